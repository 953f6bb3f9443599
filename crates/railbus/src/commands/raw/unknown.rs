//! Bytes that are no request of any protocol. The line's master does not send them, since it can't
//! know what might answer. Their reply is not interpreted, and before and after, nothing is sent
//! for as long as a reply may be late.

use super::Answer;
use crate::commands::Context;
use crate::commands::place::{Place, port_failure};
use railbus_app::failure::Failure;
use railbus_host::{AnyPort, Port, PortError, PortHistory, SerialOptions};
use railbus_wire::Micros;
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// The silence that ends a reply; adapters deliver it in pieces.
const SILENCE: Duration = Duration::from_millis(50);
/// After this time no late reply can arrive.
const LATE: Duration = Duration::from_millis(500);
/// The most bytes that are read, should something never stop sending.
const BYTES_MAX: usize = 600;

/// Sends them, and returns what comes back.
pub(super) async fn ask(
    context: &Context,
    place: &Place,
    frame: &[u8],
    timeout: Micros,
) -> Result<Answer, Failure> {
    let settings = place.settings;
    let options = SerialOptions {
        settings,
        ..SerialOptions::default()
    };
    let mut port = AnyPort::new(&place.port, options);
    let failed = |error: &PortError| port_failure(context, place, error);
    let lost = |error: std::io::Error| failed(&PortError::of_loss(&error));
    port.open().await.map_err(|error| failed(&error))?;
    if port.past() != PortHistory::Rested {
        let quiet = Instant::now() + LATE;
        hear(&mut port, quiet, LATE, &[]).await.map_err(lost)?;
    }
    // From here on they may have acted, whatever they are.
    let lost = |error| lost(error).perhaps_acted(true);
    port.send(frame, settings).map_err(lost)?;
    let sent = Instant::now() + micros(settings.frame_time(frame.len()));
    let heard = hear(&mut port, sent + micros(timeout), SILENCE, frame).await;
    let (bytes, last) = heard.map_err(lost)?;
    // What arrives now is no reply, and must not reach the next program that opens the port.
    let rest = hear(&mut port, sent + LATE, Duration::ZERO, &[]).await;
    rest.map_err(lost)?;
    port.close();
    let after = last.saturating_duration_since(sent).as_millis();
    Ok(Answer {
        bytes: without_echo(bytes, frame),
        after_ms: u64::try_from(after).unwrap_or(u64::MAX),
        outcome: None,
    })
}

/// Receives until the first byte is overdue, or until it has been silent for a while; returns when
/// the last byte came. An echo of the request does not count as the reply.
async fn hear(
    port: &mut AnyPort,
    deadline: Instant,
    silence: Duration,
    echo: &[u8],
) -> std::io::Result<(Vec<u8>, Instant)> {
    let mut heard = Vec::new();
    let mut last = Instant::now();
    let mut until = deadline;
    let mut buffer = [0; 256];
    while heard.len() < BYTES_MAX {
        match timeout_at(until, port.read(&mut buffer)).await {
            Err(_) => break,
            Ok(count) => {
                heard.extend_from_slice(buffer.get(..count?).unwrap_or_default());
                last = Instant::now();
                until = last + silence;
                if heard == echo {
                    until = until.max(deadline);
                }
            }
        }
    }
    Ok((heard, last))
}

/// Removes the echo: if more follows than what was sent, the first bytes are an echo. Alone they
/// may be a reply.
fn without_echo(mut heard: Vec<u8>, sent: &[u8]) -> Vec<u8> {
    if heard.len() > sent.len() && heard.starts_with(sent) {
        heard.drain(..sent.len());
    }
    heard
}

const fn micros(micros: Micros) -> Duration {
    Duration::from_micros(micros.0)
}
