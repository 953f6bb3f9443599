//! One edge node without sockets or clock: what is published and when, and which commands are
//! carried out. [`super::driver`] connects it to a broker.
//!
//! Messages wait in one queue in the order in which they were made, and get their sequence number
//! as they are handed over: none that was numbered is dropped. Where too many wait, all of them
//! give way to new births, which tell everything anew.

use super::backlog::{Backlog, Devices};
use super::device::{Device, LastCommand};
use super::host::{Host, HostChange, HostState};
use super::payload::{DataType, Metric, MetricValue, Payload};
use super::topics::{Topic, Topics};
use crate::northbound::broker::WINDOW;
use crate::northbound::broker::link::Filter;
use crate::northbound::broker::message::{Message, Received};
use crate::northbound::outbox::OutboxState;
use railbus_site::{News, Rights, Within};
use railbus_store::outbox::Piece;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

mod commands;
mod connection;
mod own;
mod site;

pub(super) use own::death;

use connection::{Link, Phase, Queued};
use own::{missing_metrics, node_metrics};

/// How many messages wait before all of them give way to new births.
const QUEUE_MAX: usize = 4_096;
/// So many messages of now for one of the past, where both wait.
const LIVE_SHARE: u8 = 4;
/// So many bytes of the past may be on their way.
const PAST_MAX: usize = 32 << 10;
/// How often the broker is asked whether everything arrived.
const ASK_EVERY: Duration = Duration::from_secs(2);
/// The primary host is there within this time after a connection, or said to be away: the broker
/// tells of it once that is subscribed.
const HOST_WAIT: Duration = Duration::from_secs(3);
/// The longest time in which the broker answers.
const ANSWER_MAX: Duration = Duration::from_secs(10);

/// The time, by both clocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Now {
    /// Since any fixed moment.
    pub(super) steady: Duration,
    /// In milliseconds since 1970.
    pub(super) wall: u64,
}

/// A command that is to be carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Job {
    pub(super) device: String,
    pub(super) label: String,
    pub(super) on: bool,
    pub(super) within: Within,
}

/// How a command ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct JobEnd {
    pub(super) device: String,
    pub(super) label: String,
    pub(super) end: &'static str,
    /// Why it was not done; empty if it was.
    pub(super) code: String,
}

/// What happens to it.
#[derive(Debug)]
pub(super) enum Input<'i> {
    /// Something is known of the site.
    News(&'i News),
    /// The broker has accepted the connection whose will has this number.
    Connected(u8),
    /// Commands, and the state of the primary host, come from now on, as far as the broker allows.
    Subscribed,
    /// The connection has ended.
    Lost,
    /// A message has come.
    Received(Received),
    /// A command has ended.
    Ended(JobEnd),
    /// A message of this number went out, or the broker has it if it is acknowledged.
    Went(u64),
    /// The broker has every message up to this number.
    Arrived(u64),
    /// So much is in the outbox.
    Stored(OutboxState),
    /// What was read of it; none if it could not be.
    Read(Option<(Arc<str>, Piece)>),
    /// It is to end.
    Stop,
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub(super) enum Output {
    /// These are to come.
    Subscribe(Vec<Filter>),
    /// A message is to be published; [`Input::Went`] has its number.
    Publish(u64, Message),
    /// The broker is to be asked whether everything arrived: [`Input::Arrived`].
    Ask,
    /// A command is to be carried out: [`Input::Ended`].
    Carry(Job),
    /// The births are on their way.
    Online,
    /// They wait for the primary host.
    HostAway,
    /// What came is wrong, for this reason.
    Wrong(String),
    /// Changes of these times are only in memory from now on, which is to be written down.
    Hold(Option<(u64, u64)>),
    /// What is in the outbox after this number is to be read: [`Input::Read`].
    Read(u64),
    /// The broker has what is in the outbox up to this number.
    Delivered(Arc<str>, u64),
}

/// What was counted since it was last asked.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Counted {
    pub(super) sent: u64,
    pub(super) refused: u64,
    pub(super) dropped: u64,
}

/// How an edge node is set up.
#[derive(Debug)]
pub(super) struct Setup {
    /// What the site is called.
    pub(super) site: String,
    pub(super) topics: Topics,
    /// What may be switched.
    pub(super) rights: Rights,
    /// It has an outbox.
    pub(super) has_outbox: bool,
    /// The times between which an earlier run lost what it held.
    pub(super) lost: Option<(u64, u64)>,
}

