//! A site's side of its way to the centre, without I/O: it asks for the session, says that it is
//! there, and sends the entries of its outbox in their order until the centre's servers have them.
//!
//! Nothing is sent without a session, so that of two sites with one key only one is heard. What is
//! not acknowledged is sent again, with the same message id: a server that has it already says so,
//! and a receiver knows it by its number.

use crate::message::{Beat, DataBatch, DataEntry, Hello, HelloAnswer, SiteState, Welcome};
use prost::Message as _;
use railbus_store::outbox::{OutboxEntry, Piece};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// How many entries are read at a time.
pub const READ_MAX: usize = 1_024;
/// How many messages are under way at once.
const FLYING_MAX: usize = 16;
/// The longest message with entries, in bytes: one takes 10 s on a line of 64 kbit/s.
const BATCH_MAX: usize = 64 << 10;
/// The longest message that servers take, in bytes, less what belongs to it besides.
const STATE_MAX: usize = (1 << 20) - 1_024;
/// A change waits so long for others, if nothing else is to be sent.
const GATHER: Duration = Duration::from_secs(1);
/// How often it says that it is there.
const BEAT: Duration = Duration::from_secs(10);
/// How often it says how everything is.
const STATE: Duration = Duration::from_secs(15 * 60);
/// Whoever does not answer within this time does not.
const ANSWER_MAX: Duration = Duration::from_secs(10);
/// When it asks again where nobody is at the centre.
const AWAY: Duration = Duration::from_secs(5);
/// The same where another has its session.
const TAKEN: Duration = Duration::from_secs(300);
/// When it sends again what was refused, at first, and at most.
const AGAIN: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// What a site says of itself.
#[derive(Clone, Debug)]
pub struct SiteIdentity {
    /// Its name in the fleet.
    pub site: String,
    /// Which installation this is.
    pub installation: [u8; 16],
    /// Which run of it.
    pub boot: [u8; 16],
    /// The version of railbus.
    pub version: String,
}

/// How the outbox is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OutboxHead {
    /// What its entries are numbered by; empty until it is open.
    pub epoch: Arc<str>,
    /// The number of the newest one.
    pub newest: u64,
    /// Up to which number everything was delivered when it was opened.
    pub delivered: u64,
}

/// What happened.
#[derive(Debug)]
pub enum UplinkInput<'i> {
    /// There is a connection.
    Connected,
    /// There is none any more.
    Lost,
    /// The answer to this message; none if nobody listens there.
    Answer(u64, Option<&'i [u8]>),
    /// The centre ended the session of this name.
    Ended(&'i str),
    /// So much is in the outbox.
    Stored(OutboxHead),
    /// What was read of it; none if that can't be now.
    Read(Option<(Arc<str>, Piece)>),
    /// How every point is after the entry with this number; none if that can't be said now.
    State(Option<(Arc<str>, u64, Vec<OutboxEntry>)>),
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub enum UplinkOutput {
    /// This is published.
    Publish(UpMessage),
    /// From now on the centre asks at these subjects, in the session of this name.
    Listen(String, String),
    /// Entries are read, from after this number on.
    Read(u64),
    /// It is found out how every point is.
    FindState,
    /// The centre's servers have everything up to this number, so many more entries than before.
    Delivered(Arc<str>, u64, u64),
    /// It works.
    Works,
    /// It does not, and is tried again after this time.
    Fails(UplinkFault, Duration),
}

/// Why nothing is sent, or nothing arrives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UplinkFault {
    /// Nobody is at the centre.
    Away,
    /// The centre gives no session, with this code and reason.
    NoSession(String, String),
    /// The servers did not take data, for this reason.
    NotStored(String),
    /// How everything is has more bytes than a message may have.
    StateTooLong(usize),
}

/// A message of the site.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpMessage {
    /// Where it goes.
    pub subject: String,
    /// By which the servers know it if it comes again.
    pub id: Option<String>,
    /// What it says.
    pub payload: Vec<u8>,
    /// By which its answer is known, if there is one.
    pub answer: Option<u64>,
}

/// Whether the site has its session.
#[derive(Debug, PartialEq, Eq)]
enum Session {
    Offline,
    /// It asks at this time.
    Waits(Duration),
    /// It has asked, with this number, and knows at this time that nobody answers.
    Asked(u64, Duration),
    Has(String),
}

/// Entries on their way.
#[derive(Debug)]
struct Flying {
    number: u64,
    last: u64,
    is_stored: bool,
}

