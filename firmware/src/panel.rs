//! A module's terminals as chips on an I2C bus, so that QEMU shows them to the outside.
//!
//! | address | chip | what |
//! |---|---|---|
//! | 0x50 | AT24C32 or larger | the settings |
//! | 0x60, 0x61 | PCA9552 | outputs 0 to 15, 16 to 31; one that is on is a LED that is on |
//! | 0x62 | PCA9552 | LED 0 to 7: inputs; 8 to 12: DIP switch; 15: INIT* |
//! | 0x48, 0x49 | TMP105 | analog inputs, 1/16 °C = one hundredth |
//!
//! At 0x62 a LED that is on is a pin pulled low, as on the chip: the input is low, the switch is
//! on, INIT* is grounded. All off is a module with nothing connected.

use crate::i2c::{Absent, I2c, Pins};
use railbus_device::Setup;

const OUTPUTS: [u8; 2] = [0x60, 0x61];
const INPUTS: u8 = 0x62;
const ANALOGS: [u8; 2] = [0x48, 0x49];

/// The first of the PCA9552's four registers with two bits for each LED, with the auto-increment
/// bit.
const SELECTORS: u8 = 0x06 | 0x10;
/// The TMP105's registers: what it measures, and its settings.
const TEMPERATURE: u8 = 0;
const CONFIGURATION: u8 = 1;
const TWELVE_BITS: u8 = 0x60;

/// Chips in the order of the bits of [`Panel::missing`].
static NAMES: [&str; 5] = ["io0", "io1", "in0", "ai0", "ai1"];
const IO: usize = 0;
const IN: usize = 2;
const AI: usize = 3;

/// The state of a module's inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sensed {
    /// The digital pins; none if they could not be read.
    pub panel: Option<Pinned>,
    /// The analog inputs, in hundredths; none if they could not be read.
    pub analogs: [Option<i16>; 2],
    /// Bit n = output n cannot be moved.
    pub stuck: u32,
}

/// The digital pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pinned {
    /// Bit n = input n is high or open.
    pub levels: u32,
    /// The DIP switch.
    pub dip: u8,
    /// INIT* is grounded.
    pub init_grounded: bool,
}

/// The chips of a module.
#[derive(Debug)]
pub struct Panel<P> {
    bus: I2c<P>,
    /// How many output chips this module has.
    output_chips: usize,
    /// The wanted outputs.
    outputs: u32,
    /// The last state written to each chip; none if that failed.
    shown: [Option<u16>; 2],
    missing: u8,
}

impl<P: Pins> Panel<P> {
    /// The chips that such a module has.
    pub fn new(bus: I2c<P>, setup: &Setup) -> Panel<P> {
        let mut panel = Panel {
            bus,
            output_chips: usize::from(setup.outputs).div_ceil(16),
            outputs: 0,
            shown: [None; 2],
            missing: 0,
        };
        for (index, address) in analogs() {
            let done = panel.bus.write(address, &[&[CONFIGURATION, TWELVE_BITS]]);
            panel.note(AI + index, done);
        }
        panel
    }

    /// Sets the outputs: bit n = output n is on. Chips that do not answer are written again at the
    /// next [`Panel::sense`].
    pub fn drive(&mut self, outputs: u32) {
        self.outputs = outputs;
        for (index, address) in (0..self.output_chips).zip(OUTPUTS) {
            let half = (outputs >> (16 * index)) as u16;
            let Some(shown) = self
                .shown
                .get_mut(index)
                .filter(|shown| **shown != Some(half))
            else {
                continue;
            };
            let done = self.bus.write(address, &[&[SELECTORS], &selectors(half)]);
            *shown = done.ok().map(|()| half);
            self.note(IO + index, done);
        }
    }

    /// Reads the inputs of this module.
    pub fn sense(&mut self) -> Sensed {
        self.drive(self.outputs);
        let stuck = self
            .shown
            .iter()
            .zip(0..)
            .filter(|(shown, _)| shown.is_none());
        let stuck = stuck.fold(0, |stuck, (_, index)| stuck | 0xFFFF_u32 << (16 * index));
        let mut sensed = Sensed {
            stuck,
            panel: self.pins().ok(),
            analogs: [None; 2],
        };
        for ((index, address), value) in analogs().zip(&mut sensed.analogs) {
            let mut word = [0; 2];
            let done = self.bus.read(address, &[TEMPERATURE], &mut word);
            self.note(AI + index, done);
            *value = done.ok().map(|()| i16::from_be_bytes(word) >> 4);
        }
        sensed
    }

    /// The chips that did not answer last time.
    pub fn missing(&self) -> impl Iterator<Item = &'static str> {
        let missing = self.missing;
        let named = NAMES.iter().zip([1u8, 2, 4, 8, 16]);
        named.filter_map(move |(name, bit)| (missing & bit != 0).then_some(*name))
    }

    fn pins(&mut self) -> Result<Pinned, Absent> {
        let mut bits = [0; 4];
        // What drives the pins, not their state: QEMU before 9.0 has that inverted.
        let done = self.bus.read(INPUTS, &[SELECTORS], &mut bits);
        self.note(IN, done);
        done?;
        let low = pulled_low(bits);
        Ok(Pinned {
            levels: u32::from(!low & 0xFF),
            dip: (low >> 8 & 0x1F) as u8,
            init_grounded: low >> 15 == 1,
        })
    }

    fn note(&mut self, chip: usize, done: Result<(), Absent>) {
        let bit = 1 << chip;
        self.missing = self.missing & !bit | if done.is_err() { bit } else { 0 };
    }
}

/// The analog input chips of this family.
fn analogs() -> impl Iterator<Item = (usize, u8)> {
    let count = crate::FAMILY.profile().analogs;
    ANALOGS.into_iter().enumerate().take(usize::from(count))
}

/// Two bits for each LED: 00 on, 01 off.
fn selectors(on: u16) -> [u8; 4] {
    let mut bits = 0u32;
    for led in 0..16 {
        bits |= u32::from(!on >> led & 1) << (2 * led);
    }
    bits.to_le_bytes()
}

/// Bit n = LED n is on, which is the pin pulled low.
fn pulled_low(selectors: [u8; 4]) -> u16 {
    let bits = u32::from_le_bytes(selectors);
    (0..16).fold(0, |low, led| {
        low | u16::from(bits >> (2 * led) & 3 == 0) << led
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_led_has_two_bits() {
        assert_eq!(selectors(0), [0x55; 4], "all off, as after a reset");
        assert_eq!(selectors(0xFFFF), [0; 4]);
        assert_eq!(selectors(0b1000_0000_0000_0010), [0x51, 0x55, 0x55, 0x15]);
        for on in [0, 1, 0x8000, 0xA5F0, 0xFFFF] {
            assert_eq!(pulled_low(selectors(on)), on);
        }
    }
}
