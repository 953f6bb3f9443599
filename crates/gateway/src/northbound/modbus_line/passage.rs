//! Whose request is next on the line, without I/O: requests in, reads for the line and commands for
//! the site out, then answers.
//!
//! The line takes one read at a time, of the client that had its last one the longest ago. Equal
//! reads that wait are one. Of one client, requests to a unit wait behind its
//! writes to that unit, and a write behind all others; those to other units don't.

use super::health::{Health, Turn};
use super::verdict::{self, OutputWrite, Verdict};
use railbus_site::{CommandError, Config};
use railbus_wire::rtu::{self, Exception};
use railbus_wire::{Address, Exchange, Frame, Micros, mbap};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// How many requests of a client may be under way.
pub(super) const WAITING_MAX: usize = 16;

/// A client, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ClientId(pub(super) u64);

/// A request of a client: its number among all requests.
type RequestId = u64;

/// The site, as it is now.
pub(super) struct Site<'s> {
    /// The configuration in force.
    pub(super) config: &'s Arc<Config>,
    /// Whether the line has its port.
    pub(super) is_up: bool,
    /// Whether the site hears a module; none if it has not tried.
    pub(super) is_online: &'s dyn Fn(&str) -> Option<bool>,
}

/// Something to do.
#[derive(Debug, PartialEq)]
pub(super) enum Output {
    /// This read is to be sent to the line; [`Passage::read_ended`] says how it ended.
    Read(LineRead),
    /// This command is to be given to the site; [`Passage::write_ended`] says how it ended.
    Write(ClientWrite),
    /// There are answers for this client.
    Answered(ClientId),
}

/// A read for the line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LineRead {
    /// The unit.
    pub(super) unit: u8,
    /// What to ask it.
    pub(super) exchange: Exchange<'static>,
    /// How long its reply may take to begin.
    pub(super) timeout: Micros,
}

/// A command for the site.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ClientWrite {
    /// Whose it is.
    pub(super) client: ClientId,
    /// The outputs.
    pub(super) write: OutputWrite,
    request: RequestId,
}

/// How a read ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum ReadEnd {
    /// The unit answered so, perhaps with an exception of its own, in this time.
    Answered(Vec<u8>, Micros),
    /// It did not answer, or not with a valid reply.
    Silent,
    /// It was not asked.
    NotAsked(Exception),
}

/// What was answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Answered {
    /// With what was asked for.
    pub(super) good: u64,
    /// With an exception.
    pub(super) refused: u64,
}

/// A request that is not answered yet.
#[derive(Debug)]
struct Pending {
    request: RequestId,
    transaction: u16,
    unit: u8,
    pdu: Vec<u8>,
    verdict: Verdict,
    is_begun: bool,
}

impl Pending {
    fn is_write(&self) -> bool {
        matches!(self.verdict, Verdict::Write(_))
    }
}

#[derive(Debug, Default)]
struct Client {
    pending: Vec<Pending>,
    out: Vec<u8>,
    /// When it had the line last, as a number.
    served: u64,
}

/// A read that waits for the line or is under way, and whose it is.
#[derive(Debug)]
struct Wanted {
    unit: u8,
    pdu: Vec<u8>,
    exchange: Exchange<'static>,
    askers: Vec<(ClientId, RequestId)>,
}

/// The gateway to a line.
#[derive(Debug)]
pub(super) struct Passage {
    /// Its name.
    line: String,
    clients: BTreeMap<ClientId, Client>,
    /// In the order in which they came.
    waiting: Vec<Wanted>,
    flight: Option<Wanted>,
    health: Health,
    requests: RequestId,
    turns: u64,
    outputs: Vec<Output>,
    /// When the line is to be looked at again.
    again: Option<Duration>,
    /// What was answered since this was last taken.
    pub(super) answered: Answered,
}

