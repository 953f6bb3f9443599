//! Shows the traffic line by line, and totals at the end.

use super::texts::SniffText;
use jiff::tz::TimeZone;
use railbus_app::frames::words;
use railbus_app::frames::{Facts, addressee, as_json, at, timestamp};
use railbus_app::render::{Format, records};
use railbus_sniff::{FrameRole, FrameVerdict, Reading, SniffEvent};
use railbus_wire::{Instant, Micros, SerialSettings};
use railbus_words::Lang;
use railbus_words::{hex, time, width};

/// The widths of the columns except the last, which needs none.
const WIDTHS: [usize; 6] = [12, 7, 3, 8, 4, 44];

/// The heading of an output format, if it has one.
pub(in crate::commands) fn head(lang: Lang, format: Format) -> String {
    match format {
        Format::Table => row(lang.get(SniffText::Head).split('|').map(str::to_owned)),
        Format::Csv => "time,line,gap_ms,role,protocol,address,verdict,meaning,bytes\n".to_owned(),
        Format::Json | Format::Ndjson | Format::Value => String::new(),
    }
}

/// One line of output.
pub(in crate::commands) fn line(
    lang: Lang,
    format: Format,
    line: &str,
    heard: &SniffEvent,
    facts: &Facts<'_>,
) -> String {
    match format {
        Format::Table => table(lang, heard, facts),
        Format::Json | Format::Ndjson => records::line(as_json(lang, line, heard, facts)),
        Format::Csv => {
            let json = as_json(lang, line, heard, facts);
            records::csv(&json, &CSV)
        }
        Format::Value => match heard {
            SniffEvent::Frame(frame) => format!("{}\n", hex::spaced(&frame.bytes)),
            SniffEvent::Missing(_) => String::new(),
        },
    }
}

const CSV: [&str; 9] = [
    "time", "line", "gap_ms", "role", "protocol", "address", "verdict", "meaning", "bytes",
];

fn row(cells: impl IntoIterator<Item = String>) -> String {
    let mut text = String::new();
    for (index, cell) in cells.into_iter().enumerate() {
        match WIDTHS.get(index) {
            Some(width) => text += &(width::pad(&cell, *width) + "  "),
            None => text += &cell,
        }
    }
    format!("{}\n", text.trim_end())
}

fn table(lang: Lang, heard: &SniffEvent, facts: &Facts<'_>) -> String {
    let clock = time::clock(&timestamp(at(heard)).to_zoned(TimeZone::system()));
    let gap = match heard {
        SniffEvent::Missing(missing) => Some(missing.after),
        SniffEvent::Frame(frame) => frame.gap,
    };
    let gap = gap.map(words::millis).unwrap_or_default();
    let direction = match (heard, facts.role) {
        (SniffEvent::Missing(_), _) => "–",
        (_, Some(FrameRole::Request)) => "→",
        (_, Some(FrameRole::Reply)) => "←",
        (_, None) => "?",
    };
    let protocol = facts.protocols.first();
    let protocol = protocol.map_or("–".to_owned(), ToString::to_string);
    let address = facts.address.map_or("–".to_owned(), |a| a.to_string());
    let mut meaning = words::of(lang, heard);
    if let Some(module) = facts.module {
        meaning = format!("{module}: {meaning}");
    }
    let bytes = match heard {
        SniffEvent::Frame(frame) => readable(&frame.bytes, frame.readings.first()),
        SniffEvent::Missing(_) => String::new(),
    };
    let cells = [clock, format!("{gap:>7}"), direction.to_owned(), protocol];
    row(cells
        .into_iter()
        .chain([format!("{address:>4}"), meaning, bytes]))
}

/// ASCII frames as text, all others as hexadecimal digits.
fn readable(bytes: &[u8], reading: Option<&Reading>) -> String {
    let is_ascii = reading.is_some_and(|r| r.protocol == railbus_wire::Protocol::Ascii);
    if !is_ascii {
        return hex::spaced(bytes);
    }
    let text = bytes.iter().map(|byte| match byte {
        b'\r' => "<CR>".to_owned(),
        b' '..=b'~' => char::from(*byte).to_string(),
        other => format!("<{other:02X}>"),
    });
    text.collect()
}

/// The totals.
#[derive(Debug, Default)]
pub(in crate::commands) struct Sums {
    frames: u64,
    exchanges: u64,
    missing: u64,
    bad: u64,
    busy: Micros,
    span: Option<(Instant, Instant)>,
    slowest: Option<(Micros, Option<u8>)>,
}

impl Sums {
    pub(in crate::commands) fn add(&mut self, heard: &SniffEvent, settings: SerialSettings) {
        match heard {
            SniffEvent::Missing(_) => self.missing += 1,
            SniffEvent::Frame(frame) => {
                self.frames += 1;
                self.bad += u64::from(matches!(frame.verdict, FrameVerdict::Bad(_)));
                self.busy += settings.frame_time(frame.bytes.len());
                let first = self.span.map_or(frame.at, |(first, _)| first);
                self.span = Some((first, frame.end));
                if let (Some(asked), Some(after)) = (&frame.asked, frame.after) {
                    self.exchanges += 1;
                    if self.slowest.is_none_or(|(slowest, _)| after > slowest) {
                        self.slowest = Some((after, addressee(asked)));
                    }
                }
            }
        }
    }

    /// Whether nothing was received at all.
    pub(in crate::commands) const fn is_empty(&self) -> bool {
        self.frames == 0 && self.missing == 0
    }

    pub(in crate::commands) fn told(&self, lang: Lang) -> String {
        let span = self.span.map_or(0, |(first, last)| last.since(first).0);
        let busy = 100.0 * self.busy.0 as f64 / span.max(1) as f64;
        let busy = format!("{:.1}", busy.min(100.0));
        let mut text = lang.fill(
            SniffText::Summary,
            &[
                ("frames", &self.frames),
                ("exchanges", &self.exchanges),
                ("missing", &self.missing),
                ("bad", &self.bad),
                ("busy", &busy),
            ],
        );
        if let Some((time, Some(address))) = self.slowest {
            let time = words::millis(time);
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("address", &address), ("time", &time)];
            text += lang.of(["; ", "；"]);
            text += &lang.fill(SniffText::Slowest, values);
        }
        text
    }
}
