//! `railbus export`: the configuration in forms for other tools.

mod texts;

use super::Context;
use crate::args;
use clap::{Arg, ArgMatches, Command};
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_device::{Module, Setup};
use railbus_host::LineName;
use railbus_site::Config;
use railbus_site::config::ModuleConfig;
use railbus_wire::{Character, Exchange, rtu};
use railbus_words::Lang;
use serde_json::{Value, json};
use texts::ExportText;

/// The name of the command.
pub(crate) const NAME: &str = "export";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, ExportText::About, "railbus export mbpoll|csv")
        .before_help(args::examples(lang, ExportText::Examples))
        .arg(
            Arg::new("FORM")
                .help(lang.get(ExportText::Form))
                .value_parser(["mbpoll", "csv"])
                .hide_possible_values(true)
                .required(true),
        )
}

/// Prints it.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let (path, _) = context.config()?;
    let found = config_file::read(lang, Some(&path));
    let config = found.map_err(|problem| context.failure(&problem))?.config;
    match matches.get_one::<String>("FORM").map(String::as_str) {
        Some("csv") => {
            // The name of the export says its format; only JSON can be chosen instead.
            let format = match context.format {
                format if format.is_json() => format,
                _ => Format::Csv,
            };
            out::result(lang, &points(&config).render(format))
        }
        _ => {
            let (records, left_out) = mbpoll(&config);
            out::result(lang, &records.render(context.format))?;
            if !left_out.is_empty() {
                let modules = left_out.join(" ");
                context.note(&lang.fill(ExportText::LeftOut, &[("modules", &modules)]));
            }
            Ok(())
        }
    }
}

/// Every point, one per line.
fn points(config: &Config) -> Records {
    let of_module = |(name, module): (&String, &ModuleConfig)| {
        let (setup, port) = (module.setup, config.lines.get(&module.line));
        let port = port.map_or("", |line| line.port.as_str());
        let row = |point| {
            let (prefix, number) = setup.label(point);
            let label = format!("{prefix}{number}");
            let about = module.points.get(&point);
            json!({
                "point": format!("{name}.{label}"), "module": name, "label": label,
                "index": point.index, "line": module.line, "port": port,
                "model": setup.family.name(), "address": setup.address.0,
                "protocol": setup.protocol.name(), "baud": setup.serial.baud.rate(),
                "format": setup.serial.character.to_string(),
                "name_en": about.and_then(|about| about.name_en.clone()),
                "name_zh": about.and_then(|about| about.name_zh.clone()),
            })
        };
        setup.points().map(row).collect::<Vec<Value>>()
    };
    Records {
        key: "points",
        rows: config.modules.iter().flat_map(of_module).collect(),
        columns: &[
            "point", "module", "label", "index", "line", "port", "model", "address", "protocol",
            "baud", "format", "name_en", "name_zh",
        ],
        value: "point",
        table: Table::bare(),
    }
}

/// An mbpoll command line for each read of a Modbus module, and the modules that mbpoll can't talk
/// to.
fn mbpoll(config: &Config) -> (Records, Vec<&str>) {
    let (mut rows, mut left_out) = (Vec::new(), Vec::new());
    for (name, module) in &config.modules {
        let port = config
            .lines
            .get(&module.line)
            .and_then(|line| line.port.parse().ok());
        let how = port.and_then(|port| how(&port, &module.setup));
        let reads = reads(&module.setup);
        let Some(how) = how.filter(|_| !reads.is_empty()) else {
            left_out.push(name.as_str());
            continue;
        };
        let address = module.setup.address.0;
        for (table, start, count) in reads {
            let what = format!("-a {address} -t {table} -0 -r {start} -c {count}");
            let line = format!("mbpoll {} {what} -1 {}", how.0, how.1);
            rows.push(json!({ "module": name, "command": line }));
        }
    }
    let mut table = Table::bare();
    for row in &rows {
        table.add([row["command"].as_str().unwrap_or_default().to_owned()]);
    }
    let records = Records {
        key: "commands",
        rows,
        columns: &["module", "command"],
        value: "command",
        table,
    };
    (records, left_out)
}

/// mbpoll's options for mode, settings and port; none if mbpoll has no such line.
fn how(port: &LineName, setup: &Setup) -> Option<(String, String)> {
    let baud = setup.serial.baud.rate();
    let (parity, stop) = match setup.serial.character {
        Character::N1 => ("none", 1),
        Character::E1 => ("even", 1),
        Character::O1 => ("odd", 1),
        Character::N2 => ("none", 2),
    };
    match port {
        LineName::Serial(path) | LineName::Pty(path) => Some((
            format!("-m rtu -b {baud} -P {parity} -s {stop}"),
            path.display().to_string(),
        )),
        LineName::ModbusTcp { host, port } => Some((format!("-m tcp -p {port}"), host.clone())),
        LineName::Tcp { .. } => None,
    }
}

/// The reads of a Modbus module as mbpoll numbers tables: which table, first reference, count.
fn reads(setup: &Setup) -> Vec<(u8, u16, u16)> {
    let Ok(module) = Module::new(*setup) else {
        return Vec::new();
    };
    let read = |op| match module.exchange(&op).ok()? {
        Exchange::Rtu(exchange) => match exchange.request {
            rtu::Request::ReadCoils(span) => Some((0, span.start(), span.count())),
            rtu::Request::ReadDiscreteInputs(span) => Some((1, span.start(), span.count())),
            rtu::Request::ReadInputRegisters(span) => Some((3, span.start(), span.count())),
            rtu::Request::ReadHoldingRegisters(span) => Some((4, span.start(), span.count())),
            _ => None,
        },
        _ => None,
    };
    module.full_poll().filter_map(read).collect()
}
