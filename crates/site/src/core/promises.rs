//! The scheduled actions of a site.

use crate::Config;
use crate::config::Place;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

/// The reason of a scheduled action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Why {
    /// A pulse that is timed here ends.
    Pulse,
    /// A lease was not renewed.
    Lease,
    /// An output has been on for as long as it may be.
    MaxOn,
    /// A module answers again.
    OnReturn,
    /// An output has been off for as long as it has to be. No action follows.
    MinOff,
    /// A pulse that the module times by itself ends, at the latest. No action follows.
    OwnPulse,
}

impl Why {
    /// Whether it is the policy of an output.
    pub(crate) const fn is_policy(self) -> bool {
        matches!(self, Why::OnReturn)
    }
}

/// What a promise is about, and of which output.
pub(crate) type Key = (Place, Why);

/// What will be done, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Promise {
    /// The state to switch the output to, if any.
    pub(crate) end: Option<bool>,
    /// When, by the wall clock: no other clock runs while the process does not.
    pub(crate) at: SystemTime,
    /// How long that was from the beginning.
    pub(crate) length: Duration,
}

impl Promise {
    /// So long after this time of the clock on the wall.
    pub(crate) fn after(wall: SystemTime, length: Duration, end: Option<bool>) -> Promise {
        let at = wall + length;
        Promise { end, at, length }
    }

    /// The remaining time. The wall clock may have been set: it is never longer than at the
    /// beginning.
    pub(crate) fn left(&self, wall: SystemTime) -> Duration {
        let left = self.at.duration_since(wall);
        left.unwrap_or_default().min(self.length)
    }

    /// The same where it does not end later than it can by the clock on the wall as it is now.
    pub(crate) fn at_most_its_length(self, wall: SystemTime) -> Promise {
        let latest = wall + self.length;
        let at = self.at.min(latest);
        Promise { at, ..self }
    }
}

/// Where a module is. After a restart its name alone may stand for another board.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Board {
    pub(crate) line: String,
    pub(crate) address: u8,
}

/// The board of each name.
pub(crate) type Boards = BTreeMap<String, Board>;

/// What the names of a configuration stand for.
pub(crate) fn boards(config: &Config) -> Boards {
    let each = config.modules.iter().map(|(name, module)| {
        let (line, address) = (module.line.clone(), module.setup.address.0);
        (name.clone(), Board { line, address })
    });
    each.collect()
}

/// A promise, and the board that it was made of; none where an earlier version wrote it down.
pub(crate) type Kept = (Key, Promise, Option<Board>);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_was_set_back_makes_nothing_longer() {
        let wall = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000);
        let hour = Duration::from_secs(3_600);
        let promise = Promise {
            end: Some(false),
            at: wall + 100 * hour,
            length: hour,
        };
        assert_eq!(promise.left(wall), hour);
        // Nor does the next start: it is written down anew.
        let anew = promise.at_most_its_length(wall);
        assert_eq!(anew.at, wall + hour);
        let over = Promise {
            at: SystemTime::UNIX_EPOCH,
            ..promise
        };
        assert_eq!(over.left(wall), Duration::ZERO);
    }
}
