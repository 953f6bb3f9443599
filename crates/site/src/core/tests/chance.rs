//! What goes wrong, by chance from a seed.

/// Chance from a seed: xorshift64*.
#[derive(Clone, Debug)]
pub(super) struct Dice(u64);

impl Dice {
    pub(super) fn new(seed: u64) -> Dice {
        Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub(super) fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) % end
    }

    pub(super) fn one_in(&mut self, times: u64) -> bool {
        times > 0 && self.below(times) == 0
    }

    pub(super) fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.below(high - low + 1)
    }
}

/// How often something goes wrong: once in so many times, never where it is 0.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Faults {
    /// A request gets lost.
    pub(super) request_lost: u64,
    /// A reply gets lost: the module has acted.
    pub(super) reply_lost: u64,
    /// A module refuses.
    pub(super) refused: u64,
    /// The disk refuses promises.
    pub(super) disk: u64,
    /// The disk takes seconds.
    pub(super) slow_disk: u64,
    /// The audit log refuses.
    pub(super) audit: u64,
}
