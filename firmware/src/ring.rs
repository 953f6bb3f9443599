//! What the line brings, from the interrupt that hears it to the loop that understands it.

use core::sync::atomic::{AtomicU32, Ordering};
use railbus_wire::Instant;

/// How many characters wait at most: more than the loop ever leaves lying at 115200 baud while
/// it stores settings.
const CAPACITY: u32 = 128;

/// One character off the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When it ended.
    pub at: Instant,
    /// The character; nothing where its stop bit or parity was wrong.
    pub byte: Option<u8>,
}

/// The characters that wait, oldest first. One side pushes and one side pops.
///
/// An entry is one word: the character, whether it was bad, and the lowest 23 bits of its
/// microsecond, which are enough for a loop that looks within eight seconds.
#[derive(Debug)]
pub struct Ring {
    slots: [AtomicU32; CAPACITY as usize],
    pushed: AtomicU32,
    popped: AtomicU32,
}

const BAD: u32 = 1 << 8;
const TIME_SHIFT: u32 = 9;

impl Ring {
    /// An empty ring.
    #[must_use]
    pub const fn new() -> Ring {
        Ring {
            slots: [const { AtomicU32::new(0) }; CAPACITY as usize],
            pushed: AtomicU32::new(0),
            popped: AtomicU32::new(0),
        }
    }

    /// Whether another character has room.
    #[must_use]
    pub fn has_room(&self) -> bool {
        let pushed = self.pushed.load(Ordering::Relaxed);
        pushed.wrapping_sub(self.popped.load(Ordering::Acquire)) < CAPACITY
    }

    /// Whether nothing waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pushed.load(Ordering::Acquire) == self.popped.load(Ordering::Relaxed)
    }

    /// Adds a character; false, and nothing added, where it has no room.
    pub fn push(&self, heard: Heard) -> bool {
        let at = self.pushed.load(Ordering::Relaxed);
        let Some(slot) = self.slot(at).filter(|_| self.has_room()) else {
            return false;
        };
        let what = heard.byte.map_or(BAD, u32::from);
        slot.store((heard.at.0 as u32) << TIME_SHIFT | what, Ordering::Relaxed);
        self.pushed.store(at.wrapping_add(1), Ordering::Release);
        true
    }

    /// Takes the oldest character. `now` is read after it is known to be there, so that it is
    /// not older than what it helps to date.
    pub fn pop(&self, now: impl FnOnce() -> Instant) -> Option<Heard> {
        if self.is_empty() {
            return None;
        }
        let at = self.popped.load(Ordering::Relaxed);
        let word = self.slot(at)?.load(Ordering::Relaxed);
        self.popped.store(at.wrapping_add(1), Ordering::Release);
        let now = now();
        let age = (now.0 as u32).wrapping_sub(word >> TIME_SHIFT) & (u32::MAX >> TIME_SHIFT);
        Some(Heard {
            at: Instant(now.0.saturating_sub(age.into())),
            byte: (word & BAD == 0).then_some(word as u8),
        })
    }

    fn slot(&self, count: u32) -> Option<&AtomicU32> {
        self.slots.get((count % CAPACITY) as usize)
    }
}

impl Default for Ring {
    fn default() -> Ring {
        Ring::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn heard(at: u64, byte: Option<u8>) -> Heard {
        Heard {
            at: Instant(at),
            byte,
        }
    }

    #[test]
    fn what_was_pushed_comes_out_with_its_time() {
        let ring = Ring::new();
        // Far above 23 bits, and just before they wrap.
        let late = (7 << 23) - 2;
        let told = [
            heard(late, Some(0xFF)),
            heard(late + 4, None),
            heard(late + 5, Some(0)),
        ];
        assert!(told.iter().all(|heard| ring.push(*heard)));
        let popped: Vec<_> =
            core::iter::from_fn(|| ring.pop(|| Instant(late + 8_000_000))).collect();
        assert_eq!(popped, told);
        assert!(ring.is_empty());
    }

    #[test]
    fn a_full_ring_takes_nothing_and_loses_nothing() {
        let ring = Ring::new();
        for round in 0..3 {
            let mut pushed = 0;
            while ring.has_room() {
                assert!(ring.push(heard(round, Some(pushed as u8))));
                pushed += 1;
            }
            assert_eq!(pushed, CAPACITY);
            assert!(!ring.push(heard(round, Some(1))));
            for byte in 0..CAPACITY {
                let popped = ring.pop(|| Instant(round)).map(|heard| heard.byte);
                assert_eq!(popped, Some(Some(byte as u8)));
            }
            assert_eq!(ring.pop(|| Instant(round)), None);
        }
    }
}
