//! What is to be done to outputs later, and when. A pulse or a lease is not done any more once
//! another command was carried out, and that is on the disk before it is told.

use super::lock;
use super::promises::{Board, Boards, File, Kept, Key, Promise, Why};
use super::status::Left;
use crate::config::Place;
use railbus_device::PointKind;
use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::Instant;

/// When the site ends, its pulses have this time to be released.
pub(super) const STOP_MAX: Duration = Duration::from_millis(1_400);

/// All that is to be done later.
#[derive(Debug)]
pub(super) struct Schedule {
    actions: Mutex<Actions>,
    file: File,
    /// What was promised of boards that have another name or none now, until that is told.
    dropped: Mutex<Vec<(Key, Board)>>,
    /// How many are seen to.
    running: watch::Sender<usize>,
    stop: watch::Sender<bool>,
}

#[derive(Debug, Default)]
struct Actions {
    newest: u64,
    /// Counts the changes: the file has all up to one of them.
    version: u64,
    by_number: BTreeMap<u64, Action>,
    /// For how long outputs must stay off. Nothing is done then.
    off: Vec<(Place, Promise)>,
    /// What the names of modules stand for.
    boards: Boards,
}

/// Something that is to be done to an output.
#[derive(Debug)]
struct Action {
    key: Key,
    promise: Promise,
    /// When it is due; none where nobody sees to it.
    due: Option<watch::Sender<Instant>>,
    /// The output is being released, or about to be: it is too late to put that off.
    is_ending: bool,
    /// It is not to be done any more, and the file does not have it from this version on. Until
    /// then it stays here.
    left_out: Option<u64>,
}

impl Action {
    fn is_of(&self, place: &Place) -> bool {
        !matches!(self.key.1, Why::MaxOn | Why::MinOff) && self.key.0 == *place
    }

    const fn is_to_be_done(&self) -> bool {
        self.left_out.is_none()
    }
}

/// One that is seen to, by whoever has this.
#[derive(Debug)]
pub(super) struct Watched {
    pub(super) number: u64,
    /// When it is due. Closed where it is not to be done any more; woken without another time,
    /// it is tried at once.
    pub(super) due: watch::Receiver<Instant>,
    pub(super) stop: watch::Receiver<bool>,
    running: watch::Sender<usize>,
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.running
            .send_modify(|count| *count = count.saturating_sub(1));
    }
}

/// Whether it is time for something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Time {
    /// It is not to be done any more.
    Over,
    NotYet,
    Due,
}

impl Default for Schedule {
    fn default() -> Schedule {
        Schedule::of(File::default(), Vec::new(), Boards::new())
    }
}

impl Schedule {
    /// What the file in a folder says, to which nobody sees yet. The end of another board's output
    /// is not done to the one that has its name now.
    pub(super) fn open(folder: &Path, boards: Boards) -> io::Result<Schedule> {
        let (file, known) = File::open(folder)?;
        Ok(Schedule::of(file, known, boards))
    }

    fn of(file: File, known: Vec<Kept>, boards: Boards) -> Schedule {
        let mut actions = Actions::default();
        let mut dropped = Vec::new();
        for (key, promise, board) in known {
            if let Some(board) = board
                && boards.get(&key.0.module) != Some(&board)
            {
                dropped.push((key, board));
                continue;
            }
            match key.1 {
                Why::MinOff => actions.off.push((key.0, promise)),
                _ => _ = actions.add(key, promise, None),
            }
        }
        actions.boards = boards;
        Schedule {
            actions: Mutex::new(actions),
            file,
            dropped: Mutex::new(dropped),
            running: watch::Sender::new(0),
            stop: watch::Sender::new(false),
        }
    }

    /// One more, as from now on. Of the longest times that an output may be on there is one, and
    /// of its policies. [`Schedule::keep`] brings it to the disk.
    pub(super) fn add(&self, key: Key, promise: Promise) -> Watched {
        let (sender, due) = watch::channel(Instant::now() + promise.left());
        let mut actions = lock(&self.actions);
        let gives_way = |why: Why| match key.1 {
            Why::MaxOn => why == Why::MaxOn,
            newer => newer.is_policy() && why.is_policy(),
        };
        actions.leave_out(|_, action| action.key.0 == key.0 && gives_way(action.key.1));
        let number = actions.add(key, promise, Some(sender));
        drop(actions);
        self.watched(number, due)
    }

