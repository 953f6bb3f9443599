//! Two slots in a byte EEPROM.
//!
//! A slot is written only while the other one holds what counts, so whatever a loss of power
//! makes of it, the other one is whole. Both begin at a page of their own, as a chip may spoil
//! the whole page that it was writing.
//!
//! | at | bytes | what |
//! |---|---|---|
//! | 0 | 4 | sequence: the higher one counts, round the end of the numbers |
//! | 4 | 1 | how many bytes are kept, 1 to 119 |
//! | 5 | n | those bytes |
//! | 5 + n | 4 | CRC-32 (ISO-HDLC) of all before it |
//!
//! The first slot is at 0, the second at [`SLOT`]. An EEPROM as it leaves its factory, all FF, or
//! all 00, holds nothing. This framing has no version of its own: it stays.

use crate::bytes::{Bytes, Reader};
use crate::keeper::Store;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage::Storage;

/// The distance of the two slots, a whole number of pages of any 24C chip.
pub const SLOT: u32 = 128;

const HEADER: usize = 5;
const CHECK: usize = 4;

/// Without a table: it is computed over some forty bytes, and the table takes 1 KiB.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// How often a slot is read that seems broken, so that a disturbed I²C does not make a module
/// go by its settings before last.
const READS: usize = 3;

/// Keeps bytes in an EEPROM of 256 bytes or more.
#[derive(Clone, Copy, Debug)]
pub struct Slots<S> {
    storage: S,
}

/// A whole slot.
#[derive(Clone, Copy)]
struct Slot {
    at: u32,
    sequence: u32,
    kept: Bytes,
}

impl<S> Slots<S> {
    /// The two slots at the beginning of this EEPROM.
    pub const fn new(storage: S) -> Slots<S> {
        Slots { storage }
    }

    /// The EEPROM.
    pub fn into_inner(self) -> S {
        self.storage
    }
}

impl<S: Storage> Slots<S> {
    /// The slot that counts.
    fn newest(&mut self) -> Result<Option<Slot>, S::Error> {
        let first = self.slot(0)?;
        let second = self.slot(SLOT)?;
        Ok(match (first, second) {
            (Some(first), Some(second)) if is_later(second.sequence, first.sequence) => {
                Some(second)
            }
            (Some(first), _) => Some(first),
            (None, second) => second,
        })
    }

    fn slot(&mut self, at: u32) -> Result<Option<Slot>, S::Error> {
        for _ in 0..READS {
            let slot = self.read_slot(at)?;
            if slot.is_some() {
                return Ok(slot);
            }
        }
        Ok(None)
    }

    fn read_slot(&mut self, at: u32) -> Result<Option<Slot>, S::Error> {
        let mut header = [0; HEADER];
        self.storage.read(at, &mut header)?;
        let [.., len] = header;
        let mut image = Bytes::new();
        let Some(room) = image.room(HEADER + usize::from(len) + CHECK) else {
            return Ok(None);
        };
        self.storage.read(at, room)?;
        Ok(whole(at, image.bytes()))
    }
}

impl<S: Storage> Store for Slots<S> {
    type Error = S::Error;

    fn read(&mut self) -> Result<Option<Bytes>, S::Error> {
        Ok(self.newest()?.map(|slot| slot.kept))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), S::Error> {
        let (at, sequence) = match self.newest()? {
            None => (0, 1),
            Some(newest) => (SLOT - newest.at, newest.sequence.wrapping_add(1)),
        };
        self.storage.write(at, slot_image(bytes, sequence).bytes())
    }
}

/// A slot as it lies in the EEPROM; empty where the bytes are more than 119.
#[must_use]
pub fn slot_image(bytes: &[u8], sequence: u32) -> Bytes {
    let mut image = Bytes::new();
    let fits = bytes.len() <= Bytes::MAX - HEADER - CHECK;
    if fits && let Ok(len) = u8::try_from(bytes.len()) {
        image.push(&sequence.to_le_bytes());
        image.push(&[len]);
        image.push(bytes);
        let check = CRC.checksum(image.bytes());
        image.push(&check.to_le_bytes());
    }
    image
}

/// The slot of this image, where it is whole.
fn whole(at: u32, image: &[u8]) -> Option<Slot> {
    let (body, check) = image.split_last_chunk()?;
    let mut from = Reader(body);
    let sequence = from.u32()?;
    let len = usize::from(from.u8()?);
    let right = CRC.checksum(body) == u32::from_le_bytes(*check);
    let kept = Bytes::of(from.0).filter(|_| right && len > 0)?;
    Some(Slot { at, sequence, kept })
}

/// Whether `one` comes after `other`, round the end of the numbers.
const fn is_later(one: u32, other: u32) -> bool {
    one.wrapping_sub(other) as i32 > 0
}
