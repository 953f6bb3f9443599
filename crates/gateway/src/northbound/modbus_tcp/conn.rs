//! One connection of a client, without I/O: bytes in, answers out, and writes to be begun.
//!
//! Requests to one unit are answered in their order, except where too many wait. While a write to
//! it is under way the requests after it wait; those to other units don't, so that a module that
//! does not answer holds up no other.

use crate::northbound::modbus::ends::{self, LastEnd};
use crate::northbound::modbus::image::{Look, UnitImage};
use crate::northbound::modbus::map::Space;
use railbus_device::Point;
use railbus_host::Confirmation;
use railbus_site::{CommandError, Config};
use railbus_wire::mbap::{self, Message};
use railbus_wire::rtu::{self, Exception, Identification, Request, WordBlock};
use railbus_wire::{Address, Decoded, Frame, Words};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// How many requests of a connection may wait for the end of a command.
pub(super) const WAITING_MAX: usize = 16;
/// Functions that no module here has, so that the codec of modules does not know them.
const MASK_WRITE: u8 = 0x16;
const READ_WRITE: u8 = 0x17;
/// How many registers a read with a write may have, and the write [MODBUS §3.2].
const READ_MAX: u16 = 125;
const WRITE_MAX: u16 = 121;
/// The units of the gateway itself.
pub(super) const GATEWAY: [u8; 2] = [0, 255];
const VENDOR: &str = "railbus";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The units of a site, and what is asked of it when registers about a unit are read.
pub(super) struct Units<'a> {
    /// By their numbers.
    pub(super) images: &'a mut BTreeMap<u8, UnitImage>,
    /// Age, presence and round trip of a module.
    pub(super) look: Look<'a>,
    /// What the site is called.
    pub(super) site: &'a str,
    /// The configuration that they are of.
    pub(super) config: &'a Arc<Config>,
}

/// A write to be carried out by the site.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct UnitWrite {
    /// The unit.
    pub(super) unit: u8,
    /// Its module, by name.
    pub(super) module: Arc<str>,
    /// The outputs, and their new states.
    pub(super) set: Vec<(Point, bool)>,
    /// The number of the command among those to this unit.
    pub(super) number: u16,
    /// The configuration by which the unit was this module.
    pub(super) asked_by: Arc<Config>,
    transaction: u16,
    /// The beginning of the request, which the answer repeats [MODBUS §2.3] [MODBUS §2.4].
    echo: Vec<u8>,
    /// These holding registers are the answer instead, as they are after the write.
    reads: Option<(u16, u16)>,
}

/// How a write ended; an error with the digits of its code.
pub(super) type WriteEnd = Result<Confirmation, (CommandError, u16)>;

/// Records the end of a write in the status registers of its unit, also if its client has
/// disconnected.
pub(super) fn note_end(images: &mut BTreeMap<u8, UnitImage>, write: &UnitWrite, end: &WriteEnd) {
    let (told, code) = match end {
        Ok(confirmed) => (LastEnd::from(*confirmed), 0),
        Err((failure, code)) => (ends::of_failure(failure).1, *code),
    };
    let image = images.get_mut(&write.unit);
    if let Some(image) = image.filter(|image| image.module == write.module) {
        image.ended(write.number, told, code);
    }
}

/// A request that waits until a write to its unit has ended.
#[derive(Debug)]
struct Held {
    /// By another one the unit may be another module.
    asked_by: Arc<Config>,
    transaction: u16,
    pdu: Vec<u8>,
}

/// The bytes are not Modbus TCP: nothing says where the next message begins [MODBUS §5.2].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NotModbus;

/// What was answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Answered {
    /// With what was asked for.
    pub(super) good: u64,
    /// With an exception.
    pub(super) refused: u64,
}

/// A connection.
#[derive(Debug, Default)]
pub(super) struct ModbusConn {
    /// What was received and is not yet answered.
    pub(super) received: Vec<u8>,
    /// What is to be sent.
    pub(super) out: Vec<u8>,
    /// Writes to be begun.
    pub(super) writes: VecDeque<UnitWrite>,
    /// What was answered since this was last asked.
    pub(super) answered: Answered,
    /// The units with a write under way, and the requests behind it.
    busy: BTreeMap<u8, VecDeque<Held>>,
    /// Writes under way and requests behind them.
    waiting: usize,
}