    fn watched(&self, number: u64, due: watch::Receiver<Instant>) -> Watched {
        self.running.send_modify(|count| *count += 1);
        Watched {
            number,
            due,
            stop: self.stop.subscribe(),
            running: self.running.clone(),
        }
    }

    /// Those of the process before this one, to be seen to from now on.
    pub(super) fn take_up(&self) -> Vec<(Key, Promise, Watched)> {
        let mut actions = lock(&self.actions);
        let mut begun = Vec::new();
        for (number, action) in &mut actions.by_number {
            action.promise = action.promise.at_most_its_length();
            let (sender, due) = watch::channel(Instant::now() + action.promise.left());
            action.due = Some(sender);
            begun.push((action.key.clone(), action.promise, *number, due));
        }
        actions.version += 1;
        drop(actions);
        let begun = begun.into_iter().map(|(key, promise, number, due)| {
            let watched = self.watched(number, due);
            (key, promise, watched)
        });
        begun.collect()
    }

    /// From now on names stand for these boards; [`Schedule::keep`] brings that to the disk.
    pub(super) fn now_of(&self, boards: Boards) {
        let mut actions = lock(&self.actions);
        actions.boards = boards;
        if !actions.by_number.is_empty() || !actions.off.is_empty() {
            actions.version += 1;
        }
    }

    pub(super) fn has_dropped(&self) -> bool {
        !lock(&self.dropped).is_empty()
    }

    /// What was promised of boards that have another name or none now; told once.
    pub(super) fn take_dropped(&self) -> Vec<(Key, Board)> {
        std::mem::take(&mut *lock(&self.dropped))
    }

    /// One could not be done to its board, which is one of these, and the name is about to stand
    /// for another: [`Schedule::take_dropped`] says so, once of an output.
    pub(super) fn drop_of(&self, boards: &Boards, number: u64) {
        let dropped = {
            let mut actions = lock(&self.actions);
            let action = actions.by_number.get(&number);
            let action = action.filter(|action| action.is_to_be_done());
            let dropped = action.and_then(|Action { key, .. }| {
                let board = boards.get(&key.0.module)?;
                Some((key.clone(), board.clone()))
            });
            actions.leave_out(|at, _| at == number);
            dropped
        };
        let mut known = lock(&self.dropped);
        if let Some(one) = dropped.filter(|one| !known.contains(one)) {
            known.push(one);
        }
    }

    /// For how long outputs must stay off.
    pub(super) fn off(&self) -> Vec<(Place, Promise)> {
        lock(&self.actions).off.clone()
    }

    /// Brings all of it to the disk as it is now.
    pub(super) async fn keep(&self) -> io::Result<()> {
        let version = lock(&self.actions).version;
        let newest = || {
            let actions = lock(&self.actions);
            (actions.version, actions.promises())
        };
        let written = self.file.write(version, newest).await?;
        let gone = |_: &u64, action: &mut Action| action.left_out.is_some_and(|at| at <= written);
        lock(&self.actions)
            .by_number
            .extract_if(.., gone)
            .for_each(drop);
        Ok(())
    }

    /// The same for one change, which is taken back where the disk refuses. It may be on its way
    /// there with another one meanwhile: then it counts as done once that has succeeded.
    async fn keep_or(&self, version: u64, back: impl FnOnce(&mut Actions)) -> io::Result<()> {
        let Err(why) = self.keep().await else {
            return Ok(());
        };
        // Nobody writes while this is held, and whoever does later finds it taken back.
        let written = self.file.written().await;
        if *written >= version {
            return Ok(());
        }
        {
            let mut actions = lock(&self.actions);
            back(&mut actions);
            actions.version += 1;
        }
        drop(written);
        // A write that failed at its last step may be in the file all the same.
        let _ = self.keep().await;
        Err(why)
    }

