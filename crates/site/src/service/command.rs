//! Commands: what is checked before they go to the line, and what is told of their end.

use super::record::Begun;
use super::timer::to_its_end;
use super::turn::Turn;
use super::underway::Underway;
use super::{Inner, Service, lock};
use crate::config::{ModuleConfig, Place};
use crate::{Failure, Value};
use railbus_device::{Bank, Module, Observation, Op, Point, PointKind};
use railbus_host::{Confirmed, Done, Fault, Line, ModuleId, Probe, ProbeResult, Tap, Terms};
use railbus_store::audit::Note;
use railbus_wire::{Channel, Exchange, Micros, Settings};
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;

/// How long a frame of one's own waits for the reply to begin, where nobody says.
const RAW_TIMEOUT: Micros = Micros::from_millis(300);

/// How long after it was asked for a command may still be sent.
pub(super) const TTL: Duration = Duration::from_secs(5);

/// On what terms outputs are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteTerms {
    /// Read the outputs back and compare, where the module can.
    pub verify: bool,
    /// In the form that no module answers.
    pub silent: bool,
    /// Only where every one of the outputs is in this state now, for which they are read first.
    pub only_if: Option<bool>,
    /// Who asks means it, also for outputs that want that to be said.
    pub confirm: bool,
}

impl Default for WriteTerms {
    fn default() -> WriteTerms {
        WriteTerms {
            verify: true,
            silent: false,
            only_if: None,
            confirm: false,
        }
    }
}

/// On what terms an output is switched over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ToggleTerms {
    /// By the board's own command, which is never repeated; else it is read first and then set.
    pub raw: bool,
    /// Who asks means it, also for outputs that want that to be said.
    pub confirm: bool,
}

/// How outputs were written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WriteDone {
    /// Each output with what it is now, and what it was before, where that is known.
    pub outputs: Vec<(Point, Option<bool>, Option<bool>)>,
    /// How far that is certain.
    pub confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub took: Micros,
    /// The number of its audit entry.
    pub audit: String,
    /// It was made of a read and a write.
    pub read_then_set: bool,
}

/// On what terms a read of one's own is sent; what is not said is as the line has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawTerms {
    /// Speed and character format.
    pub settings: Option<Settings>,
    /// The silence before it.
    pub gap: Option<Micros>,
    /// How long the reply may take to begin.
    pub timeout: Option<Micros>,
    /// A lone CR goes before it: see [`railbus_host::Probe::clear`].
    pub clear: bool,
}

/// A command of the line to outputs of one module.
pub(super) struct Order<'a> {
    pub(super) module: &'a str,
    /// Where the module hung when the output's turn came: while a command is under way, its name
    /// may become that of another board. One that has left answers [`Fault::Closed`].
    pub(super) at: Option<(Line, ModuleId)>,
    pub(super) points: &'a [Point],
    pub(super) op: Op,
    pub(super) verify: bool,
    /// What was not sent by then is not sent any more.
    pub(super) expires: Instant,
}

/// What is written down of a command. One that is tried again and again is written down when it
/// fails first, and then once more for all tries after that.
pub(super) struct Entry {
    pub(super) note: Note,
    /// The end of what was promised: it is done once it is read back.
    pub(super) is_release: bool,
    /// How it failed last.
    pub(super) failed: Option<&'static str>,
    /// Of the tries after the first.
    pub(super) open: Option<Begun>,
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

    pub(super) fn of_release(note: Note) -> Entry {
        Entry {
            is_release: true,
            ..Entry::new(note)
        }
    }
}

