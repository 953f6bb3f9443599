//! Whether a terminal was closed properly by its previous user.
//!
//! A killed process leaves its request on the wire, and the reply reaches the next process that
//! opens the terminal. So while we use a terminal it carries a mark, which is removed at a proper
//! close; if the mark is found, a process was killed. The mark is in the terminal's own modes: two
//! characters for line editing, which raw terminals do not do. The kernel keeps them as long as the
//! terminal exists. Unlike a file the mark can't be missing, belong to another user, be on a full
//! disk, or survive a reboot.

use rustix::termios::{SpecialCodeIndex, Termios};

/// Values these characters do not have on a terminal in interactive use.
const MARK: [(SpecialCodeIndex, u8); 2] = [
    (SpecialCodeIndex::VREPRINT, 0xF5),
    (SpecialCodeIndex::VLNEXT, 0xB7),
];
/// Their usual values: ^R and ^V.
const USUAL: [(SpecialCodeIndex, u8); 2] = [
    (SpecialCodeIndex::VREPRINT, 0x12),
    (SpecialCodeIndex::VLNEXT, 0x16),
];

/// Whether these modes carry the mark.
pub(super) fn is_on(mode: &Termios) -> bool {
    MARK.iter()
        .all(|(index, code)| mode.special_codes[*index] == *code)
}

/// Sets the mark.
pub(super) fn put(mode: &mut Termios) {
    for (index, code) in MARK {
        mode.special_codes[index] = code;
    }
}

/// Removes the mark. The values from before it were known only to the killed process.
pub(super) fn take(mode: &mut Termios) {
    if is_on(mode) {
        for (index, code) in USUAL {
            mode.special_codes[index] = code;
        }
    }
}
