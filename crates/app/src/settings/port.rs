//! A port opened exclusively: sends the requests of a procedure, and receives the replies.

use railbus_commission::{RxBytes, TimedExchange};
use railbus_host::{AnyPort, LineName, Medium, Port, PortError, PortHistory, SerialOptions};
use railbus_wire::{Frame, Instant, Micros, SerialSettings};
use std::time::Duration;
use tokio::time::{Instant as Moment, timeout_at};

/// After this long no late reply arrives any more.
const LATE: Duration = Duration::from_millis(500);
/// Babble is not listened to for ever.
const BYTES_MAX: usize = 600;

/// An exclusively opened port, and what is known about it.
#[derive(Debug)]
pub struct SettingsPort {
    port: AnyPort,
    started: Moment,
    /// Whether the adapter echoes; `None` while that is not known.
    echoes: Option<bool>,
    /// Until when a reply may arrive to a request of a killed process, or to one of ours that timed
    /// out.
    late_replies_until: Moment,
    has_asked: bool,
}

impl SettingsPort {
    /// Opens a port.
    ///
    /// # Errors
    /// Why it can't be opened.
    pub async fn open(
        name: &LineName,
        settings: SerialSettings,
    ) -> Result<SettingsPort, PortError> {
        let options = SerialOptions {
            settings,
            ..SerialOptions::default()
        };
        let mut port = AnyPort::new(name, options);
        port.open().await?;
        let started = Moment::now();
        let late = match port.past() {
            PortHistory::Abandoned => LATE,
            PortHistory::Rested | PortHistory::Unknown => Duration::ZERO,
        };
        Ok(SettingsPort {
            port,
            started,
            echoes: None,
            late_replies_until: started + late,
            has_asked: false,
        })
    }

    /// The time since the start.
    pub fn now(&self) -> Instant {
        let micros = self.started.elapsed().as_micros();
        Instant(u64::try_from(micros).unwrap_or(u64::MAX))
    }

    /// Whether the port can change its speed. A serial server keeps its own.
    pub fn follows(&self, from: SerialSettings, to: SerialSettings) -> bool {
        match (&self.port, self.port.medium()) {
            (AnyPort::Tcp(_) | AnyPort::ModbusTcp(_), _) => from == to,
            // A pseudo-terminal has a speed, and no parity.
            (AnyPort::Serial(_), Medium::Buffered) => from.character == to.character,
            (AnyPort::Serial(_), Medium::Wire) => true,
        }
    }

    /// Sends the request, and receives the reply.
    pub async fn ask(&mut self, ask: &TimedExchange) -> RxBytes {
        let lost = RxBytes {
            lost: true,
            ..RxBytes::default()
        };
        let mut frame = Frame::new();
        ask.exchange.encode(&mut frame);
        let sent = frame.bytes();
        let mut quiet = Moment::now() + micros(ask.quiet);
        if !self.has_asked {
            quiet = quiet.max(self.late_replies_until);
        }
        self.has_asked = true;
        let Ok(stray) = self.hear(quiet, |_| false).await else {
            return lost;
        };
        if self.port.send(sent, ask.settings).is_err() {
            return lost;
        }
        let sent_at = Moment::now();
        let end = sent_at + micros(ask.settings.frame_time(sent.len())) + micros(ask.timeout);
        let echoes = self.echoes;
        let is_whole = |heard: &[u8]| {
            let rest = without_echo(heard, sent, echoes);
            ask.exchange.find_response(rest).1.whole().is_some()
        };
        let Ok(heard) = self.hear(end, is_whole).await else {
            return lost;
        };
        let repeats = ask.exchange.decode_response(sent).whole().is_some();
        if !heard.is_empty() && !repeats {
            self.echoes = Some(heard.starts_with(sent));
        }
        if ask.exchange.expects_reply() && !is_whole(&heard) {
            self.late_replies_until = sent_at + LATE;
        }
        RxBytes {
            bytes: without_echo(&heard, sent, self.echoes).to_vec(),
            stray,
            lost: false,
        }
    }

    /// Waits until no request can be answered any more, so that neither the next request nor the
    /// next program to open the port gets a late reply.
    pub async fn settle(&mut self) {
        tokio::time::sleep_until(self.late_replies_until).await;
        self.port.settle();
    }

    /// Receives until the given time, or until enough has been received.
    async fn hear(
        &mut self,
        end: Moment,
        enough: impl Fn(&[u8]) -> bool,
    ) -> std::io::Result<Vec<u8>> {
        let mut heard = Vec::new();
        let mut buffer = [0; 256];
        while heard.len() < BYTES_MAX && !enough(&heard) {
            match timeout_at(end, self.port.read(&mut buffer)).await {
                Err(_) => break,
                Ok(count) => heard.extend_from_slice(buffer.get(..count?).unwrap_or_default()),
            }
        }
        Ok(heard)
    }
}

/// Some replies repeat the request: only if the adapter is known to echo, or if more follows, is
/// the first copy an echo.
fn without_echo<'h>(heard: &'h [u8], sent: &[u8], echoes: Option<bool>) -> &'h [u8] {
    match heard.strip_prefix(sent) {
        Some(rest) if echoes == Some(true) || !rest.is_empty() && echoes.is_none() => rest,
        _ => heard,
    }
}

const fn micros(micros: Micros) -> Duration {
    Duration::from_micros(micros.0)
}

#[cfg(test)]
mod tests {
    use super::without_echo;

    /// The acknowledgement of a setting repeats the request: on an adapter that echoes it arrives
    /// twice, and the first copy is the echo.
    #[test]
    fn an_echo_is_no_acknowledgement() {
        let sent = [1, 6, 0, 0, 0, 9];
        let twice = [sent, sent].concat();
        assert_eq!(
            without_echo(&sent, &sent, None),
            sent,
            "not known: it may be the reply"
        );
        assert_eq!(without_echo(&sent, &sent, Some(false)), sent);
        assert_eq!(without_echo(&sent, &sent, Some(true)), [0; 0]);
        assert_eq!(without_echo(&twice, &sent, Some(true)), sent);
        assert_eq!(without_echo(&twice, &sent, None), sent);
        assert_eq!(without_echo(&[7, 7], &sent, Some(true)), [7, 7]);
    }
}
