//! IDs that sort by time: ULIDs.

use std::hash::{BuildHasher, RandomState};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// Crockford's digits, which leave out easily confused ones.
const DIGITS: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";

/// Generates unique IDs.
#[derive(Debug, Default)]
pub struct Ulids {
    random: RandomState,
    count: Mutex<u16>,
}

impl Ulids {
    /// 48 bits of milliseconds, a 16-bit counter, 64 random bits, in 26 digits.
    pub fn next(&self, at: SystemTime) -> String {
        let since = at.duration_since(SystemTime::UNIX_EPOCH);
        let since = since.unwrap_or(Duration::ZERO);
        let count = {
            let mut count = self.count.lock().unwrap_or_else(PoisonError::into_inner);
            *count = count.wrapping_add(1);
            *count
        };
        let chance = self.random.hash_one((since, count));
        let number = (since.as_millis() & 0xFFFF_FFFF_FFFF) << 80
            | u128::from(count) << 64
            | u128::from(chance);
        let digit = |place: u32| DIGITS[(number >> (place * 5) & 31) as usize] as char;
        (0..26).rev().map(digit).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_differ_and_sort() {
        let ulids = Ulids::default();
        let ids: Vec<String> = (0..2_000).map(|_| ulids.next(SystemTime::now())).collect();
        assert!(ids.iter().all(|id| id.len() == 26));
        assert!(ids.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