impl Passage {
    /// The gateway to this line.
    pub(super) fn new(line: &str) -> Passage {
        Passage {
            line: line.to_owned(),
            clients: BTreeMap::new(),
            waiting: Vec::new(),
            flight: None,
            health: Health::default(),
            requests: 0,
            turns: 0,
            outputs: Vec::new(),
            again: None,
            answered: Answered::default(),
        }
    }

    /// A client has come.
    pub(super) fn came(&mut self, client: ClientId) {
        // Behind those that wait already.
        let served = self.turns;
        let new = Client {
            served,
            ..Client::default()
        };
        self.clients.insert(client, new);
    }

    /// A client has gone. What it asked for and was not sent is not sent any more.
    pub(super) fn gone(&mut self, client: ClientId) {
        self.clients.remove(&client);
        for wanted in self.waiting.iter_mut().chain(&mut self.flight) {
            wanted.askers.retain(|(asker, _)| *asker != client);
        }
        self.waiting.retain(|wanted| !wanted.askers.is_empty());
    }

    /// A client asks for something.
    pub(super) fn request(&mut self, id: ClientId, message: &mbap::Message<'_>, site: &Site<'_>) {
        let unit = message.unit.0;
        let verdict = verdict::verdict(site.config, &self.line, unit, message.pdu);
        let request = self.requests;
        self.requests += 1;
        let Some(client) = self.clients.get_mut(&id) else {
            return;
        };
        let is_full = client.pending.len() >= WAITING_MAX;
        client.pending.push(Pending {
            request,
            transaction: message.transaction,
            unit,
            pdu: message.pdu.to_vec(),
            verdict,
            is_begun: false,
        });
        if is_full {
            self.refuse(id, request, Exception::BUSY);
        }
        self.begin(id);
    }

    /// What is answered for a client since this was last called.
    pub(super) fn take_answers(&mut self, client: ClientId) -> Vec<u8> {
        let client = self.clients.get_mut(&client);
        client.map_or_else(Vec::new, |client| std::mem::take(&mut client.out))
    }

    /// The read under way has ended.
    pub(super) fn read_ended(&mut self, now: Duration, end: &ReadEnd) {
        let Some(wanted) = self.flight.take() else {
            return;
        };
        match end {
            ReadEnd::Answered(_, after) => self.health.answered(wanted.unit, *after),
            ReadEnd::Silent => {
                self.health.missed(now, wanted.unit);
                if self.health.is_silent(wanted.unit) {
                    self.give_up(wanted.unit);
                }
            }
            ReadEnd::NotAsked(_) => {}
        }
        self.end_read(wanted, end);
    }

    /// A unit answered a read after all that had been given up.
    pub(super) fn answered_late(&mut self, unit: u8, after: Micros) {
        self.health.answered(unit, after);
    }

    /// A command has ended.
    pub(super) fn write_ended(&mut self, write: &ClientWrite, end: Result<(), &CommandError>) {
        match end {
            Ok(()) => {
                let asked = self.pending(write.client, write.request);
                // Every write of coils has these [MODBUS §2.3] [MODBUS §2.4].
                let echo = asked.and_then(|asked| asked.pdu.get(..5).map(<[u8]>::to_vec));
                self.answer(write.client, write.request, &echo.unwrap_or_default());
            }
            Err(failure) => self.refuse(write.client, write.request, verdict::of_failure(failure)),
        }
        self.begin(write.client);
    }

    /// The next thing to do.
    pub(super) fn poll(&mut self, now: Duration, site: &Site<'_>) -> Option<Output> {
        if self.flight.is_none() {
            self.send_next(now, site);
        }
        (!self.outputs.is_empty()).then(|| self.outputs.remove(0))
    }

    /// When there may be something to do though nothing has happened.
    pub(super) fn deadline(&self) -> Option<Duration> {
        self.again.filter(|_| self.flight.is_none())
    }

