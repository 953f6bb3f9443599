//! An AT24C EEPROM with 16-bit addresses: 24C32 to 24C512.

use crate::i2c::{Absent, I2c, Pins};
use embedded_storage::{ReadStorage, Storage};

const ADDRESS: u8 = 0x50;
/// The smallest size among these chips, and far more than the settings take.
const CAPACITY: usize = 4096;
/// The smallest page among them: a write wraps within its page.
const PAGE: u32 = 32;
/// While it writes, up to 10 ms, the chip does not answer; one poll takes 25 µs or more.
const QUESTIONS: u32 = 600;

/// The chip.
#[derive(Debug)]
pub struct At24c<P> {
    bus: I2c<P>,
}

impl<P: Pins> At24c<P> {
    /// The chip on this bus.
    pub const fn new(bus: I2c<P>) -> At24c<P> {
        At24c { bus }
    }

    /// Waits until it answers.
    fn wait(&mut self) -> Result<(), Absent> {
        let mut answers = (0..QUESTIONS).map(|_| self.bus.write(ADDRESS, &[]));
        answers.find(Result::is_ok).unwrap_or(Err(Absent))
    }
}

impl<P: Pins> ReadStorage for At24c<P> {
    type Error = Absent;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Absent> {
        self.bus.read(ADDRESS, &place(offset), bytes)
    }

    fn capacity(&self) -> usize {
        CAPACITY
    }
}

impl<P: Pins> Storage for At24c<P> {
    fn write(&mut self, mut offset: u32, mut bytes: &[u8]) -> Result<(), Absent> {
        while !bytes.is_empty() {
            let room = (PAGE - offset % PAGE) as usize;
            let (page, rest) = bytes.split_at_checked(room).unwrap_or((bytes, &[]));
            self.bus.write(ADDRESS, &[&place(offset), page])?;
            self.wait()?;
            offset = offset.wrapping_add(page.len() as u32);
            bytes = rest;
        }
        Ok(())
    }
}

/// The two address bytes.
const fn place(offset: u32) -> [u8; 2] {
    (offset as u16).to_be_bytes()
}
