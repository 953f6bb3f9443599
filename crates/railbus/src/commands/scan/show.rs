//! What a scan found, for people and programs.

use super::plan::Ask;
use super::run::{Found, Report, Verdict};
use crate::commands::Context;
use crate::commands::place::Place;
use crate::failure::Failure;
use crate::i18n::Lang;
use crate::render::records::{self, Records};
use crate::render::table::Table;
use crate::render::{Format, hex, out};
use crate::texts::Text;
use railbus_wire::{Frame, Protocol};
use serde_json::{Value, json};
use std::io::{IsTerminal, Write};

/// One module, as an event of a stream.
pub(super) fn event(place: &Place, found: &Found) -> String {
    records::line(row(place, found))
}

fn row(place: &Place, found: &Found) -> Value {
    let evidence: Vec<String> = found
        .evidence
        .iter()
        .map(|(ask, bytes)| {
            let mut frame = Frame::new();
            if let Some(exchange) = ask.exchange(found.address) {
                exchange.encode(&mut frame);
            }
            format!("{} → {}", text(*ask, frame.bytes()), text(*ask, bytes))
        })
        .collect();
    json!({
        "ev": "found",
        "line": place.line,
        "addr": found.address.0,
        "proto": found.protocol.name(),
        "model": found.identity.model,
        "by_behaviour": found.identity.by_behaviour,
        "baud": place.settings.baud.rate(),
        "format": place.settings.character.to_string(),
        "checksum": (found.protocol == Protocol::Ascii).then_some(found.checksum),
        "rtt_ms": (found.rtt.0 as f64 / 100.0).round() / 10.0,
        "verdict": found.verdict.name(),
        "evidence": evidence,
    })
}

/// ASCII frames as they are, others in hexadecimal.
fn text(ask: Ask, bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return "–".to_owned();
    }
    match ask.protocol() {
        Protocol::Ascii => String::from_utf8_lossy(bytes).trim_end().to_owned(),
        _ => hex::spaced(bytes),
    }
}

/// Everything found; what streams has told it already.
pub(super) fn result(context: &Context, place: &Place, report: &Report) -> Result<(), Failure> {
    let lang = context.lang;
    if !context.quiet && std::io::stderr().is_terminal() {
        let _ = write!(std::io::stderr(), "\r\x1b[K");
    }
    match context.format {
        Format::Ndjson => out::result(
            lang,
            &records::line(json!({
                "ev": "end", "line": place.line, "found": report.found.len(),
                "probes": report.probes, "skipped": report.skipped, "complete": report.complete,
            })),
        ),
        Format::Json => out::result(
            lang,
            &records::line(json!({
                "line": place.line,
                "found": report.found.iter().map(|found| row(place, found)).collect::<Vec<_>>(),
                "probes": report.probes,
                "skipped": report.skipped,
                "complete": report.complete,
            })),
        ),
        format => {
            let records = records(lang, place, report);
            out::result(lang, &records.render(format))?;
            let (count, port) = (report.found.len(), &place.port);
            let values: &[(&str, &dyn std::fmt::Display)] = &[
                ("count", &count),
                ("silent", &report.silent),
                ("port", port),
                ("settings", &place.settings),
            ];
            context.note(&lang.fill(Text::ScanSummary, values));
            Ok(())
        }
    }
}

fn records(lang: Lang, place: &Place, report: &Report) -> Records {
    let mut table = Table::new(lang.get(Text::ScanHead).split('|'));
    for found in &report.found {
        let model = found
            .identity
            .model
            .clone()
            .unwrap_or_else(|| "?".to_owned());
        let detail = match (found.protocol, found.checksum) {
            (Protocol::Ascii, true) => lang.get(Text::ChecksumOn),
            (Protocol::Ascii, false) => lang.get(Text::ChecksumOff),
            _ if found.identity.by_behaviour => lang.get(Text::ByBehaviour),
            _ => "",
        };
        let verdict = lang.get(match found.verdict {
            Verdict::Ok => Text::VerdictOk,
            Verdict::Refused => Text::VerdictRefused,
            Verdict::Odd => Text::VerdictOdd,
            Verdict::Garbled => Text::VerdictGarbled,
        });
        table.add([
            found.address.to_string(),
            found.protocol.name().to_owned(),
            model,
            detail.to_owned(),
            format!("{} ms", found.rtt.0.div_ceil(1_000)),
            verdict.to_owned(),
        ]);
    }
    Records {
        key: "found",
        rows: report.found.iter().map(|found| row(place, found)).collect(),
        columns: &[
            "line", "addr", "proto", "model", "baud", "format", "rtt_ms", "verdict",
        ],
        value: "addr",
        table,
    }
}

/// How far the scan is, over the line that said so before.
pub(super) fn progress(lang: Lang, done: usize, total: usize, found: usize) {
    let values: &[(&str, &dyn std::fmt::Display)] =
        &[("done", &done), ("total", &total), ("found", &found)];
    let text = lang.fill(Text::ScanProgress, values);
    let _ = write!(std::io::stderr(), "\r{text}\x1b[K");
}
