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
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// A pulse that has ended is known for so long: no batch takes longer.
const KEPT_FOR: Micros = Micros::from_secs(3_600);
/// A command that is sent just before its deadline is carried out so long after it at most.
const SEND_MARGIN: Micros = Micros::from_secs(1);

/// When a pulse of this length is over at the latest: a module keeps time by a clock of its own.
const fn longest(length: Micros) -> Micros {
    Micros(length.0 + length.0 / 64)
}

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
pub(super) struct NewPulse {
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
    /// Those whose command is about to be sent, and when they end at the latest.
    pending: BTreeMap<u64, (Output, Micros)>,
    newest: u64,
    /// The last names of their boards: one that was removed may come back at another address.
    names: BTreeMap<Board, String>,
}

impl OwnPulses {
    pub(super) fn get(&self, board: &Board, point: Point) -> Option<OwnPulse> {
        self.each.get(&(board.clone(), point)).copied()
    }

    /// Until when outputs may change by themselves.
    fn running(&self, now: Micros) -> impl Iterator<Item = (&Output, Micros)> {
        let each = self.each.iter();
        let each = each.map(|(output, pulse)| (output, pulse.until));
        let pending = self.pending.values();
        let pending = pending.map(|(output, until)| (output, *until));
        each.chain(pending).filter(move |(_, until)| *until > now)
    }

    /// Whether any output may change by itself.
    pub(super) fn any(&self, now: Micros) -> bool {
        self.running(now).next().is_some()
    }

    /// A pulse began.
    fn began(&mut self, board: &Board, one: &NewPulse, now: Micros) {
        let (until, end) = (now + longest(one.length), Some(one.end));
        self.insert(board, one.point, OwnPulse { until, end }, now);
    }

    /// A pulse may have begun that ends then at the latest.
    pub(super) fn may_have_begun(
        &mut self,
        board: &Board,
        point: Point,
        until: Micros,
        now: Micros,
    ) {
        let before = self.get(board, point);
        let until = before.map_or(until, |before| before.until.max(until));
        self.insert(board, point, OwnPulse { until, end: None }, now);
    }

    fn insert(&mut self, board: &Board, point: Point, pulse: OwnPulse, now: Micros) {
        self.each.retain(|_, pulse| pulse.until + KEPT_FOR > now);
        self.each.insert((board.clone(), point), pulse);
        let each = &self.each;
        let is_there = |board: &Board| each.keys().any(|(other, _)| other == board);
        self.names.retain(|board, _| is_there(board));
    }

    /// Something may have ended the pulses of these.
    fn doubt(&mut self, of: impl Fn(&Board, Point) -> bool) {
        let doubted = self.each.iter_mut();
        for (_, pulse) in doubted.filter(|((board, at), _)| of(board, *at)) {
            pulse.end = None;
        }
    }

