//! The slave on the line, without I/O and clock: bytes in, answers out when their time has come,
//! and writes to be begun.
//!
//! A master waits for one answer at a time. Whatever else is said on the line before it ends the
//! wait for an answer: it is never sent later, when it would be taken for that to another request.

use super::echo::Echo;
use super::framing::{PIECES_MAX, Received, request_len};
use crate::northbound::modbus::ends;
use crate::northbound::modbus::request::{UnitWrite, Units, WriteEnd, refusal};
use railbus_site::Config;
use railbus_wire::rtu::Exception;
use railbus_wire::{Instant, Micros, SerialSettings, crc16};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// How many writes may be under way, each to another unit.
pub(super) const UNDER_WAY_MAX: usize = 32;
/// An answer that is this much later than it may be is not sent: its master has gone on.
const LATE_MAX: Micros = Micros::from_millis(100);
/// The address of all slaves [MODBUS §1.6].
const BROADCAST: u8 = 0;

/// What is to be done.
#[derive(Debug, PartialEq)]
pub(super) enum Output {
    /// Carry out this write, and tell its end ([`Slave::ended`]).
    Begin(UnitWrite),
    /// An answer is about to be sent: first hand over all that was received by now, which may make
    /// it one that nobody waits for ([`Slave::is_up_to_date`]).
    TakeIn,
    /// Send this frame.
    Send(Vec<u8>),
    /// Nothing before this time, if at all.
    Wait(Option<Instant>),
}

/// What became of what was heard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Heard {
    /// Answered with what was asked for.
    pub(super) good: u64,
    /// Answered with an exception, or a write to all slaves.
    pub(super) refused: u64,
    /// Not answered: the master went on, or it was too late.
    pub(super) unanswered: u64,
    /// No frame.
    pub(super) damaged: u64,
}

/// A request to one of our units.
#[derive(Clone, Debug)]
struct Asked {
    /// When it ended.
    at: Instant,
    /// From the address to the CRC.
    frame: Vec<u8>,
}

impl Asked {
    fn unit(&self) -> u8 {
        self.frame.first().copied().unwrap_or_default()
    }

    fn pdu(&self) -> &[u8] {
        let end = self.frame.len().saturating_sub(2);
        self.frame.get(1..end).unwrap_or_default()
    }
}

/// An answer that waits for the silence before it.
#[derive(Debug)]
struct Answer {
    asked: Asked,
    frame: Vec<u8>,
    is_good: bool,
}

/// A write that has not ended.
#[derive(Debug)]
struct UnderWay {
    pdu: Vec<u8>,
    number: u16,
    /// By another one the unit may be another module.
    asked_by: Arc<Config>,
}

/// The slave.
#[derive(Debug)]
pub(super) struct Slave {
    serial: SerialSettings,
    reply_within: Micros,
    /// Bytes take their time on the port.
    is_wire: bool,
    received: Received,
    /// Something was received since it was last looked at.
    is_new: bool,
    echo: Echo,
    writes: VecDeque<UnitWrite>,
    /// By unit.
    under_way: BTreeMap<u8, UnderWay>,
    /// The request that waits for the end of a write to its unit.
    waiting: Option<Asked>,
    answer: Option<Answer>,
    /// Nothing that was received waits at the port.
    is_up_to_date: bool,
    /// Since it was last asked for.
    pub(super) heard: Heard,
}

impl Slave {
    /// A slave on a port with these settings, that answers a write after this time at the latest.
    pub(super) fn new(serial: SerialSettings, reply_within: Micros) -> Slave {
        Slave {
            serial,
            reply_within,
            is_wire: false,
            received: Received::default(),
            is_new: false,
            echo: Echo::default(),
            writes: VecDeque::new(),
            under_way: BTreeMap::new(),
            waiting: None,
            answer: None,
            is_up_to_date: false,
            heard: Heard::default(),
        }
    }

    /// The port was opened. Writes that are under way go on.
    pub(super) fn opened(&mut self, is_wire: bool) {
        self.is_wire = is_wire;
        self.closed();
    }

    /// The port is gone, and with it whatever was asked there.
    pub(super) fn closed(&mut self) {
        self.received = Received::default();
        self.is_new = false;
        self.echo = Echo::default();
        self.goes_on();
    }

    /// These bytes were received.
    pub(super) fn handle(&mut self, now: Instant, bytes: &[u8]) {
        let silence = self.serial.t3_5();
        self.heard.damaged += u64::from(self.received.push(now, bytes, silence));
        self.is_new = true;
    }

    /// A write has ended. Its request is answered if it still waits.
    pub(super) fn ended(&mut self, write: &UnitWrite, end: &WriteEnd, units: &mut Units<'_>) {
        let is_it = |under_way: &UnderWay| under_way.number == write.number;
        if !self.under_way.get(&write.unit).is_some_and(is_it) {
            return;
        }
        self.under_way.remove(&write.unit);
        let Some(asked) = self.waiting.take_if(|asked| asked.unit() == write.unit) else {
            return;
        };
        let mut out = Vec::new();
        let answered = match end {
            Ok(_) => units.written(write, &mut out),
            Err((failure, _)) => Err(ends::of_failure(failure).0),
        };
        self.reply(asked, answered.map(|()| out));
    }

