//! Claims of NATS: the name and the rights of a key, signed by the key that grants them. JSON Web
//! Tokens of version 2, as `github.com/nats-io/jwt` has them; the judge is the server.

use crate::grants::Shared;
use data_encoding::{BASE32_NOPAD, BASE64URL_NOPAD};
use nkeys::KeyPair;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha512_256};

/// Claims without a signature.
pub(crate) struct Claims<'c> {
    /// Whose they are: a public key.
    pub(crate) subject: &'c str,
    /// What the subject is called.
    pub(crate) name: &'c str,
    /// From when, in seconds since 1970.
    pub(crate) issued: u64,
    /// Until when; for ever if none.
    pub(crate) expires: Option<u64>,
    /// What is claimed.
    pub(crate) nats: Value,
}

impl Claims<'_> {
    /// Signs them.
    ///
    /// # Errors
    /// The key has no seed.
    pub(crate) fn sign(&self, by: &KeyPair) -> Result<String, nkeys::error::Error> {
        let mut body = Map::new();
        body.insert("iat".to_owned(), json!(self.issued));
        body.insert("iss".to_owned(), json!(by.public_key()));
        body.insert("name".to_owned(), json!(self.name));
        body.insert("sub".to_owned(), json!(self.subject));
        if let Some(expires) = self.expires {
            body.insert("exp".to_owned(), json!(expires));
        }
        body.insert("nats".to_owned(), self.nats.clone());
        let id = Sha512_256::digest(Value::Object(body.clone()).to_string());
        body.insert("jti".to_owned(), json!(BASE32_NOPAD.encode(&id)));
        let head = json!({ "typ": "JWT", "alg": "ed25519-nkey" });
        let part = |value: &Value| BASE64URL_NOPAD.encode(value.to_string().as_bytes());
        let signed = format!("{}.{}", part(&head), part(&Value::Object(body)));
        let signature = by.sign(signed.as_bytes())?;
        Ok(format!("{signed}.{}", BASE64URL_NOPAD.encode(&signature)))
    }
}

/// What claims say, if this key has signed them; none otherwise.
pub(crate) fn verified(token: &str, by: &KeyPair) -> Option<Value> {
    let (signed, signature) = token.rsplit_once('.')?;
    let (_, body) = signed.split_once('.')?;
    let decoded = |part: &str| BASE64URL_NOPAD.decode(part.as_bytes()).ok();
    by.verify(signed.as_bytes(), &decoded(signature)?).ok()?;
    serde_json::from_slice(&decoded(body)?).ok()
}

/// The operator: who signs accounts. `signing` does, so that the operator's own key can be away.
pub(crate) fn operator(system: &str, signing: &str) -> Value {
    json!({
        "type": "operator",
        "version": 2,
        "system_account": system,
        "signing_keys": [signing],
    })
}

/// An account, and how much it may store.
pub(crate) fn account(has_streams: bool) -> Map<String, Value> {
    let mut limits = json!({
        "subs": -1, "data": -1, "payload": -1, "imports": -1, "exports": -1, "wildcards": true,
        "conn": -1, "leaf": 0,
    });
    if has_streams && let Value::Object(limits) = &mut limits {
        for limit in ["disk_storage", "streams", "consumer"] {
            limits.insert(limit.to_owned(), json!(-1));
        }
    }
    let mut account = Map::new();
    account.insert("type".to_owned(), json!("account"));
    account.insert("version".to_owned(), json!(2));
    account.insert("limits".to_owned(), limits);
    account
}

/// What an account shares.
pub(crate) fn exports(shared: &[Shared]) -> Value {
    let one = |shared: &Shared| {
        json!({
            "name": shared.name,
            "subject": shared.subject,
            "type": shared.way.word(),
        })
    };
    shared.iter().map(one).collect()
}

/// What an account has of what this one shares.
pub(crate) fn imports(from: &str, shared: &[Shared]) -> Value {
    let one = |shared: &Shared| {
        json!({
            "name": shared.name,
            "subject": shared.subject,
            "account": from,
            "local_subject": shared.subject,
            "type": shared.way.word(),
        })
    };
    shared.iter().map(one).collect()
}

/// A key of an account that can only sign users with these rights.
pub(crate) fn scoped_key(public: &str, role: &str, rights: Value) -> Value {
    json!({
        "kind": "user_scope",
        "key": public,
        "role": role,
        "template": rights,
    })
}

/// A user of an account, with these rights.
pub(crate) fn user(account: &str, rights: Value) -> Value {
    let mut user = rights;
    if let Value::Object(user) = &mut user {
        user.insert("type".to_owned(), json!("user"));
        user.insert("version".to_owned(), json!(2));
        user.insert("issuer_account".to_owned(), json!(account));
    }
    user
}

/// A site: its rights are those of the key that signs.
pub(crate) fn site(account: &str) -> Value {
    user(account, json!({}))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The parts of claims, their signature checked.
    fn read(token: &str, by: &KeyPair) -> (Value, Value) {
        let parts: Vec<&str> = token.split('.').collect();
        let signed = format!("{}.{}", parts[0], parts[1]);
        let signature = BASE64URL_NOPAD.decode(parts[2].as_bytes()).unwrap();
        by.verify(signed.as_bytes(), &signature).unwrap();
        let part = |at: usize| {
            let bytes = BASE64URL_NOPAD.decode(parts[at].as_bytes()).unwrap();
            serde_json::from_slice(&bytes).unwrap()
        };
        (part(0), part(1))
    }

    #[test]
    fn claims_are_signed_and_say_whose_they_are() {
        let (by, whose) = (KeyPair::new_account(), KeyPair::new_user());
        let subject = whose.public_key();
        let claims = Claims {
            subject: &subject,
            name: "plant7",
            issued: 1_700_000_000,
            expires: Some(1_700_000_060),
            nats: site("ACCOUNT"),
        };
        let (head, body) = read(&claims.sign(&by).unwrap(), &by);
        assert_eq!(head, json!({ "typ": "JWT", "alg": "ed25519-nkey" }));
        assert_eq!(
            (&body["sub"], &body["iss"]),
            (&json!(subject), &json!(by.public_key()))
        );
        assert_eq!(
            (&body["iat"], &body["exp"]),
            (&json!(1_700_000_000_u64), &json!(1_700_000_060_u64))
        );
        // With rights of its own the server would refuse it: the key has a template.
        let nats = json!({ "type": "user", "version": 2, "issuer_account": "ACCOUNT" });
        assert_eq!(body["nats"], nats);
        assert_eq!(body["jti"].as_str().map(str::len), Some(52));
    }

    #[test]
    fn only_who_has_a_seed_can_sign() {
        let public = KeyPair::from_public_key(&KeyPair::new_account().public_key()).unwrap();
        let claims = Claims {
            subject: "U",
            name: "plant7",
            issued: 0,
            expires: None,
            nats: site("A"),
        };
        assert!(claims.sign(&public).is_err());
    }
}
