//! `railbus outlet`: the integrations of the daemon: how they do, a test, and where each point
//! stands at the other side.

mod texts;

use super::Context;
use crate::args;
use crate::backend::DaemonClient;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use hyper::Method;
use railbus_api::outlets::{OutletInfo, OutletMap, OutletTest};
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_app::render::csv::csv;
use railbus_app::render::records::{self, Records};
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_words::Lang;
use serde_json::{Value, json};
use texts::OutletText;

/// The name of the command.
pub(crate) const NAME: &str = "outlet";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let verb = |name, about, usage| {
        let examples = args::examples(lang, OutletText::Examples);
        args::verb(lang, name, about, usage).before_help(examples)
    };
    let name = || {
        let help = lang.get(OutletText::Name);
        Arg::new("NAME").required(true).help(help)
    };
    let map = verb(
        "map",
        OutletText::Map,
        "railbus outlet map NAME [-o csv|json]",
    );
    let test = verb("test", OutletText::Test, "railbus outlet test NAME");
    verb(NAME, OutletText::About, "railbus outlet COMMAND")
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand(verb("list", OutletText::List, "railbus outlet list"))
        .subcommand(map.arg(name()))
        .subcommand(test.arg(name()))
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((verb, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let context = Context::of(lang, matches)?;
    let named = matches.try_get_one::<String>("NAME").ok().flatten();
    let name = named.map(String::as_str).unwrap_or_default();
    match verb {
        "list" => {
            let outlets = ask(&context, async |daemon| daemon.outlets().await)?;
            out::result(lang, &list(lang, &outlets).render(context.format))
        }
        "map" => map(&context, name),
        _ => test(&context, name),
    }
}

/// Asks the daemon: outlets run nowhere else.
fn ask<T>(
    context: &Context,
    question: impl AsyncFnOnce(&DaemonClient) -> Result<T, Problem>,
) -> Result<T, Failure> {
    context.block(async {
        let none = || Problem::new(codes::DAEMON).with_hint("railbus serve");
        let daemon = context.daemon().await?;
        let daemon = daemon.ok_or_else(|| context.failure(&none()))?;
        let answer = question(&daemon).await;
        answer.map_err(|problem| context.failure(&problem))
    })
}

/// The outlet of this name; `KIND/NAME` where two kinds have one.
async fn find(daemon: &DaemonClient, name: &str) -> Result<OutletInfo, Problem> {
    let all = daemon.outlets().await?;
    let whole = |one: &OutletInfo| format!("{}/{}", one.kind, one.outlet);
    let is_it = |one: &&OutletInfo| one.outlet == name || whole(one) == name;
    let mut found = all.iter().filter(is_it);
    let one = match (found.next(), found.next()) {
        (Some(one), None) => Some(one.clone()),
        _ => None,
    };
    one.ok_or_else(|| {
        let known: Vec<String> = all.iter().map(whole).collect();
        let problem = Problem::new(codes::NO_SUCH_OUTLET).with("name", name);
        problem
            .with("known", known)
            .with_hint("railbus outlet list")
    })
}

fn list(lang: Lang, outlets: &[OutletInfo]) -> Records {
    let mut table = Table::new(lang.get(OutletText::Head).split('|'));
    for one in outlets {
        let state = match one.enabled {
            true => OutletText::state(one.state),
            false => OutletText::Off,
        };
        let failing = one.last_error.as_ref().filter(|_| one.failures > 0);
        let clients = one.clients.map(|clients| clients.to_string());
        table.add([
            one.outlet.clone(),
            one.kind.clone(),
            lang.get(state).to_owned(),
            clients.unwrap_or_else(|| "–".to_owned()),
            one.sent.to_string(),
            one.failed.to_string(),
            failing.map_or_else(|| "–".to_owned(), |error| error.problem.code.clone()),
        ]);
    }
    Records {
        key: "outlets",
        rows: super::ls::json_of(outlets),
        columns: &[
            "outlet", "kind", "state", "clients", "sent", "failed", "since",
        ],
        value: "outlet",
        table,
    }
}

fn map(context: &Context, name: &str) -> Result<(), Failure> {
    let lang = context.lang;
    let map: OutletMap = ask(context, async |daemon| {
        let one = find(daemon, name).await?;
        daemon.outlet_map(&one.kind, &one.outlet, lang).await
    })?;
    let titles = map.columns.iter().map(|column| match lang {
        Lang::En => column.en.as_str(),
        Lang::Zh => column.zh.as_str(),
    });
    let text = match context.format {
        Format::Table => {
            let mut table = Table::new(titles);
            for row in map.rows {
                table.add(row);
            }
            table.render()
        }
        Format::Csv | Format::Value => {
            let lines = std::iter::once(titles.map(str::to_owned).collect());
            let lines = lines.chain(map.rows).map(|row: Vec<String>| {
                let cells: Vec<&str> = row.iter().map(String::as_str).collect();
                csv(&cells)
            });
            lines.collect::<String>().replace("\r\n", "\n")
        }
        Format::Json | Format::Ndjson => records::line(json!({
            "outlet": name,
            "columns": map.columns,
            "rows": map.rows,
        })),
    };
    out::result(lang, &text)
}

fn test(context: &Context, name: &str) -> Result<(), Failure> {
    let lang = context.lang;
    let test: OutletTest = ask(context, async |daemon| {
        let one = find(daemon, name).await?;
        let path = ["outlets", &one.kind, &one.outlet, "test"];
        let told = daemon.request(Method::POST, &path, &json!({})).await?;
        let read = serde_json::from_value(told);
        read.map_err(|error| Problem::new(codes::DAEMON).with("reason", error.to_string()))
    })?;
    if let Some(problem) = test.error {
        return Err(context.failure(&problem));
    }
    let answer = test.answer.unwrap_or_default();
    let text = match context.format {
        Format::Table => {
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("name", &name), ("answer", &answer), ("ms", &test.took_ms)];
            lang.fill(OutletText::Works, values) + "\n"
        }
        _ => records::line(Value::from_iter([
            ("outlet", json!(name)),
            ("answer", json!(answer)),
            ("took_ms", json!(test.took_ms)),
        ])),
    };
    out::result(lang, &text)
}
