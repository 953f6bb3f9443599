//! Drives procedures on a simulated line in virtual time, and interrupts them at any act.

#![allow(unreachable_pub, reason = "the files of a test see each other")]

use railbus_commission::{
    DriverAction, Event, JournalRecord, Log, Procedure, ProcedureStep, Progress, Question, RxBytes,
    TimedExchange,
};
use railbus_device::{Eeprom, Family, Options, Setup};
use railbus_sim::{
    Act as Touch, Faults, Input, Output, Power, SlotId, VirtualLine, VirtualLineConfig,
};
use railbus_wire::{Address, Frame, Instant, Micros};

/// What fails at one act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// The host dies before the act.
    Before,
    /// The host dies in the middle: half a record is on the disk, or half a frame on the wire.
    Half,
    /// The host dies after the act's own part: the record is on the disk, or the request was
    /// received and its reply is not.
    After,
    /// The host goes on; the request is not received, or the record can't be written.
    Lost,
    /// The host goes on; the reply is lost.
    ReplyLost,
    /// The host goes on; the module loses power before the request.
    PowerBefore,
    /// The host goes on; the module loses power in the middle of the request.
    PowerHalf,
    /// The host goes on; the module loses power after receiving the request.
    PowerAfter,
}

pub const CUTS: [Cut; 8] = [
    Cut::Before,
    Cut::Half,
    Cut::After,
    Cut::Lost,
    Cut::ReplyLost,
    Cut::PowerBefore,
    Cut::PowerHalf,
    Cut::PowerAfter,
];

/// How a run ended.
#[derive(Debug)]
pub enum End<T> {
    Done(T),
    Died,
}

/// One module and one of another model on a line, and a journal.
pub struct Bench {
    pub line: VirtualLine,
    pub now: Instant,
    pub module: SlotId,
    /// The journal's text.
    pub journal: String,
    /// How many acts were done.
    pub acts: usize,
    /// How many frames were sent.
    pub frames: usize,
    /// The module is switched off and on when the procedure asks for it.
    pub heeds: bool,
    /// Requests that begin with this are not received.
    pub deaf_to: Vec<u8>,
    cycled: bool,
}

impl Bench {
    pub fn new(setup: &Setup, options: Options) -> Bench {
        let mut line = VirtualLine::new(VirtualLineConfig::default());
        let now = Instant(0);
        let module = line
            .add(now, "module", setup, Eeprom::of(setup), options)
            .unwrap();
        let stranger = Setup::new(Family::Erc8, Address(30));
        line.add(
            now,
            "stranger",
            &stranger,
            Eeprom::of(&stranger),
            Options::default(),
        )
        .unwrap();
        let mut bench = Bench {
            line,
            now,
            module,
            journal: String::new(),
            acts: 0,
            frames: 0,
            heeds: true,
            deaf_to: Vec::new(),
            cycled: false,
        };
        // The time in which a board accepts an address after power-up is over.
        bench.advance(Instant(11_000_000), &|_| false);
        bench
    }

    pub fn eeprom(&self) -> Eeprom {
        *self.line.engine(self.module).eeprom()
    }

    pub fn log(&self) -> Log {
        Log::read(&self.journal)
    }

    pub fn power_cycle(&mut self) {
        self.line.handle(
            self.now,
            Input::Act(self.module, Touch::Power(Power::Cycle)),
        );
        self.wait(Micros::from_millis(1));
    }

    pub fn wait(&mut self, time: Micros) {
        self.advance(self.now + time, &|_| false);
    }

    /// Runs a procedure; the act of that number fails.
    pub fn run<T>(&mut self, procedure: Procedure<T>, cut: Option<(usize, Cut)>) -> End<T> {
        self.run_asking(procedure, cut, &mut |_| true)
    }

