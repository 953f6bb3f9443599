//! One command and its state.

use super::{CommandTold, LedgerOutput, STORES_MAX, TAKEN_OVER, record};
use crate::message::{CommandEnd, CommandIntent, CommandKind, CommandRequest};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// The state of a command.
#[derive(Debug)]
pub(super) enum Stage {
    /// Its intent is being stored.
    Storing,
    /// The record of this id is being read; or when it is read again, and how often it was.
    Reading(Option<Duration>, u32),
    /// It could not be stored, and nothing was sent. If it was stored after all, it is ended: that
    /// is waited for until then.
    Dropped(Duration),
    /// It was sent.
    Sent(u64),
    /// Its result is not known: the number of its record, when the site is asked next (none while
    /// it is being asked), and how often it was.
    Open(u64, Option<Duration>, u32),
    /// Its result is being stored after the record with this number; or when it is stored again,
    /// and how often it was.
    Ending(u64, Arc<CommandEnd>, Option<Duration>, u32),
}

#[derive(Debug)]
pub(super) struct Command {
    pub(super) intent: CommandIntent,
    pub(super) stage: Stage,
    /// The number of what is under way for it. Results of anything else are of an earlier command
    /// of this name, or came too late.
    pub(super) pending: u64,
    /// The intent of this id as it is in the stream, with its number there.
    pub(super) seen: Option<(u64, CommandIntent)>,
    /// Who waits for its end, and until when.
    pub(super) callers: Vec<(u64, Duration)>,
    /// Until when its site is asked.
    pub(super) known_until: Duration,
}

impl Command {
    /// Whether it still goes on at this time. One that was dropped may be carried out by another
    /// centre; one whose end can't be stored was told.
    pub(super) fn goes_on(&mut self, now: Duration) -> bool {
        match &self.stage {
            Stage::Dropped(by) if *by <= now => match self.seen.take() {
                Some((number, intent)) => {
                    self.intent = intent;
                    self.stage = Stage::Open(number, Some(now + TAKEN_OVER), 0);
                    true
                }
                None => false,
            },
            Stage::Ending(_, _, Some(_), tries) => *tries < STORES_MAX || !self.callers.is_empty(),
            _ => true,
        }
    }

    /// Whether it counts towards the limit of its site: it may still be carried out, or a caller
    /// waits.
    pub(super) fn is_under_way(&self) -> bool {
        match self.stage {
            Stage::Dropped(_) => false,
            Stage::Ending(..) => !self.callers.is_empty(),
            _ => true,
        }
    }

    /// The request to the stream that is due: its end is stored, or its record read.
    pub(super) fn next_request(&self, site: &str, id: &str) -> LedgerOutput {
        let (number, site, id) = (self.pending, site.to_owned(), id.to_owned());
        match &self.stage {
            Stage::Ending(after, end, ..) => LedgerOutput::Store {
                number,
                site,
                id,
                payload: record(CommandKind::End((**end).clone())),
                after: *after,
            },
            _ => LedgerOutput::Read(number, site, id),
        }
    }

    /// Answers callers whose time is over.
    pub(super) fn tell_late(
        &mut self,
        now: Duration,
        at: &mut impl FnMut(Duration),
        outputs: &mut VecDeque<LedgerOutput>,
    ) {
        let stage = &self.stage;
        self.callers.retain(|(number, until)| {
            if *until > now {
                at(*until);
                return true;
            }
            let told = match stage {
                Stage::Ending(_, end, ..) => CommandTold::End(Arc::clone(end)),
                Stage::Storing | Stage::Reading(..) | Stage::Dropped(_) => CommandTold::NotKnown,
                Stage::Sent(_) | Stage::Open(..) => CommandTold::Waiting,
            };
            outputs.push_back(LedgerOutput::Tell(*number, told));
            false
        });
    }
}

/// The message to its site.
pub(super) fn request(id: &str, intent: &CommandIntent, tell: bool) -> CommandRequest {
    CommandRequest {
        id: id.to_owned(),
        method: intent.method.clone(),
        path: intent.path.clone(),
        body: intent.body.clone(),
        user: intent.user.clone(),
        language: intent.language.clone(),
        boot: intent.boot.clone(),
        valid_until_ms: intent.valid_until_ms,
        tell,
    }
}

/// Whether it is the same command, given again.
pub(super) fn is_same(one: &CommandIntent, other: &CommandIntent) -> bool {
    one.method == other.method
        && one.path == other.path
        && one.user == other.user
        && one.body == other.body
}
