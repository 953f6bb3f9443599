//! A configuration for a site as a signed document: what is signed says for which site it is and
//! which version, so that neither another site's nor an old one passes for it.

use crate::message::{ConfigDocument, SignedConfig};
use crate::names::is_site_name;
use crate::trial::WantedConfig;
use nkeys::{KeyPair, KeyPairType};
use prost::Message as _;

/// The longest text, in bytes: servers take no message over 1 MiB, and each site has 20 of them.
pub const CONFIG_TEXT_MAX: usize = 512 << 10;
/// The longest name of who wanted it, in bytes.
const USER_MAX: usize = 256;
/// The highest version: programs in other languages read it exactly.
const VERSION_MAX: u64 = 1 << 53;
/// The longest hash, in bytes.
const HASH_LEN: usize = 32;
/// What comes before what is signed: no other signature of this key is one of a configuration.
const SIGNED_AS: &[u8] = b"railbus configuration 1\0";

/// Why there is no configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DesiredError {
    /// This is no seed of a key that signs configurations.
    Seed,
    /// This is no public key of one.
    PublicKey,
    /// It can't be decoded, or something in it can't be so.
    Malformed,
    /// The text has more than [`CONFIG_TEXT_MAX`] bytes.
    TooLong,
    /// The key did not sign it.
    Signature,
    /// It is of another site.
    OtherSite,
}

impl std::fmt::Display for DesiredError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            DesiredError::Seed => "this is no seed of a key that signs configurations",
            DesiredError::PublicKey => "this is no public key that signs configurations",
            DesiredError::Malformed => "it can't be read",
            DesiredError::TooLong => "it has more than 512 KiB",
            DesiredError::Signature => "its signature is wrong",
            DesiredError::OtherSite => "it is of another site",
        })
    }
}

impl std::error::Error for DesiredError {}

/// Signs configurations.
pub struct ConfigSigner(KeyPair);

/// Without its seed.
impl std::fmt::Debug for ConfigSigner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.public_key())
    }
}

impl ConfigSigner {
    /// A new key.
    #[must_use]
    pub fn generate() -> ConfigSigner {
        ConfigSigner(KeyPair::new_service())
    }

    /// With this seed, `SV…`.
    ///
    /// # Errors
    /// [`DesiredError::Seed`].
    pub fn from_seed(seed: &str) -> Result<ConfigSigner, DesiredError> {
        let key = KeyPair::from_seed(seed.trim()).map_err(|_| DesiredError::Seed)?;
        match key.key_pair_type() {
            KeyPairType::Service => Ok(ConfigSigner(key)),
            _ => Err(DesiredError::Seed),
        }
    }

    /// Its seed: whoever has it can configure every site that trusts the key.
    ///
    /// # Errors
    /// [`DesiredError::Seed`] if there is none.
    pub fn seed(&self) -> Result<String, DesiredError> {
        self.0.seed().map_err(|_| DesiredError::Seed)
    }

    /// Its public key, `V…`: what a site trusts.
    #[must_use]
    pub fn public_key(&self) -> String {
        self.0.public_key()
    }

    /// The signed document.
    ///
    /// # Errors
    /// [`DesiredError::TooLong`], or [`DesiredError::Malformed`] if it can't be a document.
    pub fn sign(&self, document: &ConfigDocument) -> Result<Vec<u8>, DesiredError> {
        check(document)?;
        let document = document.encode_to_vec();
        let signature = self.0.sign(&signed_part(&document));
        let signature = signature.map_err(|_| DesiredError::Seed)?;
        Ok(SignedConfig {
            document,
            signature,
        }
        .encode_to_vec())
    }
}

/// A key that a site trusts with its configuration.
pub struct ConfigVerifier(KeyPair);

impl std::fmt::Debug for ConfigVerifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.public_key())
    }
}

impl ConfigVerifier {
    /// With this public key.
    ///
    /// # Errors
    /// [`DesiredError::PublicKey`].
    pub fn new(key: &str) -> Result<ConfigVerifier, DesiredError> {
        let key = KeyPair::from_public_key(key.trim()).map_err(|_| DesiredError::PublicKey)?;
        match key.key_pair_type() {
            KeyPairType::Service => Ok(ConfigVerifier(key)),
            _ => Err(DesiredError::PublicKey),
        }
    }

    /// A document for this site, if it is signed.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn open(&self, site: &str, payload: &[u8]) -> Result<ConfigDocument, DesiredError> {
        let signed = SignedConfig::decode(payload).map_err(|_| DesiredError::Malformed)?;
        // Nothing of it is looked at before.
        self.0
            .verify(&signed_part(&signed.document), &signed.signature)
            .map_err(|_| DesiredError::Signature)?;
        let document = ConfigDocument::decode(&*signed.document);
        let document = document.map_err(|_| DesiredError::Malformed)?;
        check(&document)?;
        match document.site == site {
            true => Ok(document),
            false => Err(DesiredError::OtherSite),
        }
    }
}

