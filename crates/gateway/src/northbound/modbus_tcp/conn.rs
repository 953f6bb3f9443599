//! One connection of a client, without I/O: bytes in, answers out, and writes to be begun.
//!
//! Requests to one unit are answered in their order, except where too many wait. While a write to
//! it is under way the requests after it wait; those to other units don't, so that a module that
//! does not answer holds up no other.

use crate::northbound::modbus::ends;
use crate::northbound::modbus::request::{UnitWrite, Units, WriteEnd, refusal};
use railbus_site::Config;
use railbus_wire::Decoded;
use railbus_wire::mbap::{self, Message};
use railbus_wire::rtu::Exception;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// How many requests of a connection may wait for the end of a command.
pub(super) const WAITING_MAX: usize = 16;

/// A write that a request of the connection asked for.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AskedWrite {
    /// What is to be done.
    pub(super) write: UnitWrite,
    /// Of the request, and of its answer.
    transaction: u16,
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
    pub(super) writes: VecDeque<AskedWrite>,
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
        let may_begin = self.waiting < WAITING_MAX;
        let begun = self.open(transaction);
        match units.ask(unit, pdu, may_begin, &mut self.out) {
            Ok(None) => self.close(transaction, begun),
            // It is answered when it has ended.
            Ok(Some(write)) => {
                self.out.truncate(begun);
                self.writes.push_back(AskedWrite { write, transaction });
                self.busy.insert(unit, VecDeque::new());
                self.waiting += 1;
            }
            Err(why) => {
                self.out.truncate(begun);
                self.refuse(transaction, unit, pdu, why);
            }
        }
    }

    /// Answers with an exception [MODBUS §2.6].
    fn refuse(&mut self, transaction: u16, unit: u8, pdu: &[u8], why: Exception) {
        self.out.extend_from_slice(&mbap::header(transaction, 3));
        self.out.extend_from_slice(&refusal(unit, pdu, why));
        self.answered.refused += 1;
    }

    /// Begins a message; its length is not known yet.
    fn open(&mut self, transaction: u16) -> usize {
        let begun = self.out.len();
        self.out.extend_from_slice(&mbap::header(transaction, 0));
        begun
    }

    /// Ends the message that began here, an answer with what was asked for.
    fn close(&mut self, transaction: u16, begun: usize) {
        let inside = self.out.len() - begun - mbap::HEADER;
        let header = self.out.get_mut(begun..begun + mbap::HEADER);
        if let Some(header) = header {
            header.copy_from_slice(&mbap::header(transaction, inside));
        }
        self.answered.good += 1;
    }

    /// A write has ended: answers it, and what waited for it.
    pub(super) fn ended(&mut self, asked: &AskedWrite, end: &WriteEnd, units: &mut Units<'_>) {
        let (write, transaction) = (&asked.write, asked.transaction);
        self.waiting = self.waiting.saturating_sub(1);
        let begun = self.open(transaction);
        let answered = match end {
            Ok(_) => units.written(write, &mut self.out),
            Err((failure, _)) => Err(ends::of_failure(failure).0),
        };
        match answered {
            Ok(()) => self.close(transaction, begun),
            Err(why) => {
                self.out.truncate(begun);
                self.refuse(transaction, write.unit, &write.echo, why);
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

    /// Whether a message is incomplete.
    pub(super) fn is_partial(&self) -> bool {
        !self.received.is_empty()
    }
}
