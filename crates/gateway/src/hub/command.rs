//! Commands to sites: how one is given and sent, and how its result is returned.

use super::driver::HubCall;
use super::routes::{Calls, call};
use super::site_api::{self, INTEREST, INTEREST_STEP, SiteWay, Unanswered};
use crate::access::secret::{hex, random};
use crate::clock::since_boot;
use crate::routes::is_command;
use crate::{answer, remote_api};
use axum::body::{Body, Bytes};
use axum::http::Response;
use prost::Message as _;
use railbus_api::problem::{Problem, ProblemType, codes};
use railbus_fleet::ledger::CommandTold;
use railbus_fleet::message::{
    BulkOrder, CommandEnd, CommandIntent, CommandRequest, CommandResult, FleetRefusal,
};
use railbus_site::{WITHIN_MAX, WITHIN_MIN, Within};
use railbus_store::history::millis;
use serde_json::Value;
use std::time::{Duration, SystemTime};

/// The longest body of a command, in bytes.
const BODY_MAX: usize = 16 << 10;
/// The longest path, in bytes: names have 64 characters.
const PATH_MAX: usize = 1_024;
/// The longest `Accept-Language`, in bytes.
const LANGUAGE_MAX: usize = 256;
/// How long the end of a command is waited for, besides the time in which it is sent: reading back,
/// the way, and storing what came of it.
const END_MAX: Duration = Duration::from_secs(15);
/// The length of ids, in bytes.
const ID_LEN: usize = 16;

/// A command as it was given.
pub(super) struct GivenCommand {
    pub(super) site: String,
    pub(super) id: String,
    /// The caller gave the id: it may have been sent before.
    pub(super) is_again: bool,
    /// It is one of an order to many sites.
    is_bulk: bool,
    /// When it was given, since the machine was booted.
    pub(super) given: Duration,
    method: String,
    path: String,
    body: Bytes,
    /// Who gave it.
    user: String,
    language: String,
}

/// The result of sending one.
pub(super) enum SentEnd {
    /// The site answered.
    Answer(Vec<u8>),
    /// No responders on its subject.
    NotDelivered,
    /// No answer came.
    Nothing,
}

impl GivenCommand {
    /// The command of this request.
    ///
    /// # Errors
    /// [`codes::NOT_REMOTE`] if it is no command; [`codes::BAD_REQUEST`] if its key is not valid,
    /// or its path or body too long.
    pub(super) fn new(
        (site, key): (String, Option<&str>),
        (method, path): (&str, &str),
        body: Bytes,
        (user, language): (&str, &str),
    ) -> Result<GivenCommand, Problem> {
        let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
        // Other requests may have secrets in them, and must not be recorded.
        if !is_command(method, path) {
            return Err(remote_api::not_remote(method));
        }
        if body.len() > BODY_MAX {
            return Err(wrong("the body is longer than 16 KiB"));
        }
        if path.len() > PATH_MAX {
            return Err(wrong("the path is longer than 1 KiB"));
        }
        let is_letter = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'-';
        let id = match key {
            None => {
                let id = random::<ID_LEN>().map_err(|error| wrong(&error.to_string()))?;
                hex(&id)
            }
            Some(key) if (1..=64).contains(&key.len()) && key.bytes().all(is_letter) => {
                key.to_owned()
            }
            Some(_) => {
                return Err(wrong(
                    "the Idempotency-Key of a command to a site has 1 to 64 letters, digits and \
                     hyphens",
                ));
            }
        };
        Ok(GivenCommand {
            site,
            id,
            is_again: key.is_some(),
            is_bulk: false,
            given: since_boot(),
            method: method.to_owned(),
            path: path.to_owned(),
            body,
            user: user.to_owned(),
            // Without it, errors have no texts.
            language: match language.len() > LANGUAGE_MAX {
                true => String::new(),
                false => language.to_owned(),
            },
        })
    }

    /// The same command to all of these sites.
    ///
    /// # Errors
    /// There is no randomness.
    pub(super) fn into_order(self, sites: Vec<String>) -> Result<BulkOrder, Problem> {
        Ok(BulkOrder {
            method: self.method,
            path: self.path,
            body: self.body.to_vec(),
            user: self.user,
            language: self.language,
            sites,
            at_ms: millis(SystemTime::now()),
            token: token()?,
        })
    }

    /// The command of an order to this site, given now.
    pub(super) fn of_order(order: &BulkOrder, (site, id): (&str, &str)) -> GivenCommand {
        GivenCommand {
            site: site.to_owned(),
            id: id.to_owned(),
            is_again: false,
            is_bulk: true,
            given: since_boot(),
            method: order.method.clone(),
            path: order.path.clone(),
            body: order.body.clone().into(),
            user: order.user.clone(),
            language: order.language.clone(),
        }
    }

