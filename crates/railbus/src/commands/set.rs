//! `railbus set`: switches outputs.

mod boards;
pub(super) mod frames;
mod group;
pub(super) mod orders;

use super::context::{FAR, far_flag};
use super::{Context, stop};
use crate::args;
use crate::backend::Backend;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command};
pub(super) use group::outcomes;
use orders::{Order, State};
use railbus_api::types::{Kind, OutputsRequest, ToggleRequest, WriteRequest, Written};
use railbus_app::failure::Failure;
use railbus_app::render::records::{self, Records};
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, values};
use railbus_app::texts::AppText;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use serde_json::{Value, json};

/// The name of the command.
pub(crate) const NAME: &str = "set";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus set TARGET STATE | set MODULE POINT=STATE…";
    args::verb(lang, NAME, Text::SetAbout, usage)
        .alias("write")
        .before_help(args::examples(lang, Text::SetExamples))
        .arg(far_flag(lang))
        .arg(
            Arg::new("TARGET")
                .help(lang.get(Text::SetTargets))
                .num_args(1..)
                .required_unless_present("all-boards"),
        )
        .arg(
            args::flag(lang, "all-boards", Text::AllBoards)
                .value_name("STATE")
                .value_parser(["on", "off"])
                .hide_possible_values(true)
                .conflicts_with_all(["TARGET", FAR]),
        )
        .arg(args::flag(lang, "confirm", Text::Confirm).value_name("WORD"))
        .arg(
            args::flag(lang, "dry-run", Text::DryRun)
                .short('n')
                .action(ArgAction::SetTrue),
        )
        .arg(args::flag(lang, "no-verify", Text::NoVerify).action(ArgAction::SetTrue))
        .arg(args::flag(lang, "yes", Text::MeantYes).action(ArgAction::SetTrue))
}

/// The options of a switching command.
#[derive(Clone, Copy)]
struct Terms {
    verify: bool,
    confirm: bool,
}

/// The outcome for one output.
pub(super) struct Outcome {
    path: String,
    end: Result<Written, Failure>,
}

/// Switches the outputs, module by module.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    if matches.contains_id("all-boards") {
        return boards::run(&context, matches);
    }
    let words = super::get::selected(matches);
    let terms = Terms {
        verify: !matches.get_flag("no-verify"),
        confirm: matches.get_flag("yes"),
    };
    if words.first().is_some_and(|word| word.starts_with('@')) {
        return group::run(&context, &words, terms, matches.get_flag("dry-run"));
    }
    let dry = matches.get_flag("dry-run");
    let outcomes = context.block(async {
        let mut stop = stop::Stop::new(&context)?;
        let asked = orders::parse(&words).map_err(|word| bad_word(lang, &word))?;
        let backend = context.open().await?;
        let orders = match resolve(&context, &backend, asked).await {
            Ok(orders) => orders,
            Err(failure) => {
                backend.finish(true).await;
                return Err(failure);
            }
        };
        if dry {
            let groups = orders.chunk_by(|a, b| a.module == b.module);
            let frames = frames::show(&context, &backend, groups).await;
            backend.finish(true).await;
            return frames.map(Err);
        }
        let outcomes = carry_out(&context, &backend, &orders, terms, &mut stop).await;
        backend.finish(true).await;
        Ok(Ok(outcomes))
    })?;
    match outcomes {
        Err(frames) => out::result(lang, &frames),
        Ok((outcomes, stopped)) => {
            tell(&context, &outcomes)?;
            conclude(&context, outcomes, stopped)
        }
    }
}

fn bad_word(lang: Lang, word: &str) -> Failure {
    Failure::of(lang, Code::Usage)
        .because(lang.fill(Text::BadOrder, &[("word", &word)]))
        .with_try("railbus set pump.do0 on")
        .with_try("railbus set yard k1=on k3=off")
}

/// Resolves patterns, numbers and `all` to the paths of outputs, which needs the list of points.
async fn resolve(
    context: &Context,
    backend: &Backend,
    asked: Vec<Order>,
) -> Result<Vec<Order>, Failure> {
    let mut resolved = Vec::new();
    for order in asked {
        let Some(selector) = order.needs() else {
            resolved.push(order);
            continue;
        };
        let points = backend.points(&[selector], false).await;
        let points = points.map_err(|problem| context.failure(&problem))?;
        let outputs = points.iter().filter(|point| point.kind == Kind::Output);
        let before = resolved.len();
        resolved.extend(outputs.filter_map(|point| order.of(point)));
        if resolved.len() == before {
            let failure = Failure::of(context.lang, Code::NoPoint);
            return Err(failure.because(order.path()));
        }
    }
    Ok(resolved)
}

/// Switches outputs in the given order, consecutive ones of one module together. After Ctrl-C the
/// command in progress is finished, and no other is started.
async fn carry_out(
    context: &Context,
    backend: &Backend,
    orders: &[Order],
    terms: Terms,
    stop: &mut stop::Stop,
) -> (Vec<Outcome>, bool) {
    let mut outcomes = Vec::new();
    let together = |a: &Order, b: &Order| {
        let plain = |order: &Order| order.state != State::Toggle;
        a.module == b.module && plain(a) && plain(b)
    };
    for group in orders.chunk_by(together) {
        let work = switch(context, backend, group, terms);
        tokio::pin!(work);
        let stopped = stop.or(&mut work).await.map_or_else(
            || true,
            |done| {
                outcomes.extend(done);
                false
            },
        );
        if stopped {
            outcomes.extend(work.await);
            return (outcomes, true);
        }
    }
    (outcomes, false)
}

