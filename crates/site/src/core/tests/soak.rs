//! Seeds: several clients, faults of line, disk and audit log, dead modules, kills between any two
//! steps. The judge knows nothing of the core: it sees what was asked, what was told, and what the
//! relays did.

use super::super::order::TTL;
use super::super::*;
use super::world::{Dice, Faults, Logged, World, at, bit, ms, who_is};
use crate::Failure;
use crate::rights::Who;
use railbus_device::Bank;
use std::sync::Mutex;

const TEXT: &str = r#"
[line.main]
port = "/dev/ttyS8"
[line.far]
port = "/dev/ttyS9"
[module.oven]
line = "main"
model = "erc8"
address = 3
[module.oven.point]
k1.interlock = ["oven.k2"]
k2.interlock = ["oven.k1"]
k3.max_on = "20s"
k4.min_off = "5s"
k5.on_return = "off"
[module.kiln]
line = "main"
model = "erc8"
address = 4
[module.pump]
line = "far"
model = "erc8"
address = 3
[group.all]
members = ["oven.k6", "kiln.k1", "pump.k2"]
"#;

const GROUP: [(&str, u8); 3] = [("oven", 6), ("kiln", 1), ("pump", 2)];
const MODULES: [&str; 3] = ["oven", "kiln", "pump"];
/// Longer than any lease, pulse or limit, and than the pause between two tries.
const QUIET: Micros = ms(150_000);

/// What a client was told of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    /// It is so now.
    Is(bool),
    /// It is so now, and goes into this state by itself.
    Goes(bool),
    /// It is as it was.
    AsItWas,
    /// Nothing was done to it in the end.
    Undone,
    /// Nobody knows whether it was switched.
    Perhaps,
}

/// What a client asked of an output, and what that leads to.
#[derive(Clone, Copy, Debug)]
enum Asked {
    Write(bool),
    /// This state for a while.
    Timed(bool),
    EndLease,
    Toggle,
}

struct Command {
    who: String,
    began: Micros,
    asked: Vec<(Place, Asked)>,
    is_single: bool,
    /// Nobody else commands its outputs until it ends.
    holds_all: bool,
    ended: Option<Micros>,
}

/// The states in which an output may be in the end.
#[derive(Clone, Copy, Debug)]
struct Expected {
    may_be: [bool; 2],
    /// Something may be to be done to it yet.
    is_timed: bool,
}

impl Expected {
    const fn only(state: bool, is_timed: bool) -> Expected {
        Expected {
            may_be: [!state, state],
            is_timed,
        }
    }

    const fn or(mut self, state: bool, is_timed: bool) -> Expected {
        self.may_be[state as usize] = true;
        self.is_timed |= is_timed;
        self
    }
}

type Tolds = Arc<Mutex<Vec<(usize, Vec<Told>)>>>;

struct Soak {
    world: World,
    dice: Dice,
    commands: Vec<Command>,
    tolds: Tolds,
    expected: BTreeMap<Place, Expected>,
    /// The newest frame that was judged.
    judged: usize,
    off_at: Option<Micros>,
    /// When the command ended that counts, output by output, and whether that is sure.
    owner_at: BTreeMap<Place, (Micros, bool)>,
    killed: Vec<Micros>,
    orders: usize,
}

fn told(end: Result<Told, Failure>) -> Told {
    match end {
        Ok(told) => told,
        Err(Failure::Undone) => Told::Undone,
        Err(failure) if failure.may_have_acted() => Told::Perhaps,
        Err(_) => Told::AsItWas,
    }
}

/// Whether an entry is about this output.
fn names(entry: &Logged, number: u8) -> bool {
    let label = format!("k{number}");
    entry.what.split(['=', ' ']).any(|word| word == label)
}

impl Soak {
    fn new(seed: u64) -> Soak {
        let mut dice = Dice::new(seed ^ 0x5EED);
        let mut world = World::new(TEXT, seed);
        let calm = dice.one_in(4);
        let mut rate = |often: u64| if calm || dice.one_in(3) { 0 } else { often };
        world.faults = Faults {
            request_lost: rate(30),
            reply_lost: rate(30),
            refused: rate(60),
            disk: rate(40),
            slow_disk: rate(40),
            audit: rate(60),
        };
        let outputs = MODULES.map(|module| (1..=8).map(move |number| at(module, number)));
        let expected = outputs.into_iter().flatten();
        Soak {
            world,
            dice,
            commands: Vec::new(),
            tolds: Tolds::default(),
            expected: expected
                .map(|place| (place, Expected::only(false, false)))
                .collect(),
            judged: 0,
            off_at: None,
            owner_at: BTreeMap::new(),
            killed: Vec::new(),
            orders: 0,
        }
    }