    /// Outputs have another owner: what was to be done to them is not done any more, except by
    /// `owner`, whose promise begins anew. That is on the disk when this returns; where the disk
    /// refuses, nothing has changed.
    pub(super) async fn take_over(
        &self,
        places: &[Place],
        owner: Option<(u64, Promise)>,
    ) -> io::Result<()> {
        let of = |action: &Action| places.iter().any(|place| action.is_of(place));
        self.hand_over(of, owner).await
    }

    /// The same of what is about this alone, which has no owner any more.
    pub(super) async fn give_up(&self, key: &Key) -> io::Result<()> {
        self.hand_over(|action| action.key == *key, None).await
    }

    async fn hand_over(
        &self,
        of: impl Fn(&Action) -> bool,
        owner: Option<(u64, Promise)>,
    ) -> io::Result<()> {
        let is_owner = |number: u64| owner.is_some_and(|(owner, _)| owner == number);
        let (version, before, taken) = {
            let mut actions = lock(&self.actions);
            let version = actions.version + 1;
            let (mut before, mut taken, mut is_news) = (None, Vec::new(), false);
            for (number, action) in &mut actions.by_number {
                if is_owner(*number) {
                    before = Some(action.promise);
                    action.promise = owner.map_or(action.promise, |(_, promise)| promise);
                    is_news = true;
                } else if of(action) {
                    // What was left out before may be in the file yet.
                    is_news = true;
                    if action.left_out.is_none() {
                        action.left_out = Some(version);
                        taken.push(*number);
                    }
                }
            }
            if !is_news {
                return Ok(());
            }
            actions.version = version;
            (version, before, taken)
        };
        let back = |actions: &mut Actions| {
            for (number, action) in &mut actions.by_number {
                if taken.contains(number) {
                    action.left_out = None;
                }
                if is_owner(*number) {
                    action.promise = before.unwrap_or(action.promise);
                }
            }
        };
        let end = self.keep_or(version, back).await;
        if let Some((owner, _)) = owner {
            lock(&self.actions).set_due(owner);
        }
        end
    }

    /// It is so long from now on until one is done, and that is on the disk when this returns.
    /// False where it can't be put off any more. Where the disk refuses, nothing has changed.
    pub(super) async fn renew(&self, number: u64, length: Duration) -> io::Result<bool> {
        let (version, before) = {
            let mut actions = lock(&self.actions);
            let action = actions.by_number.get_mut(&number);
            let Some(action) = action.filter(|a| a.is_to_be_done() && !a.is_ending) else {
                return Ok(false);
            };
            let anew = Promise::after(length, action.promise.end);
            let before = std::mem::replace(&mut action.promise, anew);
            actions.version += 1;
            (actions.version, before)
        };
        let back = |actions: &mut Actions| {
            if let Some(action) = actions.by_number.get_mut(&number) {
                action.promise = before;
            }
        };
        let end = self.keep_or(version, back).await;
        let is_there = lock(&self.actions).set_due(number);
        end.map(|()| is_there)
    }

    /// Whether it is time for one; if so, it can't be put off any more.
    pub(super) fn time_of(&self, number: u64) -> Time {
        let is_stopping = self.are_stopping();
        let mut actions = lock(&self.actions);
        let action = actions.by_number.get_mut(&number);
        let Some(action) = action.filter(|action| action.is_to_be_done()) else {
            return Time::Over;
        };
        let due = action.due.as_ref().map(|due| *due.borrow());
        action.is_ending |= is_stopping || due.is_some_and(|due| due <= Instant::now());
        match action.is_ending {
            true => Time::Due,
            false => Time::NotYet,
        }
    }

    /// Somebody does now what was to be done later: it can't be put off any more.
    pub(super) fn anticipate(&self, number: u64) {
        if let Some(action) = lock(&self.actions).by_number.get_mut(&number) {
            action.is_ending = true;
        }
    }

    /// One is due now.
    pub(super) fn hasten(&self, number: u64) {
        if let Some(action) = lock(&self.actions).by_number.get_mut(&number) {
            action.is_ending = true;
            if let Some(due) = &action.due {
                due.send_replace(Instant::now());
            }
        }
    }

