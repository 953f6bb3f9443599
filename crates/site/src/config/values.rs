//! Values of keys: what they must be, and what is wrong with them.

use super::Invalid;
use super::read::{Reader, Section, Value};
use railbus_wire::Micros;
use toml::de::DeValue;

impl<'t> Reader<'t> {
    pub(super) fn required<T>(
        &mut self,
        section: &Section<'_, 't>,
        key: &'static str,
        read: impl FnOnce(&mut Self, &Value<'t>, &str) -> Option<T>,
    ) -> Option<T> {
        match section.table.get(key) {
            Some(value) => read(self, value, &format!("{}.{key}", section.path)),
            None => {
                self.problem(
                    section.span.clone(),
                    &section.path,
                    Invalid::MissingKey(key),
                );
                None
            }
        }
    }

    /// `None` if it is invalid, `Some(None)` if it is missing.
    pub(super) fn optional<T>(
        &mut self,
        section: &Section<'_, 't>,
        key: &str,
        read: impl FnOnce(&mut Self, &Value<'t>, &str) -> Option<T>,
    ) -> Option<Option<T>> {
        match section.table.get(key) {
            Some(value) => read(self, value, &format!("{}.{key}", section.path)).map(Some),
            None => Some(None),
        }
    }

    pub(super) fn one_of<T: Copy>(
        &mut self,
        section: &Section<'_, 't>,
        key: &str,
        choices: &[(&'static str, T)],
    ) -> Option<Option<T>> {
        self.optional(section, key, |reader, value, path| {
            let text = value.get_ref().as_str();
            let found = choices.iter().find(|(name, _)| text == Some(*name));
            if found.is_none() {
                let names = choices.iter().map(|(name, _)| *name).collect();
                reader.problem(value.span(), path, Invalid::NotOneOf(names));
            }
            found.map(|(_, choice)| *choice)
        })
    }

    pub(super) fn boolean(&mut self, section: &Section<'_, 't>, key: &str) -> Option<bool> {
        let found = self.optional(section, key, Self::truth)?;
        Some(found.unwrap_or(false))
    }

    pub(super) fn truth(&mut self, value: &Value<'t>, path: &str) -> Option<bool> {
        let found = value.get_ref().as_bool();
        if found.is_none() {
            self.problem(value.span(), path, Invalid::WrongType("true / false"));
        }
        found
    }

    pub(super) fn count(
        &mut self,
        section: &Section<'_, 't>,
        key: &str,
        standard: u8,
    ) -> Option<u8> {
        let found = self.optional(section, key, |reader, value, path| {
            reader.integer_in(value, path, 0, 32)
        })?;
        Some(found.map_or(standard, |count| count as u8))
    }

    pub(super) fn duration(
        &mut self,
        section: &Section<'_, 't>,
        key: &str,
    ) -> Option<Option<Micros>> {
        self.optional(section, key, |reader, value, path| {
            let found = value.get_ref().as_str().and_then(Micros::parse);
            if found.is_none() {
                reader.problem(value.span(), path, Invalid::BadDuration);
            }
            found
        })
    }

    pub(super) fn string(&mut self, value: &Value<'t>, path: &str) -> Option<String> {
        let found = value.get_ref().as_str().map(str::to_owned);
        if found.is_none() {
            self.problem(value.span(), path, Invalid::WrongType("text in quotes"));
        }
        found
    }

    pub(super) fn number(&mut self, value: &Value<'t>, path: &str) -> Option<f64> {
        let found = as_number(value.get_ref());
        if found.is_none() {
            self.problem(value.span(), path, Invalid::WrongType("number"));
        }
        found
    }

    pub(super) fn integer(&mut self, value: &Value<'t>, path: &str) -> Option<i64> {
        let number = value.get_ref().as_integer();
        let found = number.and_then(|n| i64::from_str_radix(n.as_str(), n.radix()).ok());
        if found.is_none() {
            self.problem(value.span(), path, Invalid::WrongType("whole number"));
        }
        found
    }

    pub(super) fn integer_in(
        &mut self,
        value: &Value<'t>,
        path: &str,
        low: i64,
        high: i64,
    ) -> Option<i64> {
        let number = self.integer(value, path)?;
        if (low..=high).contains(&number) {
            return Some(number);
        }
        self.problem(value.span(), path, Invalid::OutOfRange(low, high));
        None
    }
}

pub(super) fn as_number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(number) => number.as_str().parse().ok(),
        DeValue::Float(number) => number.as_str().parse().ok(),
        _ => None,
    }
}
