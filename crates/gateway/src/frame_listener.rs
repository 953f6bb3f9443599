//! The daemon's view of the traffic of a line, frame by frame.

use railbus_app::api::ask;
use railbus_app::frames::Named;
use railbus_host::{PIECE_PAUSE, TapFrame};
use railbus_site::Service;
use railbus_sniff::{Input, Listener, Output, SniffEvent};
use railbus_wire::{Instant, SerialSettings};
use std::time::Duration;
use tokio::time::sleep_until;

/// The modules that frames may belong to.
pub(super) fn modules(service: &Service, line: &str) -> Vec<Named> {
    let modules = ask::modules(service).into_iter();
    let here = modules.filter(|module| module.line == line);
    here.filter_map(Named::of).collect()
}

/// Finds the frames in the traffic.
pub(super) struct FrameListener {
    listener: Listener,
    settings: SerialSettings,
    /// When the line's clock started, in microseconds since 1970.
    start: u64,
    /// The same moment on tokio's clock.
    began: tokio::time::Instant,
    at: u64,
}

impl FrameListener {
    pub(super) fn new(start: u64, settings: SerialSettings) -> FrameListener {
        let epoch = u64::try_from(jiff::Timestamp::now().as_microsecond());
        FrameListener {
            listener: Listener::new(settings).with_silence(PIECE_PAUSE),
            settings,
            start,
            began: tokio::time::Instant::now(),
            at: epoch.unwrap_or_default(),
        }
    }

    fn now(&self) -> Instant {
        let passed = u64::try_from(self.began.elapsed().as_micros()).unwrap_or_default();
        Instant(self.at.saturating_add(passed))
    }

    /// Sleeps until then; for ever if nothing is due.
    pub(super) async fn until(&self, due: Option<Instant>) {
        match due {
            Some(due) => {
                let left = Duration::from_micros(due.since(self.now()).0);
                sleep_until(tokio::time::Instant::now() + left).await;
            }
            None => std::future::pending().await,
        }
    }

    /// Handles the deadline that has come.
    pub(super) fn timeout(&mut self) {
        self.listener.handle(self.now(), Input::Timeout);
    }

    /// Takes the frames found so far; returns the next deadline.
    pub(super) fn hear(&mut self, heard: &mut Vec<SniffEvent>) -> Option<Instant> {
        loop {
            match self.listener.poll() {
                Output::Wait(due) => return due,
                Output::Heard(one) => heard.push(one),
            }
        }
    }

    /// Handles traffic, after every timeout that was due before it.
    pub(super) fn take(&mut self, passed: &TapFrame, heard: &mut Vec<SniffEvent>) {
        let at = Instant(self.start.saturating_add(passed.at.0));
        let time = self.settings.frame_time(passed.bytes.len());
        // Sent bytes are time-stamped when written to the port, received ones when they have ended.
        let (begins, ends) = match passed.sent {
            Some(settings) => (at, at + settings.frame_time(passed.bytes.len())),
            None => (Instant(at.0.saturating_sub(time.0)), at),
        };
        while let Some(due) = self.hear(heard)
            && due <= begins
        {
            self.listener.handle(due, Input::Timeout);
        }
        let input = match passed.sent {
            Some(_) => Input::Sent(&passed.bytes),
            None => Input::Bytes(&passed.bytes),
        };
        self.listener.handle(ends, input);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_sniff::FrameVerdict;

    /// The line master accepts such a reply, so the list of frames must not call it incomplete.
    #[tokio::test]
    async fn a_reply_that_the_line_takes_in_pieces_is_one_frame() {
        let settings = SerialSettings::FACTORY;
        let passed = |at: u64, sent: bool, bytes: &[u8]| TapFrame {
            at: Instant(at),
            sent: sent.then_some(settings),
            bytes: bytes.into(),
        };
        let mut listener = FrameListener::new(1_000_000, settings);
        let mut heard = Vec::new();
        listener.take(&passed(0, true, b"$016\r"), &mut heard);
        listener.take(&passed(20_000, false, b"!0302"), &mut heard);
        listener.take(&passed(68_000, false, b"00\r"), &mut heard);
        listener.hear(&mut heard);
        let verdicts: Vec<_> = heard
            .iter()
            .map(|heard| match heard {
                SniffEvent::Frame(frame) => Some(frame.verdict),
                _ => None,
            })
            .collect();
        assert_eq!(
            verdicts,
            [Some(FrameVerdict::Good), Some(FrameVerdict::Good)],
            "{heard:?}"
        );
    }
}
