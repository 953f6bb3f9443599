//! The site's end of its connection to the centre, without I/O: it asks for a session, sends
//! heartbeats, and sends the entries of its outbox until the centre's servers have stored them.
//!
//! Nothing is sent without a session, so that of two machines with one key only one reports. What
//! is not acknowledged is sent again; a receiver recognises it by its numbers.

mod renewal;
mod transfer;

use crate::creds::SiteClaims;
use crate::message::{Beat, ConfigReport, DataEntry, Hello, HelloAnswer, SiteState, Welcome};
use prost::Message as _;
use railbus_store::outbox::{OutboxEntry, Piece};
use renewal::Renewal;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use transfer::{NextRead, Sender, Transfer, TransferEnd};
pub use transfer::{NoResend, OutboxHead};

/// How many entries are read at a time.
pub const READ_MAX: usize = 1_024;
/// The longest message with entries, in bytes: one takes 10 s on a line of 64 kbit/s.
const BATCH_MAX: usize = 64 << 10;
/// The longest message that servers take by default, in bytes.
const MESSAGE_MAX: usize = 1 << 20;
/// What belongs to a message besides what it says, in bytes: subjects and headers.
const AROUND: usize = 1_024;
/// The interval of heartbeats.
const BEAT: Duration = Duration::from_secs(10);
/// The interval of the state of all points.
const STATE: Duration = Duration::from_secs(15 * 60);
/// The timeout of a request for a session.
const ANSWER_MAX: Duration = Duration::from_secs(10);
/// The retry interval while the centre is away.
const AWAY: Duration = Duration::from_secs(5);
/// The same after it was refused a session.
const TAKEN: Duration = Duration::from_secs(300);
/// The same while it is not acknowledged.
const STATE_AGAIN: Duration = Duration::from_secs(60);

/// How many messages that say how everything is are remembered: their answers count.
const STATES_MAX: usize = 4;

/// What a site says of itself.
#[derive(Clone, Debug)]
pub struct SiteIdentity {
    /// Which installation this is.
    pub installation: [u8; 16],
    /// Which run of it.
    pub boot: [u8; 16],
    /// The version of railbus.
    pub version: String,
}

/// What happened.
#[derive(Debug)]
pub enum UplinkInput<'i> {
    /// There is a connection, on which messages of so many bytes are taken.
    Connected(usize),
    /// There is none any more.
    Lost,
    /// The reply to this message; none if it has no responder.
    Answer(u64, Option<&'i [u8]>),
    /// The centre ended the session of this name.
    Ended(&'i str),
    /// So much is in the outbox.
    Stored(OutboxHead),
    /// The disk of the outbox hangs, or does no longer.
    Stuck(bool),
    /// What was read of it; none if that can't be now. A piece without entries has none of those
    /// that were wanted again.
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
    /// The centre asks nothing more.
    Unlisten,
    /// Entries are read, from after this number on.
    Read(u64),
    /// Entries from one number to another are read, which are delivered.
    ReadAgain((u64, u64)),
    /// It is found out how every point is.
    FindState,
    /// The centre's servers have everything up to this number, or were told that it was dropped: so
    /// many entries more than before.
    Delivered(Arc<str>, u64, u64),
    /// The centre issued these claims, signed, for the key of a site: probably this one.
    Renewed(String),
    /// It issued none, for this reason, and is asked again.
    NotRenewed(String),
    /// It works.
    Works,
    /// It does not, and is tried again after this time.
    Fails(UplinkFault, Duration),
}

/// Why nothing is sent, or nothing arrives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UplinkFault {
    /// The centre does not answer.
    Away,
    /// The centre gives no session, with this code and reason.
    NoSession(String, String),
    /// The servers did not take data, for this reason.
    NotStored(String),
    /// How everything is has more bytes than a message may have.
    StateTooLong(usize),
    /// The site's own disk does not take changes.
    NotRecorded,
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
    /// Asks at this time.
    Waits(Duration),
    /// Asked, with this number; the request times out at this time.
    Asked(u64, Duration),
    Has(String),
}

/// A site's side of its way to the centre.
#[derive(Debug)]
pub struct Uplink {
    own: SiteIdentity,
    /// Its name in the fleet.
    site: String,
    /// Until when its key is valid, in seconds since 1970; none where it does not expire.
    key_expires_s: Option<i64>,
    renewal: Renewal,
    session: Session,
    /// The number of the last message with an answer.
    number: u64,
    outputs: VecDeque<UplinkOutput>,
    beat_at: Option<Duration>,
    state_at: Option<Duration>,
    is_finding_state: bool,
    /// The numbers of the last messages that said how everything is.
    states_asked: VecDeque<u64>,
    /// How many bytes the last one has, until it is answered.
    state_len: usize,
    /// When it was sent.
    state_sent: Duration,
    /// It was too long: the centre does not know how everything is.
    is_state_missing: bool,
    transfer: Transfer,
    is_stuck: bool,
    /// The longest message on this connection.
    message_max: usize,
    /// The wall clock, in milliseconds since 1970.
    clock_ms: i64,
    /// How far its configuration is, if it takes one from the centre.
    config: Option<ConfigReport>,
}

