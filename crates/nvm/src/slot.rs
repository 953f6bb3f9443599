//! One slot: a few bytes, their sequence, and a checksum. Both stores consist of slots; of the
//! intact ones the one with the highest sequence is the current one.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 4 | sequence: the higher one is newer, with wrap-around |
//! | 4 | 1 | number of bytes stored, 1 to 119 |
//! | 5 | n | those bytes |
//! | 5 + n | 4 | CRC-32 (ISO-HDLC) of all before it |
//!
//! Numbers are little-endian. Slots begin every [`SLOT`] bytes. A blank chip, all FF or all 00,
//! holds nothing. This framing has no version of its own: it never changes.

use crate::bytes::Bytes;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// The distance between slots: a multiple of the pages of any 24C chip, and of the words of any
/// flash.
pub const SLOT: u32 = 128;

/// Bytes before the stored ones.
pub(crate) const HEADER: usize = 5;

/// Bytes after the stored ones.
pub(crate) const CHECK: usize = 4;

/// Without a table: it covers some sixty bytes, and the table takes 1 KiB.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// An intact slot.
#[derive(Clone, Copy)]
pub(crate) struct Slot {
    /// Its position.
    pub(crate) at: u32,
    pub(crate) sequence: u32,
}

impl Slot {
    /// The slot at the beginning of this image, if it is intact.
    pub(crate) fn of(at: u32, image: &[u8]) -> Option<Slot> {
        let sequence = u32::from_le_bytes(*image.first_chunk()?);
        let whole = image.get(..HEADER + kept(image)?.len() + CHECK)?;
        let (body, check) = whole.split_last_chunk()?;
        let right = CRC.checksum(body) == u32::from_le_bytes(*check);
        right.then_some(Slot { at, sequence })
    }

    /// The newer one of two; the first if neither is.
    pub(crate) fn later(one: Option<Slot>, other: Option<Slot>) -> Option<Slot> {
        match (one, other) {
            (Some(one), Some(other)) => {
                let ahead = other.sequence.wrapping_sub(one.sequence) as i32;
                Some(if ahead > 0 { other } else { one })
            }
            (one, other) => one.or(other),
        }
    }

    /// The sequence of the slot after this one.
    pub(crate) fn next(slot: Option<Slot>) -> u32 {
        slot.map_or(1, |slot| slot.sequence.wrapping_add(1))
    }
}

/// The stored bytes of the slot at the beginning of this image; none if their number is not
/// possible.
pub(crate) fn kept(image: &[u8]) -> Option<&[u8]> {
    let (&[.., len], rest) = image.split_first_chunk::<HEADER>()?;
    let kept = rest.get(..usize::from(len))?;
    let fits = (1..=Bytes::MAX - HEADER - CHECK).contains(&kept.len());
    fits.then_some(kept)
}

/// The image of a slot in the chip; empty if there are no bytes, or more than 119.
#[must_use]
pub fn slot_image(bytes: &[u8], sequence: u32) -> Bytes {
    let mut image = Bytes::new();
    make_slot(bytes, sequence, &mut image);
    image
}

/// Writes [`slot_image`] over another one.
pub(crate) fn make_slot(bytes: &[u8], sequence: u32, image: &mut Bytes) {
    image.clear();
    let fits = (1..=Bytes::MAX - HEADER - CHECK).contains(&bytes.len());
    if let Ok(len) = u8::try_from(bytes.len())
        && fits
    {
        image.push(&sequence.to_le_bytes());
        image.push(&[len]);
        image.push(bytes);
        let check = CRC.checksum(image.bytes());
        image.push(&check.to_le_bytes());
    }
}
