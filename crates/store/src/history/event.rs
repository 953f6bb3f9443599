//! What happened at a site, apart from the values of its points.

use std::time::SystemTime;

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Its number, a ULID; empty until it is told.
    pub id: String,
    /// When.
    pub at: SystemTime,
    /// What kind of thing it is.
    pub kind: EventKind,
    /// How much it matters.
    pub severity: Severity,
    /// The module it is about.
    pub module: Option<String>,
    /// The label of the point it is about.
    pub point: Option<String>,
    /// The line it is about.
    pub line: Option<String>,
    /// Who did it.
    pub who: Option<String>,
    /// From where.
    pub via: Option<String>,
    /// What was done: `do0=on`.
    pub what: Option<String>,
    /// How it was before.
    pub before: Option<String>,
    /// How it is after it.
    pub after: Option<String>,
    /// How it ended.
    pub end: Option<String>,
    /// What happened, as programs read it: `module_offline`.
    pub code: Option<String>,
    /// What else is known, in the words of whoever said it.
    pub text: Option<String>,
}

impl Event {
    /// Something that happened now.
    #[must_use]
    pub fn new(kind: EventKind, severity: Severity, code: &str) -> Event {
        Event {
            id: String::new(),
            at: SystemTime::now(),
            kind,
            severity,
            module: None,
            point: None,
            line: None,
            who: None,
            via: None,
            what: None,
            before: None,
            after: None,
            end: None,
            code: Some(code.to_owned()),
            text: None,
        }
    }

    /// Of this module.
    #[must_use]
    pub fn module(mut self, module: &str) -> Event {
        self.module = Some(module.to_owned());
        self
    }

    /// Of the point with this label.
    #[must_use]
    pub fn point(mut self, label: &str) -> Event {
        self.point = Some(label.to_owned());
        self
    }

    /// Of this line.
    #[must_use]
    pub fn line(mut self, line: &str) -> Event {
        self.line = Some(line.to_owned());
        self
    }

    /// Done by somebody.
    #[must_use]
    pub fn by(mut self, origin: &crate::audit::Origin) -> Event {
        self.who = Some(origin.who.clone());
        self.via = Some(origin.via.clone());
        self
    }

    /// What was done.
    #[must_use]
    pub fn what(mut self, what: &str) -> Event {
        self.what = Some(what.to_owned());
        self
    }

    /// What else is known.
    #[must_use]
    pub fn text(mut self, text: impl Into<String>) -> Event {
        self.text = Some(text.into());
        self
    }
}

macro_rules! names {
    ($(#[$doc:meta])* $name:ident { $($(#[$of:meta])* $variant:ident = $text:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum $name {
            $($(#[$of])* $variant,)*
        }

        impl $name {
            /// All of them, in their order.
            pub const ALL: &[$name] = &[$($name::$variant),*];

            /// The name in JSON.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $($name::$variant => $text,)*
                }
            }

            /// The one of this name.
            #[must_use]
            pub fn from_name(name: &str) -> Option<$name> {
                match name {
                    $($text => Some($name::$variant),)*
                    _ => None,
                }
            }
        }
    };
}

names! {
    /// The kinds of events.
    EventKind {
        /// An output was written.
        Write = "write",
        /// A module is heard, or no longer.
        Module = "module",
        /// A line's port was opened, or lost.
        Line = "line",
        /// The configuration changed.
        Config = "config",
        /// Somebody came or went, or tried to.
        Login = "login",
        /// A value is where it should not be.
        Alarm = "alarm",
        /// A rule acted.
        Rule = "rule",
        /// The program itself.
        System = "system",
    }
}

names! {
    /// How much an event matters.
    Severity {
        /// Good to know.
        Info = "info",
        /// Somebody should look.
        Warning = "warning",
        /// Something does not work.
        Error = "error",
    }
}

/// That somebody has seen an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ack {
    /// Who.
    pub who: String,
    /// When, in milliseconds since 1970.
    pub at_ms: i64,
    /// What that one says of it.
    pub comment: String,
}
