//! How long to wait before a lost port is tried again.

use railbus_wire::Micros;
use std::hash::{BuildHasher, Hasher, RandomState};

/// The first and the longest pause. Even with the longest, a port that comes back is found well
/// within two seconds.
const FIRST: Micros = Micros::from_millis(100);
const LONGEST: Micros = Micros::from_millis(1000);

/// Pauses that double, each shortened by up to a quarter, so that many ports lost at the same time
/// are not all tried at the same moments.
#[derive(Debug)]
pub(crate) struct Backoff {
    pause: Micros,
    random: RandomState,
    draws: u64,
}

impl Backoff {
    pub(crate) fn new() -> Backoff {
        Backoff {
            pause: FIRST,
            random: RandomState::new(),
            draws: 0,
        }
    }

    /// The port was found: start again with the first pause.
    pub(crate) fn reset(&mut self) {
        self.pause = FIRST;
    }

    /// The next pause.
    pub(crate) fn next(&mut self) -> Micros {
        let pause = self.pause;
        self.pause = (pause * 2).min(LONGEST);
        self.draws += 1;
        let mut hasher = self.random.build_hasher();
        hasher.write_u64(self.draws);
        pause - Micros(hasher.finish() % (pause.0 / 4))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_a_second_and_are_jittered() {
        let mut backoff = Backoff::new();
        for most in [100, 200, 400, 800, 1000, 1000] {
            let pause = backoff.next();
            let most = Micros::from_millis(most);
            assert!(pause <= most && pause.0 >= most.0 / 4 * 3, "{pause:?}");
        }
        backoff.reset();
        assert!(backoff.next() <= FIRST);
    }
}
