//! Integrations that publish the site: the tables `[outlet.<id>]`. What their settings may be is
//! known to the program that runs them; here they are values with names.

use super::Config;
use super::change::Keys;
use super::problem::Invalid;
use super::read::{Reader, Section, Value};
use serde_json::{Number, Value as Json};
use toml::de::{DeTable, DeValue};

/// The most outlets of a site.
pub const OUTLETS_MAX: usize = 32;
/// The key of an outlet with the name of its kind.
pub const OUTLET_TYPE: &str = "type";

pub(super) const OUTLET_KEYS: [&str; 1] = [OUTLET_TYPE];

/// An outlet of the site.
#[derive(Clone, Debug, PartialEq)]
pub struct OutletTable {
    /// The name of its kind.
    pub kind: String,
    /// Its settings, as written.
    pub settings: Keys,
}

impl<'t> Reader<'t> {
    /// `[outlet.<id>]`.
    pub(super) fn outlets(&mut self, root: &DeTable<'t>, config: &mut Config) {
        let Some(value) = root.get("outlet") else {
            return;
        };
        let mut count = 0;
        self.named(value, "outlet", |reader, name, section| {
            count += 1;
            if count > OUTLETS_MAX {
                let kind = Invalid::TooMany(OUTLETS_MAX);
                reader.problem(section.place_of(OUTLET_TYPE), &section.path, kind);
            } else if let Some(outlet) = reader.outlet(&section) {
                config.outlets.insert(name, outlet);
            }
        });
    }

    fn outlet(&mut self, section: &Section<'_, 't>) -> Option<OutletTable> {
        let kind = self.required(section, OUTLET_TYPE, Self::string);
        let mut settings = Keys::new();
        for (key, value) in section.table {
            let key = key.get_ref();
            if key == OUTLET_TYPE {
                continue;
            }
            let path = format!("{}.{key}", section.path);
            settings.insert(key.to_string(), self.setting(value, &path)?);
        }
        Some(OutletTable {
            kind: kind?,
            settings,
        })
    }

    fn setting(&mut self, value: &Value<'t>, path: &str) -> Option<Json> {
        let found = json(value.get_ref());
        if found.is_none() {
            let wanted = Invalid::WrongType("text, number, true / false, or list of them");
            self.problem(value.span(), path, wanted);
        }
        found
    }
}

/// A value as the API has it: a text, a number, a truth, or a list of such.
fn json(value: &DeValue<'_>) -> Option<Json> {
    Some(match value {
        DeValue::String(text) => Json::from(text.as_ref()),
        DeValue::Boolean(truth) => Json::from(*truth),
        DeValue::Integer(number) => {
            let number = i64::from_str_radix(number.as_str(), number.radix()).ok()?;
            Json::from(number)
        }
        DeValue::Float(number) => Number::from_f64(number.as_str().parse().ok()?)?.into(),
        DeValue::Array(items) => {
            let items = items.iter().map(|item| json(item.get_ref()));
            Json::Array(items.collect::<Option<_>>()?)
        }
        DeValue::Datetime(_) | DeValue::Table(_) => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn settings_are_kept_as_written_and_their_places_are_told() {
        let text = "[outlet.plant]\ntype = \"x\"\nport = 0x10\nname = \"a\"\non = true\n\
            share = 0.5\nlist = [\"a\", 1]\n";
        let config = Config::parse(text).unwrap();
        let outlet = &config.outlets["plant"];
        assert_eq!(outlet.kind, "x");
        let wanted = json!({"port": 16, "name": "a", "on": true, "share": 0.5, "list": ["a", 1]});
        assert_eq!(Json::Object(outlet.settings.clone()), wanted);
        let told = |text: &str| {
            let problems = Config::parse(text).unwrap_err();
            let one = &problems[0];
            (one.line, one.column, one.path.clone(), one.kind.code())
        };
        let path = |key: &str| format!("outlet.plant{key}");
        assert_eq!(told("[outlet.plant]\n"), (1, 1, path(""), "E0813"));
        let text = "[outlet.plant]\ntype = \"x\"\nat = 2026-01-01\n";
        assert_eq!(told(text), (3, 6, path(".at"), "E0814"));
        let text = "[outlet.plant]\ntype = \"x\"\ndeep = { a = 1 }\n";
        assert_eq!(told(text).3, "E0814");
        let one = |at| format!("[outlet.o{at}]\ntype = \"x\"\n");
        let many: String = (0..=OUTLETS_MAX).map(one).collect();
        assert_eq!(told(&many).3, "E0868");
    }

    #[test]
    fn a_new_name_of_a_line_or_module_is_its_name_here_too() {
        let text = "[line.main]\nport = \"/dev/ttyS9\"\n[module.pump]\nline = \"main\"\n\
            model = \"erc8\"\naddress = 3\n[outlet.plant]\ntype = \"x\"\nlines = [\"main\"]\n\
            modules = [\"pump\"]\nwrite = [\"pump.k1\"]\nunits = [\"pump = 4\"]\n";
        let text = super::super::change::rename(text, "line", "main", "hall").unwrap();
        let text = super::super::change::rename(&text, "module", "pump", "well").unwrap();
        let settings = &Config::parse(&text).unwrap().outlets["plant"].settings;
        let wanted = json!({"lines": ["hall"], "modules": ["well"], "write": ["well.k1"],
            "units": ["well= 4"]});
        assert_eq!(Json::Object(settings.clone()), wanted);
    }
}
