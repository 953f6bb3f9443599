//! The module itself, as one state machine: the simulated module and the firmware alike.
//!
//! The driver hands in what happens ([`Engine::handle`]) and then drains what the module does
//! ([`Engine::poll`]) until it says [`Output::Wait`]; each `Wait` replaces the deadline before
//! it. What all families share is here; each family's own behaviour is in its room.

mod receiver;
mod state;
mod timers;

use crate::extensions::{self, count};
use crate::{Extensions, Family, Setup, SetupError, eda, emd2a2q, erc8, r55};
use railbus_wire::{
    Address, Frame, Instant, Micros, Protocol, PulseWidth, Settings, ascii, lc02, rtu,
};
use receiver::Receiver;
pub(crate) use state::DeviceState;

/// What a module keeps while it has no power. Outputs are not kept [EDA §1.6].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Eeprom {
    /// Its address.
    pub address: Address,
    /// Speed and character format.
    pub serial: Settings,
    /// The protocol it speaks. Not on any wire: the maker's software writes it.
    pub protocol: Protocol,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
    /// Bit n = output n gives pulses (EDA9060A).
    pub pulse_mask: u8,
    /// The width of all pulses (EDA9060A).
    pub pulse_width: PulseWidth,
    /// How the analog inputs are calibrated (EMD-2A2Q).
    pub calibration: Calibration,
    /// What it does beyond its datasheet.
    pub extensions: Extensions,
}

/// How an EMD-2A2Q turns what it measures into what it reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Calibration {
    /// Register 4: the voltage applied for the span step, in hundredths.
    pub voltage: u16,
    /// What each input measured at the zero step, in hundredths.
    pub zero: [i16; 2],
    /// What each input measured above zero at the span step, in hundredths, and the voltage
    /// that then was applied; equal numbers change nothing.
    pub span: [(u16, u16); 2],
}

impl Calibration {
    /// As the module leaves the factory: 5.00 V, and readings as measured.
    pub const NEUTRAL: Calibration = Calibration {
        voltage: 500,
        zero: [0; 2],
        span: [(500, 500); 2],
    };
}

impl Eeprom {
    /// The settings that make a module be as described.
    #[must_use]
    pub const fn of(setup: &Setup) -> Eeprom {
        Eeprom {
            address: setup.address,
            serial: setup.serial,
            protocol: setup.protocol,
            checksum: setup.checksum,
            pulse_mask: 0,
            pulse_width: PulseWidth::DEFAULT,
            calibration: Calibration::NEUTRAL,
            extensions: Extensions::NEUTRAL,
        }
    }
}

/// When a change of address, speed, parity or checksum takes effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Applies {
    /// After the last stop bit of the reply, which is still sent in the old way.
    #[default]
    AfterReply,
    /// At the next power-up.
    AfterRestart,
    /// The address after the reply, the rest at the next power-up.
    AddressAfterReply,
}

/// Switches for what the datasheets leave open. The defaults are the choices of
/// `docs/datasheets`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// From the end of a request to the reply, on top of what recognising the end of a frame
    /// takes.
    pub turnaround: Micros,
    /// When changed settings take effect.
    pub applies: Applies,
    /// EDA modules answer Modbus exceptions, and `?AA` in ASCII, instead of staying silent.
    pub refuse_aloud: bool,
    /// ASCII hexadecimal digits a to f are taken.
    pub lower_case: bool,
    /// ERC-8 and EMD-2A2Q answer exception 08 to a wrong CRC, and 04 to a bad character.
    pub answer_bad_frames: bool,
    /// Requests that follow earlier traffic sooner than the family's gap are not heard.
    pub insist_on_gap: bool,
    /// The module does what is beyond its datasheet: all of `docs/datasheets/beyond.md`.
    pub extensions: bool,
}

/// What happens to a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Characters heard on the line; the last one ended now.
    Bytes(&'a [u8]),
    /// A character with a wrong stop bit or parity ended now.
    BadByte,
    /// A character was lost, since the one before it was not fetched in time; it ended now.
    Overrun,
    /// The deadline of [`Output::Wait`] has come.
    Timeout,
    /// The last stop bit of the reply has left.
    Sent,
    /// The levels at the digital inputs: bit n = input n is high or open.
    Levels(u32),
    /// What lies at an analog input, in hundredths of its unit.
    Analog(u8, i16),
    /// The INIT* pin of an EDA9050 is grounded.
    Init(bool),
    /// The DIP switch of a 0x55 board; 0 leaves the address to the EEPROM.
    Dip(u8),
    /// Outputs that stay as they are whatever the module is told: bit n = output n.
    Stuck(u32),
}