    /// Begins what a client waits for, as far as its own requests allow it.
    fn begin(&mut self, id: ClientId) {
        let mut at = 0;
        while let Some(next) = self.may_begin(id, at) {
            at = next + 1;
            let client = self.clients.get_mut(&id);
            let Some(pending) = client.and_then(|client| client.pending.get_mut(next)) else {
                return;
            };
            pending.is_begun = true;
            let (request, unit) = (pending.request, pending.unit);
            match pending.verdict.clone() {
                Verdict::Read(exchange) => {
                    let pdu = pending.pdu.clone();
                    self.want((id, request), unit, pdu, exchange);
                }
                Verdict::Write(write) => self.outputs.push(Output::Write(ClientWrite {
                    client: id,
                    write,
                    request,
                })),
                Verdict::Identify(code, object) => {
                    match identification(&self.line, code, object) {
                        Ok(pdu) => self.answer(id, request, &pdu),
                        Err(why) => self.refuse(id, request, why),
                    }
                    at = next;
                }
                Verdict::Refuse(why) => {
                    self.refuse(id, request, why);
                    at = next;
                }
            }
        }
    }

    /// The first request of a client from this place on that waits for none of its own.
    fn may_begin(&self, id: ClientId, from: usize) -> Option<usize> {
        let pending = &self.clients.get(&id)?.pending;
        let may = |(at, next): &(usize, &Pending)| {
            let earlier = pending.get(..*at).unwrap_or_default().iter();
            let mut earlier = earlier.filter(|one| one.unit == next.unit);
            let waits = match next.verdict {
                Verdict::Write(_) => earlier.next().is_some(),
                _ => earlier.any(Pending::is_write),
            };
            !next.is_begun && !waits
        };
        let found = pending.iter().enumerate().skip(from).find(may);
        found.map(|(at, _)| at)
    }

    /// A read for the line, or for one that waits for it already.
    fn want(
        &mut self,
        asker: (ClientId, RequestId),
        unit: u8,
        pdu: Vec<u8>,
        exchange: Exchange<'static>,
    ) {
        // Not one under way: it may have begun before what this client knows of.
        let mut known = self.waiting.iter_mut();
        let is_equal = |wanted: &&mut Wanted| wanted.unit == unit && wanted.pdu == pdu;
        match known.find(is_equal) {
            Some(wanted) => wanted.askers.push(asker),
            None => self.waiting.push(Wanted {
                unit,
                pdu,
                exchange,
                askers: vec![asker],
            }),
        }
    }

    /// Sends the read whose turn it is.
    fn send_next(&mut self, now: Duration, site: &Site<'_>) {
        self.again = None;
        loop {
            let (mut best, mut silent): (Option<(u64, usize)>, Option<u8>) = (None, None);
            for (at, wanted) in self.waiting.iter().enumerate() {
                let module = verdict::module_at(site.config, &self.line, wanted.unit);
                let is_online = module.and_then(|(name, _)| (site.is_online)(name));
                let turn = match site.is_up {
                    true => self.health.turn(now, wanted.unit, is_online),
                    // The line says why.
                    false => Turn::Now,
                };
                match turn {
                    Turn::Now => {
                        let served = |(asker, _): &(ClientId, RequestId)| {
                            self.clients.get(asker).map_or(u64::MAX, |one| one.served)
                        };
                        let served = wanted.askers.iter().map(served).min();
                        let served = served.unwrap_or(u64::MAX);
                        if best.is_none_or(|(least, _)| served < least) {
                            best = Some((served, at));
                        }
                    }
                    Turn::From(then) => {
                        self.again = Some(self.again.map_or(then, |again| again.min(then)));
                    }
                    Turn::Silent => silent = Some(wanted.unit),
                }
            }
            if let Some(unit) = silent {
                self.give_up(unit);
                continue;
            }
            let Some((_, at)) = best else {
                return;
            };
            let wanted = self.waiting.remove(at);
            self.turns += 1;
            for (asker, _) in &wanted.askers {
                if let Some(client) = self.clients.get_mut(asker) {
                    client.served = self.turns;
                }
            }
            self.outputs.push(Output::Read(LineRead {
                unit: wanted.unit,
                exchange: wanted.exchange,
                timeout: self.health.timeout(wanted.unit),
            }));
            self.flight = Some(wanted);
            return;
        }
    }

