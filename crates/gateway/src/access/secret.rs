//! Secrets: passwords, tokens, keys. They can't be shown, logged or sent by mistake, since they
//! have no such methods.

use serde::{Deserialize, Deserializer};
use sha2::{Digest, Sha256};

/// The length in bytes of a generated secret.
const LEN: usize = 32;

/// A hash of a secret, from which it can't be derived.
pub type Fingerprint = [u8; LEN];

/// A secret in memory. It has no `Debug`, `Display`, `Serialize` or `Clone` on purpose.
#[expect(missing_debug_implementations, reason = "a secret is not shown")]
pub struct Secret(String);

impl Secret {
    /// Makes a text a secret.
    pub const fn new(text: String) -> Secret {
        Secret(text)
    }

    /// 256 random bits in hexadecimal, after a prefix that says what it is for.
    pub(crate) fn random(prefix: &str) -> Result<Secret, getrandom::Error> {
        let bytes = random::<LEN>()?;
        Ok(Secret(format!("{prefix}{}", hex(&bytes))))
    }

    /// The text itself, for the one place that needs it.
    pub fn expose(&self) -> &str {
        &self.0
    }

    /// Its fingerprint.
    pub fn fingerprint(&self) -> Fingerprint {
        fingerprint(&self.0)
    }
}

impl<'de> Deserialize<'de> for Secret {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Secret, D::Error> {
        String::deserialize(from).map(Secret)
    }
}

/// The fingerprint of a secret with this text. Fingerprints are compared, never secrets, so the
/// time of the comparison reveals nothing.
pub(crate) fn fingerprint(text: &str) -> Fingerprint {
    Sha256::digest(text.as_bytes()).into()
}

/// Cryptographically random bytes.
pub(crate) fn random<const N: usize>() -> Result<[u8; N], getrandom::Error> {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes)?;
    Ok(bytes)
}

/// Bytes in hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_long_and_never_the_same() {
        let [one, other] = [(); 2].map(|()| Secret::random("rb_").unwrap());
        assert_eq!(one.expose().len(), 3 + 64);
        assert!(one.expose().starts_with("rb_"));
        assert_ne!(one.expose(), other.expose());
        assert_ne!(one.fingerprint(), other.fingerprint());
        assert_eq!(one.fingerprint(), fingerprint(one.expose()));
    }
}
