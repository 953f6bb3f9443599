//! Scheduled actions on outputs. The action of a pulse or a lease is cancelled once another command
//! was carried out, and that is on the disk before it is reported.

use super::Now;
use super::context::{Context, TaskId};
use super::disk::Disk;
use super::own_pulses::OwnPulses;
use super::promises::{Board, Boards, Kept, Key, Promise, Why};
use super::state::State;
use crate::Left;
use crate::config::Place;
use railbus_device::Point;
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};
use std::future::poll_fn;
use std::io::ErrorKind;
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

/// How long closing the site may take to release its pulses.
pub(crate) const STOP_MAX: Micros = Micros::from_millis(1_400);

/// All that is to be done later, and what of it the disk has.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    newest: u64,
    pub(super) by_number: BTreeMap<u64, Action>,
    /// For how long outputs must stay off. Nothing is done then.
    off: Vec<(Place, Promise)>,
    /// What the names of modules stand for.
    pub(super) boards: Boards,
    /// Pulses that modules time by themselves. Nothing is done at their end.
    pub(super) own_pulses: OwnPulses,
    /// Promises for boards whose name is another board's now, or no one's. They stay on the disk
    /// until the dropped end has been reported.
    dropped: Vec<(Key, Promise, Board)>,
    /// How many are seen to.
    running: usize,
    /// Who waits until none is.
    pub(super) idle: BTreeSet<TaskId>,
    /// The site is being closed.
    pub(super) is_stopping: bool,
    /// Who waits for that.
    stops: BTreeSet<TaskId>,
    pub(super) disk: Disk,
    /// Whose wait may be over since this was last taken.
    pub(super) woken: Vec<TaskId>,
}

/// Something that is to be done to an output.
#[derive(Debug)]
pub(super) struct Action {
    key: Key,
    promise: Promise,
    /// When it is due, in the time of the site; none where nobody sees to it.
    due: Option<Micros>,
    /// The procedure that sees to it.
    pub(super) task: Option<TaskId>,
    /// What failed is to be tried again at once.
    again: bool,
    /// The output is being released, or about to be: it is too late to put that off.
    is_ending: bool,
    /// It is not to be done any more, and the file does not have it from this version on. Until
    /// then it stays here.
    pub(super) left_out: Option<u64>,
}

impl Action {
    fn is_of(&self, place: &Place) -> bool {
        !matches!(self.key.1, Why::MaxOn | Why::MinOff | Why::OwnPulse) && self.key.0 == *place
    }

    const fn is_to_be_done(&self) -> bool {
        self.left_out.is_none()
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

/// One is seen to until this is dropped.
#[derive(Debug)]
pub(super) struct Running(Context);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.with(|state| {
            let schedule = &mut state.schedule;
            schedule.running = schedule.running.saturating_sub(1);
            if schedule.running == 0 {
                schedule.woken.extend(std::mem::take(&mut schedule.idle));
            }
        });
    }
}

impl Schedule {
    /// What was written down before, to which nobody sees yet. The end of another board's output
    /// is not done to the one that has its name now.
    pub(super) fn new(known: Vec<Kept>, boards: Boards, now: Now) -> Schedule {
        let mut schedule = Schedule::default();
        for (key, promise, board) in known {
            if key.1 == Why::OwnPulse {
                let kept = (key, promise, board);
                schedule.own_pulses.take_up(&kept, &boards, now);
                continue;
            }
            if let Some(board) = board
                && boards.get(&key.0.module) != Some(&board)
            {
                schedule.dropped.push((key, promise, board));
                continue;
            }
            match key.1 {
                Why::MinOff => schedule.off.push((key.0, promise)),
                _ => _ = schedule.insert(key, promise, None),
            }
        }
        schedule.boards = boards;
        schedule
    }

    fn insert(&mut self, key: Key, promise: Promise, due: Option<Micros>) -> u64 {
        self.newest += 1;
        self.disk.version += 1;
        let action = Action {
            key,
            promise,
            due,
            task: None,
            again: false,
            is_ending: false,
            left_out: None,
        };
        self.by_number.insert(self.newest, action);
        self.newest
    }

