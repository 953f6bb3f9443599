//! What is done to an output later: the end of a pulse, of a lease, or of the longest time that
//! it may be on; and what its policy wants, which may take more than one try. Nothing of it
//! depends on who asked for it.

use super::command::{Entry, Order, TTL, channel};
use super::promises::{Key, Promise, Why};
use super::schedule::{STOP_MAX, Time, Watched};
use super::turn::Turn;
use super::{Inner, lock};
use crate::config::Place;
use crate::{Change, Failure, Value, WriteDone};
use railbus_device::{Bank, Op, Point, PointKind};
use railbus_host::{Confirmed, Fault, Line, ModuleId};
use railbus_store::audit::Note;
use railbus_store::audit::Origin;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::task::JoinSet;
use tokio::time::Instant;

/// An output that could not be released is tried again after this time, then after twice as
/// long, and so on.
const RETRY: Duration = Duration::from_secs(1);
/// The longest time between two tries.
const RETRY_MAX: Duration = Duration::from_secs(60);
/// How often a release is tried when the site ends.
const STOP_TRIES: u8 = 3;

/// Something that is done to an output later.
pub(super) struct Timer {
    inner: Arc<Inner>,
    key: Key,
    promise: Promise,
    watched: Watched,
    /// The turn that it has at its first try, if any.
    turn: Option<Turn>,
    /// Closed once it was tried.
    tried: Option<oneshot::Sender<()>>,
}

/// How an output is switched now, of which the end comes later.
pub(super) struct Begin {
    pub(super) key: Key,
    pub(super) value: bool,
    pub(super) end: Option<bool>,
    pub(super) length: Duration,
    pub(super) note: Note,
    pub(super) expires: Instant,
}

impl Timer {
    pub(super) fn new(inner: &Arc<Inner>, key: Key, promise: Promise) -> Timer {
        let watched = inner.schedule.add(key.clone(), promise);
        Timer {
            inner: Arc::clone(inner),
            key,
            promise,
            watched,
            turn: None,
            tried: None,
        }
    }

    /// It is due, and has its turn; closes this once it was tried.
    pub(super) fn at_once(mut self, turn: Turn, tried: oneshot::Sender<()>) -> Timer {
        (self.turn, self.tried) = (Some(turn), Some(tried));
        self
    }

    pub(super) const fn number(&self) -> u64 {
        self.watched.number
    }

    /// Runs from when it is promised on. What the disk refuses holds as long as the process does.
    pub(super) async fn promised(self) {
        let _ = self.inner.schedule.keep().await;
        self.run();
    }

    fn run(self) {
        tokio::spawn(self.waiting());
    }

    /// [`Timer::wait`], which ends in a command that may begin another timer.
    fn waiting(self) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        Box::pin(self.wait())
    }

    /// Waits until the time has come, and does what was promised.
    async fn wait(mut self) {
        while self.time_comes().await {
            if self.release().await {
                return;
            }
        }
    }

    /// Says whether anything is to be done.
    async fn time_comes(&mut self) -> bool {
        let Watched {
            number, due, stop, ..
        } = &mut self.watched;
        loop {
            let at = *due.borrow_and_update();
            tokio::select! {
                biased;
                changed = due.changed() => {
                    if changed.is_err() {
                        return false;
                    }
                }
                () = tokio::time::sleep_until(at) => return true,
                _ = stop.wait_for(|stop| *stop) => {
                    let goes_on = self.key.1 == Why::MaxOn;
                    if goes_on {
                        self.inner.schedule.put_aside(*number);
                    }
                    return !goes_on;
                }
            }
        }
    }

    /// Brings the output back, however often that takes. False where it was put off.
    async fn release(&mut self) -> bool {
        let mut entry = Entry::of_release(self.inner.note_of_end(&self.key, &self.promise));
        let is_over = self.try_release(&mut entry).await;
        self.inner.close(entry).await;
        is_over
    }

    async fn try_release(&mut self, entry: &mut Entry) -> bool {
        let (place, number) = (&self.key.0, self.watched.number);
        let mut pause = RETRY;
        let mut tries_when_stopping = 0;
        loop {
            let turn = match self.turn.take() {
                Some(turn) => turn,
                None => self.inner.turn_to_end([place.clone()]).await,
            };
            // Before it is asked whether that is to be done: a reload leaves it out, and then the
            // name may be that of another board.
            let at = self.inner.place(&place.module);
            match self.inner.schedule.time_of(number) {
                Time::Over => return true,
                Time::NotYet => return false,
                Time::Due => {}
            }
            let promised = (&self.key, &self.promise);
            if self.inner.release(&turn, at, promised, entry).await {
                self.inner.schedule.leave_out_one(number);
                let _ = self.inner.schedule.keep().await;
                return true;
            }
            drop(turn);
            self.tried = None;
            let Watched { due, stop, .. } = &mut self.watched;
            let stopping = *stop.borrow();
            if stopping {
                tries_when_stopping += 1;
                if tries_when_stopping >= STOP_TRIES {
                    // It is done when the site starts again.
                    self.inner.schedule.put_aside(number);
                    return true;
                }
            }
            tokio::select! {
                changed = due.changed() => {
                    if changed.is_err() {
                        return true;
                    }
                    // Its module is heard again.
                    pause = RETRY;
                }
                () = tokio::time::sleep(pause) => pause = (pause * 2).min(RETRY_MAX),
                _ = stop.wait_for(|stop| *stop), if !stopping => {}
            }
        }
    }
}

