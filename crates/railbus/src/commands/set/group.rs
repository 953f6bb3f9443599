//! `railbus set '@night' off`: a group, in as few frames as can be.

use super::orders::State;
use super::{Outcome, Terms, bad_word, conclude, stop, tell};
use crate::api::control_types::{BatchAnswer, BatchResult, GroupRequest, GroupValue, GroupWord};
use crate::api::problem::{Problem, codes};
use crate::api::types::Written;
use crate::commands::Context;
use crate::failure::{Code, Failure};

/// Switches the group that the words name.
pub(super) fn run(
    context: &Context,
    words: &[String],
    terms: Terms,
    dry: bool,
) -> Result<(), Failure> {
    let lang = context.lang;
    let (group, value) = parse(words).map_err(|word| bad_word(lang, &word))?;
    if dry {
        let failure = Failure::of(lang, Code::Usage).because("--dry-run @GROUP");
        return Err(failure.with_try("railbus ls groups"));
    }
    let wanted = GroupRequest {
        value,
        all_or_nothing: false,
        verify: terms.verify,
        confirm: terms.confirm,
    };
    let (answer, stopped) = context.block(async {
        let mut stop = stop::Stop::new(context)?;
        let backend = context.open().await?;
        // After Ctrl-C what is under way ends.
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

/// The group and what it is to become: `@night off`, `@night=toggle`; or the word that makes no
/// sense.
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

fn outcomes(context: &Context, answer: BatchAnswer) -> Vec<Outcome> {
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
