//! Shows what a scan finds, to people and programs.

use super::options;
use super::run::{End, Report};
use super::texts::ScanText;
use crate::commands::Context;
use crate::commands::place::Place;
use railbus_app::failure::Failure;
use railbus_app::render::records::{self, Records};
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out};
use railbus_app::scan::{could_be, evidence, ranges};
use railbus_commission::scan::{
    Depth, Detail, FoundModule, LeftOut, ProbeKind, ScanOptions, Scanner, Verdict,
};
use railbus_device::Family;
use railbus_wire::Micros;
use railbus_words::Lang;
use railbus_words::{time, width};
use serde_json::{Value, json};
use std::fmt::Display;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;

/// The width of the progress bar.
const BAR: usize = 32;
/// The widths of the columns, from left to right.
const WIDTHS: [usize; 7] = [11, 9, 8, 10, 48, 8, 0];

/// Shows a scan while it runs.
#[derive(Debug)]
pub(super) struct Live<'c> {
    context: &'c Context,
    place: &'c Place,
    /// Prints each module as soon as it is found.
    streams: bool,
    /// Shows the progress: stderr is a terminal.
    bar: bool,
    headed: bool,
}

impl<'c> Live<'c> {
    pub(super) fn new(context: &'c Context, place: &'c Place, follow: bool) -> Live<'c> {
        Live {
            context,
            place,
            streams: follow || context.format == Format::Ndjson,
            bar: !context.quiet && std::io::stderr().is_terminal(),
            headed: false,
        }
    }

    /// Prints what will be scanned and how long it takes.
    pub(super) fn begin(&self, depth: Depth, scanner: &Scanner) {
        let lang = self.context.lang;
        let depth = lang.get(match depth {
            Depth::Quick => ScanText::QuickWord,
            Depth::Full => ScanText::FullWord,
            Depth::Deep => ScanText::DeepWord,
        });
        let time = about(lang, scanner.progress().left);
        let port = self.place.port.to_string();
        // A line that is only known from a flag is called by its port.
        let line = match self.place.line == port {
            true => port,
            false => format!("{}  {port}", self.place.line),
        };
        let values: &[(&str, &dyn Display)] = &[
            ("line", &line),
            ("settings", &self.place.settings),
            ("depth", &depth),
            ("time", &time),
        ];
        self.context.note(&lang.fill(ScanText::Begin, values));
    }

    /// Reports a module that was found.
    pub(super) fn found(&mut self, found: &FoundModule) -> Result<ControlFlow<()>, Failure> {
        if !self.streams {
            return Ok(ControlFlow::Continue(()));
        }
        self.clear();
        let lang = self.context.lang;
        let text = match self.context.format {
            Format::Json | Format::Ndjson => event(self.place, found),
            Format::Value => format!("{}\n", found.asked.address.0),
            Format::Csv => {
                let all = listed(lang, self.place, &[found], true).render(Format::Csv);
                let lines = all.split_inclusive('\n').skip(usize::from(self.headed));
                lines.collect()
            }
            Format::Table => {
                let head: Vec<String> = lang
                    .get(ScanText::SpeedHead)
                    .split('|')
                    .map(str::to_owned)
                    .collect();
                let head = if self.headed {
                    String::new()
                } else {
                    row_of(&head)
                };
                head + &row_of(&cells(lang, found, true))
            }
        };
        self.headed = true;
        out::put(lang, &text)
    }

    /// Shows the progress, over the line that showed it before.
    pub(super) fn progress(&self, scanner: &Scanner) {
        if !self.bar {
            return;
        }
        let progress = scanner.progress();
        let percent = progress.done * 100 / progress.total.max(1);
        let full = (progress.done * BAR / progress.total.max(1)).min(BAR);
        let bar = "█".repeat(full) + &"░".repeat(BAR - full);
        let left = about(self.context.lang, progress.left);
        let values: &[(&str, &dyn Display)] = &[
            ("bar", &bar),
            ("done", &progress.done),
            ("total", &progress.total),
            ("percent", &percent),
            ("found", &scanner.found().len()),
            ("left", &left),
        ];
        let text = self.context.lang.fill(ScanText::Progress, values);
        let _ = write!(std::io::stderr(), "\r  {text}\x1b[K");
    }

    /// Clears the progress.
    pub(super) fn clear(&self) {
        if self.bar {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }

    /// Prints everything found; with a stream, that was printed already.
    pub(super) fn end(&self, report: &Report, wish: &ScanOptions) -> Result<(), Failure> {
        let lang = self.context.lang;
        let mut found: Vec<&FoundModule> = report.scanner.found().iter().collect();
        let key = |found: &&FoundModule| (found.asked.settings.baud, found.asked.address.0);
        found.sort_by_key(|found| (key(found), found.protocol()));
        match self.context.format {
            Format::Ndjson => out::result(lang, &ended(self.place, report))?,
            Format::Json if self.streams => out::result(lang, &ended(self.place, report))?,
            Format::Json => {
                let rows: Vec<Value> = found.iter().map(|found| row(self.place, found)).collect();
                let mut all = summary(self.place, report);
                all["found"] = rows.into();
                out::result(lang, &records::line(all))?;
            }
            _ if self.streams => {}
            format => {
                let speeds = found
                    .iter()
                    .any(|found| found.asked.settings != self.place.settings);
                let records = listed(lang, self.place, &found, speeds);
                out::result(lang, &records.render(format))?;
            }
        }
        if !self.context.format.is_json() {
            self.sum_up(report, wish);
        }
        Ok(())
    }

    /// The result in words, and what to do next.
    fn sum_up(&self, report: &Report, wish: &ScanOptions) {
        let (lang, scanner) = (self.context.lang, &report.scanner);
        let found = scanner.found();
        let conflicts = conflicts(scanner);
        let state = lang.get(match report.end {
            End::Complete => ScanText::Complete,
            _ => ScanText::Incomplete,
        });
        let counts = scanner.counts();
        let values: &[(&str, &dyn Display)] = &[
            ("found", &found.len()),
            ("conflicts", &conflicts.len()),
            ("silent", &counts.silent),
            ("state", &state),
            ("time", &about(lang, report.took)),
        ];
        let note = |text: &str| self.context.note(text);
        note(&lang.fill(ScanText::Summary, values));
        let left = scanner.left_out();
        if !left.is_empty() {
            let mut what: Vec<String> = left.iter().map(|left| left_part(lang, left)).collect();
            // Modbus modules are looked for twice.
            what.dedup();
            note(&lang.fill(ScanText::LeftOut, &[("what", &what.join("; "))]));
        }
        let missing: Vec<&str> = scanner.missing().collect();
        if !missing.is_empty() {
            note(&lang.fill(ScanText::Missing, &[("names", &missing.join(", "))]));
        }
        if scanner.is_crowded() {
            note(lang.get(ScanText::Crowd));
        }
        if counts.skipped > 0 {
            note(&lang.fill(ScanText::Skipped, &[("count", &counts.skipped)]));
        }
        if scanner.is_slow() {
            let command = options::with_patience(self.context, wish);
            note(&lang.fill(ScanText::NextSlow, &[("command", &command)]));
        }
        if !matches!(report.end, End::Complete | End::Noise | End::Unread) {
            note(lang.get(ScanText::NextResume));
        }
        if found
            .iter()
            .any(|found| found.known.is_none() && found.identity.family.is_some())
        {
            note(lang.get(ScanText::NextAdd));
        }
        let unsure = found.iter().filter(|found| found.known.is_none());
        for (found, model) in unsure.filter_map(|found| Some((found, *could_be(found).first()?))) {
            let values: &[(&str, &dyn Display)] =
                &[("addr", &found.asked.address.0), ("model", &model)];
            note(&lang.fill(ScanText::NextModel, values));
        }
        let is_known = |addr: &u8| {
            let mut there = found.iter().filter(|found| found.asked.address.0 == *addr);
            there.any(|found| found.known.is_some())
        };
        // What to do about two configured modules depends on their model.
        let (known, new): (Vec<u8>, Vec<u8>) = conflicts.into_iter().partition(is_known);
        for addr in known {
            note(&lang.fill(ScanText::NextRecover, &[("addr", &addr)]));
        }
        if !new.is_empty() {
            note(&lang.fill(ScanText::NextPart, &[("addrs", &ranges(&new))]));
        }
    }
}