/// The edge node.
#[derive(Debug)]
pub(super) struct Node {
    setup: Setup,
    devices: Devices,
    host: Host,
    link: Option<Link>,
    backlog: Option<Backlog>,
    /// The time of the newest change that is known.
    seen: u64,
    outputs: VecDeque<Output>,
    under_way: usize,
    is_ending: bool,
    counted: Counted,
}

impl Node {
    pub(super) fn new(setup: Setup) -> Node {
        Node {
            backlog: setup.has_outbox.then(|| Backlog::new(setup.lost)),
            setup,
            devices: BTreeMap::new(),
            host: Host::default(),
            link: None,
            seen: 0,
            outputs: VecDeque::new(),
            under_way: 0,
            is_ending: false,
            counted: Counted::default(),
        }
    }

    /// Takes what happens.
    pub(super) fn handle(&mut self, now: Now, input: Input<'_>) {
        match input {
            Input::News(News::Picture(picture)) => self.picture(now, picture),
            Input::News(News::Batch(batch)) => self.batch(now, batch),
            Input::Connected(bd_seq) => self.connected(now, bd_seq),
            Input::Subscribed => {
                if let Some(link) = &mut self.link {
                    link.is_subscribed = true;
                    link.host_by = Some(now.steady + HOST_WAIT);
                }
                self.bear_if_due(now);
            }
            Input::Lost => self.lost(),
            Input::Received(message) => self.received(now, message),
            Input::Ended(end) => {
                self.under_way = self.under_way.saturating_sub(1);
                self.counted.refused += u64::from(!end.code.is_empty());
                self.ended(now, end);
            }
            Input::Went(number) => self.went(now, number),
            Input::Arrived(number) => self.arrived(now, number),
            Input::Stored(state) => {
                if let Some(backlog) = &mut self.backlog {
                    backlog.stored(&state);
                }
            }
            Input::Read(piece) => self.read(now, piece),
            Input::Stop => {
                self.is_ending = true;
                self.die();
            }
        }
    }

    /// What is to be done now; none until something happens or [`Node::deadline`].
    pub(super) fn poll(&mut self, now: Now) -> Option<Output> {
        if let Some(output) = self.outputs.pop_front() {
            return Some(output);
        }
        if let Some(backlog) = &mut self.backlog
            && let Some(after) = backlog.next_read(now.steady)
        {
            return Some(Output::Read(after));
        }
        let is_full = self.backlog.as_ref().is_some_and(Backlog::is_pressed);
        let link = self.link.as_mut()?;
        let is_pressed = is_full || link.past_bytes() >= PAST_MAX / 2;
        let is_open = link.phase == Phase::Born && link.arrived < link.went;
        if is_open && link.asked.is_none() && (is_pressed || link.ask_at <= now.steady) {
            link.asked = Some(now.steady);
            link.ask_at = now.steady + ASK_EVERY;
            return Some(Output::Ask);
        }
        if link.host_by.take_if(|at| *at <= now.steady).is_some() {
            return Some(Output::HostAway);
        }
        let in_flight = link.handed.saturating_sub(link.went);
        if in_flight >= WINDOW as u64 {
            return None;
        }
        match link.phase {
            Phase::Waiting | Phase::Dead | Phase::Dying(Some(_)) => None,
            Phase::Dying(None) => {
                link.handed += 1;
                link.phase = Phase::Dying(Some(link.handed));
                link.asked = Some(now.steady);
                let message = death(&self.setup.topics, link.bd_seq);
                Some(Output::Publish(link.handed, message))
            }
            Phase::Born => self.next(now),
        }
    }

