//! What the centre asks of this site: what its API answers, and commands.

use crate::clock::since_boot;
use crate::remote_api::{RemoteApi, RemoteCommand, RemoteKind, RemoteRequest, Settled};
use crate::remote_order::RemoteOrder;
use prost::Message as _;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::message::{
    ApiAnswer, ApiRequest, CommandAnswer, CommandOutcome, CommandRequest, FleetRefusal,
    ResendAnswer,
};
use railbus_site::{Rights, Role, WITHIN_MAX};
use std::time::{Duration, Instant};
use tokio::sync::OwnedSemaphorePermit;

/// A run of this outlet, and its time, which goes on while the machine sleeps.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunTime {
    pub(super) boot: [u8; 16],
    /// When it began, since the machine was booted.
    pub(super) began: Duration,
}

impl RunTime {
    /// How long it has been running.
    pub(super) fn now(&self) -> Duration {
        since_boot().saturating_sub(self.began)
    }

    /// How a command came that says this, at this time since the machine was booted.
    fn order(&self, asked: &CommandRequest, (since_boot, own): (Duration, Instant)) -> RemoteOrder {
        let is_this_run = asked.boot == self.boot;
        let (now, until) = (
            since_boot.saturating_sub(self.began),
            Duration::from_millis(asked.valid_until_ms),
        );
        let most = Duration::from_micros(WITHIN_MAX.0);
        // No command lives longer, whatever deadline it comes with.
        let by = self.began + until.min(now + most);
        let passed = (now + most).saturating_sub(until).min(now);
        RemoteOrder {
            by: is_this_run.then_some(by),
            tell: asked.tell,
            given: own.checked_sub(passed).filter(|_| is_this_run),
        }
    }
}

pub(super) fn refusal(problem: &Problem) -> FleetRefusal {
    FleetRefusal {
        code: problem.code.clone(),
        reason: problem.text("reason").to_owned(),
    }
}

pub(super) fn refused(problem: &Problem) -> ResendAnswer {
    ResendAnswer {
        refusal: Some(refusal(problem)),
    }
}

/// The answer of the API of this site, and the permit if it is still needed.
pub(super) async fn api(
    api: &RemoteApi,
    outlet: &str,
    asked: &[u8],
    permit: OwnedSemaphorePermit,
) -> (ApiAnswer, Option<OwnedSemaphorePermit>) {
    let refused = |problem: &Problem| ApiAnswer {
        refusal: Some(refusal(problem)),
        ..ApiAnswer::default()
    };
    let asked = match ApiRequest::decode(asked) {
        Ok(asked) => asked,
        Err(why) => {
            let problem = Problem::new(codes::BAD_REQUEST).with("reason", why.to_string());
            return (refused(&problem), Some(permit));
        }
    };
    let request = RemoteRequest {
        method: asked.method,
        path: asked.path,
        user: asked.user,
        language: asked.language,
        command: None,
    };
    let asked = asked_of(api, outlet, request, permit).await;
    match asked {
        Ok((answer, _, permit)) => (answer, Some(permit)),
        // The daemon is stopping.
        Err(problem) => (refused(&problem), None),
    }
}

/// A command as it was sent, and a permit for it.
///
/// # Errors
/// It can't be decoded, or [`codes::OVERLOADED`].
pub(super) fn command_request(
    payload: &[u8],
    api: &RemoteApi,
) -> Result<(CommandRequest, OwnedSemaphorePermit), Problem> {
    let request = CommandRequest::decode(payload)
        .map_err(|why| Problem::new(codes::BAD_REQUEST).with("reason", why.to_string()))?;
    let kind = match request.tell {
        true => RemoteKind::Tell,
        false => RemoteKind::Command,
    };
    let permit = api.permit(kind)?;
    Ok((request, permit))
}

