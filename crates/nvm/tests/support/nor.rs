//! A NOR flash: words are programmed from ones to zeros, sectors are erased, and the power fails
//! at any step of either.

use super::Rng;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

/// Bytes of a word, as on STM32 and nRF chips.
pub const WORD: usize = 4;

/// Bytes of a sector. Small, so that a history of writes goes round all sectors.
pub const SECTOR: usize = 512;

/// How a sector that was being erased is left.
#[derive(Clone, Copy, Debug)]
pub enum Erasing {
    /// Erased from the front, up to some word.
    Forward,
    /// Erased from the back.
    Backward,
    /// Each word erased, as it was, or anything.
    Words,
    /// Some bits are ones already, anywhere.
    Bits,
    /// All bits are zeros: what a chip does before it erases.
    Zeros,
}

impl Erasing {
    pub const ALL: [Erasing; 5] = [
        Erasing::Forward,
        Erasing::Backward,
        Erasing::Words,
        Erasing::Bits,
        Erasing::Zeros,
    ];
}

/// When the power fails, and what is left then.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    /// How many steps are done before: a byte programmed, or a sixteenth of a sector erased.
    pub after: usize,
    pub erasing: Erasing,
    pub seed: u64,
}

#[derive(Clone, Debug)]
pub struct Nor {
    pub bytes: Vec<u8>,
    /// How often each sector was erased.
    pub erased: Vec<u32>,
    pub steps: usize,
    pub cut: Option<Cut>,
    pub dead: bool,
    /// Words programmed twice without an erasure between: real chips forbid it.
    written: Vec<bool>,
    pub twice: usize,
}

impl Nor {
    pub fn of(bytes: Vec<u8>) -> Nor {
        Nor {
            erased: vec![0; bytes.len() / SECTOR],
            written: bytes
                .chunks(WORD)
                .map(|word| word != [0xFF; WORD])
                .collect(),
            bytes,
            steps: 0,
            cut: None,
            dead: false,
            twice: 0,
        }
    }

    /// As it leaves its factory, with so many sectors.
    pub fn blank(sectors: usize) -> Nor {
        Nor::of(vec![0xFF; sectors * SECTOR])
    }

    /// The power is back.
    pub fn restored(self) -> Nor {
        Nor {
            cut: None,
            dead: false,
            steps: 0,
            ..self
        }
    }

    /// One step; what the power fails with, where it does.
    fn step(&mut self) -> Result<(), Cut> {
        if let Some(cut) = self.cut.filter(|cut| cut.after == self.steps) {
            self.dead = true;
            return Err(cut);
        }
        self.steps += 1;
        Ok(())
    }

    fn half_erased(&mut self, sector: usize, part: usize, cut: Cut) {
        let mut rng = Rng(cut.seed);
        let (from, len) = (sector * SECTOR, SECTOR * part / 16 / WORD * WORD);
        for (at, byte) in self.bytes[from..from + SECTOR].iter_mut().enumerate() {
            *byte = match cut.erasing {
                Erasing::Forward if at < len => 0xFF,
                Erasing::Backward if at >= SECTOR - len => 0xFF,
                Erasing::Forward | Erasing::Backward => *byte,
                Erasing::Words => match Rng(cut.seed ^ (at / WORD) as u64).below(3) {
                    0 => *byte,
                    1 => 0xFF,
                    _ => rng.next() as u8,
                },
                Erasing::Bits => *byte | (rng.next() & rng.next()) as u8,
                Erasing::Zeros => 0,
            };
        }
    }
}

impl ErrorType for Nor {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Nor {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let offset = offset as usize;
        let from = self.bytes.get(offset..offset + bytes.len());
        match from {
            _ if self.dead => Err(NorFlashErrorKind::Other),
            None => Err(NorFlashErrorKind::OutOfBounds),
            Some(from) => {
                bytes.copy_from_slice(from);
                Ok(())
            }
        }
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for Nor {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        if self.dead {
            return Err(NorFlashErrorKind::Other);
        }
        for sector in from as usize / SECTOR..to as usize / SECTOR {
            for part in 0..16 {
                if let Err(cut) = self.step() {
                    self.half_erased(sector, part, cut);
                    return Err(NorFlashErrorKind::Other);
                }
            }
            self.bytes[sector * SECTOR..][..SECTOR].fill(0xFF);
            self.written[sector * SECTOR / WORD..][..SECTOR / WORD].fill(false);
            self.erased[sector] += 1;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let whole_words = [offset as usize, bytes.len()].map(|n| n.is_multiple_of(WORD));
        if self.dead || whole_words != [true; 2] {
            return Err(NorFlashErrorKind::Other);
        }
        for (at, byte) in (offset as usize..).zip(bytes) {
            if at % WORD == 0 {
                self.twice += usize::from(self.written[at / WORD]);
                self.written[at / WORD] = true;
            }
            if let Err(cut) = self.step() {
                // Of the byte that was being programmed, some bits are zeros already.
                self.bytes[at] &= byte | Rng(cut.seed).next() as u8;
                return Err(NorFlashErrorKind::Other);
            }
            self.bytes[at] &= byte;
        }
        Ok(())
    }
}
