//! Reads the ranges of analog inputs.

use super::read::{Reader, Section};
use super::values::as_number;
use super::{Invalid, Range, Standard};
use toml::de::DeValue;

pub(super) const RANGE_KEYS: [&str; 5] = ["signal", "low", "high", "unit", "decimals"];
const SIGNALS: [(&str, Standard); 3] = [
    ("0-10V", Standard::Volts),
    ("0-20mA", Standard::Milliamps),
    ("4-20mA", Standard::LiveMilliamps),
];

impl<'t> Reader<'t> {
    /// The range in a module's or a point's table; `Some(None)` if there is none.
    pub(super) fn range(&mut self, section: &Section<'_, 't>) -> Option<Option<Range>> {
        let Some(value) = section.table.get("range") else {
            return Some(None);
        };
        let path = format!("{}.range", section.path);
        match value.get_ref() {
            DeValue::String(name) if name == "0-10V" => return Some(Some(Range::volts())),
            DeValue::String(name) if name == "0-20mA" => return Some(Some(Range::milliamps())),
            DeValue::Table(table) => {
                let section = Section::of(path.clone(), value, table);
                self.check_keys(&section, &RANGE_KEYS);
                let number = |key| section.table.get(key).and_then(|v| as_number(v.get_ref()));
                let signal = self.one_of(&section, "signal", &SIGNALS)?;
                let unit = self.optional(&section, "unit", Self::string)?;
                let decimals = self.count(&section, "decimals", 2)?;
                if let (Some(low), Some(high), Some(unit)) = (number("low"), number("high"), unit) {
                    return Some(Some(Range {
                        signal,
                        low,
                        high,
                        unit,
                        decimals,
                    }));
                }
            }
            _ => {}
        }
        self.problem(value.span(), &path, Invalid::BadRange);
        None
    }
}
