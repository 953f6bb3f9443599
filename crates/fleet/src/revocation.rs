//! Keys of sites that servers let in no longer.

use crate::claims::{self, Claims};
use nkeys::{KeyPair, KeyPairType};
use serde_json::{Value, json};

/// A key that is let in no longer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RevokedKey {
    /// The public key of a site.
    pub key: String,
    /// Since when, in seconds since 1970: what was signed for it until then counts no more.
    pub at: u64,
}

/// Why nothing is revoked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RevocationError {
    /// This is no seed of an operator's key.
    Signing,
    /// These are not the claims of this account, signed by this operator.
    Claims,
    /// This is no public key of a site.
    Key(String),
}

impl std::fmt::Display for RevocationError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RevocationError::Signing => f.write_str("this is no seed of an operator's key"),
            RevocationError::Claims => f.write_str(
                "the servers have other claims of the account of sites than this operator signed",
            ),
            RevocationError::Key(key) => write!(f, "{key} is no public key of a site"),
        }
    }
}

impl std::error::Error for RevocationError {}

/// The claims of the account of sites with these keys revoked besides those that are: `tokens` as
/// servers have them, of which the latest is taken, `account` its public key, `signing` the seed of
/// the operator that signs them, at this time in seconds since 1970 or a little later. Everything
/// else stays as it is.
///
/// # Errors
/// [`RevocationError`]. Claims that the operator did not sign are none: servers could have them
/// changed.
pub fn revoke(
    (tokens, account): (&[String], &str),
    signing: &str,
    keys: &[RevokedKey],
    now: u64,
) -> Result<String, RevocationError> {
    let signing = KeyPair::from_seed(signing).map_err(|_| RevocationError::Signing)?;
    if signing.key_pair_type() != KeyPairType::Operator {
        return Err(RevocationError::Signing);
    }
    let verified = tokens.iter().filter_map(|token| {
        let body = claims::verified(token, &signing)?;
        let is_account = body.pointer("/nats/type") == Some(&json!("account"));
        let is_it = is_account && body.get("sub") == Some(&json!(account));
        is_it.then_some(body)
    });
    let issued = |body: &Value| body.get("iat").and_then(Value::as_u64).unwrap_or_default();
    let body = verified.max_by_key(issued).ok_or(RevocationError::Claims)?;
    let mut nats = body.get("nats").cloned().unwrap_or_default();
    let revoked = nats
        .as_object_mut()
        .map(|nats| nats.entry("revocations").or_insert_with(|| json!({})));
    let Some(Value::Object(revoked)) = revoked else {
        return Err(RevocationError::Claims);
    };
    for RevokedKey { key, at } in keys {
        if !is_site_key(key) {
            return Err(RevocationError::Key(key.clone()));
        }
        let before = revoked.get(key).and_then(Value::as_u64);
        revoked.insert(key.clone(), json!(before.unwrap_or_default().max(*at)));
    }
    let claims = Claims {
        subject: account,
        name: body.get("name").and_then(Value::as_str).unwrap_or_default(),
        // Of claims of the same second servers take those that they hear of last, which may be the
        // old ones of a server that was away.
        issued: now.max(issued(&body).saturating_add(1)),
        expires: body.get("exp").and_then(Value::as_u64),
        nats,
    };
    claims.sign(&signing).map_err(|_| RevocationError::Signing)
}

