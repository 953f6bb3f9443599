//! A command line for each Modbus module, to be tried without railbus.

use super::texts::ExportText;
use crate::commands::Context;
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_device::{Module, Setup};
use railbus_host::LineName;
use railbus_site::Config;
use railbus_wire::{Character, Exchange, rtu};
use serde_json::json;

/// Prints them, and what is left out.
pub(super) fn print(context: &Context, config: &Config) -> Result<(), Failure> {
    let (lang, (records, left_out)) = (context.lang, mbpoll(config));
    out::result(lang, &records.render(context.format))?;
    if !left_out.is_empty() {
        let modules = left_out.join(" ");
        context.note(&lang.fill(ExportText::LeftOut, &[("modules", &modules)]));
    }
    Ok(())
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
