//! Whether a terminal was given up in order.
//!
//! Who is killed leaves his request on the wire, and its reply meets whoever opens the terminal
//! next. So while a terminal is ours it bears a mark, which is taken away at an orderly end; where
//! one is found, somebody was killed. The mark stands in the terminal's own modes: two characters
//! that are for line editing, which raw terminals do not do. The kernel keeps them as long as the
//! terminal is there. So there is no file that could be missing, be somebody else's, lie on a full
//! disk, or tell after a restart of the machine of what was before it.

use rustix::termios::{SpecialCodeIndex, Termios};

/// What these characters are on no terminal that somebody types at.
const MARK: [(SpecialCodeIndex, u8); 2] = [
    (SpecialCodeIndex::VREPRINT, 0xF5),
    (SpecialCodeIndex::VLNEXT, 0xB7),
];
/// What they usually are: ^R and ^V.
const USUAL: [(SpecialCodeIndex, u8); 2] = [
    (SpecialCodeIndex::VREPRINT, 0x12),
    (SpecialCodeIndex::VLNEXT, 0x16),
];

/// Whether these modes bear the mark.
pub(super) fn is_on(mode: &Termios) -> bool {
    MARK.iter()
        .all(|(index, code)| mode.special_codes[*index] == *code)
}

/// Marks them.
pub(super) fn put(mode: &mut Termios) {
    for (index, code) in MARK {
        mode.special_codes[index] = code;
    }
}

/// Takes the mark away. What stood in its place is known only to him who was killed.
pub(super) fn take(mode: &mut Termios) {
    if is_on(mode) {
        for (index, code) in USUAL {
            mode.special_codes[index] = code;
        }
    }
}
