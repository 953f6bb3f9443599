//! The boards with their power and their line, and the judge that sees all of it.

use super::order::{Order, once_only};
use crate::dice::Dice;
use crate::http::{ask, get};
use crate::oracle::{Oracle, Told, ToldEnd};
use crate::site::{Site, said};
use railbus_conformance::Bench;
use railbus_device::{PointKind, Setup};
use railbus_qemu::{Board, Hub};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// One in this many characters is lost or has a wrong bit.
const SPOILT: u64 = 400;

/// A garbled character has its effect within this time, in microseconds.
const HARM: u64 = 1_000_000;

/// The firmware looks at its inputs no longer than 5 ms before the request that asks for them; in
/// microseconds, with room for an emulator.
const SENSED: u64 = 50_000;

/// The pause between two commands for a module, in milliseconds.
const PAUSE: (u64, u64) = (20, 250);

/// A module's place on the line.
pub(super) struct Seat {
    pub(super) name: &'static str,
    pub(super) setup: Setup,
    pub(super) index: usize,
    post: Mutex<Post>,
}

/// A board, its outputs as last seen, and when it had no power, in microseconds: from surely off
/// until perhaps on.
struct Post {
    board: Board,
    shown: u32,
    dark: Vec<(u64, u64)>,
}

impl Post {
    fn has_power(&self) -> bool {
        self.dark.last().is_none_or(|(_, until)| *until != u64::MAX)
    }

    /// Whether there was power all the time since then.
    fn was_lit(&self, from: u64) -> bool {
        self.dark.iter().all(|dark| dark.1 < from)
    }

    /// Whether there was no power at all between these.
    fn was_dark(&self, from: u64, to: u64) -> bool {
        self.dark.iter().any(|dark| dark.0 <= from && to <= dark.1)
    }
}

/// How a command ended.
#[derive(Clone, Debug)]
pub(super) struct End {
    pub(super) seat: usize,
    pub(super) began: u64,
    pub(super) how: String,
    pub(super) done: bool,
    /// The board had power all the while.
    pub(super) lit: bool,
}

/// A value as reported.
pub(super) struct Reading {
    pub(super) seat: usize,
    pub(super) good: bool,
    /// The earliest time of its request.
    pub(super) from: u64,
}

/// What was garbled on the line: how many characters, and when the last one was.
#[derive(Default)]
struct Spoilt {
    count: AtomicU64,
    last: AtomicU64,
}

/// Five boards, their line, and what is known of them.
pub(super) struct Plant {
    seed: u64,
    began: Instant,
    socket: PathBuf,
    hub: Hub,
    spoilt: Arc<Spoilt>,
    pub(super) seats: Vec<Seat>,
    judge: Mutex<Oracle>,
    ends: Mutex<Vec<End>>,
    wrong: Mutex<Option<String>>,
    over: AtomicBool,
    tickets: AtomicU64,
}

impl Plant {
    /// The boards of a site, from now on.
    pub(super) fn new(site: &mut Site<'_>, seed: u64) -> Plant {
        let mut judge = Oracle::default();
        let boards = std::mem::take(&mut site.boards).into_iter();
        let setups = railbus_sim::demo::modules().map(|(_, setup)| setup);
        let seats = boards.zip(setups).enumerate();
        let seats = seats.map(|(index, ((name, board), setup))| {
            judge.add(board.outside().levels, once_only(&setup));
            let post = Post {
                board,
                shown: 0,
                dark: Vec::new(),
            };
            Seat {
                name,
                setup,
                index,
                post: Mutex::new(post),
            }
        });
        let plant = Plant {
            seed,
            began: Instant::now(),
            socket: site.socket(),
            hub: site.hub.clone(),
            spoilt: Arc::default(),
            seats: seats.collect(),
            judge: Mutex::default(),
            ends: Mutex::default(),
            wrong: Mutex::default(),
            over: AtomicBool::new(false),
            tickets: AtomicU64::new(0),
        };
        *lock(&plant.judge) = judge;
        plant.disturb();
        plant
    }

    /// Loses and spoils characters from now on.
    fn disturb(&self) {
        let (spoilt, began) = (Arc::clone(&self.spoilt), self.began);
        let mut dice = Dice::new(self.seed);
        self.hub.disturb(move |bytes| {
            bytes.retain_mut(|byte| {
                if !dice.one_in(SPOILT) {
                    return true;
                }
                spoilt.count.fetch_add(1, Ordering::SeqCst);
                spoilt.last.store(micros(began), Ordering::SeqCst);
                *byte ^= 1 << dice.between(0, 7);
                dice.one_in(2)
            });
        });
    }

