//! Commands of the centre to sites, without I/O: each has exactly one end.
//!
//! A command is a record before its site hears of it, and so is its end. Both are written by
//! compare-and-set, so that of two centres only one gives a command its end. It is sent once; if no
//! answer comes, its site is asked for the result, and never to begin it. docs/decisions/0056

mod command;
mod recent;

use crate::centre::StoreEnd;
use crate::message::{
    ApiAnswer, CommandAnswer, CommandEnd, CommandIntent, CommandKind, CommandOutcome,
    CommandRecord, CommandRequest, CommandResult, FleetRefusal,
};
use command::{Command, Stage, is_same, request};
use prost::Message as _;
use recent::Recent;
pub(crate) use recent::view_of;
pub use recent::{CommandView, EndView};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// The most commands without an end of which new ones are taken.
const GIVEN_MAX: usize = 4_096;
/// The same of one site: one that does not answer must not stop commands to the others.
const OF_SITE_MAX: usize = 64;
/// The same with those of other centres.
const OPEN_MAX: usize = 8_192;
/// The most callers that wait for one command.
const CALLERS_MAX: usize = 64;
/// For how many commands sites are asked at a time, and for how many of one site.
const ASKED_MAX: usize = 64;
const ASKED_OF_SITE_MAX: usize = 4;
/// How long another centre is given to end its own command.
const TAKEN_OVER: Duration = Duration::from_secs(60);
/// After so long a site is asked for the result of a command; the interval doubles each time.
const ASK: Duration = Duration::from_secs(2);
/// The longest interval.
const ASK_MAX: Duration = Duration::from_secs(60);
/// How long until an end is stored again that could not be, and how often.
const STORE_AGAIN: Duration = Duration::from_secs(5);
const STORES_MAX: u32 = 120;
/// How long until a record is read again that was not there yet, and how often.
const READ_AGAIN: Duration = Duration::from_secs(1);
const READS_MAX: u32 = 5;
/// The longest reason of a site, in characters.
const WORDS_MAX: usize = 200;
/// The longest answer of a site, in bytes.
const ANSWER_MAX: usize = 64 << 10;
/// How long a site is asked for a result. It keeps results for a day.
const KNOWN: Duration = Duration::from_secs(23 * 60 * 60);

/// The name of a command: its site, and its id there.
pub type CommandName<'i> = (&'i str, &'i str);

/// What happened.
#[derive(Debug)]
pub enum LedgerInput<'i> {
    /// The records up to now were read, and others come as they are stored.
    Connected,
    /// The connection is lost.
    Lost,
    /// The caller with this number gives a command, and waits this long for its result. Without a
    /// run of its site it can't begin: only an earlier result of the same id is looked up.
    Given(u64, CommandName<'i>, CommandIntent, Duration),
    /// A record, with its number in the stream, and how old it is by the clocks of the servers.
    Record(CommandName<'i>, &'i [u8], u64, Duration),
    /// The result of [`LedgerOutput::Store`] with this number.
    Stored(CommandName<'i>, u64, StoreEnd),
    /// The result of [`LedgerOutput::Read`] with this number: [`None`] if that failed, `Some(None)`
    /// if there is no record, otherwise the last one and its number in the stream.
    Read(CommandName<'i>, u64, Option<Option<(&'i [u8], u64)>>),
    /// The result of [`LedgerOutput::Send`] with this number.
    Said(CommandName<'i>, u64, SiteSaid<'i>),
}

