//! Two slots in a byte EEPROM, the first at 0, the second at [`SLOT`].
//!
//! A slot is written only while the other one is the current one, so whatever a loss of power does
//! to it, the other one is intact. Each begins at its own page, because a chip may corrupt the
//! whole page that it was writing.

use crate::bytes::Bytes;
use crate::keeper::Store;
use crate::slot::{CHECK, HEADER, SLOT, Slot, kept, make_slot};
use embedded_storage::Storage;

/// How often a slot that seems corrupted is read, so that a disturbed I²C bus does not make a
/// module use its previous settings.
const READS: usize = 3;

/// Stores bytes in an EEPROM of 256 bytes or more.
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
    /// The slot at this position, read into `image`.
    fn slot(&mut self, at: u32, image: &mut Bytes) -> Result<Option<Slot>, S::Error> {
        for _ in 0..READS {
            self.read_slot(at, image)?;
            let slot = Slot::of(at, image.bytes());
            if slot.is_some() {
                return Ok(slot);
            }
        }
        Ok(None)
    }

    /// Reads as much of a slot as its length says; nothing if that is too much.
    fn read_slot(&mut self, at: u32, image: &mut Bytes) -> Result<(), S::Error> {
        let mut header = [0; HEADER];
        self.storage.read(at, &mut header)?;
        let [.., len] = header;
        match image.room(HEADER + usize::from(len) + CHECK) {
            Some(room) => self.storage.read(at, room),
            None => {
                image.clear();
                Ok(())
            }
        }
    }
}

impl<S: Storage> Store for Slots<S> {
    type Error = S::Error;

    fn read<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, S::Error> {
        let mut image = Bytes::new();
        let second = self.slot(SLOT, &mut image)?;
        let newest = Slot::later(self.slot(0, room)?, second);
        if newest.is_some_and(|newest| newest.at == SLOT) {
            *room = image;
        }
        Ok(newest.and_then(|_| kept(room.bytes())))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), S::Error> {
        let mut image = Bytes::new();
        let first = self.slot(0, &mut image)?;
        let newest = Slot::later(first, self.slot(SLOT, &mut image)?);
        // The other slot.
        let at = match newest {
            Some(Slot { at: 0, .. }) => SLOT,
            _ => 0,
        };
        make_slot(bytes, Slot::next(newest), &mut image);
        self.storage.write(at, image.bytes())
    }
}
