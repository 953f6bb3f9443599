//! The module itself as a state machine: both the simulated module and the firmware.
//!
//! The driver passes in what happens ([`Engine::handle`]) and then drains [`Engine::poll`] until it
//! returns [`Output::Wait`]; each `Wait` replaces the previous deadline. What all families share is
//! here; each family's own behaviour is in its module.

mod receiver;
mod state;
mod timers;

use crate::extensions::{self, count};
use crate::{Extensions, Family, Setup, SetupError, eda, emd2a2q, erc8, r55};
use railbus_wire::{
    Address, Frame, Instant, Micros, Protocol, PulseWidth, SerialSettings, ascii, lc02, rtu,
};
use receiver::Receiver;
pub(crate) use state::DeviceState;

/// What a module stores in non-volatile memory. Outputs are not stored [EDA §1.6].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Eeprom {
    /// Its address.
    pub address: Address,
    /// Speed and character format.
    pub serial: SerialSettings,
    /// The protocol it uses. No frame can set it: the maker's software does.
    pub protocol: Protocol,
    /// Its ASCII frames carry a checksum.
    pub checksum: bool,
    /// Bit n = output n gives pulses (EDA9060A).
    pub pulse_mask: u8,
    /// The width of all pulses (EDA9060A).
    pub pulse_width: PulseWidth,
    /// The calibration of the analog inputs (EMD-2A2Q).
    pub calibration: AnalogCalibration,
    /// What it does beyond its datasheet.
    pub extensions: Extensions,
}

/// How an EMD-2A2Q converts measured into reported values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnalogCalibration {
    /// Register 4: the voltage applied for the span step, in hundredths.
    pub voltage: u16,
    /// What each input measured at the zero step, in hundredths.
    pub zero: [i16; 2],
    /// What each input measured above zero at the span step, in hundredths, and the voltage applied
    /// then; equal numbers change nothing.
    pub span: [(u16, u16); 2],
}

impl AnalogCalibration {
    /// The factory state: 5.00 V, and readings as measured.
    pub const NEUTRAL: AnalogCalibration = AnalogCalibration {
        voltage: 500,
        zero: [0; 2],
        span: [(500, 500); 2],
    };
}

impl Eeprom {
    /// The settings of a module with this setup.
    #[must_use]
    pub const fn of(setup: &Setup) -> Eeprom {
        Eeprom {
            address: setup.address,
            serial: setup.serial,
            protocol: setup.protocol,
            checksum: setup.checksum,
            pulse_mask: 0,
            pulse_width: PulseWidth::DEFAULT,
            calibration: AnalogCalibration::NEUTRAL,
            extensions: Extensions::NEUTRAL,
        }
    }
}

/// When a change of address, speed, parity or checksum takes effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Applies {
    /// After the last stop bit of the reply, which is still sent with the old settings.
    #[default]
    AfterReply,
    /// At the next power-up.
    AfterRestart,
    /// The address after the reply, the rest at the next power-up.
    AddressAfterReply,
}

/// Options for what the datasheets leave open. The defaults are the choices in `docs/datasheets`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// From the end of a request to the reply, in addition to the time to recognise the end of a
    /// frame.
    pub turnaround: Micros,
    /// When changed settings take effect.
    pub applies: Applies,
    /// EDA modules reply with Modbus exceptions, and with `?AA` in ASCII, instead of staying
    /// silent.
    pub refuse_aloud: bool,
    /// ASCII hexadecimal digits a to f are accepted.
    pub lower_case: bool,
    /// ERC-8 and EMD-2A2Q reply with exception 08 to a wrong CRC, and with 04 to a bad character.
    pub answer_bad_frames: bool,
    /// Requests that follow earlier traffic sooner than the family's gap are ignored.
    pub insist_on_gap: bool,
    /// The extensions are on: all of `docs/datasheets/beyond.md`.
    pub extensions: bool,
}

