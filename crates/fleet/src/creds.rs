//! A user's claims and his key as one file, in the form that every NATS client reads.

use crate::claims::{self, Claims};
use crate::is_site_name;
use data_encoding::BASE64URL_NOPAD;
use nkeys::{KeyPair, KeyPairType};
use serde_json::Value;

/// Why there are no credentials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CredsError {
    /// It can't be the name of a site.
    Name,
    /// This is no seed of an account's signing key.
    Signing,
    /// This is no public key of an account.
    Account,
    /// There is no key.
    Key,
    /// These are no credentials of a site.
    Claims,
}

impl std::fmt::Display for CredsError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            CredsError::Name => "a site's name has 1 to 64 of a-z, 0-9, - and _",
            CredsError::Signing => "this is no seed of an account's key",
            CredsError::Account => "this is no public key of an account",
            CredsError::Key => "no key could be made",
            CredsError::Claims => "these are no credentials of a site",
        })
    }
}

impl std::error::Error for CredsError {}

/// Signs keys of one kind, of sites or of invitations: the kind is a property of the signing key,
/// to which the servers give the rights.
pub struct SiteSigner {
    signing: KeyPair,
    account: String,
}

impl std::fmt::Debug for SiteSigner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.signing.public_key())
    }
}

impl SiteSigner {
    /// With the seed of a signing key, for the account with this public key.
    ///
    /// # Errors
    /// They are none of an account.
    pub fn new(signing: &str, account: &str) -> Result<SiteSigner, CredsError> {
        let account = KeyPair::from_public_key(account);
        let account = account.map_err(|_| CredsError::Account)?;
        let signing = KeyPair::from_seed(signing).map_err(|_| CredsError::Signing)?;
        for (key, error) in [
            (&account, CredsError::Account),
            (&signing, CredsError::Signing),
        ] {
            if key.key_pair_type() != KeyPairType::Account {
                return Err(error);
            }
        }
        Ok(SiteSigner {
            signing,
            account: account.public_key(),
        })
    }

    /// The credentials of a site with a new key, valid for so long from this time on, both in
    /// seconds.
    ///
    /// # Errors
    /// It can't be the name of a site, or no key can be made.
    pub fn creds(&self, site: &str, now: u64, valid: u64) -> Result<String, CredsError> {
        let key = KeyPair::new_user();
        let token = self.token(site, &key.public_key(), now, valid)?;
        file(&token, &key).map_err(|_| CredsError::Key)
    }

    /// The claims of a site for this public key.
    ///
    /// # Errors
    /// As with [`SiteSigner::creds`].
    pub(crate) fn token(
        &self,
        site: &str,
        key: &str,
        now: u64,
        valid: u64,
    ) -> Result<String, CredsError> {
        if !is_site_name(site) {
            return Err(CredsError::Name);
        }
        let claims = Claims {
            subject: key,
            name: site,
            issued: now,
            expires: Some(now.saturating_add(valid)),
            nats: claims::site(&self.account),
        };
        claims.sign(&self.signing).map_err(|_| CredsError::Signing)
    }

    /// What claims say that this key has signed and that are valid at this time; none otherwise.
    pub(crate) fn verified(&self, token: &str, now: u64) -> Option<SiteClaims> {
        let claims = claims::verified(token, &self.signing)?;
        let claims = of_site(&claims).ok()?;
        claims.expires.is_none_or(|at| now < at).then_some(claims)
    }
}

/// What the credentials of a site say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SiteClaims {
    /// The name of the site.
    pub site: String,
    /// Its public key.
    pub key: String,
    /// Since when, in seconds since 1970.
    pub issued: u64,
    /// Until when they are valid, in seconds since 1970; for ever if none.
    pub expires: Option<u64>,
    /// Their own number.
    pub id: String,
}

