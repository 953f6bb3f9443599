//! The entries of an outbox on their way: up to where the servers have them, what is sent next, and
//! what is sent again.

use super::READ_MAX;
use crate::message::{DataBatch, DataEntry, Dropped};
use prost::Message as _;
use railbus_store::outbox::Piece;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// How many messages are under way at once.
const FLYING_MAX: usize = 16;
/// A change waits so long for others, if nothing else is to be sent.
pub(super) const GATHER: Duration = Duration::from_secs(1);
/// The timeout of an acknowledgement, besides the time that what is under way takes on the slowest
/// line.
const ANSWER_MAX: Duration = Duration::from_secs(10);
/// The slowest line, in bytes a second: 64 kbit/s.
const SLOWEST: u64 = 8_000;
/// So many messages of earlier tries are remembered: their answers count.
const EARLIER_MAX: usize = 64;
/// When it sends again what was refused, at first, and at most.
pub(super) const AGAIN: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// How the outbox is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OutboxHead {
    /// What its entries are numbered by; empty until it is open.
    pub epoch: Arc<str>,
    /// The number of the newest one.
    pub newest: u64,
    /// Up to which number everything was delivered when it was opened.
    pub delivered: u64,
    /// Changes can't be written: what it has is no longer all that happened.
    pub is_failing: bool,
}

/// Why entries are not sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoResend {
    /// These are the numbers of other entries.
    Epoch,
    /// Others are being sent again.
    Busy,
}

/// What is read next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NextRead {
    /// What comes after this number.
    After(u64),
    /// What is wanted again, from one number to another.
    Again((u64, u64)),
}

/// What an answer means.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum TransferEnd {
    Nothing,
    /// The servers do not take data, for this reason.
    Refused(String),
    /// They have everything up to this number, so many entries more than before.
    Delivered(u64, u64),
}

/// Who sends, and how.
pub(super) struct Sender<'s> {
    pub(super) site: &'s str,
    pub(super) boot: &'s [u8; 16],
    pub(super) session: &'s str,
    /// How many bytes of entries a message may have.
    pub(super) most: usize,
    /// How many bytes are under way besides.
    pub(super) other_bytes: usize,
    /// The number of the next message.
    pub(super) number: u64,
    /// The wall clock, in milliseconds since 1970.
    pub(super) clock_ms: i64,
}

/// Entries on their way.
#[derive(Debug)]
struct Flying {
    number: u64,
    /// The last one; none if they were wanted again.
    last: Option<u64>,
    /// How many they are.
    count: u64,
    /// How many bytes the message has.
    len: usize,
    sent_at: Duration,
    is_stored: bool,
}

/// Entries that were sent, and are sent again since there was no answer in time.
#[derive(Clone, Copy, Debug)]
struct Earlier {
    number: u64,
    /// Up to which entry all was delivered or under way before it.
    after: u64,
    last: u64,
    count: u64,
}

/// What is being read of the outbox.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Reading {
    #[default]
    Not,
    /// What is to be sent next.
    Next,
    /// What is wanted again.
    Again,
    /// It was asked for before something went wrong.
    Void,
}

/// The entries of an outbox on their way.
#[derive(Debug)]
pub(super) struct Transfer {
    /// Whose numbers these are, and how far the outbox goes.
    head: OutboxHead,
    /// The servers have everything up to this one.
    delivered: u64,
    /// Everything up to this one is delivered or on its way.
    sent: u64,
    flying: VecDeque<Flying>,
    /// How many may be under way: fewer after something went wrong.
    window: usize,
    earlier: VecDeque<Earlier>,
    /// When the oldest of them has been under way for too long.
    answer_by: Option<Duration>,
    /// Since when something is to be sent.
    due_since: Option<Duration>,
    reading: Reading,
    /// From after which entry on it is read.
    reading_after: u64,
    /// The entries that are to be sent again: the first and the last one. Where something goes
    /// wrong, whoever misses them asks once more.
    again_span: Option<(u64, u64)>,
    /// When it goes on after something went wrong, and how often it did.
    again: Option<Duration>,
    refusals: u32,
}

