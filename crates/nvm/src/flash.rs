//! Slots in NOR flash, written one after the other through all sectors in turn, so that they wear
//! evenly.
//!
//! The newest slot is found by its sequence, wherever it is. The next slot is the first blank one
//! after it in its sector, or else the first of the next sector, which is erased first. So the
//! sector with the newest slot is never erased, and a sector whose erasure was interrupted does no
//! harm: anything it still seems to hold is older, and it is erased again before it is used.

use crate::bytes::Bytes;
use crate::keeper::Store;
use crate::slot::{SLOT, Slot, kept, slot_image};
use core::ops::Range;
use embedded_storage::nor_flash::NorFlash;

/// A slot with everything after its bytes.
type Image = [u8; SLOT as usize];

const BLANK: Image = [0xFF; SLOT as usize];

/// Stores bytes in some sectors of a NOR flash.
#[derive(Clone, Debug)]
pub struct Flash<F> {
    flash: F,
    range: Range<u32>,
}

/// The sectors can't be used: there are fewer than two, the range is not aligned to sectors or
/// outside the flash, or slots do not fit its sectors and words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadRange;

impl<F: NorFlash> Flash<F> {
    /// A store in this range of addresses, which nothing else uses: two sectors or more.
    ///
    /// # Errors
    /// If the range can't be used.
    pub fn new(flash: F, range: Range<u32>) -> Result<Flash<F>, BadRange> {
        let whole = |len: u32, of: usize| of > 0 && (len as usize).is_multiple_of(of);
        let sectors = whole(range.start, F::ERASE_SIZE) && whole(range.end, F::ERASE_SIZE);
        let slots = F::ERASE_SIZE.is_multiple_of(SLOT as usize)
            && whole(SLOT, F::WRITE_SIZE)
            && whole(SLOT, F::READ_SIZE);
        let long = range.len() >= F::ERASE_SIZE.saturating_mul(2);
        let inside = range.end as usize <= flash.capacity();
        let usable = sectors && slots && long && inside;
        usable.then_some(Flash { flash, range }).ok_or(BadRange)
    }

    /// The flash.
    pub fn into_inner(self) -> F {
        self.flash
    }

    fn image(&mut self, at: u32) -> Result<Image, F::Error> {
        let mut image = BLANK;
        self.flash.read(at, &mut image)?;
        Ok(image)
    }

    /// The newest slot, read into `room`.
    fn newest(&mut self, room: &mut Bytes) -> Result<Option<Slot>, F::Error> {
        let mut newest: Option<Slot> = None;
        for at in self.range.clone().step_by(SLOT as usize) {
            let image = self.image(at)?;
            let later = Slot::later(newest, Slot::of(at, &image));
            if let Some(found) = later
                && found.at == at
            {
                *room = Bytes::of(&image).unwrap_or_default();
            }
            newest = later;
        }
        Ok(newest)
    }

    /// The position after this slot, made blank.
    fn blank_after(&mut self, newest: Option<Slot>) -> Result<u32, F::Error> {
        let sector = F::ERASE_SIZE as u32;
        let mut at = newest.map_or(self.range.start, |newest| newest.at + SLOT);
        while !at.is_multiple_of(sector) {
            if self.image(at)? == BLANK {
                return Ok(at);
            }
            at += SLOT;
        }
        if at >= self.range.end {
            at = self.range.start;
        }
        self.flash.erase(at, at + sector)?;
        Ok(at)
    }
}

impl<F: NorFlash> Store for Flash<F> {
    type Error = F::Error;

    fn read<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, F::Error> {
        let newest = self.newest(room)?;
        Ok(newest.and_then(|_| kept(room.bytes())))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), F::Error> {
        let newest = self.newest(&mut Bytes::new())?;
        let at = self.blank_after(newest)?;
        let mut image = BLANK;
        let slot = slot_image(bytes, Slot::next(newest));
        for (to, from) in image.iter_mut().zip(slot.bytes()) {
            *to = *from;
        }
        self.flash.write(at, &image)
    }
}
