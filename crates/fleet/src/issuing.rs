//! Keys that the centre issues: to whoever has an invitation, once, and to a site again before its
//! key expires. Each is noted in a document of its site first, so that it can be revoked.
//!
//! A site's private key never leaves it: what is issued are claims for its public key. A key is
//! renewed only for itself, so a thief can't make others with one that he has.

use crate::creds::{CredsError, SiteClaims, SiteSigner};
use crate::message::{FleetRefusal, IssuedKey, KeyAnswer, KeyRequest, KeyResult, SiteKeys};
use crate::revocation::is_site_key;
use crate::{DAY_S, SITE_VALID_S};
use prost::Message as _;

/// The most keys of a site that are noted. More are not issued until some have expired.
const KEYS_MAX: usize = 64;
/// The longest request, in bytes.
const REQUEST_MAX: usize = 4 << 10;

/// How far the clock of the centre may be behind that of the machine that signed what it is shown,
/// in seconds. A centre that is further behind would issue what has expired already.
const BEHIND_MAX_S: u64 = 300;
/// How long a key is noted after it has expired, in seconds: the clock of a centre may be wrong.
const NOTED_AFTER_S: u64 = 30 * DAY_S;

/// The code of what is refused to a site.
const NOT_RENEWED: &str = "E0934";
/// The code of what is refused to somebody invited.
const NOT_INVITED: &str = "E0938";
/// The code where the centre can't issue a key, whoever asks.
const NONE_ISSUED: &str = "E0939";

/// What the centre signs with.
#[derive(Debug)]
pub struct Signers {
    /// Keys of sites.
    pub sites: SiteSigner,
    /// Invitations; none in a fleet that was founded without.
    pub invitations: Option<SiteSigner>,
}

/// How somebody asks for a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyWish {
    /// By an invitation: `rb.join.SITE`.
    Join,
    /// With the key itself: `rb.up.SITE.renew`.
    Renew,
}

impl KeyWish {
    /// The code of a refusal.
    const fn refused(self) -> &'static str {
        match self {
            KeyWish::Join => NOT_INVITED,
            KeyWish::Renew => NOT_RENEWED,
        }
    }
}

/// A request that may be granted, as far as the noted keys of its site allow it.
#[derive(Debug)]
pub struct VerifiedRequest {
    site: String,
    key: String,
    wish: KeyWish,
    claims: SiteClaims,
}

/// Why a key is not issued.
fn refusal(code: &str, reason: &str) -> FleetRefusal {
    FleetRefusal {
        code: code.to_owned(),
        reason: reason.to_owned(),
    }
}

/// Why a key is not issued to who asks for it all the time.
#[must_use]
pub fn too_often() -> FleetRefusal {
    refusal(NONE_ISSUED, "it was asked for too often: wait ten seconds")
}

/// Why no key is issued by a centre that has none to sign with.
#[must_use]
pub fn not_signing() -> FleetRefusal {
    refusal(NONE_ISSUED, "the centre has no key to sign with")
}

/// The answer that refuses.
#[must_use]
pub fn refused(refusal: FleetRefusal) -> Vec<u8> {
    let end = Some(KeyResult::Refusal(refusal));
    KeyAnswer { end }.encode_to_vec()
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
pub fn wanted(
    signers: &Signers,
    wish: KeyWish,
    site: &str,
    payload: &[u8],
    now: u64,
) -> Result<VerifiedRequest, FleetRefusal> {
    let code = wish.refused();
    let signer = match wish {
        KeyWish::Join => signers.invitations.as_ref().ok_or_else(not_signing)?,
        KeyWish::Renew => &signers.sites,
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
    let key = match wish {
        KeyWish::Join => request.key,
        KeyWish::Renew => claims.key.clone(),
    };
    if !is_site_key(&key) {
        return Err(refusal(code, "this is no public key of a site"));
    }
    Ok(VerifiedRequest {
        site: site.to_owned(),
        key,
        wish,
        claims,
    })
}

impl VerifiedRequest {
    /// What distinguishes who asks: the number of his invitation, or his key.
    #[must_use]
    pub fn asker(&self) -> &str {
        match self.wish {
            KeyWish::Join => &self.claims.id,
            KeyWish::Renew => &self.key,
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
        let code = self.wish.refused();
        let mut known = read(document).map_err(|reason| refusal(code, &reason))?;
        forget_old(&mut known, now);
        let until_s = now.saturating_add(SITE_VALID_S);
        let noted = known.keys.iter_mut().find(|noted| noted.key == self.key);
        if noted.as_ref().is_some_and(|noted| noted.is_revoked) {
            return Err(refusal(code, "the key was revoked"));
        }
        let invitation = match self.wish {
            KeyWish::Renew => String::new(),
            KeyWish::Join => self.claims.id.clone(),
        };
        if self.claims.issued <= known.revoked_s {
            return Err(refusal(code, "the keys of this site were revoked since"));
        }
        match noted {
            Some(noted) if self.wish == KeyWish::Renew || noted.invitation == invitation => {
                noted.until_s = noted.until_s.max(until_s);
            }
            Some(_) => return Err(refusal(code, "the key is there already")),
            None => {
                let is_used = |noted: &IssuedKey| noted.invitation == invitation;
                if self.wish == KeyWish::Join && known.keys.iter().any(is_used) {
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
        // Not before what it is signed for: that was signed after the last revocation.
        let issued = now.max(self.claims.issued);
        let token = signers
            .sites
            .token(&self.site, &self.key, issued, SITE_VALID_S);
        let token = token.map_err(|error: CredsError| refusal(code, &error.to_string()))?;
        let end = Some(KeyResult::Token(token));
        Ok((known.encode_to_vec(), KeyAnswer { end }.encode_to_vec()))
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
    // The clocks of those who revoke differ.
    let is_ahead = known.revoked_s > now.saturating_add(DAY_S);
    known.revoked_s = match is_ahead {
        // That one was so wrong that nobody could join any more.
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
