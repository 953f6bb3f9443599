//! Keys that the centre issues: one for each invitation, and claims for another 90 days before a
//! key expires. Each is recorded in a document of its site first, so that it can be revoked.
//!
//! A site's private key never leaves it: what is issued are claims for its public key. A key is
//! renewed only for itself, so a stolen key does not lead to others.

use crate::creds::{CredsError, SiteClaims, SiteSigner};
use crate::message::{FleetRefusal, IssuedKey, KeyAnswer, KeyRequest, KeyResult, SiteKeys};
use crate::revocation::is_site_key;
use crate::{DAY_S, SITE_VALID_S};
use prost::Message as _;

/// The maximum number of recorded keys of a site. More are not issued until some have expired.
const KEYS_MAX: usize = 64;
/// The longest request, in bytes.
const REQUEST_MAX: usize = 4 << 10;

/// How far the clock of the centre may be behind that of the machine that signed what it is shown,
/// in seconds. A centre that is further behind would issue what has expired already.
const BEHIND_MAX_S: u64 = 300;
/// How long a key is noted after it has expired, in seconds: the clock of a centre may be wrong.
const NOTED_AFTER_S: u64 = 30 * DAY_S;

/// The code of a renewal that is refused.
const NOT_RENEWED: &str = "E0934";
/// The code of an invitation that is refused.
const NOT_INVITED: &str = "E0938";
/// The code of a request that the centre can't process now.
const NONE_ISSUED: &str = "E0939";

/// What the centre signs with.
#[derive(Debug)]
pub struct Signers {
    /// Keys of sites.
    pub sites: SiteSigner,
    /// Invitations; none in a fleet that was founded without.
    pub invitations: Option<SiteSigner>,
    /// The public key that signs configurations, which an invited site is told; empty if the fleet
    /// has none.
    pub config_key: String,
}

/// How a key is requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyRequestKind {
    /// By an invitation: `rb.join.SITE`.
    Join,
    /// With the key itself: `rb.up.SITE.renew`.
    Renew,
}

impl KeyRequestKind {
    /// The code of a refusal.
    const fn refused(self) -> &'static str {
        match self {
            KeyRequestKind::Join => NOT_INVITED,
            KeyRequestKind::Renew => NOT_RENEWED,
        }
    }
}

/// A request that may be granted, as far as the noted keys of its site allow it.
#[derive(Debug)]
pub struct VerifiedRequest {
    site: String,
    key: String,
    kind: KeyRequestKind,
    claims: SiteClaims,
}

/// Why a key is not issued.
fn refusal(code: &str, reason: &str) -> FleetRefusal {
    FleetRefusal {
        code: code.to_owned(),
        reason: reason.to_owned(),
    }
}

/// The refusal of a requester that exceeds the rate limit.
#[must_use]
pub fn rate_limited() -> FleetRefusal {
    refusal(NONE_ISSUED, "it was asked for too often: wait ten seconds")
}

/// The refusal of a centre without the key that signs.
#[must_use]
pub fn no_signing_key() -> FleetRefusal {
    refusal(NONE_ISSUED, "the centre has no key to sign with")
}

/// The answer that refuses.
#[must_use]
pub fn refused(refusal: FleetRefusal) -> Vec<u8> {
    let end = Some(KeyResult::Refusal(refusal));
    KeyAnswer {
        end,
        config_key: String::new(),
    }
    .encode_to_vec()
}

/// Where the keys of a site are noted.
#[must_use]
pub fn keys_subject(site: &str) -> String {
    format!("rb.fleet.key.{site}")
}

/// Reads a request to the subject of this site, at this time in seconds since 1970.
///
/// # Errors
/// What it shows was not signed by the centre, or is not valid any more, or not of this site.
pub fn verify(
    signers: &Signers,
    kind: KeyRequestKind,
    site: &str,
    payload: &[u8],
    now: u64,
) -> Result<VerifiedRequest, FleetRefusal> {
    let code = kind.refused();
    let signer = match kind {
        KeyRequestKind::Join => signers.invitations.as_ref().ok_or_else(no_signing_key)?,
        KeyRequestKind::Renew => &signers.sites,
    };
    let request = (payload.len() <= REQUEST_MAX).then(|| KeyRequest::decode(payload).ok());
    let request = request
        .flatten()
        .ok_or_else(|| refusal(code, "the request can't be read"))?;
    let claims = signer.verified(&request.token, now);
    let claims = claims.filter(|claims| claims.site == site);
    let unknown = "it has expired, or is not of this fleet and site";
    let claims = claims.ok_or_else(|| refusal(code, unknown))?;
    if claims.issued > now.saturating_add(BEHIND_MAX_S) {
        return Err(refusal(NONE_ISSUED, "the clock of the centre is behind"));
    }
    let key = match kind {
        KeyRequestKind::Join => request.key,
        KeyRequestKind::Renew => claims.key.clone(),
    };
    if !is_site_key(&key) {
        return Err(refusal(code, "this is no public key of a site"));
    }
    Ok(VerifiedRequest {
        site: site.to_owned(),
        key,
        kind,
        claims,
    })
}

