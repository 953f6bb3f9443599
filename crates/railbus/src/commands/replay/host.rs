//! The host of a capture: its requests are sent again, and what comes back is compared.

use super::script::{PAUSE_MAX, Played, Script};
use super::{Allowed, ReplayText, faster};
use crate::commands::Context;
use crate::commands::decode::meaning;
use crate::commands::place::{Place, port_failure};
use crate::commands::stop::{self, Stop};
use crate::failure::Failure;
use crate::render::{hex, out, records};
use railbus_host::{AnyPort, Port, PortError, SerialOptions};
use railbus_site::stowaway;
use railbus_wire::{Decoded, Exchange, Micros};
use serde_json::json;
use std::ops::ControlFlow;
use std::time::Duration;
use tokio::time::{Instant, sleep, timeout_at};

/// How long a reply may take to begin, unless the flags say otherwise.
const TIMEOUT: Micros = Micros::from_millis(300);
/// Silence that ends a reply which is no right one.
const SILENCE: Duration = Duration::from_millis(50);
/// The least silence before a request: what the slowest of the families wants.
const GAP_MIN: Duration = Duration::from_millis(20);
/// Something that never stops talking is not listened to for ever.
const BYTES_MAX: usize = 600;

/// What came of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Same,
    Differs,
    /// It was answered then and is not now.
    Silent,
    /// It may not be sent.
    Skipped,
}

/// How many of each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ends {
    pub(super) same: u64,
    pub(super) differ: u64,
    pub(super) skipped: u64,
}

/// Sends what is allowed, once or again and again.
pub(super) async fn play(
    context: &Context,
    place: &Place,
    script: &Script,
    (speed, round): (f64, bool),
    allowed: Allowed,
) -> Result<Ends, Failure> {
    let mut stop = Stop::new(context)?;
    let options = SerialOptions {
        settings: place.settings,
        ..SerialOptions::default()
    };
    let mut port = AnyPort::new(&place.port, options);
    let opened = port.open().await;
    opened.map_err(|error| port_failure(context, place, &error))?;
    let mut ends = Ends::default();
    let protocols = script.protocols();
    loop {
        for played in &script.played {
            let pause = faster(played.pause.0.min(PAUSE_MAX.0), speed);
            let pause = Duration::from_micros(pause).max(GAP_MIN);
            if stop.or(sleep(pause)).await.is_none() {
                return Err(stop::interrupted(context));
            }
            let exchange = played.exchange();
            // What a module of another protocol would obey is not sent, whatever was said.
            let clean = |asked: &Exchange<'_>| {
                stowaway(&played.request, asked.protocol(), &protocols).is_none()
            };
            let sent = exchange.filter(|asked| allowed.covers(asked) && clean(asked));
            let (heard, end) = match &sent {
                None => (Vec::new(), End::Skipped),
                Some(asked) => {
                    // A frame on the wire is not cut off: a stop waits for the reply.
                    let talk = talk(context, &mut port, place, played, asked);
                    let heard = talk.await.map_err(|error| {
                        port_failure(context, place, &PortError::of_loss(&error))
                    })?;
                    let end = compared(played, &heard);
                    (heard, end)
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
            port.close();
            return Ok(ends);
        }
    }
}

/// One exchange. What is left of an earlier one is thrown away first.
async fn talk(
    context: &Context,
    port: &mut AnyPort,
    place: &Place,
    played: &Played,
    asked: &Exchange<'_>,
) -> std::io::Result<Vec<u8>> {
    let mut buffer = [0; 256];
    while let Ok(left) = timeout_at(Instant::now(), port.read(&mut buffer)).await {
        left?;
    }
    port.send(&played.request, place.settings)?;
    if !asked.expects_reply() && played.reply.is_none() {
        return Ok(Vec::new());
    }
    let frame = place.settings.frame_time(played.request.len());
    let patience = frame + context.timeout.unwrap_or(TIMEOUT);
    let mut until = Instant::now() + Duration::from_micros(patience.0);
    let mut heard = Vec::new();
    while heard.len() < BYTES_MAX {
        let Ok(count) = timeout_at(until, port.read(&mut buffer)).await else {
            break;
        };
        heard.extend_from_slice(buffer.get(..count?).unwrap_or_default());
        until = Instant::now() + SILENCE;
        // Some replies repeat the request, as an echo does: only silence tells how many came.
        let echoes = heard.starts_with(&played.request);
        if let Decoded::Whole { len, .. } = asked.decode_response(&heard)
            && len == heard.len()
            && !echoes
        {
            break;
        }
    }
    if heard.len() > played.request.len() && heard.starts_with(&played.request) {
        heard.drain(..played.request.len());
    }
    Ok(heard)
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