/// The result of sending a command to its site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SiteSaid<'i> {
    /// The site answered.
    Answer(&'i [u8]),
    /// Not delivered: no responders on the subject.
    NotDelivered,
    /// There is no answer. It may have been delivered.
    Nothing,
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub enum LedgerOutput {
    /// Store a record of this site and command, provided the number of the last one is `after`; 0
    /// for none.
    Store {
        /// By which its result is known.
        number: u64,
        /// The site.
        site: String,
        /// The command.
        id: String,
        /// The record.
        payload: Vec<u8>,
        /// The number of the last one.
        after: u64,
    },
    /// Read the last record of this site and command; its result is known by the number.
    Read(u64, String, String),
    /// Send this to the site, in its present session; its result is known by the number.
    Send(u64, String, CommandRequest),
    /// Answer the caller with this number.
    Tell(u64, CommandTold),
}

/// The answer to a caller.
#[derive(Clone, Debug, PartialEq)]
pub enum CommandTold {
    /// Its result.
    End(Arc<CommandEnd>),
    /// No result yet. The centre keeps asking the site.
    Waiting,
    /// Whether the id stands for a command is not known.
    NotKnown,
    /// There is no command of this id, and its site is not there. Nothing was sent.
    Offline,
    /// The id stands for another command. Nothing was sent.
    OtherCommand,
    /// It could not be recorded. For this caller nothing was sent, and nothing will be.
    NotStored,
    /// Too many commands have no end yet. Nothing was sent.
    TooMany,
}

/// All commands without an end, as one centre process knows them.
#[derive(Debug, Default)]
pub struct Ledger {
    open: BTreeMap<(String, String), Command>,
    outputs: VecDeque<LedgerOutput>,
    is_connected: bool,
    /// The number of the last thing that has a result.
    number: u64,
    /// Nothing is due before.
    due: Option<Duration>,
    recent: Recent,
    /// The wall clock, in milliseconds since 1970.
    clock_ms: i64,
    /// How many records could not be decoded.
    unreadable: u64,
}

impl Ledger {
    /// The time of the wall clock, in milliseconds since 1970. Only what is shown depends on it.
    pub const fn set_clock(&mut self, clock_ms: i64) {
        self.clock_ms = clock_ms;
    }

    /// The newest commands of all centres, the newest last.
    pub fn recent(&self) -> impl DoubleEndedIterator<Item = &CommandView> {
        self.recent.iter()
    }

    /// How many commands have no end yet.
    #[must_use]
    pub fn open(&self) -> usize {
        self.open.len()
    }

    /// How many records could not be decoded.
    #[must_use]
    pub const fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: LedgerInput<'_>) {
        self.due = Some(now);
        match input {
            LedgerInput::Connected => self.is_connected = true,
            LedgerInput::Lost => self.lost(now),
            LedgerInput::Given(number, name, intent, wait) => {
                self.given(number, name, intent, (now, now + wait));
            }
            LedgerInput::Record(name, payload, number, age) => {
                match CommandRecord::decode(payload).map(|record| record.record) {
                    Ok(Some(record)) => self.record(now, name, record, (number, age)),
                    Ok(None) | Err(_) => self.unreadable += 1,
                }
            }
            LedgerInput::Stored(name, number, end) => {
                if self.is_pending(name, number) {
                    self.stored(now, name, end);
                }
            }
            LedgerInput::Read(name, number, found) => {
                if self.is_pending(name, number) {
                    self.read(now, name, found);
                }
            }
            LedgerInput::Said(name, number, said) => {
                if self.is_pending(name, number) {
                    self.said(now, name, said);
                }
            }
        }
    }

    fn is_pending(&self, (site, id): CommandName<'_>, number: u64) -> bool {
        let command = self.open.get(&(site.to_owned(), id.to_owned()));
        command.is_some_and(|command| command.pending == number)
    }

    /// What is to be done at this time since the start.
    pub fn poll(&mut self, now: Duration) -> Option<LedgerOutput> {
        // What one step decides, the next one does.
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

    /// Does what is due; when something is next.
    fn step(&mut self, now: Duration) -> Option<Duration> {
        let mut next: Option<Duration> = None;
        let mut at = |due: Duration| next = Some(next.map_or(due, |next| next.min(due)));
        self.open.retain(|_, command| command.goes_on(now));
        let (mut asked, mut to_ask) = (BTreeMap::new(), Vec::new());
        for ((site, id), command) in &mut self.open {
            command.tell_late(now, &mut at, &mut self.outputs);
            if let Stage::Dropped(by) = command.stage {
                at(by);
            }
            if !self.is_connected {
                continue;
            }
            let mut is_due = false;
            match &mut command.stage {
                Stage::Open(number, _, _) if command.known_until <= now => {
                    let lost = refusal("E0169", "the site reported no result within a day");
                    let end = end(&command.intent, CommandResult::Unknown(lost), self.clock_ms);
                    command.stage = Stage::Ending(*number, end, Some(now), 0);
                    command.pending = 0;
                    at(now);
                }
                Stage::Open(_, ask_at, _) => {
                    at(command.known_until);
                    match *ask_at {
                        None => *asked.entry(site.clone()).or_default() += 1,
                        Some(due) if due > now => at(due),
                        Some(due) => to_ask.push((due, site.clone(), id.clone())),
                    }
                }
                Stage::Reading(again, _) | Stage::Ending(_, _, again, _) => {
                    is_due = again.is_some_and(|due| due <= now);
                    match *again {
                        Some(_) if is_due => *again = None,
                        Some(due) => at(due),
                        None => {}
                    }
                }
                _ => {}
            }
            if is_due {
                self.number += 1;
                command.pending = self.number;
                self.outputs.push_back(command.next_request(site, id));
            }
        }
        self.ask_some(asked, to_ask);
        next
    }

    /// Asks sites for results: those that have waited longest first, and of no site more than its
    /// share, so many being asked already. The others are asked as soon as an answer comes.
    fn ask_some(
        &mut self,
        mut asked: BTreeMap<String, usize>,
        mut to_ask: Vec<(Duration, String, String)>,
    ) {
        let mut all = asked.values().sum::<usize>();
        to_ask.sort_unstable();
        for (_, site, id) in to_ask {
            let of_site = asked.entry(site.clone()).or_default();
            if all < ASKED_MAX && *of_site < ASKED_OF_SITE_MAX {
                all += 1;
                *of_site += 1;
                self.ask((site, id));
            }
        }
    }

    /// Asks a site for the result of a command.
    fn ask(&mut self, key: (String, String)) {
        let Some(command) = self.open.get_mut(&key) else {
            return;
        };
        if let Stage::Open(_, ask_at, _) = &mut command.stage {
            *ask_at = None;
        }
        self.number += 1;
        command.pending = self.number;
        let request = request(&key.1, &command.intent, true);
        let send = LedgerOutput::Send(self.number, key.0, request);
        self.outputs.push_back(send);
    }

    /// The connection is lost: the results of pending requests will not come.
    fn lost(&mut self, now: Duration) {
        self.is_connected = false;
        // Answers to callers do not need the connection.
        let is_told = |output: &LedgerOutput| matches!(output, LedgerOutput::Tell(..));
        self.outputs.retain(is_told);
        for command in self.open.values_mut() {
            command.pending = 0;
            match &mut command.stage {
                stage @ (Stage::Storing | Stage::Reading(..)) => {
                    let told = match stage {
                        Stage::Storing => CommandTold::NotStored,
                        // Another centre carries it out.
                        _ => CommandTold::NotKnown,
                    };
                    for (number, _) in command.callers.drain(..) {
                        let told = LedgerOutput::Tell(number, told.clone());
                        self.outputs.push_back(told);
                    }
                    command.stage = Stage::Dropped(now + TAKEN_OVER);
                }
                Stage::Sent(number) => command.stage = Stage::Open(*number, Some(now), 0),
                Stage::Open(_, ask_at @ None, _) => *ask_at = Some(now),
                Stage::Ending(_, _, again @ None, _) => *again = Some(now),
                _ => {}
            }
        }
    }

    fn tell(&mut self, number: u64, told: CommandTold) {
        self.outputs.push_back(LedgerOutput::Tell(number, told));
    }

    fn given(
        &mut self,
        number: u64,
        (site, id): CommandName<'_>,
        intent: CommandIntent,
        (now, until): (Duration, Duration),
    ) {
        let key = (site.to_owned(), id.to_owned());
        if let Some(command) = self.open.get_mut(&key) {
            let told = match &command.stage {
                _ if !is_same(&command.intent, &intent) => CommandTold::OtherCommand,
                Stage::Dropped(_) => CommandTold::NotKnown,
                Stage::Ending(_, end, ..) => CommandTold::End(Arc::clone(end)),
                _ if command.callers.len() >= CALLERS_MAX => CommandTold::TooMany,
                _ => {
                    command.callers.push((number, until));
                    return;
                }
            };
            return self.tell(number, told);
        }
        if !self.is_connected {
            return self.tell(number, CommandTold::NotStored);
        }
        let first = (key.0.clone(), String::new());
        let of_site = self.open.range(first..);
        let of_site = of_site.take_while(|((its, _), _)| *its == key.0);
        let of_site = of_site
            .filter(|(_, command)| command.is_under_way())
            .count();
        if self.open.len() >= GIVEN_MAX || of_site >= OF_SITE_MAX {
            return self.tell(number, CommandTold::TooMany);
        }
        let can_begin = !intent.boot.is_empty();
        if can_begin {
            self.number += 1;
            self.outputs.push_back(LedgerOutput::Store {
                number: self.number,
                site: key.0.clone(),
                id: key.1.clone(),
                payload: record(CommandKind::Intent(intent.clone())),
                after: 0,
            });
        }
        let command = Command {
            intent,
            stage: match can_begin {
                true => Stage::Storing,
                false => Stage::Reading(Some(now), 0),
            },
            // Without a request nothing has this number.
            pending: if can_begin { self.number } else { 0 },
            seen: None,
            callers: vec![(number, until)],
            known_until: now + KNOWN,
        };
        self.open.insert(key, command);
    }

    /// A record is in the stream.
    fn record(
        &mut self,
        now: Duration,
        name: CommandName<'_>,
        record: CommandKind,
        (number, age): (u64, Duration),
    ) {
        self.recent.add(name, &record);
        let key = (name.0.to_owned(), name.1.to_owned());
        match (record, self.open.get_mut(&key)) {
            (CommandKind::Intent(intent), Some(command)) => {
                // The same id may be of another centre, which sent it.
                let is_ours = intent.token == command.intent.token;
                match command.stage {
                    Stage::Dropped(_) if is_ours => self.never_sent(now, &key, number),
                    Stage::Storing | Stage::Reading(..) | Stage::Dropped(_) => {
                        command.seen = Some((number, intent));
                    }
                    _ => {}
                }
            }
            (CommandKind::Intent(intent), None) => {
                if self.open.len() < OPEN_MAX {
                    let command = Command {
                        intent,
                        stage: Stage::Open(number, Some(now + TAKEN_OVER), 0),
                        pending: 0,
                        seen: None,
                        callers: Vec::new(),
                        // It is asked for once, however old it is.
                        known_until: now + KNOWN.saturating_sub(age).max(2 * TAKEN_OVER),
                    };
                    self.open.insert(key, command);
                }
            }
            (CommandKind::End(end), Some(_)) => self.ended(&key, &Arc::new(end)),
            (CommandKind::End(_), None) => {}
        }
    }

    /// It was stored after all, and not sent, as its caller was told.
    fn never_sent(&mut self, now: Duration, key: &(String, String), number: u64) {
        if let Some(command) = self.open.get_mut(key) {
            let never = refusal("E0164", "it was not certain that it was recorded");
            let end = end(&command.intent, CommandResult::Never(never), self.clock_ms);
            command.stage = Stage::Ending(number, end, Some(now), 0);
            command.pending = 0;
        }
    }

    /// The end of a command is stored: its callers are told.
    fn ended(&mut self, key: &(String, String), end: &Arc<CommandEnd>) {
        let Some(command) = self.open.remove(key) else {
            return;
        };
        // It may have been sent: then the end is of this command, whatever it says of which it is.
        let was_sent = matches!(
            command.stage,
            Stage::Sent(_) | Stage::Open(..) | Stage::Ending(..)
        );
        let told = match &end.intent {
            _ if was_sent => CommandTold::End(Arc::clone(end)),
            Some(intent) if is_same(intent, &command.intent) => CommandTold::End(Arc::clone(end)),
            Some(_) => CommandTold::OtherCommand,
            // One of a newer version.
            None => CommandTold::NotKnown,
        };
        for (number, _) in command.callers {
            self.tell(number, told.clone());
        }
    }

    fn stored(&mut self, now: Duration, (site, id): CommandName<'_>, stored: StoreEnd) {
        let key = (site.to_owned(), id.to_owned());
        let Some(command) = self.open.get_mut(&key) else {
            return;
        };
        match (&mut command.stage, stored) {
            (Stage::Storing, StoreEnd::Stored(number)) => {
                command.stage = Stage::Sent(number);
                self.number += 1;
                command.pending = self.number;
                let request = request(id, &command.intent, false);
                self.outputs
                    .push_back(LedgerOutput::Send(self.number, site.to_owned(), request));
            }
            (Stage::Storing, StoreEnd::Conflict) => {
                command.stage = Stage::Reading(Some(now), 0);
            }
            (Stage::Storing, StoreEnd::Unknown) => {
                // It is sent only if it is certain to be recorded.
                let callers = std::mem::take(&mut command.callers);
                command.stage = Stage::Dropped(now + TAKEN_OVER);
                let seen = command.seen.as_ref();
                let seen = seen.filter(|(_, intent)| intent.token == command.intent.token);
                let seen = seen.map(|(number, _)| *number);
                for (number, _) in callers {
                    self.tell(number, CommandTold::NotStored);
                }
                if let Some(number) = seen {
                    self.never_sent(now, &key, number);
                }
            }
            (Stage::Ending(_, end, None, _), StoreEnd::Stored(_)) => {
                let end = Arc::clone(end);
                self.recent
                    .add((site, id), &CommandKind::End((*end).clone()));
                self.ended(&key, &end);
            }
            // Another centre was first: its end is the end.
            (Stage::Ending(_, _, again @ None, tries), StoreEnd::Conflict) => {
                *again = Some(now + STORE_AGAIN);
                *tries += 1;
                self.number += 1;
                command.pending = self.number;
                let read = LedgerOutput::Read(self.number, key.0, key.1);
                self.outputs.push_back(read);
            }
            (Stage::Ending(_, end, again @ None, tries), StoreEnd::Unknown) => {
                *again = Some(now + STORE_AGAIN);
                *tries += 1;
                // The result is known even though it is not stored.
                let told = CommandTold::End(Arc::clone(end));
                for (number, _) in std::mem::take(&mut command.callers) {
                    self.tell(number, told.clone());
                }
            }
            _ => {}
        }
    }

    /// The last record was read.
    fn read(&mut self, now: Duration, name: CommandName<'_>, found: Option<Option<(&[u8], u64)>>) {
        let key = (name.0.to_owned(), name.1.to_owned());
        let Some(command) = self.open.get_mut(&key) else {
            return;
        };
        let is_none = found == Some(None);
        let found = found.flatten().and_then(|(payload, number)| {
            let record = CommandRecord::decode(payload).ok()?.record?;
            Some((record, number))
        });
        match (found, &mut command.stage) {
            (Some((CommandKind::End(end), _)), _) => self.ended(&key, &Arc::new(end)),
            // Another centre carries it out.
            (Some((CommandKind::Intent(intent), number)), Stage::Reading(..)) => {
                let callers = match is_same(&intent, &command.intent) {
                    true => Vec::new(),
                    false => std::mem::take(&mut command.callers),
                };
                command.intent = intent;
                command.stage = Stage::Open(number, Some(now + TAKEN_OVER), 0);
                for (number, _) in callers {
                    self.tell(number, CommandTold::OtherCommand);
                }
            }
            (None, Stage::Reading(..)) if is_none && command.intent.boot.is_empty() => {
                let callers = std::mem::take(&mut command.callers);
                self.open.remove(&key);
                for (number, _) in callers {
                    self.tell(number, CommandTold::Offline);
                }
            }
            // It may be on its way to the other servers.
            (None, Stage::Reading(again, tries)) if *tries < READS_MAX => {
                *tries += 1;
                *again = Some(now + READ_AGAIN);
            }
            (None, Stage::Reading(..)) => {
                let callers = std::mem::take(&mut command.callers);
                command.stage = Stage::Dropped(now + TAKEN_OVER);
                for (number, _) in callers {
                    self.tell(number, CommandTold::NotKnown);
                }
            }
            // The stream lost what it had, and has the intent under another number, or none.
            (Some((CommandKind::Intent(intent), number)), Stage::Ending(after, end, ..)) => {
                if intent.token == command.intent.token {
                    *after = number;
                    return;
                }
                // Another one took its id, and is carried out elsewhere.
                let told = CommandTold::End(Arc::clone(end));
                let callers = std::mem::take(&mut command.callers);
                command.intent = intent;
                command.stage = Stage::Open(number, Some(now + TAKEN_OVER), 0);
                for (number, _) in callers {
                    self.tell(number, told.clone());
                }
            }
            (None, Stage::Ending(after, ..)) if is_none => *after = 0,
            // It is stored again.
            _ => {}
        }
    }

    /// The result of sending a command to its site.
    fn said(&mut self, now: Duration, (site, id): CommandName<'_>, said: SiteSaid<'_>) {
        let key = (site.to_owned(), id.to_owned());
        let Some(command) = self.open.get_mut(&key) else {
            return;
        };
        let outcome = match said {
            SiteSaid::Answer(payload) => {
                CommandAnswer::decode(payload).map_or(None, |answer| answer.answer)
            }
            SiteSaid::NotDelivered | SiteSaid::Nothing => None,
        };
        let (number, is_first) = match &mut command.stage {
            Stage::Sent(number) => (*number, true),
            Stage::Open(number, None, _) => (*number, false),
            _ => return,
        };
        let result = match outcome {
            Some(CommandOutcome::Ended(answer)) if answer.body.len() > ANSWER_MAX => {
                let long = refusal("E0169", "the answer of the site is too long");
                Some(CommandResult::Unknown(long))
            }
            Some(CommandOutcome::Ended(answer)) if (200..600).contains(&answer.status) => {
                let content_type = clipped(&answer.content_type);
                Some(CommandResult::Ended(ApiAnswer {
                    content_type,
                    refusal: None,
                    ..answer
                }))
            }
            Some(CommandOutcome::Never(why)) => Some(CommandResult::Never(short(&why))),
            // A site of a version that knows no commands.
            Some(CommandOutcome::NotUnderstood(why)) if is_first => {
                Some(CommandResult::Never(short(&why)))
            }
            Some(CommandOutcome::Lost(why)) if !is_first => {
                Some(CommandResult::Unknown(short(&why)))
            }
            // Not delivered, and it is not sent again.
            _ if is_first && said == SiteSaid::NotDelivered => {
                let away = refusal("E0168", "it is not connected");
                Some(CommandResult::Never(away))
            }
            _ => None,
        };
        command.stage = match result {
            Some(result) => {
                let end = end(&command.intent, result, self.clock_ms);
                Stage::Ending(number, end, Some(now), 0)
            }
            None => {
                let tries = match command.stage {
                    Stage::Open(_, _, tries) => tries.saturating_add(1),
                    _ => 0,
                };
                let wait = ASK.saturating_mul(1 << tries.min(8)).min(ASK_MAX);
                Stage::Open(number, Some(now + wait), tries)
            }
        };
    }
}

/// As much of a text as is stored.
fn clipped(text: &str) -> String {
    text.chars().take(WORDS_MAX).collect()
}

fn short(why: &FleetRefusal) -> FleetRefusal {
    refusal(&clipped(&why.code), &clipped(&why.reason))
}

fn refusal(code: &str, reason: &str) -> FleetRefusal {
    FleetRefusal {
        code: code.to_owned(),
        reason: reason.to_owned(),
    }
}

fn end(intent: &CommandIntent, result: CommandResult, at_ms: i64) -> Arc<CommandEnd> {
    Arc::new(CommandEnd {
        intent: Some(intent.clone()),
        end: Some(result),
        at_ms,
    })
}

fn record(kind: CommandKind) -> Vec<u8> {
    let record = Some(kind);
    CommandRecord { record }.encode_to_vec()
}

#[cfg(test)]
mod tests;