    /// What is to be done now.
    pub(super) fn poll(&mut self, now: Instant, units: &mut Units<'_>) -> Output {
        loop {
            if let Some(write) = self.writes.pop_front() {
                return Output::Begin(write);
            }
            let is_silent = now >= self.silent_at();
            if self.is_new && is_silent {
                self.look(units);
                continue;
            }
            let until = self.answers_by();
            if let Some(asked) = self.waiting.take_if(|_| until.is_some_and(|at| now >= at)) {
                self.acknowledge(asked);
                continue;
            }
            let may_speak = now >= self.speaks_at();
            if may_speak && self.answer.is_some() && !self.is_up_to_date {
                return Output::TakeIn;
            }
            self.is_up_to_date = false;
            if may_speak && let Some(answer) = self.answer.take() {
                let age = now.since(answer.asked.at);
                if age > self.reply_within + LATE_MAX {
                    self.heard.unanswered += 1;
                    continue;
                }
                match answer.is_good {
                    true => self.heard.good += 1,
                    false => self.heard.refused += 1,
                }
                self.echo.sent(now, &answer.frame, &answer.asked.frame);
                return Output::Send(answer.frame);
            }
            return Output::Wait(self.deadline());
        }
    }

    /// All that was received by now was handed over ([`Output::TakeIn`]).
    pub(super) fn is_up_to_date(&mut self) {
        self.is_up_to_date = true;
    }

    /// When it is to be polled again if nothing happens.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let silent_at = self.is_new.then(|| self.silent_at());
        let speaks_at = self.answer.as_ref().map(|_| self.speaks_at());
        Instant::earliest(&[silent_at, speaks_at, self.answers_by()])
    }

    /// When the line is silent for long enough if nothing more is received.
    fn silent_at(&self) -> Instant {
        self.received.heard() + self.serial.t3_5()
    }

    /// When an answer may begin. What was heard last may be the first piece of a request.
    fn speaks_at(&self) -> Instant {
        let silence = self.serial.t3_5();
        let pause = match self.received.bytes() {
            [] => silence,
            _ => silence.max(PIECES_MAX),
        };
        self.received.heard() + pause
    }

    /// When the request that waits for the end of a write is answered at the latest.
    fn answers_by(&self) -> Option<Instant> {
        let waiting = self.waiting.as_ref();
        waiting.map(|asked| asked.at + self.reply_within)
    }

    /// Looks at what was received before a silence.
    fn look(&mut self, units: &mut Units<'_>) {
        self.is_new = false;
        self.echo
            .take_off(&mut self.received, self.serial, self.is_wire);
        let Some(frame) = self.received.last_frame() else {
            return;
        };
        let asked = Asked {
            at: self.received.heard(),
            frame: frame.to_vec(),
        };
        self.received.clear();
        self.echo.missed();
        self.goes_on();
        match (asked.unit(), asked.pdu().first()) {
            // A reply of somebody, or no request of this function.
            (_, None | Some(0x80..)) => {}
            _ if request_len(&asked.frame).is_some_and(|len| len != asked.frame.len()) => {}
            // Whatever it asks for, it is not answered, and nothing is switched.
            (BROADCAST, _) => self.heard.refused += 1,
            (unit, _) if !units.images.contains_key(&unit) => {}
            _ => self.execute(asked, units),
        }
    }

    /// The master waits for nothing any more.
    fn goes_on(&mut self) {
        let waited = [self.waiting.take().is_some(), self.answer.take().is_some()];
        self.heard.unanswered += waited.map(u64::from).iter().sum::<u64>();
    }

    /// Answers a request, or begins the write that it asks for.
    fn execute(&mut self, asked: Asked, units: &mut Units<'_>) {
        let under_way = self.under_way.get(&asked.unit());
        if let Some(write) = under_way
            && write.pdu == asked.pdu()
            && Arc::ptr_eq(&write.asked_by, units.config)
        {
            // The same once more: it does not go out twice.
            self.waiting = Some(asked);
            return;
        }
        let may_begin = under_way.is_none() && self.under_way.len() < UNDER_WAY_MAX;
        let mut out = Vec::new();
        match units.ask(asked.unit(), asked.pdu(), may_begin, &mut out) {
            Ok(None) => self.reply(asked, Ok(out)),
            Ok(Some(write)) => {
                let under_way = UnderWay {
                    pdu: asked.pdu().to_vec(),
                    number: write.number,
                    asked_by: Arc::clone(&write.asked_by),
                };
                self.under_way.insert(asked.unit(), under_way);
                self.writes.push_back(write);
                self.waiting = Some(asked);
            }
            Err(why) => self.reply(asked, Err(why)),
        }
    }

    /// Answers that the write goes on.
    fn acknowledge(&mut self, asked: Asked) {
        self.reply(asked, Err(Exception::ACKNOWLEDGE));
    }

    /// Answers with this, or an exception, after the silence.
    fn reply(&mut self, asked: Asked, answered: Result<Vec<u8>, Exception>) {
        let is_good = answered.is_ok();
        let mut frame =
            answered.unwrap_or_else(|why| refusal(asked.unit(), asked.pdu(), why).to_vec());
        let crc = crc16(&frame).to_le_bytes();
        frame.extend_from_slice(&crc);
        self.answer = Some(Answer {
            asked,
            frame,
            is_good,
        });
    }
}
