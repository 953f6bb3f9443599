//! Outputs have one command at a time: who comes first goes first, from the questions that it
//! asks until what it took over is written down. So nothing overtakes a command between the
//! decision whose the output is and its frame, and of two commands the later one is the owner.

use super::{Inner, lock};
use crate::config::Place;
use railbus_host::Fault;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use tokio::sync::OwnedMutexGuard;
use tokio::time::{Instant, timeout_at};

/// How many commands may wait for one output.
pub(super) const WAITING_MAX: usize = 64;

/// Whose turn it is, output by output. Each lock lets in who has waited longest.
#[derive(Debug, Default)]
pub(super) struct Turns(Mutex<BTreeMap<Place, Arc<tokio::sync::Mutex<()>>>>);

/// A turn with outputs, until it is dropped.
#[derive(Debug)]
pub(super) struct Turn(Vec<(Place, OwnedMutexGuard<()>)>);

impl Turn {
    pub(super) fn has(&self, place: &Place) -> bool {
        self.0.iter().any(|(own, _)| own == place)
    }
}

impl Inner {
    /// Waits for the turn with these outputs, at most until then.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] where too many wait already; [`Fault::Expired`]. Nothing was sent.
    pub(super) async fn turn(
        &self,
        places: impl IntoIterator<Item = Place>,
        until: Instant,
    ) -> Result<Turn, Fault> {
        // Everybody waits in the same order, or two would wait for each other.
        let places: BTreeSet<Place> = places.into_iter().collect();
        let mut turn = Turn(Vec::with_capacity(places.len()));
        for place in places {
            let waiting = self.turns.of(place.clone());
            // The map's own, and this one.
            if Arc::strong_count(&waiting) > WAITING_MAX + 2 {
                return Err(Fault::Overloaded);
            }
            let has_come = timeout_at(until, waiting.lock_owned()).await;
            turn.0.push((place, has_come.map_err(|_| Fault::Expired)?));
        }
        Ok(turn)
    }

    /// Waits for the turn with as many of these outputs as come by then.
    pub(super) async fn turn_by(
        &self,
        places: impl IntoIterator<Item = Place>,
        until: Instant,
    ) -> Turn {
        let places: BTreeSet<Place> = places.into_iter().collect();
        let mut turn = Turn(Vec::with_capacity(places.len()));
        for place in places {
            let has_come = timeout_at(until, self.turns.of(place.clone()).lock_owned()).await;
            turn.0.extend(has_come.map(|guard| (place, guard)));
        }
        turn
    }

    /// Waits for the turn with an output however long that takes: for an end that was promised.
    pub(super) async fn turn_to_end(&self, place: &Place) -> Turn {
        let guard = self.turns.of(place.clone()).lock_owned().await;
        Turn(vec![(place.clone(), guard)])
    }
}

impl Turns {
    fn of(&self, place: Place) -> Arc<tokio::sync::Mutex<()>> {
        let mut turns = lock(&self.0);
        // Nobody has those, or waits for them.
        turns.retain(|_, turn| Arc::strong_count(turn) > 1);
        Arc::clone(turns.entry(place).or_default())
    }
}
