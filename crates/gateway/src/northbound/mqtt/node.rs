//! One outlet without sockets or clock: what is published and when, and which commands are carried
//! out. [`super::driver`] connects it to a broker.
//!
//! Of what the broker keeps, a topic waits for its turn and not a payload: while the broker is slow
//! the newest value of a topic replaces the one before. What the broker does not keep (results and
//! events) waits in queues of a fixed length.

use super::orders::Order;
use super::replay::{Packed, PieceId, Replay};
use super::told::{OFFLINE, ONLINE, Told};
use super::topics::Topics;
use crate::northbound::broker::WINDOW;
use crate::northbound::broker::message::{Message, Received, Verdict};
use crate::northbound::outbox::OutboxState;
use railbus_api::types::SCHEMA;
use railbus_app::api::past;
use railbus_site::{News, Within};
use railbus_store::history::Event;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// How many results and how many events wait before the oldest are dropped.
const QUEUE_MAX: usize = 256;
/// The period of the health message.
pub(super) const HEALTH_EVERY: Duration = Duration::from_secs(10);
/// The longest time in which a broker acknowledges a message.
const ACKNOWLEDGED_MAX: Duration = Duration::from_secs(10);
/// Home Assistant lets go of what is to be told in another form within this time.
const MOVE_WAIT: Duration = Duration::from_secs(3);
/// What the broker refused to keep is published again after this time.
const REFUSED_WAIT: Duration = Duration::from_secs(10);

mod commands;
mod describes;

/// Where a result goes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Reply {
    topic: String,
    response: Option<String>,
    correlation: Option<Vec<u8>>,
    pub(super) id: Option<String>,
}

/// A command that is to be carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Job {
    pub(super) order: Order,
    pub(super) key: Option<String>,
    pub(super) within: Within,
    pub(super) reply: Reply,
}

/// What happens to it.
#[derive(Debug)]
pub(super) enum Input<'i> {
    /// Something is known of the site.
    News(&'i News),
    /// Something happened at the site.
    Event(Box<Event>),
    /// So many events were missed.
    Missed(u64),
    /// The broker has accepted the connection.
    Connected,
    /// The connection has ended.
    Lost,
    /// A message has come.
    Received(Received),
    /// A command has ended like this.
    Ended(Reply, Value),
    /// What the broker said of a message.
    Taken(u64, Verdict),
    /// So much is in the outbox.
    Stored(OutboxState),
    /// What was read of it; none if it could not be.
    Read(Option<Packed>),
    /// It is to end; its topics are to be cleared if it is gone for good.
    Stop { is_gone: bool },
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub(super) enum Output {
    /// Commands are to come from here.
    Subscribe(Vec<String>),
    /// A message is to be published; [`Input::Taken`] has its number.
    Publish(u64, Message),
    /// A command is to be carried out; [`Input::Ended`] has its reply.
    Carry(Box<Job>),
    /// The broker may have something at these topics, which is to be remembered.
    Keep(Vec<String>),
    /// The broker has everything, and others are told that the outlet is there.
    Online,
    /// What is in the outbox after this number is to be read: [`Input::Read`].
    Read(u64),
    /// The broker has what is in the outbox up to this number.
    Delivered(Arc<str>, u64),
}

/// What waits for its turn.
#[derive(Debug, PartialEq)]
enum Due {
    /// The newest of a topic.
    Topic(String),
    /// Whether the outlet is there.
    Bridge(bool),
}

/// A queue of messages that the broker does not keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Queue {
    Results,
    Events,
}

/// What is with the broker or on its way to it.
#[derive(Debug)]
enum Flight {
    /// How the outlet does. If it is lost, there will be a newer one.
    Health,
    /// The newest of a topic.
    Newest(String),
    /// Whether the outlet is there.
    Bridge(bool),
    /// The topic is cleared with it.
    Clear(String),
    /// If it is lost, it is to be published again.
    Said(Queue, Said),
    /// A part of the outbox.
    Piece(PieceId),
}

/// A message that the broker does not keep.
#[derive(Clone, Debug)]
struct Said {
    message: Message,
    /// A connection was lost while it was on its way.
    was_lost: bool,
}

/// A connection.
#[derive(Debug, Default)]
struct Link {
    /// Each with the time since when.
    flights: BTreeMap<u64, (Duration, Flight)>,
    /// The packets that came last, and what was in them.
    packets: VecDeque<(u16, [u8; 32])>,
    /// When it is told again how the outlet does.
    health: Duration,
    /// The topics whose newest payload the broker refused, and when it is published again; none
    /// while it is on its way.
    refused: BTreeMap<String, Option<Duration>>,
    /// Others are told that the outlet is there.
    is_online: bool,
    /// When Home Assistant is told of all modules again.
    describes: Option<Duration>,
}

