//! Times and analog ranges as people write them.

use railbus_wire::Micros;

/// Reads a length of time with its unit: `200ms`, `1.5s`, `2m`. A bare number is refused, its
/// unit being anyone's guess.
#[must_use]
pub fn parse_duration(text: &str) -> Option<Micros> {
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

/// What an analog input measures. The module reports the value times 100 [EMD-2A2Q §4.6].
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    /// The value at the low end.
    pub low: f64,
    /// The value at the high end.
    pub high: f64,
    /// The unit.
    pub unit: String,
    /// How many decimals are shown.
    pub decimals: u8,
}

impl Range {
    /// 0 to 10 V, the `-V` type.
    #[must_use]
    pub fn volts() -> Range {
        Range {
            low: 0.0,
            high: 10.0,
            unit: "V".to_owned(),
            decimals: 2,
        }
    }

    /// 0 to 20 mA, the `-I` type.
    #[must_use]
    pub fn milliamps() -> Range {
        Range {
            low: 0.0,
            high: 20.0,
            unit: "mA".to_owned(),
            decimals: 2,
        }
    }

    /// The value that a register of hundredths stands for.
    #[must_use]
    pub fn value(&self, hundredths: u16) -> f64 {
        f64::from(hundredths) / 100.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_need_their_unit() {
        assert_eq!(parse_duration("200ms"), Some(Micros(200_000)));
        assert_eq!(parse_duration("1.5s"), Some(Micros(1_500_000)));
        assert_eq!(parse_duration("2m"), Some(Micros(120_000_000)));
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
            assert_eq!(parse_duration(wrong), None, "{wrong}");
        }
    }
}