impl Uplink {
    /// Of this site, not connected.
    #[must_use]
    pub fn new(own: SiteIdentity) -> Uplink {
        Uplink {
            own,
            site: String::new(),
            key_expires_s: None,
            renewal: Renewal::default(),
            session: Session::Offline,
            number: 0,
            outputs: VecDeque::new(),
            beat_at: None,
            state_at: None,
            is_finding_state: false,
            states_asked: VecDeque::new(),
            state_len: 0,
            state_sent: Duration::ZERO,
            is_state_missing: false,
            transfer: Transfer::default(),
            is_stuck: false,
            message_max: MESSAGE_MAX,
            clock_ms: 0,
            config: None,
        }
    }

    /// Sets how far the configuration is; none where the site takes none from the centre. The
    /// centre hears of it at once.
    pub fn set_config(&mut self, config: Option<ConfigReport>) {
        if self.config != config {
            self.config = config;
            self.beat_at = self.beat_at.map(|_| Duration::ZERO);
        }
    }

    /// Whether it has a session with the centre.
    #[must_use]
    pub const fn has_session(&self) -> bool {
        matches!(self.session, Session::Has(_))
    }

    /// Sets what the credentials say, and the signed claims in them.
    pub fn set_claims(&mut self, claims: &SiteClaims, token: String) {
        self.site.clone_from(&claims.site);
        self.key_expires_s = claims.expires.and_then(|at| i64::try_from(at).ok());
        self.renewal.set_claims(claims, token);
    }

    /// When its key expires, in seconds since 1970, if that is within so many seconds; none
    /// otherwise. `now` is the time since the start, `clock_ms` the wall clock in milliseconds
    /// since 1970, which counts only as long as that of the centre is not known.
    #[must_use]
    pub fn key_ends(&self, now: Duration, clock_ms: i64, within_s: u64) -> Option<i64> {
        let (left, _) = self.renewal.left(now, clock_ms)?;
        self.key_expires_s.filter(|_| left < within_s)
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: UplinkInput<'_>) {
        match input {
            UplinkInput::Connected(message_max) => {
                self.message_max = message_max;
                if self.session == Session::Offline {
                    self.session = Session::Waits(now);
                    if !self.can_vouch() {
                        self.not_recorded();
                    }
                }
            }
            UplinkInput::Lost => self.leave(Session::Offline),
            UplinkInput::Answer(number, answer) => self.answer(now, number, answer),
            UplinkInput::Ended(session) => {
                if matches!(&self.session, Session::Has(own) if own == session) {
                    self.ask_again(now, TAKEN);
                    let code = UplinkFault::NoSession(String::new(), "ended by the centre".into());
                    self.outputs.push_back(UplinkOutput::Fails(code, TAKEN));
                }
            }
            UplinkInput::Stored(head) => {
                let is_other = self.transfer.head().epoch != head.epoch;
                let could = self.can_vouch();
                self.transfer.stored(now, head);
                self.vouches(could);
                if is_other {
                    // Numbers mean something else from now on.
                    self.state_at = None;
                }
            }
            UplinkInput::Stuck(is_stuck) => {
                let could = self.can_vouch();
                self.is_stuck = is_stuck;
                self.vouches(could);
            }
            UplinkInput::Read(read) => self.read(now, read),
            UplinkInput::State(state) => self.state(now, state),
        }
    }

    /// Entries that are delivered are wanted again, from one number to another.
    ///
    /// # Errors
    /// [`NoResend`].
    pub fn resend(&mut self, epoch: &str, span: (u64, u64)) -> Result<(), NoResend> {
        self.transfer.resend(epoch, span)
    }

    /// Sends the state of all points now, unless one is already on its way.
    pub const fn send_state(&mut self) {
        if self.state_len == 0 {
            self.state_at = None;
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
            Session::Waits(at) => return self.can_ask().then_some(at),
            Session::Asked(_, by) => return Some(by),
            Session::Has(_) => self.beat_at.filter(|_| self.can_vouch()),
        };
        let state = self.state_at.filter(|_| !self.is_finding_state);
        let data = self.transfer.deadline();
        [session, state, data].into_iter().flatten().min()
    }

    /// Whether what is recorded is all that happened.
    const fn can_vouch(&self) -> bool {
        !self.transfer.head().is_failing && !self.is_stuck
    }