    /// One more, as from now on. Of the longest times that an output may be on there is one, and
    /// of its policies. [`Context::keep`] brings it to the disk.
    fn add(&mut self, key: Key, promise: Promise, due: Micros) -> u64 {
        let gives_way = |why: Why| match key.1 {
            Why::MaxOn => why == Why::MaxOn,
            newer => newer.is_policy() && why.is_policy(),
        };
        self.leave_out_where(|_, action| action.key.0 == key.0 && gives_way(action.key.1));
        self.insert(key, promise, Some(due))
    }

    /// From now on names stand for these boards; [`Context::keep`] brings that to the disk.
    pub(super) fn now_of(&mut self, boards: Boards, is_other: impl Fn(&str) -> bool, now: Micros) {
        let pulses = &mut self.own_pulses;
        pulses.reconfigure(&self.boards, &boards, is_other, now);
        self.boards = boards;
        let is_any = !self.by_number.is_empty() || !self.off.is_empty();
        if is_any || self.own_pulses.any(now) {
            self.disk.version += 1;
        }
    }

    /// What was promised of boards that have another name or none now; told once.
    pub(super) fn take_dropped(&mut self) -> Vec<(Key, Board)> {
        let dropped = std::mem::take(&mut self.dropped);
        if !dropped.is_empty() {
            self.disk.version += 1;
            self.disk.soon = true;
        }
        let told = dropped.into_iter().map(|(key, _, board)| (key, board));
        told.collect()
    }

    /// What is to be done to these outputs can't be done any more: their boards, which are these,
    /// lose their names. [`Schedule::take_dropped`] has it then, once of an output.
    pub(super) fn drop_of(&mut self, boards: &Boards, is_other: impl Fn(&Place) -> bool) {
        for action in self.by_number.values() {
            let Action { key, .. } = action;
            if let Some(board) = boards.get(&key.0.module)
                && action.is_to_be_done()
                && is_other(&key.0)
            {
                let is_there = |(other, _, at): &(Key, Promise, Board)| other == key && at == board;
                if !self.dropped.iter().any(is_there) {
                    let one = (key.clone(), action.promise, board.clone());
                    self.dropped.push(one);
                }
            }
        }
        self.leave_out(|key| is_other(&key.0));
    }

    /// These are not to be done any more; [`Context::keep`] brings that to the disk.
    pub(super) fn leave_out(&mut self, of: impl Fn(&Key) -> bool) {
        self.leave_out_where(|_, action| of(&action.key));
    }

    /// The same of one.
    pub(super) fn leave_out_one(&mut self, number: u64) {
        self.leave_out_where(|at, _| at == number);
    }

    fn leave_out_where(&mut self, of: impl Fn(u64, &Action) -> bool) {
        let version = self.disk.version + 1;
        let mut is_any = false;
        for (number, action) in &mut self.by_number {
            if action.is_to_be_done() && of(*number, action) {
                (action.left_out, action.due) = (Some(version), None);
                self.woken.extend(action.task);
                is_any = true;
            }
        }
        if is_any {
            self.disk.version = version;
            self.disk.soon = true;
        }
        // Where the disk refuses for long: the newest of its kind says that the file may have one.
        let gone: Vec<(u64, Key)> = self
            .by_number
            .iter()
            .filter(|(_, action)| action.due.is_none() && !action.is_to_be_done())
            .map(|(number, action)| (*number, action.key.clone()))
            .collect();
        for (number, key) in &gone {
            let has_newer = |(newer, other): &(u64, Key)| newer > number && other == key;
            if gone.iter().any(has_newer) {
                self.by_number.remove(number);
            }
        }
    }