    pub(super) fn now(&self) -> u64 {
        micros(self.began)
    }

    /// How many characters were garbled so far.
    pub(super) fn spoilt(&self) -> u64 {
        self.spoilt.count.load(Ordering::SeqCst)
    }

    fn spoilt_since(&self, from: u64) -> bool {
        self.spoilt() > 0 && self.spoilt.last.load(Ordering::SeqCst) + HARM >= from
    }

    /// Gives one command after another to a module.
    pub(super) fn drive(&self, seat: &Seat) {
        let mut dice = Dice::new(self.seed ^ (seat.index as u64 + 1) << 32);
        while !self.over.load(Ordering::SeqCst) {
            let order = Order::roll(seat.name, &seat.setup, &mut dice);
            if let Err(why) = self.command(seat, &order) {
                self.found_wrong(format!("{} {}: {why}", order.ask.path, order.ask.body));
            }
            std::thread::sleep(Duration::from_millis(dice.between(PAUSE.0, PAUSE.1)));
        }
    }

    fn command(&self, seat: &Seat, order: &Order) -> Result<(), String> {
        self.look(seat)?;
        let (began, spoilt) = (self.now(), self.spoilt());
        let ticket = self.tickets.fetch_add(1, Ordering::SeqCst);
        lock(&self.judge).commanded(ticket, seat.index, order.wish, began, spoilt);
        let (_, answer) = ask(&self.socket, &order.ask)?;
        let ended = self.now();
        let told = order.told(&seat.setup, &answer)?;
        let shown = self.look(seat)?;
        let post = lock(&seat.post);
        let (dark, lit) = (post.was_dark(began, ended), post.was_lit(began));
        drop(post);
        lock(&self.ends).push(End {
            seat: seat.index,
            began,
            how: told.how.clone(),
            done: told.end == ToldEnd::Done,
            lit,
        });
        let spoiling = self.spoilt_since(began);
        let mut judge = lock(&self.judge);
        judge.ended(ticket, told.end, self.now(), self.spoilt());
        let (mask, on) = told.now;
        let outputs = Told::Outputs { mask, on };
        judge.told(seat.index, outputs, began, self.now(), spoiling);
        drop(judge);
        let done = told.end == ToldEnd::Done;
        if dark && (done || mask != 0) {
            return Err(format!("without power all the while, and yet {answer}"));
        }
        // This module has no other commands: what is reported must still be so.
        let other = (shown ^ on) & mask | (shown ^ order.wish.1) & order.wish.0;
        if lit && done && !spoiling && other != 0 {
            return Err(format!("{answer}, but its board shows {shown:08b}"));
        }
        Ok(())
    }

    /// Reads a board's outputs from outside, and reports them to the judge.
    fn look(&self, seat: &Seat) -> Result<u32, String> {
        self.look_at(seat, &mut lock(&seat.post))
    }

    fn look_at(&self, seat: &Seat, post: &mut Post) -> Result<u32, String> {
        if !post.has_power() {
            return Ok(0);
        }
        let shown = post.board.machine().and_then(|machine| machine.outputs());
        let shown = shown.map_err(|error| format!("{}: {error}", seat.name))?;
        let now = self.now();
        let spoilt = self.spoilt_since(now);
        let mut judge = lock(&self.judge);
        for channel in channels(shown ^ post.shown) {
            let on = shown >> channel & 1 == 1;
            judge.output(now, seat.index, (channel, on), spoilt);
        }
        post.shown = shown;
        Ok(shown)
    }

    /// Takes the power from a module, whatever it is doing.
    pub(super) fn cut(&self, seat: &Seat) -> Result<(), String> {
        let mut post = lock(&seat.post);
        let machine = post.board.machine().map_err(said)?;
        // What it has done until now is seen; it does nothing more.
        machine.halt().map_err(said)?;
        let shown = self.look_at(seat, &mut post)?;
        post.board.power_off();
        let now = self.now();
        post.dark.push((now, u64::MAX));
        let mut judge = lock(&self.judge);
        for channel in channels(shown) {
            judge.lost_power(now, seat.index, channel);
        }
        post.shown = 0;
        Ok(())
    }

    /// Gives it power again; its EEPROM holds what it held.
    pub(super) fn restore(&self, seat: &Seat) -> Result<(), String> {
        let mut post = lock(&seat.post);
        let now = self.now();
        if let Some(last) = post.dark.last_mut() {
            last.1 = now;
        }
        let back = post.board.power_on();
        back.and_then(|()| post.board.join(&self.hub)).map_err(said)
    }