impl VerifiedRequest {
    /// Identifies the requester: the number of the invitation, or the key.
    #[must_use]
    pub fn requester(&self) -> &str {
        match self.kind {
            KeyRequestKind::Join => &self.claims.id,
            KeyRequestKind::Renew => &self.key,
        }
    }

    /// Grants it: notes the key in the document of its site, which has to be stored before the
    /// answer is sent.
    ///
    /// # Errors
    /// The invitation was used, or the key or the invitation was revoked, or there are too many
    /// keys, or the document can't be read.
    pub fn grant(
        &self,
        signers: &Signers,
        document: Option<&[u8]>,
        now: u64,
    ) -> Result<(Vec<u8>, Vec<u8>), FleetRefusal> {
        let code = self.kind.refused();
        let mut known = read(document).map_err(|reason| refusal(code, &reason))?;
        forget_old(&mut known, now);
        let until_s = now.saturating_add(SITE_VALID_S);
        let noted = known.keys.iter_mut().find(|noted| noted.key == self.key);
        if noted.as_ref().is_some_and(|noted| noted.is_revoked) {
            return Err(refusal(code, "the key was revoked"));
        }
        let invitation = match self.kind {
            KeyRequestKind::Renew => String::new(),
            KeyRequestKind::Join => self.claims.id.clone(),
        };
        if self.claims.issued <= known.revoked_s {
            return Err(refusal(code, "the keys of this site were revoked since"));
        }
        match noted {
            Some(noted) if self.kind == KeyRequestKind::Renew || noted.invitation == invitation => {
                noted.until_s = noted.until_s.max(until_s);
            }
            Some(_) => return Err(refusal(code, "the key is there already")),
            None => {
                let is_used = |noted: &IssuedKey| noted.invitation == invitation;
                if self.kind == KeyRequestKind::Join && known.keys.iter().any(is_used) {
                    return Err(refusal(code, "it was used before"));
                }
                if known.keys.len() >= KEYS_MAX {
                    return Err(refusal(NONE_ISSUED, "this site has too many keys"));
                }
                known.keys.push(IssuedKey {
                    key: self.key.clone(),
                    until_s,
                    invitation,
                    is_revoked: false,
                });
            }
        }
        // Not earlier than the claims in the request, which are later than the last revocation.
        let issued = now.max(self.claims.issued);
        let token = signers
            .sites
            .token(&self.site, &self.key, issued, SITE_VALID_S);
        let token = token.map_err(|error: CredsError| refusal(code, &error.to_string()))?;
        let end = Some(KeyResult::Token(token));
        let answer = KeyAnswer {
            end,
            config_key: signers.config_key.clone(),
        };
        Ok((known.encode_to_vec(), answer.encode_to_vec()))
    }
}

/// Notes in the document of a site that its keys are revoked, and these besides, each with the time
/// until which it is valid, at this time in seconds since 1970. The document, and all keys that it
/// has.
///
/// # Errors
/// The document can't be read.
pub fn revoke_noted(
    document: Option<&[u8]>,
    others: &[(String, u64)],
    now: u64,
) -> Result<(Vec<u8>, Vec<IssuedKey>), String> {
    let mut known = read(document)?;
    forget_old(&mut known, now);
    for (key, until_s) in others.iter().filter(|(_, until)| *until > now) {
        if !known.keys.iter().any(|noted| noted.key == *key) {
            known.keys.push(IssuedKey {
                key: key.clone(),
                until_s: *until_s,
                invitation: String::new(),
                is_revoked: true,
            });
        }
    }
    // Several machines may revoke, and their clocks differ.
    let is_ahead = known.revoked_s > now.saturating_add(DAY_S);
    known.revoked_s = match is_ahead {
        // The earlier clock was more than a day ahead: all requests would be refused until then.
        true => now,
        false => known.revoked_s.max(now),
    };
    for noted in &mut known.keys {
        noted.is_revoked = true;
    }
    Ok((known.encode_to_vec(), known.keys))
}

/// Drops keys that have expired long ago.
fn forget_old(known: &mut SiteKeys, now: u64) {
    let is_noted = |noted: &IssuedKey| noted.until_s.saturating_add(NOTED_AFTER_S) > now;
    known.keys.retain(is_noted);
}

fn read(document: Option<&[u8]>) -> Result<SiteKeys, String> {
    let known = document.map(SiteKeys::decode).transpose();
    let known = known.map_err(|error| format!("the noted keys can't be read: {error}"))?;
    Ok(known.unwrap_or_default())
}

#[cfg(test)]
mod tests;
