//! The active faults: which, until when, and their effects.

use railbus_sim::{Chance, DurationRange, Faults};
use railbus_site::config::{FaultOrder, InjectedFault, Noise};
use railbus_wire::{Instant, Micros, SerialSettings};

/// The faults of a module or of a line.
#[derive(Clone, Debug, Default)]
pub(super) struct ActiveFaults(Vec<Stands>);

/// An active fault.
#[derive(Clone, Debug)]
struct Stands {
    order: FaultOrder,
    /// It ends automatically then.
    until: Option<Instant>,
    /// It ends automatically when the module has given this many replies since it was added.
    until_reply: Option<u64>,
}

/// An active fault, as reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Told<'a> {
    /// As specified.
    pub(super) words: &'a str,
    /// Time left, if it ends automatically.
    pub(super) left: Option<Micros>,
    /// Number of replies left, if it is limited.
    pub(super) times_left: Option<u64>,
}

impl ActiveFaults {
    /// Adds a fault, which replaces one of the same kind. `replies` is how many the module has
    /// given.
    pub(super) fn add(&mut self, now: Instant, replies: u64, order: &FaultOrder) {
        self.0.retain(|one| !one.order.fault.excludes(order.fault));
        self.0.push(Stands {
            order: order.clone(),
            until: order.lasts.map(|time| now + time),
            until_reply: order.times.map(|times| replies + u64::from(times)),
        });
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Removes those with this specification or name.
    pub(super) fn clear_some(&mut self, words: &str) {
        self.0.retain(|one| {
            let own = one.order.words.as_str();
            own != words && own.split(' ').next() != Some(words)
        });
    }

    /// Removes those whose time is over, and those whose number of replies is reached.
    pub(super) fn expire(&mut self, now: Instant, replies: u64) {
        self.0.retain(|one| {
            let lasts = one.until.is_none_or(|until| until > now);
            lasts && one.until_reply.is_none_or(|until| until > replies)
        });
    }

    /// Whether one of them has to end.
    pub(super) fn is_due(&self, now: Instant, replies: u64) -> bool {
        self.0.iter().any(|one| {
            one.until.is_some_and(|until| until <= now)
                || one.until_reply.is_some_and(|until| until <= replies)
        })
    }

    /// When the first of them ends.
    pub(super) fn next_end(&self) -> Option<Instant> {
        self.0.iter().filter_map(|one| one.until).min()
    }

    pub(super) fn has(&self, fault: InjectedFault) -> bool {
        self.0.iter().any(|one| one.order.fault == fault)
    }

    /// The address required by a fault.
    pub(super) fn address(&self) -> Option<u8> {
        self.0.iter().find_map(|one| match one.order.fault {
            InjectedFault::DupAddress(address) => Some(address),
            _ => None,
        })
    }

    /// The outputs that are stuck: bit n = output n.
    pub(super) fn stuck(&self) -> u32 {
        let faults = self.0.iter().map(|one| one.order.fault);
        faults.fold(0, |mask, fault| match fault {
            InjectedFault::Stuck(index) => mask | 1u32.checked_shl(index.into()).unwrap_or(0),
            _ => mask,
        })
    }

    /// All of them. `replies` is how many the module has given.
    pub(super) fn told(&self, now: Instant, replies: u64) -> impl Iterator<Item = Told<'_>> {
        self.0.iter().map(move |one| Told {
            words: &one.order.words,
            left: one.until.map(|until| until.since(now)),
            times_left: one.until_reply.map(|until| until.saturating_sub(replies)),
        })
    }

    /// The random faults, on a line with these settings.
    pub(super) fn faults(&self, serial: SerialSettings) -> Faults {
        let mut faults = Faults::NONE;
        for one in &self.0 {
            add(&mut faults, one.order.fault, serial);
        }
        faults
    }
}

