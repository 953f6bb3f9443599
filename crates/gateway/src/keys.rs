//! Requests with an `Idempotency-Key`: the site carries each out once, and keeps its answer as it
//! was given. docs/decisions/0028, 0040

use axum::body::Bytes;
use railbus_api::problem::{Problem, codes};
use railbus_site::{CommandKey, KeyRefusal, KeyTold, Service};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::time::Instant;

/// The end of a command, as JSON text.
pub(super) type End = Result<Bytes, Problem>;

/// What is known of a command with a key.
#[derive(Debug)]
pub(super) enum KnownEnd {
    Ended(End),
    UnderWay,
    /// It was not begun.
    Never,
    /// Whether it was begun is not known.
    Forgotten,
    /// The key stands for another command by now.
    Other,
}

/// Carries a command out once per key: a repeated request gets the first answer.
pub(super) async fn once(
    service: &Service,
    key: CommandKey,
    work: impl Future<Output = End> + Send + 'static,
) -> End {
    let told = service.once(key, async { Told::of(&work.await) }).await;
    match told {
        Ok(told) => Told::end(told),
        Err(refusal) => Err(problem(&refusal)),
    }
}

/// What is known of a command, without carrying it out: it was given at this time or later, if that
/// was in this process.
pub(super) fn told(service: &Service, key: &CommandKey, given: Option<Instant>) -> KnownEnd {
    match service.told(key, given) {
        Ok(KeyTold::Ended(told)) => KnownEnd::Ended(Told::end(told)),
        Ok(KeyTold::Begun) => KnownEnd::Ended(Err(problem(&KeyRefusal::Begun))),
        Ok(KeyTold::UnderWay) => KnownEnd::UnderWay,
        Ok(KeyTold::Never) => KnownEnd::Never,
        Ok(KeyTold::Forgotten) => KnownEnd::Forgotten,
        Err(_) => KnownEnd::Other,
    }
}

fn problem(refusal: &KeyRefusal) -> Problem {
    let wrong = |reason| Problem::new(codes::BAD_REQUEST).with("reason", reason);
    match refusal {
        KeyRefusal::BadKey => wrong("an Idempotency-Key has 1 to 128 characters of ASCII"),
        KeyRefusal::OtherCommand => wrong("this Idempotency-Key stands for another command"),
        KeyRefusal::TooMany => Problem::new(codes::OVERLOADED),
        KeyRefusal::NotKept(why) => {
            let why = format!("Idempotency-Key: {why}");
            Problem::new(codes::NOT_KEPT).with("reason", why)
        }
        KeyRefusal::Begun => Problem::new(codes::KEY_BEGUN).perhaps_acted(true),
    }
}

/// The result of a command whose task panicked.
pub(super) fn broken(error: tokio::task::JoinError) -> End {
    let problem = Problem::new(codes::INTERNAL).with("reason", error.to_string());
    Err(problem.perhaps_acted(true))
}

/// An answer as stored.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Told {
    Done(String),
    Problem(Problem),
}

impl Told {
    fn of(end: &End) -> Value {
        let told = match end {
            Ok(body) => Told::Done(String::from_utf8_lossy(body).into_owned()),
            Err(problem) => Told::Problem(problem.clone()),
        };
        // The API's own types are always valid JSON.
        serde_json::to_value(told).unwrap_or_default()
    }

    /// The answer that was stored. What can't be read is as good as none.
    fn end(told: Value) -> End {
        match serde_json::from_value(told) {
            Ok(Told::Done(body)) => Ok(Bytes::from(body)),
            Ok(Told::Problem(problem)) => Err(problem),
            Err(_) => Err(problem(&KeyRefusal::Begun)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_given_again_as_it_was() {
        let problem = Problem::new(codes::NO_REPLY).with("module", "oven");
        let body = "{\"value\":true,\"before\":null,\"a\":1.50}";
        for end in [Ok(Bytes::from(body)), Err(problem.perhaps_acted(true))] {
            assert_eq!(Told::end(Told::of(&end)), end);
        }
        let unread = Told::end(Value::from(7)).expect_err("a problem");
        assert!(unread.may_have_acted);
    }
}
