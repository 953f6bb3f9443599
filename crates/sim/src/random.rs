//! The only source of randomness: a seed reproduces a run.

use crate::{Chance, DurationRange};
use railbus_wire::Micros;

/// xoshiro256++ by Blackman and Vigna, seeded by splitmix64.
#[derive(Clone, Debug)]
pub(crate) struct Random {
    state: [u64; 4],
}

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        let mut at = seed;
        let state = [(); 4].map(|()| {
            at = at.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mixed = (at ^ at >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
            mixed ^ mixed >> 31
        });
        Random { state }
    }

    pub(crate) fn next(&mut self) -> u64 {
        let [a, b, c, d] = &mut self.state;
        let result = a.wrapping_add(*d).rotate_left(23).wrapping_add(*a);
        let shifted = *b << 17;
        *c ^= *a;
        *d ^= *b;
        *b ^= *c;
        *a ^= *d;
        *c ^= shifted;
        *d = d.rotate_left(45);
        result
    }

    /// A number from 0 to `limit - 1`; 0 where the limit is 0.
    pub(crate) fn below(&mut self, limit: u64) -> u64 {
        ((u128::from(self.next()) * u128::from(limit)) >> 64) as u64
    }

    pub(crate) fn byte(&mut self) -> u8 {
        (self.next() >> 56) as u8
    }

    /// A duration within the range, inclusive.
    pub(crate) fn within(&mut self, span: DurationRange) -> Micros {
        let width = (span.to - span.from).0.saturating_add(1);
        span.from + Micros(self.below(width))
    }

    /// A duration that is `mean` on average: 0 to twice that.
    pub(crate) fn around(&mut self, mean: Micros) -> Micros {
        self.within(DurationRange {
            from: Micros(1),
            to: mean * 2,
        })
    }

    /// Whether it happens this time. What never happens draws no number, so disabling a fault does
    /// not change the rest of a run.
    pub(crate) fn happens(&mut self, chance: Chance) -> bool {
        chance != Chance::NEVER && self.below(1_000_000) < u64::from(chance.millionths())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_the_published_one() {
        // State 1, 2, 3, 4: the first numbers of the reference implementation.
        let mut random = Random {
            state: [1, 2, 3, 4],
        };
        let first = [random.next(), random.next(), random.next()];
        assert_eq!(first, [41_943_041, 58_720_359, 3_588_806_011_781_223]);
    }

    #[test]
    fn spans_include_both_ends() {
        let mut random = Random::new(7);
        let span = DurationRange {
            from: Micros(3),
            to: Micros(5),
        };
        let mut seen = [false; 8];
        for _ in 0..100 {
            seen[random.within(span).0 as usize] = true;
        }
        assert_eq!(seen, [false, false, false, true, true, true, false, false]);
    }

    #[test]
    fn chances_are_kept() {
        let mut random = Random::new(7);
        let count = (0..100_000)
            .filter(|_| random.happens(Chance::percent(10)))
            .count();
        assert!((9_700..10_300).contains(&count), "{count}");
        assert!(!random.happens(Chance::NEVER));
        assert!(random.happens(Chance::ALWAYS));
    }
}