impl Default for Transfer {
    fn default() -> Transfer {
        Transfer {
            head: OutboxHead::default(),
            delivered: 0,
            sent: 0,
            flying: VecDeque::new(),
            window: FLYING_MAX,
            earlier: VecDeque::new(),
            answer_by: None,
            due_since: None,
            reading: Reading::Not,
            reading_after: 0,
            again_span: None,
            again: None,
            refusals: 0,
        }
    }
}

impl Transfer {
    pub(super) const fn head(&self) -> &OutboxHead {
        &self.head
    }

    pub(super) const fn delivered(&self) -> u64 {
        self.delivered
    }

    pub(super) const fn behind(&self) -> u64 {
        self.head.newest.saturating_sub(self.delivered)
    }

    /// So much is in the outbox.
    pub(super) fn stored(&mut self, now: Duration, head: OutboxHead) {
        if self.head.epoch != head.epoch {
            self.delivered = head.delivered;
            self.begin_anew(None);
            self.earlier.clear();
        }
        self.head = head;
        if self.sent < self.head.newest {
            self.due_since.get_or_insert(now);
        }
    }

    pub(super) fn resend(
        &mut self,
        epoch: &str,
        (first, last): (u64, u64),
    ) -> Result<(), NoResend> {
        if *self.head.epoch != *epoch {
            return Err(NoResend::Epoch);
        }
        if self.again_span.is_some() {
            return Err(NoResend::Busy);
        }
        // What is not delivered comes anyway.
        let (first, last) = (first.max(1), last.min(self.delivered));
        self.again_span = (first <= last).then_some((first, last));
        Ok(())
    }

    /// When it goes on by itself.
    pub(super) fn deadline(&self) -> Option<Duration> {
        let data = match self.again {
            Some(again) => Some(again),
            None if self.is_again_due() => Some(Duration::ZERO),
            None => self.read_at(),
        };
        [data, self.answer_by].into_iter().flatten().min()
    }

    /// When the oldest message was sent that is not answered.
    pub(super) fn oldest(&self) -> Option<Duration> {
        let waits = self.flying.iter().filter(|flying| !flying.is_stored);
        waits.map(|flying| flying.sent_at).min()
    }

    /// Whether an answer is missing by now.
    pub(super) fn is_overdue(&self, now: Duration) -> bool {
        self.answer_by.is_some_and(|by| by <= now)
    }

    /// What is to be read now.
    pub(super) fn next(&mut self, now: Duration) -> Option<NextRead> {
        if self.again.is_some_and(|at| at > now) {
            return None;
        }
        self.again = None;
        if self.read_at().is_some_and(|at| at <= now) {
            self.reading = Reading::Next;
            self.reading_after = self.sent;
            return Some(NextRead::After(self.sent));
        }
        let span = self.again_span.filter(|_| self.is_again_due())?;
        self.reading = Reading::Again;
        Some(NextRead::Again(span))
    }

    /// When more is read; none while there is nothing, or enough is under way. Few entries wait for
    /// others: a second, or until those before them have arrived.
    fn read_at(&self) -> Option<Duration> {
        let waiting = self.head.newest.saturating_sub(self.sent);
        let is_busy = self.reading != Reading::Not || self.flying.len() >= self.window;
        if waiting == 0 || is_busy {
            return None;
        }
        let since = self.due_since?;
        let is_alone = self.flying.iter().all(|flying| flying.last.is_none());
        match waiting >= READ_MAX as u64 {
            true => Some(since),
            false if is_alone => Some(since + GATHER),
            false => None,
        }
    }

    /// Whether entries that are wanted again are read now: they leave room for what is new.
    fn is_again_due(&self) -> bool {
        let has_room = self.flying.len() < self.window.div_ceil(2);
        self.again_span.is_some() && self.reading == Reading::Not && has_room
    }

