//! The state of a module apart from receiving and sending, and what every family does with it.

use super::timers::Timers;
use super::{Applies, Eeprom, Options};
use crate::extensions::Counters;
use crate::{Family, Setup, eda9050, eda9060a, emd2a2q, erc8, r55};
use railbus_wire::{Address, Channel, Frame, Instant, Micros, Protocol, rtu};

/// The state that all families work on.
#[derive(Clone, Debug)]
pub(crate) struct DeviceState {
    pub(crate) setup: Setup,
    pub(crate) options: Options,
    /// The stored settings.
    pub(crate) eeprom: Eeprom,
    /// The active settings: as stored at power-up, updated by [`DeviceState::apply`].
    pub(crate) active: Eeprom,
    /// Bit n = output n is on.
    pub(crate) outputs: u32,
    /// Bit n = output n is stuck.
    pub(crate) stuck: u32,
    /// Bit n = input n is high or open. An open input reads high
    /// [EDA9060A §1.5, EDA9050 §1.4].
    pub(crate) levels: u32,
    /// The values at the analog inputs, in hundredths.
    pub(crate) analogs: [i16; 2],
    /// Internal variables of a programmable board.
    pub(crate) variables: [u32; r55::VARIABLES],
    /// The level of the INIT* pin.
    pub(crate) init_pin: bool,
    /// The level that determines the active protocol.
    init_grounded: bool,
    pub(crate) dip: u8,
    pub(crate) started: Instant,
    /// A calibration step of an EMD-2A2Q: the bits of register 5, and when it ends.
    pub(crate) calibrating: Option<(u16, Instant)>,
    /// When the host watchdog trips, if it is enabled.
    pub(crate) watched_until: Option<Instant>,
    pub(crate) counters: Counters,
    /// A change waits for the reply's last stop bit.
    changed: bool,
    timers: Timers,
}

impl DeviceState {
    pub(super) fn new(
        setup: &Setup,
        eeprom: Eeprom,
        options: Options,
        now: Instant,
    ) -> DeviceState {
        DeviceState {
            setup: *setup,
            options,
            eeprom,
            active: eeprom,
            outputs: eeprom.extensions.outputs_at_power_up(options) & setup.output_mask(),
            stuck: 0,
            levels: setup.input_mask(),
            analogs: [0; 2],
            variables: [0; r55::VARIABLES],
            init_pin: setup.protocol == Protocol::Lc02,
            init_grounded: setup.protocol == Protocol::Lc02,
            dip: 0,
            started: now,
            calibrating: None,
            watched_until: eeprom.extensions.watched_until(options, now),
            counters: Counters::default(),
            changed: false,
            timers: Timers::NONE,
        }
    }

    /// Its family: a constant if only one is built, so that the compiler removes the code of the
    /// others.
    pub(crate) const fn family(&self) -> Family {
        match Family::ONLY {
            Some(only) => only,
            None => self.setup.family,
        }
    }

    /// The active address.
    pub(crate) const fn address(&self) -> Address {
        match (self.family(), self.dip) {
            (Family::R55, 1..) => Address(self.dip),
            _ => self.active.address,
        }
    }

    /// The active protocol: on an EDA9050 the INIT* pin chooses between two of the three.
    pub(crate) const fn protocol(&self) -> Protocol {
        match (self.family(), self.active.protocol) {
            (Family::Erc8 | Family::Emd2a2q, _) => Protocol::Rtu,
            (Family::R55, _) => Protocol::R55,
            (Family::Eda9050, Protocol::Ascii | Protocol::Lc02) => {
                eda9050::protocol_by_pin(self.init_grounded)
            }
            (_, Protocol::Ascii) => Protocol::Ascii,
            (_, Protocol::Lc02) => Protocol::Lc02,
            // No EDA module stores the last: only its own requests change what it stores.
            (_, Protocol::Rtu | Protocol::R55) => Protocol::Rtu,
        }
    }

    pub(crate) fn set_levels(&mut self, levels: u32) {
        self.levels = levels & self.setup.input_mask();
    }

    pub(crate) fn set_analog(&mut self, channel: u8, value: i16) {
        if let Some(analog) = self.analogs.get_mut(usize::from(channel)) {
            *analog = value;
        }
    }

    /// The stored settings, for a change; they become active after the reply.
    pub(crate) const fn keep(&mut self) -> &mut Eeprom {
        self.changed = true;
        &mut self.eeprom
    }

    /// Activates stored settings, as far as they do not need a restart.
    pub(super) fn apply(&mut self) {
        if !core::mem::take(&mut self.changed) {
            return;
        }
        let Eeprom {
            address,
            serial,
            protocol,
            checksum,
            ..
        } = self.active;
        self.active = self.eeprom;
        if self.options.applies == Applies::AfterRestart {
            self.active.address = address;
        }
        if self.options.applies != Applies::AfterReply {
            self.active.serial = serial;
            self.active.protocol = protocol;
            self.active.checksum = checksum;
        }
    }

    /// Switches the outputs of the mask, unless the host watchdog has tripped, and cancels their
    /// timers.
    pub(crate) fn switch(&mut self, mask: u32, on: u32) {
        if !self.is_locked() {
            self.set_outputs(mask, on);
        }
    }

    /// Switches the outputs of the mask even if the watchdog has tripped.
    pub(crate) fn set_outputs(&mut self, mask: u32, on: u32) {
        let mask = mask & self.setup.output_mask();
        self.drive(mask, on);
        self.timers.stop(mask);
    }