    /// The next message of a node that is born.
    fn next(&mut self, now: Now) -> Option<Output> {
        let link = self.link.as_mut()?;
        // Nothing of the past before the birth of its device.
        let is_live = link.births > 0 || (link.live < LIVE_SHARE && !link.queue.is_empty());
        let past = match &mut self.backlog {
            // A slow line could not take more in the time in which it has to answer.
            Some(backlog) if !is_live && link.past_bytes() < PAST_MAX => {
                backlog.next(now.wall, &self.devices)
            }
            _ => None,
        };
        let (queued, entries) = match past {
            Some(past) => {
                link.live = 0;
                let queued = Queued {
                    topic: self.setup.topics.device("DDATA", &past.device),
                    payload: Payload {
                        metrics: past.metrics,
                        ..Payload::default()
                    },
                    is_birth: false,
                    tells_missing: false,
                    seen: 0,
                };
                (queued, past.entries)
            }
            None => {
                link.live = link.live.saturating_add(1).min(LIVE_SHARE);
                let queued = link.queue.pop_front()?;
                if queued.is_birth {
                    link.births -= 1;
                }
                (queued, Vec::new())
            }
        };
        link.handed += 1;
        let payload = Payload {
            timestamp: Some(now.wall),
            seq: Some(u64::from(link.seq)),
            ..queued.payload
        };
        link.seq = link.seq.wrapping_add(1);
        let next = link.queue.front();
        link.mark(next.map_or(self.seen, |next| next.seen));
        let payload = payload.bytes();
        if let Some(backlog) = &mut self.backlog {
            backlog.sent(&entries, link.handed);
            if queued.tells_missing {
                backlog.missing_sent(link.handed);
            }
        }
        if !entries.is_empty() {
            link.past.push_back((link.handed, payload.len()));
        }
        let message = Message {
            topic: queued.topic,
            payload,
            is_retained: false,
            is_sure: false,
            correlation: None,
        };
        Some(Output::Publish(link.handed, message))
    }

    /// When to poll at the latest.
    pub(super) fn deadline(&self) -> Option<Duration> {
        let link = self.link.as_ref();
        let asks = link.filter(|link| link.phase == Phase::Born && link.arrived < link.went);
        let asks = asks
            .filter(|link| link.asked.is_none())
            .map(|link| link.ask_at);
        let stuck = link.and_then(|link| link.asked).map(|at| at + ANSWER_MAX);
        let backlog = self.backlog.as_ref().and_then(Backlog::deadline);
        let host = link.and_then(|link| link.host_by);
        [asks, stuck, backlog, host].into_iter().flatten().min()
    }

    /// Whether the broker has not answered for so long that the connection is of no use: what
    /// others read there is old.
    pub(super) fn is_stuck(&self, now: Now) -> bool {
        let asked = self.link.as_ref().and_then(|link| link.asked);
        asked.is_some_and(|at| at + ANSWER_MAX <= now.steady)
    }

    /// Whether the connection is to be ended: the broker knows that the node is dead.
    pub(super) fn is_dead(&self) -> bool {
        let phase = self.link.as_ref().map(|link| link.phase);
        match phase {
            Some(Phase::Dead) => true,
            // Nobody was told that it lives.
            Some(Phase::Waiting) => self.is_ending,
            _ => false,
        }
    }

    /// How many messages and commands wait, are under way, or are not known to have arrived.
    pub(super) fn waiting(&self) -> usize {
        let unknown = |link: &Link| usize::try_from(link.handed.saturating_sub(link.arrived));
        let queued = self.link.as_ref().map_or(0, |link| {
            link.queue.len() + unknown(link).unwrap_or_default()
        });
        let behind = self.backlog.as_ref().map_or(0, Backlog::behind);
        let behind = usize::try_from(behind).unwrap_or(usize::MAX);
        (queued + self.under_way).saturating_add(behind)
    }

    /// What was counted since this was last called.
    pub(super) fn counted(&mut self) -> Counted {
        if let Some(backlog) = &mut self.backlog {
            self.counted.dropped += backlog.dropped();
        }
        std::mem::take(&mut self.counted)
    }

    fn connected(&mut self, now: Now, bd_seq: u8) {
        self.lost();
        self.host.begin();
        self.link = Some(Link::new(now, bd_seq, self.seen));
        let filters = self.setup.topics.filters();
        self.outputs.push_back(Output::Subscribe(filters));
    }

    /// Tells of everything once there is somebody who hears it, and who can ask for it again.
    fn bear_if_due(&mut self, now: Now) {
        let is_host_there = self.setup.topics.host.is_none() || self.host.is_online();
        let is_due = self
            .link
            .as_ref()
            .is_some_and(|link| link.is_subscribed && link.phase == Phase::Waiting);
        if is_due && is_host_there && !self.is_ending {
            self.bear(now);
        }
    }

    fn lost(&mut self) {
        self.link = None;
        // What was to be done on that connection is due again with the next one.
        let is_of_link = |output: &Output| {
            matches!(
                output,
                Output::Subscribe(_) | Output::Online | Output::HostAway
            )
        };
        self.outputs.retain(|output| !is_of_link(output));
        self.devices.values_mut().for_each(Device::unborn);
        if let Some(backlog) = &mut self.backlog {
            backlog.lost();
        }
    }

