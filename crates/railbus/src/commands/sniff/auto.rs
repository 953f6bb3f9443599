//! Finds baud rate and parity by listening with each in turn, until bytes make frames.

use super::source::{Clock, Listening, Received};
use super::texts::SniffText;
use crate::commands::place::Place;
use crate::commands::{Context, stop};
use railbus_app::failure::Failure;
use railbus_app::frames::words;
use railbus_app::render::records;
use railbus_host::LineName;
use railbus_sniff::{FrameVerdict, Input, Listener, Output, SniffEvent};
use railbus_wire::{Baud, Character, Instant, Micros, Protocol, SerialSettings};
use railbus_words::Code;
use serde_json::json;

/// Baud rates, the most common ones first.
const BAUDS: [Baud; 8] = [
    Baud::B9600,
    Baud::B115200,
    Baud::B19200,
    Baud::B38400,
    Baud::B57600,
    Baud::B4800,
    Baud::B2400,
    Baud::B1200,
];
/// How long to listen with one setting, from the first byte on.
const DWELL: Micros = Micros::from_millis(700);
/// How long to wait for a first byte.
const QUIET_MAX: Micros = Micros::from_secs(10);
/// This many valid frames end a round early.
const ENOUGH: u64 = 8;
/// This many bytes before the first valid frame may be the rest of another frame.
const LEAD_MAX: u64 = 64;
/// With this many valid frames the result is certain, if hardly anything else was received.
const SURE: u64 = 5;

/// What was received with one baud rate and format.
#[derive(Clone, Copy, Debug)]
struct Round {
    settings: SerialSettings,
    /// Bytes received, and how many of them were in valid frames.
    heard: u64,
    good: u64,
    frames: u64,
    /// Bytes before the first valid frame: listening may have begun in the middle of one.
    lead: u64,
}

impl Round {
    /// The share of bytes in valid frames, in thousandths.
    fn share(&self) -> u64 {
        let whole = self.heard.saturating_sub(self.lead.min(LEAD_MAX));
        (self.good * 1_000 / whole.max(1)).min(1_000)
    }
}

/// Finds the settings of a line and prints how.
pub(super) async fn find(
    context: &Context,
    place: &Place,
    stop: &mut stop::Stop,
) -> Result<SerialSettings, Failure> {
    let clock = Clock::new();
    let start = clock.now();
    let mut rounds = Vec::new();
    for baud in BAUDS {
        let round = listen(context, place, (baud, Character::N1), clock, stop).await?;
        rounds.push(round);
        if round.frames >= SURE && round.share() >= 900 {
            break;
        }
    }
    let best = rounds
        .iter()
        .copied()
        .max_by_key(|round| (round.share(), round.frames));
    let Some(mut best) = best.filter(|best| best.frames > 0) else {
        let heard: u64 = rounds.iter().map(|round| round.heard).sum();
        let failure = Failure::of(context.lang, Code::NoSpeed);
        return Err(failure.with_fact("bytes", heard));
    };
    let parity = has_parity(&place.port);
    if parity {
        best = with_parity(context, place, best, clock, stop).await?;
    }
    let others = rounds
        .iter()
        .filter(|round| round.settings.baud != best.settings.baud);
    let next = others.copied().max_by_key(|round| round.good);
    tell(context, best, next, clock.now().since(start), parity);
    Ok(best.settings)
}

/// A receiver without parity accepts frames with parity; one with parity rejects frames without. So
/// receivers with parity are tried first.
async fn with_parity(
    context: &Context,
    place: &Place,
    plain: Round,
    clock: Clock,
    stop: &mut stop::Stop,
) -> Result<Round, Failure> {
    for character in [Character::E1, Character::O1] {
        let wanted = (plain.settings.baud, character);
        let round = listen(context, place, wanted, clock, stop).await?;
        if round.frames > 0 && round.share() + 100 >= plain.share() {
            return Ok(round);
        }
    }
    Ok(plain)
}