    /// These are not to be done any more; [`Schedule::keep`] brings that to the disk. Says
    /// whether there were any.
    pub(super) fn leave_out(&self, of: impl Fn(&Key) -> bool) -> bool {
        lock(&self.actions).leave_out(|_, action| of(&action.key))
    }

    /// The same of one.
    pub(super) fn leave_out_one(&self, number: u64) {
        lock(&self.actions).leave_out(|at, _| at == number);
    }

    /// One may have begun. Of those before it that end alike, the first one to end has the say;
    /// where that is put off or over, this one. Those between are not to be done any more, so that
    /// they do not pile up at a module that does not answer.
    pub(super) fn leave_out_between(&self, number: u64) {
        let mut actions = lock(&self.actions);
        let Some(newest) = actions.by_number.get(&number) else {
            return;
        };
        let (key, end) = (newest.key.clone(), newest.promise.end);
        let is_alike = |at: u64, action: &Action| {
            at != number && action.key == key && action.promise.end == end
        };
        let due = |action: &Action| action.due.as_ref().map(|due| *due.borrow());
        let before = actions.by_number.iter();
        let before = before.filter(|(at, action)| is_alike(**at, action) && action.is_to_be_done());
        let first = before.min_by_key(|(_, action)| due(action));
        let first = first.map(|(at, _)| *at);
        actions.leave_out(|at, action| is_alike(at, action) && Some(at) != first);
    }

    /// Nobody sees to one any more, and it is promised still: it is done after a restart.
    pub(super) fn put_aside(&self, number: u64) {
        if let Some(action) = lock(&self.actions).by_number.get_mut(&number) {
            action.due = None;
        }
    }

    /// A pulse or lease of this output that ends in another state, and is not this one.
    pub(super) fn has_other_end(&self, number: u64, place: &Place, end: Option<bool>) -> bool {
        let actions = lock(&self.actions);
        actions.by_number.iter().any(|(other, action)| {
            // One that ends in no state of its own leaves the output to this one.
            let ends = action.promise.end.is_some_and(|other| Some(other) != end);
            let is_other = *other != number && ends;
            is_other && action.is_to_be_done() && action.is_of(place)
        })
    }

    /// The newest of its kind.
    pub(super) fn find(&self, key: &Key) -> Option<(u64, Promise)> {
        let actions = lock(&self.actions);
        let mut newest = actions.by_number.iter().rev();
        newest
            .find(|(_, action)| action.key == *key && action.is_to_be_done())
            .map(|(number, action)| (*number, action.promise))
    }

    /// The pulses and leases of these outputs. Who is asked which of them are meant may look at
    /// the site.
    pub(super) fn held(&self, of: impl Fn(&Place) -> bool) -> Vec<(u64, Key, Promise)> {
        let mut held = Vec::new();
        for (number, action) in &lock(&self.actions).by_number {
            if action.is_to_be_done() && action.key.1 != Why::MaxOn {
                held.push((*number, action.key.clone(), action.promise));
            }
        }
        held.retain(|(_, key, _)| of(&key.0));
        held
    }

    /// Of the outputs that may be on for so long only, those that are. Who is asked which of them
    /// are meant may look at the site.
    pub(super) fn limits(&self, of: impl Fn(&Place) -> bool) -> Vec<Key> {
        let mut limits = Vec::new();
        for action in lock(&self.actions).by_number.values() {
            if action.is_to_be_done() && action.key.1 == Why::MaxOn {
                limits.push(action.key.clone());
            }
        }
        limits.retain(|(place, _)| of(place));
        limits
    }

    /// What failed at a module is tried again now: it is heard again.
    pub(super) fn try_again(&self, of: impl Fn(&str) -> bool) {
        let actions = lock(&self.actions);
        let ending = actions.by_number.values().filter(|a| a.is_ending);
        for action in ending.filter(|action| of(&action.key.0.module)) {
            if let Some(due) = &action.due {
                due.send_modify(|_| {});
            }
        }
    }

