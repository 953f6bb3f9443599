//! How late a heartbeat is: what it took longer than the fastest one of the last minutes.

use crate::message::Beat;
use std::time::Duration;

/// How long the fastest heartbeat of a session is remembered, up to twice this time. Not longer:
/// clocks drift, and the monotonic clock stops while a machine sleeps.
const FASTEST: Duration = Duration::from_secs(300);

/// The smallest difference between the centre's time and the site's in this window and the one
/// before, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fastest {
    since: Duration,
    now_ms: i128,
    before_ms: i128,
}

impl Fastest {
    /// Including one more heartbeat.
    pub(super) fn with(last: Option<Fastest>, now: Duration, beat: &Beat) -> Fastest {
        let millis = i128::try_from(now.as_millis()).unwrap_or(i128::MAX);
        let its = millis - i128::from(beat.time_ms);
        let Some(last) = last else {
            return Fastest {
                since: now,
                now_ms: its,
                before_ms: its,
            };
        };
        if now.saturating_sub(last.since) < FASTEST {
            let now_ms = last.now_ms.min(its);
            return Fastest { now_ms, ..last };
        }
        Fastest {
            since: now,
            now_ms: its,
            before_ms: last.now_ms,
        }
    }

    /// When a heartbeat was sent, by the centre's clock.
    pub(super) fn said(&self, beat: &Beat) -> Duration {
        let millis = self.now_ms.min(self.before_ms) + i128::from(beat.time_ms);
        Duration::from_millis(u64::try_from(millis).unwrap_or_default())
    }
}
