//! How much history and audit log is kept: the tables `[history]` and `[audit]`.

use super::Invalid;
use super::read::{Reader, Section, Value};
use railbus_store::history::Keep;
use railbus_wire::Micros;

pub(super) const HISTORY_KEYS: [&str; 2] = ["keep", "max_bytes"];
pub(super) const AUDIT_KEYS: [&str; 2] = ["required", "max_bytes"];
/// The shortest retention and the smallest size limit.
const AGE_MIN_MS: i64 = 3_600_000;
const BYTES_MIN: u64 = 10_000_000;
const UNITS: [(&str, u64); 4] = [
    ("TB", 1_000_000_000_000),
    ("GB", 1_000_000_000),
    ("MB", 1_000_000),
    ("kB", 1_000),
];

/// The limits of history and audit log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PastLimits {
    /// The limits of the history.
    pub history: Keep,
    /// Nothing is switched unless its audit entry could be written first.
    pub audit_required: bool,
    /// The size limit of the audit log in bytes; none if it is unlimited.
    pub audit_bytes: Option<u64>,
}

impl<'t> Reader<'t> {
    /// `[history]`.
    pub(super) fn history(&mut self, value: &Value<'t>, past: &mut PastLimits) -> Option<()> {
        let table = self.table(value, "history")?;
        let section = Section::of("history".to_owned(), value, table);
        self.check_keys(&section, &HISTORY_KEYS);
        let age = self.optional(&section, "keep", |reader, value, path| {
            let age = age(&reader.string(value, path)?);
            if age.is_none() {
                reader.problem(value.span(), path, Invalid::WrongType("\"90d\""));
            }
            age
        });
        let bytes = self.max_bytes(&section);
        let standard = Keep::default();
        past.history = Keep {
            age_ms: age?.unwrap_or(standard.age_ms),
            bytes: bytes?.unwrap_or(standard.bytes),
        };
        Some(())
    }

    /// `[audit]`.
    pub(super) fn audit(&mut self, value: &Value<'t>, past: &mut PastLimits) -> Option<()> {
        let table = self.table(value, "audit")?;
        let section = Section::of("audit".to_owned(), value, table);
        self.check_keys(&section, &AUDIT_KEYS);
        past.audit_required = self.boolean(&section, "required")?;
        past.audit_bytes = self.max_bytes(&section)?;
        Some(())
    }

    /// A size limit.
    fn max_bytes(&mut self, section: &Section<'_, 't>) -> Option<Option<u64>> {
        self.optional(section, "max_bytes", |reader, value, path| {
            let bytes = bytes(&reader.string(value, path)?);
            if bytes.is_none() {
                reader.problem(value.span(), path, Invalid::WrongType("\"2GB\""));
            }
            bytes
        })
    }
}

/// `90d`, `12h`, in milliseconds: at least an hour.
fn age(text: &str) -> Option<i64> {
    let millis = match text.strip_suffix('d') {
        Some(days) => days.parse::<u32>().ok().map(i64::from)? * 86_400_000,
        None => i64::try_from(Micros::parse(text)?.0 / 1_000).ok()?,
    };
    (millis >= AGE_MIN_MS).then_some(millis)
}

/// `2GB`, `500MB`: at least ten megabytes.
fn bytes(text: &str) -> Option<u64> {
    let (number, unit) = UNITS
        .iter()
        .find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)))?;
    let bytes = number.trim().parse::<u64>().ok()?.checked_mul(unit)?;
    (bytes >= BYTES_MIN).then_some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read_with_their_units() {
        assert_eq!(age("90d"), Some(90 * 86_400_000));
        assert_eq!(age("12h"), Some(12 * 3_600_000));
        assert_eq!(bytes("2GB"), Some(2_000_000_000));
        assert_eq!(bytes("500 MB"), Some(500_000_000));
        for wrong in ["90", "", "-1d", "59m"] {
            assert_eq!(age(wrong), None, "{wrong}");
        }
        for wrong in ["2", "2gb", "1MB", "-2GB", "99999999999TB"] {
            assert_eq!(bytes(wrong), None, "{wrong}");
        }
    }
}
