//! Output for people and programs.

pub mod colour;
pub mod csv;
pub mod out;
pub mod records;
pub mod table;
pub mod values;
pub mod wire_words;

use std::ffi::OsString;

/// The output format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// For people.
    #[default]
    Table,
    /// One JSON document.
    Json,
    /// One JSON document per line.
    Ndjson,
    /// Comma separated values with a header.
    Csv,
    /// The bare value.
    Value,
}

impl Format {
    /// The names in flags.
    pub const NAMES: [&str; 5] = ["table", "json", "ndjson", "csv", "value"];

    /// The format with that name.
    pub fn from_name(name: &str) -> Option<Format> {
        Some(match name {
            "table" => Format::Table,
            "json" => Format::Json,
            "ndjson" => Format::Ndjson,
            "csv" => Format::Csv,
            "value" => Format::Value,
            _ => return None,
        })
    }

    /// Whether errors are printed as JSON, too.
    pub const fn is_json(self) -> bool {
        matches!(self, Format::Json | Format::Ndjson)
    }

    /// The format given by the arguments, or else by the environment. It is read before anything
    /// else is parsed, since the parser's own messages already depend on it.
    pub fn of_process(arguments: &[OsString]) -> Format {
        let asked = flag(arguments, "--output", Some("-o"), Format::from_name);
        let variable = || std::env::var("RAILBUS_OUTPUT").ok();
        let otherwise = || variable().and_then(|name| Format::from_name(&name));
        asked.or_else(otherwise).unwrap_or_default()
    }
}

/// The first valid value of a flag, before the arguments are parsed.
pub fn flag<T>(
    arguments: &[OsString],
    long: &str,
    short: Option<&str>,
    read: impl Fn(&str) -> Option<T>,
) -> Option<T> {
    let mut rest = arguments.iter().filter_map(|argument| argument.to_str());
    while let Some(argument) = rest.next() {
        if argument == "--" {
            break;
        }
        let value = if argument == long || Some(argument) == short {
            rest.next()
        } else {
            let behind = |name: &str| argument.strip_prefix(name);
            behind(long).or_else(|| short.and_then(behind))
        };
        let value = value.map(|value| value.trim_start_matches('='));
        if let Some(found) = value.and_then(&read) {
            return Some(found);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_form_is_known_before_the_arguments_are_parsed() {
        let of = |line: &str| {
            let arguments: Vec<OsString> = line.split(' ').map(OsString::from).collect();
            Format::of_process(&arguments)
        };
        for line in [
            "x ls -o json",
            "x -ojson ls",
            "x --output=json",
            "x -o=json",
        ] {
            assert_eq!(of(line), Format::Json, "{line}");
        }
        assert_eq!(of("x ls -- -o json"), Format::Table);
        assert_eq!(of("x ls -o"), Format::Table);
        for name in Format::NAMES {
            assert!(Format::from_name(name).is_some(), "{name}");
        }
    }
}
