//! What is done to an output later: the end of a pulse, of a lease, or of the longest time that
//! it may be on. Nothing of it depends on who asked for it.

use super::command::channel;
use super::promises::{Key, Promise, Why};
use super::status::Left;
use super::{Inner, lock};
use crate::audit::Note;
use crate::config::Place;
use crate::{Change, Failure, Origin, Value, WriteDone};
use railbus_device::{Bank, Op, Point, PointKind};
use railbus_host::Fault;
use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::{oneshot, watch};
use tokio::time::Instant;

/// An output that could not be released is tried again after this time.
const RETRY: Duration = Duration::from_secs(1);
/// When the site ends, its pulses have this time to be released.
const STOP_MAX: Duration = Duration::from_millis(1_400);
/// How often a release is tried then.
const STOP_TRIES: u8 = 3;

/// Something that is done to an output later.
pub(super) struct Timer {
    inner: Arc<Inner>,
    key: Key,
    promise: Promise,
    turn: Turn,
}

/// How an output is switched now, of which the end comes later.
pub(super) struct Begin {
    pub(super) value: bool,
    pub(super) note: Note,
    pub(super) told: oneshot::Sender<Result<WriteDone, Failure>>,
}

impl Timer {
    /// One of its own, in place of an older one of the same kind.
    pub(super) fn new(inner: &Arc<Inner>, key: Key, promise: Promise) -> Timer {
        let turn = inner.timers.add(&key, Instant::now() + promise.left());
        Timer {
            inner: Arc::clone(inner),
            key,
            promise,
            turn,
        }
    }

    /// Switches the output, which is promised to end before the first frame goes out, and ends
    /// it. Once that frame may have gone, nothing depends on the caller any more.
    pub(super) async fn begin(self, begin: Begin) {
        let begun = match self.write_down().await {
            Ok(()) => self.switch(begin.value, begin.note).await,
            Err(why) => Err(Failure::NotKept(why.kind())),
        };
        let did_nothing = begun
            .as_ref()
            .is_err_and(|failure| !failure.may_have_acted());
        // From now on: that it was asked for long before does not make it shorter.
        self.inner
            .timers
            .put_off(&self.key, Some(self.turn.number), self.promise.length);
        if did_nothing {
            self.end().await;
            // Fails where the caller has gone away.
            let _ = begin.told.send(begun);
            return;
        }
        let _ = begin.told.send(begun);
        self.wait().await;
    }

    /// Runs from when it is promised on. What the disk refuses holds as long as the process does.
    pub(super) async fn promised(self) {
        let _ = self.write_down().await;
        tokio::spawn(self.waiting());
    }

    /// Writes down what is to be done.
    async fn write_down(&self) -> std::io::Result<()> {
        let (promises, number) = (&self.inner.promises, self.turn.number);
        promises.make(&self.key, number, self.promise).await
    }