    /// Changes what lies at the inputs of the modules that have power.
    pub(super) fn move_inputs(&self, dice: &mut Dice) -> Result<(), String> {
        for seat in &self.seats {
            let mut post = lock(&seat.post);
            let mut outside = *post.board.outside();
            outside.levels = dice.next() as u32;
            outside.analogs = [0, 1].map(|_| dice.between(0, 1000) as i16);
            if !post.has_power() {
                continue;
            }
            post.board.surround(&outside).map_err(said)?;
            let mut judge = lock(&self.judge);
            judge.inputs(self.now(), seat.index, outside.levels);
            for (channel, value) in outside.analogs.into_iter().enumerate() {
                judge.analog(self.now(), seat.index, channel, value as u16);
            }
        }
        Ok(())
    }

    /// Asks the daemon for every point, looks at every board, and judges.
    pub(super) fn compare(&self) -> Result<Vec<Reading>, String> {
        let asked = self.now();
        let (_, answer) = ask(&self.socket, &get("/api/v1/points"))?;
        let heard = self.now();
        for seat in &self.seats {
            self.look(seat)?;
        }
        let answer: Value = serde_json::from_str(&answer).map_err(said)?;
        let points = answer["points"].as_array().ok_or("no points")?;
        points
            .iter()
            .map(|point| self.judge_point(point, asked, heard))
            .collect()
    }

    fn judge_point(&self, point: &Value, asked: u64, heard: u64) -> Result<Reading, String> {
        let module = point["module"].as_str().unwrap_or_default();
        let seat = self.seats.iter().find(|seat| seat.name == module);
        let seat = seat.ok_or_else(|| format!("no module has {point}"))?;
        let good = point["quality"] == "good";
        // Ages are reported in whole milliseconds, rounded down.
        let age = point["age_ms"].as_u64().map_or(asked, |ms| (ms + 1) * 1000);
        let from = asked.saturating_sub(age);
        if good {
            let (told, sensed) = told(seat, point)?;
            let since = from.saturating_sub(sensed);
            let spoiling = self.spoilt_since(since);
            lock(&self.judge).told(seat.index, told, since, self.now(), spoiling);
            if lock(&seat.post).was_dark(from, heard) {
                return Err(format!("without power all the while, and yet {point}"));
            }
        }
        let seat = seat.index;
        Ok(Reading { seat, good, from })
    }

    /// Records that something is wrong; the first one counts.
    fn found_wrong(&self, what: String) {
        lock(&self.wrong).get_or_insert(what);
    }

    /// What was found to be wrong so far.
    pub(super) fn check(&self) -> Result<(), String> {
        let judged = lock(&self.judge).first_wrong.clone();
        match lock(&self.wrong).clone().or(judged) {
            Some(wrong) => Err(wrong),
            None => Ok(()),
        }
    }

    /// No more commands; pending ones come to their end.
    pub(super) fn stop(&self) {
        self.over.store(true, Ordering::SeqCst);
    }

    pub(super) fn ends(&self) -> Vec<End> {
        lock(&self.ends).clone()
    }

    /// Every record of the audit log.
    pub(super) fn audit(&self) -> Result<Vec<Value>, String> {
        let path = "/api/v1/audit/export?format=ndjson";
        let (_, text) = ask(&self.socket, &get(path))?;
        let records = text
            .lines()
            .map(|line| serde_json::from_str(line).map_err(said));
        records.collect()
    }

    /// Access to the judge.
    pub(super) fn judge(&self) -> MutexGuard<'_, Oracle> {
        lock(&self.judge)
    }
}

/// A reported point, and how much before its request the module may have sampled it.
fn told(seat: &Seat, point: &Value) -> Result<(Told, u64), String> {
    let label = point["label"].as_str().unwrap_or_default();
    let known = seat.setup.point(label);
    let known = known.ok_or_else(|| format!("no output or input is {point}"))?;
    let mask = 1u32 << known.index;
    let on = mask * u32::from(point["value"] == true);
    Ok(match known.kind {
        PointKind::Output => (Told::Outputs { mask, on }, 0),
        PointKind::Input => (Told::Inputs { mask, on }, SENSED),
        _ => {
            let value = point["value"].as_f64().unwrap_or(f64::MAX) * 100.0;
            let channel = known.index.into();
            let value = value.round() as u16;
            (Told::Analog { channel, value }, SENSED)
        }
    })
}

fn channels(mask: u32) -> impl Iterator<Item = u8> {
    (0..32).filter(move |channel| mask >> channel & 1 == 1)
}

fn micros(began: Instant) -> u64 {
    // The judge's past begins at 0.
    1 + began.elapsed().as_micros() as u64
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().expect("no thread panics")
}