    pub fn run_asking<T>(
        &mut self,
        mut procedure: Procedure<T>,
        cut: Option<(usize, Cut)>,
        answer: &mut dyn FnMut(Question) -> bool,
    ) -> End<T> {
        let mut event = Event::Begin;
        self.acts = 0;
        loop {
            let act = match procedure.next(self.now, event) {
                ProcedureStep::Done(end) => return End::Done(end),
                ProcedureStep::Do(act) => act,
            };
            let here = cut.filter(|(at, _)| *at == self.acts).map(|(_, cut)| cut);
            self.acts += 1;
            assert!(self.acts < 20_000, "it never ends");
            if here == Some(Cut::Before) {
                return End::Died;
            }
            event = match act {
                DriverAction::Journal(record) => match self.journal(&record, here) {
                    Some(event) => event,
                    None => return End::Died,
                },
                DriverAction::Ask(ask) => match self.ask(&ask, here) {
                    Some(heard) => Event::Heard(heard),
                    None => return End::Died,
                },
                DriverAction::Wait(time) => {
                    self.wait(time);
                    Event::Over
                }
                DriverAction::Tell(Progress::PowerCycle(_)) if self.heeds && !self.cycled => {
                    self.cycled = true;
                    self.power_cycle();
                    Event::Over
                }
                DriverAction::Tell(_) => Event::Over,
                DriverAction::Confirm(question) => Event::Answer(answer(question)),
            };
        }
    }

    fn journal(&mut self, record: &JournalRecord, cut: Option<Cut>) -> Option<Event> {
        let line = record.line_of_text();
        if !self.journal.is_empty() && !self.journal.ends_with('\n') {
            self.journal.push('\n');
        }
        match cut {
            Some(Cut::Half) => {
                self.journal.push_str(&line[..line.len() / 2]);
                return None;
            }
            Some(Cut::Lost) => return Some(Event::Kept(false)),
            Some(Cut::PowerBefore | Cut::PowerHalf | Cut::PowerAfter) => self.power_cycle(),
            _ => {}
        }
        self.journal.push_str(&line);
        (cut != Some(Cut::After)).then_some(Event::Kept(true))
    }

    fn ask(&mut self, ask: &TimedExchange, cut: Option<Cut>) -> Option<RxBytes> {
        self.frames += 1;
        let stray = self.advance(self.now + ask.quiet, &|_| false);
        let mut frame = Frame::new();
        ask.exchange.encode(&mut frame);
        let bytes = frame.bytes();
        let unheard = !self.deaf_to.is_empty() && bytes.starts_with(&self.deaf_to);
        let cut = if unheard { Some(Cut::Lost) } else { cut };
        let fault = |line: &mut VirtualLine, faults| line.set_module_faults(self.module, faults);
        match cut {
            Some(Cut::Lost) => fault(&mut self.line, Faults::DEAF),
            Some(Cut::ReplyLost | Cut::After) => fault(&mut self.line, Faults::MUTE),
            Some(Cut::PowerBefore) => self.power_cycle(),
            _ => {}
        }
        let half = cut == Some(Cut::Half);
        let sent = if half {
            &bytes[..bytes.len() / 2]
        } else {
            bytes
        };
        self.line.handle(
            self.now,
            Input::Send {
                bytes: sent,
                settings: ask.settings,
            },
        );
        let left = self.now + ask.settings.frame_time(sent.len());
        if cut == Some(Cut::PowerHalf) {
            let middle = self.now + ask.settings.frame_time(sent.len() / 2);
            self.advance(middle, &|_| false);
            self.power_cycle();
        }
        if cut == Some(Cut::PowerAfter) {
            // It has received the whole request, and no longer answers.
            self.advance(left + ask.settings.t3_5() + Micros(10), &|_| false);
            self.power_cycle();
        }
        let is_whole = |heard: &[u8]| ask.exchange.find_response(heard).1.whole().is_some();
        let bytes = self.advance(left + ask.timeout, &is_whole);
        if matches!(cut, Some(Cut::Lost | Cut::ReplyLost | Cut::After)) {
            self.line.set_module_faults(self.module, Faults::NONE);
        }
        let died = matches!(cut, Some(Cut::Half | Cut::After));
        (!died).then_some(RxBytes {
            bytes,
            stray,
            lost: false,
        })
    }

    /// Lets time pass, and returns what was received; stops as soon as that is enough.
    fn advance(&mut self, end: Instant, enough: &dyn Fn(&[u8]) -> bool) -> Vec<u8> {
        let mut heard = Vec::new();
        loop {
            match self.line.poll() {
                Output::Heard { bytes, .. } => {
                    heard.extend_from_slice(bytes);
                    if enough(&heard) {
                        return heard;
                    }
                }
                Output::Effect { .. } => {}
                Output::Wait(at) => {
                    let next = at.filter(|at| *at <= end).unwrap_or(end);
                    let over = self.now >= end;
                    if over && at.is_none_or(|at| at > end) {
                        return heard;
                    }
                    self.now = next.max(self.now);
                    self.line.handle(self.now, Input::Timeout);
                }
            }
        }
    }
}
