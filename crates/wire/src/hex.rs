//! Hexadecimal digits of the ASCII protocol.

/// Set in [`VALUES`] for a digit in lower case.
const LOWER: u8 = 0x10;
/// Stands in [`VALUES`] for what is no digit.
const NONE: u8 = 0x80;

/// What each character is worth as a digit.
const VALUES: [u8; 256] = values();

const fn values() -> [u8; 256] {
    let mut values = [NONE; 256];
    let mut nibble = 0;
    while nibble < 16 {
        let upper = digit(nibble);
        #[allow(clippy::indexing_slicing, reason = "a byte always indexes 256 entries")]
        {
            values[upper.to_ascii_lowercase() as usize] = nibble | LOWER;
            values[upper as usize] = nibble;
        }
        nibble += 1;
    }
    values
}

/// Two upper-case digits for each byte, the high one first.
const DIGITS: [[u8; 2]; 256] = pairs();

const fn pairs() -> [[u8; 2]; 256] {
    let mut pairs = [[0; 2]; 256];
    let mut byte = 0;
    while byte < 256 {
        #[allow(
            clippy::indexing_slicing,
            reason = "byte < 256, evaluated by the compiler"
        )]
        {
            pairs[byte] = [digit(byte as u8 >> 4), digit(byte as u8 & 0x0F)];
        }
        byte += 1;
    }
    pairs
}

/// Two upper-case digits, the high one first.
#[inline]
pub(crate) const fn digits(byte: u8) -> [u8; 2] {
    #[allow(clippy::indexing_slicing, reason = "a byte always indexes 256 entries")]
    DIGITS[byte as usize]
}

/// One upper-case digit of a number 0 to 15.
#[inline]
pub(crate) const fn digit(nibble: u8) -> u8 {
    if nibble < 10 {
        b'0' + nibble
    } else {
        b'A' - 10 + nibble
    }
}

/// The byte that two digits spell, in upper case or in either.
#[inline]
pub(crate) const fn byte(high: u8, low: u8, lower_case: bool) -> Option<u8> {
    let (high, low) = (value(high), value(low));
    let refused = if lower_case { NONE } else { NONE | LOWER };
    if (high | low) & refused == 0 {
        Some(high << 4 | low & 0x0F)
    } else {
        None
    }
}

const fn value(digit: u8) -> u8 {
    #[allow(clippy::indexing_slicing, reason = "a byte always indexes 256 entries")]
    VALUES[digit as usize]
}