    fn output(&mut self) -> Place {
        // Few enough to meet.
        let module = MODULES[self.dice.below(3) as usize];
        let number = match module {
            "oven" => self.dice.between(1, 6),
            _ => self.dice.between(1, 2),
        };
        at(module, number as u8)
    }

    fn begin(&mut self, asked: Vec<(Place, Asked)>, is_single: bool) -> (Who, usize, Tolds) {
        let number = self.commands.len();
        let who = format!("c{number}");
        self.commands.push(Command {
            who: who.clone(),
            began: self.world.now,
            asked,
            is_single,
            holds_all: is_single,
            ended: None,
        });
        self.orders += 1;
        (who_is(&who), number, Arc::clone(&self.tolds))
    }

    /// A client asks for something.
    fn order(&mut self) {
        let place = self.output();
        let (module, point) = (place.module.clone(), place.point);
        let on = self.dice.one_in(2);
        match self.dice.below(12) {
            0..=3 => {
                let asked = vec![(place, Asked::Write(on))];
                let (who, number, tolds) = self.begin(asked, true);
                self.world.order(move |core| async move {
                    let set = [(point, on)];
                    let end = core.write(&who, &module, &set, WriteTerms::default()).await;
                    let end = told(end.map(|_| Told::Is(on)));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            4..=5 => {
                let pulse = Pulse {
                    width: Some(ms(self.dice.between(1, 8_000))),
                    off: self.dice.one_in(4),
                    ..Pulse::default()
                };
                let asked = vec![(place, Asked::Timed(!pulse.off))];
                let (who, number, tolds) = self.begin(asked, true);
                self.world.order(move |core| async move {
                    let end = core.pulse(&who, &module, point, pulse).await;
                    let end = told(end.map(|_| Told::Goes(pulse.off)));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            6..=7 => {
                let time = ms(self.dice.between(200, 8_000));
                let asked = vec![(place, Asked::Timed(on))];
                let (who, number, tolds) = self.begin(asked, true);
                self.world.order(move |core| async move {
                    let end = core.lease(&who, &module, point, (on, time), false).await;
                    let end = told(end.map(|_| Told::Goes(!on)));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            8 => {
                let (who, number, tolds) = self.begin(vec![(place, Asked::EndLease)], true);
                self.world.order(move |core| async move {
                    let end = core.end_lease(&who, &module, point).await;
                    let end = told(end.map(|done| match done {
                        Some(done) => Told::Is(done.outputs[0].1 == Some(true)),
                        None => Told::AsItWas,
                    }));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            9 => {
                let (who, number, tolds) = self.begin(vec![(place, Asked::Toggle)], true);
                self.world.order(move |core| async move {
                    let terms = ToggleTerms::default();
                    let end = core.toggle(&who, &module, point, terms).await;
                    let end = told(end.map(|done| Told::Is(done.outputs[0].1 == Some(true))));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            10 => self.group(),
            _ => self.batch(),
        }
    }

    /// A group is switched, or switched over.
    fn group(&mut self) {
        let to = match self.dice.below(3) {
            0 => GroupState::Set(false),
            1 => GroupState::Set(true),
            _ => GroupState::Toggle,
        };
        let terms = BatchTerms {
            all_or_nothing: self.dice.one_in(2),
            ..BatchTerms::default()
        };
        let asked = GROUP.map(|(module, number)| (at(module, number), Asked::Toggle));
        let (who, number, tolds) = self.begin(asked.to_vec(), false);
        self.commands[number].holds_all = terms.all_or_nothing;
        self.world.order(move |core| async move {
            let done = core.set_group(&who, "all", to, terms).await;
            let ends = match done {
                Ok(done) => {
                    let ends = done.parts.into_iter();
                    ends.map(|part| told(part.end.map(|_| Told::Is(part.wanted))))
                        .collect()
                }
                Err(failure) => vec![told(Err(failure)); GROUP.len()],
            };
            tolds.lock().unwrap().push((number, ends));
        });
    }

    fn batch(&mut self) {
        let mut set: BTreeMap<Place, bool> = BTreeMap::new();
        for _ in 0..self.dice.between(1, 4) {
            let place = self.output();
            let on = self.dice.one_in(2);
            set.insert(place, on);
        }
        let set: Vec<_> = set.into_iter().collect();
        let terms = BatchTerms {
            all_or_nothing: self.dice.one_in(2),
            ..BatchTerms::default()
        };
        let asked = set.iter().map(|(at, on)| (at.clone(), Asked::Write(*on)));
        let (who, number, tolds) = self.begin(asked.collect(), false);
        self.commands[number].holds_all = terms.all_or_nothing;
        self.world.order(move |core| async move {
            let done = core.batch(&who, &set, terms).await;
            let ends = done.parts.into_iter();
            let ends = ends.map(|part| told(part.end.map(|_| Told::Is(part.wanted))));
            tolds.lock().unwrap().push((number, ends.collect()));
        });
    }

    /// Takes in what was told, in the order in which it was.
    fn hear(&mut self) -> Result<(), String> {
        let now = self.world.now;
        let tolds = std::mem::take(&mut *self.tolds.lock().unwrap());
        for (number, ends) in tolds {
            self.commands[number].ended = Some(now);
            let asked = self.commands[number].asked.clone();
            for ((place, asked), told) in asked.into_iter().zip(ends) {
                self.judge_end(number, &place, told)?;
                if matches!(told, Told::AsItWas | Told::Undone) {
                    continue;
                }
                // A part of a batch ends before the batch, and another command may come between.
                let at = self.ended(number, &place).unwrap_or(now);
                let (owner, is_sure) = self.owner_at.entry(place.clone()).or_default();
                if *owner <= at {
                    (*owner, *is_sure) = (at, told != Told::Perhaps);
                    self.expect(&place, asked, told);
                } else if let (Told::Is(state), false) = (told, *is_sure) {
                    // What came after it may have done nothing.
                    let expected = self.expected[&place].or(state, false);
                    self.expected.insert(place, expected);
                }
            }
        }
        Ok(())
    }

    /// When the last command to an output ended that was a part of this one, if it was one of
    /// several.
    fn ended(&self, number: usize, place: &Place) -> Option<Micros> {
        let command = &self.commands[number];
        if command.holds_all {
            return None;
        }
        let entries = self.world.log.iter().rev().take(400);
        let output = place.point.index + 1;
        let entries = entries.filter(|e| e.who == command.who && e.module == place.module);
        let entries = entries.filter(|entry| names(entry, output));
        entries.filter_map(|entry| Some(entry.ended?.0)).max()
    }

    fn expect(&mut self, place: &Place, asked: Asked, told: Told) {
        let before = self.expected[place];
        let expected = match (told, asked) {
            (Told::AsItWas | Told::Undone, _) => return,
            (Told::Is(state), _) => Expected::only(state, false),
            (Told::Goes(state), _) => Expected::only(state, true),
            (Told::Perhaps, Asked::Write(on)) => before.or(on, false),
            // Where nothing else is to be done to it, it is released all the same.
            (Told::Perhaps, Asked::Timed(on)) if !before.is_timed => Expected::only(!on, true),
            (Told::Perhaps, Asked::Timed(on)) => before.or(!on, true),
            (Told::Perhaps, Asked::Toggle) => before.or(true, false).or(false, false),
            (Told::Perhaps, Asked::EndLease) => before.or(true, true).or(false, true),
        };
        self.expected.insert(place.clone(), expected);
    }

    /// What happened last, for whoever looks for the fault.
    fn trace(&self) -> String {
        let mut lines = Vec::new();
        for entry in self.world.log.iter().rev().take(40) {
            lines.push((entry.began, format!("{entry:?}")));
        }
        for acted in self.world.acted.iter().rev().take(40) {
            lines.push((acted.at, format!("{acted:?}")));
        }
        for command in self.commands.iter().rev().take(25) {
            let (asked, ended) = (&command.asked, command.ended);
            let line = format!("{} {asked:?} to {ended:?}", command.who);
            lines.push((command.began, line));
        }
        lines.extend(self.killed.iter().map(|at| (*at, "killed".to_owned())));
        lines.sort();
        let lines = lines.into_iter();
        let lines = lines.map(|(at, line)| format!("{:>10} {line}\n", at.0 / 1_000));
        lines.collect()
    }

    /// What was told is so: a frame says it, or none was obeyed.
    fn judge_end(&self, number: usize, place: &Place, told: Told) -> Result<(), String> {
        let command = &self.commands[number];
        let entries = self.world.log.iter().rev().take(400);
        let entries: Vec<_> = entries.filter(|e| e.who == command.who).collect();
        let mask = bit(place.point.index + 1);
        let obeyed = self.world.acted.iter().rev().take(400).filter(|acted| {
            let is_of = acted.module == place.module && acted.set.mask & mask != 0;
            is_of
                && entries.iter().any(|entry| {
                    let end = entry.ended.map_or(self.world.now, |(at, _)| at);
                    entry.module == acted.module
                        && names(entry, place.point.index + 1)
                        && entry.began < acted.at
                        && acted.at <= end
                })
        });
        let states: Vec<bool> = obeyed.map(|acted| acted.set.on & mask != 0).collect();
        let is_held = command
            .asked
            .iter()
            .any(|(_, a)| matches!(a, Asked::Timed(_)));
        match told {
            Told::Is(state) if states.first() != Some(&state) => Err(format!(
                "{} was told that {place:?} is {state}, and its frames say {states:?}",
                command.who
            )),
            // Held already, it is not switched again.
            Told::Goes(state) if !is_held || states.first() == Some(&state) => Err(format!(
                "{} was told that {place:?} goes {state}: {states:?}",
                command.who
            )),
            Told::AsItWas if !states.is_empty() => Err(format!(
                "{:?} was told that {place:?} is as it was, and was switched {states:?}",
                command.asked
            )),
            _ => Ok(()),
        }
    }

    /// What the modules obeyed since is written down, allowed, and not too late.
    fn judge_frames(&mut self) -> Result<(), String> {
        let frames = self.world.acted[self.judged..].to_vec();
        self.judged = self.world.acted.len();
        for acted in frames {
            let Bank { mask, on } = acted.set;
            let open = |entry: &&Logged| {
                let end = entry.ended.map(|(at, _)| at);
                entry.module == acted.module
                    && entry.began <= acted.at
                    && end.is_none_or(|end| acted.at <= end)
            };
            // One that is tried again and again may have begun long before.
            let still = self.world.open.iter().map(|entry| &self.world.log[*entry]);
            let lately = self.world.log.iter().rev().take(200);
            let entries: Vec<_> = still.chain(lately).filter(open).collect();
            for number in (1..=8).filter(|number| mask & bit(*number) != 0) {
                let Some(entry) = entries.iter().find(|entry| names(entry, number)) else {
                    return Err(format!("nobody asked for {acted:?}"));
                };
                let asked = self.commands.iter().find(|c| c.who == entry.who);
                if let Some(command) = asked.filter(|command| command.is_single)
                    && acted.at > command.began + TTL + ms(300)
                {
                    return Err(format!("{entry:?} was obeyed too late: {acted:?}"));
                }
            }
            if acted.module != "oven" {
                continue;
            }
            let after = acted.before & !mask | on;
            if after & bit(1) != 0 && after & bit(2) != 0 {
                return Err(format!("both are on: {acted:?}"));
            }
            let (was, is) = (acted.before & bit(4) != 0, after & bit(4) != 0);
            match (was, is) {
                (true, false) => self.off_at = Some(acted.at),
                (false, true) => {
                    let since = self.off_at.map(|off| acted.at - off);
                    if since.is_some_and(|since| since < ms(5_000)) {
                        return Err(format!("k4 was off for {since:?} only: {acted:?}"));
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn kill(&mut self) -> Result<(), String> {
        self.world.kill();
        self.judge_frames()?;
        self.killed.push(self.world.now);
        if self.world.is_disk_behind {
            // What it says of how long outputs must stay off is out of date.
            self.off_at = None;
        }
        for entry in std::mem::take(&mut self.world.open) {
            self.world.log[entry].ended = Some((self.world.now, "killed"));
        }
        for number in 0..self.commands.len() {
            if self.commands[number].ended.is_some() {
                continue;
            }
            self.commands[number].ended = Some(self.world.now);
            for (place, asked) in self.commands[number].asked.clone() {
                let before = self.expected[&place];
                let expected = match asked {
                    Asked::Write(on) => before.or(on, true).or(before.may_be[1], true),
                    Asked::Timed(on) => before.or(!on, true),
                    Asked::EndLease | Asked::Toggle => before.or(true, true).or(false, true),
                };
                self.expected.insert(place, expected);
            }
        }
        if self.dice.one_in(2) {
            let away = ms(self.dice.between(1, 5_000));
            self.world.now += away;
        }
        self.world.start();
        Ok(())
    }

    fn run(&mut self, orders: usize) -> Result<(), String> {
        let clients = self.dice.between(2, 8);
        let kills = [0, 0, 400, 2_000][self.dice.below(4) as usize];
        let mut dead: Option<&str> = None;
        let mut gone = false;
        while self.orders < orders {
            for _ in 0..self.dice.between(1, clients) {
                self.order();
            }
            let pause = match self.dice.below(4) {
                0 => ms(self.dice.between(0, 20)),
                1 => ms(self.dice.between(0, 5_000)),
                _ => ms(self.dice.between(0, 300)),
            };
            let until = self.world.now + pause;
            while self.world.step(until) {
                self.hear()?;
                self.judge_frames()?;
                if self.dice.one_in(kills) {
                    self.kill()?;
                }
            }
            if self.dice.one_in(60) {
                if let Some(module) = dead.take() {
                    self.world.dead(module, false);
                } else {
                    let module = MODULES[self.dice.below(3) as usize];
                    self.world.dead(module, true);
                    dead = Some(module);
                }
            }
            if self.dice.one_in(80) {
                gone = !gone;
                self.world.unplug("/dev/ttyS9", gone);
            }
            self.forget();
        }
        self.world.faults = Faults::default();
        self.world.unplug("/dev/ttyS9", false);
        for module in MODULES {
            self.world.dead(module, false);
        }
        let until = self.world.now + QUIET;
        while self.world.step(until) {
            self.hear()?;
            self.judge_frames()?;
        }
        self.judge_rest()
    }

    /// Of what is long over, nothing is asked any more.
    fn forget(&mut self) {
        if self.world.acted.len() > 4_000 {
            self.world.acted.drain(..2_000);
            self.judged -= 2_000;
        }
    }

    /// It may have to go on when a lease ends, and must not while another one is.
    fn is_kept_off(&self, place: &Place) -> bool {
        let on = self.world.relays("oven");
        match (&*place.module, place.point.index + 1) {
            ("oven", 1) => on & bit(2) != 0,
            ("oven", 2) => on & bit(1) != 0,
            _ => false,
        }
    }

    /// All is quiet: nothing is left to be done, and every output is as its last owner wanted.
    fn judge_rest(&mut self) -> Result<(), String> {
        if let Some(command) = self.commands.iter().find(|c| c.ended.is_none()) {
            return Err(format!("{} never ended", command.who));
        }
        let expected: Vec<_> = self.expected.iter().map(|(p, e)| (p.clone(), *e)).collect();
        for (place, expected) in expected {
            let left = self.world.state().left(&place);
            if self.is_kept_off(&place) {
                continue;
            }
            if left != crate::Left::default() {
                return Err(format!("{place:?} is never released: {left:?}"));
            }
            let number = place.point.index + 1;
            let is_on = self.world.relays(&place.module) & bit(number) != 0;
            let is_right = match (&*place.module, number) {
                ("oven", 3) => !is_on,
                // Its module may have returned.
                ("oven", 5) => !is_on || expected.may_be[1],
                _ => expected.may_be[usize::from(is_on)],
            };
            if !is_right {
                return Err(format!("{place:?} is {is_on} in the end: {expected:?}"));
            }
        }
        // One that is tried for ever is open until it succeeds.
        let blocked = [1, 2]
            .iter()
            .any(|number| self.is_kept_off(&at("oven", *number)));
        if !blocked && !self.world.open.is_empty() {
            return Err(format!("{} entries are open", self.world.open.len()));
        }
        if !blocked && !self.world.state().is_at_rest() {
            return Err(format!("not at rest: {:?}", self.world.state()));
        }
        let left = self.world.disk.iter();
        let left = left.filter(|((at, why), ..)| *why != Why::MinOff && !self.is_kept_off(at));
        let left: Vec<_> = left.collect();
        match left.is_empty() {
            true => Ok(()),
            false => Err(format!("the disk still promises {left:?}")),
        }
    }
}

fn run(seed: u64, orders: usize) {
    let mut soak = Soak::new(seed);
    if let Err(why) = soak.run(orders) {
        let (orders, now, trace) = (soak.orders, soak.world.now.0, soak.trace());
        panic!("{trace}seed {seed}, order {orders}, at {now}: {why}");
    }
}

/// In the suite few enough for every run. More of them, by hand, in releases' code:
/// `RAILBUS_SOAK=10000000 cargo test --profile soak -p railbus-site --lib soak::seeds`.
#[test]
fn seeds() {
    let orders = std::env::var("RAILBUS_SOAK").ok();
    let orders: u64 = orders
        .and_then(|orders| orders.parse().ok())
        .unwrap_or(20_000);
    for seed in 0..orders / 500 {
        run(seed, 500);
    }
}