impl ModbusConn {
    /// Answers what was received, as far as it is complete; the number of requests.
    ///
    /// # Errors
    /// [`NotModbus`]: what came before it is answered.
    pub(super) fn answer(&mut self, units: &mut Units<'_>) -> Result<usize, NotModbus> {
        let received = std::mem::take(&mut self.received);
        let (mut rest, mut count) = (&received[..], 0);
        let end = loop {
            match Message::decode(rest) {
                Decoded::Partial { .. } => break Ok(count),
                Decoded::Malformed(_) => break Err(NotModbus),
                Decoded::Whole { len, value } => {
                    self.take(&value, units);
                    count += 1;
                    rest = rest.get(len..).unwrap_or_default();
                }
            }
        };
        let done = received.len() - rest.len();
        self.received = received;
        self.received.drain(..done);
        end
    }

    fn take(&mut self, message: &Message<'_>, units: &mut Units<'_>) {
        let unit = message.unit.0;
        match self.busy.get_mut(&unit) {
            Some(_) if self.waiting >= WAITING_MAX => {
                self.refuse(message.transaction, unit, message.pdu, Exception::BUSY);
            }
            Some(held) => {
                self.waiting += 1;
                held.push_back(Held {
                    asked_by: Arc::clone(units.config),
                    transaction: message.transaction,
                    pdu: message.pdu.to_vec(),
                });
            }
            None => self.execute(message.transaction, unit, message.pdu, units),
        }
    }

    /// Answers a request, or begins the write that it asks for.
    fn execute(&mut self, transaction: u16, unit: u8, pdu: &[u8], units: &mut Units<'_>) {
        let begun = self.out.len();
        let end = self.reply(transaction, unit, pdu, units);
        match end {
            Ok(()) if self.out.len() > begun => self.answered.good += 1,
            // A write, which is answered when it has ended.
            Ok(()) => {}
            Err(why) => {
                self.out.truncate(begun);
                self.refuse(transaction, unit, pdu, why);
            }
        }
    }

    /// Answers with an exception [MODBUS §2.6].
    fn refuse(&mut self, transaction: u16, unit: u8, pdu: &[u8], why: Exception) {
        let function = pdu.first().copied().unwrap_or_default();
        self.out.extend_from_slice(&mbap::header(transaction, 3));
        self.out.extend_from_slice(&[unit, function | 0x80, why.0]);
        self.answered.refused += 1;
    }

    fn reply(
        &mut self,
        transaction: u16,
        unit: u8,
        pdu: &[u8],
        units: &mut Units<'_>,
    ) -> Result<(), Exception> {
        // Whatever is asked of it.
        if !units.images.contains_key(&unit) && !GATEWAY.contains(&unit) {
            return Err(Exception::PATH);
        }
        if let (Some(&(MASK_WRITE | READ_WRITE)), Some(image)) =
            (pdu.first(), units.images.get_mut(&unit))
        {
            return self.combined((transaction, unit), pdu, image, units.config);
        }
        let exchange = rtu::Exchange::decode_pdu(Address(unit), pdu);
        let request = match &exchange {
            Ok(exchange) => &exchange.request,
            Err(error) => {
                let exception = error.exception();
                return Err(exception.map_or(Exception::FUNCTION, |(_, _, why)| why));
            }
        };
        let Some(image) = units.images.get_mut(&unit) else {
            return match request {
                Request::Identify { code, object } => {
                    let said = [VENDOR, VENDOR, VERSION, units.site];
                    self.identify(transaction, unit, (*code, *object), said)
                }
                _ => Err(Exception::FUNCTION),
            };
        };
        let (space, span) = match request {
            Request::ReadCoils(span) => (Space::Coils, (span.start(), span.count())),
            Request::ReadDiscreteInputs(span) => {
                (Space::DiscreteInputs, (span.start(), span.count()))
            }
            Request::ReadHoldingRegisters(span) => {
                (Space::HoldingRegisters, (span.start(), span.count()))
            }
            Request::ReadInputRegisters(span) => {
                (Space::InputRegisters, (span.start(), span.count()))
            }
            Request::WriteCoil { .. }
            | Request::WriteRegister { .. }
            | Request::WriteCoils(_)
            | Request::WriteRegisters(_) => {
                let set = image.writes(request)?;
                // Every write has these [MODBUS §2.3].
                let echo = pdu.get(..5).ok_or(Exception::VALUE)?;
                let unit = (transaction, unit);
                return self.begin(unit, (image, units.config), set, (echo, None));
            }
            Request::Identify { code, object } => {
                let model = image.setup.family.profile().model;
                let said = [VENDOR, model, VERSION, &image.module];
                return self.identify(transaction, unit, (*code, *object), said);
            }
            Request::Diagnose { .. } => return Err(Exception::FUNCTION),
        };
        let begun = self.open(transaction, unit, request.function().code());
        match space {
            Space::Coils | Space::DiscreteInputs => image.read_bits(space, span, &mut self.out),
            Space::HoldingRegisters | Space::InputRegisters => {
                image.read_words(space, span, units.look, &mut self.out)
            }
        }?;
        self.close(transaction, begun);
        Ok(())
    }

