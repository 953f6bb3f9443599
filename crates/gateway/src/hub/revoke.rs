//! Revokes keys of sites: servers get the claims of the sites' account with these keys in them, and
//! end connections made with them at once.

use super::keys;
use super::link::{self, HubFiles};
use crate::nats::{next, unusable};
use async_nats::{Client, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_fleet::message::IssuedKey;
use railbus_fleet::revocation::{RevokedKey, revoke};
use railbus_store::durable;
use railbus_words::Lang;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// How long servers may take to say what they have, and that they took something.
const ANSWERS_MAX: Duration = Duration::from_secs(5);
/// What a server says of claims that it took.
const TAKEN: u64 = 200;

/// The claims that were handed over last, below the folder of the fleet.
const HANDED_OVER: &str = "hub/sites-account.jwt";

/// The result of a revocation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revocation {
    /// The servers that let the keys in no longer.
    pub servers: Vec<String>,
    /// How many servers the fleet has.
    pub of: usize,
    /// Why one of the others did not take it, if it said so.
    pub refused: Option<String>,
}

/// Revokes these keys at the servers of the fleet in this folder. `signing` is the seed of the
/// operator that signs accounts, `now` the time in seconds since 1970. Only one may run at a time.
///
/// # Errors
/// Files can't be used, no server can be reached or none takes it, or the servers' claims are not
/// those of this fleet.
pub fn revoke_keys(
    lang: Lang,
    folder: &Path,
    signing: &str,
    keys: &[RevokedKey],
    now: u64,
) -> Result<Revocation, Failure> {
    let revoked = async {
        let files = HubFiles::read(folder)?;
        let count = files.servers.len();
        let account_file = folder.join("hub/sites-account.pub");
        let account = std::fs::read_to_string(&account_file);
        let account = account.map_err(|error| unusable(&account_file, &error))?;
        let account = account.trim();
        let (client, _) = link::connect(&files, &folder.join("hub/system.creds")).await?;
        let mut tokens = claims(&client, account, count).await?;
        let kept = folder.join(HANDED_OVER);
        // There is none the first time.
        tokens.extend(std::fs::read_to_string(&kept).map(|token| token.trim().to_owned()));
        let token = revoke((&tokens, account), signing, keys, now);
        let token = token.map_err(|error| unusable(folder, &error))?;
        let kept_so = durable::replace(&kept, token.as_bytes(), None);
        kept_so.map_err(|error| unusable(&kept, &error))?;
        let (mut servers, refused) = hand_over(&client, account, &token, count).await?;
        // Another one may have handed over others at the same moment.
        let now_there = claims(&client, account, count).await?;
        if now_there.iter().filter(|there| **there == token).count() < servers.len() {
            servers.clear();
        }
        Ok(Revocation {
            servers: servers.into_iter().collect(),
            of: count,
            refused,
        })
    };
    at_once(lang, revoked)
}

/// Waits for something.
fn at_once<T>(lang: Lang, what: impl Future<Output = Result<T, Problem>>) -> Result<T, Failure> {
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| super::cant_serve(lang, error))?
        .block_on(what)
        .map_err(|problem| Failure::of_problem(lang, &problem))
}

/// Notes at the servers that the keys of this site are revoked, and these besides, each with the
/// time until which it is valid: the centre renews them no more, and invitations of before count no
/// more. All that the centre has issued.
///
/// # Errors
/// Files can't be used, no server can be reached, or the streams can't be used.
pub fn revoke_issued(
    lang: Lang,
    folder: &Path,
    site: &str,
    keys: &[(String, u64)],
) -> Result<Vec<IssuedKey>, Failure> {
    let noted = async {
        let files = HubFiles::read(folder)?;
        let (client, _) = link::connect(&files, &files.creds).await?;
        keys::revoke(client, site, keys).await
    };
    at_once(lang, noted)
}

/// Asks all servers; their answers as they come, until there are so many or it takes too long.
async fn ask(client: &Client, subject: String, payload: &str) -> Result<Subscriber, Problem> {
    let inbox = client.new_inbox();
    let answers = client.subscribe(inbox.clone()).await;
    let answers = answers.map_err(|error| link::ended(&error))?;
    let sent = client.publish_with_reply(subject, inbox, payload.to_owned().into());
    sent.await.map_err(|error| link::ended(&error))?;
    Ok(answers)
}

/// The claims of an account, as each server has them.
async fn claims(client: &Client, account: &str, count: usize) -> Result<Vec<String>, Problem> {
    let subject = format!("$SYS.REQ.ACCOUNT.{account}.CLAIMS.LOOKUP");
    let mut answers = ask(client, subject, "").await?;
    let (end, mut found) = (Instant::now() + ANSWERS_MAX, Vec::new());
    while found.len() < count
        && let Ok(Some(answer)) = timeout_at(end, next(&mut answers)).await
    {
        found.push(String::from_utf8_lossy(&answer.payload).into_owned());
    }
    Ok(found)
}

/// Hands claims over to all servers: which of them took it, and why another one did not.
async fn hand_over(
    client: &Client,
    account: &str,
    token: &str,
    count: usize,
) -> Result<(BTreeSet<String>, Option<String>), Problem> {
    let mut answers = ask(client, "$SYS.REQ.CLAIMS.UPDATE".to_owned(), token).await?;
    let end = Instant::now() + ANSWERS_MAX;
    let (mut servers, mut refused) = (BTreeSet::new(), None);
    while servers.len() < count
        && let Ok(Some(answer)) = timeout_at(end, next(&mut answers)).await
    {
        match taken_by(&answer.payload, account) {
            Ok(server) => _ = servers.insert(server),
            Err(reason) => refused = Some(reason),
        }
    }
    match (servers.is_empty(), refused) {
        (false, refused) => Ok((servers, refused)),
        (true, None) => Err(link::ended(&"no server says that it took it")),
        (true, Some(why)) => Err(Problem::new(codes::FLEET_NOT_STORED).with("reason", why)),
    }
}

/// The name of the server that took the claims of this account; or why it did not.
fn taken_by(answer: &[u8], account: &str) -> Result<String, String> {
    let answer: Value = serde_json::from_slice(answer).map_err(|error| error.to_string())?;
    let text = |path: &str| answer.pointer(path).and_then(Value::as_str);
    let is_taken = answer.pointer("/data/code").and_then(Value::as_u64) == Some(TAKEN)
        && text("/data/account") == Some(account);
    match (is_taken, text("/server/name")) {
        (true, Some(server)) => Ok(server.to_owned()),
        _ => Err(text("/error/description").unwrap_or("refused").to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn only_a_server_that_took_it_counts() {
        let said = |answer: Value| taken_by(answer.to_string().as_bytes(), "AX");
        let server = json!({ "name": "server1" });
        let data = |account: &str, code: u64| {
            let data = json!({ "account": account, "code": code });
            json!({ "server": server, "data": data })
        };
        assert_eq!(said(data("AX", 200)), Ok("server1".to_owned()));
        assert!(said(data("AY", 200)).is_err());
        assert!(said(data("AX", 500)).is_err());
        let error = json!({
            "server": server,
            "error": { "account": "AX", "code": 500, "description": "disk full" },
        });
        assert_eq!(said(error), Err("disk full".to_owned()));
        assert!(said(Value::Null).is_err());
        assert!(taken_by(b"", "AX").is_err());
    }
}