/// Pseudo-terminals and serial servers have no parity of their own.
fn has_parity(port: &LineName) -> bool {
    match port {
        LineName::Serial(path) => {
            let real = std::fs::canonicalize(path).unwrap_or_else(|_| path.clone());
            !real.starts_with("/dev/pts")
        }
        LineName::Pty(_) | LineName::Tcp { .. } | LineName::ModbusTcp { .. } => false,
    }
}

async fn listen(
    context: &Context,
    place: &Place,
    (baud, character): (Baud, Character),
    clock: Clock,
    stop: &mut stop::Stop,
) -> Result<Round, Failure> {
    let settings = SerialSettings { baud, character };
    let place = Place {
        settings,
        ..place.clone()
    };
    let values: &[(&str, &dyn std::fmt::Display)] = &[("settings", &settings)];
    if context.verbose > 0 {
        context.note(&context.lang.fill(SniffText::Trying, values));
    }
    let mut port = Listening::open(context, &place).await?;
    let mut round = Round {
        settings,
        heard: 0,
        good: 0,
        frames: 0,
        lead: 0,
    };
    let mut listener = Listener::new(settings);
    let mut end = clock.now() + QUIET_MAX;
    while round.frames < ENOUGH {
        let received = tokio::select! {
            () = stop.requested() => return Err(stop::interrupted(context)),
            () = tokio::time::sleep(clock.until(end)) => break,
            received = port.next(context, clock) => received?,
        };
        if let Received::Bytes(at, bytes) = received {
            if round.heard == 0 {
                end = at + DWELL;
            }
            round.heard += bytes.len() as u64;
            listener.handle(at, Input::Bytes(&bytes));
            count(&mut listener, &mut round);
        }
    }
    port.close();
    if round.heard == 0 {
        return Err(Failure::of(context.lang, Code::NothingHeard));
    }
    listener.handle(Instant(u64::MAX), Input::Silence);
    count(&mut listener, &mut round);
    Ok(round)
}

/// Counts only certain frames: ASCII without a checksum may be chance.
fn count(listener: &mut Listener, round: &mut Round) {
    while let Output::Heard(heard) = listener.poll() {
        let SniffEvent::Frame(frame) = heard else {
            continue;
        };
        let good = matches!(frame.verdict, FrameVerdict::Good | FrameVerdict::Refused);
        let weak = frame.bytes.len() < 4
            && frame
                .readings
                .first()
                .is_some_and(|r| r.protocol == Protocol::Ascii);
        if good && (!weak || frame.asked.is_some()) {
            round.good += frame.bytes.len() as u64;
            round.frames += 1;
        } else if round.frames == 0 {
            round.lead += frame.bytes.len() as u64;
        }
    }
}

fn tell(context: &Context, best: Round, next: Option<Round>, took: Micros, parity: bool) {
    let lang = context.lang;
    let sure = best.frames >= SURE && best.share() >= 900;
    let share = |round: &Round| format!("{}/{}", round.good, round.heard);
    if context.format.is_json() {
        let next = next.map(|next| json!({"baud": next.settings.baud.rate(), "valid": next.good}));
        context.note(
            records::line(json!({
                "event": "settings",
                "baud": best.settings.baud.rate(),
                "format": best.settings.character.to_string(),
                "heard": best.heard,
                "valid": best.good,
                "frames": best.frames,
                "next": next,
                "sure": sure,
            }))
            .trim_end(),
        );
        return;
    }
    let time = format!("{} ms", words::millis(took));
    let (other, name) = match &next {
        Some(next) => (share(next), next.settings.baud.to_string()),
        None => ("–".to_owned(), "–".to_owned()),
    };
    let mut text = lang.fill(
        SniffText::Found,
        &[
            ("settings", &best.settings),
            ("time", &time),
            ("good", &best.good),
            ("all", &best.heard),
            ("next", &name),
            ("other", &other),
        ],
    );
    let remarks = [
        Some(if sure {
            SniffText::Sure
        } else {
            SniffText::Likely
        }),
        (!parity).then_some(SniffText::NoParityHere),
        (parity && best.settings.character == Character::N1).then_some(SniffText::StopBits),
    ];
    for remark in remarks.into_iter().flatten() {
        text += lang.of(["; ", "；"]);
        text += lang.get(remark);
    }
    context.note(&text);
}
