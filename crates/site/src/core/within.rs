//! How long a command may wait until it is sent.

use super::context::Context;
use railbus_wire::Micros;

/// The shortest time within which a command can be wanted: a line needs some of it for what is
/// under way.
pub const WITHIN_MIN: Micros = Micros::from_millis(200);
/// The longest.
pub const WITHIN_MAX: Micros = Micros::from_secs(60);
/// The time of commands that say none, and of what the site does by itself.
pub(super) const TTL: Micros = Micros::from_secs(5);

/// The time within which the frames of a command must be sent, from when it is given to the site.
/// What has not been sent by then is not sent any more. It covers all that the command waits for:
/// its turn, other modules, the disk and the line. What is done already is read back and, where it
/// has to be, undone after that time, too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Within(Micros);

impl Within {
    /// Five seconds.
    pub const DEFAULT: Within = Within(TTL);

    /// This time; none if it is not from [`WITHIN_MIN`] to [`WITHIN_MAX`].
    #[must_use]
    pub fn new(time: Micros) -> Option<Within> {
        let allowed = WITHIN_MIN..=WITHIN_MAX;
        allowed.contains(&time).then_some(Within(time))
    }

    /// What is left of it after some time; none if nothing is. No less is left than
    /// [`WITHIN_MIN`].
    #[must_use]
    pub fn after(self, time: Micros) -> Option<Within> {
        let left = self.0.0.checked_sub(time.0).filter(|left| *left > 0)?;
        Some(Within(Micros(left).max(WITHIN_MIN)))
    }

    /// This time.
    #[must_use]
    pub const fn time(self) -> Micros {
        self.0
    }
}

impl Default for Within {
    fn default() -> Within {
        Within::DEFAULT
    }
}

impl Context {
    /// When a command expires that is given now.
    pub(crate) fn expires(&self, within: Within) -> Micros {
        self.now() + within.0
    }
}
