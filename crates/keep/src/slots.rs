//! Two slots in a byte EEPROM, the first at 0, the second at [`SLOT`].
//!
//! A slot is written only while the other one holds what counts, so whatever a loss of power
//! makes of it, the other one is whole. Both begin at a page of their own, as a chip may spoil
//! the whole page that it was writing.

use crate::bytes::Bytes;
use crate::keeper::Store;
use crate::slot::{CHECK, HEADER, SLOT, Slot, slot_image};
use embedded_storage::Storage;

/// How often a slot is read that seems broken, so that a disturbed I²C does not make a module
/// go by its settings before last.
const READS: usize = 3;

/// Keeps bytes in an EEPROM of 256 bytes or more.
#[derive(Clone, Copy, Debug)]
pub struct Slots<S> {
    storage: S,
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
        Ok(Slot::later(self.slot(0)?, self.slot(SLOT)?))
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
        Ok(Slot::of(at, image.bytes()))
    }
}

impl<S: Storage> Store for Slots<S> {
    type Error = S::Error;

    fn read(&mut self) -> Result<Option<Bytes>, S::Error> {
        Ok(self.newest()?.map(|slot| slot.kept))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), S::Error> {
        let newest = self.newest()?;
        let at = newest.map_or(0, |newest| SLOT - newest.at);
        let image = slot_image(bytes, Slot::next(newest));
        self.storage.write(at, image.bytes())
    }
}
