//! One command, and how far it is.

use super::{CommandTold, LedgerOutput, STORES_MAX, TAKEN_OVER};
use crate::message::{CommandEnd, CommandIntent, CommandRequest};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// How far a command is.
#[derive(Debug)]
pub(super) enum Stage {
    /// That it is wanted is being stored.
    Storing,
    /// It is read what this id stands for; or when it is again, and how often it was.
    Reading(Option<Duration>, u32),
    /// It could not be stored, and nothing was sent. If it was stored after all, it is ended: that
    /// is waited for until then.
    Dropped(Duration),
    /// It was sent.
    Sent(u64),
    /// What came of it is not known: the number of its record, when the site is asked, if it is
    /// not being asked, and how often it was.
    Open(u64, Option<Duration>, u32),
    /// What came of it is being stored after the record with this number; or when it is, again, and
    /// how often it was.
    Ending(u64, Arc<CommandEnd>, Option<Duration>, u32),
}

#[derive(Debug)]
pub(super) struct Command {
    pub(super) intent: CommandIntent,
    pub(super) stage: Stage,
    /// The number of what is under way for it. Results of anything else are of an earlier command
    /// of this name, or came too late.
    pub(super) pending: u64,
    /// What is wanted under this id, as it is in the stream, with its number there.
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

    /// Whether it counts among those of its site: it may still be carried out, or somebody waits.
    pub(super) fn is_under_way(&self) -> bool {
        match self.stage {
            Stage::Dropped(_) => false,
            Stage::Ending(..) => !self.callers.is_empty(),
            _ => true,
        }
    }

    /// Tells callers whose time is over.
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

/// What its site is sent.
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
    let what = |intent: &CommandIntent| {
        let CommandIntent {
            method, path, user, ..
        } = intent.clone();
        (method, path, user)
    };
    one.body == other.body && what(one) == what(other)
}