    /// What was read, as a message: its id and what it says.
    pub(super) fn read(
        &mut self,
        now: Duration,
        read: Option<(Arc<str>, Piece)>,
        sender: &Sender<'_>,
    ) -> Option<(String, Vec<u8>)> {
        let reading = std::mem::replace(&mut self.reading, Reading::Not);
        let read = read.filter(|(epoch, _)| *epoch == self.head.epoch);
        match (reading, read) {
            (Reading::Not | Reading::Void, _) => None,
            // A late answer has said meanwhile that the servers have it.
            (Reading::Next, _) if self.reading_after != self.sent => None,
            (Reading::Next, Some((epoch, piece))) if !piece.entries.is_empty() => {
                let (batch, last) = pack(sender, &epoch, &piece);
                // All that can be another the next time is in it. What begins at the same entry may
                // have more in it then, and a server that took it for the one before would leave
                // out the rest.
                let dropped = batch.dropped.map_or(0, |dropped| dropped.count);
                let id = format!("{}-{epoch}-{}-{last}-{dropped}", sender.site, batch.seq);
                self.sent = last;
                self.due_since = (self.sent < self.head.newest).then_some(now);
                Some((id, self.fly(now, &batch, Some(last), sender)))
            }
            (Reading::Again, Some((epoch, piece))) => self.send_again(now, (&epoch, piece), sender),
            (Reading::Next | Reading::Again, _) => {
                self.begin_anew(Some(now + AGAIN.0));
                None
            }
        }
    }

    /// Sends entries again, with an id of their own: the servers may remember those that they have
    /// lost.
    fn send_again(
        &mut self,
        now: Duration,
        (epoch, mut piece): (&str, Piece),
        sender: &Sender<'_>,
    ) -> Option<(String, Vec<u8>)> {
        let (first, last) = self.again_span.take()?;
        if piece.entries.is_empty() {
            piece.first = last + 1;
        }
        let (mut batch, packed) = pack(sender, epoch, &piece);
        if piece.first > first {
            let oldest = piece.entries.first();
            batch.dropped = Some(Dropped {
                count: piece.first - first,
                from_ms: None,
                to_ms: oldest.map_or(sender.clock_ms, |entry| entry.at),
            });
        }
        if !piece.entries.is_empty() && packed < last {
            self.again_span = Some((packed + 1, last));
        }
        let [a, b, c, d, ..] = sender.boot;
        let id = format!(
            "{}-{epoch}-{}-{packed}-{a:02x}{b:02x}{c:02x}{d:02x}-{}",
            sender.site, batch.seq, sender.number
        );
        Some((id, self.fly(now, &batch, None, sender)))
    }

    fn fly(
        &mut self,
        now: Duration,
        batch: &DataBatch,
        last: Option<u64>,
        sender: &Sender<'_>,
    ) -> Vec<u8> {
        let payload = batch.encode_to_vec();
        self.flying.push_back(Flying {
            number: sender.number,
            last,
            count: batch.entries.len() as u64,
            len: payload.len(),
            sent_at: now,
            is_stored: false,
        });
        if self.answer_by.is_none() {
            self.answer_by = self.answer_by(now, sender.other_bytes);
        }
        payload
    }

    /// When the oldest of what is under way should be answered, beside so many other bytes.
    fn answer_by(&self, now: Duration, others: usize) -> Option<Duration> {
        (!self.flying.is_empty()).then_some(now + self.patience(others))
    }

    /// How long an answer may take on the slowest line, with so many other bytes under way.
    pub(super) fn patience(&self, others: usize) -> Duration {
        let bytes: usize = self.flying.iter().map(|flying| flying.len).sum();
        let bytes = (bytes + others) as u64;
        ANSWER_MAX + Duration::from_millis(bytes.saturating_mul(1_000) / SLOWEST)
    }