    /// One may have begun. Of those before it that end alike, the first one to end has the say;
    /// where that is put off or over, this one. Those between are not to be done any more, so that
    /// they do not pile up at a module that does not answer.
    pub(super) fn leave_out_between(&mut self, number: u64) {
        let Some(newest) = self.by_number.get(&number) else {
            return;
        };
        let (key, end) = (newest.key.clone(), newest.promise.end);
        let is_alike = |at: u64, action: &Action| {
            at != number && action.key == key && action.promise.end == end
        };
        let before = self.by_number.iter();
        let before = before.filter(|(at, action)| is_alike(**at, action) && action.is_to_be_done());
        let first = before.min_by_key(|(_, action)| action.due);
        let first = first.map(|(at, _)| *at);
        self.leave_out_where(|at, action| is_alike(at, action) && Some(at) != first);
    }

    /// These may be switched on; [`Context::keep`] brings that to the disk. Says whether that is
    /// to be done.
    pub(super) fn forget_off(&mut self, outputs: &[Place]) -> bool {
        let before = self.off.len();
        self.off.retain(|(place, _)| !outputs.contains(place));
        let is_news = self.off.len() < before;
        self.disk.version += u64::from(is_news);
        is_news
    }

    /// Somebody does now what was to be done later: it can't be put off any more.
    pub(super) fn anticipate(&mut self, number: u64) {
        if let Some(action) = self.by_number.get_mut(&number) {
            action.is_ending = true;
        }
    }

    /// One is due now.
    pub(super) fn hasten(&mut self, number: u64, now: Micros) {
        if let Some(action) = self.by_number.get_mut(&number) {
            action.is_ending = true;
            if let Some(due) = &mut action.due {
                (*due, action.again) = (now, true);
                self.woken.extend(action.task);
            }
        }
    }

    /// Nobody sees to one any more, and it is promised still: it is done after a restart.
    pub(super) fn put_aside(&mut self, number: u64) {
        if let Some(action) = self.by_number.get_mut(&number) {
            action.due = None;
        }
    }

    /// A pulse or lease of this output that ends in another state, and is not this one.
    pub(super) fn has_other_end(&self, number: u64, place: &Place, end: Option<bool>) -> bool {
        self.by_number.iter().any(|(other, action)| {
            // One that ends in no state of its own leaves the output to this one.
            let ends = action.promise.end.is_some_and(|other| Some(other) != end);
            let is_other = *other != number && ends;
            is_other && action.is_to_be_done() && action.is_of(place)
        })
    }

    /// The newest of its kind.
    pub(super) fn find(&self, key: &Key) -> Option<(u64, Promise)> {
        let mut newest = self.by_number.iter().rev();
        newest
            .find(|(_, action)| action.key == *key && action.is_to_be_done())
            .map(|(number, action)| (*number, action.promise))
    }

    /// The pulses, leases and policies of these outputs that are to be done.
    pub(super) fn held(&self, of: impl Fn(&Place) -> bool) -> Vec<(u64, Key, Promise)> {
        let held = self.by_number.iter().filter(|(_, action)| {
            action.is_to_be_done() && action.key.1 != Why::MaxOn && of(&action.key.0)
        });
        held.map(|(number, action)| (*number, action.key.clone(), action.promise))
            .collect()
    }

    /// Of the outputs that may be on for so long only, those that are.
    pub(super) fn limits(&self, of: impl Fn(&Place) -> bool) -> Vec<Key> {
        let limits = self.by_number.values().filter(|action| {
            action.is_to_be_done() && action.key.1 == Why::MaxOn && of(&action.key.0)
        });
        limits.map(|action| action.key.clone()).collect()
    }

    /// What failed at a module is tried again now: it is heard again.
    pub(super) fn try_again(&mut self, of: impl Fn(&str) -> bool) {
        let ending = self.by_number.values_mut().filter(|a| a.is_ending);
        for action in ending.filter(|action| of(&action.key.0.module)) {
            if action.due.is_some() {
                action.again = true;
                self.woken.extend(action.task);
            }
        }
    }

    /// When the first of these is due, in the time of the site.
    fn due(&self, key: &Key) -> Option<Micros> {
        let each = self.by_number.values();
        let of_key = each.filter(|action| action.key == *key && action.is_to_be_done());
        of_key.filter_map(|action| action.due).min()
    }