/// Adds one fault. Those without randomness are handled by the stage.
fn add(faults: &mut Faults, fault: InjectedFault, serial: SerialSettings) {
    let chance = Chance::per_million;
    let same = |time| DurationRange {
        from: time,
        to: time,
    };
    match fault {
        InjectedFault::Mute => faults.lose_reply = Chance::ALWAYS,
        InjectedFault::Deaf => faults.lose_request = Chance::ALWAYS,
        InjectedFault::Drop(part) => {
            faults.lose_request = faults.lose_request.max(chance(part));
            faults.lose_reply = faults.lose_reply.max(chance(part));
        }
        InjectedFault::Flip(part) => faults.flip = chance(part),
        InjectedFault::Skip(part) => faults.lose_character = chance(part),
        InjectedFault::Noise(Noise::Every(time)) => faults.noise_every = Some(time),
        InjectedFault::Noise(Noise::Chance(part)) => {
            let character = serial.frame_time(1).0;
            faults.noise_every = Some(Micros(character * 1_000_000 / u64::from(part.max(1))));
        }
        InjectedFault::Glitch(part) => {
            faults.glitch_before = chance(part);
            faults.glitch_after = chance(part);
        }
        InjectedFault::Delay(from, to) => {
            faults.late = Chance::ALWAYS;
            faults.late_by = DurationRange { from, to };
        }
        InjectedFault::Duplicate(part) => {
            faults.again = chance(part);
            faults.again_after = DurationRange::millis(2, 20);
        }
        InjectedFault::Split(part, pause) => {
            faults.pieces = chance(part);
            faults.pause = same(pause);
        }
        InjectedFault::Babble(Some(part)) => {
            faults.babble = chance(part);
            faults.babble_for = DurationRange::millis(50, 500);
        }
        InjectedFault::Cuts(every, away) => {
            faults.cut_every = Some(every);
            faults.cut_for = same(away);
        }
        InjectedFault::Bad => faults.spoil = Chance::ALWAYS,
        InjectedFault::Babble(None)
        | InjectedFault::Dead
        | InjectedFault::Echo
        | InjectedFault::DupAddress(_)
        | InjectedFault::Stuck(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::{Family, Setup};
    use railbus_site::config::{FaultsOf, parse_faults};
    use railbus_wire::Address;

    fn active(text: &str) -> ActiveFaults {
        let mut faults = ActiveFaults::default();
        let oven = Setup::new(Family::Erc8, Address(1));
        let of = match text.starts_with("noise") {
            true => FaultsOf::Line,
            false => FaultsOf::Module(&oven),
        };
        for order in parse_faults(text, of).unwrap() {
            faults.add(Instant(0), 5, &order);
        }
        faults
    }

    #[test]
    fn the_later_of_a_kind_holds_and_all_add_up() {
        let faults = active("drop 5%, flip 1%, drop 10%").faults(SerialSettings::FACTORY);
        assert_eq!(faults.lose_request, Chance::percent(10));
        assert_eq!(faults.lose_reply, Chance::percent(10));
        assert_eq!(faults.flip, Chance::percent(1));
        let faults = active("drop 5%, mute").faults(SerialSettings::FACTORY);
        assert_eq!(faults.lose_reply, Chance::ALWAYS);
        assert_eq!(faults.lose_request, Chance::percent(5));
    }

    #[test]
    fn noise_counts_by_characters() {
        let faults = active("noise 1e-3").faults(SerialSettings::FACTORY);
        assert_eq!(faults.noise_every, Some(Micros(1_042_000)));
    }

    #[test]
    fn a_fault_ends_when_its_time_is_over() {
        let mut faults = active("mute 10s, deaf");
        assert_eq!(faults.next_end(), Some(Instant(10_000_000)));
        faults.expire(Instant(9_999_999), 9);
        assert!(faults.has(InjectedFault::Mute));
        assert!(faults.is_due(Instant(10_000_000), 9));
        faults.expire(Instant(10_000_000), 9);
        assert!(!faults.has(InjectedFault::Mute) && faults.has(InjectedFault::Deaf));
        assert_eq!(faults.next_end(), None);
    }

    #[test]
    fn a_fault_ends_when_all_its_replies_were_given() {
        let mut faults = active("bad 2x, stuck k1, stuck k3, stuck k1");
        assert_eq!(faults.stuck(), 0b101);
        let left = |faults: &ActiveFaults, replies| {
            let told = faults.told(Instant(0), replies);
            told.filter_map(|told| told.times_left).collect::<Vec<_>>()
        };
        assert_eq!((left(&faults, 5), left(&faults, 6)), (vec![2], vec![1]));
        assert!(!faults.is_due(Instant(0), 6));
        faults.expire(Instant(0), 6);
        assert!(faults.has(InjectedFault::Bad) && faults.is_due(Instant(0), 7));
        faults.expire(Instant(0), 7);
        assert!(!faults.has(InjectedFault::Bad));
        assert_eq!(faults.told(Instant(0), 7).count(), 2);
    }
}
