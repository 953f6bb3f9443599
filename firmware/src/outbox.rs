//! Bytes to send, from the loop that writes them to the interrupt that sends them.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// At most `N` bytes, written as one and sent one by one. One side writes and one side takes.
#[derive(Debug)]
pub struct Outbox<const N: usize> {
    bytes: [AtomicU8; N],
    len: AtomicU32,
    taken: AtomicU32,
}

impl<const N: usize> Outbox<N> {
    /// Nothing to send.
    #[must_use]
    pub const fn new() -> Outbox<N> {
        Outbox {
            bytes: [const { AtomicU8::new(0) }; N],
            len: AtomicU32::new(0),
            taken: AtomicU32::new(0),
        }
    }

    /// Replaces the content by these bytes; those that exceed the capacity are dropped.
    pub fn fill(&self, bytes: &[u8]) {
        self.clear();
        for (slot, byte) in self.bytes.iter().zip(bytes) {
            slot.store(*byte, Ordering::Relaxed);
        }
        self.taken.store(0, Ordering::Relaxed);
        self.len.store(bytes.len().min(N) as u32, Ordering::Release);
    }

    /// Takes the next byte.
    pub fn take(&self) -> Option<u8> {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken >= self.len.load(Ordering::Acquire) {
            return None;
        }
        self.taken.store(taken + 1, Ordering::Relaxed);
        Some(self.bytes.get(taken as usize)?.load(Ordering::Relaxed))
    }

    /// Drops what was not taken.
    pub fn clear(&self) {
        self.len.store(0, Ordering::Release);
    }
}

impl<const N: usize> Default for Outbox<N> {
    fn default() -> Outbox<N> {
        Outbox::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_leave_in_order_and_once() {
        let outbox = Outbox::<4>::new();
        let taken = || core::iter::from_fn(|| outbox.take()).collect::<Vec<_>>();
        assert_eq!(taken(), []);
        outbox.fill(&[1, 2, 3]);
        assert_eq!(outbox.take(), Some(1));
        assert_eq!(taken(), [2, 3]);
        outbox.fill(&[4, 5, 6, 7, 8]);
        assert_eq!(taken(), [4, 5, 6, 7], "no more than there is room for");
        outbox.fill(&[9]);
        outbox.clear();
        assert_eq!(taken(), []);
    }
}
