//! `railbus bench`: how many reads per second a line can do, and what the time is spent on. It only
//! reads.

mod texts;

use super::doctor::{Chosen, chosen_lines};
use super::place::{self, Place, port_failure};
use super::{Context, stop};
use crate::args;
use crate::backend::Backend;
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, records};
use railbus_host::{Line, LineOptions, Module, ModuleId, Op, Plan, PortError, Terms};
use railbus_site::config::wire_time;
use railbus_wire::Micros;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::width;
use serde_json::{Value, json};
use std::fmt::Display;
use std::time::Instant;
use texts::BenchText;

/// The name of the command.
pub(crate) const NAME: &str = "bench";

/// How long it measures by default.
const TIME: Micros = Micros::from_secs(10);
/// The most reads of one module that are recorded: an hour at the highest rate that a line allows.
const READS_MAX: usize = 1_000_000;

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(
        lang,
        NAME,
        BenchText::About,
        "railbus bench [-l LINE] [--time TIME]",
    )
    .before_help(args::examples(lang, BenchText::Examples))
    .arg(
        args::flag(lang, "time", BenchText::Time)
            .value_name("TIME")
            .value_parser(super::context::duration),
    )
}

/// The measurements of one module.
struct Tally {
    id: ModuleId,
    module: String,
    protocol: &'static str,
    op: Op,
    wire: Micros,
    took: Vec<Micros>,
    bad: u64,
}

/// Reads the modules in turn for a time, or until Ctrl-C, and prints the result.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let time = matches.get_one("time").copied().unwrap_or(TIME);
    context.block(not_served(&context))?;
    let line = line(&context)?;
    let (tallies, lasted) = context.block(async {
        let mut stop = stop::Stop::new(&context)?;
        measure(&context, &line, time, &mut stop).await
    })?;
    out::result(lang, &shown(&context, &line, &tallies, lasted))?;
    if tallies.iter().all(|tally| tally.took.is_empty()) {
        return Err(Failure::of(lang, Code::NoReply).with_fact("line", line.name));
    }
    Ok(())
}

/// Refuses a line that a daemon has. It is not borrowed: its outputs would be uncontrolled in
/// the meantime, and running pulses and leases would end.
async fn not_served(context: &Context) -> Result<(), Failure> {
    if context.options.ad_hoc.is_some() {
        return Ok(());
    }
    let Some(daemon) = context.daemon().await? else {
        return Ok(());
    };
    let lang = context.lang;
    let site = daemon.name(lang);
    let place = place::of(context, &Backend::Daemon(daemon)).await?;
    let busy = port_failure(context, &place, &PortError::Busy { holder: None });
    let why = lang.fill(BenchText::Daemon, &[("site", &site)]);
    Err(busy.because(why).with_try("railbus ls lines"))
}

/// The one line to measure, and its modules.
fn line(context: &Context) -> Result<Chosen, Failure> {
    let mut lines = chosen_lines(context)?;
    lines.retain(|line| !line.modules.is_empty());
    if lines.len() > 1 {
        let failure = Failure::of(context.lang, Code::NoLine).because("-l");
        return Err(lines.iter().fold(failure, |failure, line| {
            failure.with_try(format!("railbus bench -l {}", line.name))
        }));
    }
    lines.pop().ok_or_else(|| {
        let failure = Failure::of(context.lang, Code::NoModule);
        failure.with_try("railbus bench -l /dev/ttyUSB0 -m erc8 -a 3")
    })
}

async fn measure(
    context: &Context,
    line: &Chosen,
    time: Micros,
    stop: &mut stop::Stop,
) -> Result<(Vec<Tally>, f64), Failure> {
    let mut config = LineOptions::new(line.port.clone());
    config.bus = line.bus;
    for (_, module, plan) in &line.modules {
        config = config.with(module.clone(), *plan);
    }
    let place = Place {
        line: line.name.clone(),
        port: line.port.clone(),
        settings: line.settings,
        echo: line.bus.echo,
    };
    let failed = |error| port_failure(context, &place, &error);
    let handle = Line::open(config).map_err(failed)?;
    if let Err(error) = handle.opened().await {
        handle.close().await;
        return Err(failed(error));
    }
    let mut tallies: Vec<Tally> = line.modules.iter().enumerate().filter_map(tally).collect();
    // The first reads wait until the line has settled, and find out whether there is an echo.
    for tally in &tallies {
        let _ = handle.run(tally.id, tally.op, Terms::default()).await;
    }
    let begun = Instant::now();
    let mut left = true;
    while left {
        for tally in &mut tallies {
            let Some(end) = stop
                .or(handle.run(tally.id, tally.op, Terms::default()))
                .await
            else {
                left = false;
                break;
            };
            match end {
                Ok(done) if tally.took.len() < READS_MAX => tally.took.push(done.took),
                Ok(_) => {}
                Err(_) => tally.bad += 1,
            }
        }
        left &= begun.elapsed().as_micros() < u128::from(time.0);
    }
    let lasted = begun.elapsed().as_secs_f64();
    handle.close().await;
    for tally in &mut tallies {
        tally.took.sort();
    }
    Ok((tallies, lasted))
}