    /// Tells everything anew: the node and every device that answers, in one block.
    fn bear(&mut self, now: Now) {
        let Some(link) = &mut self.link else {
            return;
        };
        // What was told on this connection and has nothing before it that is dropped now is known.
        let is_known = link.phase == Phase::Born && link.queue.is_empty();
        link.queue.clear();
        link.host_by = None;
        (link.births, link.seq, link.phase) = (0, 0, Phase::Born);
        let online = self.devices.values().filter(|device| device.is_online);
        let missing = self.backlog.as_ref().and_then(Backlog::missing);
        let metrics = node_metrics(&self.setup, link.bd_seq, online.count(), missing, now);
        let topic = self.setup.topics.node("NBIRTH");
        link.push(topic, metrics, true);
        link.tells_missing();
        for (name, device) in &mut self.devices {
            device.unborn();
            if device.is_online {
                let topic = self.setup.topics.device("DBIRTH", name);
                link.push(topic, device.birth(&self.setup.rights, now.wall), true);
            }
        }
        match &mut self.backlog {
            Some(backlog) if is_known => backlog.born(),
            Some(backlog) => backlog.live_from(self.seen + 1),
            None => {}
        }
        self.outputs.push_back(Output::Online);
    }

    /// Says that the node is dead, if somebody was told that it lives.
    fn die(&mut self) {
        if let Some(link) = &mut self.link
            && link.phase == Phase::Born
        {
            link.queue.clear();
            (link.births, link.phase) = (0, Phase::Dying(None));
        }
    }

    fn went(&mut self, now: Now, number: u64) {
        let Some(link) = &mut self.link else {
            return;
        };
        link.went = link.went.max(number);
        self.counted.sent += 1;
        if link.phase == Phase::Dying(Some(number)) {
            // It was acknowledged, and what went before it has arrived as well.
            link.phase = Phase::Dead;
            self.arrived(now, number);
        }
    }

    fn arrived(&mut self, now: Now, number: u64) {
        let Some(link) = &mut self.link else {
            return;
        };
        if link.phase == Phase::Born {
            link.asked = None;
        }
        link.arrived = link.arrived.max(number);
        while link.past.front().is_some_and(|(last, _)| *last <= number) {
            link.past.pop_front();
        }
        let mut until = None;
        while let Some((last, seen)) = link.marks.front().copied()
            && last <= number
        {
            until = Some(seen);
            link.marks.pop_front();
        }
        if let Some(backlog) = &mut self.backlog {
            if let Some(until) = until {
                backlog.live_until(until);
            }
            backlog.arrived(number);
        }
        self.settle(now);
    }

    /// The outbox need not keep what the broker has. What is missing is told.
    fn settle(&mut self, now: Now) {
        let Some(backlog) = &mut self.backlog else {
            return;
        };
        let settled = backlog.settled(&self.devices);
        // In this order: it is on the disk in one of both places.
        let held = settled.held.map(Output::Hold);
        let delivered = settled
            .delivered
            .map(|(epoch, to)| Output::Delivered(epoch, to));
        self.outputs.extend(held);
        self.outputs.extend(delivered);
        if backlog.is_untold() {
            let missing = backlog.missing();
            let link = self.link.as_ref();
            let is_queued =
                link.is_some_and(|link| link.queue.iter().any(|queued| queued.tells_missing));
            if !is_queued && self.is_born() {
                self.tell_node(missing_metrics(missing, now));
                if let Some(link) = &mut self.link {
                    link.tells_missing();
                }
            }
        }
    }

    fn read(&mut self, now: Now, piece: Option<(Arc<str>, Piece)>) {
        if let Some(backlog) = &mut self.backlog {
            backlog.read(now.steady, piece, &self.devices);
            // What was told live has arrived before it was on the disk.
            self.settle(now);
        }
    }

    /// Tells metrics of the node itself.
    fn tell_node(&mut self, metrics: impl IntoIterator<Item = (Metric, DataType)>) {
        let topic = self.setup.topics.node("NDATA");
        if let Some(link) = self.link.as_mut().filter(|link| link.phase == Phase::Born) {
            let metrics = metrics.into_iter().map(|(metric, _)| metric).collect();
            link.push(topic, metrics, false);
        }
    }

    /// Where the broker is slower than the site, what waits gives way to how everything is now.
    fn shorten(&mut self, now: Now) {
        let queued = self.link.as_ref().map_or(0, |link| link.queue.len());
        if queued > QUEUE_MAX {
            // With an outbox what was dropped comes later, as the past.
            if self.backlog.is_none() {
                self.counted.dropped += queued as u64;
            }
            self.bear(now);
        }
    }
}

#[cfg(test)]
mod tests;