impl Link {
    /// When the oldest message has been on its way for too long.
    fn stuck_at(&self) -> Option<Duration> {
        let (since, _) = self.flights.values().next()?;
        Some(*since + ACKNOWLEDGED_MAX)
    }
}

/// What was counted since it was last asked.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Counted {
    pub(super) sent: u64,
    pub(super) refused: u64,
    pub(super) dropped: u64,
}

/// How an outlet is set up.
#[derive(Debug)]
pub(super) struct Setup {
    /// What the site is called.
    pub(super) site: String,
    pub(super) topics: Topics,
    /// The kinds of events that are told; empty for all.
    pub(super) events: BTreeSet<String>,
    /// Topics at which an earlier run may have left something.
    pub(super) old: BTreeSet<String>,
    /// It has an outbox.
    pub(super) has_outbox: bool,
}

/// The outlet.
#[derive(Debug)]
pub(super) struct Node {
    site: String,
    topics: Topics,
    kinds: BTreeSet<String>,
    told: Told,
    link: Option<Link>,
    due: VecDeque<Due>,
    /// The topics among them.
    is_due: BTreeSet<String>,
    /// The `attr` of the value that was just published, as it was at that moment.
    attr: Option<(Message, Flight)>,
    results: VecDeque<Said>,
    events: VecDeque<Said>,
    replay: Option<Replay>,
    /// Whose turn it is: what the broker keeps, one of the queues, or the outbox.
    turn: u8,
    outputs: VecDeque<Output>,
    under_way: usize,
    is_ending: bool,
    newest: u64,
    counted: Counted,
    /// The same since it began, with what was received.
    totals: Counted,
    commands: u64,
    commands_refused: u64,
}

impl Node {
    pub(super) fn new(setup: Setup) -> Node {
        let told = Told::new(&setup.site, setup.topics.clone(), setup.old);
        Node {
            site: setup.site,
            topics: setup.topics,
            kinds: setup.events,
            told,
            link: None,
            due: VecDeque::new(),
            is_due: BTreeSet::new(),
            attr: None,
            results: VecDeque::new(),
            events: VecDeque::new(),
            replay: setup.has_outbox.then(Replay::default),
            turn: 0,
            outputs: VecDeque::new(),
            under_way: 0,
            is_ending: false,
            newest: 0,
            counted: Counted::default(),
            totals: Counted::default(),
            commands: 0,
            commands_refused: 0,
        }
    }

    /// Takes what happens. `now` is the time since any fixed moment.
    pub(super) fn handle(&mut self, now: Duration, input: Input<'_>) {
        match input {
            Input::News(news) => self.news(now, news),
            Input::Event(event) => self.event(*event),
            Input::Missed(count) => self.dropped(count),
            Input::Connected => self.connected(now),
            Input::Lost => self.lost(),
            Input::Received(message) => self.received(now, message),
            Input::Ended(reply, result) => {
                self.under_way = self.under_way.saturating_sub(1);
                self.answer(reply, result);
            }
            Input::Taken(number, verdict) => self.taken(now, number, verdict),
            Input::Stored(state) => {
                if let Some(replay) = &mut self.replay {
                    replay.stored(&state);
                }
            }
            Input::Read(packed) => {
                if let Some(replay) = &mut self.replay {
                    replay.read(now, packed);
                }
            }
            Input::Stop { is_gone } => self.stop(is_gone),
        }
    }

    /// What is to be done now; none until something happens or [`Node::deadline`].
    pub(super) fn poll(&mut self, now: Duration) -> Option<Output> {
        if let Some(output) = self.outputs.pop_front() {
            return Some(output);
        }
        let link = self.link.as_mut()?;
        if link.flights.len() >= WINDOW {
            return None;
        }
        if link.health <= now && !self.is_ending {
            link.health = now + HEALTH_EVERY;
            let message = self.health();
            return Some(self.publish(now, message, Flight::Health));
        }
        self.try_again(now);
        self.describe_again(now);
        let replay = self.replay.as_mut().filter(|_| !self.is_ending);
        if let Some(after) = replay.and_then(|replay| replay.next_read(now)) {
            return Some(Output::Read(after));
        }
        // One after the other, so that none of them keeps the others waiting.
        for _ in 0..4 {
            self.turn = (self.turn + 1) % 4;
            let next = match self.turn {
                0 => self.next_due(),
                1 => self.next_said(Queue::Results),
                2 => self.next_said(Queue::Events),
                _ => self.next_piece(),
            };
            if let Some((message, flight)) = next {
                return Some(self.publish(now, message, flight));
            }
        }
        None
    }