impl From<ConfigDocument> for WantedConfig {
    fn from(document: ConfigDocument) -> WantedConfig {
        WantedConfig {
            version: document.version,
            text: document.text,
            replaces: document.replaces,
            user: document.user,
        }
    }
}

fn signed_part(document: &[u8]) -> Vec<u8> {
    [SIGNED_AS, document].concat()
}

/// Whether it can be a document.
fn check(document: &ConfigDocument) -> Result<(), DesiredError> {
    if document.text.len() > CONFIG_TEXT_MAX {
        return Err(DesiredError::TooLong);
    }
    // The first version is 1: 0 is none.
    let can_be = (1..=VERSION_MAX).contains(&document.version)
        && is_site_name(&document.site)
        && document.user.len() <= USER_MAX
        && document.replaces.len() <= HASH_LEN;
    match can_be {
        true => Ok(()),
        false => Err(DesiredError::Malformed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document() -> ConfigDocument {
        ConfigDocument {
            site: "plant7".to_owned(),
            version: 3,
            text: "[line.hall]\nport = \"/dev/ttyS1\"\n".to_owned(),
            user: "li".to_owned(),
            at_ms: 1_795_910_400_000,
            replaces: vec![7; 32],
        }
    }

    #[test]
    fn a_site_reads_what_its_centre_signed() {
        let signer = ConfigSigner::generate();
        let payload = signer.sign(&document()).unwrap();
        let trusted = ConfigVerifier::new(&signer.public_key()).unwrap();
        assert_eq!(trusted.open("plant7", &payload), Ok(document()));
        let wanted: WantedConfig = document().into();
        assert_eq!((wanted.version, wanted.text), (3, document().text));
        // The same key, from its seed.
        let again = ConfigSigner::from_seed(&format!("{}\n", signer.seed().unwrap())).unwrap();
        assert_eq!(again.sign(&document()).unwrap(), payload);
    }

    #[test]
    fn nothing_else_passes_for_it() {
        let (signer, other) = (ConfigSigner::generate(), ConfigSigner::generate());
        let payload = signer.sign(&document()).unwrap();
        let trusted = ConfigVerifier::new(&signer.public_key()).unwrap();
        assert_eq!(
            trusted.open("plant8", &payload),
            Err(DesiredError::OtherSite)
        );
        let by_other = other.sign(&document()).unwrap();
        assert_eq!(
            trusted.open("plant7", &by_other),
            Err(DesiredError::Signature)
        );
        // A signature of the same key for something else.
        let body = document().encode_to_vec();
        let plain = SignedConfig {
            signature: signer.0.sign(&body).unwrap(),
            document: body,
        };
        assert_eq!(
            trusted.open("plant7", &plain.encode_to_vec()),
            Err(DesiredError::Signature)
        );
        // Not one bit of it may differ.
        for at in 0..payload.len() * 8 {
            let mut broken = payload.clone();
            broken[at / 8] ^= 1 << (at % 8);
            assert!(trusted.open("plant7", &broken).is_err(), "bit {at}");
        }
        for cut in 0..payload.len() {
            assert!(trusted.open("plant7", &payload[..cut]).is_err(), "{cut}");
        }
    }

    #[test]
    fn what_can_be_no_document_is_not_signed() {
        let signer = ConfigSigner::generate();
        let wrong = |change: fn(&mut ConfigDocument)| {
            let mut document = document();
            change(&mut document);
            signer.sign(&document).err()
        };
        assert_eq!(wrong(|_| {}), None);
        let malformed = Some(DesiredError::Malformed);
        assert_eq!(wrong(|one| one.version = 0), malformed);
        assert_eq!(wrong(|one| one.version = u64::MAX), malformed);
        assert_eq!(wrong(|one| one.site = "a.b".to_owned()), malformed);
        assert_eq!(wrong(|one| one.user = "x".repeat(257)), malformed);
        assert_eq!(wrong(|one| one.replaces = vec![0; 33]), malformed);
        let long = |one: &mut ConfigDocument| one.text = "x".repeat(CONFIG_TEXT_MAX + 1);
        assert_eq!(wrong(long), Some(DesiredError::TooLong));
        let fits = |one: &mut ConfigDocument| one.text = "x".repeat(CONFIG_TEXT_MAX);
        assert_eq!(wrong(fits), None);
    }

    #[test]
    fn only_a_key_for_configurations_is_one() {
        for key in [KeyPair::new_user(), KeyPair::new_account()] {
            let seed = key.seed().unwrap();
            assert!(matches!(
                ConfigSigner::from_seed(&seed),
                Err(DesiredError::Seed)
            ));
            assert!(matches!(
                ConfigVerifier::new(&key.public_key()),
                Err(DesiredError::PublicKey)
            ));
        }
        assert!(ConfigVerifier::new("").is_err());
        let signer = ConfigSigner::generate();
        assert!(!format!("{signer:?}").contains(&signer.seed().unwrap()));
        assert!(ConfigSigner::from_seed(&signer.public_key()).is_err());
    }
}
