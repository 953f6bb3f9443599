//! What our own modules do beyond the datasheets: nothing, unless [`crate::Options::extensions`] is
//! on.
//!
//! The host watchdog works on the [`DeviceState`] of any family. It is set in ASCII by the commands
//! of DCON modules, in Modbus by registers and on 0x55 boards by variables; registers and variables
//! are the same few numbers. Modbus modules also report their identification and diagnostic
//! counters.

mod ascii;
mod counters;
mod rtu;

pub(crate) use ascii::answer as ascii;
pub(crate) use counters::{Counters, count};
pub(crate) use rtu::answer as rtu;

use crate::engine::{DeviceState, Options};
use railbus_wire::r55::{self, Request, Response, U24};
use railbus_wire::{Address, Instant, Micros};

/// The version that a module reports.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What a module stores for its extensions [BEYOND §1.3].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extensions {
    /// The host watchdog in tenths of a second, 0.1 s to 25.5 s; 0 disables it.
    pub watchdog: u8,
    /// Outputs at power-up: bit n = output n is on.
    pub power_on: u32,
    /// Outputs when the host watchdog trips: bit n = output n is on.
    pub safe: u32,
    /// The host watchdog has tripped and was not cleared yet.
    pub tripped: bool,
}

/// The settings as numbers: Modbus registers from [`rtu::FIRST`] on, variables of 0x55 boards from
/// [`FIRST_VARIABLE`] on [BEYOND §3.1, §3.6].
mod number {
    pub(super) const STATUS: u16 = 0;
    pub(super) const WATCHDOG: u16 = 1;
    pub(super) const POWER_ON: u16 = 2;
    pub(super) const POWER_ON_HIGH: u16 = 3;
    pub(super) const SAFE: u16 = 4;
    pub(super) const SAFE_HIGH: u16 = 5;
    /// How many numbers there are.
    pub(super) const COUNT: u16 = 6;
}

/// The variable of a 0x55 board for number 0 [BEYOND §3.6].
const FIRST_VARIABLE: u8 = 0xE0;

impl Extensions {
    /// The watchdog is disabled, and all outputs are off at power-up, as in the makers' modules.
    pub const NEUTRAL: Extensions = Extensions {
        watchdog: 0,
        power_on: 0,
        safe: 0,
        tripped: false,
    };

    /// The status: 04h it has tripped, 80h it is enabled [BEYOND §1.8].
    const fn status(self) -> u8 {
        let tripped = if self.tripped { 0x04 } else { 0 };
        let watches = if self.watchdog > 0 { 0x80 } else { 0 };
        tripped | watches
    }

    /// The outputs at power-up: as stored for that, or safe if the watchdog has tripped and was not
    /// cleared [BEYOND §1.5].
    pub(crate) const fn outputs_at_power_up(&self, options: Options) -> u32 {
        match (options.extensions, self.tripped) {
            (false, _) => 0,
            (true, false) => self.power_on,
            (true, true) => self.safe,
        }
    }

    /// When the watchdog trips if the host is not heard after now, if it is enabled.
    // Not inlined: called by every protocol.
    #[inline(never)]
    pub(crate) fn watched_until(&self, options: Options, now: Instant) -> Option<Instant> {
        let watches = options.extensions && self.watchdog > 0 && !self.tripped;
        let time = Micros::from_millis(100) * u64::from(self.watchdog);
        watches.then(|| now + time)
    }

    const fn number(self, number: u16) -> u16 {
        match number {
            number::STATUS => self.status() as u16,
            number::WATCHDOG => self.watchdog as u16,
            number::POWER_ON => self.power_on as u16,
            number::POWER_ON_HIGH => (self.power_on >> 16) as u16,
            number::SAFE => self.safe as u16,
            number::SAFE_HIGH => (self.safe >> 16) as u16,
            _ => 0,
        }
    }

    /// With one number written; none if it does not accept the value. Only 0 can be written to the
    /// status, which clears it [BEYOND §3.2].
    fn with(mut self, number: u16, value: u16) -> Option<Extensions> {
        let low = |of: u32| of & 0xFFFF_0000 | u32::from(value);
        let high = |of: u32| of & 0x0000_FFFF | u32::from(value) << 16;
        match number {
            number::STATUS if value == 0 => self.tripped = false,
            number::WATCHDOG => self.watchdog = u8::try_from(value).ok()?,
            number::POWER_ON => self.power_on = low(self.power_on),
            number::POWER_ON_HIGH => self.power_on = high(self.power_on),
            number::SAFE => self.safe = low(self.safe),
            number::SAFE_HIGH => self.safe = high(self.safe),
            _ => return None,
        }
        Some(self)
    }
}

impl DeviceState {
    /// The host is alive: restarts the watchdog, if it is enabled [BEYOND §1.1].
    pub(crate) fn feed(&mut self, now: Instant) {
        self.watched_until = self.eeprom.extensions.watched_until(self.options, now);
    }

    /// Sets the outputs to their safe states when the host was silent for too long. Pulses and jogs
    /// end [BEYOND §1.2, §1.6].
    pub(crate) fn run_watchdog(&mut self, now: Instant) {
        if self.watched_until.take_if(|at| *at <= now).is_some() {
            self.set_outputs(u32::MAX, self.eeprom.extensions.safe);
            self.eeprom.extensions.tripped = true;
        }
    }

    /// The watchdog has tripped: outputs are locked until that is cleared [BEYOND §1.4].
    pub(crate) const fn is_locked(&self) -> bool {
        self.options.extensions && self.eeprom.extensions.tripped
    }

    /// Stores new settings if the module has the outputs they name; returns whether it has.
    // Not inlined: called by two protocols whose code is large already.
    #[inline(never)]
    fn store_extensions(&mut self, now: Instant, extensions: Extensions) -> bool {
        let fits = (extensions.power_on | extensions.safe) & !self.setup.output_mask() == 0;
        if fits {
            self.keep().extensions = extensions;
            self.feed(now);
        }
        fits
    }
}

/// A 0x55 board: the variables that hold the settings. None if the request is for another variable;
/// the inner none means no reply [BEYOND §3.6, §3.7].
pub(crate) fn variable(
    state: &mut DeviceState,
    now: Instant,
    address: Address,
    request: Request,
) -> Option<Option<Response>> {
    let (Request::ReadVariable(index) | Request::WriteVariable(index, _)) = request else {
        return None;
    };
    let number = u16::from(index.checked_sub(FIRST_VARIABLE)?);
    if !state.options.extensions || number >= number::COUNT {
        return None;
    }
    Some(match request {
        Request::WriteVariable(_, value) if address != r55::BROADCAST => u16::try_from(value.get())
            .ok()
            .and_then(|value| state.eeprom.extensions.with(number, value))
            .filter(|extensions| state.store_extensions(now, *extensions))
            .map(|_| Response::variable(index, value)),
        Request::ReadVariable(_) => {
            let value = U24::new(state.eeprom.extensions.number(number).into());
            value.map(|value| Response::variable(index, value))
        }
        _ => None,
    })
}
