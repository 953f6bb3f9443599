//! A command to outputs of one module: outputs that it may switch on are reserved from before its
//! first frame until it has ended. All switching of outputs goes through here, in the output's
//! turn.

use super::OpenAuditEntry;
use super::commands::Command;
use super::context::Context;
use super::own_pulses::NewPulse;
use super::promises::Why;
use super::state::State;
use super::turns::Turn;
use super::within::TTL;
use crate::config::{Place, Safety};
use crate::{CommandError, PointValue, WriteDone};
use railbus_device::{Bank, Module, Observation, Op, Point};
use railbus_host::{Confirmation, Done, Fault};
use railbus_store::audit::{End, Note};
use railbus_wire::{Channel, Micros};

/// A command to outputs of one module.
pub(super) struct Order<'a> {
    pub(super) module: &'a str,
    pub(super) points: &'a [Point],
    pub(super) op: Op,
    pub(super) verify: bool,
    /// It is not sent from this time of the site on.
    pub(super) expires: Micros,
}

/// The audit entries of a command. One that is retried gets an entry for its first failure, and one
/// more for all later attempts.
pub(super) struct Entry {
    note: Note,
    /// The end of a scheduled action: done once it is read back.
    is_release: bool,
    /// The last failure.
    failed: Option<End>,
    /// Of the tries after the first.
    open: Option<OpenAuditEntry>,
}

impl Entry {
    pub(super) const fn new(note: Note) -> Entry {
        Entry {
            note,
            is_release: false,
            failed: None,
            open: None,
        }
    }

    pub(super) const fn of_release(note: Note) -> Entry {
        Entry {
            note,
            is_release: true,
            failed: None,
            open: None,
        }
    }
}

/// The effect of a command on outputs that are watched.
#[derive(Debug, Default)]
struct Effect {
    /// Those that it may switch on.
    rising: Vec<Place>,
    /// Those of them that are off beyond doubt before it.
    off: Vec<Place>,
    /// Those that it switches off, and that are not off already.
    falling: Vec<Place>,
    /// The pulses that it begins at the module.
    begins: Vec<NewPulse>,
}

/// What a command has done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Acted {
    /// Nothing.
    No,
    /// Unknown until it is read.
    Perhaps,
    /// What it was to do; that was read.
    Surely,
}

impl Acted {
    fn of(end: &Result<Done, Fault>) -> Acted {
        match end {
            Ok(done) if done.confirmed == Confirmation::Readback => Acted::Surely,
            // Of several frames, one before may have been taken.
            Ok(_) | Err(Fault::Refused(_)) => Acted::Perhaps,
            Err(fault) if fault.may_have_acted() => Acted::Perhaps,
            Err(_) => Acted::No,
        }
    }
}

impl Context {
    /// Carries a command out: permission, audit entry, and the states before and after. It goes
    /// where the module was when the output's turn came; where that has left since, it is
    /// [`Fault::Closed`].
    pub(super) async fn command(
        &self,
        turn: &Turn,
        order: Order<'_>,
        entry: &mut Entry,
        wanted: impl Fn(Point) -> Option<bool>,
    ) -> Result<WriteDone, CommandError> {
        let Order { module, points, .. } = order;
        let mut effect = self.with(|state| state.effect(module, points, &order.op));
        self.ask_excluded(&effect.rising, order.expires).await;
        // A module that has no board has no line either, and nothing is sent.
        let pending = match turn.board(module) {
            Some(board) => {
                let promised = self.promise_own_pulses(board, &effect.begins, order.expires);
                Some((board, promised.await?))
            }
            None => None,
        };
        let (begun, before) = self.begin_command(module, points, entry).await?;
        let id = begun.id.clone();
        let allowed = self.with(|state| {
            let falling = std::mem::take(&mut effect.falling);
            effect.falling = state.not_off(falling);
            effect.off = state.surely_off(&effect.rising);
            state.rise(&effect.rising)
        });
        if let Err(failure) = allowed {
            let end = End::not_done(failure.name());
            self.end_command(begun, Err(end), String::new(), entry);
            return Err(failure);
        }
        let expires = order.expires;
        self.until(expires, self.forget_off(&effect.rising)).await;
        let limits = self.limit(&effect, expires).await;
        let at = turn.at(module);
        let end = match at.filter(|at| self.with(|state| state.has(*at))) {
            // The log or the disk took too long.
            Some(_) if self.now() >= expires => Err(Fault::Expired),
            Some(at) => self.run_at(at, order.op, order.verify, expires).await,
            None => Err(Fault::Closed),
        };
        let acted = Acted::of(&end);
        let after = |point: &Point| {
            let done = end.as_ref().ok()?;
            match (done.confirmed, done.seen) {
                (Confirmation::Sent, _) => None,
                // A reading takes precedence over the request: a pulse may be over.
                (_, Some(Observation::Channels { outputs, .. })) => bank_state(outputs, *point),
                (Confirmation::Readback | Confirmation::Reply, _) => wanted(*point),
            }
        };
        let after: Vec<_> = points.iter().map(|point| (*point, after(point))).collect();
        let states = self.with(|state| {
            state.note_fault(module, &end);
            state.release(module, &effect, acted, &limits);
            if let Some((board, _)) = &pending
                && acted != Acted::No
            {
                let is_certain = matches!(&end, Ok(done) if done.confirmed != Confirmation::Sent);
                state.note_own_pulses(board, points, &effect.begins, is_certain);
            }
            // Where outputs were read after the reply, they are as they were read.
            let is_read = matches!(&end, Ok(done) if done.seen.is_some());
            if acted == Acted::Perhaps && !is_read {
                state.site.doubt_points(module, points);
            }
            state.states(module, &after)
        });
        drop(pending);
        let ended = end_of(&end);
        let is_done = acted == Acted::Surely || end.is_ok() && !entry.is_release;
        let ended = if is_done { Ok(ended) } else { Err(ended) };
        self.end_command(begun, ended, states, entry);
        let done = end?;
        let outputs = after.into_iter().zip(before);
        Ok(WriteDone {
            outputs: outputs
                .map(|((point, after), (_, before))| (point, after, before))
                .collect(),
            confirmed: done.confirmed,
            took: done.took,
            audit: id,
            read_then_set: false,
        })
    }