impl Inner {
    /// Begins something whose end comes later: that is promised before the first frame goes out.
    /// Gives back how long it is until then.
    pub(super) async fn begin_timed(
        self: &Arc<Inner>,
        turn: &Turn,
        begin: Begin,
    ) -> Result<(WriteDone, Duration), Failure> {
        let Begin {
            key,
            value,
            end,
            length,
            note,
            expires,
        } = begin;
        let op = Op::Write(Bank::one(channel(key.0.point)?, value));
        let timer = Timer::new(self, key, Promise::after(length, end));
        let (place, number) = (&timer.key.0, timer.watched.number);
        let kept = match self.schedule.are_stopping() {
            // Nobody would wait for its end.
            true => Err(Fault::Closed.into()),
            false => {
                let kept = self.schedule.keep().await;
                kept.map_err(|why| Failure::NotKept(why.kind()))
            }
        };
        let begun = match kept {
            Ok(()) => {
                let order = Order {
                    module: &place.module,
                    at: self.place(&place.module),
                    points: &[place.point],
                    op,
                    verify: true,
                    expires,
                };
                let wanted = |_| Some(value);
                self.command(turn, order, &mut Entry::new(note), wanted)
                    .await
            }
            Err(failure) => Err(failure),
        };
        let begun = match begun {
            Ok(done) => {
                let is_alone = self.schedule.held(|other| other == place).len() < 2;
                // From now on: that it was asked for long before does not make it shorter.
                let anew = Promise::after(length, end);
                let taken = self
                    .schedule
                    .take_over(std::slice::from_ref(place), Some((number, anew)))
                    .await;
                match taken {
                    Err(why) if !is_alone => Err(Failure::NotTakenOver(why.kind())),
                    // Where the disk refuses, it ends as was written down before.
                    _ => {
                        let left = self.schedule.due(&timer.key).unwrap_or_default();
                        Ok((done, left))
                    }
                }
            }
            Err(failure) => {
                // An older one was surely begun, and has the say.
                let is_other = self.schedule.has_other_end(number, place, end);
                if !failure.may_have_acted() || is_other {
                    self.schedule.leave_out_one(number);
                    let _ = self.schedule.keep().await;
                    return Err(failure);
                }
                self.schedule.leave_out_between(number);
                let _ = self.schedule.renew(number, length).await;
                Err(failure)
            }
        };
        timer.run();
        begun
    }

    /// Brings an output where a promise wants it; says whether that is over. Whose the output
    /// was, does not matter any more then.
    async fn release(
        self: &Arc<Inner>,
        turn: &Turn,
        at: Option<(Line, ModuleId)>,
        (key, promise): (&Key, &Promise),
        entry: &mut Entry,
    ) -> bool {
        let Place { module, point } = &key.0;
        let (Some(on), Ok(channel)) = (promise.end, channel(*point)) else {
            return true;
        };
        if key.1.is_policy() && self.policy(&key.0) != Some(on) {
            // There is another configuration by now.
            return true;
        }
        let order = Order {
            module,
            at,
            points: &[*point],
            op: Op::Write(Bank::one(channel, on)),
            verify: true,
            expires: Instant::now() + TTL,
        };
        let wanted = |_| Some(on);
        let end = self.command(turn, order, entry, wanted).await;
        match end {
            Ok(done) if is_released(&done) => {
                let is_of =
                    |other: &Key| other.0 == key.0 && matches!(other.1, Why::Pulse | Why::Lease);
                self.schedule.leave_out(is_of);
                true
            }
            Err(Failure::Interlock { .. }) if key.1.is_policy() => !self.comes_free(key),
            // What was acknowledged and not seen is not believed. Who locks an output does not keep
            // it from its end, which was promised before.
            _ => matches!(
                self.writable(module, &[*point]),
                Err(Failure::NoSuchModule | Failure::NoSuchPoint | Failure::NotAnOutput(_))
            ),
        }
    }