    /// What people are told of that is due, and when, in the time of the site.
    pub(super) fn ends(&self) -> impl Iterator<Item = (&Key, Micros)> {
        let told = |why| matches!(why, Why::Pulse | Why::Lease | Why::MaxOn);
        let actions = self.by_number.values().filter(|a| a.is_to_be_done());
        let actions = actions.filter(move |action| told(action.key.1));
        actions.filter_map(|action| Some((&action.key, action.due?)))
    }

    pub(super) fn promises(&self, now: Now) -> Vec<Kept> {
        let actions = self.by_number.values();
        let actions = actions.filter(|action| action.is_to_be_done());
        let actions = actions.map(|action| (action.key.clone(), action.promise));
        let off = self.off.iter();
        let off = off.map(|(place, promise)| ((place.clone(), Why::MinOff), *promise));
        let each = actions.chain(off).map(|(key, promise)| {
            let board = self.boards.get(&key.0.module).cloned();
            (key, promise, board)
        });
        let dropped = self.dropped.iter().cloned();
        let dropped = dropped.map(|(key, promise, board)| (key, promise, Some(board)));
        let own = self.own_pulses.kept(&self.boards, now);
        each.chain(dropped).chain(own).collect()
    }

    /// The site is being closed: whoever sees to something is told.
    pub(super) fn stop(&mut self) {
        self.is_stopping = true;
        self.woken.extend(std::mem::take(&mut self.stops));
        let tasks = self.by_number.values().filter_map(|action| action.task);
        self.woken.extend(tasks);
    }

    /// Nobody waits for the end of the site, or of all that is seen to.
    #[cfg(test)]
    pub(super) fn nobody_waits(&self) -> bool {
        self.stops.is_empty() && self.idle.is_empty()
    }

    /// How many are known, those included that the disk may still have.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.by_number.len()
    }
}

impl State {
    /// How long it is until one is due, where there is one.
    pub(super) fn time_to(&self, key: &Key) -> Option<Duration> {
        let due = self.schedule.due(key)?;
        Some(Duration::from_micros((due - self.now.site).0))
    }

    /// How long it is until anything is done to an output.
    pub(crate) fn left(&self, module: &str, point: Point) -> Left {
        let is_here = |at: &Place| at.point == point && at.module == module;
        let mut left = Left::default();
        for ((_, why), due) in self.schedule.ends().filter(|((at, _), _)| is_here(at)) {
            let first = match why {
                Why::Pulse => &mut left.pulse,
                Why::Lease => &mut left.lease,
                Why::MaxOn => &mut left.max_on,
                Why::OnReturn | Why::MinOff | Why::OwnPulse => continue,
            };
            let time = Duration::from_micros((due - self.now.site).0);
            *first = Some(first.map_or(time, |first| first.min(time)));
        }
        left
    }

    /// Whether it is time for one; if so, it can't be put off any more.
    pub(super) fn time_of(&mut self, number: u64) -> Time {
        let (now, is_stopping) = (self.now.site, self.schedule.is_stopping);
        let action = self.schedule.by_number.get_mut(&number);
        let Some(action) = action.filter(|action| action.is_to_be_done()) else {
            return Time::Over;
        };
        action.is_ending |= is_stopping || action.due.is_some_and(|due| due <= now);
        match action.is_ending {
            true => Time::Due,
            false => Time::NotYet,
        }
    }

    /// When a promise is due, in the time of the site.
    fn due_of(&self, promise: &Promise) -> Micros {
        let left = promise.left(self.now.wall).as_micros();
        self.now.site + Micros(u64::try_from(left).unwrap_or(u64::MAX))
    }