/// What the driver has to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output<'a> {
    /// Send these bytes now, and say [`Input::Sent`] when they have left.
    Transmit(&'a [u8]),
    /// Change something outside.
    Effect(Effect),
    /// Nothing more until the deadline, or until something happens.
    Wait(Option<Instant>),
}

/// A change outside the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Output `channel`, 0-based, is now on or off.
    Output {
        /// Which output.
        channel: u8,
        /// Pulled in or conducting.
        on: bool,
    },
    /// The LED is now lit or dark.
    Led(bool),
    /// Listen and send this way from now on.
    Serial(Settings),
    /// Keep this over a loss of power.
    Save(Eeprom),
}

/// A module.
#[derive(Clone, Debug)]
pub struct Engine {
    state: DeviceState,
    receiver: Receiver,
    reply: Frame,
    /// When the reply goes out.
    reply_at: Option<Instant>,
    /// The reply is on its way, and nothing is heard or written into its frame until it has left.
    sending: bool,
    /// It is on its way, and the driver has not got it yet.
    unsent: bool,
    reported: Reported,
    now: Instant,
}

/// What the driver was told last.
#[derive(Clone, Copy, Debug)]
struct Reported {
    outputs: u32,
    led: Option<bool>,
    serial: Settings,
    eeprom: Eeprom,
}

impl Engine {
    /// A module that is powered up now with these settings. All outputs are off
    /// [EDA §1.6].
    ///
    /// # Errors
    /// Where no module of the family can be as described.
    pub fn new(
        setup: &Setup,
        eeprom: Eeprom,
        options: Options,
        now: Instant,
    ) -> Result<Engine, SetupError> {
        setup.check_built()?;
        Ok(Engine {
            state: DeviceState::new(setup, eeprom, options, now),
            receiver: Receiver::new(now),
            reply: Frame::new(),
            reply_at: None,
            sending: false,
            unsent: false,
            reported: Reported {
                outputs: 0,
                led: None,
                serial: eeprom.serial,
                eeprom,
            },
            now,
        })
    }