    /// Ends the pulses and leases of these outputs now, as far as that can be in a moment: of those
    /// whose turn comes within this time. Nobody commands them until the turns are dropped. The
    /// others, and those that could not be ended, come back.
    pub(super) async fn end_now(
        self: &Arc<Inner>,
        of: impl Fn(&Place) -> bool,
        patience: Duration,
    ) -> (Vec<Arc<Turn>>, Vec<u64>) {
        let until = Instant::now() + patience;
        let mut ending = JoinSet::new();
        for place in self.outputs().into_iter().filter(&of) {
            ending.spawn(Arc::clone(self).end_in_turn(place, until));
        }
        let mut turns = Vec::new();
        while let Some(end) = ending.join_next().await {
            // Fails only where the runtime itself ends.
            turns.extend(end.ok().flatten());
        }
        let _ = self.schedule.keep().await;
        let left = self.schedule.held(of).into_iter();
        (turns, left.map(|(number, ..)| number).collect())
    }

    /// The same of one output: it waits for none of the others.
    async fn end_in_turn(self: Arc<Inner>, place: Place, until: Instant) -> Option<Arc<Turn>> {
        let turn = tokio::time::timeout_at(until, self.turn_to_end([place.clone()])).await;
        let turn = Arc::new(turn.ok()?);
        // A command that had its turn still has gone out, and what it began is known.
        let held = self.schedule.held(|other| *other == place);
        // Who waits for this does not wait for long, and may have another board by that name then.
        let at = self.place(&place.module);
        let in_turn = Arc::clone(&turn);
        let ending = tokio::spawn(async move {
            for (number, key, promise) in held {
                if self.schedule.time_of(number) == Time::Over {
                    continue;
                }
                self.schedule.anticipate(number);
                let mut entry = Entry::of_release(self.note_of_end(&key, &promise));
                let (at, promised) = (at.clone(), (&key, &promise));
                if self.release(&in_turn, at, promised, &mut entry).await {
                    self.schedule.leave_out_one(number);
                }
            }
        });
        // What was sent has its end all the same, and is written down.
        let _ = tokio::time::timeout(STOP_MAX, ending).await;
        Some(turn)
    }

    /// All outputs of the site.
    fn outputs(&self) -> Vec<Place> {
        let state = lock(&self.state);
        let modules = state.site.config().modules.iter();
        let outputs = modules.flat_map(|(module, config)| {
            let outputs = 0..config.setup.count(PointKind::Output);
            outputs.map(move |index| {
                let kind = PointKind::Output;
                Place::new(module, Point { kind, index })
            })
        });
        outputs.collect()
    }

    /// What is one of these is not to be done any more.
    pub(super) fn leave_out(self: &Arc<Inner>, of: impl Fn(&Key) -> bool) {
        if self.schedule.leave_out(of) {
            self.keep_soon();
        }
    }

    /// The same of those with these numbers.
    pub(super) fn leave_out_numbers(self: &Arc<Inner>, numbers: &[u64]) {
        for number in numbers {
            self.schedule.leave_out_one(*number);
        }
        if !numbers.is_empty() {
            self.keep_soon();
        }
    }