    /// How long it is until it is done, where there is one.
    pub(super) fn due(&self, key: &Key) -> Option<Duration> {
        let actions = lock(&self.actions);
        let each = actions.by_number.values();
        let of_key = each.filter(|action| action.key == *key && action.is_to_be_done());
        let due = of_key.filter_map(|action| action.due.as_ref().map(|due| *due.borrow()));
        due.min()
            .map(|due| due.saturating_duration_since(Instant::now()))
    }

    /// How long it is until anything is done to an output.
    pub(super) fn left(&self, place: &Place) -> Left {
        if place.point.kind != PointKind::Output {
            return Left::default();
        }
        let due = |why| self.due(&(place.clone(), why));
        Left {
            pulse: due(Why::Pulse),
            lease: due(Why::Lease),
            max_on: due(Why::MaxOn),
        }
    }

    /// Says how long outputs must stay off yet, in place of what was said before.
    pub(super) async fn must_stay_off(&self, outputs: Vec<(Place, Duration)>) {
        let off = outputs.into_iter();
        let off = off.map(|(place, left)| (place, Promise::after(left, None)));
        {
            let mut actions = lock(&self.actions);
            actions.off = off.collect();
            actions.version += 1;
        }
        let _ = self.keep().await;
    }

    /// Whether the site is being closed.
    pub(super) fn are_stopping(&self) -> bool {
        *self.stop.borrow()
    }

    /// Waits for that.
    pub(super) async fn stopping(&self) {
        let mut stop = self.stop.subscribe();
        // Fails only where the site has gone.
        let _ = stop.wait_for(|stop| *stop).await;
    }

    /// Waits until none is seen to.
    pub(super) async fn all_ended(&self) {
        let mut running = self.running.subscribe();
        // Fails only where the site has gone.
        let _ = running.wait_for(|count| *count == 0).await;
    }

    /// Ends all of them now, and waits for that as long as may be.
    pub(super) async fn stop_all(&self) {
        self.stop.send_replace(true);
        let _ = tokio::time::timeout(STOP_MAX, self.all_ended()).await;
    }
}

impl Actions {
    fn add(&mut self, key: Key, promise: Promise, due: Option<watch::Sender<Instant>>) -> u64 {
        self.newest += 1;
        self.version += 1;
        let action = Action {
            key,
            promise,
            due,
            is_ending: false,
            left_out: None,
        };
        self.by_number.insert(self.newest, action);
        self.newest
    }

    /// One is due when its promise says. False where there is none any more.
    fn set_due(&mut self, number: u64) -> bool {
        let Some(action) = self.by_number.get(&number) else {
            return false;
        };
        if let Some(due) = &action.due {
            due.send_replace(Instant::now() + action.promise.left());
        }
        true
    }

    fn leave_out(&mut self, of: impl Fn(u64, &Action) -> bool) -> bool {
        let version = self.version + 1;
        let mut is_any = false;
        for (number, action) in &mut self.by_number {
            if action.is_to_be_done() && of(*number, action) {
                (action.left_out, action.due) = (Some(version), None);
                is_any = true;
            }
        }
        if is_any {
            self.version = version;
        }
        // Where the disk refuses for long: the newest of its kind says that the file may have one.
        let gone: Vec<(u64, Key)> = self
            .by_number
            .iter()
            .filter(|(_, action)| action.due.is_none() && !action.is_to_be_done())
            .map(|(number, action)| (*number, action.key.clone()))
            .collect();
        for (number, key) in &gone {
            if gone
                .iter()
                .any(|(newer, other)| newer > number && other == key)
            {
                self.by_number.remove(number);
            }
        }
        is_any
    }

    fn promises(&self) -> Vec<Kept> {
        let actions = self.by_number.values();
        let actions = actions.filter(|action| action.is_to_be_done());
        let actions = actions.map(|action| (action.key.clone(), action.promise));
        let off = self.off.iter();
        let off = off.map(|(place, promise)| ((place.clone(), Why::MinOff), *promise));
        let each = actions.chain(off).map(|(key, promise)| {
            let board = self.boards.get(&key.0.module).cloned();
            (key, promise, board)
        });
        each.collect()
    }
}

#[cfg(test)]
mod tests;
