//! Names and versions, stored inline.

use crate::Malformed;

/// 1 to 16 printable characters: a module's name or firmware version.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Text {
    len: u8,
    characters: [u8; Text::MAX],
}

impl Text {
    /// The most characters.
    pub const MAX: usize = 16;

    /// The text of these characters; printable ASCII only.
    #[must_use]
    pub fn new(characters: &[u8]) -> Option<Text> {
        let printable = characters.iter().all(|c| (0x20..0x7F).contains(c));
        if characters.is_empty() || !printable {
            return None;
        }
        let mut text = Text {
            len: characters.len() as u8,
            characters: [0; Text::MAX],
        };
        text.characters
            .get_mut(..characters.len())?
            .copy_from_slice(characters);
        Some(text)
    }

    /// The characters.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.characters
            .get(..usize::from(self.len))
            .unwrap_or_default()
    }

    /// The characters as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        core::str::from_utf8(self.bytes()).unwrap_or_default()
    }

    pub(super) fn parse(characters: &[u8]) -> Result<Text, Malformed> {
        Text::new(characters).ok_or(Malformed::Syntax)
    }
}

impl core::fmt::Debug for Text {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.as_str().fmt(f)
    }
}
