//! Analog ranges as they are written.

/// The range of an analog input. The module reports the value times 100 [EMD-2A2Q §4.6].
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    /// The signal at the terminals, where it differs from the value: that of a sensor. Without one,
    /// the value is what the module reports.
    pub signal: Option<Standard>,
    /// The value at the low end.
    pub low: f64,
    /// The value at the high end.
    pub high: f64,
    /// The unit.
    pub unit: String,
    /// How many decimals are shown.
    pub decimals: u8,
}

/// A sensor's signal, from the low end to the high end of its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standard {
    /// 0 to 10 V.
    Volts,
    /// 0 to 20 mA.
    Milliamps,
    /// 4 to 20 mA: a broken wire reads far below the low end.
    LiveMilliamps,
}

impl Standard {
    /// Its two ends, in V or mA.
    const fn ends(self) -> (f64, f64) {
        match self {
            Standard::Volts => (0.0, 10.0),
            Standard::Milliamps => (0.0, 20.0),
            Standard::LiveMilliamps => (4.0, 20.0),
        }
    }
}

impl Range {
    /// 0 to 10 V, the `-V` type.
    #[must_use]
    pub fn volts() -> Range {
        Range {
            signal: None,
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
            signal: None,
            low: 0.0,
            high: 20.0,
            unit: "mA".to_owned(),
            decimals: 2,
        }
    }

    /// The value that a register of hundredths stands for.
    #[must_use]
    pub fn value(&self, hundredths: u16) -> f64 {
        let at_terminal = f64::from(hundredths) / 100.0;
        let Some(signal) = self.signal else {
            return at_terminal;
        };
        let (from, to) = signal.ends();
        self.low + (at_terminal - from) / (to - from) * (self.high - self.low)
    }

    /// The signal at the terminals.
    #[must_use]
    pub fn at_terminal(&self) -> Range {
        match self.signal {
            None => self.clone(),
            Some(Standard::Volts) => Range::volts(),
            Some(Standard::Milliamps | Standard::LiveMilliamps) => Range::milliamps(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_told_as_what_it_means() {
        let bar = |signal| Range {
            signal,
            low: 0.0,
            high: 16.0,
            unit: "bar".to_owned(),
            decimals: 1,
        };
        let means = |signal, hundredths| bar(Some(signal)).value(hundredths);
        assert_eq!(means(Standard::Volts, 500), 8.0);
        assert_eq!(means(Standard::Milliamps, 500), 4.0);
        assert_eq!(means(Standard::LiveMilliamps, 400), 0.0);
        assert_eq!(means(Standard::LiveMilliamps, 2_000), 16.0);
        assert_eq!(means(Standard::LiveMilliamps, 0), -4.0, "a broken wire");
        assert_eq!(bar(None).value(871), 8.71);
        let other_way = Range {
            low: 100.0,
            high: -20.0,
            ..bar(Some(Standard::Volts))
        };
        assert_eq!(other_way.value(1_000), -20.0);
        assert_eq!(bar(Some(Standard::LiveMilliamps)).at_terminal().unit, "mA");
    }
}