    /// [`Timer::wait`], which ends in a command that may begin another timer.
    fn waiting(self) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        Box::pin(self.wait())
    }

    /// Waits until the time has come, and does what was promised.
    async fn wait(mut self) {
        let why = loop {
            let at = *self.turn.at.borrow_and_update();
            tokio::select! {
                biased;
                over = &mut self.turn.taken_over => break over.unwrap_or(Over::ForGood),
                () = tokio::time::sleep_until(at) => {
                    if self.inner.timers.is_up(&self.key, self.turn.number) {
                        break Over::Due;
                    }
                }
                Ok(()) = self.turn.at.changed() => {}
                _ = self.turn.stop.wait_for(|stop| *stop) => {
                    if self.key.1 == Why::MaxOn {
                        // It goes on when the site does.
                        break Over::ForNow;
                    }
                    break Over::Due;
                }
            }
        };
        let why = match why {
            Over::Due => self.release().await,
            why => why,
        };
        if why == Over::ForNow {
            self.inner.timers.ended(&self.key, self.turn.number);
            return;
        }
        self.end().await;
    }

    async fn end(self) {
        self.inner.timers.ended(&self.key, self.turn.number);
        let number = self.turn.number;
        self.inner.promises.drop(&self.key, number).await;
    }

    /// Brings the output back, however often that takes; says what is left of the promise.
    async fn release(&mut self) -> Over {
        let Some(end) = self.promise.end else {
            return Over::ForGood;
        };
        let mut tries_when_stopping = 0;
        loop {
            let done = self.switch(end, self.note_of_end()).await;
            let (Place { module, point }, _) = &self.key;
            if done.is_ok() || self.inner.writable(module, &[*point]).is_err() {
                return Over::ForGood;
            }
            let stopping = *self.turn.stop.borrow();
            if stopping {
                tries_when_stopping += 1;
                if tries_when_stopping >= STOP_TRIES {
                    // It is done when the site starts again.
                    return Over::ForNow;
                }
            }
            tokio::select! {
                over = &mut self.turn.taken_over => return over.unwrap_or(Over::ForGood),
                () = tokio::time::sleep(RETRY) => {}
                _ = self.turn.stop.wait_for(|stop| *stop), if !stopping => {}
            }
        }
    }

    fn note_of_end(&self) -> Note {
        let (place, why) = &self.key;
        let label = self.inner.label(&place.module, place.point);
        let (part, what) = match why {
            Why::Pulse => ("pulse", format!("end of pulse {label}")),
            Why::Lease => ("lease", format!("end of lease {label}")),
            Why::MaxOn | Why::MinOff => {
                let longest = self.promise.length.as_millis();
                ("max_on", format!("{label}=off after {longest}ms"))
            }
        };
        Note {
            origin: Origin::program(part),
            what,
        }
    }

    async fn switch(&self, on: bool, note: Note) -> Result<WriteDone, Failure> {
        let (Place { module, point }, _) = &self.key;
        let op = Op::Write(Bank::one(channel(*point)?, on));
        let wanted = |_| Some(on);
        self.inner
            .command(module, &[*point], op, true, note, wanted)
            .await
    }
}

impl Inner {
    /// Begins something whose end comes later, and waits until it has begun.
    pub(super) async fn begin_timed(
        self: &Arc<Inner>,
        key: Key,
        (value, end): (bool, Option<bool>),
        length: Duration,
        note: Note,
    ) -> Result<WriteDone, Failure> {
        let (told, begun) = oneshot::channel();
        let timer = Timer::new(self, key, Promise::after(length, end));
        tokio::spawn(timer.begin(Begin { value, note, told }));
        let lost = || Err(Fault::Unknown.into());
        begun.await.unwrap_or_else(|_| lost())
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
            Value::Bool(false) => self.timers.take_over(&(place, Why::MaxOn)),
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
        let passed = match self.timers.due(&key) {
            None => Duration::ZERO,
            // It is on already, and may be so for longer or less long by now.
            Some(left) => {
                let before = self.promises.length_of(&key)?;
                (before != length).then(|| before.saturating_sub(left))?
            }
        };
        let promise = Promise {
            length,
            ..Promise::after(length.saturating_sub(passed), Some(false))
        };
        self.polls.then(|| Timer::new(self, key, promise))
    }

    /// There is another configuration: outputs that are on are limited as it says.
    pub(super) fn limit_anew(self: &Arc<Inner>) {
        let (limited, free) = {
            let state = lock(&self.state);
            let on = |place: &Place| {
                let (known, _) =
                    state
                        .site
                        .point(&place.module, place.point, railbus_wire::Instant(0));
                known.is_some_and(|known| known.value == Value::Bool(true))
            };
            let modules = state.site.config().modules.iter();
            let outputs = modules.flat_map(|(module, config)| {
                let outputs = 0..config.setup.count(PointKind::Output);
                outputs.map(move |index| {
                    let kind = PointKind::Output;
                    Place::new(module, Point { kind, index })
                })
            });
            let is_limited = |place: &Place| {
                let safety = state.site.config().safety(place);
                safety.is_some_and(|safety| safety.max_on.is_some())
            };
            let (limited, free): (Vec<_>, Vec<_>) = outputs.partition(is_limited);
            (limited.into_iter().filter(on).collect::<Vec<_>>(), free)
        };
        for place in free {
            self.timers.take_over(&(place, Why::MaxOn));
        }
        for place in limited {
            if let Some(timer) = self.limit_on(&place) {
                tokio::spawn(timer.promised());
            }
        }
    }

