//! How a command ended, as its result says it.

use super::orders::{Order, Target, Wish};
use super::turns::Turn;
use crate::northbound::command_end::CommandEnd;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::{ask, control, convert, failures};
use railbus_device::Point;
use railbus_host::Confirmation;
use railbus_site::{
    BatchDone, BatchTerms, By, CommandError, CommandKey, GroupState, KeyRefusal, Pulse, PulseDone,
    Service, ToggleTerms, Within, WriteDone, WriteTerms,
};
use railbus_wire::Micros;
use serde_json::{Value, json};
use std::time::Duration;
use tokio::time::Instant;

/// The result of a command that was refused before it was one.
pub(super) fn refused(problem: Problem) -> Value {
    failed(CommandEnd::Failed, problem)
}

/// It is no command, for this reason.
pub(super) fn wrong(reason: impl Into<String>) -> Problem {
    Problem::new(codes::BAD_REQUEST).with("reason", reason.into())
}

/// The result of a command whose task panicked.
pub(super) fn broken(error: &tokio::task::JoinError) -> Value {
    let problem = Problem::new(codes::INTERNAL).with("reason", error.to_string());
    failed(CommandEnd::Unknown, problem.perhaps_acted(true))
}

fn failed(end: CommandEnd, mut problem: Problem) -> Value {
    // Which names there are is in `bridge/info`.
    problem.with.remove("known");
    json!({
        "end": end.name(),
        "code": problem.code,
        "value": null,
        "before": null,
        "may_have_acted": problem.may_have_acted,
        "audit": null,
        "took_ms": null,
        "error": problem,
    })
}

/// The result of a command to an output that was done.
fn done(
    confirmed: Confirmation,
    (value, before): (Option<bool>, Option<bool>),
    audit: &str,
    took: Micros,
) -> Value {
    json!({
        "end": CommandEnd::confirmed(confirmed).name(),
        "value": value,
        "before": before,
        "may_have_acted": true,
        "audit": audit,
        "took_ms": convert::millis(took),
    })
}

fn written(done_so: &WriteDone) -> Value {
    let output = done_so.outputs.first();
    let states = output.map_or((None, None), |(_, value, before)| (*value, *before));
    done(done_so.confirmed, states, &done_so.audit, done_so.took)
}

fn pulsed(pulse: &PulseDone) -> Value {
    let states = (Some(pulse.value), pulse.before);
    let mut told = done(pulse.confirmed, states, &pulse.audit, pulse.took);
    if let Value::Object(told) = &mut told {
        told.insert("width_ms".to_owned(), convert::millis(pulse.width).into());
    }
    told
}

/// The result of several outputs: the worst end of any of them, and each of them.
fn batch(service: &Service, done_so: BatchDone) -> Value {
    let config = service.config();
    let mut worst: Option<CommandEnd> = None;
    let mut first = None;
    let (mut may_have_acted, mut each) = (false, Vec::new());
    for part in done_so.parts {
        let path = config.path(&part.place);
        let (end, mut told) = match part.end {
            Ok(ok) => {
                let states = (ok.value, ok.before);
                let end = CommandEnd::confirmed(ok.confirmed);
                (end, done(ok.confirmed, states, &ok.audit, ok.took))
            }
            Err(failure) => {
                let (module, point) = (&part.place.module, Some(part.place.point));
                let problem = failures::problem(service, module, point, &failure);
                first = first.or_else(|| Some(problem.code.clone()));
                let end = CommandEnd::of(&failure);
                (end, failed(end, problem))
            }
        };
        may_have_acted |= told["may_have_acted"] == true;
        worst = worst.max(Some(end));
        told["path"] = path.into();
        each.push(told);
    }
    json!({
        // Of nothing, all is done.
        "end": worst.unwrap_or(CommandEnd::Readback).name(),
        "code": first,
        "may_have_acted": may_have_acted,
        "undone": done_so.undone,
        "outputs": each,
    })
}

/// Carries an order out once under its key, or just carries it out, and gives back its result.
pub(super) async fn carry_out(
    service: Service,
    order: Order,
    key: Option<String>,
    within: Within,
    turn: Turn,
) -> Value {
    let (came, mut turn) = (Instant::now(), Box::pin(turn.come()));
    let longest = Duration::from_micros(within.time().0);
    let begun = tokio::time::timeout(longest, &mut turn).await;
    let waited = u64::try_from(came.elapsed().as_micros()).unwrap_or(u64::MAX);
    let Ok(begun) = begun else {
        // Those after it still wait for those before it.
        tokio::spawn(turn);
        return refused(Problem::new(codes::EXPIRED));
    };
    let Some(within) = within.after(Micros(waited)) else {
        return refused(Problem::new(codes::EXPIRED));
    };
    let Some(key) = key else {
        return begun.with(carried(&service, &order, within)).await;
    };
    // Who may not command it any more is not told how it ended either.
    if let Err(problem) = may(&service, &order.target) {
        return refused(problem);
    }
    let mut command: Vec<Vec<u8>> = order.target.parts().map(|part| part.into()).to_vec();
    let terms = (order.wish, order.confirm, order.only_if, order.within_ms);
    command.push(format!("{terms:?}").into_bytes());
    let key = CommandKey {
        key,
        caller: service.origin().who.clone(),
        command,
    };
    let once = service.clone();
    let work = async move { begun.with(carried(&once, &order, within)).await };
    let end = service.once(key, work).await;
    end.unwrap_or_else(|refusal| {
        let end = match refusal {
            KeyRefusal::Begun => CommandEnd::Unknown,
            _ => CommandEnd::Failed,
        };
        failed(end, of_key(&refusal))
    })
}