    /// One is due when its promise says. False where there is none any more.
    fn set_due(&mut self, number: u64) -> bool {
        let promise = self.schedule.by_number.get(&number).map(|a| a.promise);
        let due = promise.map(|promise| self.due_of(&promise));
        let Some((action, at)) = self.schedule.by_number.get_mut(&number).zip(due) else {
            return false;
        };
        if let Some(due) = &mut action.due {
            (*due, action.again) = (at, true);
            self.schedule.woken.extend(action.task);
        }
        true
    }

    /// When one is due; none where nobody sees to it any more. One that is being handed over is
    /// seen to until that is on the disk: it may be taken back.
    pub(super) fn due_at(&self, number: u64) -> Option<Micros> {
        self.schedule.by_number.get(&number)?.due
    }

    /// Whether what failed is to be tried again now.
    pub(super) fn takes_again(&mut self, number: u64) -> bool {
        let action = self.schedule.by_number.get_mut(&number);
        action.is_some_and(|action| std::mem::take(&mut action.again))
    }

    /// The current procedure sees to one.
    pub(super) fn sees_to(&mut self, number: u64) {
        let task = self.runs.current;
        if let Some(action) = self.schedule.by_number.get_mut(&number) {
            action.task = Some(task);
        }
    }

    /// Those of the process before this one, to be seen to from now on.
    pub(super) fn take_up(&mut self) -> Vec<(u64, Key, Promise)> {
        let wall = self.now.wall;
        let mut begun = Vec::new();
        for (number, action) in &mut self.schedule.by_number {
            action.promise = action.promise.at_most_its_length(wall);
            begun.push((*number, action.key.clone(), action.promise));
        }
        for (number, _, promise) in &begun {
            let due = self.due_of(promise);
            if let Some(action) = self.schedule.by_number.get_mut(number) {
                action.due = Some(due);
            }
        }
        self.schedule.disk.version += 1;
        self.schedule.disk.soon |= !begun.is_empty();
        begun
    }

    /// For how long outputs must stay off by what was written down.
    pub(super) fn kept_off(&self) -> Vec<(Place, Micros)> {
        let off = self.schedule.off.iter();
        let off = off.map(|(place, promise)| {
            let left = promise.left(self.now.wall).as_micros();
            (
                place.clone(),
                Micros(u64::try_from(left).unwrap_or(u64::MAX)),
            )
        });
        off.collect()
    }

    /// Writes down how long outputs must stay off yet, in place of what was said before, where
    /// that is said of one of these.
    pub(super) fn keep_off_of<'a>(&mut self, outputs: impl IntoIterator<Item = &'a Place>) {
        let config = self.site.config();
        let min_off = |place: &Place| config.safety(place).is_some_and(|s| s.min_off.is_some());
        if !outputs.into_iter().any(min_off) {
            return;
        }
        let wall = self.now.wall;
        let off = self.must_stay_off().into_iter();
        let off = off.map(|(place, left)| (place, Promise::after(wall, left, None)));
        self.schedule.off = off.collect();
        self.schedule.disk.version += 1;
        self.schedule.disk.soon = true;
    }
}

impl Context {
    /// One more that is seen to, as from now on; [`Context::keep`] brings it to the disk.
    pub(super) fn schedule(&self, key: Key, promise: Promise) -> (u64, Running) {
        let number = self.with(|state| {
            let due = state.due_of(&promise);
            state.schedule.add(key, promise, due)
        });
        (number, self.running())
    }

    pub(super) fn running(&self) -> Running {
        self.with(|state| state.schedule.running += 1);
        Running(self.clone())
    }

    /// The same for one change, which is taken back where the disk refuses.
    async fn keep_or(&self, back: impl FnOnce(&mut Schedule)) -> Result<(), ErrorKind> {
        let Err(why) = self.keep().await else {
            return Ok(());
        };
        // Nothing is written between the end of a write and those who waited for it.
        self.with(|state| {
            back(&mut state.schedule);
            state.schedule.disk.version += 1;
        });
        // A write that failed at its last step may be in the file all the same.
        let _ = self.keep().await;
        Err(why)
    }

