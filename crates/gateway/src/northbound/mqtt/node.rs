//! One outlet without sockets or clock: what is published and when, and which commands are carried
//! out. [`super::driver`] connects it to a broker.
//!
//! Of what the broker keeps, a topic waits for its turn and not a payload: while the broker is slow
//! the newest value of a topic replaces the one before. What the broker does not keep (results and
//! events) waits in queues of a fixed length.

use super::ends;
use super::orders::{self, Order, Target};
use super::told::{OFFLINE, ONLINE, Told};
use super::topics::Topics;
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_app::api::past;
use railbus_site::{News, Within};
use railbus_store::history::Event;
use railbus_wire::Micros;
use serde_json::{Map, Value, json};
use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// How many messages are with the broker, or on their way to it, at a time.
pub(super) const WINDOW: usize = 64;
/// How many commands are under way before more are refused.
const COMMANDS_MAX: usize = 64;
/// How many results and how many events wait before the oldest are dropped.
const QUEUE_MAX: usize = 256;
/// How many packets are remembered to know one that comes again.
const PACKETS_MAX: usize = 256;
/// How often it is told how the outlet does.
const HEALTH_EVERY: Duration = Duration::from_secs(30);
/// The time of a command that says none, in milliseconds.
const WITHIN_MS: u64 = 5_000;

/// What is published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// The broker keeps it for those who come later.
    pub(super) is_retained: bool,
    /// Delivered at least once, instead of at most once.
    pub(super) is_sure: bool,
    pub(super) correlation: Option<Vec<u8>>,
}

/// What was received.
#[derive(Clone, Debug, Default)]
pub(super) struct Received {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// The broker kept it for us.
    pub(super) is_retained: bool,
    /// The number of its packet, if it has one.
    pub(super) packet: Option<u16>,
    /// It may have been delivered before.
    pub(super) is_again: bool,
    /// When it expires, in seconds.
    pub(super) expiry: Option<u32>,
    pub(super) response: Option<String>,
    pub(super) correlation: Option<Vec<u8>>,
}

/// Where a result goes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Reply {
    topic: String,
    response: Option<String>,
    correlation: Option<Vec<u8>>,
    id: Option<String>,
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
    /// The connection is no more.
    Lost,
    /// A message has come.
    Received(Received),
    /// A command has ended like this.
    Ended(Reply, Value),
    /// The broker has a message, or has refused it.
    Taken(u64, bool),
    /// It is to end; its topics are to be cleared if it is gone for good.
    Stop { is_gone: bool },
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub(super) enum Output {
    /// Commands are to come from here.
    Subscribe([String; 2]),
    /// A message is to be published; [`Input::Taken`] has its number.
    Publish(u64, Message),
    /// A command is to be carried out; [`Input::Ended`] has its reply.
    Carry(Box<Job>),
    /// The broker may have something at these topics, which is to be remembered.
    Keep(Vec<String>),
    /// The broker has everything, and others are told that the outlet is there.
    Online,
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
    /// If it is lost, there will be a newer one.
    Newest,
    Online,
    /// The topic is cleared with it.
    Clear(String),
    /// If it is lost, it is to be published again.
    Said(Queue, Message),
}