fn of_key(refusal: &KeyRefusal) -> Problem {
    match refusal {
        KeyRefusal::BadKey => wrong("the id of a command has 1 to 128 bytes"),
        KeyRefusal::OtherCommand => wrong("this id stands for another command"),
        KeyRefusal::TooMany => Problem::new(codes::OVERLOADED),
        KeyRefusal::NotKept(why) => Problem::new(codes::NOT_KEPT).with("reason", why.clone()),
        KeyRefusal::Begun => Problem::new(codes::KEY_BEGUN).perhaps_acted(true),
    }
}

/// Whether this may be commanded now.
fn may(service: &Service, target: &Target) -> Result<(), Problem> {
    match target {
        Target::Output(module, label) => {
            let point = found(service, module, label)?;
            let may = service.may_write(module, label);
            may.map_err(|failure| failures::problem(service, module, Some(point), &failure))
        }
        Target::Group(group) => {
            let may = service.may_set_group(group);
            may.map_err(|failure| control::of_group(service, group, &failure))
        }
        Target::Scene(scene) => {
            let may = service.may_play(scene);
            may.map_err(|failure| control::of_scene(service, scene, &failure))
        }
    }
}

/// The point of this label.
fn found(service: &Service, module: &str, label: &str) -> Result<Point, Problem> {
    ask::find(service, &format!("{module}.{label}")).map(|(_, point)| point)
}

async fn carried(service: &Service, order: &Order, within: Within) -> Value {
    let told = match &order.target {
        Target::Output(module, label) => on_output(service, order, (module, label), within).await,
        Target::Group(group) => {
            let to = match order.wish {
                Wish::Set(on) => GroupState::Set(on),
                Wish::Toggle | Wish::Pulse(_) | Wish::Run => GroupState::Toggle,
            };
            let done = service.set_group(group, to, terms(order, within)).await;
            done.map(|done| batch(service, done)).map_err(|failure| {
                let problem = control::of_group(service, group, &failure);
                (failure, problem)
            })
        }
        Target::Scene(scene) => {
            let done = service.play(scene, terms(order, within)).await;
            done.map(|done| batch(service, done)).map_err(|failure| {
                let problem = control::of_scene(service, scene, &failure);
                (failure, problem)
            })
        }
    };
    told.unwrap_or_else(|(failure, problem)| failed(CommandEnd::of(&failure), problem))
}

const fn terms(order: &Order, within: Within) -> BatchTerms {
    BatchTerms {
        verify: true,
        confirm: order.confirm,
        all_or_nothing: false,
        within,
    }
}

async fn on_output(
    service: &Service,
    order: &Order,
    (module, label): (&str, &str),
    within: Within,
) -> Result<Value, (CommandError, Problem)> {
    let confirm = order.confirm;
    // Only for what is said of it: the command looks it up once more as it begins, as another
    // board may have the name by then.
    let point = found(service, module, label);
    let point = point.map_err(|problem| (CommandError::NoSuchPoint, problem))?;
    let told = match order.wish {
        Wish::Set(on) => {
            let terms = WriteTerms {
                only_if: order.only_if,
                confirm,
                within,
                ..WriteTerms::default()
            };
            let done = service.write_labelled((module, label), on, terms).await;
            done.map(|done| written(&done))
        }
        Wish::Toggle | Wish::Run => {
            let terms = ToggleTerms {
                raw: false,
                confirm,
                within,
            };
            let done = service.toggle_labelled((module, label), terms).await;
            done.map(|done| written(&done))
        }
        Wish::Pulse(width) => {
            let pulse = Pulse {
                width: width.map(|ms| Micros(ms.saturating_mul(1_000))),
                by: By::Auto,
                off: false,
                confirm,
                within,
            };
            let done = service.pulse_labelled((module, label), pulse).await;
            done.map(|done| pulsed(&done))
        }
    };
    told.map_err(|failure| {
        let problem = failures::problem(service, module, Some(point), &failure);
        (failure, problem)
    })
}

#[cfg(test)]
mod tests {
    use super::super::orders::parse;
    use super::super::turns::Turns;
    use super::*;
    use railbus_site::{Config, Rights, Role};
    use railbus_store::audit::Origin;

    /// A line that can't be opened, so that nothing is ever done.
    const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
        model = \"erc8\"\naddress = 3\n[group.lamps]\nmembers = [\"oven.k1\"]\n\
        [scene.night]\nsteps = [{ set = \"oven.k2\", to = true }]\n";

    struct Stage {
        folder: std::path::PathBuf,
        service: Service,
    }

