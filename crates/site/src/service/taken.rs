//! Outputs that commands take over from pulses and leases. Of several commands at once for one
//! output, one that is carried out settles it: only where all of them fail, what was to be done
//! later still is.

use super::promises::{Key, Promise, Why};
use super::timer::Timer;
use super::{Inner, lock};
use crate::config::Place;
use railbus_device::Point;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// The outputs that commands under way have taken over.
#[derive(Debug, Default)]
pub(super) struct Claims(Mutex<BTreeMap<Place, Claim>>);

#[derive(Debug, Default)]
struct Claim {
    /// The commands under way.
    commands: usize,
    /// One of them was carried out.
    is_settled: bool,
    /// What was to be done, and the numbers of those that were to do it.
    taken: Vec<(Key, u64, Promise)>,
}

/// A command that has taken outputs over. Where it ends without [`Taken::settle`], it has failed.
#[derive(Debug)]
pub(super) struct Taken {
    inner: Arc<Inner>,
    places: Vec<Place>,
    is_done: bool,
}

impl Taken {
    /// The command has ended, and was carried out or not.
    pub(super) fn settle(mut self, is_done: bool) {
        self.is_done = is_done;
    }

    /// All that was done was taken back: the outputs are as they were found, in their pulses and
    /// leases.
    pub(super) fn give_back(self) {
        for place in &self.places {
            if let Some(claim) = lock(&self.inner.claims.0).get_mut(place) {
                claim.is_settled = false;
            }
        }
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        // Without a runtime the process ends, and what is promised still is.
        let Ok(runtime) = tokio::runtime::Handle::try_current() else {
            return;
        };
        for place in &self.places {
            let Some(claim) = self.inner.claims.end(place, self.is_done) else {
                continue;
            };
            for (key, number, promise) in claim.taken {
                let inner = Arc::clone(&self.inner);
                if claim.is_settled {
                    runtime.spawn(async move { inner.promises.drop(&key, number).await });
                } else {
                    runtime.spawn(Timer::new(&inner, key, promise).promised());
                }
            }
        }
    }
}

impl Claims {
    /// A command has ended: gives back what there is to do after the last one.
    fn end(&self, place: &Place, is_done: bool) -> Option<Claim> {
        let mut all = lock(&self.0);
        let claim = all.get_mut(place)?;
        claim.commands -= 1;
        claim.is_settled |= is_done;
        match claim.commands {
            0 => all.remove(place),
            _ => None,
        }
    }
}

impl Inner {
    /// A command takes outputs over: their pulses and leases will not be ended from here. What was
    /// promised stays written down until the command has ended.
    pub(super) fn take_over(self: &Arc<Inner>, module: &str, points: &[Point]) -> Taken {
        let places = points.iter().map(|point| Place::new(module, *point));
        self.take_over_all(places.collect())
    }

    /// The same of outputs of any modules.
    pub(super) fn take_over_all(self: &Arc<Inner>, places: Vec<Place>) -> Taken {
        for place in &places {
            let mut all = lock(&self.claims.0);
            let claim = all.entry(place.clone()).or_default();
            claim.commands += 1;
            for why in [Why::Pulse, Why::Lease] {
                let key = (place.clone(), why);
                let end = self.promises.end_of(&key);
                if let (Some(end), Some((number, left))) = (end, self.timers.claim(&key)) {
                    claim.taken.push((key, number, Promise::after(left, end)));
                }
            }
        }
        Taken {
            inner: Arc::clone(self),
            places,
            is_done: false,
        }
    }
}
