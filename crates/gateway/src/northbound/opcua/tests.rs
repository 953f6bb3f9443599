//! Who is let in by what account, and what becomes of them. The server itself is tried by foreign
//! clients, and in its own crate.

use super::users::OutletUsers;
use crate::access::desk;
use crate::northbound::stage::{OutletStage, PATIENCE, folder, free_address};
use crate::northbound::supervisor::{OutletId, Supervised};
use railbus_opcua::{ANONYMOUS, OpcuaUsers as _};
use railbus_site::Role;
use railbus_store::audit::Origin;
use serde_json::json;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpStream;

const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";
const PASSWORD: &str = "correct horse battery";

struct Served {
    stage: OutletStage,
    at: SocketAddr,
}

impl Served {
    async fn start(name: &str) -> Served {
        let (at, folder) = (free_address().await, folder(&format!("opcua-{name}")));
        let text = format!("{SITE}[outlet.scada]\ntype = \"opcua\"\nlisten = \"{at}\"\n");
        let stage = OutletStage::running(folder, &text);
        Served { stage, at }
    }

    async fn user(&self, name: &str, role: Role, points: &[&str]) {
        let user = json!({
            "name": name, "role": role.name(), "points": points, "password": PASSWORD
        });
        let user = user.to_string();
        desk::add_user(&self.stage.accounts, user.as_bytes())
            .await
            .unwrap();
    }

    fn users(&self, allows_anonymous: bool) -> OutletUsers {
        OutletUsers::new(
            &self.stage.accounts,
            &self.stage.service,
            "opcua:scada",
            allows_anonymous,
        )
    }
}

#[tokio::test]
async fn an_identity_has_the_rights_of_its_account_as_they_are_now() {
    let served = Served::start("rights").await;
    served.user("admin", Role::Admin, &[]).await;
    served.user("li", Role::Operator, &["oven.k1"]).await;
    let users = served.users(false);
    let password = || PASSWORD.to_owned();
    assert_eq!(users.sign_in("li", "wrong".to_owned()).await, None);
    assert_eq!(users.sign_in("nobody", password()).await, None);
    let li = users.sign_in("li", password()).await.unwrap();
    let user = users.user(&li).unwrap();
    assert_eq!(user.name, "li");
    assert!(user.rights.may_switch("oven", "k1").is_ok());
    assert!(user.rights.may_switch("oven", "k2").is_err());

    let change = |body: serde_json::Value| {
        let (accounts, body) = (Arc::clone(&served.stage.accounts), body.to_string());
        async move {
            desk::change_user(&accounts, "li", None, body.as_bytes())
                .await
                .unwrap()
        }
    };
    change(json!({"points": ["oven.k2"]})).await;
    let rights = users.user(&li).unwrap().rights;
    assert!(rights.may_switch("oven", "k1").is_err() && rights.may_switch("oven", "k2").is_ok());

    // A changed password or a locked account ends the sessions signed in before.
    change(json!({"password": "another horse battery"})).await;
    assert!(users.user(&li).is_none());
    users.revoked().await;
    change(json!({"password": PASSWORD})).await;
    assert!(users.user(&li).is_none(), "signed in before");
    let again = users.sign_in("li", password()).await.unwrap();
    change(json!({"locked": true})).await;
    assert!(users.user(&again).is_none());
    assert_eq!(users.sign_in("li", password()).await, None);
}

#[tokio::test]
async fn only_a_token_signs_in_without_a_password() {
    let served = Served::start("tokens").await;
    served.user("admin", Role::Admin, &[]).await;
    let body = json!({"name": "grafana", "role": "viewer"}).to_string();
    let made = desk::add_token(&served.stage.accounts, "admin", body.as_bytes())
        .await
        .unwrap();
    let token = made["token"].as_str().unwrap().to_owned();
    let users = served.users(false);
    let identity = users.sign_in("whoever", token.clone()).await.unwrap();
    assert!(!identity.contains(&token), "it may be shown");
    let user = users.user(&identity).unwrap();
    assert_eq!(
        (&*user.name, user.rights.role),
        ("token:grafana", Role::Viewer)
    );
    desk::remove_token(&served.stage.accounts, "grafana")
        .await
        .unwrap();
    assert!(users.user(&identity).is_none());
    users.revoked().await;

    assert!(users.user(ANONYMOUS).is_none());
    let guest = served.users(true).user(ANONYMOUS).unwrap();
    assert_eq!(guest.rights.role, Role::Viewer);
    for forged in [
        "user:admin",
        "user::admin",
        "user:0000000000000000:admin",
        "token:",
        "",
    ] {
        assert!(users.user(forged).is_none(), "{forged}");
    }
}