/// The addresses that more than one module may have, each once: they may answer in several
/// protocols.
fn conflicts(scanner: &Scanner) -> Vec<u8> {
    let found = scanner.found().iter().filter(|found| found.is_conflict());
    let mut addresses: Vec<u8> = found.map(|found| found.asked.address.0).collect();
    addresses.sort_unstable();
    addresses.dedup();
    addresses
}

/// A module as an event of the stream.
fn event(place: &Place, found: &FoundModule) -> String {
    let mut row = row(place, found);
    row["ev"] = "found".into();
    records::line(row)
}

/// The last event of the stream.
fn ended(place: &Place, report: &Report) -> String {
    let mut all = summary(place, report);
    all["ev"] = "end".into();
    all["found"] = report.scanner.found().len().into();
    records::line(all)
}

fn summary(place: &Place, report: &Report) -> Value {
    let (scanner, counts) = (&report.scanner, report.scanner.counts());
    let left_out: Vec<Value> = scanner.left_out().iter().map(left_out).collect();
    json!({
        "line": place.line,
        "probes": counts.probes,
        "silent": counts.silent,
        "skipped": counts.skipped,
        "conflicts": conflicts(scanner).len(),
        "missing": scanner.missing().collect::<Vec<_>>(),
        "slow": scanner.is_slow(),
        "complete": matches!(report.end, End::Complete),
        "left_out": left_out,
        "took_ms": report.took.0 / 1_000,
        "estimate_ms": report.estimate.0 / 1_000,
    })
}

