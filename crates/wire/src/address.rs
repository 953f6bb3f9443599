//! Small numbers that are range-checked once, when they are created.

use core::fmt;

/// The address byte of a module, 0 to 255 (00 to FF).
///
/// Which addresses a family allows, and which one is the broadcast address (0 in Modbus, 245 on
/// 0x55 boards), is defined by the family; on the wire any byte is possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address(pub u8);

/// Decimal with hexadecimal in parentheses, as `10 (0Ah)`: Modbus manuals use the one, DCON manuals
/// the other.
impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:02X}h)", self.0, self.0)
    }
}

/// The 0-based index of a channel, 0 to 31. Terminals of 0x55 boards, ERC-8 and EMD-2A2Q are
/// labelled from 1; the codecs convert.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Channel(u8);

impl Channel {
    /// The largest index, that of relay 32 of a 0x55 board.
    pub const MAX: Channel = Channel(31);

    /// The channel with this 0-based index; none above 31.
    #[must_use]
    pub const fn new(index: u8) -> Option<Channel> {
        if index <= Self::MAX.0 {
            Some(Channel(index))
        } else {
            None
        }
    }

    /// The 0-based index, 0 to 31.
    #[must_use]
    pub const fn index(self) -> u8 {
        self.0
    }

    /// The mask with only this channel's bit set: bit 0 is index 0.
    #[must_use]
    pub const fn mask(self) -> u32 {
        // The index is never above 31; the mask tells the compiler.
        1 << (self.0 & 31)
    }
}

/// The width of an EDA9060A's pulses in steps of 0.1 s, 1 to 200 (0.1 s to 20 s).
/// One width serves all pulse channels of a module [EDA9060A §3.4].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PulseWidth(u8);

impl PulseWidth {
    /// The factory setting, 1.0 s.
    pub const DEFAULT: PulseWidth = PulseWidth(10);

    /// The width in tenths of a second; none outside 1 to 200.
    #[must_use]
    pub const fn from_tenths(tenths: u8) -> Option<PulseWidth> {
        if tenths >= 1 && tenths <= 200 {
            Some(PulseWidth(tenths))
        } else {
            None
        }
    }

    /// The width in tenths of a second, 1 to 200.
    #[must_use]
    pub const fn tenths(self) -> u8 {
        self.0
    }
}
