//! Keys that the centre issues, and those that are revoked: each is noted in a document of its
//! site. Of all centre processes one gets each request; the documents are changed by
//! compare-and-set.

use super::link::HubFiles;
use super::streams::{last_of, put};
use crate::clock::unix_s;
use crate::nats::{next, unusable};
use async_nats::jetstream::{self, Context};
use async_nats::{Client, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::SiteSigner;
use railbus_fleet::centre::StoreEnd;
use railbus_fleet::desired::ConfigSigner;
use railbus_fleet::issuing::{
    KeyRequestKind, Signers, VerifiedRequest, keys_subject, no_signing_key, rate_limited, refused,
    revoke_noted, verify,
};
use railbus_fleet::message::IssuedKey;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio::time::Instant;

/// How often a document is read again after a conflict.
const TRIES: usize = 5;
/// The rate limit: so many requests of one requester in this time.
const PACE: Duration = Duration::from_secs(10);
const PACE_MAX: u32 = 10;
/// The stream of the documents.
const STREAM: &str = "FLEET";

/// What answers requests for keys. Ends with its connection.
pub(super) struct KeyIssuer(JoinHandle<()>);

impl Drop for KeyIssuer {
    fn drop(&mut self) {
        // A request that was recorded but not answered can be repeated: it gets the same key.
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
    // Sites get their keys also where this one can't be read; what is to be signed with it is
    // refused.
    let config = config_signer(files).ok().flatten();
    Ok(Signers {
        sites: signer(&files.site_signing)?,
        invitations: invitations.transpose()?,
        config_key: config.map_or_else(String::new, |signer| signer.public_key()),
    })
}

/// What the centre signs configurations with; none if its fleet has no such key.
///
/// # Errors
/// The file can't be used.
pub(super) fn config_signer(files: &HubFiles) -> Result<Option<ConfigSigner>, Problem> {
    let path = &files.config_signing;
    let seed = match std::fs::read_to_string(path) {
        Ok(seed) => seed,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(unusable(path, &error)),
    };
    let signer = ConfigSigner::from_seed(&seed);
    signer.map(Some).map_err(|error| unusable(path, &error))
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
) -> (KeyIssuer, Result<(), Problem>) {
    let (signers, end) = match signers(files) {
        Ok(signers) => (Some(signers), Ok(())),
        Err(problem) => (None, Err(problem)),
    };
    let desk = tokio::spawn(serve(signers, client, streams, requests));
    (KeyIssuer(desk), end)
}

async fn serve(
    signers: Option<Signers>,
    client: Client,
    streams: Context,
    mut requests: KeyRequests,
) {
    let mut asked = BTreeMap::new();
    loop {
        let (kind, message) = tokio::select! {
            message = next(&mut requests.joins) => (KeyRequestKind::Join, message),
            message = next(&mut requests.renewals) => (KeyRequestKind::Renew, message),
        };
        let Some(message) = message else {
            return;
        };
        let Some(reply) = message.reply.clone() else {
            continue;
        };
        // `rb.join.SITE` and `rb.up.SITE.renew`.
        let site = message.subject.split('.').nth(2).unwrap_or_default();
        let signing = signers.as_ref().ok_or_else(no_signing_key);
        let verified = signing.and_then(|signers| {
            let verified = verify(signers, kind, site, &message.payload, unix_s())?;
            // Only verified requests count, so that others can't exhaust the limit.
            match exceeds_rate(&mut asked, verified.requester(), Instant::now()) {
                true => Err(rate_limited()),
                false => Ok((signers, verified)),
            }
        });
        let answer = match verified {
            Ok((signers, verified)) => issue(signers, &streams, site, &verified).await,
            Err(refusal) => Some(refused(refusal)),
        };
        if let Some(answer) = answer {
            // Fails if the connection has ended, as if the answer were lost.
            let _ = client.publish(reply, answer.into()).await;
        }
    }
}

/// Whether a requester exceeds the rate limit.
fn exceeds_rate(
    asked: &mut BTreeMap<String, (Instant, u32)>,
    requester: &str,
    now: Instant,
) -> bool {
    asked.retain(|_, (since, _)| now.saturating_duration_since(*since) < PACE);
    let (_, count) = asked.entry(requester.to_owned()).or_insert((now, 0));
    *count = count.saturating_add(1);
    *count > PACE_MAX
}

/// The answer to a request; none if it could not be decided, as if it were lost.
async fn issue(
    signers: &Signers,
    streams: &Context,
    site: &str,
    wanted: &VerifiedRequest,
) -> Option<Vec<u8>> {
    let subject = keys_subject(site);
    for _ in 0..TRIES {
        let (document, revision) = last_of(streams, STREAM, &subject).await?.unzip();
        match wanted.grant(signers, document.as_deref(), unix_s()) {
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
        let noted = revoke_noted(document.as_deref(), others, unix_s());
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
    Err(failed(&"too many conflicts"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_asks_all_the_time_is_refused_and_nobody_else() {
        let (mut asked, now) = (BTreeMap::new(), Instant::now());
        let mut often = |requester, after| exceeds_rate(&mut asked, requester, now + after);
        for _ in 0..PACE_MAX {
            assert!(!often("a", Duration::ZERO));
        }
        assert!(often("a", PACE / 2));
        assert!(!often("b", PACE / 2));
        assert!(!often("a", PACE));
    }
}