/// A site's side of its way to the centre.
#[derive(Debug)]
pub struct Uplink {
    own: SiteIdentity,
    session: Session,
    /// The number of the last message with an answer.
    number: u64,
    outputs: VecDeque<UplinkOutput>,
    beat_at: Option<Duration>,
    state_at: Option<Duration>,
    is_finding_state: bool,
    /// Whose numbers these are, and how far the outbox goes.
    head: OutboxHead,
    /// The centre has everything up to this one.
    delivered: u64,
    /// Everything up to this one is delivered or on its way.
    sent: u64,
    flying: VecDeque<Flying>,
    /// When the oldest of them has been under way for too long.
    answer_by: Option<Duration>,
    /// Since when something is to be sent.
    due_since: Option<Duration>,
    is_reading: bool,
    /// What is being read was asked for before something went wrong.
    is_read_void: bool,
    /// When it goes on after something went wrong, and how often it did.
    again: Option<Duration>,
    refusals: u32,
    /// The wall clock, in milliseconds since 1970.
    clock_ms: i64,
}

impl Uplink {
    /// Of this site, not connected.
    #[must_use]
    pub fn new(own: SiteIdentity) -> Uplink {
        Uplink {
            own,
            session: Session::Offline,
            number: 0,
            outputs: VecDeque::new(),
            beat_at: None,
            state_at: None,
            is_finding_state: false,
            head: OutboxHead::default(),
            delivered: 0,
            sent: 0,
            flying: VecDeque::new(),
            answer_by: None,
            due_since: None,
            is_reading: false,
            is_read_void: false,
            again: None,
            refusals: 0,
            clock_ms: 0,
        }
    }

    /// Its credentials are those of this site.
    pub fn is_site(&mut self, site: String) {
        self.own.site = site;
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: UplinkInput<'_>) {
        match input {
            UplinkInput::Connected => {
                if self.session == Session::Offline {
                    self.session = Session::Waits(now);
                }
            }
            UplinkInput::Lost => {
                self.session = Session::Offline;
                self.begin_anew(None);
            }
            UplinkInput::Answer(number, answer) => self.answer(now, number, answer),
            UplinkInput::Ended(session) => {
                if matches!(&self.session, Session::Has(own) if own == session) {
                    self.ask_again(now, TAKEN);
                    let code = UplinkFault::NoSession(String::new(), "ended by the centre".into());
                    self.outputs.push_back(UplinkOutput::Fails(code, TAKEN));
                }
            }
            UplinkInput::Stored(head) => {
                if self.head.epoch != head.epoch {
                    self.delivered = head.delivered;
                    self.begin_anew(None);
                }
                self.head = head;
                if self.sent < self.head.newest {
                    self.due_since.get_or_insert(now);
                }
            }
            UplinkInput::Read(read) => self.read(now, read),
            UplinkInput::State(state) => self.state(now, state),
        }
    }

    /// What is to be done at this time since the start, and at this one of the wall clock, in
    /// milliseconds since 1970.
    pub fn poll(&mut self, now: Duration, clock_ms: i64) -> Option<UplinkOutput> {
        self.clock_ms = clock_ms;
        if self.outputs.is_empty() {
            self.step(now);
        }
        self.outputs.pop_front()
    }

    /// When it goes on by itself.
    #[must_use]
    pub fn deadline(&self) -> Option<Duration> {
        let session = match self.session {
            Session::Offline => return None,
            Session::Waits(at) => return (!self.head.epoch.is_empty()).then_some(at),
            Session::Asked(_, by) => return Some(by),
            Session::Has(_) => self.beat_at,
        };
        let state = self.state_at.filter(|_| !self.is_finding_state);
        let data = match self.again {
            Some(again) => Some(again),
            None => self.read_at(),
        };
        [session, state, data, self.answer_by]
            .into_iter()
            .flatten()
            .min()
    }

    /// How many entries the centre does not have.
    #[must_use]
    pub const fn behind(&self) -> u64 {
        self.head.newest.saturating_sub(self.delivered)
    }

    fn step(&mut self, now: Duration) {
        match self.session {
            Session::Offline => {}
            // Before there is an outbox, nothing can be said of it.
            Session::Waits(at) if at <= now && !self.head.epoch.is_empty() => self.ask(now),
            Session::Waits(_) => {}
            Session::Asked(_, by) => {
                if by <= now {
                    self.away(now);
                }
            }
            Session::Has(_) => self.work(now),
        }
    }

    fn ask(&mut self, now: Duration) {
        let hello = Hello {
            installation: self.own.installation.to_vec(),
            boot: self.own.boot.to_vec(),
            epoch: self.head.epoch.to_string(),
            newest: self.head.newest,
            version: self.own.version.clone(),
            clock_ms: self.clock_ms,
        };
        let number = self.next_number();
        self.session = Session::Asked(number, now + ANSWER_MAX);
        self.publish("hello", None, hello.encode_to_vec(), Some(number));
    }