/// Reads what the file with the credentials of a site says. Nothing is checked: servers do that.
///
/// # Errors
/// These are no credentials of a site.
pub fn read_site_creds(text: &str) -> Result<SiteClaims, CredsError> {
    read_token(site_token(text).ok_or(CredsError::Claims)?)
}

/// The claims in the file of a site, signed; none if there are none.
#[must_use]
pub fn site_token(text: &str) -> Option<&str> {
    text.lines().find(|line| line.starts_with("ey"))
}

/// The file of a site with these claims in place of its own.
///
/// # Errors
/// These are no credentials, or the claims are not of this site and its key.
pub fn renewed_creds(text: &str, token: &str) -> Result<String, CredsError> {
    let seed = text.lines().find(|line| line.starts_with("SU"));
    let own = read_site_creds(text)?;
    joined_creds(&own.site, seed.unwrap_or_default().trim(), token)
}

/// The file of a site with this seed of its key, and these claims.
///
/// # Errors
/// This is no seed, or the claims are not of this site and its key.
pub fn joined_creds(site: &str, seed: &str, token: &str) -> Result<String, CredsError> {
    let key = KeyPair::from_seed(seed).map_err(|_| CredsError::Key)?;
    let new = read_token(token)?;
    if new.site != site || new.key != key.public_key() {
        return Err(CredsError::Claims);
    }
    file(token, &key).map_err(|_| CredsError::Key)
}

/// A new key of a site: its seed and its public key.
///
/// # Errors
/// None can be made.
pub fn new_site_key() -> Result<(String, String), CredsError> {
    let key = KeyPair::new_user();
    let seed = key.seed().map_err(|_| CredsError::Key)?;
    Ok((seed, key.public_key()))
}

/// The public key of a seed.
///
/// # Errors
/// This is no seed of a site's key.
pub fn public_site_key(seed: &str) -> Result<String, CredsError> {
    let key = KeyPair::from_seed(seed).map_err(|_| CredsError::Key)?;
    let is_site = key.key_pair_type() == KeyPairType::User;
    is_site.then(|| key.public_key()).ok_or(CredsError::Key)
}

fn read_token(token: &str) -> Result<SiteClaims, CredsError> {
    let body = token.split('.').nth(1);
    let body = body.and_then(|body| BASE64URL_NOPAD.decode(body.as_bytes()).ok());
    let claims: Option<Value> = body.and_then(|body| serde_json::from_slice(&body).ok());
    of_site(&claims.ok_or(CredsError::Claims)?)
}

fn of_site(claims: &Value) -> Result<SiteClaims, CredsError> {
    let site = claims
        .get("name")
        .and_then(Value::as_str)
        .unwrap_or_default();
    if !is_site_name(site) {
        return Err(CredsError::Claims);
    }
    let text = |name| claims.get(name).and_then(Value::as_str).unwrap_or_default();
    Ok(SiteClaims {
        site: site.to_owned(),
        key: text("sub").to_owned(),
        issued: claims
            .get("iat")
            .and_then(Value::as_u64)
            .unwrap_or_default(),
        expires: claims.get("exp").and_then(Value::as_u64),
        id: text("jti").to_owned(),
    })
}