    /// Writes down what is about to be done; gives back how the outputs are known to be.
    async fn begin_command(
        &self,
        module: &str,
        points: &[Point],
        entry: &mut Entry,
    ) -> Result<(OpenAuditEntry, Vec<(Point, Option<bool>)>), CommandError> {
        let (before, states, label) = self.with(|state| {
            let before = |point: &Point| (*point, state.known(&Place::new(module, *point)));
            let before: Vec<_> = points.iter().map(before).collect();
            let states = state.states(module, &before);
            let label = match points {
                [point] => Some(state.label(module, *point)),
                _ => None,
            };
            (before, states, label)
        });
        if let Some(begun) = entry.open.take() {
            return Ok((begun, before));
        }
        let journal = self.journal(module.to_owned(), label, entry.note.clone(), states);
        let begun = journal.await?;
        self.with(|state| {
            state.commands.add(Command {
                id: begun.id.clone(),
                at: state.now.wall,
                origin: entry.note.origin.clone(),
                module: module.to_owned(),
                what: entry.note.what.clone(),
                end: None,
            });
        });
        Ok((begun, before))
    }

    /// Records how a command ended, unless it failed again like before.
    fn end_command(
        &self,
        begun: OpenAuditEntry,
        end: Result<End, End>,
        after: String,
        entry: &mut Entry,
    ) {
        let is_again = entry.failed.is_some();
        entry.failed = end.err();
        let (Ok(ended) | Err(ended)) = end;
        if end.is_err() && is_again {
            entry.open = Some(begun);
        } else {
            self.with(|state| state.commands.end(&begun.id, ended));
            self.journal_end(begun, ended, after);
        }
    }

    /// It is not retried any more.
    pub(super) fn close(&self, entry: Entry) {
        if let (Some(begun), Some(ended)) = (entry.open, entry.failed) {
            self.with(|state| state.commands.end(&begun.id, ended));
            self.journal_end(begun, ended, String::new());
        }
    }

    /// The disk says no more how long these must stay off, before they are switched on: should
    /// they go off again and the process end before that is written down, the next one waits for
    /// the whole time.
    async fn forget_off(&self, rising: &[Place]) {
        if self.with(|state| state.schedule.forget_off(rising)) {
            // What the disk refuses is tried again.
            let _ = self.keep().await;
        }
    }

    /// Sees to it that outputs which may be on for so long only are switched off then, before
    /// they are switched on. Gives back those whose longest time began with that, and its number.
    async fn limit(&self, effect: &Effect, expires: Micros) -> Vec<(Place, u64)> {
        let mut limits = Vec::new();
        for place in &effect.rising {
            let key = (place.clone(), Why::MaxOn);
            let runs = self.with(|state| {
                if effect.off.contains(place) {
                    // One that runs began for nothing: what was to switch it on did not.
                    state.schedule.leave_out(|other| *other == key);
                }
                state.schedule.find(&key).is_some()
            });
            if let Some(timer) = self.limit_on(place) {
                if !runs {
                    limits.push((place.clone(), timer.number()));
                }
                timer.promised_by(expires).await;
            }
        }
        limits
    }

    /// Asks the modules of which nothing sure is known, where outputs that exclude these hang on
    /// them. What that brings is looked at afterwards.
    async fn ask_excluded(&self, rising: &[Place], expires: Micros) {
        if rising.is_empty() {
            return;
        }
        for module in self.with(|state| state.to_be_asked(rising)) {
            let _ = self.read_all(&module, expires).await;
        }
    }