    /// Begins a message; its length is not known yet.
    fn open(&mut self, transaction: u16, unit: u8, function: u8) -> usize {
        let begun = self.out.len();
        self.out.extend_from_slice(&mbap::header(transaction, 0));
        self.out.extend_from_slice(&[unit, function]);
        begun
    }

    /// Ends the message that began here.
    fn close(&mut self, transaction: u16, begun: usize) {
        let inside = self.out.len() - begun - mbap::HEADER;
        let header = self.out.get_mut(begun..begun + mbap::HEADER);
        if let Some(header) = header {
            header.copy_from_slice(&mbap::header(transaction, inside));
        }
    }

    /// Vendor, product, revision and name [BEYOND §5].
    fn identify(
        &mut self,
        transaction: u16,
        unit: u8,
        (code, object): (u8, u8),
        said: [&str; 4],
    ) -> Result<(), Exception> {
        const NUMBERS: [u8; 4] = [
            Identification::VENDOR,
            Identification::PRODUCT,
            Identification::REVISION,
            Identification::NAME,
        ];
        let all: Vec<(u8, &str)> = NUMBERS.into_iter().zip(said).collect();
        let listed = match code {
            1 => all.get(..3).unwrap_or_default(),
            2..=4 => &all,
            _ => return Err(Exception::VALUE),
        };
        let at = listed.iter().position(|(number, _)| *number == object);
        let wanted = match (code, at) {
            (4, None) => return Err(Exception::ADDRESS),
            (4, Some(at)) => listed.get(at..=at),
            // One that does not exist is the first.
            (_, at) => listed.get(at.unwrap_or(0)..),
        };
        let is_text = |letter: &char| (' '..='~').contains(letter);
        let ascii = |text: &str| text.chars().filter(is_text).take(48).collect();
        let wanted = wanted.unwrap_or_default().iter();
        let objects: Vec<(u8, String)> = wanted
            .map(|(number, text)| (*number, ascii(text)))
            .collect();
        let texts: Vec<(u8, &str)> = objects
            .iter()
            .map(|(number, text)| (*number, text.as_str()))
            .collect();
        let mut frame = Frame::new();
        rtu::encode_identification(Address(unit), code, &texts, &mut frame);
        // Without its CRC.
        let inside = frame.bytes();
        let inside = inside.get(..inside.len().saturating_sub(2));
        let inside = inside.unwrap_or_default();
        self.out
            .extend_from_slice(&mbap::header(transaction, inside.len()));
        self.out.extend_from_slice(inside);
        Ok(())
    }

