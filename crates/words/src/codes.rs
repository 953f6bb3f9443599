//! Every failure by its code, for errors and `railbus explain`. The tables are below, grouped by
//! the exit codes of their failures.

mod config;
mod ends;
mod module;
mod own;
mod port;

use crate::Lang;
use std::fmt;

/// All tables, in order of number.
const TABLES: [&[Code]; 5] = [
    own::TABLE,
    module::TABLE,
    port::TABLE,
    config::TABLE,
    ends::TABLE,
];

/// What corrupts replies.
pub(crate) const GARBLED: [&str; 2] = [
    "two modules on one address · other baud or parity · noise, bias, termination or a bad cable · \
     gaps between the bytes",
    "两个模块地址相同 · 波特率或校验位不同 · 干扰、偏置、终端电阻或线缆问题 · 字节之间有间隔",
];

/// The explanation of a failure, in both languages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page {
    /// What happened.
    pub(crate) title: [&'static str; 2],
    /// Its usual causes.
    pub(crate) likely: [&'static str; 2],
    /// What to do next.
    pub(crate) next: [&'static str; 2],
}

impl Page {
    /// What happened.
    #[must_use]
    pub const fn title(&self, lang: Lang) -> &'static str {
        lang.of(self.title)
    }

    /// Its usual causes.
    #[must_use]
    pub const fn likely(&self, lang: Lang) -> &'static str {
        lang.of(self.likely)
    }

    /// What to do next.
    #[must_use]
    pub const fn next(&self, lang: Lang) -> &'static str {
        lang.of(self.next)
    }
}

/// A kind of failure.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Code(&'static Row);

/// A row of a table. A failure refers to it by its code, so failures stay small.
#[derive(PartialEq, Eq)]
struct Row {
    /// All but the last two digits are its exit code.
    name: &'static str,
    page: Page,
}

impl fmt::Debug for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.name)
    }
}

/// A table: a constant for each of its failures, and the list of them.
macro_rules! codes {
    ($($name:ident = $number:literal {
        title: $title:expr, likely: $likely:expr, next: $next:expr $(,)?
    })*) => {
        #[allow(non_upper_case_globals, reason = "they read as the variants of one enum")]
        impl Code {
            $(
                #[doc = $number]
                pub const $name: Code = Code(&super::Row {
                    name: $number,
                    page: super::Page { title: $title, likely: $likely, next: $next },
                });
            )*
        }

        pub(super) const TABLE: &[Code] = &[$(Code::$name),*];
    };
}
use codes;

impl Code {
    /// All of them, in order of number.
    pub fn all() -> impl Iterator<Item = Code> {
        TABLES.into_iter().flatten().copied()
    }

    /// The code with this name.
    pub fn from_name(name: &str) -> Option<Code> {
        // Its former name.
        if name.eq_ignore_ascii_case("E13001") {
            return Some(Code::Interrupted);
        }
        Code::all().find(|code| code.0.name.eq_ignore_ascii_case(name))
    }

    /// As shown to people and programs, such as `E0301`.
    pub const fn name(self) -> &'static str {
        self.0.name
    }

    /// Its explanation.
    pub const fn page(self) -> Page {
        self.0.page
    }

    /// Its exit code.
    pub fn exit(self) -> u8 {
        // The exit code for Ctrl-C is the shells', with three digits.
        if self == Code::Interrupted {
            return 130;
        }
        let digits = self.0.name.trim_start_matches('E');
        let number: u16 = digits.parse().unwrap_or(100);
        u8::try_from(number / 100).unwrap_or(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rise_and_lead_to_known_exit_codes() {
        let exits: Vec<u8> = Code::all().map(Code::exit).collect();
        assert!(exits.is_sorted());
        for exit in exits {
            let known = crate::EXITS.iter().any(|e| e.code == exit);
            assert!(known, "{exit}");
        }
        let names: Vec<_> = Code::all()
            .map(|code| (code.name().len(), code.name()))
            .collect();
        assert!(names.is_sorted_by(|a, b| a < b), "{names:?}");
    }

    #[test]
    fn every_page_is_written_in_both_languages() {
        for code in Code::all() {
            let page = code.page();
            for [en, zh] in [page.title, page.likely, page.next] {
                assert!(!en.is_empty() && en.len() < 200, "{code:?}");
                assert!(!zh.is_empty(), "{code:?}");
            }
            assert!(
                !page.title[1].is_ascii() && !page.likely[1].is_ascii(),
                "{code:?}"
            );
        }
    }

    /// Scheduled actions, accounts and the audit log are in the state folder.
    #[test]
    fn nobody_is_sent_to_another_folder_of_the_state() {
        let sends = |code: &Code| {
            let next = code.page().next.join("");
            next.contains("RAILBUS_STATE") || next.contains("--state DIR")
        };
        let sent: Vec<Code> = Code::all().filter(sends).collect();
        assert!(sent.is_empty(), "{sent:?}");
    }

    #[test]
    fn a_code_is_found_by_its_name() {
        assert_eq!(Code::from_name("e0301"), Some(Code::NoReply));
        assert_eq!(Code::from_name("E1300"), Some(Code::Interrupted));
        assert_eq!(Code::from_name("E13001"), Some(Code::Interrupted));
        assert!(Code::all().all(|code| code.name().len() == 5));
        assert_eq!(Code::from_name("E9999"), None);
        assert_eq!(Code::Interrupted.exit(), 130);
        assert_eq!(Code::NoReply.exit(), 3);
    }
}
