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

/// How outputs are known to be so, the weakest first.
const CONFIRMED: [&str; 3] = ["sent", "reply", "readback"];

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
    /// Its result; none as long as there is none.
    pub end: Option<EndView>,
}

/// The result of a command, for people.
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

    /// Adds a command, or its result. One of many sites is shown with the others.
    pub(super) fn add(&mut self, name: CommandName<'_>, record: &CommandKind) {
        let intent = match record {
            CommandKind::Intent(intent) => Some(intent),
            CommandKind::End(end) => end.intent.as_ref(),
        };
        if intent.is_none_or(|intent| intent.is_bulk) {
            return;
        }
        let Some(view) = view_of(name, record) else {
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
        // The result of an older command adds none: it is not among the newest.
        if view.end.is_none() {
            if self.0.len() >= RECENT_MAX {
                self.0.pop_front();
            }
            self.0.push_back(view);
        }
    }
}

/// A record for people; none if it does not name its command.
pub(crate) fn view_of((site, id): CommandName<'_>, record: &CommandKind) -> Option<CommandView> {
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
            let confirmed = confirmed(&body).filter(|_| code.is_none());
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

/// How all of its outputs are known to be so: the weakest of the words of the API.
fn confirmed(body: &Value) -> Option<String> {
    let results = body.get("results").and_then(Value::as_array);
    let each = results.into_iter().flatten().chain([body]);
    let words = each.filter_map(|one| one.get("confirmed")?.as_str());
    let rank = |word: &str| CONFIRMED.iter().position(|known| *known == word);
    let weakest = words.filter_map(rank).min()?;
    CONFIRMED.get(weakest).map(|word| (*word).to_owned())
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
    use crate::message::CommandEnd;
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
    fn several_outputs_are_known_as_well_as_the_worst_of_them() {
        let known = |words: &[&str]| {
            let results: Vec<_> = words
                .iter()
                .map(|word| json!({ "confirmed": word }))
                .collect();
            confirmed(&json!({ "results": results }))
        };
        assert_eq!(
            known(&["readback", "sent", "reply"]).as_deref(),
            Some("sent")
        );
        assert_eq!(known(&["readback", "reply"]).as_deref(), Some("reply"));
        assert_eq!(known(&["\u{1b}[31m"]), None);
        let one = confirmed(&json!({ "confirmed": "readback" }));
        assert_eq!(one.as_deref(), Some("readback"));
    }

    #[test]
    fn an_end_of_one_that_was_forgotten_is_not_among_the_newest() {
        let intent = CommandKind::Intent(CommandIntent::default());
        let mut recent = Recent::default();
        for at in 0..=RECENT_MAX {
            recent.add(("p1", &at.to_string()), &intent);
        }
        let end = CommandEnd {
            intent: Some(CommandIntent::default()),
            ..CommandEnd::default()
        };
        for id in ["0", "1"] {
            recent.add(("p1", id), &CommandKind::End(end.clone()));
        }
        assert_eq!(recent.iter().count(), RECENT_MAX);
        let first = recent.iter().next().unwrap();
        assert_eq!((first.id.as_str(), first.end.is_some()), ("1", true));
    }
}
