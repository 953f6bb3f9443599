//! Limits login attempts, per account and per address.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How many attempts may be made at once; then one more each [`PAUSE`], which is as many per
/// minute.
const TRIES_MAX: u32 = 5;
/// The time after which one more attempt is allowed.
const PAUSE: Duration = Duration::from_secs(12);
/// How many accounts and addresses are remembered; the one not seen for longest is dropped.
const REMEMBERED_MAX: usize = 1_024;

/// Whose attempts are counted.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Who {
    Account(String),
    Address(IpAddr),
}

impl Who {
    /// A host with IPv6 has a whole network of addresses, which counts as one.
    pub(crate) fn address(address: IpAddr) -> Who {
        Who::Address(match address.to_canonical() {
            IpAddr::V6(address) => IpAddr::V6((address.to_bits() >> 64 << 64).into()),
            address => address,
        })
    }
}

/// The attempts made, as the time when the last of them is forgotten.
#[derive(Debug, Default)]
pub(crate) struct Tries(Mutex<HashMap<Who, Instant>>);

impl Tries {
    /// Counts one attempt for each; the error is how long to wait if one of them has none left.
    pub(crate) fn take(&self, all: &[Who], now: Instant) -> Result<(), Duration> {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let free = |who: &Who| known.get(who).map_or(now, |free| (*free).max(now));
        let latest = all.iter().map(free).max().unwrap_or(now);
        let full = now + PAUSE * (TRIES_MAX - 1);
        if latest > full {
            return Err(latest - full);
        }
        for who in all {
            let next = known.get(who).map_or(now, |free| (*free).max(now)) + PAUSE;
            if known.len() >= REMEMBERED_MAX && !known.contains_key(who) {
                forget_one(&mut known, now);
            }
            known.insert(who.clone(), next);
        }
        Ok(())
    }

    /// The password was right: resets the attempts of the account, and returns the one used to
    /// the address, so that logging in to an own account yields no attempts at others.
    pub(crate) fn give_back(&self, all: &[Who]) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for who in all {
            match (who, known.get_mut(who)) {
                (Who::Address(_), Some(free)) => *free = free.checked_sub(PAUSE).unwrap_or(*free),
                _ => drop(known.remove(who)),
            }
        }
    }
}

/// Drops an entry: those without any attempts to remember, or else the one nearest to that.
fn forget_one(known: &mut HashMap<Who, Instant>, now: Instant) {
    known.retain(|_, free| *free > now);
    if known.len() >= REMEMBERED_MAX {
        let nearest = known.iter().min_by_key(|(_, free)| **free);
        if let Some(who) = nearest.map(|(who, _)| who.clone()) {
            known.remove(&who);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn account(name: &str) -> Who {
        Who::Account(name.to_owned())
    }

    #[test]
    fn five_in_a_minute_and_no_more() {
        let (tries, now) = (Tries::default(), Instant::now());
        let of = |name: &str, at| tries.take(&[account(name)], at);
        for _ in 0..TRIES_MAX {
            assert_eq!(of("li", now), Ok(()));
        }
        assert_eq!(of("li", now), Err(PAUSE));
        assert_eq!(of("wang", now), Ok(()));
        assert_eq!(of("li", now + PAUSE), Ok(()));
        assert!(of("li", now + PAUSE).is_err());
        let later = now + Duration::from_secs(600);
        let many = (0..20).filter(|_| of("li", later).is_ok()).count();
        assert_eq!(many, 5, "no try is saved up beyond that");
        tries.give_back(&[account("li")]);
        assert_eq!((0..20).filter(|_| of("li", later).is_ok()).count(), 5);
    }

    #[test]
    fn an_address_is_counted_whatever_the_account_and_a_refusal_costs_nothing() {
        let (tries, now) = (Tries::default(), Instant::now());
        let address = Who::address("10.0.0.7".parse().unwrap());
        for number in 0..5 {
            let both = [account(&number.to_string()), address.clone()];
            assert_eq!(tries.take(&both, now), Ok(()));
        }
        for _ in 0..10 {
            assert!(tries.take(&[account("li"), address.clone()], now).is_err());
        }
        tries.give_back(&[account("4"), address.clone()]);
        assert!(
            tries.take(std::slice::from_ref(&address), now).is_ok(),
            "one of its own"
        );
        assert!(tries.take(&[address], now).is_err());
        let other = Who::address("10.0.0.8".parse().unwrap());
        assert_eq!(tries.take(&[account("li"), other], now), Ok(()));
    }

    #[test]
    fn a_network_of_ipv6_is_one_and_so_are_both_forms_of_ipv4() {
        let of = |text: &str| Who::address(text.parse().unwrap());
        assert_eq!(of("2001:db8::1"), of("2001:db8::ffff:2"));
        assert_ne!(of("2001:db8::1"), of("2001:db8:0:1::1"));
        assert_eq!(of("::ffff:10.0.0.7"), of("10.0.0.7"));
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let (tries, now) = (Tries::default(), Instant::now());
        for _ in 0..TRIES_MAX {
            assert!(tries.take(&[account("li")], now).is_ok());
        }
        for number in 0..2 * REMEMBERED_MAX {
            let _ = tries.take(&[account(&number.to_string())], now);
        }
        let known = tries.0.lock().unwrap().len();
        assert!(known <= REMEMBERED_MAX, "{known}");
        assert!(tries.take(&[account("li")], now).is_err(), "still known");
    }
}
