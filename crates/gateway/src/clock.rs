//! Clocks of this machine.

use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;

/// The wall clock, in whole seconds since 1970; zero before that.
#[cfg(feature = "fleet")]
pub(crate) fn unix_s() -> u64 {
    let now = railbus_store::history::millis(std::time::SystemTime::now());
    u64::try_from(now / 1_000).unwrap_or_default()
}

/// The time since this machine was booted, including suspensions.
pub(crate) fn since_boot() -> Duration {
    let time = clock_gettime(ClockId::Boottime);
    let seconds = u64::try_from(time.tv_sec).unwrap_or_default();
    Duration::new(seconds, u32::try_from(time.tv_nsec).unwrap_or_default())
}