    fn keep_soon(self: &Arc<Inner>) {
        // Without a runtime the process ends, and what is promised still is.
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            let inner = Arc::clone(self);
            runtime.spawn(async move { inner.schedule.keep().await });
        }
    }

    fn note_of_end(&self, (place, why): &Key, promise: &Promise) -> Note {
        let label = self.label(&place.module, place.point);
        let end = if promise.end == Some(true) {
            "on"
        } else {
            "off"
        };
        let (part, what) = match why {
            Why::Pulse => ("pulse", format!("end of pulse {label}")),
            Why::Lease => ("lease", format!("end of lease {label}")),
            Why::OnReturn => ("on_return", format!("{label}={end}")),
            Why::MaxOn | Why::MinOff => {
                let longest = promise.length.as_millis();
                ("max_on", format!("{label}=off after {longest}ms"))
            }
        };
        Note {
            origin: Origin::program(part),
            what,
        }
    }

    /// An output was seen in another state: it may be on for so long only.
    pub(super) fn watch_on(self: &Arc<Inner>, change: &Change) {
        let place = Place::new(&change.module, change.point);
        match change.value {
            Value::Bool(true) => {
                if let Some(timer) = self.limit_on(&place) {
                    tokio::spawn(timer.promised());
                }
            }
            Value::Bool(false) => self.leave_out(|key| *key == (place.clone(), Why::MaxOn)),
            Value::Analog(..) | Value::Number(_) => {}
        }
    }

    /// The timer of an output that may be on for so long only, where none of that length runs.
    pub(super) fn limit_on(self: &Arc<Inner>, place: &Place) -> Option<Timer> {
        let longest = {
            let state = lock(&self.state);
            state.site.config().safety(place)?.max_on?
        };
        let key = (place.clone(), Why::MaxOn);
        let length = Duration::from_micros(longest.0);
        let passed = match self.schedule.due(&key) {
            None => Duration::ZERO,
            // It is on already, and may be so for longer or less long by now.
            Some(left) => {
                let before = self.schedule.find(&key)?.1.length;
                (before != length).then(|| before.saturating_sub(left))?
            }
        };
        let promise = Promise {
            length,
            ..Promise::after(length.saturating_sub(passed), Some(false))
        };
        self.polls.then(|| Timer::new(self, key, promise))
    }

    /// There is another configuration: outputs that are on are limited as it says. Gives back those
    /// that were, and are not any more.
    pub(super) fn limit_anew(self: &Arc<Inner>) -> Vec<Place> {
        let outputs = self.outputs();
        let (limited, free): (Vec<_>, Vec<_>) = {
            let state = lock(&self.state);
            let on = |place: &Place| {
                let (known, _) =
                    state
                        .site
                        .point(&place.module, place.point, railbus_wire::Instant(0));
                known.is_some_and(|known| known.value == Value::Bool(true))
            };
            let is_limited = |place: &Place| {
                let safety = state.site.config().safety(place);
                safety.is_some_and(|safety| safety.max_on.is_some())
            };
            let (limited, free): (Vec<_>, Vec<_>) = outputs.into_iter().partition(is_limited);
            (limited.into_iter().filter(on).collect(), free)
        };
        let dropped = self.schedule.limits(|place| free.contains(place));
        self.leave_out(|key| dropped.contains(key));
        for place in limited {
            if let Some(timer) = self.limit_on(&place) {
                tokio::spawn(timer.promised());
            }
        }
        dropped.into_iter().map(|(place, _)| place).collect()
    }

    /// Takes up what was promised before the process began. All of it ends when it was to end
    /// then: who holds an output has until then to say so again.
    pub(super) fn take_up(self: &Arc<Inner>) {
        let actions = self.schedule.take_up();
        for (place, promise) in self.schedule.off() {
            let left = u64::try_from(promise.left().as_micros()).unwrap_or(u64::MAX);
            lock(&self.state)
                .guard
                .free_at(&place, railbus_wire::Micros(left));
        }
        if actions.is_empty() && !self.schedule.has_dropped() {
            return;
        }
        self.keep_soon();
        for (key, promise, watched) in actions {
            let timer = Timer {
                inner: Arc::clone(self),
                key,
                promise,
                watched,
                turn: None,
                tried: None,
            };
            tokio::spawn(async move {
                let module = &timer.key.0.module;
                if let Some((line, _)) = timer.inner.place(module) {
                    // Why it could not be opened, its status says.
                    let _ = line.opened().await;
                }
                timer.wait().await;
            });
        }
    }
}

/// Whether an output that was to be released was seen so. An acknowledgement alone says nothing
/// of a relay that is welded.
pub(super) fn is_released(done: &WriteDone) -> bool {
    done.confirmed == Confirmed::Readback
}

/// Does something to its end, whether or not somebody waits for that.
pub(super) async fn to_its_end<T: Send + 'static>(
    what: impl Future<Output = Result<T, Failure>> + Send + 'static,
) -> Result<T, Failure> {
    let end = tokio::spawn(what).await;
    end.unwrap_or_else(|_| Err(Fault::Unknown.into()))
}
