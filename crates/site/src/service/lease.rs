//! Outputs that somebody holds: they stay as they are only for as long as that is said again.

use super::promises::Why;
use super::{Service, lock};
use crate::config::Place;
use crate::{Failure, WriteDone};
use railbus_device::Point;
use railbus_wire::Micros;
use std::time::Duration;

/// The shortest lease: who holds an output must have the time to say so again.
pub const LEASE_MIN: Micros = Micros::from_millis(200);
/// The longest lease.
pub const LEASE_MAX: Micros = Micros::from_secs(3_600);

/// How an output was taken, or is held on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leased {
    /// How it was switched; none where it was held already and is so still.
    pub written: Option<WriteDone>,
    /// How long it is held from now on.
    pub left: Duration,
}

impl Service {
    /// Brings an output into a state and holds it there for a time. Before that time is over it
    /// is to be called again, or the output goes where its policy says (`on_offline`), and
    /// without one into its other state. Another command takes it over.
    ///
    /// # Errors
    /// [`Failure::LeaseTime`], or as [`Service::write`].
    pub async fn lease(
        &self,
        module: &str,
        point: Point,
        (value, time): (bool, Micros),
        confirm: bool,
    ) -> Result<Leased, Failure> {
        self.inner.may_command(module, &[point], confirm)?;
        if !(LEASE_MIN..=LEASE_MAX).contains(&time) {
            return Err(Failure::LeaseTime(point));
        }
        if value {
            self.inner.watched(module, [point])?;
        }
        let left = Duration::from_micros(time.0);
        let key = (Place::new(module, point), Why::Lease);
        let end = self.end_of_lease(&key.0, value);
        let is_held = self.inner.promises.end_of(&key) == Some(end)
            && self.inner.known(&key.0) == Some(value);
        if is_held && self.inner.timers.put_off(&key, None, left) {
            return Ok(Leased {
                written: None,
                left,
            });
        }
        let taken = self.inner.take_over(module, &[point]);
        let on = if value { "on" } else { "off" };
        let label = self.inner.label(module, point);
        let note = self.note(format!("lease {label}={on} {}ms", time.0 / 1_000));
        let written = self.inner.begin_timed(key, (value, end), left, note).await;
        taken.settle(written.is_ok());
        let written = written?;
        Ok(Leased {
            written: Some(written),
            left,
        })
    }

    /// Gives an output back before its time is over: it goes where it would have gone then.
    /// Nothing comes back where it is to stay as it is.
    ///
    /// # Errors
    /// [`Failure::NoLease`], or as [`Service::write`].
    pub async fn end_lease(
        &self,
        module: &str,
        point: Point,
    ) -> Result<Option<WriteDone>, Failure> {
        self.inner.may_command(module, &[point], true)?;
        let key = (Place::new(module, point), Why::Lease);
        let end = self.inner.promises.end_of(&key);
        let number = end.and_then(|_| self.inner.timers.anticipate(&key));
        let (Some(end), Some(number)) = (end, number) else {
            return Err(Failure::NoLease(point));
        };
        let Some(on) = end else {
            self.inner.timers.take_over_one(&key, number);
            return Ok(None);
        };
        // It is taken over by this command, and switched by itself where this one fails. Who
        // takes the output meanwhile, has it.
        let done = self.release_now(module, point, on).await?;
        self.inner.timers.take_over_one(&key, number);
        Ok(Some(done))
    }

    fn end_of_lease(&self, place: &Place, value: bool) -> Option<bool> {
        let state = lock(&self.inner.state);
        let safety = state.site.config().safety(place);
        match safety.and_then(|safety| safety.on_offline) {
            Some(policy) => policy.state(),
            None => Some(!value),
        }
    }
}
