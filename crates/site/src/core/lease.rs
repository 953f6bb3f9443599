//! Leases: outputs that keep their state only for as long as the lease is renewed.

use super::context::Context;
use super::order::places;
use super::promises::Why;
use super::state::State;
use super::timers::{Begin, is_released};
use super::within::{TTL, Within};
use super::write::note;
use crate::config::Place;
use crate::rights::Who;
use crate::{CommandError, WriteDone, WriteTerms};
use railbus_device::Point;
use railbus_wire::Micros;
use std::time::Duration;

/// The shortest lease: its holder must have the time to renew it.
pub const LEASE_MIN: Micros = Micros::from_millis(200);
/// The longest lease.
pub const LEASE_MAX: Micros = Micros::from_secs(3_600);

/// On what terms an output is leased.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeaseTerms {
    /// The caller confirms an output that requires it.
    pub confirm: bool,
    /// It must be sent within this time; a renewal sends nothing, and must have its turn within it.
    pub within: Within,
}

/// How an output was leased, or its lease renewed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leased {
    /// How it was switched; none for a renewal.
    pub written: Option<WriteDone>,
    /// How long the lease lasts from now on.
    pub left: Duration,
}

impl Context {
    /// Switches an output and holds it in this state for a time.
    pub(crate) async fn lease(
        &self,
        who: &Who,
        module: &str,
        point: Point,
        (value, time): (bool, Micros),
        terms: LeaseTerms,
    ) -> Result<Leased, CommandError> {
        let LeaseTerms { confirm, within } = terms;
        let expires = self.expires(within);
        self.with(|state| state.may_command(who, module, &[point], confirm))?;
        if !(LEASE_MIN..=LEASE_MAX).contains(&time) {
            return Err(CommandError::LeaseTime(point));
        }
        if value {
            self.with(|state| state.watched(module, [point]))?;
        }
        let length = Duration::from_micros(time.0);
        let turn = self.turn(places(module, &[point]), expires).await?;
        // Meanwhile the configuration may have changed, or the site may be closing.
        self.with(|state| state.may_command(who, module, &[point], confirm))?;
        let key = (Place::new(module, point), Why::Lease);
        let (end, held) = self.with(|state| {
            let end = state.end_of_lease(&key.0, value);
            let held = state.schedule.find(&key);
            let held = held.filter(|(_, held)| held.end == end);
            // What could not be taken over before still ends: that is taken over first.
            let is_alone = state.schedule.held(|other| *other == key.0).len() < 2;
            let held = held.filter(|_| is_alone);
            (end, held.filter(|_| state.known(&key.0) == Some(value)))
        });
        if let Some((number, _)) = held {
            let renewed = self.renew(number, length).await;
            if renewed.map_err(CommandError::NotKept)? {
                let left = self.with(|state| state.time_to(&key));
                return Ok(Leased {
                    written: None,
                    left: left.unwrap_or_default(),
                });
            }
        }
        let on = if value { "on" } else { "off" };
        let label = self.with(|state| state.label(module, point));
        let begin = Begin {
            key,
            value,
            end,
            length,
            note: note(who, format!("lease {label}={on} {}ms", length.as_millis())),
            expires,
        };
        let (written, left) = self.begin_timed(&turn, begin).await?;
        Ok(Leased {
            written: Some(written),
            left,
        })
    }

    /// Ends a lease early: the output is switched as at its end.
    pub(crate) async fn end_lease(
        &self,
        who: &Who,
        module: &str,
        point: Point,
    ) -> Result<Option<WriteDone>, CommandError> {
        self.with(|state| state.may_command(who, module, &[point], true))?;
        let expires = self.now() + TTL;
        let turn = self.turn(places(module, &[point]), expires).await?;
        let key = (Place::new(module, point), Why::Lease);
        let (number, held) = self.with(|state| {
            state.may_command(who, module, &[point], true)?;
            state
                .schedule
                .find(&key)
                .ok_or(CommandError::NoLease(point))
        })?;
        let Some(on) = held.end else {
            // It stays as it is: a pulse that may have begun still has to end.
            self.give_up(&key)
                .await
                .map_err(CommandError::NotTakenOver)?;
            return Ok(None);
        };
        // If this fails, it is switched when its time is over.
        self.with(|state| state.schedule.anticipate(number));
        let set = [(point, on)];
        let terms = WriteTerms::default();
        let done = self.write_in_turn(who, &turn, module, &set, terms, expires);
        let done = done.await?;
        if !is_released(&done) {
            // It was acknowledged and not seen: that is retried.
            self.with(|state| state.schedule.hasten(number, state.now.site));
            return Ok(Some(done));
        }
        self.take_over(module, &[point], done).await.map(Some)
    }
}

impl State {
    fn end_of_lease(&self, place: &Place, value: bool) -> Option<bool> {
        let safety = self.site.config().safety(place);
        match safety.and_then(|safety| safety.on_offline) {
            Some(policy) => policy.state(),
            None => Some(!value),
        }
    }
}