    fn away(&mut self, now: Duration) {
        self.ask_again(now, AWAY);
        self.outputs
            .push_back(UplinkOutput::Fails(UplinkFault::Away, AWAY));
    }

    fn ask_again(&mut self, now: Duration, after: Duration) {
        self.session = Session::Waits(now + after);
        self.begin_anew(None);
    }

    fn work(&mut self, now: Duration) {
        if self.beat_at.is_none_or(|at| at <= now) {
            self.beat_at = Some(now + BEAT);
            self.beat(now);
        }
        if self.state_at.is_none_or(|at| at <= now) && !self.is_finding_state {
            self.is_finding_state = true;
            self.outputs.push_back(UplinkOutput::FindState);
        }
        if self.answer_by.is_some_and(|by| by <= now) {
            self.refused(now, "no answer within 10 s".to_owned());
        }
        if self.again.is_some_and(|at| at > now) {
            return;
        }
        self.again = None;
        if self.read_at().is_some_and(|at| at <= now) {
            self.is_reading = true;
            self.outputs.push_back(UplinkOutput::Read(self.sent));
        }
    }

    fn beat(&mut self, now: Duration) {
        let Session::Has(session) = &self.session else {
            return;
        };
        let beat = Beat {
            boot: self.own.boot.to_vec(),
            session: session.clone(),
            time_ms: u64::try_from(now.as_millis()).unwrap_or(u64::MAX),
            epoch: self.head.epoch.to_string(),
            newest: self.head.newest,
            delivered: self.delivered,
            clock_ms: self.clock_ms,
        };
        self.publish("beat", None, beat.encode_to_vec(), None);
    }

    /// When more is read; none while there is nothing, or enough is under way. Few entries wait for
    /// others: a second, or until those before them have arrived.
    fn read_at(&self) -> Option<Duration> {
        let waiting = self.head.newest.saturating_sub(self.sent);
        if waiting == 0 || self.is_reading || self.flying.len() >= FLYING_MAX {
            return None;
        }
        let since = self.due_since?;
        match waiting >= READ_MAX as u64 {
            true => Some(since),
            false if self.flying.is_empty() => Some(since + GATHER),
            false => None,
        }
    }

    fn read(&mut self, now: Duration, read: Option<(Arc<str>, Piece)>) {
        self.is_reading = false;
        if std::mem::take(&mut self.is_read_void) {
            return;
        }
        let read =
            read.filter(|(epoch, piece)| *epoch == self.head.epoch && !piece.entries.is_empty());
        let Some((epoch, piece)) = read else {
            self.begin_anew(Some(now + AGAIN.0));
            return;
        };
        let (batch, last) = pack(&epoch, &piece);
        // Both ends are in it: what begins at the same entry may have more in it the next time, and
        // a server that took it for the one before would leave out the rest.
        let id = format!("{}-{epoch}-{}-{last}", self.own.site, batch.seq);
        let number = self.next_number();
        self.flying.push_back(Flying {
            number,
            last,
            is_stored: false,
        });
        self.answer_by.get_or_insert(now + ANSWER_MAX);
        self.sent = last;
        self.due_since = (self.sent < self.head.newest).then_some(now);
        self.publish("data", Some(id), batch.encode_to_vec(), Some(number));
    }

    fn state(&mut self, now: Duration, state: Option<(Arc<str>, u64, Vec<OutboxEntry>)>) {
        self.is_finding_state = false;
        let Session::Has(session) = &self.session else {
            return;
        };
        let Some((epoch, seq, points)) = state else {
            self.state_at = Some(now + AGAIN.1);
            return;
        };
        self.state_at = Some(now + STATE);
        let state = SiteState {
            session: session.clone(),
            epoch: epoch.to_string(),
            seq,
            points: points.iter().map(DataEntry::from).collect(),
        };
        let payload = state.encode_to_vec();
        if payload.len() > STATE_MAX {
            let fault = UplinkFault::StateTooLong(payload.len());
            self.outputs.push_back(UplinkOutput::Fails(fault, STATE));
            return;
        }
        self.publish("state", None, payload, None);
    }

