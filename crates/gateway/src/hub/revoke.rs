//! Revokes keys of sites: servers get the claims of the sites' account with these keys in them, and
//! end connections made with them at once.

use super::link::{self, HubFiles};
use crate::nats::next;
use async_nats::Client;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_fleet::revocation::{RevokedKey, revoke};
use railbus_words::Lang;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;
use tokio::time::{Instant, timeout, timeout_at};

/// How long servers may take to say what they have, and that they took something.
const ANSWERS_MAX: Duration = Duration::from_secs(5);
/// What a server says of claims that it took.
const TAKEN: u64 = 200;

/// The result of a revocation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revocation {
    /// The servers that know it.
    pub servers: Vec<String>,
    /// How many servers the fleet has.
    pub of: usize,
}

/// Revokes these keys at the servers of the fleet in this folder. `signing` is the seed of the
/// operator that signs accounts, `now` the time in seconds since 1970.
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
        let account_file = folder.join("hub/sites-account.pub");
        let account = std::fs::read_to_string(&account_file);
        let account = account.map_err(|error| link::unusable(&account_file, &error))?;
        let account = account.trim();
        let (client, _) = link::connect(&files, &folder.join("hub/system.creds")).await?;
        let token = claims(&client, account).await?;
        let token = revoke((&token, account), signing, keys, now);
        let token = token.map_err(|error| link::unusable(folder, &error))?;
        let servers = hand_over(&client, account, token, files.servers.len()).await?;
        Ok(Revocation {
            servers: servers.into_iter().collect(),
            of: files.servers.len(),
        })
    };
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| super::cant_serve(lang, error))?
        .block_on(revoked)
        .map_err(|problem: Problem| Failure::of_problem(lang, &problem))
}

/// The claims of an account, as a server has them.
async fn claims(client: &Client, account: &str) -> Result<String, Problem> {
    let subject = format!("$SYS.REQ.ACCOUNT.{account}.CLAIMS.LOOKUP");
    let asked = timeout(ANSWERS_MAX, client.request(subject, Vec::new().into())).await;
    let answer = asked.map_err(|_| link::ended(&"the servers do not say whom they let in"))?;
    let answer = answer.map_err(|error| link::ended(&error))?;
    Ok(String::from_utf8_lossy(&answer.payload).into_owned())
}

/// Hands claims over to all servers; which of them took it.
async fn hand_over(
    client: &Client,
    account: &str,
    token: String,
    count: usize,
) -> Result<BTreeSet<String>, Problem> {
    let inbox = client.new_inbox();
    let answers = client.subscribe(inbox.clone()).await;
    let mut answers = answers.map_err(|error| link::ended(&error))?;
    let sent = client.publish_with_reply("$SYS.REQ.CLAIMS.UPDATE", inbox, token.into());
    sent.await.map_err(|error| link::ended(&error))?;
    let end = Instant::now() + ANSWERS_MAX;
    let (mut servers, mut refused) = (BTreeSet::new(), String::new());
    while servers.len() < count
        && let Ok(Some(answer)) = timeout_at(end, next(&mut answers)).await
    {
        match taken_by(&answer.payload, account) {
            Ok(server) => _ = servers.insert(server),
            Err(reason) => refused = reason,
        }
    }
    match servers.is_empty() {
        false => Ok(servers),
        true if refused.is_empty() => Err(link::ended(&"no server says that it took it")),
        true => Err(Problem::new(codes::FLEET_NOT_STORED).with("reason", refused)),
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
