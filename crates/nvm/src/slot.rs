//! One slot: a few bytes, their sequence, and whether they are whole. Both stores are made of
//! slots, of which the whole one with the highest sequence counts.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 4 | sequence: the higher one counts, round the end of the numbers |
//! | 4 | 1 | how many bytes are kept, 1 to 119 |
//! | 5 | n | those bytes |
//! | 5 + n | 4 | CRC-32 (ISO-HDLC) of all before it |
//!
//! Numbers go low byte first. Slots begin every [`SLOT`] bytes. A chip as it leaves its factory,
//! all FF, or all 00, holds nothing. This framing has no version of its own: it stays.

use crate::bytes::Bytes;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// The distance of slots: a whole number of pages of any 24C chip, and of words of any flash.
pub const SLOT: u32 = 128;

/// Bytes before those that are kept.
pub(crate) const HEADER: usize = 5;

/// Bytes behind those that are kept.
pub(crate) const CHECK: usize = 4;

/// Without a table: it is computed over some sixty bytes, and the table takes 1 KiB.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A whole slot.
#[derive(Clone, Copy)]
pub(crate) struct Slot {
    /// Where it lies.
    pub(crate) at: u32,
    pub(crate) sequence: u32,
}

impl Slot {
    /// The slot that this image begins with, where it is whole.
    pub(crate) fn of(at: u32, image: &[u8]) -> Option<Slot> {
        let sequence = u32::from_le_bytes(*image.first_chunk()?);
        let whole = image.get(..HEADER + kept(image)?.len() + CHECK)?;
        let (body, check) = whole.split_last_chunk()?;
        let right = CRC.checksum(body) == u32::from_le_bytes(*check);
        right.then_some(Slot { at, sequence })
    }

    /// The one of two that counts; the first where neither does more.
    pub(crate) fn later(one: Option<Slot>, other: Option<Slot>) -> Option<Slot> {
        match (one, other) {
            (Some(one), Some(other)) => {
                let ahead = other.sequence.wrapping_sub(one.sequence) as i32;
                Some(if ahead > 0 { other } else { one })
            }
            (one, other) => one.or(other),
        }
    }

    /// The sequence of what comes after this.
    pub(crate) fn next(slot: Option<Slot>) -> u32 {
        slot.map_or(1, |slot| slot.sequence.wrapping_add(1))
    }
}

/// The bytes that the slot keeps which this image begins with; nothing where they can't be so
/// few or so many.
pub(crate) fn kept(image: &[u8]) -> Option<&[u8]> {
    let (&[.., len], rest) = image.split_first_chunk::<HEADER>()?;
    let kept = rest.get(..usize::from(len))?;
    let fits = (1..=Bytes::MAX - HEADER - CHECK).contains(&kept.len());
    fits.then_some(kept)
}

/// A slot as it lies in the chip; empty where the bytes are none, or more than 119.
#[must_use]
pub fn slot_image(bytes: &[u8], sequence: u32) -> Bytes {
    let mut image = Bytes::new();
    make_slot(bytes, sequence, &mut image);
    image
}

/// Makes [`slot_image`] where something else lay.
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