    /// The time within which its frames must be sent.
    fn within(&self) -> Duration {
        let body: Value = serde_json::from_slice(&self.body).unwrap_or_default();
        let wanted = body.get("within_ms").and_then(Value::as_u64);
        let micros = wanted.map_or(Within::DEFAULT.time().0, |ms| ms.saturating_mul(1_000));
        // The site says what is wrong with another one.
        Duration::from_micros(micros.clamp(WITHIN_MIN.0, WITHIN_MAX.0))
    }

    /// How long what came of it is waited for.
    pub(super) fn wait(&self) -> Duration {
        self.within() + END_MAX
    }

    /// What is wanted at this time since the machine was booted, of a site in this run, whose time
    /// has come so far. Without that it can't begin: only what came of it before can be told.
    pub(super) fn intent(
        &self,
        now: Duration,
        time: Option<(&[u8], u64)>,
        at_ms: i64,
    ) -> Result<CommandIntent, Problem> {
        // It may have waited here.
        let within = self.within().saturating_sub(now.saturating_sub(self.given));
        let within = u64::try_from(within.as_millis()).unwrap_or(u64::MAX);
        let until = time.map_or(0, |(_, time_ms)| time_ms.saturating_add(within));
        Ok(CommandIntent {
            method: self.method.clone(),
            path: self.path.clone(),
            body: self.body.to_vec(),
            user: self.user.clone(),
            language: self.language.clone(),
            boot: time.map_or_else(Vec::new, |(boot, _)| boot.to_vec()),
            valid_until_ms: until,
            at_ms,
            token: token()?,
            is_bulk: self.is_bulk,
        })
    }
}

/// What distinguishes a record from another one of the same id.
fn token() -> Result<Vec<u8>, Problem> {
    let token = random::<ID_LEN>();
    token
        .map(|token| token.to_vec())
        .map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))
}

/// Gives a command, and returns its result.
pub(super) async fn give(calls: &Calls, given: GivenCommand) -> Response<Body> {
    let (site, id, is_again) = (given.site.clone(), given.id.clone(), given.is_again);
    let begun = since_boot();
    let told = match call(calls, |to| HubCall::Command(given, to)).await {
        Ok(Ok(told)) => told,
        Ok(Err(problem)) => return answer::problem(&problem),
        // The centre is stopping: it may have been sent.
        Err(problem) => return answer::problem(&problem.perhaps_acted(true)),
    };
    let open = |reason: &str| {
        let problem = Problem::new(codes::COMMAND_OPEN).with("name", site.as_str());
        let problem = problem.with("id", id.as_str()).with("reason", reason);
        problem.perhaps_acted(true)
    };
    let problem = match told {
        CommandTold::End(end) => match end_of(&site, &end, since_boot().saturating_sub(begun)) {
            Ok(answer) => return answer,
            Err(problem) => problem,
        },
        CommandTold::Waiting => open("no answer yet; the centre keeps asking the site"),
        CommandTold::NotKnown => open("it is not known whether it was sent before"),
        CommandTold::TooMany if is_again => open("it is not known whether it was sent before"),
        CommandTold::OtherCommand => Problem::new(codes::BAD_REQUEST)
            .with("reason", "this Idempotency-Key stands for another command"),
        CommandTold::Offline => offline(&site),
        CommandTold::NotStored if is_again => open("it is not known whether it was sent before"),
        CommandTold::NotStored => {
            let reason = "not sent: it could not be recorded first";
            Problem::new(codes::FLEET_NOT_STORED).with("reason", reason)
        }
        CommandTold::TooMany => {
            Problem::new(codes::OVERLOADED).with("reason", "too many commands without a result")
        }
    };
    answer::problem(&problem)
}

/// The result of a command as HTTP; a problem if the site gave none.
fn end_of(site: &str, end: &CommandEnd, waited: Duration) -> Result<Response<Body>, Problem> {
    let of = |kind: ProblemType, why: FleetRefusal| {
        let problem = Problem::new(kind).with("name", site);
        problem.with("reason", site_api::shown(&why))
    };
    match end.end.clone() {
        Some(CommandResult::Ended(answer)) => {
            // It says what was so when it was given.
            let age = millis(SystemTime::now()).saturating_sub(end.at_ms);
            let age = u64::try_from(age).unwrap_or_default();
            let took = Duration::from_millis(answer.took_ms);
            let passed = waited.saturating_sub(took).max(Duration::from_millis(age));
            site_api::response(answer, passed).map_err(|reason| {
                Problem::new(codes::COMMAND_OPEN)
                    .with("name", site)
                    .with("reason", reason)
                    .perhaps_acted(true)
            })
        }
        Some(CommandResult::Never(why)) => {
            let known = [codes::EXPIRED, codes::FLEET_NOT_STORED];
            let kind = known.into_iter().find(|kind| kind.code == why.code);
            Err(of(kind.unwrap_or(codes::SITE_AWAY), why))
        }
        Some(CommandResult::Unknown(why)) => Err(of(codes::COMMAND_OPEN, why).perhaps_acted(true)),
        // One of a newer version.
        None => Err(of(codes::COMMAND_OPEN, FleetRefusal::default()).perhaps_acted(true)),
    }
}

