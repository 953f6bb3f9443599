//! Plays back the modules of a capture: answers requests as they were answered then.

use super::script::{PAUSE_MAX, Reply, Script};
use super::{ReplayText, faster};
use crate::commands::Context;
use crate::commands::place::{Place, port_failure};
use crate::commands::sniff::{Clock, millis};
use crate::commands::stop::{self, Stop};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_host::{AnyPort, Port, PortError, SerialOptions};
use railbus_sniff::{FrameRole, Input, Listener, Output, SniffEvent};
use railbus_wire::Instant;
use railbus_words::hex;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Duration;

/// The replies to one request, in order, and which is next.
#[derive(Debug, Default)]
struct Answers {
    all: Vec<Option<Reply>>,
    next: usize,
}

impl Answers {
    /// The next reply; after the last one the last again, or the first with `round`.
    fn take(&mut self, round: bool) -> Option<Reply> {
        let answer = self.all.get(self.next).cloned().flatten();
        let last = self.next + 1 >= self.all.len();
        self.next = match (last, round) {
            (false, _) => self.next + 1,
            (true, true) => 0,
            (true, false) => self.next,
        };
        answer
    }
}

/// Replies until it is stopped, or has answered `count` requests.
pub(super) async fn play(
    context: &Context,
    place: &Place,
    script: &Script,
    (speed, round, count): (f64, bool, Option<u64>),
) -> Result<(), Failure> {
    let mut answers: BTreeMap<&[u8], Answers> = BTreeMap::new();
    for played in &script.played {
        let known = answers.entry(&played.request).or_default();
        known.all.push(played.reply.clone());
    }
    let mut stop = Stop::new(context)?;
    let options = SerialOptions {
        settings: place.settings,
        ..SerialOptions::default()
    };
    let mut port = AnyPort::new(&place.port, options);
    let failed = |error: &PortError| port_failure(context, place, error);
    let lost = |error: std::io::Error| failed(&PortError::of_loss(&error));
    port.open().await.map_err(|error| failed(&error))?;
    let values: &[(&str, &dyn std::fmt::Display)] =
        &[("count", &answers.len()), ("port", &place.port)];
    context.note(&context.lang.fill(ReplayText::Answering, values));
    let clock = Clock::new();
    let mut listener = Listener::new(place.settings);
    let mut buffer = vec![0; 4_096];
    let mut left = count;
    loop {
        let due = loop {
            match listener.poll() {
                Output::Wait(due) => break due,
                Output::Heard(SniffEvent::Missing(_)) => {}
                Output::Heard(SniffEvent::Frame(frame)) => {
                    let asked = frame.readings.first().and_then(|reading| reading.role);
                    if asked != Some(FrameRole::Request) {
                        continue;
                    }
                    let known = answers.get_mut(frame.bytes.as_slice());
                    let reply = known.and_then(|answers| answers.take(round));
                    if let Some(reply) = &reply {
                        let wait = faster(reply.after.0.min(PAUSE_MAX.0), speed);
                        // Counted from the end of the request, which is some time ago already.
                        let at = Instant(frame.end.0.saturating_add(wait));
                        tokio::time::sleep(clock.until(at)).await;
                        port.send(&reply.bytes, place.settings).map_err(lost)?;
                        listener.handle(clock.now(), Input::Bytes(&reply.bytes));
                    }
                    let text = shown(context, &frame.bytes, reply.as_ref());
                    if let ControlFlow::Break(()) = out::put(context.lang, &text)? {
                        return Ok(());
                    }
                    if let Some(left) = &mut left {
                        *left -= 1;
                        if *left == 0 {
                            return Ok(());
                        }
                    }
                }
            }
        };
        let due = due.map_or(Duration::from_secs(3_600), |due| clock.until(due));
        tokio::select! {
            biased;
            () = stop.requested() => return Err(stop::interrupted(context)),
            count = port.read(&mut buffer) => {
                let bytes = buffer.get(..count.map_err(lost)?).unwrap_or_default();
                listener.handle(clock.now(), Input::Bytes(bytes));
            }
            () = tokio::time::sleep(due) => listener.handle(clock.now(), Input::Timeout),
        }
    }
}

fn shown(context: &Context, request: &[u8], reply: Option<&Reply>) -> String {
    if context.format.is_json() {
        return railbus_app::render::records::line(serde_json::json!({
            "request": hex::spaced(request),
            "reply": reply.map(|reply| hex::spaced(&reply.bytes)),
            "after_ms": reply.map(|reply| reply.after.0 as f64 / 1_000.0),
        }));
    }
    let answer = match reply {
        Some(reply) => format!("{}  {} ms", hex::spaced(&reply.bytes), millis(reply.after)),
        None => context.lang.get(ReplayText::Silent).to_owned(),
    };
    format!("{}  →  {answer}\n", hex::spaced(request))
}
