//! The faults that stand: which, until when, and what they amount to.

use railbus_sim::{Chance, Faults, Span};
use railbus_site::config::{Fault, FaultOrder, Noise};
use railbus_wire::{Instant, Micros, Settings};
use std::mem::discriminant;

/// The faults of a module or of a line.
#[derive(Clone, Debug, Default)]
pub(super) struct Standing(Vec<Stands>);

/// A fault that stands.
#[derive(Clone, Debug)]
struct Stands {
    order: FaultOrder,
    /// It ends by itself then.
    until: Option<Instant>,
}

impl Standing {
    /// From now on this goes wrong too; it takes the place of one of its own kind.
    pub(super) fn add(&mut self, now: Instant, order: &FaultOrder) {
        let kind = discriminant(&order.fault);
        self.0.retain(|one| discriminant(&one.order.fault) != kind);
        self.0.push(Stands {
            order: order.clone(),
            until: order.lasts.map(|time| now + time),
        });
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Drops those whose time is over.
    pub(super) fn expire(&mut self, now: Instant) {
        self.0
            .retain(|one| one.until.is_none_or(|until| until > now));
    }

    /// When the first of them ends.
    pub(super) fn next_end(&self) -> Option<Instant> {
        self.0.iter().filter_map(|one| one.until).min()
    }

    pub(super) fn has(&self, fault: Fault) -> bool {
        self.0.iter().any(|one| one.order.fault == fault)
    }

    /// The address that a fault gives the module.
    pub(super) fn address(&self) -> Option<u8> {
        self.0.iter().find_map(|one| match one.order.fault {
            Fault::DupAddress(address) => Some(address),
            _ => None,
        })
    }

    /// As they were ordered, and how long those still last that end by themselves.
    pub(super) fn words(&self, now: Instant) -> impl Iterator<Item = (&str, Option<Micros>)> {
        self.0.iter().map(move |one| {
            let left = one.until.map(|until| until.since(now));
            (one.order.words.as_str(), left)
        })
    }

    /// What chance is to do, on a line with these settings.
    pub(super) fn faults(&self, serial: Settings) -> Faults {
        let mut faults = Faults::NONE;
        for one in &self.0 {
            add(&mut faults, one.order.fault, serial);
        }
        faults
    }
}

/// Adds one fault. Those that chance has no part in are the stage's business.
fn add(faults: &mut Faults, fault: Fault, serial: Settings) {
    let chance = Chance::per_million;
    let same = |time| Span {
        from: time,
        to: time,
    };
    match fault {
        Fault::Mute => faults.lose_reply = Chance::ALWAYS,
        Fault::Deaf => faults.lose_request = Chance::ALWAYS,
        Fault::Drop(part) => {
            faults.lose_request = faults.lose_request.max(chance(part));
            faults.lose_reply = faults.lose_reply.max(chance(part));
        }
        Fault::Flip(part) => faults.flip = chance(part),
        Fault::Skip(part) => faults.lose_character = chance(part),
        Fault::Noise(Noise::Every(time)) => faults.noise_every = Some(time),
        Fault::Noise(Noise::Chance(part)) => {
            let character = serial.frame_time(1).0;
            faults.noise_every = Some(Micros(character * 1_000_000 / u64::from(part.max(1))));
        }
        Fault::Glitch(part) => {
            faults.glitch_before = chance(part);
            faults.glitch_after = chance(part);
        }
        Fault::Delay(from, to) => {
            faults.late = Chance::ALWAYS;
            faults.late_by = Span { from, to };
        }
        Fault::Duplicate(part) => {
            faults.again = chance(part);
            faults.again_after = Span::millis(2, 20);
        }
        Fault::Split(part, pause) => {
            faults.pieces = chance(part);
            faults.pause = same(pause);
        }
        Fault::Babble(Some(part)) => {
            faults.babble = chance(part);
            faults.babble_for = Span::millis(50, 500);
        }
        Fault::Cuts(every, away) => {
            faults.cut_every = Some(every);
            faults.cut_for = same(away);
        }
        Fault::Babble(None) | Fault::Dead | Fault::Echo | Fault::DupAddress(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_site::config::parse_faults;

    fn standing(text: &str) -> Standing {
        let mut standing = Standing::default();
        for order in parse_faults(text, true).unwrap_or_default() {
            standing.add(Instant(0), &order);
        }
        standing
    }

    #[test]
    fn the_later_of_a_kind_holds_and_all_add_up() {
        let faults = standing("drop 5%, flip 1%, drop 10%").faults(Settings::FACTORY);
        assert_eq!(faults.lose_request, Chance::percent(10));
        assert_eq!(faults.lose_reply, Chance::percent(10));
        assert_eq!(faults.flip, Chance::percent(1));
        let faults = standing("drop 5%, mute").faults(Settings::FACTORY);
        assert_eq!(faults.lose_reply, Chance::ALWAYS);
        assert_eq!(faults.lose_request, Chance::percent(5));
    }

    #[test]
    fn noise_counts_by_characters() {
        let faults = standing("noise 1e-3").faults(Settings::FACTORY);
        assert_eq!(faults.noise_every, Some(Micros(1_042_000)));
    }

    #[test]
    fn a_fault_ends_when_its_time_is_over() {
        let mut standing = standing("mute 10s, deaf");
        assert_eq!(standing.next_end(), Some(Instant(10_000_000)));
        standing.expire(Instant(9_999_999));
        assert!(standing.has(Fault::Mute));
        standing.expire(Instant(10_000_000));
        assert!(!standing.has(Fault::Mute) && standing.has(Fault::Deaf));
        assert_eq!(standing.next_end(), None);
    }
}
