//! `railbus scene`: sequences of switching steps from the configuration.

mod texts;

use super::context::far_flag;
use super::set::frames;
use super::set::orders::{Order, State};
use super::{Context, set, stop};
use crate::args;
use crate::backend::Backend;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_api::control::{SceneInfo, SceneRequest, StepInfo};
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{out, values};
use railbus_app::texts::AppText;
use railbus_words::Lang;
use railbus_words::time;
use texts::SceneText;

/// The name of the command.
pub(crate) const NAME: &str = "scene";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let verb = |name, about, usage| {
        let examples = args::examples(lang, SceneText::Examples);
        args::verb(lang, name, about, usage).before_help(examples)
    };
    let run = verb("run", SceneText::Run, "railbus scene run NAME [-n] [--yes]")
        .arg(far_flag(lang))
        .arg(
            Arg::new("NAME")
                .required(true)
                .help(lang.get(SceneText::Name)),
        )
        .arg(
            args::flag(lang, "dry-run", Text::DryRun)
                .short('n')
                .action(ArgAction::SetTrue),
        )
        .arg(args::flag(lang, "yes", Text::MeantYes).action(ArgAction::SetTrue));
    verb(NAME, SceneText::About, "railbus scene COMMAND")
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand(verb("list", SceneText::List, "railbus scene list").arg(far_flag(lang)))
        .subcommand(run)
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((verb, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let context = Context::of(lang, matches)?;
    if verb == "list" {
        let scenes = look(&context, async |backend| scenes(&context, backend).await)?;
        return out::result(lang, &records(lang, &scenes).render(context.format));
    }
    let name = matches.get_one::<String>("NAME").map(String::as_str);
    let name = name.unwrap_or_default();
    if matches.get_flag("dry-run") {
        let frames = look(&context, async |backend| {
            let scenes = scenes(&context, backend).await?;
            let scene = find(&context, &scenes, name)?;
            let runs = runs(scene);
            frames::show(&context, backend, runs.iter().map(Vec::as_slice)).await
        })?;
        return out::result(lang, &frames);
    }
    let confirm = matches.get_flag("yes");
    play(
        &context,
        name,
        SceneRequest {
            confirm,
            ..SceneRequest::default()
        },
    )
}

/// Asks the daemon or the site opened here, and changes nothing.
fn look<T>(
    context: &Context,
    question: impl AsyncFnOnce(&Backend) -> Result<T, Failure>,
) -> Result<T, Failure> {
    context.block(async {
        let mut stop = stop::Stop::new(context)?;
        let backend = context.open().await?;
        let answer = stop.or(question(&backend)).await;
        backend.finish(true).await;
        answer.ok_or_else(|| stop::interrupted(context))?
    })
}

async fn scenes(context: &Context, backend: &Backend) -> Result<Vec<SceneInfo>, Failure> {
    let scenes = backend.scenes().await;
    scenes.map_err(|problem| context.failure(&problem))
}

fn find<'s>(
    context: &Context,
    scenes: &'s [SceneInfo],
    name: &str,
) -> Result<&'s SceneInfo, Failure> {
    let found = scenes.iter().find(|scene| scene.scene == name);
    found.ok_or_else(|| {
        let known: Vec<&str> = scenes.iter().map(|scene| scene.scene.as_str()).collect();
        let problem = Problem::new(codes::NO_SUCH_SCENE).with("name", name);
        context.failure(&problem.with("known", known))
    })
}

/// The switching steps of a scene, grouped into commands: consecutive steps for outputs of one
/// module are one command if they are of the same kind.
fn runs(scene: &SceneInfo) -> Vec<Vec<Order>> {
    let mut runs: Vec<Vec<Order>> = Vec::new();
    let mut waited = true;
    for step in &scene.steps {
        let StepInfo::Set { path, value } = step else {
            waited = true;
            continue;
        };
        let state = if *value { State::On } else { State::Off };
        let Some(order) = Order::to(path, state) else {
            continue;
        };
        let same = |run: &&mut Vec<Order>| {
            let before = run.last();
            before.is_some_and(|last| last.module == order.module && last.state == order.state)
        };
        match runs.last_mut().filter(same).filter(|_| !waited) {
            Some(run) => run.push(order),
            None => runs.push(vec![order]),
        }
        waited = false;
    }
    runs
}

/// Runs it and waits for its end. After Ctrl-C the step in progress is finished.
fn play(context: &Context, name: &str, wanted: SceneRequest) -> Result<(), Failure> {
    let (answer, stopped) = context.block(async {
        let mut stop = stop::Stop::new(context)?;
        let backend = context.open().await?;
        let (answer, stopped) = {
            let work = backend.play(name, wanted);
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
    let outcomes = set::outcomes(context, answer);
    set::tell(context, &outcomes)?;
    set::conclude(context, outcomes, stopped)
}

fn records(lang: Lang, scenes: &[SceneInfo]) -> Records {
    let mut table = Table::new(lang.get(SceneText::Head).split('|')).names(1);
    let told = |step: &StepInfo| match step {
        StepInfo::Set { path, value } => format!("{path} {}", values::state(lang, *value)),
        StepInfo::Wait { wait_ms } => {
            let time = time::duration(lang, *wait_ms);
            lang.fill(SceneText::Wait, &[("time", &time)])
        }
    };
    for scene in scenes {
        let name = values::called(lang, &scene.name);
        let steps: Vec<String> = scene.steps.iter().map(told).collect();
        table.add([
            scene.scene.clone(),
            name,
            steps.join(lang.get(AppText::Comma)),
        ]);
    }
    Records {
        key: "scenes",
        rows: super::ls::json_of(scenes),
        columns: &["scene"],
        value: "scene",
        table,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_each_other_and_goes_the_same_way_is_one_command() {
        let set = |path: &str, value| StepInfo::Set {
            path: path.to_owned(),
            value,
        };
        let scene = SceneInfo {
            scene: "evening".to_owned(),
            name: Default::default(),
            steps: vec![
                set("yard.k1", true),
                set("yard.k2", true),
                set("yard.k3", false),
                set("oven.k1", false),
                StepInfo::Wait { wait_ms: 5 },
                set("oven.k2", false),
            ],
        };
        let paths = |run: &Vec<Order>| run.iter().map(Order::path).collect::<Vec<_>>();
        let told: Vec<_> = runs(&scene).iter().map(paths).collect();
        let wanted = [
            vec!["yard.k1", "yard.k2"],
            vec!["yard.k3"],
            vec!["oven.k1"],
            vec!["oven.k2"],
        ];
        assert_eq!(told, wanted);
    }
}
