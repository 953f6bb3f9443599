//! What is under way on a connection.

use super::super::payload::{Metric, Payload};
use super::{ASK_EVERY, Now};
use std::collections::VecDeque;
use std::time::Duration;

/// How many times are remembered until which everything was told.
const MARKS_MAX: usize = 1_024;

/// What the births of a connection have come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// Nobody would be told yet: nothing is subscribed, or the primary host is not there.
    Waiting,
    Born,
    /// The death of the node is on its way in the message of this number, and nothing else is.
    Dying(Option<u64>),
    /// The broker has it.
    Dead,
}

/// A message that waits.
#[derive(Debug)]
pub(super) struct Queued {
    pub(super) topic: String,
    pub(super) payload: Payload,
    pub(super) is_birth: bool,
    /// It tells between which times changes may be missing.
    pub(super) tells_missing: bool,
    /// Every change until this time is in the messages before it.
    pub(super) seen: u64,
}

/// A connection.
#[derive(Debug)]
pub(super) struct Link {
    /// The number of its will.
    pub(super) bd_seq: u8,
    pub(super) phase: Phase,
    /// What is to come does.
    pub(super) is_subscribed: bool,
    /// When it is told that the primary host is away.
    pub(super) host_by: Option<Duration>,
    pub(super) queue: VecDeque<Queued>,
    /// How many of them are births.
    pub(super) births: usize,
    /// The next sequence number.
    pub(super) seq: u8,
    /// The last message that was handed over, that went out, and that is known to have arrived.
    pub(super) handed: u64,
    pub(super) went: u64,
    pub(super) arrived: u64,
    /// Messages of now since the last one of the past.
    pub(super) live: u8,
    /// When the broker was asked, until it answers.
    pub(super) asked: Option<Duration>,
    /// The messages of the past that are not known to have arrived, and their lengths.
    pub(super) past: VecDeque<(u64, usize)>,
    /// When it is asked next.
    pub(super) ask_at: Duration,
    /// Every change until this time is in the messages that wait, or in those before them.
    pub(super) seen: u64,
    /// Everything that had happened by the second time went in messages up to the first number.
    pub(super) marks: VecDeque<(u64, u64)>,
    /// The last packets with commands, to know one that comes again.
    pub(super) packets: VecDeque<(u16, [u8; 32])>,
}

impl Link {
    /// A new one, whose will has this number; changes are known until this time.
    pub(super) fn new(now: Now, bd_seq: u8, seen: u64) -> Link {
        Link {
            bd_seq,
            phase: Phase::Waiting,
            is_subscribed: false,
            host_by: None,
            queue: VecDeque::new(),
            births: 0,
            seq: 0,
            handed: 0,
            went: 0,
            arrived: 0,
            live: 0,
            asked: None,
            past: VecDeque::new(),
            ask_at: now.steady + ASK_EVERY,
            seen,
            marks: VecDeque::new(),
            packets: VecDeque::new(),
        }
    }

    pub(super) fn push(&mut self, topic: String, metrics: Vec<Metric>, is_birth: bool) {
        self.births += usize::from(is_birth);
        self.queue.push_back(Queued {
            topic,
            payload: Payload::new(metrics),
            is_birth,
            tells_missing: false,
            seen: self.seen,
        });
    }

    /// The last message that waits tells between which times changes may be missing.
    pub(super) fn tells_missing(&mut self) {
        if let Some(last) = self.queue.back_mut() {
            last.tells_missing = true;
        }
    }

    /// How many bytes of the past are not known to have arrived.
    pub(super) fn past_bytes(&self) -> usize {
        self.past.iter().map(|(_, bytes)| bytes).sum()
    }

    /// Everything that is known until this time has been handed over.
    pub(super) fn mark(&mut self, seen: u64) {
        let is_full = self.marks.len() >= MARKS_MAX;
        match self.marks.back_mut() {
            Some((last, until)) if is_full || *last == self.handed => {
                (*last, *until) = (self.handed, seen);
            }
            _ => self.marks.push_back((self.handed, seen)),
        }
    }
}