/// A connection.
#[derive(Debug, Default)]
struct Link {
    flights: BTreeMap<u64, Flight>,
    /// The packets that came last, and what was in them.
    packets: VecDeque<(u16, [u8; 32])>,
    /// When it is told again how the outlet does.
    health: Duration,
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
    results: VecDeque<Message>,
    events: VecDeque<Message>,
    /// Whose turn it is: what the broker keeps, or one of the queues.
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
            results: VecDeque::new(),
            events: VecDeque::new(),
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
            Input::News(news) => self.news(news),
            Input::Event(event) => self.event(*event),
            Input::Missed(count) => self.dropped(count),
            Input::Connected => self.connected(now),
            Input::Lost => self.lost(),
            Input::Received(message) => self.received(message),
            Input::Ended(reply, result) => {
                self.under_way = self.under_way.saturating_sub(1);
                self.answer(reply, result);
            }
            Input::Taken(number, is_refused) => self.taken(number, is_refused),
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
            return Some(self.publish(message, Flight::Newest));
        }
        // One after the other, so that none of them keeps the others waiting.
        for _ in 0..3 {
            self.turn = (self.turn + 1) % 3;
            let next = match self.turn {
                0 => self.next_due(),
                1 => self.next_said(Queue::Results),
                _ => self.next_said(Queue::Events),
            };
            if let Some((message, flight)) = next {
                return Some(self.publish(message, flight));
            }
        }
        None
    }

    /// When to poll at the latest.
    pub(super) fn deadline(&self) -> Option<Duration> {
        let link = self.link.as_ref().filter(|_| !self.is_ending)?;
        Some(link.health)
    }

    /// Whether nothing is left to do before it ends.
    pub(super) fn is_done(&self) -> bool {
        let is_idle = |link: &Link| self.due.is_empty() && link.flights.is_empty();
        self.is_ending && self.link.as_ref().is_none_or(is_idle)
    }

    /// How many messages and commands wait or are under way.
    pub(super) fn waiting(&self) -> usize {
        let flights = self.link.as_ref().map_or(0, |link| link.flights.len());
        let said = self.results.len() + self.events.len();
        self.due.len() + said + flights + self.under_way
    }

    /// What was counted since this was last called.
    pub(super) fn counted(&mut self) -> Counted {
        std::mem::take(&mut self.counted)
    }

    fn news(&mut self, news: &News) {
        let changed = match news {
            News::Picture(picture) => {
                let changed = self.told.picture(picture);
                self.outputs.push_back(Output::Keep(self.told.kept()));
                changed
            }
            News::Batch(batch) => self.told.batch(batch),
        };
        // Without a connection everything is told once there is one.
        if self.link.is_some() && !self.is_ending {
            changed.into_iter().for_each(|topic| self.due(topic));
        }
    }

    fn due(&mut self, topic: String) {
        if self.is_due.insert(topic.clone()) {
            self.due.push_back(Due::Topic(topic));
        }
    }

    fn next_due(&mut self) -> Option<(Message, Flight)> {
        loop {
            let message = |topic: String, payload: &[u8], is_sure| Message {
                topic,
                payload: payload.to_owned(),
                is_retained: true,
                is_sure,
                correlation: None,
            };
            match self.due.pop_front()? {
                Due::Bridge(is_there) => {
                    let (word, flight) = match is_there {
                        true => (ONLINE, Flight::Online),
                        false => (OFFLINE, Flight::Newest),
                    };
                    let topic = self.topics.bridge_state();
                    return Some((message(topic, word.as_bytes(), true), flight));
                }
                Due::Topic(topic) => {
                    self.is_due.remove(&topic);
                    if let Some(newest) = self.told.newest(&topic) {
                        let message = message(topic, &newest.payload, newest.is_sure);
                        return Some((message, Flight::Newest));
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
        let message = match queue {
            Queue::Results => self.results.pop_front(),
            Queue::Events => self.events.pop_front(),
        }?;
        Some((message.clone(), Flight::Said(queue, message)))
    }

    fn publish(&mut self, message: Message, flight: Flight) -> Output {
        self.newest += 1;
        if let Some(link) = &mut self.link {
            link.flights.insert(self.newest, flight);
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
        let all = self.told.all();
        all.into_iter().for_each(|topic| self.due(topic));
        self.due.push_back(Due::Bridge(true));
    }

    fn lost(&mut self) {
        self.due.clear();
        self.is_due.clear();
        // What was to be published on that connection is due again with the next one.
        self.outputs
            .retain(|output| !matches!(output, Output::Subscribe(_)));
        let Some(link) = self.link.take() else {
            return;
        };
        for flight in link.flights.into_values().rev() {
            match flight {
                Flight::Said(Queue::Results, message) => self.results.push_front(message),
                Flight::Said(Queue::Events, message) => self.events.push_front(message),
                Flight::Newest | Flight::Online | Flight::Clear(_) => {}
            }
        }
        self.shorten();
    }

    /// Drops the oldest of what is too much.
    fn shorten(&mut self) {
        let over = |queue: &VecDeque<Message>| queue.len().saturating_sub(QUEUE_MAX);
        let (results, events) = (over(&self.results), over(&self.events));
        self.results.drain(..results);
        self.events.drain(..events);
        self.dropped((results + events) as u64);
    }

    fn dropped(&mut self, count: u64) {
        self.counted.dropped += count;
        self.totals.dropped += count;
    }

    fn taken(&mut self, number: u64, is_refused: bool) {
        let Some(link) = &mut self.link else {
            return;
        };
        let Some(flight) = link.flights.remove(&number) else {
            return;
        };
        for counted in [&mut self.counted, &mut self.totals] {
            match is_refused {
                true => counted.refused += 1,
                false => counted.sent += 1,
            }
        }
        match flight {
            Flight::Clear(topic) => {
                if self.told.cleared(&topic) && !self.is_ending {
                    self.outputs.push_back(Output::Keep(self.told.kept()));
                }
            }
            Flight::Online if !is_refused => self.outputs.push_back(Output::Online),
            Flight::Online | Flight::Newest | Flight::Said(..) => {}
        }
    }

    fn stop(&mut self, is_gone: bool) {
        if self.is_ending {
            return;
        }
        self.is_ending = true;
        self.due.clear();
        self.is_due.clear();
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
        self.events.push_back(message);
        self.shorten();
    }

    fn health(&self) -> Message {
        let mut health = self.told.health();
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

    fn received(&mut self, message: Received) {
        let Some(target) = self.topics.target(&message.topic) else {
            return;
        };
        // Another outlet of these topics may have it, and then says how it ended.
        if matches!(&target, Target::Output(module, _) if !self.topics.has(module)) {
            return;
        }
        // So a topic is cleared that should not have been kept.
        let clears = message.is_retained && message.payload.is_empty();
        if self.is_ending || clears || self.was_here(&message) {
            return;
        }
        self.commands += 1;
        let mut reply = Reply {
            topic: Topics::result(&message.topic),
            response: message
                .response
                .filter(|topic| self.topics.may_respond(topic)),
            correlation: message.correlation,
            id: None,
        };
        let order = match message.is_retained {
            true => Err(ends::wrong("a retained command is never carried out")),
            false => orders::parse(target, &message.payload).map_err(ends::wrong),
        };
        let job = order.and_then(|order| {
            reply.id.clone_from(&order.id);
            if self.under_way >= COMMANDS_MAX {
                return Err(Problem::new(codes::OVERLOADED));
            }
            let within = within(order.within_ms, message.expiry)?;
            // Correlation data is no key: MQTT names no sender, and two of them may use the same.
            let key = order.id.clone();
            Ok((order, key, within))
        });
        match job {
            Ok((order, key, within)) => {
                self.under_way += 1;
                let job = Job {
                    order,
                    key,
                    within,
                    reply,
                };
                self.outputs.push_back(Output::Carry(Box::new(job)));
            }
            Err(problem) => {
                self.commands_refused += 1;
                self.answer(reply, ends::refused(problem));
            }
        }
    }

    /// Whether this message was delivered before on the same connection. It is under way or done,
    /// and has its result.
    fn was_here(&mut self, message: &Received) -> bool {
        let (Some(link), Some(packet)) = (&mut self.link, message.packet) else {
            return false;
        };
        let content = digest(&[message.topic.as_bytes(), &message.payload]);
        if message.is_again && link.packets.contains(&(packet, content)) {
            return true;
        }
        // The number belongs to another message now.
        link.packets.retain(|(known, _)| *known != packet);
        link.packets.push_back((packet, content));
        if link.packets.len() > PACKETS_MAX {
            link.packets.pop_front();
        }
        false
    }

    /// Tells a result to all, and to who asked for it.
    fn answer(&mut self, reply: Reply, result: Value) {
        let mut told = Map::new();
        told.insert("id".to_owned(), reply.id.into());
        if let Value::Object(result) = result {
            told.extend(result);
        }
        let told = Value::Object(told);
        self.results.push_back(unkept(reply.topic, &told, true));
        if let Some(topic) = reply.response {
            self.results.push_back(Message {
                correlation: reply.correlation,
                ..unkept(topic, &told, true)
            });
        }
        self.shorten();
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

/// The time within which a command must be sent: what it says, and no more than is left of its
/// message.
fn within(asked_ms: Option<u64>, expiry: Option<u32>) -> Result<Within, Problem> {
    let asked = asked_ms.unwrap_or(WITHIN_MS);
    let checked = Within::new(Micros(asked.saturating_mul(1_000)));
    let checked = checked.ok_or_else(|| ends::wrong("\"within_ms\" is 200 to 60000"))?;
    let Some(seconds) = expiry else {
        return Ok(checked);
    };
    let least = asked.min(u64::from(seconds) * 1_000);
    Within::new(Micros(least * 1_000)).ok_or_else(|| Problem::new(codes::EXPIRED))
}

/// A hash of these parts.
fn digest(parts: &[&[u8]]) -> [u8; 32] {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.finalize().into()
}

#[cfg(test)]
mod tests;
