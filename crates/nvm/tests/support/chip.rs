//! A byte EEPROM of the 24C kind: written in pages, and cut off at any byte.

use super::Rng;
use embedded_storage::{ReadStorage, Storage};

/// Bytes of a page of an AT24C32 and larger.
pub const PAGE: usize = 32;

/// What a loss of power leaves behind.
#[derive(Clone, Copy, Debug)]
pub enum Spoils {
    /// The byte that was being written is as it was.
    Nothing,
    /// The byte that was being written is written.
    Written,
    /// The byte that was being written is anything.
    Byte(u64),
    /// Every byte of the page that was being written, also those that were not to be, may be
    /// as it was, as it was to be, or anything.
    Page(u64),
}

/// The chip, or its bus, does not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dead;

#[derive(Clone, Debug)]
pub struct Chip {
    pub bytes: Vec<u8>,
    /// How often each page was written.
    pub worn: Vec<u32>,
    /// How often it was read.
    pub reads: usize,
    /// How many bytes are written before the power fails, and what is left then.
    pub cut: Option<(usize, Spoils)>,
    /// It answers nothing.
    pub dead: bool,
    /// Writes change nothing: the chip is worn out, or protected.
    pub stuck: bool,
    /// So many reads bring a wrong bit.
    pub disturbed: usize,
}

impl Chip {
    pub fn of(bytes: Vec<u8>) -> Chip {
        Chip {
            worn: vec![0; bytes.len().div_ceil(PAGE)],
            bytes,
            reads: 0,
            cut: None,
            dead: false,
            stuck: false,
            disturbed: 0,
        }
    }

    /// As it leaves its factory.
    pub fn blank() -> Chip {
        Chip::of(vec![0xFF; 512])
    }

    /// The power is back.
    pub fn restored(self) -> Chip {
        Chip {
            cut: None,
            dead: false,
            ..self
        }
    }

    fn fail(&mut self, page: usize, at: usize, new: &[(usize, u8)], spoils: Spoils) {
        self.dead = true;
        match spoils {
            Spoils::Nothing => {}
            Spoils::Written => self.bytes[at] = find(new, at).unwrap_or(self.bytes[at]),
            Spoils::Byte(seed) => self.bytes[at] = Rng(seed).next() as u8,
            Spoils::Page(seed) => {
                let mut rng = Rng(seed);
                for at in page * PAGE..(page + 1) * PAGE {
                    self.bytes[at] = match rng.below(3) {
                        0 => self.bytes[at],
                        1 => find(new, at).unwrap_or(self.bytes[at]),
                        _ => rng.next() as u8,
                    };
                }
            }
        }
    }

    fn write_page(&mut self, page: usize, new: &[(usize, u8)]) -> Result<(), Dead> {
        self.worn[page] += 1;
        for &(at, byte) in new {
            if let Some((left, spoils)) = &mut self.cut {
                if *left == 0 {
                    let spoils = *spoils;
                    self.fail(page, at, new, spoils);
                    return Err(Dead);
                }
                *left -= 1;
            }
            self.bytes[at] = byte;
        }
        Ok(())
    }
}

fn find(new: &[(usize, u8)], at: usize) -> Option<u8> {
    new.iter()
        .find(|(one, _)| *one == at)
        .map(|(_, byte)| *byte)
}

impl ReadStorage for Chip {
    type Error = Dead;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Dead> {
        if self.dead {
            return Err(Dead);
        }
        self.reads += 1;
        let offset = offset as usize;
        let from = self.bytes.get(offset..offset + bytes.len()).ok_or(Dead)?;
        bytes.copy_from_slice(from);
        if self.disturbed > 0 {
            self.disturbed -= 1;
            bytes[0] ^= 0x10;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl Storage for Chip {
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Dead> {
        if self.dead || offset as usize + bytes.len() > self.bytes.len() {
            return Err(Dead);
        }
        if self.stuck {
            return Ok(());
        }
        let placed: Vec<(usize, u8)> = (offset as usize..).zip(bytes.iter().copied()).collect();
        for chunk in placed.chunk_by(|one, next| one.0 / PAGE == next.0 / PAGE) {
            self.write_page(chunk[0].0 / PAGE, chunk)?;
        }
        Ok(())
    }
}