    /// A unit is not waited for any more: neither by other reads.
    fn give_up(&mut self, unit: u8) {
        let mut waiting = std::mem::take(&mut self.waiting);
        let given_up = waiting.extract_if(.., |wanted| wanted.unit == unit);
        let given_up: Vec<Wanted> = given_up.collect();
        self.waiting = waiting;
        for wanted in given_up {
            self.end_read(wanted, &ReadEnd::Silent);
        }
    }

    /// Answers all who wanted a read.
    fn end_read(&mut self, wanted: Wanted, end: &ReadEnd) {
        for (client, request) in wanted.askers {
            match end {
                ReadEnd::Answered(pdu, _) => self.answer(client, request, pdu),
                ReadEnd::Silent => self.refuse(client, request, Exception::TARGET),
                ReadEnd::NotAsked(why) => self.refuse(client, request, *why),
            }
            self.begin(client);
        }
    }

    fn pending(&self, client: ClientId, request: RequestId) -> Option<&Pending> {
        let mut pending = self.clients.get(&client)?.pending.iter();
        pending.find(|one| one.request == request)
    }

    /// Answers a request with an exception [MODBUS §2.6].
    fn refuse(&mut self, client: ClientId, request: RequestId, why: Exception) {
        let asked = self.pending(client, request);
        let function = asked.and_then(|asked| asked.pdu.first().copied());
        let function = function.unwrap_or_default();
        self.answer(client, request, &[function | 0x80, why.0]);
    }

    /// Answers a request, unless its client has disconnected.
    fn answer(&mut self, id: ClientId, request: RequestId, pdu: &[u8]) {
        let Some(client) = self.clients.get_mut(&id) else {
            return;
        };
        let at = client.pending.iter().position(|one| one.request == request);
        let Some(asked) = at.map(|at| client.pending.remove(at)) else {
            return;
        };
        let header = mbap::header(asked.transaction, 1 + pdu.len());
        client.out.extend_from_slice(&header);
        client.out.push(asked.unit);
        client.out.extend_from_slice(pdu);
        match pdu.first() {
            Some(function) if function & 0x80 == 0 => self.answered.good += 1,
            _ => self.answered.refused += 1,
        }
        let told = Output::Answered(id);
        if !self.outputs.contains(&told) {
            self.outputs.push(told);
        }
    }
}

/// Vendor, product, revision and line, as the gateway tells them of itself [BEYOND §5].
fn identification(line: &str, code: u8, object: u8) -> Result<Vec<u8>, Exception> {
    const FIRST: u8 = rtu::Identification::VENDOR;
    let texts = [
        (FIRST, "railbus"),
        (rtu::Identification::PRODUCT, "Modbus gateway"),
        (rtu::Identification::REVISION, env!("CARGO_PKG_VERSION")),
        (rtu::Identification::NAME, line),
    ];
    let listed = match code {
        1 => texts.get(..3).unwrap_or_default(),
        2..=4 => &texts,
        _ => return Err(Exception::VALUE),
    };
    let at = listed.iter().position(|(number, _)| *number == object);
    let wanted = match (code, at) {
        (4, None) => return Err(Exception::ADDRESS),
        (4, Some(at)) => listed.get(at..=at),
        // One that does not exist is the first.
        (_, at) => listed.get(at.unwrap_or(0)..),
    };
    let mut frame = Frame::new();
    let wanted = wanted.unwrap_or_default();
    rtu::encode_identification(Address(verdict::GATEWAY), code, wanted, &mut frame);
    // Without address and CRC.
    let bytes = frame.bytes();
    let pdu = bytes.get(1..bytes.len().saturating_sub(2));
    Ok(pdu.unwrap_or_default().to_vec())
}