    /// It can vouch for what it has told, or can't any more.
    fn vouches(&mut self, could: bool) {
        match (could, self.can_vouch()) {
            (true, false) => self.not_recorded(),
            (false, true) => self.works(),
            _ => {}
        }
    }

    fn not_recorded(&mut self) {
        let fault = UplinkOutput::Fails(UplinkFault::NotRecorded, AWAY);
        self.outputs.push_back(fault);
    }

    /// Unless something else is wrong.
    fn works(&mut self) {
        let has_session = matches!(self.session, Session::Has(_));
        if has_session && self.can_vouch() && !self.is_state_missing {
            self.outputs.push_back(UplinkOutput::Works);
        }
    }

    /// How many entries the centre does not have.
    #[must_use]
    pub const fn behind(&self) -> u64 {
        self.transfer.behind()
    }

    fn step(&mut self, now: Duration) {
        match self.session {
            Session::Offline => {}
            // Before there is an outbox, nothing can be said of it.
            Session::Waits(at) if at <= now && self.can_ask() => self.ask(now),
            Session::Waits(_) => {}
            Session::Asked(_, by) => {
                if by <= now {
                    self.away(now);
                }
            }
            Session::Has(_) => self.work(now),
        }
    }

    fn can_ask(&self) -> bool {
        !self.transfer.head().epoch.is_empty() && self.can_vouch()
    }

