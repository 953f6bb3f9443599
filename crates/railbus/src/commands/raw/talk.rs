//! One frame out, whatever it is, and what comes back, on a line that nobody else has.

use super::Answer;
use crate::commands::Context;
use crate::commands::place::{Place, port_failure};
use crate::failure::Failure;
use railbus_host::{AnyPort, Port, PortError, SerialOptions};
use railbus_wire::Micros;
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// Silence that ends a reply; adapters hand it over in pieces.
const SILENCE: Duration = Duration::from_millis(50);
/// Silence before the frame: replies to someone's earlier request may still come.
const QUIET: Duration = Duration::from_millis(50);
/// Something that never stops talking is not listened to for ever.
const BYTES_MAX: usize = 600;

pub(super) async fn talk(
    context: &Context,
    place: &Place,
    frame: &[u8],
    timeout: Micros,
    silent: bool,
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
    hear(&mut port, Instant::now() + QUIET, QUIET, &[])
        .await
        .map_err(lost)?;
    port.send(frame, settings).map_err(lost)?;
    let sent = Instant::now() + micros(settings.frame_time(frame.len()));
    let patience = if silent { Micros::ZERO } else { timeout };
    let heard = hear(&mut port, sent + micros(patience), SILENCE, frame).await;
    let (bytes, last) = heard.map_err(lost)?;
    port.close();
    let after = last.saturating_duration_since(sent).as_millis();
    Ok(Answer {
        bytes: without_echo(bytes, frame),
        after_ms: u64::try_from(after).unwrap_or(u64::MAX),
    })
}

/// Hears until the first byte is overdue, or it has been silent for a while; says when the last
/// byte came. An echo of what was sent is not the reply that is waited for.
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

/// Some replies repeat the request: only where more follows is the first an echo.
fn without_echo(mut heard: Vec<u8>, sent: &[u8]) -> Vec<u8> {
    if heard.len() > sent.len() && heard.starts_with(sent) {
        heard.drain(..sent.len());
    }
    heard
}

const fn micros(micros: Micros) -> Duration {
    Duration::from_micros(micros.0)
}