    /// Takes up what was promised before the process began.
    pub(super) fn take_up(self: &Arc<Inner>) {
        for ((place, why), mut promise) in self.promises.all() {
            match why {
                Why::Pulse | Why::MaxOn => {}
                // Who holds it has as long to say so as at the beginning.
                Why::Lease => promise = Promise::after(promise.length, promise.end),
                Why::MinOff => {
                    let left = u64::try_from(promise.left().as_micros()).unwrap_or(u64::MAX);
                    lock(&self.state)
                        .guard
                        .free_at(&place, railbus_wire::Micros(left));
                    continue;
                }
            }
            let timer = Timer::new(self, (place, why), promise);
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

/// Why a timer does not wait any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Over {
    /// Its time is up.
    Due,
    /// What it was to do is not to be done any more.
    ForGood,
    /// It is promised still; somebody else sees to it.
    ForNow,
}

/// A timer's own end of its entry among the [`Timers`].
struct Turn {
    number: u64,
    at: watch::Receiver<Instant>,
    taken_over: oneshot::Receiver<Over>,
    stop: watch::Receiver<bool>,
}

/// What runs: at most one of each kind for an output.
#[derive(Debug)]
pub(super) struct Timers {
    running: Mutex<Running>,
    count: watch::Sender<usize>,
    stop: watch::Sender<bool>,
}

#[derive(Debug, Default)]
struct Running {
    newest: u64,
    by_key: BTreeMap<Key, Entry>,
    /// Those that run, the ones that were taken over included.
    count: usize,
}

#[derive(Debug)]
struct Entry {
    number: u64,
    at: watch::Sender<Instant>,
    take_over: oneshot::Sender<Over>,
    /// The output is being released, or about to be: it is too late to put that off.
    is_ending: bool,
}

impl Default for Timers {
    fn default() -> Timers {
        Timers {
            running: Mutex::default(),
            count: watch::Sender::new(0),
            stop: watch::Sender::new(false),
        }
    }
}

impl Timers {
    fn add(&self, key: &Key, at: Instant) -> Turn {
        let (take_over, taken_over) = oneshot::channel();
        let (put_off, at) = watch::channel(at);
        let mut running = lock(&self.running);
        running.newest += 1;
        let number = running.newest;
        let entry = Entry {
            number,
            at: put_off,
            take_over,
            is_ending: false,
        };
        if let Some(older) = running.by_key.insert(key.clone(), entry) {
            // Fails where that one has just ended.
            let _ = older.take_over.send(Over::ForGood);
        }
        running.count += 1;
        self.count.send_replace(running.count);
        Turn {
            number,
            at,
            taken_over,
            stop: self.stop.subscribe(),
        }
    }

    /// One has ended.
    fn ended(&self, key: &Key, number: u64) {
        let mut running = lock(&self.running);
        let newest = running.by_key.get(key).map(|entry| entry.number);
        if newest == Some(number) {
            running.by_key.remove(key);
        }
        running.count = running.count.saturating_sub(1);
        self.count.send_replace(running.count);
    }

    /// One is not to be done any more.
    pub(super) fn take_over(&self, key: &Key) {
        if let Some(older) = lock(&self.running).by_key.remove(key) {
            let _ = older.take_over.send(Over::ForGood);
        }
    }

    /// A command takes one over, and what was promised stands until that has ended. Gives back
    /// which one it was, and how long it would have been.
    pub(super) fn claim(&self, key: &Key) -> Option<(u64, Duration)> {
        let older = lock(&self.running).by_key.remove(key)?;
        let left = (*older.at.borrow()).saturating_duration_since(Instant::now());
        let _ = older.take_over.send(Over::ForNow);
        Some((older.number, left))
    }

    /// The same of this one only, not of one that came in its place.
    pub(super) fn take_over_one(&self, key: &Key, number: u64) {
        let mut running = lock(&self.running);
        let newest = running.by_key.get(key).map(|entry| entry.number);
        if newest == Some(number)
            && let Some(older) = running.by_key.remove(key)
        {
            let _ = older.take_over.send(Over::ForGood);
        }
    }

    /// From now on it is so long until it is done, where it is this one or no other is meant; says
    /// whether that is so. What is being done already can't be put off.
    pub(super) fn put_off(&self, key: &Key, number: Option<u64>, length: Duration) -> bool {
        let running = lock(&self.running);
        let entry = running.by_key.get(key);
        let entry = entry.filter(|entry| number.is_none_or(|number| entry.number == number));
        entry
            .is_some_and(|entry| !entry.is_ending && entry.at.send(Instant::now() + length).is_ok())
    }

    /// Whether the time of this one is up. If so, it can't be put off any more.
    fn is_up(&self, key: &Key, number: u64) -> bool {
        let mut running = lock(&self.running);
        let entry = running.by_key.get_mut(key);
        let entry = entry.filter(|entry| entry.number == number);
        entry.is_some_and(|entry| {
            entry.is_ending |= *entry.at.borrow() <= Instant::now();
            entry.is_ending
        })
    }

    /// Somebody does now what was to be done later: it can't be put off any more. Gives back which
    /// one it is, where there is one.
    pub(super) fn anticipate(&self, key: &Key) -> Option<u64> {
        let mut running = lock(&self.running);
        let entry = running.by_key.get_mut(key)?;
        entry.is_ending = true;
        Some(entry.number)
    }

    /// How long it is until it is done, where there is one.
    pub(super) fn due(&self, key: &Key) -> Option<Duration> {
        let running = lock(&self.running);
        let at = *running.by_key.get(key)?.at.borrow();
        Some(at.saturating_duration_since(Instant::now()))
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

    /// Waits until none runs.
    pub(super) async fn all_ended(&self) {
        let mut count = self.count.subscribe();
        // Fails only where the site has gone.
        let _ = count.wait_for(|count| *count == 0).await;
    }

    /// Ends the pulses and leases of these outputs now, and waits for that as long as may be. Those
    /// that could not be ended by then come back.
    pub(super) async fn end_now(&self, of: impl Fn(&Place) -> bool) -> Vec<(Key, u64)> {
        let mut count = self.count.subscribe();
        let mut ending = Vec::new();
        for key in self.keys(|key| key.1 != Why::MaxOn && of(&key.0)) {
            if let Some(entry) = lock(&self.running).by_key.get_mut(&key) {
                entry.is_ending = true;
                entry.at.send_replace(Instant::now());
                ending.push((key, entry.number));
            }
        }
        let until = Instant::now() + STOP_MAX;
        loop {
            ending.retain(|(key, number)| self.runs(key, *number));
            if ending.is_empty() {
                return ending;
            }
            // Fails only where the site has gone.
            if tokio::time::timeout_at(until, count.changed())
                .await
                .is_err()
            {
                return ending;
            }
        }
    }

    /// How long these outputs may be on is not counted any more.
    pub(super) fn forget_limits(&self, of: impl Fn(&Place) -> bool) {
        for key in self.keys(|key| key.1 == Why::MaxOn && of(&key.0)) {
            self.take_over(&key);
        }
    }

    /// Those that run. Who is asked which of them are meant may look at the site: its lock is
    /// taken before the one of this.
    fn keys(&self, of: impl Fn(&Key) -> bool) -> Vec<Key> {
        let mut keys: Vec<Key> = lock(&self.running).by_key.keys().cloned().collect();
        keys.retain(of);
        keys
    }

    fn runs(&self, key: &Key, number: u64) -> bool {
        let running = lock(&self.running);
        running.by_key.get(key).map(|entry| entry.number) == Some(number)
    }

    /// Ends all of them now, and waits for that as long as may be.
    pub(super) async fn stop_all(&self) {
        self.stop.send_replace(true);
        let _ = tokio::time::timeout(STOP_MAX, self.all_ended()).await;
    }
}
