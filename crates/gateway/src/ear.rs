//! The daemon's own ear on a line: what passes, frame by frame.

use railbus_app::api::ask;
use railbus_app::frames::Named;
use railbus_host::{PIECE_PAUSE, TapFrame};
use railbus_site::Service;
use railbus_sniff::{Heard, Input, Listener, Output};
use railbus_wire::{Instant, Settings};
use std::time::Duration;
use tokio::time::sleep_until;

/// The modules that frames may be of.
pub(super) fn modules(service: &Service, line: &str) -> Vec<Named> {
    let modules = ask::modules(service).into_iter();
    let here = modules.filter(|module| module.line == line);
    here.filter_map(Named::of).collect()
}

/// Finds the frames in what passes.
pub(super) struct Ear {
    listener: Listener,
    settings: Settings,
    /// When the line's time began, in microseconds since 1970.
    start: u64,
    /// Its own time began then.
    began: tokio::time::Instant,
    at: u64,
}

impl Ear {
    pub(super) fn new(start: u64, settings: Settings) -> Ear {
        let epoch = u64::try_from(jiff::Timestamp::now().as_microsecond());
        Ear {
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

    /// Until then; where nothing is due, for ever.
    pub(super) async fn until(&self, due: Option<Instant>) {
        match due {
            Some(due) => {
                let left = Duration::from_micros(due.since(self.now()).0);
                sleep_until(tokio::time::Instant::now() + left).await;
            }
            None => std::future::pending().await,
        }
    }

    /// What was due is due now.
    pub(super) fn timeout(&mut self) {
        self.listener.handle(self.now(), Input::Timeout);
    }

    /// Takes out what was heard; says when it is due again.
    pub(super) fn hear(&mut self, heard: &mut Vec<Heard>) -> Option<Instant> {
        loop {
            match self.listener.poll() {
                Output::Wait(due) => return due,
                Output::Heard(one) => heard.push(one),
            }
        }
    }

    /// What passed, after every timeout that fell due before it.
    pub(super) fn take(&mut self, passed: &TapFrame, heard: &mut Vec<Heard>) {
        let at = Instant(self.start.saturating_add(passed.at.0));
        let time = self.settings.frame_time(passed.bytes.len());
        // What is sent is told when it is handed to the port, what is heard when it has ended.
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
    use railbus_sniff::Verdict;

    /// The line master takes such a reply as good, so the list of frames must not call it cut.
    #[tokio::test]
    async fn a_reply_that_the_line_takes_in_pieces_is_one_frame() {
        let settings = Settings::FACTORY;
        let passed = |at: u64, sent: bool, bytes: &[u8]| TapFrame {
            at: Instant(at),
            sent: sent.then_some(settings),
            bytes: bytes.into(),
        };
        let mut ear = Ear::new(1_000_000, settings);
        let mut heard = Vec::new();
        ear.take(&passed(0, true, b"$016\r"), &mut heard);
        ear.take(&passed(20_000, false, b"!0302"), &mut heard);
        ear.take(&passed(68_000, false, b"00\r"), &mut heard);
        ear.hear(&mut heard);
        let verdicts: Vec<_> = heard
            .iter()
            .map(|heard| match heard {
                Heard::Frame(frame) => Some(frame.verdict),
                _ => None,
            })
            .collect();
        assert_eq!(
            verdicts,
            [Some(Verdict::Good), Some(Verdict::Good)],
            "{heard:?}"
        );
    }
}
