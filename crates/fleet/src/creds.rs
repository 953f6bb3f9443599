//! A user's claims and his key as one file, in the form that every NATS client reads.

use crate::claims::{self, Claims, SITE_DAYS};
use crate::{DAY_S, is_site_name};
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

/// The credentials of a site, with a new key, valid for [`SITE_DAYS`] from this time on, in seconds
/// since 1970. `signing` is the seed of the key that makes sites, `account` their account.
///
/// # Errors
/// [`CredsError`].
pub fn site_creds(
    (signing, account): (&str, &str),
    site: &str,
    now: u64,
) -> Result<String, CredsError> {
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
    if !is_site_name(site) {
        return Err(CredsError::Name);
    }
    let key = KeyPair::new_user();
    let claims = Claims {
        subject: &key.public_key(),
        name: site,
        issued: now,
        expires: Some(now.saturating_add(SITE_DAYS * DAY_S)),
        nats: claims::site(&account.public_key()),
    };
    let token = claims.sign(&signing).map_err(|_| CredsError::Signing)?;
    file(&token, &key).map_err(|_| CredsError::Key)
}

/// What the credentials of a site say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SiteClaims {
    /// The name of the site.
    pub site: String,
    /// Its public key.
    pub key: String,
    /// Until when they are valid, in seconds since 1970; for ever if none.
    pub expires: Option<u64>,
}

/// Reads what the file with the credentials of a site says. Nothing is checked: servers do that.
///
/// # Errors
/// These are no credentials of a site.
pub fn read_site_creds(text: &str) -> Result<SiteClaims, CredsError> {
    let token = text.lines().find(|line| line.starts_with("ey"));
    let body = token.and_then(|token| token.split('.').nth(1));
    let body = body.and_then(|body| BASE64URL_NOPAD.decode(body.as_bytes()).ok());
    let claims: Option<Value> = body.and_then(|body| serde_json::from_slice(&body).ok());
    let claims = claims.ok_or(CredsError::Claims)?;
    let site = claims
        .get("name")
        .and_then(Value::as_str)
        .unwrap_or_default();
    if !is_site_name(site) {
        return Err(CredsError::Claims);
    }
    let key = claims.get("sub").and_then(Value::as_str);
    Ok(SiteClaims {
        site: site.to_owned(),
        key: key.unwrap_or_default().to_owned(),
        expires: claims.get("exp").and_then(Value::as_u64),
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

    #[test]
    fn a_site_gets_what_it_asks_for_only_with_the_right_keys() {
        let (account, signing) = (KeyPair::new_account(), KeyPair::new_account());
        let (public, seed) = (account.public_key(), signing.seed().unwrap());
        let made = |seed: &str, public: &str, site| site_creds((seed, public), site, 7);
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
        assert_eq!(claims.expires, Some(7 + SITE_DAYS * DAY_S));
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
}
