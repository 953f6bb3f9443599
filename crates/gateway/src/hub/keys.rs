//! Keys that the centre issues, and those that are revoked: each is noted in a document of its
//! site. Of all centre processes one gets each request; the documents are changed by
//! compare-and-set.

use super::driver::{last_of, put};
use super::link::HubFiles;
use crate::nats::{next, unusable};
use async_nats::jetstream::{self, Context};
use async_nats::{Client, Message, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::SiteSigner;
use railbus_fleet::centre::StoreEnd;
use railbus_fleet::issuing::{
    KeyWish, Signers, keys_subject, refused, revoke_noted, too_soon, wanted,
};
use railbus_fleet::message::{FleetRefusal, IssuedKey};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, SystemTime};
use tokio::task::JoinHandle;
use tokio::time::Instant;

/// How often a document is read again that another one changed meanwhile.
const TRIES: usize = 5;
/// A site that asks again within this time is refused.
const PACE: Duration = Duration::from_secs(1);
/// How long to wait for the end of a second at a time.
const MOMENT: Duration = Duration::from_millis(100);
/// The stream of the documents.
const STREAM: &str = "FLEET";

/// What answers requests for keys. Ends with its connection.
pub(super) struct KeyDesk(JoinHandle<()>);

impl Drop for KeyDesk {
    fn drop(&mut self) {
        // A key that is noted and not answered is asked for again.
        self.0.abort();
    }
}

/// Requests for keys: by invitations, and to renew them.
pub(super) struct KeyRequests {
    pub(super) joins: Subscriber,
    pub(super) renewals: Subscriber,
}

/// What the centre signs with.
fn signers(files: &HubFiles) -> Result<Signers, Problem> {
    let text = |path: &Path| {
        let text = std::fs::read_to_string(path).map_err(|error| unusable(path, &error))?;
        Ok(text.trim().to_owned())
    };
    let account = text(&files.account)?;
    let signer = |path: &Path| {
        let signer = SiteSigner::new(&text(path)?, &account);
        signer.map_err(|error| unusable(path, &error))
    };
    Ok(Signers {
        sites: signer(&files.site_signing)?,
        invitations: signer(&files.join_signing)?,
    })
}

fn now_s() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    since.map(|since| since.as_secs()).unwrap_or_default()
}

/// Answers requests for keys on this connection from now on.
///
/// # Errors
/// The keys that sign can't be read: requests are refused then.
pub(super) fn open(
    files: &HubFiles,
    client: Client,
    streams: Context,
    requests: KeyRequests,
) -> (KeyDesk, Result<(), Problem>) {
    let (signers, end) = match signers(files) {
        Ok(signers) => (Some(signers), Ok(())),
        Err(problem) => (None, Err(problem)),
    };
    let desk = tokio::spawn(serve(signers, client, streams, requests));
    (KeyDesk(desk), end)
}

async fn serve(
    signers: Option<Signers>,
    client: Client,
    streams: Context,
    mut requests: KeyRequests,
) {
    let mut answered = BTreeMap::new();
    loop {
        let (wish, message) = tokio::select! {
            message = next(&mut requests.joins) => (KeyWish::Join, message),
            message = next(&mut requests.renewals) => (KeyWish::Renew, message),
        };
        let Some(message) = message else {
            return;
        };
        let Some(reply) = message.reply.clone() else {
            continue;
        };
        // `rb.join.SITE` and `rb.up.SITE.renew`.
        let site = message.subject.split('.').nth(2).unwrap_or_default();
        let is_early = is_too_early(&mut answered, (wish, site), Instant::now());
        let answer = match &signers {
            _ if is_early => Some(refused(too_soon(wish))),
            Some(signers) => issue(signers, &streams, (wish, site), &message).await,
            None => Some(refused(FleetRefusal {
                code: codes::FLEET_FILE.code.to_owned(),
                reason: "the centre has no key to sign with".to_owned(),
            })),
        };
        if let Some(answer) = answer {
            // Fails if the connection has ended: it is asked for again.
            let _ = client.publish(reply, answer.into()).await;
        }
    }
}

/// Whether this site was answered the same a moment ago: no site takes all the time.
fn is_too_early(
    answered: &mut BTreeMap<(bool, String), Instant>,
    (wish, site): (KeyWish, &str),
    now: Instant,
) -> bool {
    answered.retain(|_, at| now.saturating_duration_since(*at) < PACE);
    let name = (wish == KeyWish::Join, site.to_owned());
    if answered.contains_key(&name) {
        return true;
    }
    answered.insert(name, now);
    false
}

/// The answer to a request; none if it could not be decided: it is repeated then.
async fn issue(
    signers: &Signers,
    streams: &Context,
    (wish, site): (KeyWish, &str),
    message: &Message,
) -> Option<Vec<u8>> {
    let wanted = match wanted(signers, wish, site, &message.payload, now_s()) {
        Ok(wanted) => wanted,
        Err(refusal) => return Some(refused(refusal)),
    };
    let subject = keys_subject(site);
    for _ in 0..TRIES {
        let (document, revision) = last_of(streams, STREAM, &subject).await?.unzip();
        match wanted.grant(signers, document.as_deref(), now_s()) {
            Err(refusal) => return Some(refused(refusal)),
            Ok((document, answer)) => {
                let revision = revision.unwrap_or_default();
                let stored = put(streams, subject.clone(), document, revision).await;
                match stored.0 {
                    StoreEnd::Stored(_) => return Some(answer),
                    StoreEnd::Conflict => {}
                    StoreEnd::Unknown => return None,
                }
            }
        }
    }
    None
}

/// Notes that all keys of a site are revoked, and these besides, each with the time until which it
/// is valid. All that are noted. Returns once an invitation that is made counts again: those of the
/// second of the revocation do not.
///
/// # Errors
/// The document can't be read or stored.
pub(super) async fn revoke(
    client: Client,
    site: &str,
    others: &[(String, u64)],
) -> Result<Vec<IssuedKey>, Problem> {
    let failed = |reason: &dyn ToString| {
        Problem::new(codes::FLEET_STREAMS).with("reason", reason.to_string())
    };
    let streams = jetstream::new(client);
    let subject = keys_subject(site);
    for _ in 0..TRIES {
        let found = last_of(&streams, STREAM, &subject).await;
        let found = found.ok_or_else(|| failed(&"the stream can't be read"))?;
        let (document, revision) = found.unzip();
        let now = now_s();
        let noted = revoke_noted(document.as_deref(), others, now);
        let (document, keys) = noted.map_err(|reason| failed(&reason))?;
        let revision = revision.unwrap_or_default();
        match put(&streams, subject.clone(), document, revision).await {
            (StoreEnd::Stored(_), _) => {
                while now_s() <= now {
                    tokio::time::sleep(MOMENT).await;
                }
                return Ok(keys);
            }
            (StoreEnd::Conflict, _) => {}
            (StoreEnd::Unknown, problem) => {
                return Err(problem.unwrap_or_else(|| failed(&"not stored")));
            }
        }
    }
    Err(failed(&"others change it all the time"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_site_does_not_take_the_time_of_others() {
        let (mut answered, now) = (BTreeMap::new(), Instant::now());
        let mut early = |site, wish, after| is_too_early(&mut answered, (wish, site), now + after);
        let half = PACE / 2;
        assert!(!early("a", KeyWish::Renew, Duration::ZERO));
        assert!(early("a", KeyWish::Renew, half));
        assert!(!early("b", KeyWish::Renew, half));
        assert!(!early("a", KeyWish::Join, half));
        // What was refused for that does not count.
        assert!(!early("a", KeyWish::Renew, PACE));
    }
}