/// The result of a command, and the permit if it is still needed.
pub(super) async fn command(
    api: &RemoteApi,
    outlet: &str,
    (run, rights): (RunTime, Rights),
    asked: CommandRequest,
    permit: OwnedSemaphorePermit,
) -> (CommandAnswer, Option<OwnedSemaphorePermit>) {
    // In this order: what comes between makes it older.
    let own = Instant::now();
    let order = run.order(&asked, (since_boot(), own));
    // It is looked up also where nothing is to be switched any more, and does not begin then.
    let rights = match asked.tell && rights.points.is_empty() {
        true => Rights {
            role: Role::Operator,
            points: [String::new()].into(),
        },
        false => rights,
    };
    let request = RemoteRequest {
        method: asked.method,
        path: asked.path,
        user: asked.user,
        language: asked.language,
        command: Some(RemoteCommand {
            rights,
            key: asked.id,
            body: asked.body,
            order,
        }),
    };
    let asked = asked_of(api, outlet, request, permit).await;
    let (answer, settled, permit) = match asked {
        Ok((answer, settled, permit)) => (answer, settled, Some(permit)),
        // The daemon is stopping: whether it began is not known.
        Err(problem) => return (of(CommandOutcome::Later(refusal(&problem))), None),
    };
    let why = || {
        let problem: Problem =
            serde_json::from_slice(&answer.body).unwrap_or_else(|_| Problem::new(codes::INTERNAL));
        refusal(&problem)
    };
    let outcome = match settled {
        Settled::Ended => CommandOutcome::Ended(answer),
        Settled::Never => CommandOutcome::Never(why()),
        Settled::Later => CommandOutcome::Later(why()),
        Settled::Lost => CommandOutcome::Lost(why()),
    };
    (of(outcome), permit)
}

/// The answer to a command that did not get as far as the API: it is asked for again. It may have
/// come before.
pub(super) fn not_begun(problem: &Problem) -> CommandAnswer {
    of(CommandOutcome::Later(refusal(problem)))
}

fn of(outcome: CommandOutcome) -> CommandAnswer {
    CommandAnswer {
        answer: Some(outcome),
    }
}

async fn asked_of(
    api: &RemoteApi,
    outlet: &str,
    request: RemoteRequest,
    permit: OwnedSemaphorePermit,
) -> Result<(ApiAnswer, Settled, OwnedSemaphorePermit), Problem> {
    let answer = api.ask(outlet, request, permit).await?;
    let wire = ApiAnswer {
        refusal: None,
        status: answer.status.into(),
        content_type: answer.content_type,
        body: answer.body.into(),
        took_ms: u64::try_from(answer.took.as_millis()).unwrap_or(u64::MAX),
    };
    Ok((wire, answer.settled, answer.permit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::remote_api::remote_api;

    #[test]
    fn a_deadline_counts_in_the_time_of_one_run() {
        let secs = Duration::from_secs;
        let (began, own) = (secs(1_000), Instant::now());
        let run = RunTime {
            boot: [7; 16],
            began,
        };
        let order = |boot: [u8; 16], until_s: u64| {
            let asked = CommandRequest {
                boot: boot.to_vec(),
                valid_until_ms: until_s * 1_000,
                ..CommandRequest::default()
            };
            let order = run.order(&asked, (began + secs(100), own));
            let ago = order.given.map(|given| own.duration_since(given));
            (order.by, ago)
        };
        // A minute is the longest that a command may wait: it was not given before.
        let ago = |by: u64, ago: u64| (Some(began + secs(by)), Some(secs(ago)));
        assert_eq!(order([7; 16], 105), ago(105, 55));
        assert_eq!(order([7; 16], 90), ago(90, 70));
        assert_eq!(order([7; 16], 5), ago(5, 100));
        assert_eq!(order([7; 16], u64::MAX / 1_000), ago(160, 0));
        assert_eq!(order([8; 16], 105), (None, None));
    }

    /// Questions must not take the permits of commands.
    #[test]
    fn a_question_takes_no_permit_of_a_command() {
        let (api, _calls) = remote_api();
        let request = |tell| {
            let asked = CommandRequest {
                tell,
                ..CommandRequest::default()
            };
            command_request(&asked.encode_to_vec(), &api)
        };
        let questions: Vec<_> = std::iter::from_fn(|| request(true).ok())
            .take(100)
            .collect();
        assert!((1..100).contains(&questions.len()), "{}", questions.len());
        assert_eq!(request(true).unwrap_err().code, "E0105");
        assert!(request(false).is_ok());
        assert_eq!(command_request(&[255], &api).unwrap_err().code, "E0806");
    }
}
