//! The newest commands, for people.

use super::{CommandName, problem_code};
use crate::message::{CommandIntent, CommandKind, CommandResult};
use std::collections::VecDeque;

/// How many are known.
const RECENT_MAX: usize = 512;
/// The longest body that is shown, in characters.
const BODY_SHOWN: usize = 200;

/// A command, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandView {
    /// Its site.
    pub site: String,
    /// Its id there.
    pub id: String,
    /// The name of the caller at the centre.
    pub user: String,
    /// What was wanted: method, path, and the beginning of the body.
    pub what: (String, String, String),
    /// When it was wanted, in milliseconds since 1970.
    pub at_ms: i64,
    /// What came of it; none as long as that is not known.
    pub end: Option<EndView>,
}

/// What came of a command, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndView {
    /// `answered`, `never` or `unknown`.
    pub how: &'static str,
    /// The code of the problem, if there was one.
    pub code: Option<String>,
    /// Why it was not carried out, or that is not known, in English.
    pub reason: String,
    /// When that was known, in milliseconds since 1970.
    pub at_ms: i64,
}

/// The newest ones.
#[derive(Debug, Default)]
pub(super) struct Recent(VecDeque<CommandView>);

impl Recent {
    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = &CommandView> {
        self.0.iter()
    }

    /// Adds a command, or what came of it.
    pub(super) fn add(&mut self, view: Option<CommandView>) {
        let Some(view) = view else {
            return;
        };
        let known = self.0.iter_mut().rev();
        let mut same = known.filter(|one| one.id == view.id && one.site == view.site);
        if let Some(one) = same.next() {
            if view.end.is_some() {
                one.end = view.end;
            }
            return;
        }
        if self.0.len() >= RECENT_MAX {
            self.0.pop_front();
        }
        self.0.push_back(view);
    }
}

/// What a record tells people; none if it does not say of which command it is.
pub(super) fn view_of((site, id): CommandName<'_>, record: &CommandKind) -> Option<CommandView> {
    let of = |intent: &CommandIntent, end| {
        let body = String::from_utf8_lossy(&intent.body);
        CommandView {
            site: site.to_owned(),
            id: id.to_owned(),
            user: intent.user.clone(),
            what: (
                intent.method.clone(),
                intent.path.clone(),
                body.chars().take(BODY_SHOWN).collect(),
            ),
            at_ms: intent.at_ms,
            end,
        }
    };
    let end = match record {
        CommandKind::Intent(intent) => return Some(of(intent, None)),
        CommandKind::End(end) => end,
    };
    let (how, code, reason) = match end.end.as_ref()? {
        CommandResult::Ended(answer) => ("answered", problem_code(answer), String::new()),
        CommandResult::Never(why) => ("never", Some(why.code.clone()), why.reason.clone()),
        CommandResult::Unknown(why) => ("unknown", Some(why.code.clone()), why.reason.clone()),
    };
    let view = EndView {
        how,
        code,
        reason,
        at_ms: end.at_ms,
    };
    Some(of(end.intent.as_ref()?, Some(view)))
}
