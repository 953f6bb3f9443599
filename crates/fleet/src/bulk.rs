//! One command to many sites, without I/O: its sites are commanded so many at a time, until it is
//! stopped.
//!
//! The order is a record before the first site hears of it. The command to each site is one of the
//! [`crate::ledger`], with the id of the order; to which sites none was sent is recorded at the
//! end. So every process of the centre knows what became of it. docs/decisions/0062

mod one;
mod reasons;

use crate::centre::StoreEnd;
use crate::ledger::{CommandName, CommandTold, EndView, view_of};
use crate::message::{
    BulkEnd, BulkKind, BulkOrder, BulkRecord, BulkUnsent, CommandKind, CommandRecord, FleetRefusal,
};
use crate::names::is_site_name;
use one::{Bulk, BulkStage, is_same};
pub use one::{BulkSiteState, BulkView};
use prost::Message as _;
use reasons::{gone, over, refusal, stopped, uncertain, unconnected};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// Where the records of bulk commands are in place of those of a site: no site is named so.
pub const BULK: &str = "BULK";
/// The most sites of one.
pub const BULK_SITES_MAX: usize = 10_000;
/// The longest record, in bytes: a stream takes no longer ones.
const RECORD_MAX: usize = 250 << 10;
/// How many commands are without a result at a time.
const AT_ONCE: usize = 256;
/// The most that go on at a time.
const RUNNING_MAX: usize = 8;
/// How many are known, with those that go on.
const KEPT: usize = 32;
/// The same with those that could not be recorded, and others may still appear.
const HELD_MAX: usize = 64;
/// The most callers that wait for one.
const CALLERS_MAX: usize = 16;
/// After this time no further site is commanded.
const BEGIN_MAX: Duration = Duration::from_secs(5 * 60);
/// After this time, one without an end is not carried out by anybody any more.
const TAKEN_OVER: Duration = Duration::from_secs(6 * 60);
/// How long a record is waited for that the servers have.
const RECORD_WAIT: Duration = Duration::from_secs(5);
/// How long an order may still appear that could not be stored.
const DROPPED: Duration = Duration::from_secs(60);
/// How long until an end is stored again that could not be.
const STORE_AGAIN: Duration = Duration::from_secs(5);
/// How often.
const STORES_MAX: u32 = 120;