    impl Stage {
        fn new(name: &str, points: &[&str]) -> Stage {
            let name = format!("railbus-outlet-ends-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(name);
            std::fs::create_dir_all(&folder).unwrap();
            let config = Config::parse(SITE).unwrap();
            let service = Service::start_in(config, &folder).unwrap();
            let points: Vec<String> = points.iter().map(|point| (*point).to_owned()).collect();
            let rights = Rights {
                role: match points.is_empty() {
                    true => Role::Viewer,
                    false => Role::Operator,
                },
                points: points.into(),
            };
            let service = service.on_behalf_of(Origin::program("outlet"), rights);
            Stage { folder, service }
        }

        async fn end(&self, target: Target, payload: &str) -> (String, String) {
            let order = parse(target, payload.as_bytes()).unwrap();
            let key = order.id.clone();
            let done = carry_out(
                self.service.clone(),
                order,
                key,
                Within::DEFAULT,
                Turn::default(),
            );
            let told = done.await;
            let word = |key: &str| told[key].as_str().unwrap_or_default().to_owned();
            (word("end"), word("code"))
        }
    }

    impl Drop for Stage {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }

    fn output(label: &str) -> Target {
        Target::Output("oven".to_owned(), label.to_owned())
    }

    fn failed_with(code: &str) -> (String, String) {
        ("failed".to_owned(), code.to_owned())
    }

    #[tokio::test]
    async fn what_is_not_done_is_told_with_its_code() {
        let stage = Stage::new("codes", &["oven.k1"]);
        let group = |name: &str| Target::Group(name.to_owned());
        let scene = |name: &str| Target::Scene(name.to_owned());
        for (target, payload, code) in [
            (output("k1"), "ON", "E0710"),
            (output("k1"), "TOGGLE", "E0710"),
            (output("k1"), "PULSE 500", "E0710"),
            (output("k2"), "ON", "E0906"),
            (output("k2"), "TOGGLE", "E0906"),
            (output("k2"), "PULSE", "E0906"),
            (output("k9"), "ON", "E0802"),
            (
                Target::Output("nothing".to_owned(), "k1".to_owned()),
                "ON",
                "E0801",
            ),
            (group("lamps"), "ON", "E0710"),
            (group("nothing"), "ON", "E0860"),
            (scene("night"), "RUN", "E0906"),
            (scene("nothing"), "RUN", "E0861"),
        ] {
            let end = stage.end(target.clone(), payload).await;
            assert_eq!(end, failed_with(code), "{target:?} {payload}");
        }
        let reads = Stage::new("reads", &[]);
        assert_eq!(reads.end(output("k1"), "ON").await, failed_with("E0905"));
    }

    #[tokio::test]
    async fn an_id_stands_for_one_command() {
        let stage = Stage::new("once", &["oven"]);
        let end = async |payload: &str| stage.end(output("k1"), payload).await;
        let on = "{\"value\": \"ON\", \"id\": \"a\"}";
        assert_eq!(end(on).await, failed_with("E0710"));
        assert_eq!(end(on).await, failed_with("E0710"), "the same again");
        let off = "{\"value\": \"OFF\", \"id\": \"a\"}";
        assert_eq!(end(off).await, failed_with("E0806"), "another command");
    }

    #[tokio::test]
    async fn who_lost_the_rights_is_not_told_of_an_earlier_end() {
        let stage = Stage::new("lost", &["oven"]);
        let texts = [
            (output("k1"), "{\"value\": \"ON\", \"id\": \"a\"}"),
            (
                Target::Group("lamps".to_owned()),
                "{\"value\": \"ON\", \"id\": \"b\"}",
            ),
            (
                Target::Scene("night".to_owned()),
                "{\"value\": \"RUN\", \"id\": \"c\"}",
            ),
        ];
        for (target, text) in &texts {
            let end = stage.end(target.clone(), text).await;
            assert_eq!(end, failed_with("E0710"), "{text}");
        }
        // The same caller, to whom less is allowed by now.
        let rights = Rights {
            role: Role::Operator,
            points: vec!["oven.k7".to_owned()].into(),
        };
        let service = stage
            .service
            .on_behalf_of(Origin::program("outlet"), rights);
        for (target, text) in texts {
            let order = parse(target, text.as_bytes()).unwrap();
            let key = order.id.clone();
            let told = carry_out(
                service.clone(),
                order,
                key,
                Within::DEFAULT,
                Turn::default(),
            )
            .await;
            assert_eq!(told["code"], "E0906", "{text}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_command_that_has_no_turn_in_its_time_is_not_carried_out() {
        let stage = Stage::new("turns", &["oven"]);
        let mut turns = Turns::default();
        let first = turns.next(None);
        let order = parse(output("k1"), b"ON").unwrap();
        let late = turns.next(None);
        let after = turns.next(None);
        let done = carry_out(stage.service.clone(), order, None, Within::DEFAULT, late);
        assert_eq!(done.await["code"], "E0106");
        let mut after = tokio::spawn(after.come());
        let early = tokio::time::timeout(Duration::from_secs(60), &mut after).await;
        assert!(early.is_err(), "the first one has not begun");
        drop(first);
        let _begun = after.await.unwrap();
    }
}