    /// A message was answered: it is stored, or why not. So many other bytes are under way.
    pub(super) fn answer(
        &mut self,
        (now, others): (Duration, usize),
        number: u64,
        is_stored: Result<(), String>,
    ) -> TransferEnd {
        let its = self.flying.iter_mut();
        let its = its.into_iter().find(|flying| flying.number == number);
        match (its, is_stored) {
            (Some(_), Err(reason)) => return TransferEnd::Refused(reason),
            (None, Err(_)) => return TransferEnd::Nothing,
            (Some(flying), Ok(())) => flying.is_stored = true,
            (None, Ok(())) => return self.answer_earlier(number, (now, others)),
        }
        let (mut newest, mut count, mut has_moved) = (None, 0, false);
        while let Some(first) = self.flying.pop_front_if(|flying| flying.is_stored) {
            if first.last.is_some() {
                newest = first.last;
                count += first.count;
            }
            has_moved = true;
        }
        if has_moved {
            self.refusals = 0;
            self.window = (self.window * 2).min(FLYING_MAX);
            self.answer_by = self.answer_by(now, others);
        }
        newest.map_or(TransferEnd::Nothing, |newest| {
            self.delivered_to(newest, count)
        })
    }

    /// An answer that comes late says that the servers have what was sent, as any other. On a slow
    /// line it would be sent for ever otherwise.
    fn answer_earlier(&mut self, number: u64, (now, others): (Duration, usize)) -> TransferEnd {
        let its = self.earlier.iter().find(|earlier| earlier.number == number);
        // Only where nothing before it is open.
        let its = its.copied().filter(|its| its.after <= self.delivered);
        let Some(its) = its else {
            return TransferEnd::Nothing;
        };
        self.sent = self.sent.max(its.last);
        let end = self.delivered_to(its.last, its.count);
        // No answer is missing to what is known to have arrived.
        let delivered = self.delivered;
        self.flying
            .retain(|flying| flying.last.is_none_or(|last| last > delivered));
        self.answer_by = self.answer_by(now, others);
        end
    }

    fn delivered_to(&mut self, newest: u64, count: u64) -> TransferEnd {
        // Of two answers to the same entries the second one may come first.
        if newest <= self.delivered {
            return TransferEnd::Nothing;
        }
        // What another answer has said already does not count again.
        let count = count.min(newest - self.delivered);
        self.delivered = newest;
        TransferEnd::Delivered(newest, count)
    }

    /// Data did not come in: all that is under way is sent again, after this time.
    pub(super) fn refused(&mut self, now: Duration) -> Duration {
        let wait = AGAIN.0.saturating_mul(1 << self.refusals.min(6));
        let wait = wait.min(AGAIN.1);
        self.refusals = self.refusals.saturating_add(1);
        self.begin_anew(Some(now + wait));
        self.window = 1;
        wait
    }

    /// What is not delivered is read and sent again, at this time or as soon as it can be.
    pub(super) fn begin_anew(&mut self, at: Option<Duration>) {
        let mut after = self.delivered;
        for flying in self.flying.drain(..) {
            if let Some(last) = flying.last {
                self.earlier.push_back(Earlier {
                    number: flying.number,
                    after,
                    last,
                    count: flying.count,
                });
                after = last;
            }
        }
        let many = self.earlier.len().saturating_sub(EARLIER_MAX);
        self.earlier.drain(..many);
        self.answer_by = None;
        self.sent = self.delivered;
        self.again = at;
        self.again_span = None;
        if self.reading != Reading::Not {
            self.reading = Reading::Void;
        }
        self.due_since = (self.sent < self.head.newest).then_some(Duration::ZERO);
    }
}

/// As many entries as fit into a message, but one at least where there is one, and the number of
/// the last one.
pub(super) fn pack(sender: &Sender<'_>, epoch: &str, piece: &Piece) -> (DataBatch, u64) {
    let mut batch = DataBatch {
        epoch: epoch.to_owned(),
        seq: piece.first,
        dropped: piece.missing.as_ref().map(Into::into),
        entries: Vec::new(),
        session: sender.session.to_owned(),
    };
    let (mut length, mut last) = (batch.encoded_len(), piece.first.saturating_sub(1));
    for (entry, number) in piece.entries.iter().zip(piece.first..) {
        let entry = DataEntry::from(entry);
        // Its tag and its length.
        length += entry.encoded_len() + 4;
        if length > sender.most && !batch.entries.is_empty() {
            break;
        }
        batch.entries.push(entry);
        last = number;
    }
    (batch, last)
}