fn tally((index, (name, module, _)): (usize, &(String, Module, Plan))) -> Option<Tally> {
    let op = module.full_poll().next()?;
    Some(Tally {
        id: ModuleId(index),
        module: name.clone(),
        protocol: module.setup().protocol.name(),
        wire: wire_time(module, &op)?,
        op,
        took: Vec::new(),
        bad: 0,
    })
}

impl Tally {
    /// The time below which so many hundredths of the reads stayed, in milliseconds.
    fn percentile(&self, hundredths: usize) -> Option<f64> {
        let at = (self.took.len().checked_sub(1)?) * hundredths / 100;
        self.took.get(at).map(|took| millis(*took))
    }

    fn json(&self) -> Value {
        json!({
            "module": self.module, "protocol": self.protocol, "n": self.took.len(),
            "p50_ms": self.percentile(50), "p99_ms": self.percentile(99),
            "max_ms": self.percentile(100), "wire_ms": millis(self.wire), "bad": self.bad,
        })
    }
}

fn millis(time: Micros) -> f64 {
    // In tenths.
    (time.0 as f64 / 100.0).round() / 10.0
}

fn shown(context: &Context, line: &Chosen, tallies: &[Tally], lasted: f64) -> String {
    let lang = context.lang;
    let reads: usize = tallies.iter().map(|tally| tally.took.len()).sum();
    let wire: f64 = tallies
        .iter()
        .map(|t| t.wire.0 as f64 * t.took.len() as f64)
        .sum();
    let round: f64 = tallies.iter().map(|tally| tally.wire.0 as f64).sum();
    let rate = reads as f64 / lasted.max(1e-6);
    let theory = tallies.len() as f64 * 1e6 / round.max(1.0);
    let busy = wire / 1e4 / lasted.max(1e-6);
    let rows: Vec<Value> = tallies.iter().map(Tally::json).collect();
    let mut table = Table::new(lang.get(BenchText::Head).split('|'));
    for tally in tallies {
        let ms = |time: Option<f64>| time.map_or("–".to_owned(), |time| format!("{time:.1} ms"));
        table.add([
            tally.module.clone(),
            tally.protocol.to_owned(),
            tally.took.len().to_string(),
            ms(tally.percentile(50)),
            ms(tally.percentile(99)),
            ms(tally.percentile(100)),
            ms(Some(millis(tally.wire))),
            tally.bad.to_string(),
        ]);
    }
    let one = |number: f64| (number * 10.0).round() / 10.0;
    match context.format {
        Format::Table => {
            let (rate, theory, busy) = (one(rate), one(theory), busy.round());
            let values: &[(&str, &dyn Display)] = &[
                ("line", &line.name),
                ("rate", &rate),
                ("busy", &busy),
                ("theory", &theory),
                ("settings", &line.settings),
            ];
            let head = lang.fill(BenchText::Summary, values);
            format!("{head}\n{}", table.render_within(width::terminal()))
        }
        Format::Json => records::line(json!({
            "line": line.name, "seconds": one(lasted), "reads_per_s": one(rate),
            "theory_per_s": one(theory), "busy_percent": one(busy), "modules": rows,
        })),
        format => {
            let records = records::Records {
                key: "modules",
                rows,
                columns: &[
                    "module", "protocol", "n", "p50_ms", "p99_ms", "max_ms", "wire_ms", "bad",
                ],
                value: "p50_ms",
                table,
            };
            records.render(format)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_sorted_times() {
        let took: Vec<Micros> = (1..=100).map(|ms| Micros(ms * 1_000)).collect();
        let tally = |took| Tally {
            id: ModuleId(0),
            module: "oven".to_owned(),
            protocol: "rtu",
            op: Op::ReadOutputs,
            wire: Micros(28_230),
            took,
            bad: 0,
        };
        let full = tally(took);
        assert_eq!(
            [50, 99, 100].map(|p| full.percentile(p)),
            [50.0, 99.0, 100.0].map(Some)
        );
        assert_eq!(tally(Vec::new()).percentile(50), None);
        assert_eq!(millis(Micros(28_230)), 28.2);
    }
}