    /// There is another configuration, and these names stand for other boards now. Whether a board
    /// was moved or is another one is not known: a pulse may be of the board that has the name that
    /// its board had last, or of a new one at the address of a board that has none any more. How it
    /// ends is not known then.
    pub(super) fn reconfigure(
        &mut self,
        old: &Boards,
        new: &Boards,
        is_other: impl Fn(&str) -> bool,
        now: Micros,
    ) {
        let names = old.keys().chain(new.keys()).filter(|name| is_other(name));
        let others: BTreeSet<&Board> = names
            .flat_map(|name| [old.get(name), new.get(name)])
            .flatten()
            .collect();
        self.doubt(|board, _| others.contains(board));
        let named = old
            .iter()
            .map(|(name, board)| (board.clone(), name.clone()));
        self.names.extend(named);
        let mut moved = Vec::new();
        for ((board, point), until) in self.running(now) {
            let by_name = self.names.get(board).and_then(|name| new.get(name));
            let by_address = new.values().filter(|to| !has(old, to));
            let by_address = by_address.filter(|to| may_be_same(board, to, new));
            let to = by_name.into_iter().chain(by_address);
            let to = to.filter(|to| *to != board);
            moved.extend(to.map(|to| (to.clone(), *point, until)));
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
        let by_name = boards.get(&place.module);
        let by_address = boards.values().filter(|to| {
            let from = board.as_ref();
            from.is_some_and(|from| may_be_same(from, to, boards))
        });
        let each: BTreeSet<&Board> = board.iter().chain(by_name).chain(by_address).collect();
        for board in each {
            self.may_have_begun(board, place.point, until, now.site);
            self.names.insert(board.clone(), place.module.clone());
        }
    }

    /// Those that run, or may soon, as they are written down.
    pub(super) fn kept(&self, boards: &Boards, now: Now) -> Vec<Kept> {
        let mut each: BTreeMap<&Output, Micros> = BTreeMap::new();
        for (output, until) in self.running(now.site) {
            let latest = each.entry(output).or_default();
            *latest = (*latest).max(until);
        }
        let kept = each.into_iter().map(|((board, point), until)| {
            let name = boards.iter().find(|(_, other)| *other == board);
            let name = name.map(|(name, _)| name);
            let name = name.or_else(|| self.names.get(board));
            let name = name.map_or("", String::as_str);
            let length = Duration::from_micros((until - now.site).0);
            let promise = Promise::after(now.wall, length, None);
            let key = (Place::new(name, *point), Why::OwnPulse);
            (key, promise, Some(board.clone()))
        });
        kept.collect()
    }
}

fn has(boards: &Boards, board: &Board) -> bool {
    boards.values().any(|other| other == board)
}

/// Whether a board that has no name any more may be this one: its line may have another name.
fn may_be_same(gone: &Board, board: &Board, boards: &Boards) -> bool {
    gone.address == board.address && !has(boards, gone)
}

/// Commands of pulses are about to be sent, or their ends not known yet, until this is dropped.
pub(super) struct Pending(Context, Vec<u64>);

impl Drop for Pending {
    fn drop(&mut self) {
        self.0.with(|state| {
            let schedule = &mut state.schedule;
            for number in &self.1 {
                schedule.own_pulses.pending.remove(number);
            }
            if !self.1.is_empty() {
                // The file has the latest end that was possible, or a pulse that never began.
                schedule.disk.version += 1;
                schedule.disk.soon = true;
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
        begins: &[NewPulse],
        expires: Micros,
    ) -> Result<Pending, CommandError> {
        if begins.is_empty() {
            return Ok(Pending(self.clone(), Vec::new()));
        }
        let numbers = self.with(|state| {
            let schedule = &mut state.schedule;
            schedule.disk.version += 1;
            let pulses = &mut schedule.own_pulses;
            let numbers = begins.iter().map(|one| {
                pulses.newest += 1;
                let latest = expires + SEND_MARGIN + longest(one.length);
                let pending = ((board.clone(), one.point), latest);
                pulses.pending.insert(pulses.newest, pending);
                pulses.newest
            });
            numbers.collect()
        });
        let pending = Pending(self.clone(), numbers);
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
    pub(super) fn begins(&self, module: &str, points: &[Point], op: &Op) -> Vec<NewPulse> {
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
            Some(NewPulse { point, length, end })
        });
        begins.collect()
    }

    /// Takes note of what a command that may have acted has done to the pulses of its outputs. Any
    /// command ends the one that runs [R55 §2.14]; `is_certain` if this one was acknowledged.
    pub(super) fn note_own_pulses(
        &mut self,
        board: &Board,
        points: &[Point],
        begins: &[NewPulse],
        is_certain: bool,
    ) {
        let (now, schedule) = (self.now.site, &mut self.schedule);
        let pulses = &mut schedule.own_pulses;
        for point in points {
            match begins.iter().find(|one| one.point == *point) {
                Some(one) if is_certain => pulses.began(board, one, now),
                Some(one) => {
                    let until = now + longest(one.length);
                    pulses.may_have_begun(board, *point, until, now);
                }
                None if is_certain => {
                    let ended = pulses.each.remove(&(board.clone(), *point));
                    if ended.is_some_and(|pulse| pulse.until > now) {
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
