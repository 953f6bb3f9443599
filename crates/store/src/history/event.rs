//! What happened at a site, apart from point values.

use std::time::SystemTime;

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Its ID, a ULID; empty until it is published.
    pub id: String,
    /// When.
    pub at: SystemTime,
    /// Its kind.
    pub kind: EventKind,
    /// Its severity.
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
    /// The state before.
    pub after: Option<String>,
    /// The state after it.
    pub end: Option<String>,
    /// The result.
    pub code: Option<String>,
    /// Other information, in the words of its source.
    pub text: Option<String>,
}

impl Event {
    /// An event that happens now.
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

    /// By whom.
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

    /// Other information.
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

            /// The one with this name.
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
        /// A module came online or went offline.
        Module = "module",
        /// A line's port was opened, or lost.
        Line = "line",
        /// The configuration changed.
        Config = "config",
        /// Somebody signed in or out, or tried to.
        Login = "login",
        /// A value is out of its limits.
        Alarm = "alarm",
        /// A rule was triggered.
        Rule = "rule",
        /// The program itself.
        System = "system",
    }
}

names! {
    /// The severity of an event.
    Severity {
        /// For information.
        Info = "info",
        /// Needs attention.
        Warning = "warning",
        /// Something does not work.
        Error = "error",
    }
}

/// The acknowledgement of an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ack {
    /// Who.
    pub who: String,
    /// When, in milliseconds since 1970.
    pub at_ms: i64,
    /// The comment.
    pub comment: String,
}
