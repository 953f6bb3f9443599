//! The one-time link for creating the first user. It is valid for a while, only while there is no
//! user, and only the newest one.

use super::secret::{Fingerprint, Secret, fingerprint, random};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long a link is valid.
pub(crate) const LIFE: Duration = Duration::from_secs(15 * 60);
/// The alphabet of keys: digits and letters that are not easily confused.
const LETTERS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";
/// The length of a key in characters, of five random bits each.
const LEN: usize = 28;
const GROUP: usize = 4;

/// The key of the newest link.
#[derive(Debug, Default)]
pub(crate) struct Setup(Mutex<Option<(Fingerprint, Instant)>>);

impl Setup {
    /// A new key; the previous one becomes invalid.
    pub(crate) fn key(&self, now: Instant) -> Result<Secret, getrandom::Error> {
        let bytes = random::<LEN>()?;
        let letter = |byte: &u8| LETTERS.get(usize::from(byte % 32)).copied();
        let letters: Vec<u8> = bytes.iter().filter_map(letter).collect();
        let groups = letters.chunks(GROUP).map(String::from_utf8_lossy);
        let key = Secret::new(groups.collect::<Vec<_>>().join("-"));
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *newest = Some((key.fingerprint(), now + LIFE));
        Ok(key)
    }

    /// Whether this is the key, and still valid.
    pub(crate) fn fits(&self, key: &Secret, now: Instant) -> bool {
        let newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let given = fingerprint(key.expose().trim());
        newest.is_some_and(|(known, end)| known == given && now < end)
    }

    /// The key was used.
    pub(crate) fn close(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_newest_key_fits_and_not_for_long() {
        let (setup, now) = (Setup::default(), Instant::now());
        let old = setup.key(now).unwrap();
        assert_eq!(old.expose().len(), 28 + 6);
        assert!(setup.fits(&old, now));
        let new = setup.key(now).unwrap();
        assert!(!setup.fits(&old, now));
        assert!(setup.fits(&new, now + LIFE - Duration::from_secs(1)));
        assert!(!setup.fits(&new, now + LIFE));
        assert!(!setup.fits(&Secret::new(String::new()), now));
        setup.close();
        assert!(!setup.fits(&new, now));
    }
}