    /// Asks a module for everything now, until then. What it says is known when this returns.
    ///
    /// # Errors
    /// [`CommandError::NoSuchModule`], or what the line said.
    pub(super) async fn read_all(&self, module: &str, expires: Micros) -> Result<(), CommandError> {
        let setup = self.with(|state| state.described(module).map(|module| module.setup))?;
        let described = Module::new(setup).map_err(|_| Fault::Unsupported)?;
        for op in described.full_poll() {
            self.run(module, op, expires).await?;
        }
        Ok(())
    }

    /// The same for a caller who asked for nothing else.
    ///
    /// # Errors
    /// The same.
    pub(crate) async fn read_fresh(&self, module: &str) -> Result<(), CommandError> {
        self.read_all(module, self.now() + TTL).await
    }

    /// Reads something of a module, until then.
    pub(super) async fn run(&self, module: &str, op: Op, expires: Micros) -> Result<Done, Fault> {
        let at = self.with(|state| state.at(module)).ok_or(Fault::Closed)?;
        let end = self.run_at(at, op, false, expires).await;
        self.with(|state| state.note_fault(module, &end));
        end
    }
}

impl State {
    /// Counts what the module or the line did wrong.
    fn note_fault(&mut self, module: &str, end: &Result<Done, Fault>) {
        if let Err(
            fault
            @ (Fault::NoReply(_) | Fault::Garbled(_) | Fault::Refused(_) | Fault::NotVerified),
        ) = end
        {
            let now = self.now.site;
            self.missed(module, now, fault);
        }
    }

    /// `do0=on do1=off`, as far as it is known.
    fn states(&self, module: &str, points: &[(Point, Option<bool>)]) -> String {
        let known = points.iter().filter_map(|(point, on)| {
            let on = if (*on)? { "on" } else { "off" };
            Some(format!("{}={on}", self.label(module, *point)))
        });
        known.collect::<Vec<_>>().join(" ")
    }

    /// What an op does to the outputs of a module that something is said of.
    fn effect(&self, module: &str, points: &[Point], op: &Op) -> Effect {
        let config = self.site.config();
        let watched = |place: &Place| {
            let of = |safety: &Safety| {
                !safety.interlock.is_empty() || safety.min_off.is_some() || safety.max_on.is_some()
            };
            config.safety(place).is_some_and(of)
        };
        let places = points.iter().map(|point| Place::new(module, *point));
        let (rising, falling): (Vec<_>, Vec<_>) = places
            .filter(watched)
            .partition(|place| rises(op, place.point));
        Effect {
            rising,
            off: Vec::new(),
            falling,
            begins: self.begins(module, points, op),
        }
    }

    /// What a command switched on is reserved no longer: from now on readings say how it is.
    fn release(&mut self, module: &str, effect: &Effect, acted: Acted, limits: &[(Place, u64)]) {
        let Effect {
            rising,
            falling,
            begins,
            ..
        } = effect;
        let (from, now) = (self.line_time(module), self.now.site);
        let doubt = match acted {
            Acted::No => None,
            Acted::Surely if begins.is_empty() => None,
            Acted::Surely | Acted::Perhaps => Some(from),
        };
        for place in rising {
            self.guard.ended(place, doubt);
            let begins = begins.iter().find(|one| one.point == place.point);
            if let Some(begins) = begins.filter(|_| acted != Acted::No) {
                self.went_off(place, now + begins.length);
            }
        }
        if acted != Acted::No {
            for place in falling {
                // What was read before says no more that it is on.
                self.guard.doubt(place, doubt);
                self.went_off(place, now);
            }
            // Where the switching on before it was never seen, no reading is news.
            self.keep_off_of(rising.iter().chain(falling));
            return;
        }
        // What was never sent has begun no longest time; one that ran before goes on.
        for (place, number) in limits {
            let known = self.site.point(&place.module, place.point, from).0;
            if known.is_none_or(|known| known.value != PointValue::Bool(true)) {
                self.schedule.leave_out_one(*number);
            }
        }
    }
}

/// Whether an op may switch an output on.
fn rises(op: &Op, point: Point) -> bool {
    match op {
        Op::Write(bank) | Op::WriteSilent(bank) => bank_state(*bank, point) == Some(true),
        // Whatever it is now, it may be on before it is read again.
        Op::Toggle(_) | Op::Jog { .. } => true,
        _ => false,
    }
}

const fn end_of(end: &Result<Done, Fault>) -> End {
    match end {
        Ok(done) => match done.confirmed {
            Confirmation::Readback => End::Readback,
            Confirmation::Reply => End::Reply,
            Confirmation::Sent => End::Sent,
        },
        Err(fault) => End::Failed {
            name: fault.name(),
            may_have_acted: fault.may_have_acted(),
        },
    }
}

pub(super) fn places(module: &str, points: &[Point]) -> impl Iterator<Item = Place> {
    points.iter().map(move |point| Place::new(module, *point))
}

pub(super) fn channel(point: Point) -> Result<Channel, CommandError> {
    Channel::new(point.index).ok_or(CommandError::NoSuchPoint)
}

pub(super) fn bank_state(bank: Bank, point: Point) -> Option<bool> {
    bank.get(Channel::new(point.index)?)
}