    /// When to poll at the latest.
    pub(super) fn deadline(&self) -> Option<Duration> {
        let link = self.link.as_ref().filter(|_| !self.is_ending)?;
        let stuck = link.stuck_at();
        if link.flights.len() >= WINDOW {
            return stuck;
        }
        let again = link.refused.values().flatten().min().copied();
        let replay = self.replay.as_ref().and_then(Replay::deadline);
        [Some(link.health), again, stuck, link.describes, replay]
            .into_iter()
            .flatten()
            .min()
    }

    /// Whether the broker has not acknowledged a message for so long that the connection is of no
    /// use: what others read there is old.
    pub(super) fn is_stuck(&self, now: Duration) -> bool {
        let stuck = self.link.as_ref().and_then(Link::stuck_at);
        stuck.is_some_and(|at| at <= now)
    }

    /// Whether nothing is left to do before it ends.
    pub(super) fn is_done(&self) -> bool {
        let is_due = !self.due.is_empty() || self.attr.is_some();
        let is_idle = |link: &Link| !is_due && link.flights.is_empty();
        self.is_ending && self.link.as_ref().is_none_or(is_idle)
    }

    /// How many messages and commands wait or are under way.
    pub(super) fn waiting(&self) -> usize {
        let flights = self.link.as_ref().map_or(0, |link| link.flights.len());
        let said = self.results.len() + self.events.len();
        let behind = self.replay.as_ref().map_or(0, Replay::behind);
        let behind = usize::try_from(behind).unwrap_or(usize::MAX);
        (self.due.len() + said + flights + self.under_way).saturating_add(behind)
    }

    /// What was counted since this was last called.
    pub(super) fn counted(&mut self) -> Counted {
        std::mem::take(&mut self.counted)
    }

    fn news(&mut self, now: Duration, news: &News) {
        let changed = match news {
            News::Picture(picture) => self.told.picture(picture),
            News::Batch(batch) => self.told.batch(batch),
        };
        if self.told.is_to_be_kept() {
            self.outputs.push_back(Output::Keep(self.told.kept()));
        }
        // Without a connection everything is told once there is one.
        if self.link.is_some() && !self.is_ending {
            self.described(now, &changed);
            changed.into_iter().for_each(|topic| self.due(topic));
        }
        if let Some(link) = &mut self.link {
            // What is told no longer need not be kept.
            let (told, own) = (&self.told, self.topics.bridge_state());
            let is_told = |topic: &String| *topic == own || told.newest(topic).is_some();
            link.refused.retain(|topic, _| is_told(topic));
        }
        self.online_again();
    }

    fn due(&mut self, topic: String) {
        if self.is_due.insert(topic.clone()) {
            self.due.push_back(Due::Topic(topic));
        }
    }

    fn next_due(&mut self) -> Option<(Message, Flight)> {
        if let Some(attr) = self.attr.take() {
            return Some(attr);
        }
        loop {
            let message = |topic: String, payload: &[u8], is_sure| Message {
                topic,
                payload: payload.to_owned(),
                is_retained: true,
                is_sure,
                correlation: None,
            };
            let link = self.link.as_mut()?;
            let is_other = |(_, flight): &(Duration, Flight)| !matches!(flight, Flight::Newest(_));
            if self.due.front() == Some(&Due::Bridge(true)) {
                // Only once it is known that the broker has everything else.
                if !link.flights.values().all(is_other) {
                    return None;
                }
                if !link.refused.is_empty() {
                    self.due.pop_front();
                    continue;
                }
            }
            match self.due.pop_front()? {
                Due::Bridge(is_there) => {
                    link.is_online = is_there;
                    let word = if is_there { ONLINE } else { OFFLINE };
                    let topic = self.topics.bridge_state();
                    let flight = Flight::Bridge(is_there);
                    return Some((message(topic, word.as_bytes(), true), flight));
                }
                Due::Topic(topic) => {
                    // Published already, before its `attr`.
                    if !self.is_due.remove(&topic) {
                        continue;
                    }
                    if let Some(newest) = self.told.newest(&topic) {
                        let newest = message(topic.clone(), &newest.payload, newest.is_sure);
                        // The `attr` of a new value would be taken for that of the one before.
                        if let Some(value) = Topics::value_of(&topic)
                            && let Some(first) = self.told.newest(&value)
                            && self.is_due.remove(&value)
                        {
                            self.attr = Some((newest, Flight::Newest(topic)));
                            let first = message(value.clone(), &first.payload, first.is_sure);
                            return Some((first, Flight::Newest(value)));
                        }
                        return Some((newest, Flight::Newest(topic)));
                    }
                    if self.told.is_old(&topic) {
                        let flight = Flight::Clear(topic.clone());
                        return Some((message(topic, b"", true), flight));
                    }
                }
            }
        }
    }