/// A site that is not online is sent nothing: without its heartbeat there is no deadline.
pub(super) fn offline(site: &str) -> Problem {
    let problem = Problem::new(codes::SITE_AWAY).with("name", site);
    problem.with("reason", "it is not online")
}

/// Sends it to its site, in the session of this subject.
pub(super) async fn send(way: SiteWay, request: &CommandRequest) -> SentEnd {
    let (payload, begun) = (Bytes::from(request.encode_to_vec()), since_boot());
    loop {
        match way.request(payload.clone()).await {
            Ok(answer) => return SentEnd::Answer(answer.payload.to_vec()),
            Err(Unanswered::NotDelivered) if since_boot().saturating_sub(begun) > INTEREST => {
                return SentEnd::NotDelivered;
            }
            // After a site has connected, servers know only after a moment that it listens.
            Err(Unanswered::NotDelivered) => tokio::time::sleep(INTEREST_STEP).await,
            Err(_) => return SentEnd::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(key: Option<&str>, body: &str) -> Result<GivenCommand, Problem> {
        let body = Bytes::from(body.to_owned());
        let place = ("PUT", "/api/v1/points/oven/k1");
        GivenCommand::new(("plant7".to_owned(), key), place, body, ("li", ""))
    }

    #[test]
    fn an_id_can_stand_in_a_subject() {
        let id = |key| given(key, "").map(|given| given.id);
        assert_eq!(id(Some("a-1")).unwrap(), "a-1");
        assert_eq!(id(None).unwrap().len(), 32);
        assert_ne!(id(None).unwrap(), id(None).unwrap());
        for wrong in ["", "a.b", "*", ">", "a b", "é", &"x".repeat(65)] {
            assert_eq!(id(Some(wrong)).unwrap_err().code, "E0806", "{wrong:?}");
        }
    }

    #[test]
    fn a_deadline_is_in_the_time_of_the_site() {
        let until = |body: &str| {
            let given = given(None, body).unwrap();
            let time = Some((&[7; 16][..], 1_000));
            given.intent(given.given, time, 0).unwrap().valid_until_ms
        };
        assert_eq!(until("{\"value\":true}"), 6_000);
        assert_eq!(until("{\"within_ms\":300}"), 1_300);
        assert_eq!(until("{\"within_ms\":1}"), 1_200);
        assert_eq!(until("{\"within_ms\":99999999}"), 61_000);
        assert_eq!(until("nothing"), 6_000);
        // What it has waited for is not given again; without a heartbeat it can't begin.
        let given = given(None, "{}").unwrap();
        let later = given.given + Duration::from_secs(2);
        let time = Some((&[7; 16][..], 1_000));
        assert_eq!(given.intent(later, time, 0).unwrap().valid_until_ms, 4_000);
        let none = given.intent(later, None, 0).unwrap();
        assert_eq!((none.valid_until_ms, none.boot), (0, Vec::new()));
    }

    #[test]
    fn only_commands_are_recorded() {
        let code = |method, path| {
            let place = ("plant7".to_owned(), None);
            let given = GivenCommand::new(place, (method, path), Bytes::new(), ("li", ""));
            given.err().map(|problem| problem.code)
        };
        for (method, path) in [
            ("PUT", "/api/v1/points/oven/k1"),
            ("POST", "/api/v1/points/oven/k1/toggle"),
            ("POST", "/api/v1/scenes/night/run?x=y"),
            ("POST", "/api/v1/batch"),
        ] {
            assert_eq!(code(method, path), None, "{method} {path}");
        }
        for (method, path) in [
            ("POST", "/api/v1/users"),
            ("PUT", "/api/v1/config"),
            ("PUT", "/api/v1/points/oven/k1/lease"),
            ("POST", "/api/v1/points/oven/k1"),
            ("PUT", "/api/v1/points/oven"),
            ("PUT", "/points/oven/k1"),
            ("PUT", "/api/v1/points/oven/k1/"),
        ] {
            let refused = Some("E0937".to_owned());
            assert_eq!(code(method, path), refused, "{method} {path}");
        }
    }

    #[test]
    fn what_is_not_known_may_have_acted_and_what_never_began_has_not() {
        let told = |result: Option<CommandResult>| {
            let end = CommandEnd {
                intent: None,
                end: result,
                at_ms: 0,
            };
            let problem = end_of("plant7", &end, Duration::ZERO).unwrap_err();
            (problem.code, problem.may_have_acted)
        };
        let why = |code: &str| FleetRefusal {
            code: code.to_owned(),
            reason: String::new(),
        };
        for (code, shown) in [("E0106", "E0106"), ("E0164", "E0164"), ("E0999", "E0168")] {
            let never = Some(CommandResult::Never(why(code)));
            assert_eq!(told(never), (shown.to_owned(), false));
        }
        let unknown = Some(CommandResult::Unknown(why("E0106")));
        assert_eq!(told(unknown), ("E0169".to_owned(), true));
        assert_eq!(told(None), ("E0169".to_owned(), true));
    }
}
