//! What is done to an output later: the end of a pulse, of a lease, or of the longest time that
//! it may be on; and what its policy wants, which may take more than one try. Nothing of it
//! depends on who asked for it.

use super::context::{Context, TaskId};
use super::order::{Entry, Order, channel};
use super::promises::{Key, Promise, Why};
use super::schedule::{Running, STOP_MAX, Time};
use super::state::State;
use super::turns::Turn;
use super::within::TTL;
use crate::config::Place;
use crate::service::lock;
use crate::{CommandError, PointChange, PointValue, WriteDone};
use railbus_device::{Bank, Op};
use railbus_host::{Confirmation, Fault};
use railbus_store::audit::{Note, Origin};
use railbus_wire::{Instant, Micros};
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::Poll;
use std::time::Duration;

/// An output that could not be released is tried again after this time, then after twice as
/// long, and so on.
const RETRY: Micros = Micros::from_secs(1);
/// The longest time between two tries.
const RETRY_MAX: Micros = Micros::from_secs(60);
/// How often a release is tried when the site ends.
const STOP_TRIES: u8 = 3;

/// Something that is done to an output later.
pub(super) struct Timer {
    context: Context,
    number: u64,
    key: Key,
    promise: Promise,
    /// The turn that it has at its first try, if any.
    turn: Option<Turn>,
    /// Dropped once it was tried.
    tried: Option<Tried>,
    _running: Running,
}

/// Tells a procedure that something was tried, when it is dropped.
pub(super) struct Tried {
    context: Context,
    waits: TaskId,
    is_tried: Arc<Mutex<bool>>,
}

impl Drop for Tried {
    fn drop(&mut self) {
        *lock(&self.is_tried) = true;
        let waits = self.waits;
        self.context.with(|state| state.runs.wake(waits));
    }
}

/// How an output is switched now, of which the end comes later.
pub(super) struct Begin {
    pub(super) key: Key,
    pub(super) value: bool,
    pub(super) end: Option<bool>,
    pub(super) length: Duration,
    pub(super) note: Note,
    pub(super) expires: Micros,
}

impl Timer {
    pub(super) fn new(context: &Context, key: Key, promise: Promise) -> Timer {
        let (number, running) = context.schedule(key.clone(), promise);
        Timer {
            context: context.clone(),
            number,
            key,
            promise,
            turn: None,
            tried: None,
            _running: running,
        }
    }

    /// It is due, and has its turn; drops this once it was tried.
    pub(super) fn at_once(mut self, turn: Turn, tried: Tried) -> Timer {
        (self.turn, self.tried) = (Some(turn), Some(tried));
        self
    }

    pub(super) const fn number(&self) -> u64 {
        self.number
    }

    /// Runs from when it is promised on. What the disk refuses holds as long as the process does.
    pub(super) async fn promised(self) {
        let _ = self.context.keep().await;
        self.run();
    }

    /// The same of one for a command: a disk that takes longer than that has is not waited for.
    pub(super) async fn promised_by(self, expires: Micros) {
        let _ = self.context.until(expires, self.context.keep()).await;
        self.run();
    }

    fn run(self) {
        let context = self.context.clone();
        context.spawn(self.waiting());
    }