impl Service {
    /// Brings outputs of one module into these states with one command of the line, and leaves
    /// the others alone.
    ///
    /// # Errors
    /// [`Failure`]; [`Failure::may_have_acted`] says whether something may have happened even
    /// so.
    pub async fn write(
        &self,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, Failure> {
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        self.inner.may_command(module, &points, terms.confirm)?;
        let (service, module, set) = (self.clone(), module.to_owned(), set.to_vec());
        to_its_end(async move { service.write_asked(&module, &set, terms).await }).await
    }

    async fn write_asked(
        &self,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, Failure> {
        let expires = Instant::now() + TTL;
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        let turn = self.inner.turn(places(module, &points), expires).await?;
        // Meanwhile the configuration may have changed, or the site begun to end.
        self.inner.may_command(module, &points, terms.confirm)?;
        if let Some(wanted) = terms.only_if {
            self.read_fresh(module).await?;
            let known = |point| self.inner.output(module, point);
            let other = points.iter().find(|point| known(**point) != Some(wanted));
            if let Some(point) = other {
                return Err(Failure::NotAsAsked(*point, !wanted));
            }
        }
        let on = set.iter().filter(|(_, on)| *on).map(|(point, _)| *point);
        self.inner.watched(module, on)?;
        let done = self
            .write_in_turn(&turn, module, set, terms, expires)
            .await?;
        self.inner.take_over(module, &points, done).await
    }

    /// The same at the end of the site: nobody is asked whether it is meant, and how many wait
    /// does not matter.
    pub(super) async fn write_at_exit(
        &self,
        module: &str,
        set: &[(Point, bool)],
    ) -> Result<WriteDone, Failure> {
        let (service, module, set) = (self.clone(), module.to_owned(), set.to_vec());
        to_its_end(async move {
            let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
            let turn = service.inner.turn_to_end(places(&module, &points)).await;
            let (terms, expires) = (WriteTerms::default(), Instant::now() + TTL);
            let done = service.write_in_turn(&turn, &module, &set, terms, expires);
            let done = done.await?;
            service.inner.take_over(&module, &points, done).await
        })
        .await
    }

    /// Writes outputs whose turn it is. What was to be done to them later still is.
    pub(super) async fn write_in_turn(
        &self,
        turn: &Turn,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
        expires: Instant,
    ) -> Result<WriteDone, Failure> {
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        self.inner.writable(module, &points)?;
        let mut bank = Bank::default();
        for (point, on) in set {
            let one = Bank::one(channel(*point)?, *on);
            bank = Bank::new(bank.mask | one.mask, bank.on & !one.mask | one.on);
        }
        let op = if terms.silent {
            Op::WriteSilent(bank)
        } else {
            Op::Write(bank)
        };
        let mut entry = Entry::new(self.note(self.inner.describe(module, set)));
        let order = Order {
            module,
            at: self.inner.place(module),
            points: &points,
            op,
            verify: terms.verify,
            expires,
        };
        let wanted = |point| bank_state(bank, point);
        self.inner.command(turn, order, &mut entry, wanted).await
    }

    /// Switches an output over. Where it is read first and then set, someone else may come
    /// between.
    ///
    /// # Errors
    /// As [`Service::write`]; [`Fault::Unsupported`] where the model has no such command.
    pub async fn toggle(
        &self,
        module: &str,
        point: Point,
        terms: ToggleTerms,
    ) -> Result<WriteDone, Failure> {
        self.inner.may_command(module, &[point], terms.confirm)?;
        let (service, module) = (self.clone(), module.to_owned());
        to_its_end(async move { service.toggle_asked(&module, point, terms).await }).await
    }

    async fn toggle_asked(
        &self,
        module: &str,
        point: Point,
        terms: ToggleTerms,
    ) -> Result<WriteDone, Failure> {
        let ToggleTerms { raw, confirm } = terms;
        let expires = Instant::now() + TTL;
        let turn = self.inner.turn(places(module, &[point]), expires).await?;
        self.inner.may_command(module, &[point], confirm)?;
        let done = if raw {
            self.inner.watched(module, [point])?;
            let note = self.note(format!("toggle {}", self.inner.label(module, point)));
            let order = Order {
                module,
                at: self.inner.place(module),
                points: &[point],
                op: Op::Toggle(channel(point)?.mask()),
                verify: true,
                expires,
            };
            let mut entry = Entry::new(note);
            self.inner
                .command(&turn, order, &mut entry, |_| None)
                .await?
        } else {
            let read = self.read_fresh(module).await;
            read.map_err(|failure| match failure {
                Failure::Line(fault) => Failure::NotRead(fault),
                other => other,
            })?;
            let now = self.inner.output(module, point);
            let now = now.ok_or(Failure::NotRead(Fault::Unknown))?;
            self.inner.watched(module, (!now).then_some(point))?;
            let (set, terms) = ([(point, !now)], WriteTerms::default());
            let done = self.write_in_turn(&turn, module, &set, terms, expires);
            WriteDone {
                read_then_set: true,
                ..done.await?
            }
        };
        self.inner.take_over(module, &[point], done).await
    }

    /// Asks a module for everything now. What it says is known when this returns.
    ///
    /// # Errors
    /// [`Failure::NoSuchModule`], or what the line said.
    pub async fn read_fresh(&self, module: &str) -> Result<(), Failure> {
        self.inner.read_all(module).await
    }

    /// Sends a read of one's own between the line's own exchanges.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`], or what the line said.
    pub async fn raw(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<ProbeResult, Failure> {
        let (handle, probe) = self.probe_of(line, exchange, terms)?;
        Ok(handle.probe(probe).await?)
    }

    /// A line, and a frame of one's own as it is to be sent there.
    pub(super) fn probe_of(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
    ) -> Result<(Line, Probe), Failure> {
        let status = self.line(line).ok_or(Failure::NoSuchLine)?;
        let handle = self.inner.handle(line).ok_or(Failure::Lent)?;
        let settings = terms.settings.unwrap_or(status.serial);
        // What the slowest of the families wants.
        let gap = Micros::from_millis(20).max(settings.t3_5());
        let probe = Probe {
            exchange,
            settings,
            gap: terms.gap.unwrap_or(gap),
            timeout: terms.timeout.unwrap_or(RAW_TIMEOUT),
            clear: terms.clear,
            changes: false,
        };
        Ok((handle, probe))
    }

    /// Looks on at what passes on a line, without touching it. The moment is now as the line
    /// counts.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`], or [`Fault::Closed`] while the line has no port.
    pub async fn tap(&self, line: &str) -> Result<(railbus_wire::Instant, Tap), Failure> {
        let handle = self.inner.handle(line).ok_or(Failure::NoSuchLine)?;
        // A line that is only just being opened will have a port in a moment.
        let _ = handle.opened().await;
        let tap = handle.tap().await?;
        Ok((handle.now(), tap))
    }
}

impl Inner {
    pub(super) fn described(&self, module: &str) -> Result<ModuleConfig, Failure> {
        let state = lock(&self.state);
        let config = state.site.config().modules.get(module);
        config.cloned().ok_or(Failure::NoSuchModule)
    }

    /// Asks a module for everything now.
    pub(super) async fn read_all(&self, module: &str) -> Result<(), Failure> {
        let setup = self.described(module)?.setup;
        let described = Module::new(setup).map_err(|_| Fault::Unsupported)?;
        for op in described.full_poll() {
            self.run(module, op, false).await?;
        }
        Ok(())
    }

    /// Whether somebody may switch these points now.
    pub(super) fn may_command(
        &self,
        module: &str,
        points: &[Point],
        confirm: bool,
    ) -> Result<(), Failure> {
        self.writable(module, points)?;
        if self.schedule.are_stopping() {
            return Err(Fault::Closed.into());
        }
        let state = lock(&self.state);
        let config = state.site.config();
        let safety = |point: &Point| config.safety(&Place::new(module, *point));
        let asks = |point: &&Point| safety(point).is_some_and(|safety| safety.confirm.is_some());
        match points.iter().find(asks) {
            Some(point) if !confirm => Err(Failure::Confirm(*point)),
            _ => Ok(()),
        }
    }

    /// Somebody sees to it that these outputs are switched off when they have been on for as
    /// long as they may.
    pub(super) fn watched(
        &self,
        module: &str,
        on: impl IntoIterator<Item = Point>,
    ) -> Result<(), Failure> {
        let state = lock(&self.state);
        let limited = |point: &Point| {
            let safety = state.site.config().safety(&Place::new(module, *point));
            safety.is_some_and(|safety| safety.max_on.is_some())
        };
        match on.into_iter().find(limited) {
            Some(point) if !self.polls => Err(Failure::Unwatched(point)),
            _ => Ok(()),
        }
    }

    /// Whether these points are outputs that may be written.
    pub(super) fn writable(&self, module: &str, points: &[Point]) -> Result<(), Failure> {
        let config = self.described(module)?;
        if points.is_empty() {
            return Err(Failure::NoSuchPoint);
        }
        for point in points {
            if point.index >= config.setup.count(point.kind) {
                return Err(Failure::NoSuchPoint);
            }
            if point.kind != PointKind::Output {
                return Err(Failure::NotAnOutput(*point));
            }
            if config.points.get(point).is_some_and(|point| point.locked) {
                return Err(Failure::Locked(*point));
            }
        }
        Ok(())
    }

    /// What an output was when it was last read.
    pub(super) fn output(&self, module: &str, point: Point) -> Option<bool> {
        let state = lock(&self.state);
        let (known, _) = state.site.point(module, point, railbus_wire::Instant(0));
        match known?.value {
            Value::Bool(on) => Some(on),
            Value::Analog(..) | Value::Number(_) => None,
        }
    }

    pub(super) fn label(&self, module: &str, point: Point) -> String {
        let label = self.described(module).map(|module| {
            let (letters, number) = module.setup.label(point);
            format!("{letters}{number}")
        });
        label.unwrap_or_default()
    }

    fn describe(&self, module: &str, set: &[(Point, bool)]) -> String {
        let mut text = String::new();
        for (point, on) in set {
            let on = if *on { "on" } else { "off" };
            // Writing into a String does not fail.
            let _ = write!(text, "{}={on} ", self.label(module, *point));
        }
        text.truncate(text.trim_end().len());
        text
    }

    /// A command was carried out: its outputs are in no pulse and no lease any more. A frame that
    /// nobody answers may not have been heard, and takes nothing over.
    pub(super) async fn take_over(
        &self,
        module: &str,
        points: &[Point],
        done: WriteDone,
    ) -> Result<WriteDone, Failure> {
        if done.confirmed != Confirmed::Sent {
            let places: Vec<Place> = places(module, points).collect();
            let taken = self.schedule.take_over(&places, None).await;
            taken.map_err(|why| Failure::NotTakenOver(why.kind()))?;
        }
        Ok(done)
    }

    /// One command of the line: what it is allowed to do, its audit entry, and the states before
    /// and after. Every switching of an output comes through here, and it is its turn.
    pub(super) async fn command(
        self: &Arc<Inner>,
        _turn: &Turn,
        order: Order<'_>,
        entry: &mut Entry,
        wanted: impl Fn(Point) -> Option<bool>,
    ) -> Result<WriteDone, Failure> {
        let Order {
            module,
            at,
            points,
            op,
            verify,
            expires,
        } = order;
        let effect = self.effect(module, points, &op);
        self.ask_excluded(&effect.rising).await;
        let mut underway = Underway::begin(self, module, points, entry, effect).await?;
        underway.limit().await;
        let end = self.run_at(at, module, op, verify, expires).await;
        let after = |point: &Point| {
            let done = end.as_ref().ok()?;
            match (done.confirmed, done.seen) {
                (Confirmed::Sent, _) => None,
                // What was read counts for more than what was wanted: a pulse may be over.
                (_, Some(Observation::Channels { outputs, .. })) => bank_state(outputs, *point),
                (Confirmed::Readback | Confirmed::Reply, _) => wanted(*point),
            }
        };
        let after: Vec<_> = points.iter().map(|point| (*point, after(point))).collect();
        let (audit, before) = underway.end(&end, &after, entry).await;
        let done = end?;
        let outputs = after.into_iter().zip(before);
        Ok(WriteDone {
            outputs: outputs
                .map(|((point, after), (_, before))| (point, after, before))
                .collect(),
            confirmed: done.confirmed,
            took: done.took,
            audit,
            read_then_set: false,
        })
    }

    /// Does an op with a module, within the time that a command has.
    pub(super) async fn run(&self, module: &str, op: Op, verify: bool) -> Result<Done, Fault> {
        let (at, expires) = (self.place(module), Instant::now() + TTL);
        self.run_at(at, module, op, verify, expires).await
    }

    /// Does an op with a module; counts what the module or the line did wrong. What was not sent
    /// by then is not sent any more.
    async fn run_at(
        &self,
        at: Option<(Line, ModuleId)>,
        module: &str,
        op: Op,
        verify: bool,
        expires: Instant,
    ) -> Result<Done, Fault> {
        let (line, id) = at.ok_or(Fault::Closed)?;
        let left = expires.saturating_duration_since(Instant::now());
        let left = Micros(u64::try_from(left.as_micros()).unwrap_or(u64::MAX));
        let terms = Terms {
            verify,
            expires: Some(line.now() + left),
        };
        let end = line.run(id, op, terms).await;
        if let Err(
            fault
            @ (Fault::NoReply(_) | Fault::Garbled(_) | Fault::Refused(_) | Fault::NotVerified),
        ) = &end
        {
            let now = self.now();
            lock(&self.state).missed(module, now, fault);
        }
        end
    }
}

pub(super) const fn confirmed_name(confirmed: Confirmed) -> &'static str {
    match confirmed {
        Confirmed::Readback => "readback",
        Confirmed::Reply => "reply",
        Confirmed::Sent => "sent",
    }
}

pub(super) fn places(module: &str, points: &[Point]) -> impl Iterator<Item = Place> {
    points.iter().map(move |point| Place::new(module, *point))
}

pub(super) fn channel(point: Point) -> Result<Channel, Failure> {
    Channel::new(point.index).ok_or(Failure::NoSuchPoint)
}

pub(super) fn bank_state(bank: Bank, point: Point) -> Option<bool> {
    bank.get(Channel::new(point.index)?)
}