/// An input of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Characters were received; the last one ended now.
    Bytes(&'a [u8]),
    /// A character with a wrong stop bit or parity ended now.
    BadByte,
    /// A character was lost because the one before it was not read in time; it ended now.
    Overrun,
    /// The deadline of [`Output::Wait`] has come.
    Timeout,
    /// The last stop bit of the reply has been sent.
    Sent,
    /// The levels at the digital inputs: bit n = input n is high or open.
    Levels(u32),
    /// The value at an analog input, in hundredths of its unit.
    Analog(u8, i16),
    /// The INIT* pin of an EDA9050 is grounded.
    Init(bool),
    /// The DIP switch of a 0x55 board; 0 means that the address comes from the EEPROM.
    Dip(u8),
    /// Outputs that are stuck, whatever the commands: bit n = output n.
    Stuck(u32),
}

/// What the driver has to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output<'a> {
    /// Send these bytes now, and pass in [`Input::Sent`] when they have been sent.
    Transmit(&'a [u8]),
    /// Change something outside the module.
    Effect(Effect),
    /// Nothing more to do until the deadline, or until something happens.
    Wait(Option<Instant>),
}

/// An effect outside the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Output `channel`, 0-based, is now on or off.
    Output {
        /// Which output.
        channel: u8,
        /// Pulled in or conducting.
        on: bool,
    },
    /// The LED is now on or off.
    Led(bool),
    /// Use these settings from now on.
    Serial(SerialSettings),
    /// Store this in non-volatile memory.
    Save(Eeprom),
}

/// A module.
#[derive(Clone, Debug)]
pub struct Engine {
    state: DeviceState,
    receiver: Receiver,
    reply: Frame,
    /// When the reply is sent.
    reply_at: Option<Instant>,
    /// The reply is being sent; until it has been, nothing is received or written into its frame.
    sending: bool,
    /// It is being sent, and the driver has not fetched it yet.
    unsent: bool,
    reported: Reported,
    now: Instant,
}

/// The last state passed to the driver.
#[derive(Clone, Copy, Debug)]
struct Reported {
    outputs: u32,
    led: Option<bool>,
    serial: SerialSettings,
    eeprom: Eeprom,
}

impl Engine {
    /// A module powered up now with these settings. All outputs are off [EDA §1.6].
    ///
    /// # Errors
    /// If the setup is not possible for the family.
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

    /// Passes in what happened, and when. Time never runs backwards.
    pub fn handle(&mut self, now: Instant, input: Input<'_>) {
        self.now = now;
        // A late driver passes in what happened after a pulse had ended.
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
            // Half duplex: what is being received when it starts to send is lost.
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

    /// The present outputs: bit n = output n is on.
    #[must_use]
    pub const fn outputs(&self) -> u32 {
        self.state.outputs
    }

    /// The active settings, which may differ from the stored ones.
    #[must_use]
    pub const fn active(&self) -> &Eeprom {
        &self.state.active
    }

    /// The active address: the DIP switch's, if it sets one.
    #[must_use]
    pub const fn address(&self) -> Address {
        self.state.address()
    }

    /// The active protocol: the one that the INIT* pin selects, if it selects one.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        self.state.protocol()
    }

    /// The stored settings.
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

    /// When silence will end the frame being received.
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

    /// This many characters end now. The previous frame ends first if they began after its silence:
    /// a late driver passes in both at once.
    fn begin_hearing(&mut self, characters: usize) {
        let took = self.state.active.serial.frame_time(characters);
        let began = Instant(self.now.0.saturating_sub(took.0));
        if self.frame_end().is_some_and(|end| end <= began) {
            self.end_frame();
        }
        // The INIT* pin takes effect between frames [EDA9050 §2.3]: when no frame is open, or when
        // its sender has abandoned it.
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
        let rules = ascii::DecodeRules {
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
            // Requests need no gap between them, so only silence shows which was the last, and only
            // that one is answered [R55 §3.12].
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

    /// A new request was received: a reply that has not been sent yet is dropped.
    fn begin_reply(&mut self) {
        self.reply.clear();
        self.reply_at = None;
    }

    fn schedule_reply(&mut self) {
        if self.reply.bytes().is_empty() {
            // There is no reply, so there is no last stop bit to wait for.
            self.state.apply();
        } else {
            self.reply_at = Some(self.now + self.state.options.turnaround);
        }
    }
}

/// Executes a Modbus request, as an extension or as the family does.
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
