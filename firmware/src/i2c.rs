//! I2C by hand: two open-drain pins and a pause.

/// The two pins. High means let go: a pull-up makes it high, unless another pulls it low.
pub trait Pins {
    /// Lets the clock go, or pulls it low.
    fn clock(&mut self, high: bool);
    /// Lets the data line go, or pulls it low.
    fn data(&mut self, high: bool);
    /// Whether the data line is high.
    fn data_is_high(&self) -> bool;
    /// A quarter of a bit: 0.6 µs or more for chips of 400 kHz.
    fn pause(&self);
}

/// The chip at this address did not answer, or not to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Absent;

/// The bus, of which this is the only master.
#[derive(Debug)]
pub struct I2c<P> {
    pins: P,
}

impl<P: Pins> I2c<P> {
    /// A bus that is idle whatever a chip was doing: a reset may have come in the middle of a
    /// byte that it sends, and then it holds the data line until it has got all its clocks.
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

    /// Writes `to`, which is most often a register's number, and reads what lies there.
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
        if result.is_ok() {
            let mut left = into.len();
            for byte in into {
                left -= 1;
                *byte = self.take(left > 0);
            }
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

    /// One clock. What lies on the data line while it is high.
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