#[tokio::test]
async fn it_answers_its_own_test_and_ends_who_does_not_say_hello() {
    let served = Served::start("hello").await;
    let id = OutletId {
        kind: super::KIND.name,
        name: "scada".to_owned(),
    };
    served.stage.until_running(&id).await;
    let by = Origin::program("tests");
    let said = served
        .stage
        .northbound
        .aside(&id, by, super::KIND.test)
        .await;
    let url = format!("opc.tcp://127.0.0.1:{}/", served.at.port());
    assert_eq!(said.unwrap().unwrap(), url);

    let mut silent = TcpStream::connect(served.at).await.unwrap();
    let mut garbage = TcpStream::connect(served.at).await.unwrap();
    tokio::io::AsyncWriteExt::write_all(&mut garbage, b"GET / HTTP/1.1\r\n\r\n")
        .await
        .unwrap();
    let mut answer = Vec::new();
    // Both end by themselves, one with an error message of the protocol.
    garbage.read_to_end(&mut answer).await.unwrap();
    answer.clear();
    silent.read_to_end(&mut answer).await.unwrap();
    let clients = |outlet: &Supervised| outlet.counts().clients.load(Relaxed);
    let gone = async {
        while served.stage.northbound.look(&id, clients) != Some(0) {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(PATIENCE, gone).await.unwrap();
}

mod relayed {
    use super::super::relay::relay;
    use std::io::ErrorKind;
    use std::sync::Arc;
    use std::time::Duration;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex, split};
    use tokio::sync::Notify;
    use tokio::time::{Instant, timeout};

    /// How much a side holds before it is read.
    const HELD: usize = 1_024;

    #[tokio::test(start_paused = true)]
    async fn bytes_go_both_ways_until_one_side_ends() {
        let (mut client, outer) = duplex(HELD);
        let (mut server, inner) = duplex(HELD);
        let relayed = tokio::spawn(relay(split(outer), split(inner), |_| true));
        for (words, size) in [("a question", 10), ("another, longer question", 24)] {
            client.write_all(words.as_bytes()).await.unwrap();
            let mut got = vec![0; size];
            server.read_exact(&mut got).await.unwrap();
            assert_eq!(got, words.as_bytes());
            server.write_all(&got).await.unwrap();
            client.read_exact(&mut got).await.unwrap();
            assert_eq!(got, words.as_bytes());
        }
        drop(client);
        let end = relayed.await.unwrap().unwrap_err();
        assert_eq!(end.kind(), ErrorKind::UnexpectedEof);
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_takes_no_answers_is_not_read_and_ends() {
        let began = Instant::now();
        let (mut client, outer) = duplex(HELD);
        let (mut server, inner) = duplex(HELD);
        let relayed = tokio::spawn(relay(split(outer), split(inner), |_| true));
        let full = Arc::new(Notify::new());
        let is_full = Arc::clone(&full);
        // More than is held on the way; the client takes none of it.
        let answers = tokio::spawn(async move {
            let (mut taken, waiting) = (0, Duration::from_millis(10));
            let mut asked = [0; HELD];
            loop {
                match timeout(waiting, server.write(&[7; HELD])).await {
                    Ok(Ok(count)) => taken += count,
                    Ok(Err(_)) => return taken,
                    Err(_) => {
                        is_full.notify_one();
                        let read = timeout(waiting, server.read(&mut asked)).await;
                        let count = read.map_or(0, Result::unwrap_or_default);
                        assert_eq!(count, 0, "it was read though it owes");
                    }
                }
            }
        });
        full.notified().await;
        client.write_all(b"and another question").await.unwrap();
        let end = relayed.await.unwrap().unwrap_err();
        assert_eq!(end.kind(), ErrorKind::TimedOut);
        let lasted = began.elapsed();
        assert!(lasted >= Duration::from_secs(10) && lasted < Duration::from_secs(12));
        assert!(answers.await.unwrap() < 64 * HELD, "bounded");
    }
}
