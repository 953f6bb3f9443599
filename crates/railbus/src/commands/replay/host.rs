//! Plays back the host of a capture: sends its requests again and compares the replies.

use super::script::{PAUSE_MAX, Played, Script};
use super::{Allowed, ReplayText, faster};
use crate::commands::Context;
use crate::commands::own_line::OwnLine;
use crate::commands::place::Place;
use crate::commands::stop::{self, Stop};
use railbus_app::failure::Failure;
use railbus_app::frames::meaning;
use railbus_app::render::{out, records};
use railbus_commission::request;
use railbus_wire::{Exchange, REPLY_TIMEOUT, foreign_command};
use railbus_words::hex;
use serde_json::json;
use std::ops::ControlFlow;
use std::time::Duration;
use tokio::time::sleep;

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Same,
    Differs,
    /// It was answered in the capture, but not now.
    Silent,
    /// It is not allowed to be sent.
    Skipped,
}

/// The number of each outcome.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ends {
    pub(super) same: u64,
    pub(super) differ: u64,
    pub(super) skipped: u64,
}

/// Sends what is allowed, once or repeatedly.
pub(super) async fn play(
    context: &Context,
    place: &Place,
    script: &Script,
    pace: (f64, bool),
    allowed: Allowed,
) -> Result<Ends, Failure> {
    let mut stop = Stop::new(context)?;
    let mut line = OwnLine::open(context, place).await?;
    let played = play_on(context, &mut line, script, pace, allowed, &mut stop).await;
    line.close().await;
    played
}

async fn play_on(
    context: &Context,
    line: &mut OwnLine<'_>,
    script: &Script,
    (speed, round): (f64, bool),
    allowed: Allowed,
    stop: &mut Stop,
) -> Result<Ends, Failure> {
    let timeout = context.timeout.unwrap_or(REPLY_TIMEOUT);
    let mut ends = Ends::default();
    let protocols = script.protocols();
    loop {
        for played in &script.played {
            let pause = faster(played.pause.0.min(PAUSE_MAX.0), speed);
            let pause = Duration::from_micros(pause);
            if stop.or(sleep(pause)).await.is_none() {
                return Err(stop::interrupted(context));
            }
            // A request that the line's master can't send byte for byte is not sent.
            let exact = |asked: Exchange<'_>| request(asked.protocol(), &played.request);
            let exchange = played.exchange().and_then(exact);
            // A request that a module of another protocol would obey is never sent, whatever the
            // flags say.
            let clean = |asked: &Exchange<'_>| {
                let others = protocols.iter().copied();
                foreign_command(&played.request, asked.protocol(), others).is_none()
            };
            let sent = exchange.filter(|asked| allowed.covers(asked) && clean(asked));
            let (heard, end) = match sent {
                None => (Vec::new(), End::Skipped),
                Some(asked) => {
                    // A frame on the wire is not cut off: Ctrl-C waits for the reply.
                    let met = line.ask(asked, timeout).await?;
                    let end = compared(played, &met.bytes);
                    (met.bytes, end)
                }
            };
            match end {
                End::Same => ends.same += 1,
                End::Skipped => ends.skipped += 1,
                End::Differs | End::Silent => ends.differ += 1,
            }
            let text = shown(context, played, &heard, end);
            if let ControlFlow::Break(()) = out::put(context.lang, &text)? {
                return Ok(ends);
            }
        }
        if !round {
            return Ok(ends);
        }
    }
}

fn compared(played: &Played, heard: &[u8]) -> End {
    match &played.reply {
        Some(reply) if reply.bytes == heard => End::Same,
        None if heard.is_empty() => End::Same,
        Some(_) if heard.is_empty() => End::Silent,
        Some(_) | None => End::Differs,
    }
}

fn shown(context: &Context, played: &Played, heard: &[u8], end: End) -> String {
    let lang = context.lang;
    let asked = played.exchange();
    let meaning = asked.as_ref().map(|asked| meaning::request(lang, asked));
    let then = played.reply.as_ref().map(|reply| hex::spaced(&reply.bytes));
    if context.format.is_json() {
        return records::line(json!({
            "request": hex::spaced(&played.request),
            "meaning": meaning,
            "recorded": then,
            "reply": (!heard.is_empty()).then(|| hex::spaced(heard)),
            "result": match end {
                End::Same => "same",
                End::Differs => "differs",
                End::Silent => "silent",
                End::Skipped => "skipped",
            },
        }));
    }
    let now = hex::spaced(heard);
    let then = then.unwrap_or_else(|| lang.get(ReplayText::Silent).to_owned());
    let values: &[(&str, &dyn std::fmt::Display)] = &[("now", &now), ("then", &then)];
    let result = match end {
        End::Same => lang.fill(ReplayText::Same, values),
        End::Differs => lang.fill(ReplayText::Differs, values),
        End::Silent => lang.fill(ReplayText::NowSilent, values),
        End::Skipped => lang.get(ReplayText::Skipped).to_owned(),
    };
    let request = hex::spaced(&played.request);
    let meaning = meaning.unwrap_or_default();
    format!("{request}  {meaning}\n  {result}\n")
}
