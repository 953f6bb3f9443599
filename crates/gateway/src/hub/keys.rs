//! Keys that the centre issues, and those that are revoked: each is noted in a document of its
//! site. Of all centre processes one gets each request; the documents are changed by
//! compare-and-set.

use super::driver::{last_of, put};
use super::link::HubFiles;
use crate::nats::{next, unusable};
use async_nats::jetstream::{self, Context};
use async_nats::{Client, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::SiteSigner;
use railbus_fleet::centre::StoreEnd;
use railbus_fleet::issuing::{
    KeyWish, Signers, VerifiedRequest, keys_subject, not_signing, refused, revoke_noted, too_often,
    wanted,
};
use railbus_fleet::message::IssuedKey;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, SystemTime};
use tokio::task::JoinHandle;
use tokio::time::Instant;

/// How often a document is read again that another one changed meanwhile.
const TRIES: usize = 5;
/// Whoever asks more often than so within this time is refused.
const PACE: Duration = Duration::from_secs(10);
const PACE_MAX: u32 = 10;
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
    // A fleet that was founded before has none for invitations.
    let invitations = files.join_signing.exists();
    let invitations = invitations.then(|| signer(&files.join_signing));
    Ok(Signers {
        sites: signer(&files.site_signing)?,
        invitations: invitations.transpose()?,
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
    let mut asked = BTreeMap::new();
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
        let signing = signers.as_ref().ok_or_else(not_signing);
        let verified = signing.and_then(|signers| {
            let verified = wanted(signers, wish, site, &message.payload, now_s())?;
            // Only of whoever may ask: nobody else can use up his turns.
            match is_too_often(&mut asked, verified.asker(), Instant::now()) {
                true => Err(too_often()),
                false => Ok((signers, verified)),
            }
        });
        let answer = match verified {
            Ok((signers, verified)) => issue(signers, &streams, site, &verified).await,
            Err(refusal) => Some(refused(refusal)),
        };
        if let Some(answer) = answer {
            // Fails if the connection has ended: it is asked for again.
            let _ = client.publish(reply, answer.into()).await;
        }
    }
}

/// Whether somebody asks so often that others would have to wait.
fn is_too_often(asked: &mut BTreeMap<String, (Instant, u32)>, asker: &str, now: Instant) -> bool {
    asked.retain(|_, (since, _)| now.saturating_duration_since(*since) < PACE);
    let (_, count) = asked.entry(asker.to_owned()).or_insert((now, 0));
    *count = count.saturating_add(1);
    *count > PACE_MAX
}

/// The answer to a request; none if it could not be decided: it is repeated then.
async fn issue(
    signers: &Signers,
    streams: &Context,
    site: &str,
    wanted: &VerifiedRequest,
) -> Option<Vec<u8>> {
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
/// is valid. All that are noted.
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
        let noted = revoke_noted(document.as_deref(), others, now_s());
        let (document, keys) = noted.map_err(|reason| failed(&reason))?;
        let revision = revision.unwrap_or_default();
        match put(&streams, subject.clone(), document, revision).await {
            (StoreEnd::Stored(_), _) => return Ok(keys),
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
    fn who_asks_all_the_time_is_refused_and_nobody_else() {
        let (mut asked, now) = (BTreeMap::new(), Instant::now());
        let mut often = |asker, after| is_too_often(&mut asked, asker, now + after);
        for _ in 0..PACE_MAX {
            assert!(!often("a", Duration::ZERO));
        }
        assert!(often("a", PACE / 2));
        assert!(!often("b", PACE / 2));
        assert!(!often("a", PACE));
    }
}