    fn next_said(&mut self, queue: Queue) -> Option<(Message, Flight)> {
        let said = match queue {
            Queue::Results => self.results.pop_front(),
            Queue::Events => self.events.pop_front(),
        }?;
        Some((said.message.clone(), Flight::Said(queue, said)))
    }

    fn next_piece(&mut self) -> Option<(Message, Flight)> {
        let replay = self.replay.as_mut().filter(|_| !self.is_ending)?;
        let (message, id) = replay.next()?;
        Some((message, Flight::Piece(id)))
    }

    fn publish(&mut self, now: Duration, message: Message, flight: Flight) -> Output {
        self.newest += 1;
        if let Some(link) = &mut self.link {
            link.flights.insert(self.newest, (now, flight));
        }
        Output::Publish(self.newest, message)
    }

    fn connected(&mut self, now: Duration) {
        self.lost();
        self.link = Some(Link {
            health: now + HEALTH_EVERY,
            ..Link::default()
        });
        let commands = self.topics.commands();
        self.outputs.push_back(Output::Subscribe(commands));
        // What is still kept from before is not to be trusted until it has been told anew.
        self.due.push_back(Due::Bridge(false));
        self.told.begin();
        let all = self.told.all();
        all.into_iter().for_each(|topic| self.due(topic));
        self.due.push_back(Due::Bridge(true));
    }

    fn lost(&mut self) {
        self.due.clear();
        self.is_due.clear();
        self.attr = None;
        // What was to be published on that connection is due again with the next one.
        self.outputs
            .retain(|output| !matches!(output, Output::Subscribe(_)));
        if let Some(replay) = &mut self.replay {
            replay.lost();
        }
        let Some(link) = self.link.take() else {
            return;
        };
        for (_, flight) in link.flights.into_values().rev() {
            let Flight::Said(queue, mut said) = flight else {
                continue;
            };
            match queue {
                // It may be why the broker hangs up: where it goes, others have said.
                Queue::Results if said.was_lost => self.dropped(1),
                Queue::Results => {
                    said.was_lost = true;
                    self.results.push_front(said);
                }
                Queue::Events => self.events.push_front(said),
            }
        }
        self.shorten();
    }

    /// Drops the oldest of what is too much.
    fn shorten(&mut self) {
        let over = |queue: &VecDeque<Said>| queue.len().saturating_sub(QUEUE_MAX);
        let (results, events) = (over(&self.results), over(&self.events));
        self.results.drain(..results);
        self.events.drain(..events);
        self.dropped((results + events) as u64);
    }

    fn dropped(&mut self, count: u64) {
        self.counted.dropped += count;
        self.totals.dropped += count;
    }

    fn taken(&mut self, now: Duration, number: u64, verdict: Verdict) {
        let Some(link) = &mut self.link else {
            return;
        };
        let Some((_, flight)) = link.flights.remove(&number) else {
            return;
        };
        let is_refused = verdict == Verdict::Refused;
        for counted in [&mut self.counted, &mut self.totals] {
            match is_refused {
                true => counted.refused += 1,
                false => counted.sent += 1,
            }
        }
        if let Flight::Newest(topic) = &flight
            && self.told.moves(topic)
        {
            link.describes = Some(now + MOVE_WAIT);
        }
        match flight {
            // It stays among those that are to be cleared, for the next connection.
            Flight::Clear(_) if is_refused => {}
            Flight::Clear(topic) => {
                if self.told.cleared(&topic) && !self.is_ending {
                    self.outputs.push_back(Output::Keep(self.told.kept()));
                }
            }
            Flight::Newest(topic) if is_refused => {
                if self.told.newest(&topic).is_some() && Topics::is_vital(&topic) {
                    self.refused(now, topic);
                }
            }
            Flight::Newest(topic) => {
                if link.refused.remove(&topic).is_some() {
                    self.online_again();
                }
            }
            Flight::Bridge(_) if is_refused => {
                let topic = self.topics.bridge_state();
                link.refused.insert(topic, Some(now + REFUSED_WAIT));
            }
            Flight::Piece(id) => {
                let replay = self.replay.as_mut();
                if let Some((epoch, to)) = replay.and_then(|it| it.taken(now, id, verdict)) {
                    self.outputs.push_back(Output::Delivered(epoch, to));
                }
            }
            Flight::Bridge(true) => self.outputs.push_back(Output::Online),
            Flight::Bridge(false) | Flight::Health | Flight::Said(..) => {}
        }
    }

