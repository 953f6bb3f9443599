//! Pulses that modules time by themselves [R55 §3.6]. Until such a pulse has ended the output still
//! changes without a command, so what is read of it does not stay so. Each is written down before
//! its command is sent: a module goes on while the process does not.

use super::Now;
use super::context::Context;
use super::order::bank_state;
use super::promises::{Board, Boards, Kept, Promise, Why};
use super::schedule::Schedule;
use super::state::State;
use crate::CommandError;
use crate::config::Place;
use railbus_device::{Op, Point};
use railbus_host::Fault;
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::time::Duration;

/// What ended longer ago than this is forgotten: no batch takes so long.
const KEPT: Micros = Micros::from_secs(3_600);

/// A pulse that a module times by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OwnPulse {
    /// It ends then at the latest, in the time of the site.
    pub(super) until: Micros,
    /// The state of the output after that; none where a later command may have ended it, or it may
    /// not have begun: then it is not known whether the output still changes by itself.
    pub(super) end: Option<bool>,
}

/// A pulse that a command begins at its module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Begins {
    pub(super) point: Point,
    pub(super) length: Micros,
    /// The state after it.
    pub(super) end: bool,
}

/// An output of a board, whatever that is called.
type Output = (Board, Point);

/// The pulses of all boards. They stay with their board when its name becomes another's.
#[derive(Debug, Default)]
pub(super) struct OwnPulses {
    each: BTreeMap<Output, OwnPulse>,
    /// When pulses end at the latest whose command is about to be sent.
    pending: BTreeMap<Output, Micros>,
}

impl OwnPulses {
    pub(super) fn get(&self, board: &Board, point: Point) -> Option<OwnPulse> {
        self.each.get(&(board.clone(), point)).copied()
    }

    /// A pulse began that ends then.
    pub(super) fn began(&mut self, board: &Board, point: Point, pulse: OwnPulse, now: Micros) {
        self.each.retain(|_, pulse| pulse.until + KEPT > now);
        self.each.insert((board.clone(), point), pulse);
    }

    /// A pulse may have begun that ends then.
    pub(super) fn may_have_begun(
        &mut self,
        board: &Board,
        point: Point,
        until: Micros,
        now: Micros,
    ) {
        let before = self.get(board, point);
        let until = before.map_or(until, |before| before.until.max(until));
        self.began(board, point, OwnPulse { until, end: None }, now);
    }

    /// A later command has ended what ran at this output. Says whether anything did.
    pub(super) fn ended(&mut self, board: &Board, point: Point, now: Micros) -> bool {
        let ended = self.each.remove(&(board.clone(), point));
        ended.is_some_and(|pulse| pulse.until > now)
    }

    /// Something may have ended the pulses of these.
    pub(super) fn doubt(&mut self, of: impl Fn(&Board, Point) -> bool) {
        let doubted = self
            .each
            .iter_mut()
            .filter(|((board, at), _)| of(board, *at));
        for (_, pulse) in doubted {
            pulse.end = None;
        }
    }

    /// Names stand for other boards. Whether it is the same board that was moved, or another one,
    /// is not always known: a pulse may be of the board that has the name now as well.
    pub(super) fn may_have_moved(&mut self, old: &Boards, new: &Boards, now: Micros) {
        let mut moved = Vec::new();
        for (name, from) in old {
            let Some(to) = new.get(name).filter(|to| *to != from) else {
                continue;
            };
            let pulses = self.each.iter().filter(|((board, _), _)| board == from);
            moved.extend(pulses.map(|((_, point), pulse)| (to.clone(), *point, pulse.until)));
        }
        for (board, point, until) in moved {
            self.may_have_begun(&board, point, until, now);
        }
    }

    /// What was written down before the process began. What came after that is not known.
    pub(super) fn take_up(&mut self, kept: &Kept, boards: &Boards, now: Now) {
        let ((place, _), promise, board) = kept;
        let left = promise.left(now.wall).as_micros();
        let until = now.site + Micros(u64::try_from(left).unwrap_or(u64::MAX));
        for board in [board.as_ref(), boards.get(&place.module)]
            .into_iter()
            .flatten()
        {
            self.may_have_begun(board, place.point, until, now.site);
        }
    }

    /// Those that run, or may soon, as they are written down.
    pub(super) fn kept(&self, boards: &Boards, now: Now) -> Vec<Kept> {
        let mut until: BTreeMap<&Output, Micros> = BTreeMap::new();
        let running = self
            .each
            .iter()
            .map(|(output, pulse)| (output, pulse.until));
        let pending = self.pending.iter().map(|(output, until)| (output, *until));
        for (output, end) in running.chain(pending).filter(|(_, end)| *end > now.site) {
            let until = until.entry(output).or_default();
            *until = (*until).max(end);
        }
        let kept = until.into_iter().map(|((board, point), until)| {
            let name = boards.iter().find(|(_, other)| *other == board);
            let name = name.map_or("", |(name, _)| name);
            let length = Duration::from_micros((until - now.site).0);
            let promise = Promise::after(now.wall, length, None);
            let key = (Place::new(name, *point), Why::OwnPulse);
            (key, promise, Some(board.clone()))
        });
        kept.collect()
    }
}