    /// [`Timer::wait`], which ends in a command that may begin another timer.
    fn waiting(self) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        Box::pin(self.wait())
    }

    /// Waits until the time has come, and does what was promised.
    async fn wait(mut self) {
        let number = self.number;
        self.context.with(|state| state.sees_to(number));
        while self.time_comes().await {
            if self.release().await {
                return;
            }
        }
    }

    /// Says whether anything is to be done.
    async fn time_comes(&mut self) -> bool {
        let (number, why) = (self.number, self.key.1);
        self.context
            .wait(|state| {
                state.takes_again(number);
                let Some(due) = state.due_at(number) else {
                    return Some(false);
                };
                if state.is_past(due) {
                    return Some(true);
                }
                if !state.schedule.is_stopping {
                    return None;
                }
                let goes_on = why == Why::MaxOn;
                if goes_on {
                    state.schedule.put_aside(number);
                }
                Some(!goes_on)
            })
            .await
    }

    /// Brings the output back, however often that takes. False where it was put off.
    async fn release(&mut self) -> bool {
        let note = self
            .context
            .with(|state| state.note_of_end(&self.key, &self.promise));
        let mut entry = Entry::of_release(note);
        let is_over = self.try_release(&mut entry).await;
        self.context.close(entry);
        is_over
    }

    async fn try_release(&mut self, entry: &mut Entry) -> bool {
        let (place, number, context) = (&self.key.0, self.number, &self.context);
        let mut pause = RETRY;
        let mut tries_when_stopping = 0;
        loop {
            let turn = match self.turn.take() {
                Some(turn) => turn,
                None => context.turn_to_end([place.clone()]).await,
            };
            match context.with(|state| state.time_of(number)) {
                Time::Over => return true,
                Time::NotYet => return false,
                Time::Due => {}
            }
            let promised = (&self.key, &self.promise);
            if context.release(&turn, promised, entry).await {
                context.with(|state| state.schedule.leave_out_one(number));
                let _ = context.keep().await;
                return true;
            }
            drop(turn);
            self.tried = None;
            let was_stopping = context.with(|state| state.schedule.is_stopping);
            if was_stopping {
                tries_when_stopping += 1;
                if tries_when_stopping >= STOP_TRIES {
                    // It is done when the site starts again.
                    context.with(|state| state.schedule.put_aside(number));
                    return true;
                }
            }
            let next = context.now() + pause;
            pause = Micros(pause.0 * 2).min(RETRY_MAX);
            let over = context.wait(|state| {
                if state.due_at(number).is_none() {
                    return Some(true);
                }
                let stops = state.schedule.is_stopping && !was_stopping;
                if state.takes_again(number) {
                    // Its module is heard again.
                    pause = RETRY;
                    return Some(false);
                }
                (stops || state.is_past(next)).then_some(false)
            });
            if over.await {
                return true;
            }
        }
    }
}