/// The file with claims and their key.
pub(crate) fn file(token: &str, key: &KeyPair) -> Result<String, nkeys::error::Error> {
    Ok(format!(
        "-----BEGIN NATS USER JWT-----\n{token}\n------END NATS USER JWT------\n\n\
         -----BEGIN USER NKEY SEED-----\n{}\n------END USER NKEY SEED------\n",
        key.seed()?
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SITE_VALID_S;

    #[test]
    fn a_site_gets_what_it_asks_for_only_with_the_right_keys() {
        let (account, signing) = (KeyPair::new_account(), KeyPair::new_account());
        let (public, seed) = (account.public_key(), signing.seed().unwrap());
        let made = |seed: &str, public: &str, site| {
            SiteSigner::new(seed, public)?.creds(site, 7, SITE_VALID_S)
        };
        let creds = made(&seed, &public, "plant7").unwrap();
        assert!(
            creds.starts_with("-----BEGIN NATS USER JWT-----\neyJ"),
            "{creds}"
        );
        assert!(creds.contains("\nSU"), "{creds}");
        let claims = read_site_creds(&creds).unwrap();
        assert_eq!(claims.site, "plant7");
        let seed_line = creds.lines().find(|line| line.starts_with("SU")).unwrap();
        let key = KeyPair::from_seed(seed_line).unwrap();
        assert_eq!(claims.key, key.public_key());
        assert_eq!(claims.expires, Some(7 + SITE_VALID_S));
        for wrong in [
            "",
            "ey",
            "ey.ey.ey",
            "eyJ.e30.x",
            &creds.replace("ey", "ez"),
        ] {
            assert_eq!(read_site_creds(wrong), Err(CredsError::Claims), "{wrong}");
        }
        assert_eq!(made(&seed, &public, "a.b"), Err(CredsError::Name));
        assert_eq!(made(&public, &public, "a"), Err(CredsError::Signing));
        let user = KeyPair::new_user();
        assert_eq!(
            made(&user.seed().unwrap(), &public, "a"),
            Err(CredsError::Signing)
        );
        assert_eq!(
            made(&seed, &user.public_key(), "a"),
            Err(CredsError::Account)
        );
        assert_eq!(made(&seed, "", "a"), Err(CredsError::Account));
    }

    #[test]
    fn a_file_is_renewed_with_claims_of_its_own_key_only() {
        let signing = KeyPair::new_account();
        let account = KeyPair::new_account().public_key();
        let signer = SiteSigner::new(&signing.seed().unwrap(), &account).unwrap();
        let creds = signer.creds("plant7", 7, 100).unwrap();
        let own = read_site_creds(&creds).unwrap();
        let token = |site, key: &str| signer.token(site, key, 50, 100).unwrap();
        let renewed = renewed_creds(&creds, &token("plant7", &own.key)).unwrap();
        let now = read_site_creds(&renewed).unwrap();
        assert_eq!((now.issued, now.expires), (50, Some(150)));
        assert_eq!((&now.site, &now.key), (&own.site, &own.key));
        assert_ne!(now.id, own.id);
        let seed = |text: &str| {
            text.lines()
                .rfind(|l| l.starts_with("SU"))
                .map(str::to_owned)
        };
        assert_eq!(seed(&renewed), seed(&creds));
        let other = KeyPair::new_user().public_key();
        for wrong in [token("plant8", &own.key), token("plant7", &other)] {
            assert_eq!(renewed_creds(&creds, &wrong), Err(CredsError::Claims));
        }
        assert_eq!(renewed_creds(&creds, "ey"), Err(CredsError::Claims));
        let none = renewed_creds("", &token("plant7", &own.key));
        assert_eq!(none, Err(CredsError::Claims));
        let (seed, key) = new_site_key().unwrap();
        assert_eq!(public_site_key(&seed).as_ref(), Ok(&key));
        let joined = joined_creds("plant7", &seed, &token("plant7", &key)).unwrap();
        assert_eq!(read_site_creds(&joined).unwrap().key, key);
    }

    #[test]
    fn claims_count_from_the_right_key_and_in_time() {
        let signer = || {
            let signing = KeyPair::new_account().seed().unwrap();
            SiteSigner::new(&signing, &KeyPair::new_account().public_key()).unwrap()
        };
        let (own, other) = (signer(), signer());
        let token = own.token("plant7", &KeyPair::new_user().public_key(), 7, 10);
        let token = token.unwrap();
        assert_eq!(own.verified(&token, 16).unwrap().site, "plant7");
        assert_eq!(own.verified(&token, 17), None);
        assert_eq!(other.verified(&token, 16), None);
        assert_eq!(own.verified("", 16), None);
    }
}