fn left_out(left: &LeftOut) -> Value {
    json!({
        "baud": left.settings.baud.rate(),
        "format": left.settings.character.to_string(),
        "proto": left.ask.protocol().name(),
        "ask": left.ask.name(),
        "addresses": ranges(&left.addresses),
    })
}

fn row(place: &Place, found: &FoundModule) -> Value {
    let format = found.asked.settings.character.to_string();
    let mut row = json!({
        "line": place.line,
        "addr": found.asked.address.0,
        "proto": found.protocol().name(),
        "model": found.identity.model,
        "by_behaviour": found.identity.by_behaviour,
        "could_be": could_be(found),
        "baud": found.asked.settings.baud.rate(),
        "parity": format.chars().nth(1).map(|parity| parity.to_ascii_lowercase()),
        "format": format,
        "checksum": found.checksum(),
        "rtt_ms": (found.rtt.0 as f64 / 100.0).round() / 10.0,
        "verdict": found.verdict().name(),
        "module": found.known,
        "differs": found.differs,
        "evidence": evidence(found),
    });
    if let Some(says) = found.description() {
        row["says"] = says.into();
    }
    row
}

fn listed(lang: Lang, place: &Place, found: &[&FoundModule], speeds: bool) -> Records {
    let head = match speeds {
        true => ScanText::SpeedHead,
        false => ScanText::Head,
    };
    // Columns that may be dropped: round trip, detail, protocol. The speed is before them, if it is
    // shown.
    let spare: &'static [usize] = match speeds {
        true => &[5, 4, 2],
        false => &[4, 3, 1],
    };
    let mut table = Table::new(lang.get(head).split('|')).spare(spare);
    for found in found {
        table.add(cells(lang, found, speeds));
    }
    Records {
        key: "found",
        rows: found.iter().map(|found| row(place, found)).collect(),
        columns: &[
            "line", "addr", "proto", "model", "baud", "format", "rtt_ms", "verdict",
        ],
        value: "addr",
        table,
    }
}