    /// Outputs have another owner: what was to be done to them is not done any more, except by
    /// `owner`, whose promise begins anew. That is on the disk when this returns; where the disk
    /// refuses, nothing has changed.
    pub(super) async fn hand_outputs_over(
        &self,
        places: &[Place],
        owner: Option<(u64, Promise)>,
    ) -> Result<(), ErrorKind> {
        let of = |action: &Action| places.iter().any(|place| action.is_of(place));
        self.hand_over(of, owner).await
    }

    /// The same of what is about this alone, which has no owner any more.
    pub(super) async fn give_up(&self, key: &Key) -> Result<(), ErrorKind> {
        self.hand_over(|action| action.key == *key, None).await
    }

    async fn hand_over(
        &self,
        of: impl Fn(&Action) -> bool,
        owner: Option<(u64, Promise)>,
    ) -> Result<(), ErrorKind> {
        let is_owner = |number: u64| owner.is_some_and(|(owner, _)| owner == number);
        let changed = self.with(|state| {
            let schedule = &mut state.schedule;
            let version = schedule.disk.version + 1;
            let (mut before, mut taken, mut is_news) = (None, Vec::new(), false);
            for (number, action) in &mut schedule.by_number {
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
            if is_news {
                schedule.disk.version = version;
            }
            is_news.then_some((before, taken))
        });
        let Some((before, taken)) = changed else {
            return Ok(());
        };
        let back = |schedule: &mut Schedule| {
            for (number, action) in &mut schedule.by_number {
                if taken.contains(number) {
                    action.left_out = None;
                }
                if is_owner(*number) {
                    action.promise = before.unwrap_or(action.promise);
                }
            }
        };
        let end = self.keep_or(back).await;
        self.with(|state| {
            if let Some((owner, _)) = owner {
                state.set_due(owner);
            }
        });
        end
    }

    /// It is so long from now on until one is done, and that is on the disk when this returns.
    /// False where it can't be put off any more. Where the disk refuses, nothing has changed.
    pub(super) async fn renew(&self, number: u64, length: Duration) -> Result<bool, ErrorKind> {
        let before = self.with(|state| {
            let wall = state.now.wall;
            let action = state.schedule.by_number.get_mut(&number);
            let action = action.filter(|a| a.is_to_be_done() && !a.is_ending)?;
            let anew = Promise::after(wall, length, action.promise.end);
            let before = std::mem::replace(&mut action.promise, anew);
            state.schedule.disk.version += 1;
            Some(before)
        });
        let Some(before) = before else {
            return Ok(false);
        };
        let back = |schedule: &mut Schedule| {
            if let Some(action) = schedule.by_number.get_mut(&number) {
                action.promise = before;
            }
        };
        let end = self.keep_or(back).await;
        let is_there = self.with(|state| state.set_due(number));
        end.map(|()| is_there)
    }

    /// Waits until the site is being closed.
    pub(super) async fn stopping(&self) {
        let is_stopping = |state: &mut State| state.schedule.is_stopping;
        self.wait_in(|state| &mut state.schedule.stops, is_stopping)
            .await;
    }

    /// Does something unless the site begins to end before it is done; it is dropped then.
    pub(super) async fn unless_stopping<T>(&self, what: impl Future<Output = T>) -> Option<T> {
        let (mut stops, mut what) = (pin!(self.stopping()), pin!(what));
        poll_fn(|cx| match stops.as_mut().poll(cx) {
            Poll::Ready(()) => Poll::Ready(None),
            Poll::Pending => what.as_mut().poll(cx).map(Some),
        })
        .await
    }

    /// Waits until none is seen to.
    pub(crate) async fn all_ended(&self) {
        let is_idle = |state: &mut State| state.schedule.running == 0;
        self.wait_in(|state| &mut state.schedule.idle, is_idle)
            .await;
        self.answer_behind_all();
    }

    /// Ends all of them now. Gives back until when that may take.
    pub(super) fn stop(&self) -> Micros {
        self.with(|state| {
            state.schedule.stop();
            state.now.site + STOP_MAX
        })
    }
}
