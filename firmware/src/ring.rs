//! Received characters, from the interrupt that receives them to the loop that parses them.

use core::sync::atomic::{AtomicU32, Ordering};
use railbus_wire::Instant;

/// The capacity: more than ever accumulates at 115200 baud while the loop stores settings.
const CAPACITY: u32 = 128;

/// One character off the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When it ended.
    pub at: Instant,
    /// What it is.
    pub what: What,
}

/// What a character is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// This byte.
    Byte(u8),
    /// Unknown: its stop bit or parity was wrong.
    Bad,
    /// Unknown: it was not taken in time.
    Lost,
}

/// Pending characters, oldest first. One side pushes and one side pops.
///
/// An entry is one word: nine bits for the character, and the lowest 23 bits of its time in
/// microseconds, which are enough for times of up to four seconds before and after the time of
/// reading.
#[derive(Debug)]
pub struct Ring {
    slots: [AtomicU32; CAPACITY as usize],
    pushed: AtomicU32,
    popped: AtomicU32,
}

const BAD: u32 = 0x100;
const LOST: u32 = 0x101;
const WHAT: u32 = 0x1FF;
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

    /// Whether there is room for another character.
    #[must_use]
    pub fn has_room(&self) -> bool {
        let pushed = self.pushed.load(Ordering::Relaxed);
        pushed.wrapping_sub(self.popped.load(Ordering::Acquire)) < CAPACITY
    }

    /// Whether it is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pushed.load(Ordering::Acquire) == self.popped.load(Ordering::Relaxed)
    }

    /// Adds a character; returns false, and adds nothing, if it is full.
    pub fn push(&self, heard: Heard) -> bool {
        let at = self.pushed.load(Ordering::Relaxed);
        let Some(slot) = self.slot(at).filter(|_| self.has_room()) else {
            return false;
        };
        let what = match heard.what {
            What::Byte(byte) => byte.into(),
            What::Bad => BAD,
            What::Lost => LOST,
        };
        slot.store((heard.at.0 as u32) << TIME_SHIFT | what, Ordering::Relaxed);
        self.pushed.store(at.wrapping_add(1), Ordering::Release);
        true
    }

    /// When the oldest character ended or will end. `now` is read after that character is known to
    /// be there, so that it is not older than the time that it helps to reconstruct.
    pub fn next_at(&self, now: impl FnOnce() -> Instant) -> Option<Instant> {
        let word = self.oldest()?;
        let now = now();
        // Both wrap, and what is above the highest bit is irrelevant.
        let ahead = (word & !WHAT).wrapping_sub((now.0 as u32) << TIME_SHIFT) as i32 >> TIME_SHIFT;
        Some(Instant(now.0.saturating_add_signed(ahead.into())))
    }

    /// Takes the oldest character, once it has ended.
    pub fn pop(&self, now: impl Fn() -> Instant + Copy) -> Option<Heard> {
        let at = self.next_at(now)?;
        let word = self.oldest().filter(|_| at <= now())?;
        let popped = self.popped.load(Ordering::Relaxed);
        self.popped.store(popped.wrapping_add(1), Ordering::Release);
        let what = match word & WHAT {
            BAD => What::Bad,
            LOST => What::Lost,
            _ => What::Byte(word as u8),
        };
        Some(Heard { at, what })
    }

    fn oldest(&self) -> Option<u32> {
        if self.is_empty() {
            return None;
        }
        let at = self.popped.load(Ordering::Relaxed);
        Some(self.slot(at)?.load(Ordering::Relaxed))
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

    const fn heard(at: u64, what: What) -> Heard {
        Heard {
            at: Instant(at),
            what,
        }
    }

    #[test]
    fn what_was_pushed_comes_out_with_its_time() {
        let ring = Ring::new();
        // Far above 23 bits, and just before they wrap.
        let late = (7 << 23) - 2;
        let told = [
            heard(late, What::Byte(0xFF)),
            heard(late + 4, What::Bad),
            heard(late + 4, What::Lost),
            heard(late + 5, What::Byte(0)),
        ];
        assert!(told.iter().all(|heard| ring.push(*heard)));
        let pop = || ring.pop(|| Instant(late + 4_000_000));
        assert_eq!(core::iter::from_fn(pop).collect::<Vec<_>>(), told);
        assert!(ring.is_empty());
    }

    #[test]
    fn what_has_not_ended_waits() {
        let ring = Ring::new();
        let end = (3 << 23) + 1;
        assert_eq!(ring.next_at(|| Instant(0)), None);
        ring.push(heard(end, What::Byte(7)));
        for early in [1, 2, 4_000_000] {
            let now = || Instant(end - early);
            assert_eq!(ring.next_at(now), Some(Instant(end)));
            assert_eq!(ring.pop(now), None);
        }
        assert_eq!(ring.pop(|| Instant(end)), Some(heard(end, What::Byte(7))));
    }

    #[test]
    fn a_full_ring_takes_nothing_and_loses_nothing() {
        let ring = Ring::new();
        for round in 0..3 {
            let mut pushed = 0;
            while ring.has_room() {
                assert!(ring.push(heard(round, What::Byte(pushed as u8))));
                pushed += 1;
            }
            assert_eq!(pushed, CAPACITY);
            assert!(!ring.push(heard(round, What::Bad)));
            for byte in 0..CAPACITY {
                let popped = ring.pop(|| Instant(round)).map(|heard| heard.what);
                assert_eq!(popped, Some(What::Byte(byte as u8)));
            }
            assert_eq!(ring.pop(|| Instant(round)), None);
        }
    }
}
