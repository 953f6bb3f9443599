//! Bit-banged I2C: two open-drain pins and a pause.

/// The two pins. High means released: a pull-up makes it high, unless another device pulls it low.
pub trait Pins {
    /// Releases the clock, or pulls it low.
    fn clock(&mut self, high: bool);
    /// Releases the data line, or pulls it low.
    fn data(&mut self, high: bool);
    /// Whether the data line is high.
    fn data_is_high(&self) -> bool;
    /// A quarter of a bit: 0.6 µs or more for chips of 400 kHz.
    fn pause(&self);
}

/// The chip at this address did not answer, or stopped answering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Absent;

/// The bus; this is the only master on it.
#[derive(Debug)]
pub struct I2c<P> {
    pins: P,
}

impl<P: Pins> I2c<P> {
    /// Makes the bus idle whatever a chip was doing: a reset may have come in the middle of a byte
    /// that it sends, and then it holds the data line until it has got all its clocks.
    pub fn new(pins: P) -> I2c<P> {
        let mut bus = I2c { pins };
        bus.pins.data(true);
        for _ in 0..9 {
            bus.bit(true);
        }
        bus.start();
        bus.stop();
        bus
    }

    /// Writes the parts, one after the other, to the chip at this 7-bit address.
    ///
    /// # Errors
    /// [`Absent`].
    pub fn write(&mut self, address: u8, parts: &[&[u8]]) -> Result<(), Absent> {
        self.start();
        let result = self.send(address << 1, parts);
        self.stop();
        result
    }

    /// Writes `to`, usually the number of a register, and reads from there.
    ///
    /// # Errors
    /// [`Absent`].
    pub fn read(&mut self, address: u8, to: &[u8], into: &mut [u8]) -> Result<(), Absent> {
        self.start();
        let mut result = self.send(address << 1, &[to]);
        if result.is_ok() {
            self.start();
            result = self.send(address << 1 | 1, &[]);
        }
        if result.is_ok()
            && let Some((last, others)) = into.split_last_mut()
        {
            for byte in others {
                *byte = self.take(true);
            }
            *last = self.take(false);
        }
        self.stop();
        result
    }

    fn send(&mut self, address: u8, parts: &[&[u8]]) -> Result<(), Absent> {
        let bytes = parts.iter().copied().flatten().copied();
        for byte in core::iter::once(address).chain(bytes) {
            for bit in (0..8).rev() {
                self.bit(byte >> bit & 1 == 1);
            }
            let refused = self.bit(true);
            if refused {
                return Err(Absent);
            }
        }
        Ok(())
    }

    fn take(&mut self, more: bool) -> u8 {
        let byte = (0..8).fold(0, |byte, _| byte << 1 | u8::from(self.bit(true)));
        self.bit(!more);
        byte
    }

    /// One clock. Returns the data line while it is high.
    // Not inlined: a bit takes longer than a call, and there are many callers.
    #[inline(never)]
    fn bit(&mut self, high: bool) -> bool {
        self.pins.clock(false);
        self.pins.pause();
        self.pins.data(high);
        self.pins.pause();
        self.pins.clock(true);
        self.pins.pause();
        let seen = self.pins.data_is_high();
        self.pins.pause();
        seen
    }

    /// The data line falls while the clock is high.
    #[inline(never)]
    fn start(&mut self) {
        self.pins.clock(false);
        self.pins.pause();
        self.pins.data(true);
        self.pins.pause();
        self.pins.clock(true);
        self.pins.pause();
        self.pins.data(false);
        self.pins.pause();
    }

