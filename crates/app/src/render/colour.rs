//! Colour, where a terminal supports it. It never carries information on its own: there are always
//! words, too.

use std::ffi::OsString;
use std::io::IsTerminal;

/// When to use colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Colour {
    /// On terminals, unless the environment forbids it.
    #[default]
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

impl Colour {
    /// The names in flags.
    pub const NAMES: [&str; 3] = ["auto", "always", "never"];

    /// The one with this name.
    pub fn from_name(name: &str) -> Option<Colour> {
        Some(match name {
            "auto" => Colour::Auto,
            "always" => Colour::Always,
            "never" => Colour::Never,
            _ => return None,
        })
    }

    /// The choice given by the arguments, or else by the environment, before anything is parsed.
    pub fn of_process(arguments: &[OsString]) -> Colour {
        let variable = || std::env::var("RAILBUS_COLOR").ok();
        super::flag(arguments, "--color", None, Colour::from_name)
            .or_else(|| variable().and_then(|name| Colour::from_name(&name)))
            .unwrap_or_default()
    }

    /// Whether a stream is coloured, according to the environment (no-color.org and
    /// bixense.com/clicolors).
    fn shows(self, terminal: bool, variable: impl Fn(&str) -> Option<String>) -> bool {
        let set = |name: &str| variable(name).filter(|value| !value.is_empty());
        match self {
            Colour::Always => true,
            Colour::Never => false,
            Colour::Auto if set("NO_COLOR").is_some() => false,
            Colour::Auto if set("CLICOLOR_FORCE").is_some_and(|force| force != "0") => true,
            Colour::Auto => terminal && set("TERM").is_none_or(|kind| kind != "dumb"),
        }
    }
}

/// The colouring of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paint {
    /// None: a file, or a terminal without colours.
    Plain,
    /// With escape sequences.
    Coloured,
}

impl Paint {
    /// The colouring of this stream.
    pub fn of(colour: Colour, stream: &impl IsTerminal) -> Paint {
        match colour.shows(stream.is_terminal(), |name| std::env::var(name).ok()) {
            true => Paint::Coloured,
            false => Paint::Plain,
        }
    }

    /// An error.
    pub fn bad(self, text: &str) -> String {
        self.with("1;31", text)
    }

    /// A warning.
    pub fn doubtful(self, text: &str) -> String {
        self.with("33", text)
    }

    /// All is well.
    pub fn good(self, text: &str) -> String {
        self.with("32", text)
    }

    fn with(self, style: &str, text: &str) -> String {
        match self {
            Paint::Plain => text.to_owned(),
            Paint::Coloured => format!("\x1b[{style}m{text}\x1b[0m"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flag_goes_before_the_environment_and_that_before_the_terminal() {
        let shows = |colour: Colour, terminal: bool, variables: &[(&str, &str)]| {
            colour.shows(terminal, |name| {
                let found = variables.iter().find(|(known, _)| *known == name);
                found.map(|(_, value)| (*value).to_owned())
            })
        };
        assert!(shows(Colour::Auto, true, &[]));
        assert!(!shows(Colour::Auto, false, &[]));
        assert!(!shows(Colour::Auto, true, &[("NO_COLOR", "1")]));
        assert!(shows(Colour::Auto, true, &[("NO_COLOR", "")]));
        assert!(!shows(Colour::Auto, true, &[("TERM", "dumb")]));
        assert!(shows(Colour::Auto, false, &[("CLICOLOR_FORCE", "1")]));
        assert!(!shows(Colour::Auto, false, &[("CLICOLOR_FORCE", "0")]));
        let both = [("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")];
        assert!(!shows(Colour::Auto, true, &both));
        assert!(shows(Colour::Always, false, &both));
        assert!(!shows(Colour::Never, true, &[("CLICOLOR_FORCE", "1")]));
    }

    #[test]
    fn paint_only_adds() {
        assert_eq!(Paint::Plain.bad("x"), "x");
        assert_eq!(Paint::Coloured.bad("x"), "\x1b[1;31mx\x1b[0m");
    }
}
