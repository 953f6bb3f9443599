//! What passes on a line, for those who look on. It is the line's own view: nothing is sent for
//! it, and while nobody looks it costs nothing.

use crate::clock::Clock;
use railbus_wire::{Instant, Settings};
use std::sync::Arc;
use tokio::sync::broadcast;

/// How many pieces wait for one who looks on before the oldest are dropped.
const PIECES_MAX: usize = 256;

/// Bytes that passed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Passed {
    /// When they were handed to the port, or came from it; as [`crate::Line::now`] counts.
    pub at: Instant,
    /// A frame that was sent, at this speed and in this format; or else bytes that were heard.
    pub sent: Option<Settings>,
    /// All of them.
    pub bytes: Arc<[u8]>,
}

/// The end of one who looks on.
#[derive(Debug)]
pub struct Tap(broadcast::Receiver<Passed>);

impl Tap {
    /// What passes next, or how many pieces before that were lost because this receiver was too
    /// slow; none after the line was closed. To drop the future loses nothing.
    pub async fn next(&mut self) -> Option<Result<Passed, u64>> {
        match self.0.recv().await {
            Ok(passed) => Some(Ok(passed)),
            Err(broadcast::error::RecvError::Lagged(count)) => Some(Err(count)),
            Err(broadcast::error::RecvError::Closed) => None,
        }
    }
}

/// The line's end of it.
#[derive(Debug)]
pub(crate) struct Tapped {
    sender: broadcast::Sender<Passed>,
    clock: Clock,
}

impl Tapped {
    pub(crate) fn new(clock: Clock) -> Tapped {
        Tapped {
            sender: broadcast::Sender::new(PIECES_MAX),
            clock,
        }
    }

    pub(crate) fn tap(&self) -> Tap {
        Tap(self.sender.subscribe())
    }

    /// Tells what passes; false once nobody looks on any more.
    pub(crate) fn tell(&self, sent: Option<Settings>, bytes: &[u8]) -> bool {
        let passed = Passed {
            at: self.clock.now(),
            sent,
            bytes: bytes.into(),
        };
        self.sender.send(passed).is_ok()
    }
}
