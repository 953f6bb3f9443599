//! Outputs that somebody holds: they stay as they are only for as long as that is said again.

use super::command::{TTL, places};
use super::promises::Why;
use super::timer::{Begin, is_released, to_its_end};
use super::{Service, lock};
use crate::config::Place;
use crate::{Failure, WriteDone, WriteTerms};
use railbus_device::Point;
use railbus_wire::Micros;
use std::time::Duration;
use tokio::time::Instant;

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
        let (service, module) = (self.clone(), module.to_owned());
        let held = (value, Duration::from_micros(time.0));
        to_its_end(async move { service.lease_asked(&module, point, held, confirm).await }).await
    }

    async fn lease_asked(
        &self,
        module: &str,
        point: Point,
        (value, length): (bool, Duration),
        confirm: bool,
    ) -> Result<Leased, Failure> {
        let expires = Instant::now() + TTL;
        let turn = self.inner.turn(places(module, &[point]), expires).await?;
        // Meanwhile the configuration may have changed, or the site begun to end.
        self.inner.may_command(module, &[point], confirm)?;
        let key = (Place::new(module, point), Why::Lease);
        let end = self.end_of_lease(&key.0, value);
        if let Some((number, held)) = self.inner.schedule.find(&key)
            && held.end == end
            && self.inner.known(&key.0) == Some(value)
        {
            let renewed = self.inner.schedule.renew(number, length).await;
            if renewed.map_err(|why| Failure::NotKept(why.kind()))? {
                return Ok(Leased {
                    written: None,
                    left: self.inner.schedule.due(&key).unwrap_or_default(),
                });
            }
        }
        let on = if value { "on" } else { "off" };
        let label = self.inner.label(module, point);
        let begin = Begin {
            key,
            value,
            end,
            length,
            note: self.note(format!("lease {label}={on} {}ms", length.as_millis())),
            expires,
        };
        let (written, left) = self.inner.begin_timed(&turn, begin).await?;
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
        let (service, module) = (self.clone(), module.to_owned());
        to_its_end(async move { service.end_lease_asked(&module, point).await }).await
    }

    async fn end_lease_asked(
        &self,
        module: &str,
        point: Point,
    ) -> Result<Option<WriteDone>, Failure> {
        let expires = Instant::now() + TTL;
        let turn = self.inner.turn(places(module, &[point]), expires).await?;
        self.inner.may_command(module, &[point], true)?;
        let schedule = &self.inner.schedule;
        let key = (Place::new(module, point), Why::Lease);
        let (number, held) = schedule.find(&key).ok_or(Failure::NoLease(point))?;
        let Some(on) = held.end else {
            // It stays as it is: a pulse that may have begun still has to end.
            let kept = schedule.give_up(&key).await;
            kept.map_err(|why| Failure::NotTakenOver(why.kind()))?;
            return Ok(None);
        };
        // Where this fails, it is switched by itself when its time is over.
        schedule.anticipate(number);
        let set = [(point, on)];
        let terms = WriteTerms::default();
        let done = self.write_in_turn(&turn, module, &set, terms, expires);
        let done = done.await?;
        if !is_released(&done) {
            // It was acknowledged and not seen: that is tried again.
            schedule.hasten(number);
            return Ok(Some(done));
        }
        self.inner.take_over(module, &[point], done).await.map(Some)
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