    /// The data line rises while the clock is high.
    #[inline(never)]
    fn stop(&mut self) {
        self.pins.clock(false);
        self.pins.pause();
        self.pins.data(false);
        self.pins.pause();
        self.pins.clock(true);
        self.pins.pause();
        self.pins.data(true);
        self.pins.pause();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::{Cell, RefCell};

    /// A chip at address 48h with four registers, modelled from the state of the two lines.
    #[derive(Default)]
    struct Chip {
        clock: Cell<bool>,
        master: Cell<bool>,
        /// The chip's output on the data line: true releases it.
        chip: Cell<bool>,
        bits: RefCell<Vec<bool>>,
        /// Bytes since the start, the address first; none while another chip is addressed.
        bytes: RefCell<Vec<u8>>,
        is_meant: Cell<bool>,
        sends: Cell<bool>,
        place: Cell<usize>,
        registers: RefCell<[u8; 4]>,
        stops: Cell<usize>,
    }

    impl Pins for &Chip {
        fn clock(&mut self, high: bool) {
            if self.clock.replace(high) && !high {
                self.fell();
            } else if high {
                self.bits.borrow_mut().push(self.level());
            }
        }
        fn data(&mut self, high: bool) {
            let before = self.level();
            self.master.set(high);
            if self.clock.get() && before != self.level() {
                // A start, or a stop.
                self.bits.borrow_mut().clear();
                self.bytes.borrow_mut().clear();
                self.is_meant.set(before);
                self.sends.set(false);
                self.chip.set(true);
                self.stops.set(self.stops.get() + usize::from(!before));
            }
        }
        fn data_is_high(&self) -> bool {
            self.level()
        }
        fn pause(&self) {}
    }

    impl Chip {
        fn level(&self) -> bool {
            self.master.get() && self.chip.get()
        }

        /// The clock falls: the time for the chip to move the data line.
        fn fell(&self) {
            let mut bits = self.bits.borrow_mut();
            self.chip.set(true);
            match bits.len() {
                8 if !self.sends.get() => {
                    let byte = bits.iter().fold(0, |byte, bit| byte << 1 | u8::from(*bit));
                    self.chip.set(!self.takes(byte));
                }
                9 => {
                    let refused = bits[8];
                    bits.clear();
                    let asked = self
                        .bytes
                        .borrow()
                        .first()
                        .is_some_and(|byte| byte & 1 == 1);
                    self.sends.set(self.is_meant.get() && asked && !refused);
                    self.send(0);
                }
                sent => self.send(sent),
            }
        }

        fn send(&self, bit: usize) {
            if self.sends.get() && bit < 8 {
                let byte = self.registers.borrow()[self.place.get() % 4];
                self.chip.set(byte >> (7 - bit) & 1 == 1);
                self.place.set(self.place.get() + usize::from(bit == 7));
            }
        }

        fn takes(&self, byte: u8) -> bool {
            let mut bytes = self.bytes.borrow_mut();
            if bytes.is_empty() && byte >> 1 != 0x48 {
                self.is_meant.set(false);
            }
            if !self.is_meant.get() {
                return false;
            }
            bytes.push(byte);
            match bytes.len() {
                1 => {}
                2 => self.place.set(byte.into()),
                _ => {
                    self.registers.borrow_mut()[self.place.get() % 4] = byte;
                    self.place.set(self.place.get() + 1);
                }
            }
            true
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let chip = Chip::default();
        let mut bus = I2c::new(&chip);
        assert_eq!(bus.write(0x48, &[&[1], &[0xA5, 0x3C]]), Ok(()));
        assert_eq!(*chip.registers.borrow(), [0, 0xA5, 0x3C, 0]);
        let mut read = [0; 3];
        assert_eq!(bus.read(0x48, &[1], &mut read), Ok(()));
        assert_eq!(read, [0xA5, 0x3C, 0]);
        assert!(chip.level() && chip.clock.get(), "the bus is let go");
        assert_eq!(chip.stops.get(), 3, "that of the beginning, and one each");
    }

    #[test]
    fn nobody_answers_for_a_chip_that_is_not_there() {
        let chip = Chip::default();
        let mut bus = I2c::new(&chip);
        assert_eq!(bus.write(0x49, &[&[1, 2]]), Err(Absent));
        assert_eq!(bus.read(0x49, &[1], &mut [0; 2]), Err(Absent));
        assert_eq!(*chip.registers.borrow(), [0; 4]);
        assert_eq!(bus.write(0x48, &[&[0, 9]]), Ok(()), "the next one is heard");
    }
}