async fn switch(
    context: &Context,
    backend: &Backend,
    group: &[Order],
    terms: Terms,
) -> Vec<Outcome> {
    if let [order] = group {
        let path = order.path();
        let written = match order.state {
            State::Toggle => {
                let wanted = ToggleRequest {
                    confirm: terms.confirm,
                    ..ToggleRequest::default()
                };
                backend.toggle(&path, wanted).await
            }
            state => {
                let wanted = WriteRequest {
                    verify: terms.verify,
                    confirm: terms.confirm,
                    ..WriteRequest::to(state == State::On)
                };
                backend.write(&path, wanted).await
            }
        };
        let end = written.map_err(|problem| context.failure(&problem));
        return vec![Outcome { path, end }];
    }
    let module = group
        .first()
        .map(|order| order.module.clone())
        .unwrap_or_default();
    let set = group
        .iter()
        .map(|order| (order.point.clone(), order.state == State::On));
    let wanted = OutputsRequest {
        set: set.collect(),
        verify: terms.verify,
        no_reply: false,
        confirm: terms.confirm,
        within_ms: None,
    };
    let written = backend.outputs(&module, wanted).await;
    let each = |order: &Order| Outcome {
        path: order.path(),
        end: match &written {
            Err(problem) => Err(context.failure(problem)),
            Ok(all) => {
                let one = all.set.get(&order.point);
                Ok(Written {
                    value: one.and_then(|one| one.value),
                    before: one.and_then(|one| one.before),
                    confirmed: all.confirmed,
                    took_ms: all.took_ms,
                    audit: all.audit.clone(),
                    read_then_set: false,
                })
            }
        },
    };
    group.iter().map(each).collect()
}

pub(super) fn tell(context: &Context, outcomes: &[Outcome]) -> Result<(), Failure> {
    let lang = context.lang;
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for outcome in outcomes {
        let mut row = json!({ "path": outcome.path });
        match &outcome.end {
            Ok(written) => {
                table.add(cells(lang, &outcome.path, written));
                merge(&mut row, serde_json::to_value(written).unwrap_or_default());
            }
            Err(failure) if outcomes.len() > 1 => {
                let told = format!("{}  {}", failure.code().name(), failure.message());
                let perhaps = failure
                    .may_have_acted()
                    .then(|| lang.get(AppText::MayHaveActed));
                let perhaps = perhaps.unwrap_or_default().to_owned();
                table.add([outcome.path.clone(), told, perhaps]);
                let error = match context.format {
                    Format::Csv => json!(failure.code().name()),
                    _ => failure.to_json(lang),
                };
                merge(&mut row, json!({ "error": error }));
            }
            // A single failure is reported as it is.
            Err(_) => return Ok(()),
        }
        rows.push(row);
    }
    let records = Records {
        key: "set",
        rows,
        columns: &["path", "value", "before", "confirmed", "took_ms", "error"],
        value: "value",
        table,
    };
    if context.quiet && context.format == Format::Table {
        return Ok(());
    }
    out::result(lang, &records.render(context.format))
}

fn cells(lang: Lang, path: &str, written: &Written) -> Vec<String> {
    let word = |state: Option<bool>| state.map_or("?", |on| values::state(lang, on));
    let change = match written.value {
        None => word(None).to_owned(),
        Some(value) => match written.before {
            Some(before) => format!("{} → {}", word(Some(before)), word(Some(value))),
            None => format!("→ {}", word(Some(value))),
        },
    };
    let mut cells = vec![
        path.to_owned(),
        change,
        values::confirmed(lang, written.confirmed).to_owned(),
        time::duration(lang, written.took_ms),
    ];
    if written.read_then_set {
        cells.push(lang.get(Text::ReadThenSet).to_owned());
    }
    cells
}

/// Adds the keys of one object to another.
fn merge(row: &mut Value, more: Value) {
    if let (Value::Object(row), Value::Object(more)) = (row, more) {
        row.extend(more);
    }
}

/// The failure that follows from the outcomes.
pub(super) fn conclude(
    context: &Context,
    outcomes: Vec<Outcome>,
    stopped: bool,
) -> Result<(), Failure> {
    let count = outcomes.len();
    let mut perhaps = Vec::new();
    let mut failures = Vec::new();
    for outcome in outcomes {
        let Err(failure) = outcome.end else { continue };
        if failure.may_have_acted() {
            perhaps.push(outcome.path);
        }
        failures.push(failure);
    }
    let failed = failures.len();
    if stopped {
        return Err(stop::interrupted(context).perhaps_acted_on(perhaps));
    }
    let same = failures.windows(2).all(|pair| match pair {
        [a, b] => a.code() == b.code(),
        _ => true,
    });
    match failures.into_iter().next() {
        None => Ok(()),
        Some(first) if count == 1 => Err(first),
        Some(first) if failed == count && same => Err(first.perhaps_acted_on(perhaps)),
        Some(first) => {
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("failed", &failed), ("count", &count)];
            let message = context.lang.fill(Text::SomeFailed, values);
            let told = format!("{} {}", first.code().name(), first.message());
            Err(Failure::new(Code::Partial, message)
                .because(told)
                .with_fact("failed", failed)
                .with_fact("count", count)
                .perhaps_acted_on(perhaps))
        }
    }
}

/// The same as CSV with these columns.
pub(super) fn rows(columns: &[&str], path: &str, written: impl serde::Serialize) -> String {
    let mut row = json!({ "path": path });
    merge(&mut row, serde_json::to_value(written).unwrap_or_default());
    columns.join(",") + "\n" + &records::csv(&row, columns)
}

/// One document of a stream, for the pulse command.
pub(super) fn document(path: &str, written: impl serde::Serialize) -> String {
    let mut row = json!({ "path": path });
    merge(&mut row, serde_json::to_value(written).unwrap_or_default());
    records::line(row)
}