/// The cells of a module's row.
fn cells(lang: Lang, found: &FoundModule, speeds: bool) -> Vec<String> {
    let model = found.identity.model.clone();
    let rtt = match found.answers.is_empty() {
        true => "–".to_owned(),
        false => time::duration(lang, found.rtt.0.div_ceil(1_000)),
    };
    let models: Vec<String> = found
        .identity
        .could_be
        .iter()
        .map(Family::to_string)
        .collect();
    let models = models.join(lang.of([", ", "、"]));
    let verdict = match found.verdict() {
        Verdict::Ok if found.identity.by_behaviour => ScanText::VerdictBehaves,
        Verdict::Ok => ScanText::VerdictOk,
        Verdict::CouldBe => ScanText::VerdictCouldBe,
        Verdict::Refused => ScanText::VerdictRefused,
        Verdict::Odd => ScanText::VerdictOdd,
        Verdict::Garbled => ScanText::VerdictGarbled,
    };
    let verdict = lang.fill(verdict, &[("models", &models)]);
    let speed = speeds.then(|| found.asked.settings.to_string());
    let rest = [
        found.asked.address.to_string(),
        found.protocol().name().to_owned(),
        model.unwrap_or_else(|| "?".to_owned()),
        detail(lang, found),
        rtt,
        verdict,
    ];
    speed.into_iter().chain(rest).collect()
}

fn detail(lang: Lang, found: &FoundModule) -> String {
    let checksum = found.checksum().map(|on| {
        lang.get(match on {
            true => ScanText::ChecksumOn,
            false => ScanText::ChecksumOff,
        })
    });
    let checksum = checksum.filter(|_| !found.answers.is_empty());
    let what = match found.detail() {
        Detail::None => None,
        Detail::Channels(outputs, inputs) => Some(lang.fill(
            ScanText::Channels,
            &[("outputs", &outputs), ("inputs", &inputs)],
        )),
        Detail::CoilsAt60 => Some(lang.get(ScanText::CoilsAt60).to_owned()),
        Detail::Version(version) => Some(lang.fill(ScanText::VersionIs, &[("version", &version)])),
        Detail::AtLeast(0) => Some(lang.get(ScanText::AllOff).to_owned()),
        Detail::AtLeast(count) => Some(lang.fill(ScanText::AtLeast, &[("count", &count)])),
        Detail::Spoilt { tries, differ } => {
            let text = if differ {
                ScanText::Differ
            } else {
                ScanText::Wrong
            };
            Some(lang.fill(text, &[("tries", &tries)]))
        }
        Detail::Twice => Some(lang.get(ScanText::Twice).to_owned()),
    };
    let known = found.known.as_ref().map(|name| {
        let text = match found.differs {
            true => ScanText::NotAsConfigured,
            false => ScanText::KnownAs,
        };
        lang.fill(text, &[("name", name)])
    });
    let says = found.description();
    let says = says.map(|text| lang.fill(ScanText::Says, &[("text", &text)]));
    let parts = [what, checksum.map(str::to_owned), says, known];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    parts.join(lang.of([", ", "，"]))
}

/// A row with fixed column widths: rows are printed before all of them are known.
fn row_of(cells: &[String]) -> String {
    let cells = cells.iter().zip(WIDTHS);
    let cells: Vec<String> = cells.map(|(cell, wide)| width::pad(cell, wide)).collect();
    cells.join("  ").trim_end().to_owned() + "\n"
}

fn left_part(lang: Lang, left: &LeftOut) -> String {
    let settings = left.settings;
    let proto = match left.ask {
        ProbeKind::AsciiName(true) => lang.get(ScanText::AsciiWithChecksum),
        ask => ask.protocol().name(),
    };
    let addresses = ranges(&left.addresses);
    let values: &[(&str, &dyn Display)] = &[
        ("settings", &settings),
        ("proto", &proto),
        ("addresses", &addresses),
    ];
    lang.fill(ScanText::LeftPart, values)
}

/// `8 s`, `1.5 s`, `7 min 3 s`
fn about(lang: Lang, time: Micros) -> String {
    let millis = time.0 / 1_000;
    let (minutes, seconds) = (millis / 60_000, millis / 1_000 % 60);
    match minutes {
        0 => time::duration(lang, millis),
        _ => format!(
            "{minutes} {} {seconds} {}",
            lang.of(["min", "分"]),
            lang.of(["s", "秒"])
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_told_in_minutes_and_seconds() {
        assert_eq!(about(Lang::En, Micros::from_secs(423)), "7 min 3 s");
    }
}