/// Whether this is the public key of a site.
#[must_use]
pub fn is_site_key(key: &str) -> bool {
    let key = KeyPair::from_public_key(key);
    key.is_ok_and(|key| key.key_pair_type() == KeyPairType::User)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Keys {
        operator: KeyPair,
        account: KeyPair,
    }

    impl Keys {
        fn new() -> Keys {
            Keys {
                operator: KeyPair::new_operator(),
                account: KeyPair::new_account(),
            }
        }

        fn token(&self, nats: Value) -> String {
            let claims = Claims {
                subject: &self.account.public_key(),
                name: "SITES",
                issued: 5,
                expires: None,
                nats,
            };
            claims.sign(&self.operator).unwrap()
        }

        fn revoke(&self, token: &str, keys: &[(&str, u64)]) -> Result<Value, RevocationError> {
            let keys: Vec<_> = keys
                .iter()
                .map(|(key, at)| RevokedKey {
                    key: (*key).to_owned(),
                    at: *at,
                })
                .collect();
            let seed = self.operator.seed().unwrap();
            let account = self.account.public_key();
            let tokens = [String::new(), token.to_owned()];
            let signed = revoke((&tokens, &account), &seed, &keys, 9)?;
            Ok(claims::verified(&signed, &self.operator).unwrap())
        }
    }

    fn key() -> String {
        KeyPair::new_user().public_key()
    }

    #[test]
    fn what_was_revoked_stays_so_and_all_else_is_as_it_was() {
        let keys = Keys::new();
        let (a, b) = (key(), key());
        let nats = json!({ "type": "account", "limits": { "conn": -1 }, "imports": [1, 2] });
        let once = keys.revoke(&keys.token(nats.clone()), &[(&a, 7)]).unwrap();
        let mut wanted = nats;
        wanted["revocations"] = json!({ &a: 7 });
        assert_eq!(once["nats"], wanted);
        assert_eq!((&once["name"], &once["iat"]), (&json!("SITES"), &json!(9)));
        assert!(once.get("exp").is_none());
        // Neither is the earlier one forgotten nor a later one put back.
        let again = keys.revoke(&keys.token(once["nats"].clone()), &[(&b, 8), (&a, 3)]);
        wanted["revocations"] = json!({ &a: 7, &b: 8 });
        assert_eq!(again.unwrap()["nats"], wanted);
    }

    /// Servers keep the later ones.
    #[test]
    fn claims_are_later_than_those_that_they_replace() {
        let keys = Keys::new();
        let signed_at = |issued: u64| {
            let claims = Claims {
                subject: &keys.account.public_key(),
                name: "SITES",
                issued,
                expires: None,
                nats: json!({ "type": "account" }),
            };
            let token = claims.sign(&keys.operator).unwrap();
            keys.revoke(&token, &[]).unwrap()["iat"].as_u64().unwrap()
        };
        assert_eq!([7, 8, 9, 20].map(signed_at), [9, 9, 10, 21]);
    }

    /// A server that was away, or a hostile one, has older ones that this operator signed, too.
    #[test]
    fn the_latest_claims_count() {
        let keys = Keys::new();
        let signed = |issued: u64, conn: u64| {
            let claims = Claims {
                subject: &keys.account.public_key(),
                name: "SITES",
                issued,
                expires: None,
                nats: json!({ "type": "account", "limits": { "conn": conn } }),
            };
            claims.sign(&keys.operator).unwrap()
        };
        let tokens = [signed(3, 1), signed(6, 2), signed(5, 3), "x".to_owned()];
        let account = keys.account.public_key();
        let seed = keys.operator.seed().unwrap();
        let signed = revoke((&tokens, &account), &seed, &[], 4).unwrap();
        let body = claims::verified(&signed, &keys.operator).unwrap();
        assert_eq!(body["nats"]["limits"]["conn"], 2);
        assert_eq!(body["iat"], 7);
    }

    #[test]
    fn nothing_is_signed_that_the_operator_has_not_signed_before() {
        let (keys, other) = (Keys::new(), Keys::new());
        let nats = json!({ "type": "account" });
        let good = keys.token(nats.clone());
        let of_other = other.token(nats);
        let (head, rest) = good.split_once('.').unwrap();
        let (body, signature) = rest.split_once('.').unwrap();
        let (_, other_body) = of_other.split_once('.').unwrap();
        let other_body = other_body.split('.').next().unwrap();
        for wrong in [
            String::new(),
            "a.b.c".to_owned(),
            of_other.clone(),
            format!("{head}.{other_body}.{signature}"),
            format!("{head}.{body}."),
            format!("{good}.x"),
            keys.token(json!({ "type": "user" })),
            keys.token(json!([])),
            keys.token(json!({ "type": "account", "revocations": [] })),
        ] {
            assert_eq!(
                keys.revoke(&wrong, &[]),
                Err(RevocationError::Claims),
                "{wrong}"
            );
        }
        let seed = keys.operator.seed().unwrap();
        let account = other.account.public_key();
        let good = [good];
        let end = revoke((&good, &account), &seed, &[], 9);
        assert_eq!(end, Err(RevocationError::Claims));
        for seed in ["", &keys.account.seed().unwrap()] {
            let end = revoke((&good, &keys.account.public_key()), seed, &[], 9);
            assert_eq!(end, Err(RevocationError::Signing));
        }
        for no_key in ["", "*", &keys.account.public_key()] {
            let end = keys.revoke(&good[0], &[(no_key, 1)]);
            assert_eq!(end, Err(RevocationError::Key(no_key.to_owned())));
        }
    }
}
