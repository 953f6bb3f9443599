//! Tests of the gate.

use super::super::accounts::{TokenWish, new_logins};
use super::super::password;
use super::*;
use axum::http::HeaderValue;

const HERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

struct Folder(std::path::PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn opened(folder: &Path) -> Arc<Gate> {
    let access = Gate::open(folder);
    Arc::new(access.unwrap_or_else(|problem| panic!("{problem:?}")))
}

async fn access(name: &str) -> (Arc<Gate>, Folder) {
    let unique = format!("railbus-gate-{}-{name}", std::process::id());
    let folder = std::env::temp_dir().join(unique);
    let access = opened(&folder);
    let user = User {
        name: "li".to_owned(),
        role: Role::Admin,
        points: Vec::new(),
        password: hashed("correct horse"),
        locked: false,
        lang: None,
        logins: new_logins().unwrap_or_else(|problem| panic!("{problem:?}")),
        created: Timestamp::now(),
    };
    let second = User {
        name: "wang".to_owned(),
        ..user.clone()
    };
    let added = access.change(|accounts| accounts.add_user(user)).await;
    assert!(added.is_ok());
    let added = access.change(|accounts| accounts.add_user(second)).await;
    assert!(added.is_ok());
    (access, Folder(folder))
}

async fn log_in(access: &Gate, name: &str, password: &str) -> Result<Secret, String> {
    let password = Secret::new(password.to_owned());
    let done = access.log_in(name, password, HERE).await;
    done.map_err(|problem| problem.code)
}

fn with(name: &'static str, value: &str) -> HeaderMap {
    let value = HeaderValue::from_str(value).unwrap_or_else(|_| panic!("ASCII"));
    HeaderMap::from_iter([(axum::http::HeaderName::from_static(name), value)])
}

#[tokio::test]
async fn wrong_tries_are_refused_alike_and_counted() {
    let (access, _folder) = access("tries").await;
    let code = |end: Result<Secret, String>| end.err().unwrap_or_default();
    assert_eq!(code(log_in(&access, "li", "correct horse").await), "");
    assert_eq!(code(log_in(&access, "li", "wrong").await), "E0904");
    assert_eq!(code(log_in(&access, "nobody", "wrong").await), "E0904");
    for _ in 0..3 {
        assert_eq!(code(log_in(&access, "nobody", "wrong").await), "E0904");
    }
    let right = log_in(&access, "li", "correct horse").await;
    assert_eq!(code(right), "E0907", "the address has no try left");
}

#[tokio::test]
async fn a_session_is_known_by_its_cookie_and_ends_with_its_user() {
    let (access, _folder) = access("session").await;
    let Ok(secret) = log_in(&access, "li", "correct horse").await else {
        panic!("it logs in");
    };
    let cookie = |name: &str| with("cookie", &format!("a=b; {name}={}", secret.expose()));
    let others = cookie(&format!("{COOKIE_NAME}_0"));
    assert!(access.cookie(&others).is_none(), "another daemon's");
    let mut headers = cookie(&access.cookie_name);
    let caller = access.caller(&headers, None, HERE);
    assert_eq!(
        (caller.name.as_str(), caller.role),
        ("li", Some(Role::Admin))
    );
    assert!(matches!(
        caller.known,
        Known::Session { is_ours: false, .. }
    ));
    let token = HeaderValue::from_str(&csrf(secret.expose())).unwrap();
    headers.insert(CSRF_HEADER, token);
    let ours = access.caller(&headers, None, HERE);
    assert!(matches!(ours.known, Known::Session { is_ours: true, .. }));
    headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
    let query = format!("a=1&csrf={}", csrf(secret.expose()));
    let socket = access.caller(&headers, Some(&query), HERE);
    assert!(matches!(socket.known, Known::Session { is_ours: true, .. }));

    let lock = UserChange {
        locked: Some(true),
        ..UserChange::default()
    };
    let gone = access.gone(&ours);
    let locked = access.change(|accounts| accounts.change_user("li", lock));
    let (locked, ()) = tokio::join!(locked, gone);
    assert!(locked.is_ok());
    assert_eq!(access.caller(&headers, None, HERE).role, None);
    let again = log_in(&access, "li", "correct horse").await;
    assert_eq!(again.err().as_deref(), Some("E0904"));
}

/// The program ends between the write of another password and that of the sessions.
#[tokio::test]
async fn a_crash_brings_no_session_back_that_a_password_or_a_lock_has_ended() {
    let (access, folder) = access("crash").await;
    let mut cookies = Vec::new();
    for name in ["li", "wang"] {
        cookies.push(log_in(&access, name, "correct horse").await.unwrap());
    }
    let changes = [
        UserChange {
            password: Some(hashed("battery staple")),
            ..UserChange::default()
        },
        UserChange {
            locked: Some(true),
            ..UserChange::default()
        },
    ];
    for (name, change) in ["li", "wang"].into_iter().zip(changes) {
        let changed = access.change(|accounts| accounts.change_user(name, change));
        assert!(changed.await.is_ok());
    }
    drop(access);
    let again = opened(&folder.0);
    let unlock = UserChange {
        locked: Some(false),
        ..UserChange::default()
    };
    let unlocked = again.change(|accounts| accounts.change_user("wang", unlock));
    assert!(unlocked.await.is_ok());
    for secret in &cookies {
        let cookie = format!("{}={}", again.cookie_name, secret.expose());
        let caller = again.caller(&with("cookie", &cookie), None, HERE);
        assert_eq!(caller.role, None, "{}", caller.name);
    }
    // Who asks for another password himself stays logged in, also over a restart.
    let own = log_in(&again, "li", "battery staple").await.unwrap();
    let logins = again.logins_of("li").unwrap();
    let key = own.fingerprint();
    let changed = again.change_own_password(("li", &logins), hashed("staple"), &key);
    assert!(changed.await.is_ok());
    drop(again);
    let third = opened(&folder.0);
    let cookie = format!("{}={}", third.cookie_name, own.expose());
    let caller = third.caller(&with("cookie", &cookie), None, HERE);
    assert_eq!(caller.name, "li");
}

fn hashed(password: &str) -> Hashed {
    let hashed = password::hash(&Secret::new(password.to_owned()));
    hashed.unwrap_or_else(|problem| panic!("{problem:?}"))
}

/// Its connection is cut while it is written.
#[tokio::test]
async fn a_change_whose_asker_goes_away_is_whole() {
    let (access, folder) = access("gone").await;
    let session = log_in(&access, "wang", "correct horse").await.unwrap();
    let lock = UserChange {
        locked: Some(true),
        ..UserChange::default()
    };
    {
        let lock = |accounts: &mut Accounts| accounts.change_user("wang", lock);
        let change = access.change_and_end(Some(("wang", None)), lock);
        let mut context = std::task::Context::from_waker(std::task::Waker::noop());
        assert!(std::pin::pin!(change).poll(&mut context).is_pending());
    }
    // One after the other: the next one is done when that is.
    assert!(access.change(|_| Ok(())).await.is_ok());
    let on_disk = Store::look(&folder.0).unwrap_or_else(|problem| panic!("{problem:?}"));
    assert!(on_disk.user("wang").is_some_and(|user| user.locked));
    assert!(access.unlocked("wang").is_none());
    assert!(
        !access
            .sessions
            .lasts(&session.fingerprint(), Instant::now())
    );
}

/// An administrator gives another password, or locks, while the one that is asked for by who
/// knew the old one is hashed.
#[tokio::test]
async fn a_password_under_way_undoes_no_reset_and_no_lock() {
    let (access, _folder) = access("reset").await;
    let reset = UserChange {
        password: Some(hashed("reset by li")),
        ..UserChange::default()
    };
    let lock = UserChange {
        locked: Some(true),
        ..UserChange::default()
    };
    for (password, change) in [("correct horse", reset), ("reset by li", lock)] {
        let own = log_in(&access, "wang", password)
            .await
            .unwrap()
            .fingerprint();
        let old = Secret::new(password.to_owned());
        let logins = access.confirm("wang", old, HERE).await;
        let logins = logins.unwrap_or_else(|problem| panic!("{problem:?}"));
        let changed = access.change(|accounts| accounts.change_user("wang", change));
        assert!(changed.await.is_ok());
        let before = access.password_of("wang");
        let new = hashed("of the thief");
        let late = access.change_own_password(("wang", &logins), new, &own);
        let refused = late.await.err().map(|problem| problem.code);
        assert_eq!(refused.as_deref(), Some("E0904"));
        assert!(access.password_of("wang") == before);
    }
}

#[tokio::test]
async fn a_token_is_known_and_only_by_itself() {
    let (access, _folder) = access("token").await;
    let wish = TokenWish {
        name: "ci".to_owned(),
        role: Role::Operator,
        points: vec!["pump.*".to_owned()],
        days: 1,
    };
    let made = access.change(|accounts| accounts.add_token(wish, "li", Timestamp::now()));
    let Ok((_, secret)) = made.await else {
        panic!("it is made");
    };
    let bearer = |text: String| access.caller(&with("authorization", &text), None, HERE);
    let caller = bearer(format!("Bearer {}", secret.expose()));
    assert_eq!(caller.name, "token:ci");
    assert_eq!(caller.role, Some(Role::Operator));
    assert!(caller.may_write("oven.k1").is_err());
    for other in ["Bearer rb_0", "Bearer ", "", "Basic bGk6eA=="] {
        assert_eq!(bearer(other.to_owned()).role, None, "{other}");
    }
    let lost = format!("Token {}", secret.expose());
    assert_eq!(bearer(lost).role, None);
}

#[tokio::test]
async fn what_was_changed_is_there_after_a_new_start() {
    let (access, folder) = access("restart").await;
    let removed = access.change(|accounts| accounts.remove_user("wang")).await;
    assert!(removed.is_ok());
    let refused = access.change(|accounts| accounts.remove_user("li")).await;
    assert!(refused.is_err(), "the last one");
    drop(access);
    let again = opened(&folder.0);
    assert_eq!(again.read(|accounts| accounts.users().len()), 1);
    assert!(!again.is_new());
}
