//! Whether this machine or this program stood still while there was a connection.

use std::time::{Duration, SystemTime};
use tokio::time::Instant;

/// Something happens on a connection at least with every keep-alive, of 3 s.
const GAP_MAX: Duration = Duration::from_secs(5);

/// When something happened last, by both clocks: only one of them goes on while the machine
/// sleeps, and the other can be set.
#[derive(Debug)]
pub(crate) struct Alive {
    last: (Instant, SystemTime),
}

impl Alive {
    pub(crate) const fn since(last: (Instant, SystemTime)) -> Alive {
        Alive { last }
    }

    /// Something happens. Whether too long after the last time: what has waited since may have
    /// been ordered for a moment that is over.
    pub(crate) fn is_late(&mut self, now: (Instant, SystemTime)) -> bool {
        let last = std::mem::replace(&mut self.last, now);
        let steady = now.0.duration_since(last.0);
        let wall = now.1.duration_since(last.1).unwrap_or_default();
        steady.max(wall) > GAP_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_clocks_count() {
        let (begun, today) = (Instant::now(), SystemTime::UNIX_EPOCH + GAP_MAX * 9);
        let late = |steady: u64, wall: u64| {
            let mut alive = Alive::since((begun, today));
            let of = Duration::from_secs;
            alive.is_late((begun + of(steady), today + of(wall)))
        };
        assert!(!late(3, 3) && !late(5, 5));
        assert!(late(6, 6), "the program was stopped");
        assert!(late(0, 60), "the machine slept");
        assert!(late(6, 0), "the clock was set back meanwhile");
        let mut alive = Alive::since((begun, today));
        assert!(!alive.is_late((begun, today - GAP_MAX * 3)), "set back");
        assert!(alive.is_late((begun + GAP_MAX * 2, today)));
        assert!(
            !alive.is_late((begun + GAP_MAX * 2, today)),
            "it counts anew"
        );
    }
}