    /// Switches an output now and back after `time`; a time of zero means the end state at once.
    pub(crate) fn switch_for(&mut self, now: Instant, channel: Channel, on: bool, time: Micros) {
        let instant = if time == Micros::ZERO { !on } else { on };
        self.switch(channel.mask(), if instant { channel.mask() } else { 0 });
        let is_ours = self.setup.output_mask() & channel.mask() != 0 && !self.is_locked();
        if time != Micros::ZERO && is_ours {
            self.timers.start(channel, now + time, !on);
        }
    }

    pub(super) fn run_timers(&mut self, now: Instant) {
        let (over, on) = self.timers.over(now);
        self.drive(over, on);
        self.run_watchdog(now);
        if matches!(self.family(), Family::Emd2a2q) {
            emd2a2q::run_calibration(self, now);
        }
    }

    /// Switches outputs, except those that are stuck.
    const fn drive(&mut self, mask: u32, on: u32) {
        let mask = mask & !self.stuck;
        self.outputs = self.outputs & !mask | on & mask;
    }

    pub(super) fn timer_deadline(&self) -> Option<Instant> {
        let calibrated_at = match self.family() {
            Family::Emd2a2q => self.calibrating.map(|(_, at)| at),
            _ => None,
        };
        Instant::earliest(&[self.timers.next(), calibrated_at, self.watched_until])
    }

    /// The LED: the datasheets of the two EDA modules describe it, the others' is always on
    /// [EDA9060A §1.6, EDA9050 §1.8].
    pub(super) const fn led(&self, now: Instant, sending: bool) -> bool {
        match self.family() {
            Family::Eda9060a => eda9060a::led(now.since(self.started), sending),
            Family::Eda9050 => eda9050::led(sending),
            Family::Erc8 | Family::R55 | Family::Emd2a2q => true,
        }
    }

    pub(super) fn led_deadline(&self, now: Instant) -> Option<Instant> {
        match self.family() {
            Family::Eda9060a => Some(now + eda9060a::led_holds(now.since(self.started))),
            _ => None,
        }
    }

    /// The gap before a request that this module enforces.
    pub(super) fn insisted_gap(&self) -> Micros {
        match self.options.insist_on_gap {
            true if self.family() != Family::R55 => self.request_gap(),
            _ => Micros::ZERO,
        }
    }

    /// The gap that a host leaves before a request, with the active settings.
    pub(super) fn request_gap(&self) -> Micros {
        let (protocol, serial) = (self.protocol(), self.active.serial);
        self.setup.gap_of(self.family().profile(), protocol, serial)
    }

    /// Applies the present level of the INIT* pin.
    pub(super) const fn follow_init_pin(&mut self) {
        self.init_grounded = self.init_pin;
    }

    /// Refuses a Modbus request with an exception, if the family has exceptions and the request is
    /// addressed to this module alone.
    pub(crate) fn refuse_rtu(
        &self,
        refusal: Option<(Address, u8, rtu::Exception)>,
        reply: &mut Frame,
    ) {
        let aloud = match self.family() {
            Family::Erc8 | Family::Emd2a2q => true,
            // Extensions are refused as in the standard [BEYOND §3.4].
            _ if self.options.extensions && refusal.is_some_and(|(_, code, _)| is_beyond(code)) => {
                true
            }
            Family::Eda9060a | Family::Eda9050 | Family::R55 => self.options.refuse_aloud,
        };
        if let Some((address, code, why)) = refusal
            && aloud
            && address == self.address()
            && address != rtu::BROADCAST
        {
            let absent = match self.family() {
                Family::Erc8 => erc8::ABSENT,
                Family::Emd2a2q => emd2a2q::ABSENT,
                Family::Eda9060a => eda9060a::ABSENT,
                Family::Eda9050 => eda9050::ABSENT,
                Family::R55 => &[],
            };
            // An unsupported function is refused before its quantity is checked [MODBUS §3.5].
            let is_absent = absent.iter().any(|function| function.code() == code)
                || is_beyond(code) && !self.options.extensions;
            let why = if is_absent {
                rtu::Exception::FUNCTION
            } else {
                why
            };
            rtu::encode_exception(address, code, why, reply);
        }
    }

    /// Answers a corrupted frame: with silence, or with an exception if that option is on and the
    /// frame names this module [ERC-8 §5.8, §5.9].
    pub(super) fn answer_bad_frame(&self, frame: &[u8], why: rtu::Exception, reply: &mut Frame) {
        let listed = matches!(self.family(), Family::Erc8 | Family::Emd2a2q);
        if let &[address, code, ..] = frame
            && listed
            && self.options.answer_bad_frames
            && Address(address) == self.address()
        {
            rtu::encode_exception(self.address(), code, why, reply);
        }
    }

    /// Whether a request with this address is for this module, or a broadcast.
    pub(crate) fn hears(&self, address: Address) -> bool {
        let broadcast = match self.protocol() {
            Protocol::Rtu => address == rtu::BROADCAST,
            Protocol::R55 => address == railbus_wire::r55::BROADCAST,
            Protocol::Ascii | Protocol::Lc02 => false,
        };
        address == self.address() || broadcast
    }

    /// The code of the stored baud rate.
    pub(crate) fn baud_code(&self) -> Option<u8> {
        self.family().profile().baud_code(self.eeprom.serial.baud)
    }
}

/// A function that is in no datasheet, but that our own modules have [MODBUS §2.10].
const fn is_beyond(code: u8) -> bool {
    matches!(
        rtu::Function::from_code(code),
        Some(rtu::Function::Diagnose | rtu::Function::Identify)
    )
}