    fn ask(&mut self, now: Duration) {
        let hello = Hello {
            installation: self.own.installation.to_vec(),
            boot: self.own.boot.to_vec(),
            epoch: self.transfer.head().epoch.to_string(),
            newest: self.transfer.head().newest,
            version: self.own.version.clone(),
            clock_ms: self.clock_ms,
            key_expires_s: self.key_expires_s,
            time_ms: millis(now),
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
        self.leave(Session::Waits(now + after));
    }

    /// There is no session any more, and nothing is said in it.
    fn leave(&mut self, session: Session) {
        if matches!(self.session, Session::Has(_)) {
            self.outputs.push_back(UplinkOutput::Unlisten);
        }
        self.session = session;
        let is_said = |output: &UplinkOutput| {
            matches!(output, UplinkOutput::Publish(_) | UplinkOutput::Listen(..))
        };
        self.outputs.retain(|output| !is_said(output));
        self.states_asked.clear();
        self.state_len = 0;
        self.transfer.begin_anew(None);
    }

    fn work(&mut self, now: Duration) {
        // A heartbeat vouches for the values that were sent.
        if self.beat_at.is_none_or(|at| at <= now) && self.can_vouch() {
            self.beat_at = Some(now + BEAT);
            self.beat(now);
        }
        if self.state_at.is_none_or(|at| at <= now) && !self.is_finding_state {
            self.is_finding_state = true;
            self.outputs.push_back(UplinkOutput::FindState);
        }
        if self.renewal.is_due(now, self.clock_ms) {
            let number = self.next_number();
            let request = self.renewal.ask(now, number);
            self.publish("renew", None, request, Some(number));
        }
        if self.transfer.is_overdue(now) {
            self.refused(now, "no answer in time".to_owned());
        }
        if let Some(read) = self.transfer.next(now) {
            self.outputs.push_back(match read {
                NextRead::After(number) => UplinkOutput::Read(number),
                NextRead::Again(span) => UplinkOutput::ReadAgain(span),
            });
        }
    }

    fn beat(&mut self, now: Duration) {
        let Session::Has(session) = &self.session else {
            return;
        };
        let state = (self.state_len > 0).then_some(self.state_sent);
        let waits = [state, self.transfer.oldest()].into_iter().flatten().min();
        let beat = Beat {
            boot: self.own.boot.to_vec(),
            session: session.clone(),
            time_ms: millis(now),
            epoch: self.transfer.head().epoch.to_string(),
            newest: self.transfer.head().newest,
            delivered: self.transfer.delivered(),
            clock_ms: self.clock_ms,
            waits_ms: waits.map_or(0, |since| millis(now.saturating_sub(since))),
            key_expires_s: self.key_expires_s,
            config: self.config.clone(),
        };
        self.publish("beat", None, beat.encode_to_vec(), None);
    }

    fn read(&mut self, now: Duration, read: Option<(Arc<str>, Piece)>) {
        let session = match &self.session {
            Session::Has(session) => session,
            // Nothing is sent without one.
            _ => "",
        };
        let sender = Sender {
            site: &self.site,
            boot: &self.own.boot,
            session,
            most: BATCH_MAX.min(self.message_max.saturating_sub(AROUND)),
            other_bytes: self.state_len,
            number: self.number + 1,
            clock_ms: self.clock_ms,
        };
        if let Some((id, payload)) = self.transfer.read(now, read, &sender) {
            let number = self.next_number();
            self.publish("data", Some(id), payload, Some(number));
        }
    }

    fn state(&mut self, now: Duration, state: Option<(Arc<str>, u64, Vec<OutboxEntry>)>) {
        self.is_finding_state = false;
        let Session::Has(session) = &self.session else {
            return;
        };
        // Unless it arrives.
        self.state_at = Some(now + STATE_AGAIN);
        let Some((epoch, seq, points)) =
            state.filter(|(epoch, ..)| *epoch == self.transfer.head().epoch)
        else {
            return;
        };
        let state = SiteState {
            session: session.clone(),
            epoch: epoch.to_string(),
            seq,
            points: points.iter().map(DataEntry::from).collect(),
        };
        let payload = state.encode_to_vec();
        if payload.len() > self.message_max.saturating_sub(AROUND) {
            self.state_at = Some(now + STATE);
            self.is_state_missing = true;
            let fault = UplinkFault::StateTooLong(payload.len());
            self.outputs.push_back(UplinkOutput::Fails(fault, STATE));
            return;
        }
        let number = self.next_number();
        self.states_asked.push_back(number);
        if self.states_asked.len() > STATES_MAX {
            self.states_asked.pop_front();
        }
        self.state_len = payload.len();
        self.state_sent = now;
        // On a slow line it takes longer.
        let patience = self.transfer.patience(self.state_len);
        self.state_at = Some(now + patience.max(STATE_AGAIN));
        self.publish("state", None, payload, Some(number));
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
        if self.renewal.is_asked(number) {
            self.outputs.push_back(match self.renewal.answer(answer) {
                Ok(token) => UplinkOutput::Renewed(token),
                Err(reason) => UplinkOutput::NotRenewed(reason),
            });
            return;
        }
        if self.states_asked.contains(&number) {
            // A later one may still be on its way.
            if self.states_asked.back() == Some(&number) {
                self.state_len = 0;
            }
            if is_stored(answer, "STATE").is_ok() {
                self.state_at = Some(now + STATE);
                self.is_state_missing = false;
            }
            return;
        }
        let is_stored = is_stored(answer, "DATA");
        match self
            .transfer
            .answer((now, self.state_len), number, is_stored)
        {
            TransferEnd::Nothing => {}
            TransferEnd::Refused(reason) => self.refused(now, reason),
            TransferEnd::Delivered(to, count) => {
                let epoch = Arc::clone(&self.transfer.head().epoch);
                self.outputs
                    .push_back(UplinkOutput::Delivered(epoch, to, count));
                self.works();
            }
        }
    }

    fn welcome(&mut self, now: Duration, welcome: Welcome) {
        match welcome.answer {
            Some(HelloAnswer::Session(session)) if is_token(&session) => {
                let subjects = format!("rb.down.{}.{session}.*", self.site);
                let listen = UplinkOutput::Listen(subjects, session.clone());
                self.outputs.push_back(listen);
                self.session = Session::Has(session);
                self.renewal.set_centre(now, welcome.clock_ms);
                self.works();
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
        let wait = self.transfer.refused(now);
        let fault = UplinkFault::NotStored(reason);
        self.outputs.push_back(UplinkOutput::Fails(fault, wait));
    }

    const fn next_number(&mut self) -> u64 {
        self.number += 1;
        self.number
    }

    fn publish(&mut self, what: &str, id: Option<String>, payload: Vec<u8>, answer: Option<u64>) {
        let subject = format!("rb.up.{}.{what}", self.site);
        self.outputs.push_back(UplinkOutput::Publish(UpMessage {
            subject,
            id,
            payload,
            answer,
        }));
    }
}

fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

/// Whether this stream has taken a message, as its answer says.
fn is_stored(answer: Option<&[u8]>, stream: &str) -> Result<(), String> {
    let answer = answer.ok_or("no stream takes it")?;
    let answer: serde_json::Value =
        serde_json::from_slice(answer).map_err(|error| error.to_string())?;
    if let Some(error) = answer.get("error") {
        let said = error.get("description").and_then(serde_json::Value::as_str);
        return Err(said.unwrap_or("refused").to_owned());
    }
    match answer.get("stream").and_then(serde_json::Value::as_str) {
        Some(its) if its == stream => Ok(()),
        _ => Err("another stream answers".to_owned()),
    }
}

/// Whether it can stand in a subject.
pub(crate) fn is_token(session: &str) -> bool {
    let is_allowed = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'-';
    (1..=64).contains(&session.len()) && session.bytes().all(is_allowed)
}

#[cfg(test)]
pub(crate) mod tests;
