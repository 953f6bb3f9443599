//! Every change in its order, also those of an outage: what is published of the outbox, and up to
//! where the broker has it. Without I/O.

use crate::northbound::broker::message::{Message, Verdict};
use crate::northbound::outbox::OutboxState;
use jiff::Timestamp;
use railbus_api::types::SCHEMA;
use railbus_store::outbox::{EntryKind, OutboxEntry, Piece};
use railbus_words::time::rfc3339;
use serde_json::{Map, Value, json};
use std::sync::Arc;
use std::time::Duration;

/// How many entries are read at a time.
pub(super) const READ_MAX: usize = 256;
/// The longest message: one that takes 10 s on a slow line would end the connection.
const LEN_MAX: usize = 16 << 10;
/// When it is tried again what the broker refused, or nobody received, or could not be read.
const AGAIN: Duration = Duration::from_secs(10);

/// A message with entries.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Packed {
    epoch: Arc<str>,
    /// The number of its last entry.
    last: u64,
    message: Message,
}

/// What is with the broker: up to which entry, and in which round it was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PieceId {
    round: u64,
    last: u64,
}

/// The entries of an outbox on their way to the broker.
#[derive(Debug, Default)]
pub(super) struct Replay {
    epoch: Arc<str>,
    /// The newest entry on the disk.
    newest: u64,
    /// The broker has everything up to this one.
    delivered: u64,
    /// Everything up to this one was read in this round.
    read: u64,
    /// The round in which a read began whose end is not known yet.
    reading: Option<u64>,
    ready: Option<Packed>,
    /// The last entry of what is with the broker. One message at a time: if the broker, or nobody,
    /// took it, a receiver that got the next one would take its readings for those it has.
    under_way: Option<u64>,
    /// Another one begins where what is not delivered has to be read and sent again.
    round: u64,
    /// When it goes on.
    again: Option<Duration>,
}

impl Replay {
    /// So much is on the disk.
    pub(super) fn stored(&mut self, state: &OutboxState) {
        if self.epoch != state.epoch {
            self.epoch = Arc::clone(&state.epoch);
            self.delivered = state.delivered;
            self.begin_round(None);
        }
        self.newest = state.newest;
    }

    /// After which entry is to be read now; none while there is nothing to read, or a read is
    /// under way.
    pub(super) fn next_read(&mut self, now: Duration) -> Option<u64> {
        if self.again.is_some_and(|at| at > now) {
            return None;
        }
        self.again = None;
        let is_idle = self.reading.is_none() && self.ready.is_none();
        let is_due = is_idle && self.read < self.newest;
        is_due.then(|| {
            self.reading = Some(self.round);
            self.read
        })
    }

    /// What was read; none if it could not be.
    pub(super) fn read(&mut self, now: Duration, packed: Option<Packed>) {
        if self.reading.take() != Some(self.round) {
            return;
        }
        match packed.filter(|packed| packed.epoch == self.epoch) {
            Some(packed) => {
                self.read = packed.last;
                self.ready = Some(packed);
            }
            None => self.again = Some(now + AGAIN),
        }
    }

    /// What is to be published next.
    pub(super) fn next(&mut self) -> Option<(Message, PieceId)> {
        if self.under_way.is_some() {
            return None;
        }
        let Packed { last, message, .. } = self.ready.take()?;
        self.under_way = Some(last);
        let round = self.round;
        Some((message, PieceId { round, last }))
    }

    /// What the broker said of a message. Up to which entry all is delivered now, if that is
    /// further than before.
    pub(super) fn taken(
        &mut self,
        now: Duration,
        id: PieceId,
        verdict: Verdict,
    ) -> Option<(Arc<str>, u64)> {
        if id.round != self.round {
            return None;
        }
        if verdict != Verdict::Taken {
            self.begin_round(Some(now + AGAIN));
            return None;
        }
        self.delivered = self.under_way.take_if(|last| *last == id.last)?;
        Some((Arc::clone(&self.epoch), self.delivered))
    }

    /// The connection is lost. What is not delivered is sent again on the next one.
    pub(super) fn lost(&mut self) {
        self.begin_round(None);
    }

    fn begin_round(&mut self, at: Option<Duration>) {
        self.round += 1;
        self.read = self.delivered;
        (self.ready, self.again, self.under_way) = (None, at, None);
    }

    /// When it goes on by itself.
    pub(super) const fn deadline(&self) -> Option<Duration> {
        self.again
    }

    /// How many entries the broker does not have.
    pub(super) const fn behind(&self) -> u64 {
        self.newest.saturating_sub(self.delivered)
    }
}

/// Entries as a message at this topic, as many as fit in so many bytes, but one at least.
pub(super) fn pack(
    (site, topic): (&str, String),
    (epoch, piece): (Arc<str>, &Piece),
    limit: Option<usize>,
) -> Option<Packed> {
    let mut head = Map::new();
    head.insert("schema".to_owned(), json!(SCHEMA));
    head.insert("site".to_owned(), json!(site));
    head.insert("epoch".to_owned(), json!(&*epoch));
    head.insert("seq".to_owned(), json!(piece.first));
    if let Some(missing) = piece.missing {
        let missing = json!({
            "count": missing.count,
            "from": missing.from.and_then(time),
            "to": time(missing.to),
        });
        head.insert("missing".to_owned(), missing);
    }
    let mut payload = Value::Object(head).to_string();
    // It goes on.
    payload.pop();
    payload += ",\"readings\":[";
    // What a packet has besides.
    let most = limit.map_or(LEN_MAX, |limit| {
        LEN_MAX.min(limit.saturating_sub(topic.len() + 32))
    });
    let mut count = 0;
    for entry in &piece.entries {
        let text = told(entry).to_string();
        if count > 0 && payload.len() + text.len() + 3 > most {
            break;
        }
        if count > 0 {
            payload.push(',');
        }
        payload += &text;
        count += 1;
    }
    payload += "]}";
    let last = piece.first + count;
    Some(Packed {
        epoch,
        last: last.checked_sub(1).filter(|_| count > 0)?,
        message: Message {
            topic,
            payload: payload.into_bytes(),
            is_retained: false,
            is_sure: true,
            correlation: None,
        },
    })
}

/// An entry as it is told.
fn told(entry: &OutboxEntry) -> Value {
    match &entry.what {
        EntryKind::Reading {
            path,
            value,
            quality,
            reason,
            time: read,
        } => {
            let value = value.as_deref().map(serde_json::from_str::<Value>);
            let mut told = json!({
                "path": path,
                "value": value.and_then(Result::ok),
                "quality": quality,
                "at": time(entry.at),
            });
            if let Value::Object(told) = &mut told {
                if let Some(reason) = reason {
                    told.insert("reason".to_owned(), json!(reason));
                }
                if let Some(read) = read.and_then(time) {
                    told.insert("time".to_owned(), json!(read));
                }
            }
            told
        }
        EntryKind::Gap { from, reason } => json!({
            "gap": { "reason": reason, "from": from.and_then(time), "to": time(entry.at) },
        }),
    }
}

fn time(millis: i64) -> Option<String> {
    Timestamp::from_millisecond(millis).ok().map(rfc3339)
}

#[cfg(test)]
mod tests;
