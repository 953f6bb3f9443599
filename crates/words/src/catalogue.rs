//! Catalogues: every user-visible text, in both languages side by side.
//!
//! A key that lacks one of the languages does not compile, and an unused one does not pass the
//! lints, unless its catalogue is `pub`; a test checks that the placeholders agree.

use std::fmt::Debug;

/// A text in both languages.
pub trait Phrase {
    /// The English and the Chinese text.
    fn in_both(self) -> [&'static str; 2];
}

/// A catalogue: an enum with the given name, one text each; private to its crate, unless it is
/// `pub`.
#[macro_export]
macro_rules! texts {
    ($vis:vis $keys:ident; $($name:ident { en: $en:literal, zh: $zh:literal $(,)? })*) => {
        /// A text by its key.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        $vis enum $keys { $(#[doc = $en] $name),* }

        impl $crate::Phrase for $keys {
            fn in_both(self) -> [&'static str; 2] {
                match self { $($keys::$name => [$en, $zh]),* }
            }
        }

        #[cfg(test)]
        mod catalogue {
            #[test]
            fn both_languages_say_the_same() {
                $crate::catalogue::check(&[$(super::$keys::$name),*]);
            }
        }
    };
}

/// A text in both languages right where it is used, with `{values}` in scope: for the many short
/// meanings of frames, which are used only once.
#[macro_export]
macro_rules! say {
    ($lang:expr, $en:literal, $zh:literal) => {
        match $lang {
            $crate::Lang::En => format!($en),
            $crate::Lang::Zh => format!($zh),
        }
    };
}

/// The test of each catalogue: both languages are present, with the same placeholders, and the
/// Chinese is Chinese.
///
/// # Panics
/// If not.
/// Where they do not.
pub fn check(texts: &[impl Phrase + Copy + Debug]) {
    for text in texts {
        let [en, zh] = text.in_both();
        assert!(!en.is_empty() && !zh.is_empty(), "{text:?}");
        assert_eq!(placeholders(en), placeholders(zh), "{text:?}");
        let commands = zh.starts_with("  railbus ");
        assert!(commands || !zh.is_ascii(), "{text:?}: {zh}");
    }
}

fn placeholders(text: &str) -> Vec<&str> {
    let mut found: Vec<&str> = text
        .split('{')
        .skip(1)
        .map(|rest| rest.split('}').next().unwrap_or_default())
        .collect();
    found.sort_unstable();
    found
}