    /// Tells the module what happened, and when. Time never runs backwards.
    pub fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.now = now;
        // A driver that is late hands in what happened after a pulse had ended.
        self.state.run_timers(now);
        match input {
            Input::Bytes(bytes) if !self.sending => self.hear(bytes),
            Input::BadByte if !self.sending => self.hear_bad_byte(),
            Input::Overrun if !self.sending => {
                count(&mut self.state.counters.overruns);
                self.hear_bad_byte();
            }
            Input::Bytes(_) | Input::BadByte | Input::Overrun => {}
            Input::Timeout => self.end_frame_if_silent(),
            Input::Sent if !self.sending => {}
            Input::Sent => {
                (self.sending, self.unsent) = (false, false);
                self.receiver.line_was_busy(now);
                self.state.apply();
            }
            Input::Levels(levels) => self.state.set_levels(levels),
            Input::Analog(channel, value) => self.state.set_analog(channel, value),
            Input::Init(grounded) => self.state.init_pin = grounded,
            Input::Dip(dip) => self.state.dip = dip,
            Input::Stuck(mask) => self.state.stuck = mask,
        }
    }

    /// The next thing to do; [`Output::Wait`] when there is nothing more.
    pub fn poll(&mut self) -> Output<'_> {
        if let Some(effect) = self.next_effect() {
            return Output::Effect(effect);
        }
        if self.reply_at.is_some_and(|at| at <= self.now) && !self.sending {
            self.reply_at = None;
            (self.sending, self.unsent) = (true, true);
            // Half duplex: what is being heard while it begins to talk is lost.
            self.receiver.clear();
        }
        if let Some(lit) = self.led_change() {
            return Output::Effect(Effect::Led(lit));
        }
        if core::mem::take(&mut self.unsent) {
            return Output::Transmit(self.reply.bytes());
        }
        Output::Wait(self.deadline())
    }

    /// The outputs as they are: bit n = output n is on.
    #[must_use]
    pub const fn outputs(&self) -> u32 {
        self.state.outputs
    }

    /// The settings in force, which may differ from those kept.
    #[must_use]
    pub const fn active(&self) -> &Eeprom {
        &self.state.active
    }

    /// The address in force: that of the DIP switch, where one gives it.
    #[must_use]
    pub const fn address(&self) -> Address {
        self.state.address()
    }

    /// The protocol in force: that of the INIT* pin, where it chooses.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        self.state.protocol()
    }

    /// The settings kept.
    #[must_use]
    pub const fn eeprom(&self) -> &Eeprom {
        &self.state.eeprom
    }

    fn next_effect(&mut self) -> Option<Effect> {
        let changed = self.state.outputs ^ self.reported.outputs;
        if changed != 0 {
            let channel = changed.trailing_zeros();
            self.reported.outputs ^= 1 << channel;
            let on = self.state.outputs >> channel & 1 == 1;
            return Some(Effect::Output {
                channel: channel as u8,
                on,
            });
        }
        if self.state.eeprom != self.reported.eeprom {
            self.reported.eeprom = self.state.eeprom;
            return Some(Effect::Save(self.state.eeprom));
        }
        if self.state.active.serial != self.reported.serial {
            self.reported.serial = self.state.active.serial;
            return Some(Effect::Serial(self.state.active.serial));
        }
        None
    }

    fn led_change(&mut self) -> Option<bool> {
        let lit = self.state.led(self.now, self.sending);
        (self.reported.led != Some(lit)).then(|| {
            self.reported.led = Some(lit);
            lit
        })
    }

    fn deadline(&self) -> Option<Instant> {
        let reply_at = self.reply_at.filter(|_| !self.sending);
        let led = self.state.led_deadline(self.now).filter(|_| !self.sending);
        let frame_end = self.frame_end();
        Instant::earliest(&[reply_at, led, frame_end, self.state.timer_deadline()])
    }

    /// When silence will have ended the frame being heard.
    fn frame_end(&self) -> Option<Instant> {
        let silence = self.state.active.serial.t3_5();
        let open = self.state.protocol() == Protocol::Rtu && self.receiver.has_frame();
        open.then(|| self.receiver.last + silence)
    }

    fn end_frame_if_silent(&mut self) {
        if self.frame_end().is_some_and(|end| end <= self.now) {
            self.end_frame();
        }
    }

    /// So many characters end now. The frame before them ends first if they began after its
    /// silence: a driver that is late hands in both at once.
    fn begin_hearing(&mut self, characters: usize) {
        let took = self.state.active.serial.frame_time(characters);
        let began = Instant(self.now.0.saturating_sub(took.0));
        if self.frame_end().is_some_and(|end| end <= began) {
            self.end_frame();
        }
        // The INIT* pin acts between frames [EDA9050 §2.3]: when none is open, or the one that
        // is was given up by its sender.
        let silence = self.receiver.silence_before(self.now, took);
        if !self.receiver.has_frame() || silence >= self.state.request_gap() {
            self.state.follow_init_pin();
        }
        let gap = self.state.insisted_gap();
        self.receiver.begin(self.now, took, gap);
    }

    fn hear_bad_byte(&mut self) {
        self.begin_hearing(1);
        self.receiver.bad_byte(self.state.protocol(), self.now);
    }

    fn hear(&mut self, bytes: &[u8]) {
        let serial = self.state.active.serial;
        for (&byte, left) in bytes.iter().zip((1..=bytes.len()).rev()) {
            self.begin_hearing(left);
            match self.state.protocol() {
                Protocol::Rtu => self.receiver.push(byte),
                Protocol::Ascii => self.hear_ascii(byte),
                Protocol::Lc02 => self.hear_lc02(byte),
                Protocol::R55 => self.hear_r55(byte),
            }
            let later = serial.frame_time(left - 1);
            self.receiver.last = Instant(self.now.0.saturating_sub(later.0));
        }
    }

    fn hear_ascii(&mut self, byte: u8) {
        let rules = ascii::Rules {
            checksum: self.state.active.checksum,
            lower_case: self.state.options.lower_case,
        };
        let Some(decoded) = self.receiver.push_ascii(byte, rules) else {
            return;
        };
        self.begin_reply();
        match decoded {
            Ok(exchange) => {
                let (state, now, reply) = (&mut self.state, self.now, &mut self.reply);
                let own = !exchange.request.is_broadcast() && state.hears(exchange.address);
                if own || exchange.request == ascii::Request::HostOk {
                    state.feed(now);
                }
                if !extensions::ascii(state, now, &exchange, reply) {
                    eda::ascii(state, now, &exchange, reply);
                }
            }
            Err(address) => eda::refuse_ascii(&self.state, address, &mut self.reply),
        }
        self.schedule_reply();
    }

    fn hear_lc02(&mut self, byte: u8) {
        self.receiver.push(byte);
        while let Some(exchange) = self.receiver.take(lc02::Exchange::decode_request) {
            self.begin_reply();
            if self.state.hears(exchange.address) {
                self.state.feed(self.now);
            }
            eda::lc02(&mut self.state, self.now, &exchange, &mut self.reply);
            self.schedule_reply();
        }
    }

    fn hear_r55(&mut self, byte: u8) {
        self.receiver.push(byte);
        let mut answered = self.reply_at.is_some();
        while let Some(frame) = self.receiver.take(r55::decode_frame) {
            if let Some(exchange) = frame {
                if self.state.hears(exchange.address()) {
                    self.state.feed(self.now);
                }
                answered |= r55::answer(&mut self.state, self.now, &exchange, &mut self.reply);
            }
        }
        if answered {
            // Requests need no gap between them, so that only silence shows which was the last,
            // and only that one is answered [R55 §3.12].
            let silence = self.state.active.serial.t1_5();
            self.reply_at = Some(self.now + silence + self.state.options.turnaround);
        } else {
            self.state.apply();
        }
    }

    /// Silence has ended a Modbus frame.
    fn end_frame(&mut self) {
        let ended = self.receiver.end_frame();
        if !ended.heard_rightly {
            self.state.count_error(ended.too_long);
            self.receiver.clear();
            return;
        }
        self.begin_reply();
        let (state, reply, frame) = (&mut self.state, &mut self.reply, self.receiver.frame());
        match rtu::Exchange::decode_frame(frame) {
            _ if ended.bad_byte => {
                state.count_error(true);
                state.answer_bad_frame(frame, rtu::Exception::FAILURE, reply);
            }
            Err(rtu::RequestError::Garbled) => {
                state.count_error(true);
                state.answer_bad_frame(frame, rtu::Exception::CHECKSUM, reply);
            }
            Ok(exchange) => {
                let own = state.begin_message(self.now, exchange.address);
                answer_rtu(state, self.now, &exchange, reply);
                state.end_message(own, reply);
            }
            Err(error) => {
                let refusal = error.exception();
                let own =
                    refusal.is_some_and(|(address, ..)| state.begin_message(self.now, address));
                state.refuse_rtu(refusal, reply);
                state.end_message(own, reply);
            }
        }
        self.receiver.clear();
        self.schedule_reply();
    }

    /// A new request was heard: a reply that has not left yet is dropped.
    fn begin_reply(&mut self) {
        self.reply.clear();
        self.reply_at = None;
    }

    fn schedule_reply(&mut self) {
        if self.reply.bytes().is_empty() {
            // Nobody is answered, so there is no last stop bit to wait for.
            self.state.apply();
        } else {
            self.reply_at = Some(self.now + self.state.options.turnaround);
        }
    }
}

/// Carries out a Modbus request, beyond the datasheet or as the family does.
fn answer_rtu(
    state: &mut DeviceState,
    now: Instant,
    exchange: &rtu::Exchange<'_>,
    reply: &mut Frame,
) {
    if extensions::rtu(state, now, exchange, reply) {
        return;
    }
    match state.family() {
        Family::Eda9060a | Family::Eda9050 => eda::rtu(state, now, exchange, reply),
        Family::Erc8 => erc8::answer(state, exchange, reply),
        Family::Emd2a2q => emd2a2q::answer(state, now, exchange, reply),
        Family::R55 => {}
    }
}