impl Context {
    /// Says to the current procedure that something was tried.
    pub(super) fn tried(&self) -> (Tried, impl Future<Output = ()> + Send + use<>) {
        let is_tried = Arc::new(Mutex::new(false));
        let tried = Tried {
            context: self.clone(),
            waits: self.with(|state| state.runs.current),
            is_tried: Arc::clone(&is_tried),
        };
        let waits = std::future::poll_fn(move |_| match *lock(&is_tried) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        });
        (tried, waits)
    }

    /// Begins something whose end comes later: that is promised before the first frame goes out.
    /// Gives back how long it is until then.
    pub(super) async fn begin_timed(
        &self,
        turn: &Turn,
        begin: Begin,
    ) -> Result<(WriteDone, Duration), CommandError> {
        let Begin {
            key,
            value,
            end,
            length,
            note,
            expires,
        } = begin;
        let op = Op::Write(Bank::one(channel(key.0.point)?, value));
        let (wall, is_stopping) = self.with(|state| (state.now.wall, state.schedule.is_stopping));
        let timer = Timer::new(self, key, Promise::after(wall, length, end));
        let (place, number) = (&timer.key.0, timer.number);
        let kept = match is_stopping {
            // Nobody would wait for its end.
            true => Err(Fault::Closed.into()),
            false => self.keep().await.map_err(CommandError::NotKept),
        };
        let begun = match kept {
            Ok(()) => {
                let order = Order {
                    module: &place.module,
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
                let (is_alone, anew) = self.with(|state| {
                    let is_alone = state.schedule.held(|other| other == place).len() < 2;
                    // From now on: that it was asked for long before does not make it shorter.
                    (is_alone, Promise::after(state.now.wall, length, end))
                });
                let taken = self
                    .hand_outputs_over(std::slice::from_ref(place), Some((number, anew)))
                    .await;
                match taken {
                    Err(why) if !is_alone => Err(CommandError::NotTakenOver(why)),
                    // Where the disk refuses, it ends as was written down before.
                    _ => {
                        let left = self.with(|state| state.time_to(&timer.key));
                        Ok((done, left.unwrap_or_default()))
                    }
                }
            }
            Err(failure) => {
                let is_kept = self.with(|state| {
                    // An older one was surely begun, and has the say.
                    let is_other = state.schedule.has_other_end(number, place, end);
                    let is_kept = failure.may_have_acted() && !is_other;
                    if is_kept {
                        state.schedule.leave_out_between(number);
                    } else {
                        state.schedule.leave_out_one(number);
                    }
                    is_kept
                });
                if !is_kept {
                    let _ = self.keep().await;
                    return Err(failure);
                }
                let _ = self.renew(number, length).await;
                Err(failure)
            }
        };
        timer.run();
        begun
    }

    /// Brings an output where a promise wants it; says whether that is over. Whose the output
    /// was, does not matter any more then.
    async fn release(
        &self,
        turn: &Turn,
        (key, promise): (&Key, &Promise),
        entry: &mut Entry,
    ) -> bool {
        let Place { module, point } = &key.0;
        let (Some(on), Ok(channel)) = (promise.end, channel(*point)) else {
            return true;
        };
        let is_other = |state: &mut State| key.1.is_policy() && state.policy(&key.0) != Some(on);
        if self.with(is_other) {
            // There is another configuration by now.
            return true;
        }
        let order = Order {
            module,
            points: &[*point],
            op: Op::Write(Bank::one(channel, on)),
            verify: true,
            expires: self.now() + TTL,
        };
        let end = self.command(turn, order, entry, |_| Some(on)).await;
        self.with(|state| match end {
            Ok(done) if is_released(&done) => {
                let is_of =
                    |other: &Key| other.0 == key.0 && matches!(other.1, Why::Pulse | Why::Lease);
                state.schedule.leave_out(is_of);
                true
            }
            Err(CommandError::Interlock { .. }) if key.1.is_policy() => !state.comes_free(key),
            // What was acknowledged and not seen is not believed. Who locks an output does not keep
            // it from its end, which was promised before.
            _ => matches!(
                state.writable(module, &[*point]),
                Err(CommandError::NoSuchModule
                    | CommandError::NoSuchPoint
                    | CommandError::NotAnOutput(_))
            ),
        })
    }

    /// Ends the pulses and leases of these outputs now, as far as that can be in a moment: of those
    /// whose turn comes within this time. Nobody commands them until the turns are dropped. The
    /// others, and those that could not be ended, come back.
    pub(super) async fn end_now(
        &self,
        of: impl Fn(&Place) -> bool,
        patience: Micros,
    ) -> (Vec<Arc<Turn>>, Vec<u64>) {
        let outputs = self.with(|state| state.outputs());
        let until = self.now() + patience;
        let ending = outputs.into_iter().filter(&of);
        let ending = ending.map(|place| self.end_in_turn(place, until));
        let turns = self.all(ending.collect::<Vec<_>>()).await;
        let _ = self.keep().await;
        let left = self.with(|state| state.schedule.held(of));
        (
            turns.into_iter().flatten().collect(),
            left.into_iter().map(|(number, ..)| number).collect(),
        )
    }

    /// The same of one output: it waits for none of the others.
    async fn end_in_turn(&self, place: Place, until: Micros) -> Option<Arc<Turn>> {
        let turn = self.until(until, self.turn_to_end([place.clone()])).await?;
        let (context, turn) = (self.clone(), Arc::new(turn));
        let in_turn = Arc::clone(&turn);
        let ending = self.begin(async move { context.end_held(&place, &in_turn).await });
        // What was sent has its end all the same, and is written down.
        let until = self.now() + STOP_MAX;
        self.until(until, ending).await;
        Some(turn)
    }

    async fn end_held(&self, place: &Place, turn: &Turn) {
        // A command that had its turn still has gone out, and what it began is known.
        let held = self.with(|state| state.schedule.held(|other| other == place));
        for (number, key, promise) in held {
            let note = self.with(|state| {
                if state.time_of(number) == Time::Over {
                    return None;
                }
                state.schedule.anticipate(number);
                Some(state.note_of_end(&key, &promise))
            });
            let Some(note) = note else {
                continue;
            };
            let mut entry = Entry::of_release(note);
            if self.release(turn, (&key, &promise), &mut entry).await {
                self.with(|state| state.schedule.leave_out_one(number));
            }
        }
    }

    /// An output was seen in another state: it may be on for so long only.
    pub(super) fn watch_on(&self, change: &PointChange) {
        let place = Place::new(&change.module, change.point);
        match change.value {
            PointValue::Bool(true) => {
                if let Some(timer) = self.limit_on(&place) {
                    self.spawn(timer.promised());
                }
            }
            PointValue::Bool(false) => self.with(|state| {
                let key = (place, Why::MaxOn);
                state.schedule.leave_out(|other| *other == key);
            }),
            PointValue::Analog(..) | PointValue::Number(_) => {}
        }
    }

    /// The timer of an output that may be on for so long only, where none of that length runs.
    pub(super) fn limit_on(&self, place: &Place) -> Option<Timer> {
        let key = (place.clone(), Why::MaxOn);
        let promise = self.with(|state| {
            if !state.polls {
                return None;
            }
            let longest = state.site.config().safety(place)?.max_on?;
            let length = Duration::from_micros(longest.0);
            let passed = match state.time_to(&key) {
                None => Duration::ZERO,
                // It is on already, and may be so for longer or less long by now.
                Some(left) => {
                    let before = state.schedule.find(&key)?.1.length;
                    (before != length).then(|| before.saturating_sub(left))?
                }
            };
            let left = length.saturating_sub(passed);
            Some(Promise {
                length,
                ..Promise::after(state.now.wall, left, Some(false))
            })
        })?;
        Some(Timer::new(self, key, promise))
    }

    /// There is another configuration: outputs that are on are limited as it says. Gives back those
    /// that were, and are not any more.
    pub(super) fn limit_anew(&self) -> Vec<Place> {
        let (limited, dropped) = self.with(|state| {
            let on = |place: &Place| {
                let (known, _) = state.site.point(&place.module, place.point, Instant(0));
                known.is_some_and(|known| known.value == PointValue::Bool(true))
            };
            let is_limited = |place: &Place| {
                let safety = state.site.config().safety(place);
                safety.is_some_and(|safety| safety.max_on.is_some())
            };
            let outputs = state.outputs().into_iter();
            let (limited, free): (Vec<_>, Vec<_>) = outputs.partition(is_limited);
            let limited: Vec<_> = limited.into_iter().filter(on).collect();
            let dropped = state.schedule.limits(|place| free.contains(place));
            state.schedule.leave_out(|key| dropped.contains(key));
            (limited, dropped)
        });
        for place in limited {
            if let Some(timer) = self.limit_on(&place) {
                self.spawn(timer.promised());
            }
        }
        dropped.into_iter().map(|(place, _)| place).collect()
    }

    /// Takes up what was promised before the process began. All of it ends when it was to end
    /// then: who holds an output has until then to say so again.
    pub(super) fn take_up(&self) {
        let actions = self.with(|state| {
            let actions = state.take_up();
            for (place, left) in state.kept_off() {
                state.guard.free_at(&place, state.now.site + left);
            }
            actions
        });
        for (number, key, promise) in actions {
            let timer = Timer {
                context: self.clone(),
                number,
                key,
                promise,
                turn: None,
                tried: None,
                _running: self.running(),
            };
            self.spawn(async move {
                let module = timer.key.0.module.clone();
                let is_opened = |state: &mut State| state.is_opened(&module);
                let opens = timer.context.wait_in(|state| &mut state.opening, is_opened);
                opens.await;
                timer.wait().await;
            });
        }
    }
}

impl State {
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
            Why::MaxOn | Why::MinOff | Why::OwnPulse => {
                let longest = promise.length.as_millis();
                ("max_on", format!("{label}=off after {longest}ms"))
            }
        };
        Note {
            origin: Origin::program(part),
            what,
        }
    }
}

/// Whether an output that was to be released was seen so. An acknowledgement alone says nothing
/// of a relay that is welded.
pub(super) fn is_released(done: &WriteDone) -> bool {
    done.confirmed == Confirmation::Readback
}