    /// Functions 16h and 17h: some bits of a register, and a read after a write.
    fn combined(
        &mut self,
        (transaction, unit): (u16, u8),
        pdu: &[u8],
        image: &mut UnitImage,
        config: &Arc<Config>,
    ) -> Result<(), Exception> {
        match *pdu {
            [
                MASK_WRITE,
                at_high,
                at_low,
                and_high,
                and_low,
                or_high,
                or_low,
            ] => {
                let [at, and, or] = [[at_high, at_low], [and_high, and_low], [or_high, or_low]]
                    .map(u16::from_be_bytes);
                let set = image.writes_masked(at, and, or)?;
                if set.is_empty() {
                    let begun = self.open(transaction, unit, MASK_WRITE);
                    self.out.extend_from_slice(pdu.get(1..).unwrap_or_default());
                    self.close(transaction, begun);
                    return Ok(());
                }
                self.begin((transaction, unit), (image, config), set, (pdu, None))
            }
            [
                READ_WRITE,
                r1,
                r0,
                rc1,
                rc0,
                w1,
                w0,
                wc1,
                wc0,
                len,
                ref data @ ..,
            ] => {
                let [start, count, at, words] =
                    [[r1, r0], [rc1, rc0], [w1, w0], [wc1, wc0]].map(u16::from_be_bytes);
                let fits = (1..=READ_MAX).contains(&count)
                    && (1..=WRITE_MAX).contains(&words)
                    && usize::from(len) == data.len()
                    && data.len() == 2 * usize::from(words);
                let block = Words::from_packed(data).and_then(|words| WordBlock::new(at, words));
                let (true, Some(block)) = (fits, block) else {
                    return Err(Exception::VALUE);
                };
                image.has_holding(start, count)?;
                let set = image.writes(&Request::WriteRegisters(block))?;
                let begins = [READ_WRITE, w1, w0];
                let reads = Some((start, count));
                self.begin((transaction, unit), (image, config), set, (&begins, reads))
            }
            _ => Err(Exception::VALUE),
        }
    }

    fn begin(
        &mut self,
        (transaction, unit): (u16, u8),
        (image, config): (&mut UnitImage, &Arc<Config>),
        set: Vec<(Point, bool)>,
        (echo, reads): (&[u8], Option<(u16, u16)>),
    ) -> Result<(), Exception> {
        if self.waiting >= WAITING_MAX {
            return Err(Exception::BUSY);
        }
        let &[_, high, low, ..] = echo else {
            return Err(Exception::VALUE);
        };
        let last = &mut image.last;
        last.number = last.number.wrapping_add(1);
        (last.end, last.code) = (LastEnd::UnderWay, 0);
        last.at = u16::from_be_bytes([high, low]);
        self.writes.push_back(UnitWrite {
            unit,
            module: Arc::clone(&image.module),
            set,
            number: last.number,
            asked_by: Arc::clone(config),
            transaction,
            echo: echo.to_vec(),
            reads,
        });
        self.busy.insert(unit, VecDeque::new());
        self.waiting += 1;
        Ok(())
    }

    /// A write has ended: answers it, and what waited for it.
    pub(super) fn ended(&mut self, write: &UnitWrite, end: &WriteEnd, units: &mut Units<'_>) {
        self.waiting = self.waiting.saturating_sub(1);
        match end {
            Ok(_) => self.written(write, units),
            Err((failure, _)) => {
                let (why, _) = ends::of_failure(failure);
                self.refuse(write.transaction, write.unit, &write.echo, why);
            }
        }
        let mut held = self.busy.remove(&write.unit).unwrap_or_default();
        while let Some(next) = held.pop_front() {
            self.waiting = self.waiting.saturating_sub(1);
            if !Arc::ptr_eq(&next.asked_by, units.config) {
                self.refuse(next.transaction, write.unit, &next.pdu, Exception::BUSY);
                continue;
            }
            self.execute(next.transaction, write.unit, &next.pdu, units);
            if let Some(behind) = self.busy.get_mut(&write.unit) {
                // It is a write itself.
                *behind = held;
                return;
            }
        }
    }

    /// Answers a write that was carried out.
    fn written(&mut self, write: &UnitWrite, units: &mut Units<'_>) {
        let (transaction, unit) = (write.transaction, write.unit);
        let Some(span) = write.reads else {
            let header = mbap::header(transaction, 1 + write.echo.len());
            self.out.extend_from_slice(&header);
            self.out.push(unit);
            self.out.extend_from_slice(&write.echo);
            self.answered.good += 1;
            return;
        };
        let begun = self.open(transaction, unit, READ_WRITE);
        let read = match units.images.get(&unit) {
            Some(image) if image.module == write.module => {
                let space = Space::HoldingRegisters;
                image.read_words(space, span, units.look, &mut self.out)
            }
            // The write was carried out, but the unit is another module now.
            _ => Err(Exception::TARGET),
        };
        match read {
            Ok(()) => {
                self.close(transaction, begun);
                self.answered.good += 1;
            }
            Err(why) => {
                self.out.truncate(begun);
                self.refuse(transaction, unit, &write.echo, why);
            }
        }
    }

    /// Whether a message is incomplete.
    pub(super) fn is_partial(&self) -> bool {
        !self.received.is_empty()
    }
}
