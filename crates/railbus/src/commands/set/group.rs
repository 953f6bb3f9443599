//! `railbus set '@night' off`: switches a group, in as few frames as possible.

use super::orders::{Order, State};
use super::{Outcome, Terms, bad_word, conclude, frames, stop, tell};
use crate::backend::Backend;
use crate::commands::Context;
use railbus_api::control::{BatchAnswer, BatchResult, GroupRequest, GroupValue, GroupWord};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::{Value, Written};
use railbus_app::failure::Failure;
use railbus_app::render::out;

/// Switches the group that the arguments name.
pub(super) fn run(
    context: &Context,
    words: &[String],
    terms: Terms,
    dry: bool,
) -> Result<(), Failure> {
    let lang = context.lang;
    let (group, value) = parse(words).map_err(|word| bad_word(lang, &word))?;
    if dry {
        let frames = context.block(async {
            let backend = context.open().await?;
            let frames = frames_of(context, &backend, &group, value).await;
            backend.finish(true).await;
            frames
        })?;
        return out::result(lang, &frames);
    }
    let wanted = GroupRequest {
        value,
        all_or_nothing: false,
        verify: terms.verify,
        confirm: terms.confirm,
        within_ms: None,
    };
    let (answer, stopped) = context.block(async {
        let mut stop = stop::Stop::new(context)?;
        let backend = context.open().await?;
        // After Ctrl-C the command in progress is finished.
        let (answer, stopped) = {
            let work = backend.set_group(&group, wanted);
            tokio::pin!(work);
            match stop.or(&mut work).await {
                Some(answer) => (answer, false),
                None => (work.await, true),
            }
        };
        backend.finish(true).await;
        let answer = answer.map_err(|problem| context.failure(&problem))?;
        Ok((answer, stopped))
    })?;
    let outcomes = outcomes(context, answer);
    tell(context, &outcomes)?;
    conclude(context, outcomes, stopped)
}

/// The frames that would switch it in its present state, module by module.
async fn frames_of(
    context: &Context,
    backend: &Backend,
    group: &str,
    value: GroupValue,
) -> Result<String, Failure> {
    let told = |problem: Problem| context.failure(&problem);
    let groups = backend.groups().await.map_err(told)?;
    let Some(found) = groups.iter().find(|known| known.group == group) else {
        let known: Vec<&str> = groups.iter().map(|known| known.group.as_str()).collect();
        let problem = Problem::new(codes::NO_SUCH_GROUP).with("name", group);
        return Err(told(problem.with("known", known)));
    };
    let state = match value {
        GroupValue::Set(true) => State::On,
        GroupValue::Set(false) => State::Off,
        GroupValue::Word(GroupWord::Toggle) => {
            let points = backend.points(&found.members, true).await.map_err(told)?;
            // The same rule as for the group itself: off if any output is on, or may be.
            match points
                .iter()
                .all(|point| point.value == Some(Value::Bool(false)))
            {
                true => State::On,
                false => State::Off,
            }
        }
    };
    let mut orders: Vec<Order> = Vec::new();
    for path in &found.members {
        orders.extend(Order::to(path, state));
    }
    // The number of frames for a module does not depend on its position in the list.
    orders.sort_by(|a, b| a.module.cmp(&b.module));
    let modules = orders.chunk_by(|a, b| a.module == b.module);
    frames::show(context, backend, modules).await
}

/// The group and its new state: `@night off`, `@night=toggle`; or the word that can't be parsed.
fn parse(words: &[String]) -> Result<(String, GroupValue), String> {
    let (group, state) = match words {
        [one] => one.split_once('=').ok_or_else(|| one.clone())?,
        [group, state] => (group.as_str(), state.as_str()),
        _ => return Err(words.join(" ")),
    };
    let value = match State::from_word(state).ok_or_else(|| state.to_owned())? {
        State::On => GroupValue::Set(true),
        State::Off => GroupValue::Set(false),
        State::Toggle => GroupValue::Word(GroupWord::Toggle),
    };
    Ok((group.trim_start_matches('@').to_owned(), value))
}

/// The outcome for each output.
pub(in crate::commands) fn outcomes(context: &Context, answer: BatchAnswer) -> Vec<Outcome> {
    let end = |result: BatchResult| match (result.confirmed, result.error) {
        (Some(confirmed), None) => Ok(Written {
            value: result.value,
            before: result.before,
            confirmed,
            took_ms: result.took_ms.unwrap_or_default(),
            audit: result.audit.unwrap_or_default(),
            read_then_set: false,
        }),
        (_, Some(problem)) => Err(context.failure(&problem)),
        (None, None) => Err(context.failure(&Problem::new(codes::DAEMON))),
    };
    let each = answer.results.into_iter().map(|result| Outcome {
        path: result.path.clone(),
        end: end(result),
    });
    each.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_and_its_state_are_understood() {
        let told = |line: &str| {
            let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            parse(&words)
        };
        let night = |value| Ok(("night".to_owned(), value));
        assert_eq!(told("@night off"), night(GroupValue::Set(false)));
        assert_eq!(told("@night=on"), night(GroupValue::Set(true)));
        let toggle = GroupValue::Word(GroupWord::Toggle);
        assert_eq!(told("@night toggle"), night(toggle));
        assert_eq!(told("@night"), Err("@night".to_owned()));
        assert_eq!(told("@night maybe"), Err("maybe".to_owned()));
        assert!(told("@night off pump.do0 on").is_err());
    }
}
