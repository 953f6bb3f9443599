//! The newest commands, for people.

use super::CommandName;
use crate::message::{ApiAnswer, CommandIntent, CommandKind, CommandResult, FleetRefusal};
use serde_json::Value;
use std::collections::VecDeque;

/// How many are known.
const RECENT_MAX: usize = 512;
/// The longest body that is shown, in characters.
const BODY_SHOWN: usize = 200;
/// The longest reason, in characters.
const REASON_SHOWN: usize = 200;

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
    /// The code of the problem, if there was one; of several outputs that of the first.
    pub code: Option<String>,
    /// How the output is known to be so: a word of the site's API.
    pub confirmed: Option<String>,
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
        // The end of one that was forgotten is not the newest.
        let at = self.0.partition_point(|one| one.at_ms <= view.at_ms);
        self.0.insert(at, view);
        if self.0.len() > RECENT_MAX {
            self.0.pop_front();
        }
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
    let refused = |why: &FleetRefusal| {
        let reason = why.reason.chars().take(REASON_SHOWN).collect();
        (code_of(&why.code), reason)
    };
    let (how, (code, reason), confirmed) = match &end.end {
        Some(CommandResult::Ended(answer)) => {
            let body: Value = serde_json::from_slice(&answer.body).unwrap_or_default();
            let code = problem_code(answer, &body);
            let confirmed = body.get("confirmed").and_then(Value::as_str);
            let confirmed = confirmed.filter(|_| code.is_none());
            let confirmed = confirmed.map(|word| word.chars().take(REASON_SHOWN).collect());
            ("answered", (code, String::new()), confirmed)
        }
        Some(CommandResult::Never(why)) => ("never", refused(why), None),
        Some(CommandResult::Unknown(why)) => ("unknown", refused(why), None),
        // One of a newer version.
        None => ("unknown", (None, String::new()), None),
    };
    let view = EndView {
        how,
        code,
        confirmed,
        reason,
        at_ms: end.at_ms,
    };
    Some(of(end.intent.as_ref()?, Some(view)))
}

/// The code of the problem that the API of a site answered; none if there is none. Of several
/// outputs that of the first that failed.
fn problem_code(answer: &ApiAnswer, body: &Value) -> Option<String> {
    let code = |problem: &Value| {
        problem
            .get("code")
            .and_then(Value::as_str)
            .and_then(code_of)
    };
    if !(200..300).contains(&answer.status) {
        return Some(code(body).unwrap_or_else(|| format!("HTTP {}", answer.status)));
    }
    let results = body.get("results").and_then(Value::as_array);
    let mut errors = results
        .into_iter()
        .flatten()
        .filter_map(|one| one.get("error"));
    let first = errors.find_map(code);
    let is_undone = body.get("undone").and_then(Value::as_bool) == Some(true);
    first.or_else(|| is_undone.then(|| "E1101".to_owned()))
}

/// A code, if it is one.
fn code_of(text: &str) -> Option<String> {
    let digits = text.strip_prefix('E')?;
    let is_code = (3..=5).contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_digit());
    is_code.then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn code(status: u32, body: &Value) -> Option<String> {
        let answer = ApiAnswer {
            status,
            ..ApiAnswer::default()
        };
        problem_code(&answer, body)
    }

    #[test]
    fn several_outputs_are_done_only_if_all_are() {
        let good = json!({ "path": "oven.k1", "value": true });
        let bad = json!({ "path": "hall.do0", "error": { "code": "E0301" } });
        assert_eq!(code(200, &json!({ "results": [good] })), None);
        let some = json!({ "results": [good, bad] });
        assert_eq!(code(200, &some), Some("E0301".to_owned()));
        let undone = json!({ "results": [good], "undone": true });
        assert_eq!(code(200, &undone), Some("E1101".to_owned()));
    }

    #[test]
    fn only_a_code_is_one() {
        let hostile = json!({ "code": "E0301\u{1b}[31m" });
        assert_eq!(code(500, &hostile), Some("HTTP 500".to_owned()));
        assert_eq!(
            code(404, &json!({ "code": "E0802" })),
            Some("E0802".to_owned())
        );
        assert_eq!(code(302, &Value::Null), Some("HTTP 302".to_owned()));
    }

    #[test]
    fn an_end_that_comes_late_is_not_the_newest() {
        let view = |id: &str, at_ms: i64| {
            let intent = CommandIntent {
                at_ms,
                ..CommandIntent::default()
            };
            view_of(("p1", id), &CommandKind::Intent(intent))
        };
        let mut recent = Recent::default();
        recent.add(view("b", 2));
        recent.add(view("a", 1));
        let ids: Vec<_> = recent.iter().map(|one| one.id.as_str()).collect();
        assert_eq!(ids, ["a", "b"]);
        for at in 0..RECENT_MAX {
            recent.add(view(&at.to_string(), 10 + i64::try_from(at).unwrap()));
        }
        recent.add(view("old", 0));
        assert_eq!(recent.iter().count(), RECENT_MAX);
        assert!(recent.iter().all(|one| one.id != "old"));
    }
}
