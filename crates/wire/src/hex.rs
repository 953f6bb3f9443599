//! Hexadecimal digits of the ASCII protocol.

/// Set in [`VALUES`] for a lower-case digit.
const LOWER: u8 = 0x10;
/// The entry in [`VALUES`] for a character that is not a digit.
const NONE: u8 = 0x80;

/// The value of each character as a digit.
const VALUES: [u8; 256] = values();

const fn values() -> [u8; 256] {
    let mut values = [NONE; 256];
    let mut character = 0;
    while character < 256 {
        #[allow(
            clippy::indexing_slicing,
            reason = "character < 256, evaluated by the compiler"
        )]
        {
            values[character] = worth(character as u8);
        }
        character += 1;
    }
    values
}

/// The value of a character as a digit, with [`LOWER`], or [`NONE`].
#[cfg_attr(feature = "small", inline(never))]
const fn worth(character: u8) -> u8 {
    match character {
        b'0'..=b'9' => character - b'0',
        b'A'..=b'F' => character - b'A' + 10,
        b'a'..=b'f' => (character - b'a' + 10) | LOWER,
        _ => NONE,
    }
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
            pairs[byte] = pair(byte as u8);
        }
        byte += 1;
    }
    pairs
}

const fn pair(byte: u8) -> [u8; 2] {
    [digit(byte >> 4), digit(byte & 0x0F)]
}

/// Two upper-case digits, the high one first.
#[cfg_attr(feature = "small", inline(never))]
#[cfg_attr(not(feature = "small"), inline)]
pub(crate) const fn digits(byte: u8) -> [u8; 2] {
    if cfg!(feature = "small") {
        return pair(byte);
    }
    #[allow(clippy::indexing_slicing, reason = "a byte always indexes 256 entries")]
    DIGITS[byte as usize]
}

/// One upper-case digit for a number from 0 to 15.
#[inline]
pub(crate) const fn digit(nibble: u8) -> u8 {
    if nibble < 10 {
        b'0' + nibble
    } else {
        b'A' - 10 + nibble
    }
}

/// The byte written as two digits, in upper case or in either case.
#[cfg_attr(feature = "small", inline(never))]
#[cfg_attr(not(feature = "small"), inline)]
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
    if cfg!(feature = "small") {
        return worth(digit);
    }
    #[allow(clippy::indexing_slicing, reason = "a byte always indexes 256 entries")]
    VALUES[digit as usize]
}
