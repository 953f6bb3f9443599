//! The two languages, and which one to use.

use crate::Phrase;
use std::ffi::OsString;
use std::fmt::Display;

/// A supported language; every text exists in all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lang {
    /// English.
    #[default]
    En,
    /// Simplified Chinese.
    Zh,
}

impl Lang {
    /// The language for this process: from `--lang`, or else the first of `RAILBUS_LANG`, `LC_ALL`,
    /// `LC_MESSAGES` and `LANG` that is set.
    pub fn of_process(arguments: &[OsString]) -> Lang {
        Lang::choose(arguments, |name| std::env::var(name).ok())
    }

    fn choose(arguments: &[OsString], variable: impl Fn(&str) -> Option<String>) -> Lang {
        let variables = ["RAILBUS_LANG", "LC_ALL", "LC_MESSAGES", "LANG"];
        let asked = flag(arguments);
        let mut named = variables.into_iter().filter_map(variable);
        let name = asked.or_else(|| named.find(|value| !value.is_empty()));
        match name {
            Some(name) if name.starts_with("zh") => Lang::Zh,
            _ => Lang::En,
        }
    }

    /// A text without placeholders.
    pub fn get(self, text: impl Phrase) -> &'static str {
        self.of(text.in_both())
    }

    /// The one of two texts, English and Chinese, in this language.
    pub const fn of(self, [en, zh]: [&'static str; 2]) -> &'static str {
        match self {
            Lang::En => en,
            Lang::Zh => zh,
        }
    }

    /// The name as used in flags and in the names of points.
    pub const fn name(self) -> &'static str {
        self.of(["en", "zh"])
    }

    /// A text with its `{placeholders}` filled.
    pub fn fill(self, text: impl Phrase, values: &[(&str, &dyn Display)]) -> String {
        let mut filled = self.get(text).to_owned();
        for (name, value) in values {
            filled = filled.replace(&format!("{{{name}}}"), &value.to_string());
        }
        filled
    }
}

/// The value of `--lang`. It is read before anything else is parsed, since the parser's own
/// messages already depend on it.
fn flag(arguments: &[OsString]) -> Option<String> {
    let mut rest = arguments.iter().filter_map(|argument| argument.to_str());
    while let Some(argument) = rest.next() {
        match argument.strip_prefix("--lang") {
            Some("") => return rest.next().map(str::to_owned),
            Some(value) if value.starts_with('=') => return Some(value[1..].to_owned()),
            _ if argument == "--" => return None,
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(arguments: &[&str], variables: &[(&str, &str)]) -> Lang {
        let arguments: Vec<OsString> = arguments.iter().map(OsString::from).collect();
        Lang::choose(&arguments, |name| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn the_flag_goes_before_the_environment() {
        assert_eq!(chosen(&["railbus"], &[]), Lang::En);
        assert_eq!(chosen(&["railbus"], &[("LANG", "zh_CN.UTF-8")]), Lang::Zh);
        let both = [("LANG", "zh_CN.UTF-8"), ("LC_ALL", "C")];
        assert_eq!(chosen(&["railbus"], &both), Lang::En);
        assert_eq!(chosen(&["railbus", "--lang", "zh"], &both), Lang::Zh);
        assert_eq!(chosen(&["railbus", "sim", "--lang=zh"], &[]), Lang::Zh);
        assert_eq!(chosen(&["railbus", "--", "--lang=zh"], &[]), Lang::En);
    }

    #[test]
    fn placeholders_are_filled() {
        struct NoSuchCommand;
        impl Phrase for NoSuchCommand {
            fn in_both(self) -> [&'static str; 2] {
                ["no command \"{name}\"", "没有命令 \"{name}\""]
            }
        }
        let filled = Lang::Zh.fill(NoSuchCommand, &[("name", &"smi")]);
        assert_eq!(filled, "没有命令 \"smi\"");
    }
}