/// What happened.
#[derive(Debug)]
pub enum BulkInput<'i> {
    /// The records up to now were read, and others come as they are stored.
    Connected,
    /// The connection is lost.
    Lost,
    /// The caller with this number gives an order under this id.
    Given(u64, &'i str, BulkOrder),
    /// The caller with this number, of this name, wants no more of its commands to be sent.
    Stop(u64, &'i str, &'i str),
    /// A record of the order with this id: its number in the stream, and how old it is by the
    /// clocks of the servers.
    Record(&'i str, &'i [u8], u64, Duration),
    /// A record of a command to a site. Those of no order are ignored.
    Command(CommandName<'i>, &'i [u8]),
    /// The result of [`BulkOutput::Store`] with this number.
    Stored(&'i str, u64, StoreEnd),
    /// The answer of the ledger to [`BulkOutput::Begin`].
    Told(CommandName<'i>, CommandTold),
    /// The site was not commanded, for this reason.
    Refused(CommandName<'i>, FleetRefusal),
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum BulkOutput {
    /// Store a record at [`BULK`] under this id, provided the number of the last one is `after`; 0
    /// for none.
    Store {
        /// By which its result is known.
        number: u64,
        /// The order.
        id: String,
        /// The record.
        payload: Vec<u8>,
        /// The number of the last one.
        after: u64,
    },
    /// Give the command of this order to this site.
    Begin {
        /// The order, and the command.
        id: String,
        /// The site.
        site: String,
    },
    /// Answer the caller with this number.
    Tell(u64, BulkTold),
}

/// The answer to a caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BulkTold {
    /// It is known by its id.
    Known,
    /// The id stands for another one.
    OtherOrder,
    /// There is none of this id.
    NoSuch,
    /// It could not be recorded, and nothing is sent.
    NotStored,
    /// Whether it is recorded is not known.
    NotKnown,
    /// Too many go on already.
    TooMany,
}

/// Why an order can't be one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BulkWrong {
    /// It names no site, or more than [`BULK_SITES_MAX`].
    Count,
    /// One of its sites can't be one.
    Name,
    /// A site is named twice.
    Twice,
    /// The names are too long together.
    TooLong,
}

impl BulkOrder {
    /// Whether it can be given.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self) -> Result<(), BulkWrong> {
        if self.sites.is_empty() || self.sites.len() > BULK_SITES_MAX {
            return Err(BulkWrong::Count);
        }
        if !self.sites.iter().all(|site| is_site_name(site)) {
            return Err(BulkWrong::Name);
        }
        let names: BTreeSet<&String> = self.sites.iter().collect();
        if names.len() < self.sites.len() {
            return Err(BulkWrong::Twice);
        }
        match self.encoded_len() > RECORD_MAX {
            true => Err(BulkWrong::TooLong),
            false => Ok(()),
        }
    }
}

const _: () = assert!(BEGIN_MAX.as_secs() + 30 < TAKEN_OVER.as_secs());

/// The newest bulk commands of all processes, as one process of the centre knows them.
#[derive(Debug)]
pub struct Bulks {
    bulks: BTreeMap<String, Bulk>,
    outputs: VecDeque<BulkOutput>,
    is_connected: bool,
    /// The number of the last thing that has a result.
    number: u64,
    /// Nothing is due before.
    due: Option<Duration>,
    /// The wall clock, in milliseconds since 1970.
    clock_ms: i64,
    /// How many records could not be decoded.
    unreadable: u64,
    /// How many commands are without a result at a time.
    at_once: usize,
}

impl Default for Bulks {
    fn default() -> Bulks {
        Bulks::with(AT_ONCE)
    }
}

impl Bulks {
    fn with(at_once: usize) -> Bulks {
        Bulks {
            bulks: BTreeMap::new(),
            outputs: VecDeque::new(),
            is_connected: false,
            number: 0,
            due: None,
            clock_ms: 0,
            unreadable: 0,
            at_once,
        }
    }

    /// Whether it hears of all records. Otherwise more may have been sent than it tells.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.is_connected
    }

    /// The time of the wall clock, in milliseconds since 1970. Only what is shown depends on it.
    pub const fn set_clock(&mut self, clock_ms: i64) {
        self.clock_ms = clock_ms;
    }

    /// Those that were recorded, the oldest first.
    pub fn iter(&self) -> impl Iterator<Item = BulkView<'_>> {
        let recorded = self.bulks.iter().filter(|(_, bulk)| bulk.place > 0);
        let mut all: Vec<_> = recorded.map(|(id, bulk)| bulk.view(id)).collect();
        all.sort_by_key(|view| view.place);
        all.into_iter()
    }

    /// The one with this id.
    #[must_use]
    pub fn get(&self, id: &str) -> Option<BulkView<'_>> {
        let (id, bulk) = self.bulks.get_key_value(id)?;
        (bulk.place > 0).then(|| bulk.view(id))
    }

    /// The order with this id.
    #[must_use]
    pub fn order(&self, id: &str) -> Option<&BulkOrder> {
        self.bulks.get(id).map(|bulk| &bulk.order)
    }

    /// How many records could not be decoded.
    #[must_use]
    pub const fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: BulkInput<'_>) {
        self.due = Some(now);
        match input {
            BulkInput::Connected => self.is_connected = true,
            BulkInput::Lost => self.lost(now),
            BulkInput::Given(caller, id, order) => self.given(caller, id, order),
            BulkInput::Stop(caller, id, who) => self.stop(caller, id, who),
            BulkInput::Record(id, payload, number, age) => {
                match BulkRecord::decode(payload).map(|record| record.record) {
                    Ok(Some(record)) => self.record(now, id, record, (number, age)),
                    Ok(None) | Err(_) => self.unreadable += 1,
                }
            }
            BulkInput::Command((site, id), payload) => {
                if let Some(bulk) = self.bulks.get_mut(id)
                    && let Ok(record) = CommandRecord::decode(payload)
                    && let Some(record) = record.record
                {
                    bulk.command(site, id, &record);
                }
            }
            BulkInput::Stored(id, number, end) => self.stored(now, id, number, end),
            BulkInput::Told(name, told) => self.told(name, told),
            BulkInput::Refused((site, id), why) => {
                let clock_ms = self.clock_ms;
                if let Some(bulk) = self.bulks.get_mut(id)
                    && bulk.has_begun(site)
                {
                    bulk.not_sent(site, &why, clock_ms);
                }
            }
        }
    }

    /// What is to be done at this time since the start.
    pub fn poll(&mut self, now: Duration) -> Option<BulkOutput> {
        while self.outputs.is_empty() && self.due.is_some_and(|due| due <= now) {
            self.due = self.step(now);
        }
        self.outputs.pop_front()
    }

    /// When it goes on by itself.
    #[must_use]
    pub const fn deadline(&self) -> Option<Duration> {
        self.due
    }

    fn tell(&mut self, caller: u64, told: BulkTold) {
        self.outputs.push_back(BulkOutput::Tell(caller, told));
    }

    /// Does what is due; when something is next.
    fn step(&mut self, now: Duration) -> Option<Duration> {
        let mut next: Option<Duration> = None;
        let mut at = |due: Duration| next = Some(next.map_or(due, |next| next.min(due)));
        let (outputs, clock_ms) = (&mut self.outputs, self.clock_ms);
        let is_connected = self.is_connected;
        self.bulks.retain(|_, bulk| match &mut bulk.stage {
            BulkStage::Elsewhere(until, callers) if *until <= now => {
                for caller in callers.drain(..) {
                    outputs.push_back(BulkOutput::Tell(caller, BulkTold::NotKnown));
                }
                false
            }
            // What was stored was read by then.
            BulkStage::Dropped(until) if *until <= now => !is_connected,
            BulkStage::Elsewhere(until, _) | BulkStage::Dropped(until) => {
                at(*until);
                true
            }
            _ => true,
        });
        let busy = self.bulks.values().map(Bulk::in_flight).sum::<usize>();
        let mut free = self.at_once.saturating_sub(busy);
        // The oldest first.
        let mut running: Vec<(&String, &mut Bulk)> = self.bulks.iter_mut().collect();
        running.sort_by_key(|(_, bulk)| bulk.place);
        for (id, bulk) in running {
            match &mut bulk.stage {
                BulkStage::Running { until, .. } if *until <= now => {
                    bulk.unsent_rest(&over(), clock_ms);
                }
                BulkStage::Running { until, .. } => at(*until),
                _ => {}
            }
            while free > 0
                && self.is_connected
                && let Some(site) = bulk.begin()
            {
                free -= 1;
                let id = id.clone();
                self.outputs.push_back(BulkOutput::Begin { id, site });
            }
            let is_sent = bulk.is_sent();
            match &mut bulk.stage {
                BulkStage::Running { .. } if is_sent => {
                    bulk.stage = BulkStage::Ending(bulk.end(clock_ms), Some(now), 0);
                }
                BulkStage::Followed(until) if *until <= now && self.is_connected => {
                    bulk.unsent_rest(&gone(), clock_ms);
                    bulk.stage = BulkStage::Ending(bulk.end(clock_ms), Some(now), 0);
                }
                BulkStage::Followed(until) if *until > now => at(*until),
                _ => {}
            }
            if let BulkStage::Ending(end, again, _) = &mut bulk.stage
                && self.is_connected
                && let Some(due) = *again
            {
                if due > now {
                    at(due);
                    continue;
                }
                *again = None;
                self.number += 1;
                bulk.pending = self.number;
                self.outputs.push_back(BulkOutput::Store {
                    number: self.number,
                    id: id.clone(),
                    payload: encoded(BulkKind::End(end.clone())),
                    after: bulk.last,
                });
            }
        }
        self.forget();
        next
    }

    /// Forgets the oldest ones beyond those that are kept, but none that this process carries out.
    fn forget(&mut self) {
        while self.bulks.len() > KEPT {
            let old = self.bulks.iter().filter(|(_, bulk)| !bulk.is_ours());
            let oldest = old.min_by_key(|(_, bulk)| (!bulk.has_ended(), bulk.place));
            let Some(id) = oldest.map(|(id, _)| id.clone()) else {
                return;
            };
            self.bulks.remove(&id);
        }
    }

    fn given(&mut self, caller: u64, id: &str, order: BulkOrder) {
        if let Some(bulk) = self.bulks.get_mut(id) {
            let told = match &mut bulk.stage {
                _ if !is_same(&bulk.order, &order) => BulkTold::OtherOrder,
                BulkStage::Dropped(_) => BulkTold::NotKnown,
                BulkStage::Storing(callers) | BulkStage::Elsewhere(_, callers)
                    if callers.len() < CALLERS_MAX =>
                {
                    callers.push(caller);
                    return;
                }
                BulkStage::Storing(_) | BulkStage::Elsewhere(..) => BulkTold::TooMany,
                _ => BulkTold::Known,
            };
            return self.tell(caller, told);
        }
        if !self.is_connected {
            return self.tell(caller, BulkTold::NotStored);
        }
        let running = self.bulks.values().filter(|bulk| bulk.is_running()).count();
        if running >= RUNNING_MAX || self.bulks.len() >= HELD_MAX {
            return self.tell(caller, BulkTold::TooMany);
        }
        self.number += 1;
        self.outputs.push_back(BulkOutput::Store {
            number: self.number,
            id: id.to_owned(),
            payload: encoded(BulkKind::Order(order.clone())),
            after: 0,
        });
        let bulk = Bulk::new(order, BulkStage::Storing(vec![caller]), self.number);
        self.bulks.insert(id.to_owned(), bulk);
    }

    fn stop(&mut self, caller: u64, id: &str, who: &str) {
        let clock_ms = self.clock_ms;
        let Some(bulk) = self.bulks.get_mut(id) else {
            return self.tell(caller, BulkTold::NoSuch);
        };
        let is_stopped = !bulk.stopped_by.is_empty();
        let told = match &mut bulk.stage {
            // The caller is answered once the order is recorded: then none of it is sent.
            BulkStage::Storing(_) if bulk.stop_callers.len() < CALLERS_MAX => {
                bulk.stop_callers.push(caller);
                bulk.stopped(who, clock_ms);
                return;
            }
            BulkStage::Storing(_) => BulkTold::TooMany,
            BulkStage::Elsewhere(..) => BulkTold::NotKnown,
            BulkStage::Dropped(_) => BulkTold::NoSuch,
            BulkStage::Running { .. } => {
                bulk.stopped(who, clock_ms);
                BulkTold::Known
            }
            BulkStage::Followed(_) if is_stopped => BulkTold::Known,
            BulkStage::Followed(_) if !self.is_connected => BulkTold::NotStored,
            BulkStage::Followed(_) if bulk.stopping.is_some() => BulkTold::TooMany,
            BulkStage::Followed(_) => {
                self.number += 1;
                bulk.stopping = Some((self.number, caller));
                let store = BulkOutput::Store {
                    number: self.number,
                    id: id.to_owned(),
                    payload: encoded(BulkKind::Stop(who.to_owned())),
                    after: bulk.last,
                };
                self.outputs.push_back(store);
                return;
            }
            // There is nothing left to stop.
            BulkStage::Ending(..) | BulkStage::Ended => BulkTold::Known,
        };
        self.tell(caller, told);
    }

    /// The order that these callers wanted to stop is not carried out here.
    fn not_stopped(&mut self, callers: Vec<u64>) {
        for caller in callers {
            self.tell(caller, BulkTold::NotKnown);
        }
    }

    /// A record is in the stream.
    fn record(
        &mut self,
        now: Duration,
        id: &str,
        record: BulkKind,
        (number, age): (u64, Duration),
    ) {
        let clock_ms = self.clock_ms;
        let followed = || BulkStage::Followed(now + TAKEN_OVER.saturating_sub(age));
        match (record, self.bulks.get_mut(id)) {
            (BulkKind::Order(order), None) => {
                if order.check().is_ok() {
                    let mut bulk = Bulk::new(order, followed(), 0);
                    (bulk.place, bulk.last) = (number, number);
                    self.bulks.insert(id.to_owned(), bulk);
                    self.forget();
                } else {
                    self.unreadable += 1;
                }
            }
            (BulkKind::Order(order), Some(bulk)) => {
                let is_ours = order.token == bulk.order.token;
                match &mut bulk.stage {
                    // Its callers were told that it is not recorded: nothing is sent.
                    BulkStage::Dropped(_) if is_ours => {
                        (bulk.place, bulk.last) = (number, number);
                        bulk.unsent_rest(&uncertain(), clock_ms);
                        bulk.stage = BulkStage::Ending(bulk.end(clock_ms), Some(now), 0);
                    }
                    // The result of storing it comes.
                    BulkStage::Storing(_) if is_ours => bulk.seen = Some(number),
                    // Another one was first: this one is not stored.
                    BulkStage::Storing(_) | BulkStage::Dropped(_) | BulkStage::Elsewhere(..) => {
                        let told = match is_same(&order, &bulk.order) {
                            true => BulkTold::Known,
                            false => BulkTold::OtherOrder,
                        };
                        let (callers, stops) = (bulk.callers(), bulk.stops());
                        *bulk = Bulk::new(order, followed(), 0);
                        (bulk.place, bulk.last) = (number, number);
                        for caller in callers {
                            self.tell(caller, told);
                        }
                        self.not_stopped(stops);
                    }
                    // The stream was restored, and has it under another number.
                    _ if is_ours && bulk.place != number => {
                        (bulk.place, bulk.last) = (number, number);
                    }
                    _ => {}
                }
            }
            (BulkKind::Stop(who), Some(bulk)) => {
                bulk.last = bulk.last.max(number);
                bulk.stopped(&who, clock_ms);
            }
            (BulkKind::End(end), Some(bulk)) => {
                bulk.last = bulk.last.max(number);
                bulk.ended(&end);
            }
            // That of an order which is older than what is read.
            (BulkKind::Stop(_) | BulkKind::End(_), None) => {}
        }
    }

    fn stored(&mut self, now: Duration, id: &str, number: u64, end: StoreEnd) {
        let clock_ms = self.clock_ms;
        let Some(bulk) = self.bulks.get_mut(id) else {
            return;
        };
        if let Some((_, caller)) = bulk.stopping.take_if(|(of, _)| *of == number) {
            // Another stop, or the end of the order, was heard.
            let is_over = !bulk.stopped_by.is_empty() || bulk.has_ended();
            let told = match end {
                StoreEnd::Stored(last) => {
                    bulk.last = bulk.last.max(last);
                    BulkTold::Known
                }
                StoreEnd::Conflict if is_over => BulkTold::Known,
                StoreEnd::Conflict | StoreEnd::Unknown => BulkTold::NotKnown,
            };
            return self.tell(caller, told);
        }
        if bulk.pending != number {
            return;
        }
        match (&mut bulk.stage, end) {
            (BulkStage::Storing(_), StoreEnd::Stored(place)) => {
                let callers = bulk.callers().into_iter().chain(bulk.stops());
                let callers: Vec<u64> = callers.collect();
                (bulk.place, bulk.last) = (place, bulk.last.max(place));
                bulk.stage = BulkStage::Running {
                    queue: bulk.order.sites.iter().cloned().collect(),
                    until: now + BEGIN_MAX,
                };
                // It was stopped before that was known.
                if !bulk.stopped_by.is_empty() {
                    bulk.unsent_rest(&stopped(), clock_ms);
                }
                for caller in callers {
                    self.tell(caller, BulkTold::Known);
                }
            }
            (BulkStage::Storing(_), StoreEnd::Conflict) => {
                let (callers, stops) = (bulk.callers(), bulk.stops());
                bulk.stage = BulkStage::Elsewhere(now + RECORD_WAIT, callers);
                self.not_stopped(stops);
            }
            (BulkStage::Storing(_), StoreEnd::Unknown) => self.dropped(now, id),
            (BulkStage::Ending(end, None, _), StoreEnd::Stored(last)) => {
                let end = end.clone();
                bulk.last = bulk.last.max(last);
                bulk.ended(&end);
            }
            // Given up. It is true all the same; after a restart, a process records it again.
            (BulkStage::Ending(end, None, STORES_MAX), _) => {
                let end = end.clone();
                bulk.ended(&end);
            }
            // A record of another process comes.
            (BulkStage::Ending(_, again @ None, tries), StoreEnd::Conflict | StoreEnd::Unknown) => {
                *again = Some(now + STORE_AGAIN);
                *tries += 1;
            }
            _ => {}
        }
    }

    /// The order could not be stored: nothing is sent, also if it was.
    fn dropped(&mut self, now: Duration, id: &str) {
        let Some(bulk) = self.bulks.get_mut(id) else {
            return;
        };
        let (callers, order) = (bulk.callers(), bulk.order.clone());
        bulk.stage = BulkStage::Dropped(now + DROPPED);
        let (seen, stops) = (bulk.seen.take(), bulk.stops());
        for caller in callers {
            self.tell(caller, BulkTold::NotStored);
        }
        self.not_stopped(stops);
        if let Some(number) = seen {
            let order = BulkKind::Order(order);
            self.record(now, id, order, (number, Duration::ZERO));
        }
    }

    /// The ledger knows what came of a command, or that nothing was sent.
    fn told(&mut self, (site, id): CommandName<'_>, told: CommandTold) {
        let clock_ms = self.clock_ms;
        let Some(bulk) = self.bulks.get_mut(id).filter(|bulk| bulk.has_begun(site)) else {
            return;
        };
        let never = match told {
            CommandTold::End(end) => {
                bulk.command(site, id, &CommandKind::End((*end).clone()));
                return bulk.settled(site);
            }
            // It was sent. Its record may not have come back yet.
            CommandTold::Waiting => return bulk.sent(site),
            CommandTold::NotKnown => {
                bulk.not_known(site, clock_ms);
                return bulk.settled(site);
            }
            CommandTold::Offline => refusal("E0168", "it is not online"),
            CommandTold::OtherCommand => {
                refusal("E0806", "this Idempotency-Key stands for another command")
            }
            CommandTold::NotStored => refusal("E0164", "not sent: it could not be recorded first"),
            CommandTold::TooMany => refusal("E0105", "too many commands without a result"),
        };
        bulk.not_sent(site, &never, clock_ms);
    }

    /// The connection is lost: what has not begun does not begin later.
    fn lost(&mut self, now: Duration) {
        self.is_connected = false;
        let clock_ms = self.clock_ms;
        // What was not begun is among the others.
        for output in std::mem::take(&mut self.outputs) {
            match output {
                BulkOutput::Begin { id, site } => {
                    if let Some(bulk) = self.bulks.get_mut(&id) {
                        bulk.not_sent(&site, &unconnected(), clock_ms);
                    }
                }
                BulkOutput::Tell(..) => self.outputs.push_back(output),
                BulkOutput::Store { .. } => {}
            }
        }
        let mut unstored = Vec::new();
        let mut told = Vec::new();
        for (id, bulk) in &mut self.bulks {
            if let Some((_, caller)) = bulk.stopping.take() {
                told.push((caller, BulkTold::NotKnown));
            }
            match &mut bulk.stage {
                BulkStage::Storing(_) => unstored.push(id.clone()),
                BulkStage::Elsewhere(until, callers) => {
                    *until = now;
                    let callers = callers.drain(..);
                    told.extend(callers.map(|caller| (caller, BulkTold::NotKnown)));
                }
                BulkStage::Running { .. } => bulk.unsent_rest(&unconnected(), clock_ms),
                BulkStage::Ending(_, again, _) => *again = Some(now),
                _ => {}
            }
            bulk.pending = 0;
        }
        for (caller, told) in told {
            self.tell(caller, told);
        }
        for id in unstored {
            self.dropped(now, &id);
        }
    }
}

fn encoded(kind: BulkKind) -> Vec<u8> {
    let record = Some(kind);
    BulkRecord { record }.encode_to_vec()
}

#[cfg(test)]
mod tests;
