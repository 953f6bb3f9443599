//! Time in the core: numbers passed in from outside. There is no clock here.

use core::ops::{Add, AddAssign, Mul, Sub};

/// How long the reply of a module may take to begin that has never answered, or whose usual time is
/// not known [EDA §1.12, ERC-8 §1.7, EMD-2A2Q §1.7, R55 §3.10].
pub const REPLY_TIMEOUT: Micros = Micros::from_millis(300);

/// A moment, in microseconds since an origin chosen by the driver (usually its start).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(pub u64);

impl Instant {
    /// The time since `earlier`; zero if `earlier` is later.
    #[must_use]
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn since(self, earlier: Instant) -> Micros {
        Micros(self.0.saturating_sub(earlier.0))
    }

    /// The earliest of some moments, each of which may be none.
    #[must_use]
    #[cfg_attr(feature = "small", inline(never))]
    pub fn earliest(all: &[Option<Instant>]) -> Option<Instant> {
        all.iter().copied().flatten().min()
    }
}

impl Add<Micros> for Instant {
    type Output = Instant;
    #[cfg_attr(feature = "small", inline(never))]
    fn add(self, span: Micros) -> Instant {
        Instant(self.0.saturating_add(span.0))
    }
}

/// A span of time in microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Micros(pub u64);

impl Micros {
    /// Zero.
    pub const ZERO: Micros = Micros(0);

    /// This many milliseconds.
    #[must_use]
    pub const fn from_millis(millis: u64) -> Micros {
        Micros(millis.saturating_mul(1000))
    }

    /// This many seconds.
    #[must_use]
    pub const fn from_secs(secs: u64) -> Micros {
        Micros(secs.saturating_mul(1_000_000))
    }

    /// Parses a duration with its unit: `200ms`, `1.5s`, `2m`. A bare number is refused, since its
    /// unit would be a guess.
    #[must_use]
    pub fn parse(text: &str) -> Option<Micros> {
        let at = text.find(|c: char| c.is_ascii_alphabetic())?;
        let (number, unit) = text.split_at(at);
        let micros_per_unit: u64 = match unit {
            "us" => 1,
            "ms" => 1_000,
            "s" => 1_000_000,
            "m" | "min" => 60_000_000,
            "h" => 3_600_000_000,
            _ => return None,
        };
        let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
        let whole: u64 = whole.parse().ok()?;
        let mut micros = whole.checked_mul(micros_per_unit)?;
        let mut weight = micros_per_unit;
        for digit in fraction.chars() {
            weight /= 10;
            micros = micros.checked_add(u64::from(digit.to_digit(10)?) * weight)?;
        }
        Some(Micros(micros))
    }

    /// Whole seconds, and the remaining microseconds.
    ///
    /// In steps of 16 bits: a small processor divides 32 bits by 32, and a function to divide 64
    /// bits takes half a KiB there.
    #[must_use]
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn seconds(self) -> (u64, u32) {
        // A second is 64 times 15625 µs.
        const UNIT: u32 = 15_625;
        let units = self.0 >> 6;
        let [high, low] = [(units >> 32) as u32, units as u32];
        let (first, rest) = (high / UNIT, high % UNIT);
        let part = rest << 16 | low >> 16;
        let (second, rest) = (part / UNIT, part % UNIT);
        let part = rest << 16 | low & 0xFFFF;
        let (third, rest) = (part / UNIT, part % UNIT);
        let seconds = (first as u64) << 32 | (second << 16 | third) as u64;
        (seconds, rest << 6 | self.0 as u32 & 63)
    }
}

impl Add for Micros {
    type Output = Micros;
    fn add(self, other: Micros) -> Micros {
        Micros(self.0.saturating_add(other.0))
    }
}

impl AddAssign for Micros {
    fn add_assign(&mut self, other: Micros) {
        *self = *self + other;
    }
}

impl Sub for Micros {
    type Output = Micros;
    /// Zero if the other duration is longer.
    fn sub(self, other: Micros) -> Micros {
        Micros(self.0.saturating_sub(other.0))
    }
}

impl Mul<u64> for Micros {
    type Output = Micros;
    fn mul(self, times: u64) -> Micros {
        Micros(self.0.saturating_mul(times))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_what_division_says() {
        let second: u64 = 1_000_000;
        let around = |at: u64| [at.wrapping_sub(1), at, at.wrapping_add(1)];
        let ends = [0, 1 << 16, 1 << 22, 1 << 32, 1 << 38, 1 << 54, u64::MAX];
        let wholes = [1, 2, 15_625, 4_294_967_296, u64::MAX / second].map(|n| n * second);
        for micros in ends.into_iter().chain(wholes).flat_map(around) {
            let right = (micros / second, (micros % second) as u32);
            assert_eq!(Micros(micros).seconds(), right, "{micros}");
        }
    }

    #[test]
    fn times_need_their_unit() {
        assert_eq!(Micros::parse("200ms"), Some(Micros(200_000)));
        assert_eq!(Micros::parse("1.5s"), Some(Micros(1_500_000)));
        assert_eq!(Micros::parse("2m"), Some(Micros(120_000_000)));
        for wrong in [
            "200",
            "",
            "ms",
            "1.x5s",
            "-1s",
            "5 s",
            "1e3s",
            "99999999999999h",
        ] {
            assert_eq!(Micros::parse(wrong), None, "{wrong}");
        }
    }
}
