//! Outputs have one command at a time: who comes first goes first, from the questions that it
//! asks until what it took over is written down. So nothing overtakes a command between the
//! decision whose the output is and its frame, and of two commands the later one is the owner.
//!
//! A turn with several outputs comes with all of them at once: who waits has none. So the end of a
//! pulse waits for commands that have begun, and for nobody who waits himself for another output.

use super::At;
use super::context::{Context, TaskId};
use super::order::places;
use super::promises::{Board, Boards};
use super::reload::same_board;
use crate::config::{Config, Place};
use railbus_device::Point;
use railbus_host::Fault;
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};

/// How many commands may wait for one output.
pub(super) const WAITING_MAX: usize = 64;

/// Whose turn it is, output by output, by the order in which they came.
#[derive(Debug, Default)]
pub(super) struct Turns {
    newest: u64,
    each: BTreeMap<u64, Asked>,
    /// Whose turn has come since this was last taken.
    pub(super) woken: Vec<TaskId>,
}

/// A turn that was asked for.
#[derive(Debug)]
struct Asked {
    places: BTreeSet<Place>,
    /// It is for an end that was promised, which goes before commands that can't begin yet.
    is_end: bool,
    task: TaskId,
    has_come: bool,
}

/// A turn with outputs, or a place in the queue for one, until it is dropped.
#[derive(Debug)]
pub(crate) struct Turn {
    context: Context,
    number: u64,
    /// Where its modules were when it came.
    at: BTreeMap<String, At>,
    /// The boards of its modules then.
    boards: Boards,
}

impl Turn {
    /// Where a module was when the turn came. However long a command takes from then on, it is
    /// not for another board that gets the name meanwhile.
    pub(super) fn at(&self, module: &str) -> Option<At> {
        self.at.get(module).copied()
    }

    /// The board of a module when the turn came.
    pub(super) fn board(&self, module: &str) -> Option<&Board> {
        self.boards.get(module)
    }

    fn comes(mut self, places: &BTreeSet<Place>) -> Turn {
        let modules = places.iter().map(|place| &place.module);
        (self.at, self.boards) = self.context.with(|state| {
            let at = |module: &String| Some((module.clone(), state.at(module)?));
            let boards = &state.schedule.boards;
            let board = |module: &String| Some((module.clone(), boards.get(module)?.clone()));
            let boards = modules.clone().filter_map(board).collect();
            (modules.filter_map(at).collect(), boards)
        });
        self
    }

    /// Gives some of its outputs back before it ends.
    pub(super) fn give_back(&self, of: impl Fn(&Place) -> bool) {
        self.context.with(|state| {
            if let Some(own) = state.turns.each.get_mut(&self.number) {
                own.places.retain(|place| !of(place));
            }
            state.turns.call();
        });
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.context.with(|state| state.turns.end(self.number));
    }
}

impl Turns {
    /// A place in the queue for an end.
    fn ask(&mut self, places: BTreeSet<Place>, is_end: bool, task: TaskId) -> u64 {
        self.newest += 1;
        let asked = Asked {
            places,
            is_end,
            task,
            has_come: false,
        };
        self.each.insert(self.newest, asked);
        self.call();
        self.newest
    }

    fn end(&mut self, number: u64) {
        self.each.remove(&number);
        self.call();
    }

    /// Calls everybody whose turn has come.
    fn call(&mut self) {
        let had = self.each.values().filter(|asked| asked.has_come);
        let mut taken: BTreeSet<Place> = had.flat_map(|asked| asked.places.clone()).collect();
        // Of those who came before and wait yet.
        let mut awaited: BTreeSet<Place> = BTreeSet::new();
        for asked in self.each.values_mut().filter(|asked| !asked.has_come) {
            let is_free = |place: &Place| {
                !taken.contains(place) && (asked.is_end || !awaited.contains(place))
            };
            let places = asked.places.iter().cloned();
            if !asked.places.iter().all(is_free) {
                awaited.extend(places);
                continue;
            }
            taken.extend(places);
            asked.has_come = true;
            self.woken.push(asked.task);
        }
    }

    #[cfg(test)]
    pub(super) fn is_empty(&self) -> bool {
        self.each.is_empty()
    }

    fn has_come(&self, number: u64) -> bool {
        let asked = self.each.get(&number);
        asked.is_none_or(|asked| asked.has_come)
    }

    fn waiting_for(&self, place: &Place) -> usize {
        let each = self.each.values();
        let waiting = each.filter(|asked| !asked.has_come && asked.places.contains(place));
        waiting.count()
    }
}

impl Context {
    /// Waits for the turn with these outputs, at most until then.
    ///
    /// # Errors
    /// As [`Context::turn_since`].
    pub(super) async fn turn(
        &self,
        places: impl IntoIterator<Item = Place>,
        until: Micros,
    ) -> Result<Turn, Fault> {
        self.turn_since(&self.config(), places, until).await
    }

    /// The same for the boards that had the names in an earlier configuration: for work that has
    /// done something else before.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] where too many wait already; [`Fault::Expired`]; [`Fault::Closed`] if
    /// the name of a module became that of another board meanwhile. Nothing was sent.
    pub(super) async fn turn_since(
        &self,
        since: &Config,
        places: impl IntoIterator<Item = Place>,
        until: Micros,
    ) -> Result<Turn, Fault> {
        let places: BTreeSet<Place> = places.into_iter().collect();
        let is_full = self.with(|state| {
            let is_full = |place| state.turns.waiting_for(place) >= WAITING_MAX;
            places.iter().any(is_full)
        });
        if is_full {
            return Err(Fault::Overloaded);
        }
        let turn = self.queue(places.clone(), false);
        let comes = self.wait(|state| state.turns.has_come(turn.number).then_some(()));
        match self.until(until, comes).await {
            Some(()) => {
                let is_same = self.with(|state| {
                    let now = state.site.config();
                    let mut modules = places.iter().map(|place| &place.module);
                    modules.all(|module| same_board(since, now, module))
                });
                is_same.then(|| turn.comes(&places)).ok_or(Fault::Closed)
            }
            None => Err(Fault::Expired),
        }
    }

    /// Waits for the turn with these outputs however long that takes: for an end that was
    /// promised, or a policy.
    pub(super) async fn turn_to_end(&self, places: impl IntoIterator<Item = Place>) -> Turn {
        let places: BTreeSet<Place> = places.into_iter().collect();
        let turn = self.queue(places.clone(), true);
        self.wait(|state| state.turns.has_come(turn.number).then_some(()))
            .await;
        turn.comes(&places)
    }

    /// The same for the board that had the name of a module in an earlier configuration; none where
    /// another board has it by then.
    pub(super) async fn turn_to_end_since(
        &self,
        since: &Config,
        module: &str,
        points: &[Point],
    ) -> Option<Turn> {
        let turn = self.turn_to_end(places(module, points)).await;
        same_board(since, &self.config(), module).then_some(turn)
    }

    fn queue(&self, places: BTreeSet<Place>, is_end: bool) -> Turn {
        let number = self.with(|state| {
            let task = state.runs.current;
            state.turns.ask(places, is_end, task)
        });
        Turn {
            context: self.clone(),
            number,
            at: BTreeMap::new(),
            boards: Boards::new(),
        }
    }
}
