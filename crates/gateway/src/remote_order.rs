//! A command that a remote caller gave: by when it is begun, or what is known of it.
//! docs/decisions/0056

use super::answer;
use super::clock::since_boot;
use super::keys::{self, KnownEnd};
use super::route::Answer;
use axum::body::Body;
use axum::http::Response;
use railbus_api::problem::{Problem, codes};
use railbus_site::{CommandKey, Service, WITHIN_MIN, Within};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::time::{Duration, Instant};

/// The key of a request with the time within which it must be sent, in milliseconds.
const WITHIN: &str = "within_ms";

/// How a command came that a remote caller gave. Its request has it as an extension. Times are
/// since the machine was booted: they go on while it sleeps.
#[derive(Clone, Copy, Debug)]
pub(super) struct RemoteOrder {
    /// By when its frames must be sent. None if the caller speaks of another run: then it is not
    /// begun.
    pub(super) by: Option<Duration>,
    /// It is not begun: only what is known of it is wanted.
    pub(super) tell: bool,
    /// It was given at this time or later; none if that may have been in another run.
    pub(super) given: Option<Instant>,
}

/// What came of a command, besides its answer. The response has it as an extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Settled {
    /// The answer is what came of it.
    Ended,
    /// It was not begun, and never will be.
    Never,
    /// Not known yet.
    Later,
    /// Not known, and never will be.
    Lost,
}

impl RemoteOrder {
    /// Whether it may begin now.
    pub(super) fn may_begin(&self) -> bool {
        !self.tell && self.left().is_some()
    }

    /// How long it has until its frames must be sent; none if that is too short.
    fn left(&self) -> Option<Duration> {
        let left = self.by?.checked_sub(since_boot())?;
        (left >= Duration::from_micros(WITHIN_MIN.0)).then_some(left)
    }

    /// The request with what is left of its time.
    ///
    /// # Errors
    /// [`codes::EXPIRED`] if that is too short.
    pub(super) fn in_time<T: DeserializeOwned>(&self, body: &[u8]) -> Result<T, Problem> {
        let left = self.left().ok_or_else(|| Problem::new(codes::EXPIRED))?;
        let left = u64::try_from(left.as_millis()).unwrap_or(u64::MAX);
        let wrong = |error: &dyn ToString| {
            Problem::new(codes::BAD_REQUEST).with("reason", error.to_string())
        };
        let body = if body.is_empty() { b"{}" } else { body };
        let mut body: Value = serde_json::from_slice(body).map_err(|error| wrong(&error))?;
        let object = body
            .as_object_mut()
            .ok_or_else(|| wrong(&"the body is no object"))?;
        let usual = Within::DEFAULT.time().0 / 1_000;
        let own = object.get(WITHIN).and_then(Value::as_u64).unwrap_or(usual);
        object.insert(WITHIN.to_owned(), own.min(left).into());
        serde_json::from_value(body).map_err(|error| wrong(&error))
    }

    /// What is known of it. Whoever must not learn how it ended is told no more than whether it
    /// was begun.
    pub(super) fn told(&self, service: &Service, key: &CommandKey, may_learn: bool) -> Answer {
        // Whatever still arrives of it is not begun any more.
        let is_over = self.left().is_none();
        match keys::told(service, key, self.given) {
            KnownEnd::Ended(end) if may_learn => settled(answer::text(end), Settled::Ended),
            KnownEnd::Ended(_) | KnownEnd::UnderWay => expired(Settled::Later),
            KnownEnd::Never if is_over => expired(Settled::Never),
            // It may have been known, and it may still come.
            KnownEnd::Forgotten | KnownEnd::Other if self.tell && is_over => expired(Settled::Lost),
            KnownEnd::Never | KnownEnd::Forgotten | KnownEnd::Other => expired(Settled::Later),
        }
    }
}

fn expired(how: Settled) -> Answer {
    let reason = match how {
        Settled::Ended | Settled::Never => "it reached the site too late",
        Settled::Later => "it is under way at the site, or may still come",
        Settled::Lost => "the site was restarted meanwhile, or has no record of it any more",
    };
    let problem = Problem::new(codes::EXPIRED).with("reason", reason);
    settled(answer::problem(&problem), how)
}

fn settled(mut answer: Response<Body>, how: Settled) -> Answer {
    answer.extensions_mut().insert(how);
    answer
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::types::{ToggleRequest, WriteRequest};

    fn order(left: Duration) -> RemoteOrder {
        RemoteOrder {
            by: Some(since_boot() + left),
            tell: false,
            given: None,
        }
    }

    #[test]
    fn a_command_has_what_is_left_of_its_time() {
        let within = |left: Duration, body: &str| {
            let wanted: WriteRequest = order(left).in_time(body.as_bytes()).unwrap();
            wanted.within_ms.unwrap()
        };
        let long = Duration::from_secs(100);
        assert_eq!(within(long, "{\"value\":true}"), 5_000);
        assert_eq!(within(long, "{\"value\":true,\"within_ms\":300}"), 300);
        let two = Duration::from_secs(2);
        let left = within(two, "{\"value\":true,\"within_ms\":60000}");
        assert!(left <= 2_000 && left > 200, "{left}");
        let toggle: ToggleRequest = order(long).in_time(b"").unwrap();
        assert_eq!(toggle.within_ms, Some(5_000));
    }

    #[test]
    fn a_command_that_is_late_does_not_begin() {
        let late = [
            order(Duration::ZERO),
            order(Duration::from_millis(199)),
            RemoteOrder {
                by: None,
                ..order(Duration::ZERO)
            },
        ];
        for late in late {
            assert!(!late.may_begin());
            let end = late.in_time::<WriteRequest>(b"{\"value\":true}");
            assert_eq!(end.unwrap_err().code, "E0106");
        }
        let long = order(Duration::from_secs(100));
        assert!(long.may_begin());
        assert!(!RemoteOrder { tell: true, ..long }.may_begin());
    }
}
