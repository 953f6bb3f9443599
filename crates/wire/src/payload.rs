//! Runs of coils and registers in Modbus encoding.

use core::fmt;

/// The packed bytes: borrowed, or stored inline if there are few. Commands to modules need only a
/// few, so that such a request borrows nothing.
#[derive(Clone, Copy)]
enum Store<'a> {
    Here([u8; 4]),
    There(&'a [u8]),
}

impl Store<'_> {
    #[inline]
    fn bytes(&self, len: usize) -> &[u8] {
        let all: &[u8] = match self {
            Store::Here(bytes) => bytes,
            Store::There(bytes) => bytes,
        };
        all.get(..len).unwrap_or(all)
    }
}

/// Up to 2000 coils or inputs. Bit 0 of the first byte is the first one.
#[derive(Clone, Copy)]
pub struct Bits<'a> {
    count: u16,
    store: Store<'a>,
}

impl<'a> Bits<'a> {
    /// The most in one Modbus reply.
    pub const MAX: u16 = 2000;

    /// The lowest `count` bits of a mask, bit 0 first; none outside 1 to 32.
    #[must_use]
    #[inline]
    pub const fn from_mask(mask: u32, count: u16) -> Option<Bits<'static>> {
        match count {
            1..32 => {
                let mask = mask & ((1 << count) - 1);
                Some(Bits {
                    count,
                    store: Store::Here(mask.to_le_bytes()),
                })
            }
            32 => Some(Bits {
                count,
                store: Store::Here(mask.to_le_bytes()),
            }),
            _ => None,
        }
    }

    /// `count` bits packed in exactly as many bytes as they need; none outside 1 to 2000.
    #[must_use]
    #[inline]
    pub const fn from_packed(bytes: &'a [u8], count: u16) -> Option<Bits<'a>> {
        let fits = bytes.len() == count.div_ceil(8) as usize;
        if fits && count >= 1 && count <= Self::MAX {
            Some(Bits {
                count,
                store: Store::There(bytes),
            })
        } else {
            None
        }
    }

    /// The number of bits.
    #[must_use]
    #[allow(clippy::len_without_is_empty, reason = "there is always at least one")]
    #[inline]
    pub const fn len(&self) -> u16 {
        self.count
    }

    /// The packed bytes. Bits above the last one are as received.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        self.store.bytes(usize::from(self.count.div_ceil(8)))
    }

    /// The bit with this 0-based index.
    #[must_use]
    pub fn get(&self, index: u16) -> Option<bool> {
        if index >= self.count {
            return None;
        }
        self.bytes()
            .get(usize::from(index / 8))
            .map(|byte| byte >> (index % 8) & 1 == 1)
    }

    /// All bits in order.
    pub fn iter(&self) -> impl Iterator<Item = bool> {
        (0..self.count).map_while(|index| self.get(index))
    }

    /// The first 32 bits as a mask; bits that were not sent are 0.
    #[must_use]
    #[inline]
    pub fn to_mask(&self) -> u32 {
        let mut mask = 0;
        for byte in self.bytes().iter().take(4).rev() {
            mask = mask << 8 | u32::from(*byte);
        }
        if self.count < 32 {
            mask & ((1 << self.count) - 1)
        } else {
            mask
        }
    }
}

impl PartialEq for Bits<'_> {
    fn eq(&self, other: &Bits<'_>) -> bool {
        self.count == other.count && self.iter().eq(other.iter())
    }
}

impl Eq for Bits<'_> {}

impl fmt::Debug for Bits<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.iter()
            .try_for_each(|bit| f.write_str(if bit { "1" } else { "0" }))
    }
}

/// Up to 125 registers, high byte first as on the wire.
#[derive(Clone, Copy)]
pub struct Words<'a> {
    count: u16,
    store: Store<'a>,
}

impl<'a> Words<'a> {
    /// The most in one Modbus reply.
    pub const MAX: u16 = 125;

    /// One register.
    #[must_use]
    #[inline]
    pub const fn one(word: u16) -> Words<'static> {
        let [high, low] = word.to_be_bytes();
        Words {
            count: 1,
            store: Store::Here([high, low, 0, 0]),
        }
    }

    /// Two registers.
    #[must_use]
    #[inline]
    pub const fn two(first: u16, second: u16) -> Words<'static> {
        let ([a, b], [c, d]) = (first.to_be_bytes(), second.to_be_bytes());
        Words {
            count: 2,
            store: Store::Here([a, b, c, d]),
        }
    }

    /// Registers in two bytes each, high byte first; none outside 1 to 125 registers.
    #[must_use]
    #[inline]
    pub const fn from_packed(bytes: &'a [u8]) -> Option<Words<'a>> {
        let count = bytes.len() / 2;
        if bytes.len().is_multiple_of(2) && count >= 1 && count <= Self::MAX as usize {
            Some(Words {
                count: count as u16,
                store: Store::There(bytes),
            })
        } else {
            None
        }
    }

    /// The number of registers.
    #[must_use]
    #[allow(clippy::len_without_is_empty, reason = "there is always at least one")]
    #[inline]
    pub const fn len(&self) -> u16 {
        self.count
    }

    /// The packed bytes.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        self.store.bytes(2 * usize::from(self.count))
    }

    /// The register with this 0-based index.
    #[must_use]
    pub fn get(&self, index: u16) -> Option<u16> {
        self.iter().nth(usize::from(index))
    }

    /// All registers in order.
    pub fn iter(&self) -> impl Iterator<Item = u16> {
        let (pairs, _) = self.bytes().as_chunks::<2>();
        pairs.iter().map(|pair| u16::from_be_bytes(*pair))
    }
}

impl PartialEq for Words<'_> {
    fn eq(&self, other: &Words<'_>) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Eq for Words<'_> {}

impl fmt::Debug for Words<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}