/// The command of a pulse is about to be sent, or its end is not known yet, until this is dropped.
pub(super) struct Pending(Context, Board, Vec<Point>);

impl Drop for Pending {
    fn drop(&mut self) {
        self.0.with(|state| {
            for point in &self.2 {
                let output = (self.1.clone(), *point);
                state.schedule.own_pulses.pending.remove(&output);
            }
        });
    }
}

impl Context {
    /// Writes down which pulses a command is about to begin that is sent until then; durable when
    /// this returns.
    ///
    /// # Errors
    /// [`CommandError::NotKept`]; [`Fault::Expired`] where the disk takes too long.
    pub(super) async fn promise_own_pulses(
        &self,
        board: &Board,
        begins: &[Begins],
        expires: Micros,
    ) -> Result<Pending, CommandError> {
        let pending = Pending(
            self.clone(),
            board.clone(),
            begins.iter().map(|b| b.point).collect(),
        );
        if begins.is_empty() {
            return Ok(pending);
        }
        self.with(|state| {
            let latest = |one: &Begins| ((board.clone(), one.point), expires + one.length);
            let schedule = &mut state.schedule;
            schedule
                .own_pulses
                .pending
                .extend(begins.iter().map(latest));
            schedule.disk.version += 1;
        });
        let kept = self.until(expires, self.keep()).await;
        let kept = kept.ok_or(Fault::Expired)?;
        kept.map_err(CommandError::NotKept)?;
        Ok(pending)
    }
}

impl State {
    /// The pulse that the module of an output times by itself, if any. It may have ended.
    pub(super) fn own_pulse(&self, place: &Place) -> Option<OwnPulse> {
        let board = self.schedule.boards.get(&place.module)?;
        self.schedule.own_pulses.get(board, place.point)
    }

    /// Whether an output may still change by itself.
    pub(super) fn changes_by_itself(&self, place: &Place) -> bool {
        let pulse = self.own_pulse(place);
        pulse.is_some_and(|pulse| pulse.until > self.now.site)
    }

    /// The pulses that an op begins at a module.
    pub(super) fn begins(&self, module: &str, points: &[Point], op: &Op) -> Vec<Begins> {
        let stored = self.site.pulses(module);
        let begins = points.iter().filter_map(|point| {
            let (millis, end) = match op {
                Op::Jog { close, millis, .. } => (u64::from(millis.get()), !close),
                Op::Write(bank) | Op::WriteSilent(bank)
                    if bank_state(*bank, *point) == Some(true) =>
                {
                    let width = stored?.of(*point)?;
                    (u64::from(width.tenths()) * 100, false)
                }
                _ => return None,
            };
            let (point, length) = (*point, Micros::from_millis(millis));
            Some(Begins { point, length, end })
        });
        begins.collect()
    }

    /// Takes note of what a command that may have acted has done to the pulses of its outputs. Any
    /// command ends the one that runs [R55 §2.14]; `is_certain` if this one was acknowledged.
    pub(super) fn note_own_pulses(
        &mut self,
        board: &Board,
        points: &[Point],
        begins: &[Begins],
        is_certain: bool,
    ) {
        let (now, schedule) = (self.now.site, &mut self.schedule);
        let pulses = &mut schedule.own_pulses;
        for point in points {
            match begins.iter().find(|one| one.point == *point) {
                Some(one) if is_certain => {
                    let (until, end) = (now + one.length, Some(one.end));
                    pulses.began(board, *point, OwnPulse { until, end }, now);
                }
                Some(one) => pulses.may_have_begun(board, *point, now + one.length, now),
                None if is_certain => {
                    if pulses.ended(board, *point, now) {
                        // Otherwise the next start knows of a pulse that is over.
                        schedule.disk.version += 1;
                        schedule.disk.soon = true;
                    }
                }
                None => pulses.doubt(|other, at| other == board && at == *point),
            }
        }
    }

    /// Something may have ended the pulses that these modules time by themselves.
    pub(super) fn doubt_own_pulses(&mut self, of: impl Fn(&str) -> bool) {
        let Schedule {
            boards, own_pulses, ..
        } = &mut self.schedule;
        let is_of = |board: &Board| boards.iter().any(|(name, at)| at == board && of(name));
        own_pulses.doubt(|board, _| is_of(board));
    }
}