    fn answer(&mut self, now: Duration, number: u64, answer: Option<&[u8]>) {
        if matches!(self.session, Session::Asked(asked, _) if asked == number) {
            match answer.map(Welcome::decode) {
                None => self.away(now),
                Some(Ok(welcome)) => self.welcome(now, welcome),
                Some(Err(error)) => self.no_session(now, String::new(), error.to_string()),
            }
            return;
        }
        let Some(at) = self
            .flying
            .iter()
            .position(|flying| flying.number == number)
        else {
            // Of an earlier try.
            return;
        };
        if let Err(reason) = is_stored(answer) {
            self.refused(now, reason);
            return;
        }
        if let Some(flying) = self.flying.get_mut(at) {
            flying.is_stored = true;
        }
        let mut newest = None;
        while self.flying.front().is_some_and(|flying| flying.is_stored) {
            newest = self.flying.pop_front().map(|flying| flying.last);
        }
        if let Some(newest) = newest {
            let count = newest.saturating_sub(self.delivered);
            self.delivered = newest;
            self.refusals = 0;
            self.answer_by = (!self.flying.is_empty()).then_some(now + ANSWER_MAX);
            let epoch = Arc::clone(&self.head.epoch);
            self.outputs
                .push_back(UplinkOutput::Delivered(epoch, newest, count));
            self.outputs.push_back(UplinkOutput::Works);
        }
    }

    fn welcome(&mut self, now: Duration, welcome: Welcome) {
        match welcome.answer {
            Some(HelloAnswer::Session(session)) if is_token(&session) => {
                let subjects = format!("rb.down.{}.{session}.*", self.own.site);
                let listen = UplinkOutput::Listen(subjects, session.clone());
                self.outputs.push_back(listen);
                self.outputs.push_back(UplinkOutput::Works);
                self.session = Session::Has(session);
                (self.beat_at, self.state_at) = (None, None);
            }
            Some(HelloAnswer::Refusal(refusal)) => {
                self.no_session(now, refusal.code, refusal.reason);
            }
            _ => self.no_session(now, String::new(), "no session in the answer".to_owned()),
        }
    }

    fn no_session(&mut self, now: Duration, code: String, reason: String) {
        self.ask_again(now, TAKEN);
        let fault = UplinkFault::NoSession(code, reason);
        self.outputs.push_back(UplinkOutput::Fails(fault, TAKEN));
    }

    /// Data did not come in: all that is under way is sent again.
    fn refused(&mut self, now: Duration, reason: String) {
        let wait = AGAIN
            .0
            .saturating_mul(1 << self.refusals.min(6))
            .min(AGAIN.1);
        self.refusals = self.refusals.saturating_add(1);
        self.begin_anew(Some(now + wait));
        let fault = UplinkFault::NotStored(reason);
        self.outputs.push_back(UplinkOutput::Fails(fault, wait));
    }

    /// What is not delivered is read and sent again, at this time or as soon as it can be.
    fn begin_anew(&mut self, at: Option<Duration>) {
        self.flying.clear();
        self.answer_by = None;
        self.sent = self.delivered;
        self.again = at;
        self.is_read_void = self.is_reading;
        self.due_since = (self.sent < self.head.newest).then_some(Duration::ZERO);
    }

    const fn next_number(&mut self) -> u64 {
        self.number += 1;
        self.number
    }

    fn publish(&mut self, what: &str, id: Option<String>, payload: Vec<u8>, answer: Option<u64>) {
        let subject = format!("rb.up.{}.{what}", self.own.site);
        self.outputs.push_back(UplinkOutput::Publish(UpMessage {
            subject,
            id,
            payload,
            answer,
        }));
    }
}

/// As many entries as fit into a message, but one at least, and the number of the last one.
fn pack(epoch: &str, piece: &Piece) -> (DataBatch, u64) {
    let mut batch = DataBatch {
        epoch: epoch.to_owned(),
        seq: piece.first,
        dropped: piece.missing.as_ref().map(Into::into),
        entries: Vec::new(),
    };
    let (mut length, mut last) = (batch.encoded_len(), piece.first);
    for (entry, number) in piece.entries.iter().zip(piece.first..) {
        let entry = DataEntry::from(entry);
        // Its tag and its length.
        length += entry.encoded_len() + 4;
        if length > BATCH_MAX && !batch.entries.is_empty() {
            break;
        }
        batch.entries.push(entry);
        last = number;
    }
    (batch, last)
}

/// Whether a stream has taken a message, as its answer says.
fn is_stored(answer: Option<&[u8]>) -> Result<(), String> {
    let answer = answer.ok_or("no stream takes it")?;
    let answer: serde_json::Value =
        serde_json::from_slice(answer).map_err(|error| error.to_string())?;
    if let Some(error) = answer.get("error") {
        let said = error.get("description").and_then(serde_json::Value::as_str);
        return Err(said.unwrap_or("refused").to_owned());
    }
    match answer.get("stream").and_then(serde_json::Value::as_str) {
        Some("DATA") => Ok(()),
        _ => Err("another stream answers".to_owned()),
    }
}

/// Whether it can stand in a subject.
fn is_token(session: &str) -> bool {
    let is_allowed = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'-';
    (1..=64).contains(&session.len()) && session.bytes().all(is_allowed)
}

#[cfg(test)]
mod tests;