    /// The broker refused what is to be known. What it keeps there is older, so that the outlet
    /// is not there for others until the broker has taken it.
    fn refused(&mut self, now: Duration, topic: String) {
        let Some(link) = self.link.as_mut().filter(|_| !self.is_ending) else {
            return;
        };
        link.refused.insert(topic, Some(now + REFUSED_WAIT));
        if std::mem::take(&mut link.is_online) {
            self.due.push_front(Due::Bridge(false));
        }
    }

    /// Has published again what was refused and whose time has come.
    fn try_again(&mut self, now: Duration) {
        let Some(link) = self.link.as_mut().filter(|_| !self.is_ending) else {
            return;
        };
        let mut again = Vec::new();
        for (topic, at) in &mut link.refused {
            if at.is_some_and(|at| at <= now) {
                *at = None;
                again.push(topic.clone());
            }
        }
        let own = self.topics.bridge_state();
        for topic in again {
            if topic != own {
                self.due(topic);
                continue;
            }
            if let Some(link) = &mut self.link {
                link.refused.remove(&own);
                let is_there = link.refused.is_empty();
                self.due.push_back(Due::Bridge(is_there));
            }
        }
    }

    /// Says that the outlet is there, if the broker has everything now.
    fn online_again(&mut self) {
        let Some(link) = self.link.as_ref().filter(|_| !self.is_ending) else {
            return;
        };
        let is_said = link.is_online || self.due.contains(&Due::Bridge(true));
        if link.refused.is_empty() && !is_said {
            self.due.push_back(Due::Bridge(true));
        }
    }

    /// What the broker may still have at the end.
    pub(super) fn left(&self) -> Vec<String> {
        self.told.left()
    }

    fn stop(&mut self, is_gone: bool) {
        if self.is_ending {
            return;
        }
        self.is_ending = true;
        self.due.clear();
        self.is_due.clear();
        self.attr = None;
        self.due.push_back(Due::Bridge(false));
        if is_gone {
            let all = self.told.clear();
            all.into_iter().for_each(|topic| self.due(topic));
            let own = self.topics.bridge_state();
            self.told.forget(own.clone());
            self.due(own);
        }
    }

    fn event(&mut self, event: Event) {
        let is_wanted = self.kinds.is_empty() || self.kinds.contains(event.kind.name());
        let is_of_others = event
            .module
            .as_ref()
            .is_some_and(|module| !self.topics.has(module));
        if !is_wanted || is_of_others {
            return;
        }
        let told = past::of_event(event);
        let payload = json!({ "schema": SCHEMA, "site": self.site, "event": told });
        let message = unkept(self.topics.event(), &payload, true);
        self.events.push_back(said(message));
        self.shorten();
    }

    fn health(&self) -> Message {
        let mut health = self.told.health();
        if let Some(replay) = &self.replay {
            health.insert("behind".to_owned(), replay.behind().into());
        }
        let counts = [
            ("waiting", self.waiting() as u64),
            ("sent", self.totals.sent),
            ("refused", self.totals.refused),
            ("dropped", self.totals.dropped),
            ("commands", self.commands),
            ("commands_refused", self.commands_refused),
        ];
        health.extend(counts.map(|(name, count)| (name.to_owned(), Value::from(count))));
        unkept(self.topics.bridge_health(), &Value::Object(health), false)
    }
}

fn said(message: Message) -> Said {
    Said {
        message,
        was_lost: false,
    }
}

/// A message that the broker does not keep.
fn unkept(topic: String, payload: &Value, is_sure: bool) -> Message {
    Message {
        topic,
        payload: payload.to_string().into_bytes(),
        is_retained: false,
        is_sure,
        correlation: None,
    }
}

#[cfg(test)]
mod tests;
