//! A tap of a line's traffic. It is the line's own view: nothing is sent for it, and without a tap
//! it costs nothing.

use crate::clock::Clock;
use railbus_wire::{Instant, Micros, SerialSettings};
use std::sync::Arc;
use tokio::sync::broadcast;

/// How many frames wait for a tap before the oldest are dropped.
const PIECES_MAX: usize = 256;

/// Bytes sent or received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TapFrame {
    /// When they were passed to the port or came from it, in the time of [`crate::Line::now`].
    pub at: Instant,
    /// The settings of a frame that was sent; none for received bytes.
    pub sent: Option<SerialSettings>,
    /// All of them.
    pub bytes: Arc<[u8]>,
}

/// Bytes received this soon after a tap was opened, before a frame was sent, may be the rest of an
/// earlier reply: half a frame, which would be shown as a bad one.
const BEGINNING: Micros = Micros::from_millis(500);

/// The receiving end.
#[derive(Debug)]
pub struct Tap {
    pieces: broadcast::Receiver<TapFrame>,
    /// Until a frame is sent, bytes received before this moment are skipped.
    begins: Option<Instant>,
}

impl Tap {
    /// The next bytes, or how many frames were lost because this receiver was too slow; none after
    /// the line was closed. Cancel-safe.
    pub async fn next(&mut self) -> Option<Result<TapFrame, u64>> {
        loop {
            match self.pieces.recv().await {
                Ok(passed) if self.is_too_early(&passed) => {}
                Ok(passed) => return Some(Ok(passed)),
                Err(broadcast::error::RecvError::Lagged(count)) => return Some(Err(count)),
                Err(broadcast::error::RecvError::Closed) => return None,
            }
        }
    }

    fn is_too_early(&mut self, passed: &TapFrame) -> bool {
        let early = self.begins.is_some_and(|begins| passed.at < begins);
        if early && passed.sent.is_none() {
            return true;
        }
        self.begins = None;
        false
    }
}

/// The sending end.
#[derive(Debug)]
pub(crate) struct TapSender {
    sender: broadcast::Sender<TapFrame>,
    clock: Clock,
    /// What was sent last and may still come back as an echo.
    echo: Vec<u8>,
}

impl TapSender {
    pub(crate) fn new(clock: Clock) -> TapSender {
        TapSender {
            sender: broadcast::Sender::new(PIECES_MAX),
            clock,
            echo: Vec::new(),
        }
    }

    pub(crate) fn tap(&self) -> Tap {
        Tap {
            pieces: self.sender.subscribe(),
            begins: Some(self.clock.now() + BEGINNING),
        }
    }

    /// Passes on a frame that is sent; false once there is no tap left.
    pub(crate) fn sent(&mut self, bytes: &[u8], settings: SerialSettings) -> bool {
        self.echo.clear();
        self.echo.extend_from_slice(bytes);
        self.tell(Some(settings), bytes)
    }

    /// Passes on received bytes, without the adapter's echo; false as above.
    pub(crate) fn heard(&mut self, bytes: &[u8], echoes: bool) -> bool {
        if !echoes {
            return self.tell(None, bytes);
        }
        let same = self.echo.iter().zip(bytes).take_while(|(a, b)| a == b);
        let count = same.count();
        // From the first difference on, it is not an echo.
        match count == bytes.len() {
            true => drop(self.echo.drain(..count)),
            false => self.echo.clear(),
        }
        match bytes.get(count..) {
            Some(rest) if !rest.is_empty() => self.tell(None, rest),
            _ => self.sender.receiver_count() > 0,
        }
    }

    fn tell(&self, sent: Option<SerialSettings>, bytes: &[u8]) -> bool {
        let passed = TapFrame {
            at: self.clock.now(),
            sent,
            bytes: bytes.into(),
        };
        self.sender.send(passed).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Alarm;

    async fn rest(tap: &mut Tap) -> Vec<u8> {
        let passed = tap.next().await.unwrap().unwrap();
        passed.bytes.to_vec()
    }

    #[tokio::test]
    async fn an_echo_is_taken_out_in_whatever_pieces_it_comes() {
        let mut tapped = TapSender::new(Alarm::new().unwrap().clock());
        let mut tap = tapped.tap();
        assert!(tapped.sent(&[1, 5, 0], SerialSettings::FACTORY));
        for piece in [&[1, 5][..], &[0, 1, 5], &[0]] {
            assert!(tapped.heard(piece, true));
        }
        // The frame, and the reply that repeats it.
        assert_eq!(rest(&mut tap).await, [1, 5, 0]);
        assert_eq!(rest(&mut tap).await, [1, 5]);
        assert_eq!(rest(&mut tap).await, [0]);
        tapped.sent(&[1, 5, 0], SerialSettings::FACTORY);
        tapped.heard(&[1, 5, 0], false);
        rest(&mut tap).await;
        assert_eq!(rest(&mut tap).await, [1, 5, 0], "no echo here, so a reply");
    }

    #[tokio::test]
    async fn it_does_not_begin_within_a_reply() {
        let mut tapped = TapSender::new(Alarm::new().unwrap().clock());
        let mut tap = tapped.tap();
        tapped.heard(&[9], false);
        tapped.sent(&[1], SerialSettings::FACTORY);
        tapped.heard(&[2], false);
        assert_eq!(rest(&mut tap).await, [1]);
        assert_eq!(rest(&mut tap).await, [2]);
        // On a line where nothing is sent, noise is shown anyway.
        let mut tap = tapped.tap();
        tap.begins = Some(Instant(0));
        tapped.heard(&[9], false);
        assert_eq!(rest(&mut tap).await, [9]);
    }

    #[tokio::test]
    async fn who_is_too_slow_is_told_so_and_nobody_is_missed() {
        let mut tapped = TapSender::new(Alarm::new().unwrap().clock());
        let mut tap = tapped.tap();
        tap.begins = None;
        for _ in 0..PIECES_MAX + 2 {
            assert!(tapped.heard(&[1], false));
        }
        assert_eq!(tap.next().await, Some(Err(2)));
        drop(tap);
        assert!(!tapped.heard(&[1], false));
    }
}
