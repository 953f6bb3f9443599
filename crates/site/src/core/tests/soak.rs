//! Seeds: several clients and a rule, faults of line, disk and audit log, dead modules, reloads,
//! lines that are lent, kills between any two steps. The judge knows nothing of the core: it sees
//! what was asked, what was told, which board had which name, and what the relays did.

mod judge;
mod layout;

use super::super::within::TTL;
use super::super::*;
use super::world::{Acted, Dice, End, Faults, Logged, Seat, World, at, bit, ms, who_is};
use crate::CommandError;
use crate::config::Step;
use crate::rights::Who;
use layout::Layout;
use std::sync::Mutex;

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
    /// The same, and the module keeps the time.
    Jog(bool),
    EndLease,
    Toggle,
}

struct Command {
    who: String,
    began: Micros,
    /// With the board that had the name then.
    asked: Vec<(Place, Seat, Asked)>,
    is_single: bool,
    /// Nobody else commands its outputs until it ends.
    holds_all: bool,
    /// Until when its frames may be sent; none where it is not judged: a scene takes its time,
    /// and what is all or nothing may be undone later.
    expires: Option<Micros>,
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

/// An output of a board, whatever its name is.
type Relay = (Seat, u8);

/// A line that is asked for, or lent, until then.
struct Borrowed {
    line: &'static str,
    end: End<Result<Exclusive, CommandError>>,
    until: Micros,
    /// It is being given back.
    returns: Option<End<()>>,
}

struct Soak {
    world: World,
    dice: Dice,
    layout: Layout,
    /// Those that were asked for since the last start, and the one before them.
    layouts: Vec<Layout>,
    commands: Vec<Command>,
    tolds: Tolds,
    expected: BTreeMap<Relay, Expected>,
    /// The newest frame that was judged.
    judged: usize,
    /// When the output that must stay off was switched off, and at which board.
    off_at: Option<(Seat, Micros)>,
    /// When the command ended that counts, output by output, and whether that is sure.
    owner_at: BTreeMap<Relay, (Micros, bool)>,
    killed: Vec<Micros>,
    /// The board that does not answer.
    dead: Option<Seat>,
    /// Boards that have got each other's address.
    moved: Vec<[Seat; 2]>,
    /// Ends that were reported as dropped.
    dropped: Vec<(Micros, String)>,
    orders: usize,
    /// The act of the rule that is in progress, and what of it has failed.
    act: Option<(usize, BTreeMap<String, Told>)>,
    /// How many acts have ended.
    acts: usize,
    borrowed: Vec<Borrowed>,
    reloads: Vec<(Micros, End<Option<Reloaded>>)>,
}

fn told(end: Result<Told, CommandError>) -> Told {
    match end {
        Ok(told) => told,
        Err(CommandError::Undone) => Told::Undone,
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
        let layout = Layout::new();
        let mut world = World::new(&layout.text(), seed);
        world.run_rules();
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
        Soak {
            world,
            dice,
            layouts: vec![layout.clone()],
            layout,
            commands: Vec::new(),
            tolds: Tolds::default(),
            expected: BTreeMap::new(),
            judged: 0,
            off_at: None,
            owner_at: BTreeMap::new(),
            killed: Vec::new(),
            dead: None,
            moved: Vec::new(),
            dropped: Vec::new(),
            orders: 0,
            act: None,
            acts: 0,
            borrowed: Vec::new(),
            reloads: Vec::new(),
        }
    }

    fn config(&mut self) -> Arc<Config> {
        Arc::clone(self.world.state().site.config())
    }

    fn output(&mut self) -> Place {
        // Few enough to meet.
        let config = self.config();
        let number = self.dice.below(config.modules.len() as u64) as usize;
        let module = config.modules.keys().nth(number).unwrap();
        let number = match &**module {
            "oven" => self.dice.between(1, 6),
            _ => self.dice.between(1, 2),
        };
        at(module, number as u8)
    }

    fn begin(&mut self, asked: Vec<(Place, Asked)>, is_single: bool) -> (Who, usize, Tolds) {
        let number = self.commands.len();
        let who = format!("c{number}");
        let seat = |place: &Place| self.world.seat_of(&place.module).unwrap();
        let asked = asked.into_iter();
        let asked = asked.map(|(place, asked)| (place.clone(), seat(&place), asked));
        let asked = asked.collect();
        self.commands.push(Command {
            who: who.clone(),
            began: self.world.now,
            asked,
            is_single,
            holds_all: is_single,
            expires: is_single.then_some(self.world.now + TTL),
            ended: None,
        });
        self.orders += 1;
        (who_is(&who), number, Arc::clone(&self.tolds))
    }

    /// How long a command has, which is judged from now on.
    fn within(&mut self, number: usize) -> Within {
        let time = match self.dice.below(3) {
            0 => WITHIN_MIN,
            1 => ms(self.dice.between(200, 5_000)),
            _ => ms(5_000),
        };
        let command = &mut self.commands[number];
        command.expires = (command.is_single || !command.holds_all).then_some(command.began + time);
        Within::new(time).unwrap()
    }

    /// A client asks for something.
    fn order(&mut self) {
        let place = self.output();
        let (module, point) = (place.module.clone(), place.point);
        let on = self.dice.one_in(2);
        match self.dice.below(13) {
            0..=3 => {
                let asked = vec![(place, Asked::Write(on))];
                let (who, number, tolds) = self.begin(asked, true);
                let terms = WriteTerms {
                    within: self.within(number),
                    ..WriteTerms::default()
                };
                self.world.order(move |core| async move {
                    let set = [(point, on)];
                    let end = core.write(&who, &module, &set, terms).await;
                    let end = told(end.map(|_| Told::Is(on)));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            4..=5 => {
                let mut pulse = Pulse {
                    width: Some(ms(self.dice.between(1, 8_000))),
                    off: self.dice.one_in(4),
                    ..Pulse::default()
                };
                let by_module = module == "gate";
                let asked = match by_module {
                    true => Asked::Jog(!pulse.off),
                    false => Asked::Timed(!pulse.off),
                };
                let asked = vec![(place, asked)];
                let (who, number, tolds) = self.begin(asked, true);
                pulse.within = self.within(number);
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
                let terms = LeaseTerms {
                    within: self.within(number),
                    ..LeaseTerms::default()
                };
                self.world.order(move |core| async move {
                    let end = core.lease(&who, &module, point, (on, time), terms).await;
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
                let terms = ToggleTerms {
                    within: self.within(number),
                    ..ToggleTerms::default()
                };
                self.world.order(move |core| async move {
                    let end = core.toggle(&who, &module, point, terms).await;
                    let end = told(end.map(|done| Told::Is(done.outputs[0].1 == Some(true))));
                    tolds.lock().unwrap().push((number, vec![end]));
                });
            }
            10 => self.group(),
            11 => self.scene(),
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
        let mut terms = BatchTerms {
            all_or_nothing: self.dice.one_in(2),
            ..BatchTerms::default()
        };
        let members = self.config().groups["all"].members.clone();
        let count = members.len();
        let asked = members.into_iter().map(|place| (place, Asked::Toggle));
        let (who, number, tolds) = self.begin(asked.collect(), false);
        self.commands[number].holds_all = terms.all_or_nothing;
        terms.within = self.within(number);
        self.world.order(move |core| async move {
            let done = core.set_group(&who, "all", to, terms).await;
            let ends = match done {
                Ok(done) => {
                    let ends = done.parts.into_iter();
                    ends.map(|part| told(part.end.map(|_| Told::Is(part.wanted))))
                        .collect()
                }
                Err(failure) => vec![told(Err(failure)); count],
            };
            tolds.lock().unwrap().push((number, ends));
        });
    }

    fn scene(&mut self) {
        let steps = self.config().scenes["dusk"].steps.clone();
        let asked = steps.into_iter().filter_map(|step| match step {
            Step::Set(place, on) => Some((place, Asked::Write(on))),
            Step::Wait(_) => None,
        });
        let asked: Vec<_> = asked.collect();
        let count = asked.len();
        let (who, number, tolds) = self.begin(asked, false);
        self.world.order(move |core| async move {
            let ends = match core.play(&who, "dusk", BatchTerms::default()).await {
                Ok(done) => {
                    let ends = done.parts.into_iter();
                    ends.map(|part| told(part.end.map(|_| Told::Is(part.wanted))))
                        .collect()
                }
                Err(failure) => vec![told(Err(failure)); count],
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
        let mut terms = BatchTerms {
            all_or_nothing: self.dice.one_in(2),
            ..BatchTerms::default()
        };
        let asked = set.iter().map(|(at, on)| (at.clone(), Asked::Write(*on)));
        let (who, number, tolds) = self.begin(asked.collect(), false);
        self.commands[number].holds_all = terms.all_or_nothing;
        terms.within = self.within(number);
        self.world.order(move |core| async move {
            let done = core.batch(&who, &set, terms).await;
            let ends = done.parts.into_iter();
            let ends = ends.map(|part| told(part.end.map(|_| Told::Is(part.wanted))));
            tolds.lock().unwrap().push((number, ends.collect()));
        });
    }

    fn kill(&mut self) -> Result<(), String> {
        self.world.kill();
        self.act = None;
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
            for (place, _, asked) in self.commands[number].asked.clone() {
                for relay in self.relays_of(number, &place) {
                    let before = self.expected(&relay);
                    let expected = match asked {
                        Asked::Write(on) => before.or(on, true).or(before.may_be[1], true),
                        Asked::Timed(on) => before.or(!on, true),
                        Asked::EndLease | Asked::Toggle | Asked::Jog(_) => {
                            before.or(true, true).or(false, true)
                        }
                    };
                    self.expected.insert(relay, expected);
                }
            }
        }
        if self.dice.one_in(2) {
            let away = ms(self.dice.between(1, 5_000));
            self.world.now += away;
        }
        self.borrowed.clear();
        self.reloads.clear();
        // A reload may have been cut short before it was written.
        let file = self.world.file.lock().unwrap().clone();
        let is_written = |layout: &&Layout| Config::parse(&layout.text()).unwrap() == file;
        self.layout = self.layouts.iter().rfind(is_written).unwrap().clone();
        self.layouts = vec![self.layout.clone()];
        self.world.start();
        self.world.tell_dropped_ends();
        self.take_events();
        Ok(())
    }

    /// Another configuration is wanted.
    fn reload(&mut self) {
        let before = self.layout.clone();
        for _ in 0..self.dice.between(1, 3) {
            let was = self.layout.clone();
            self.layout.change(&mut self.dice);
            // While a line is lent, a name whose address changes is a module that was moved.
            let mut lent = self.borrowed.iter();
            if lent.any(|one| !self.layout.is_alike(&was, one.line)) {
                self.layout = was;
            }
        }
        let is_written = !self.dice.one_in(8);
        let now = self.world.now;
        let end = self.world.reload(&self.layout.text(), is_written);
        self.reloads.push((now, end));
        if !is_written {
            self.layout = before;
        }
        self.layouts.push(self.layout.clone());
    }

    /// Somebody wants a line, and may have gone before that is lent.
    fn borrow(&mut self) {
        let line = ["main", "far", "spare"][self.dice.below(3) as usize];
        let time = match self.dice.one_in(3) {
            true => self.dice.between(0, 300),
            false => self.dice.between(300, 20_000),
        };
        let until = self.world.now + ms(time);
        let end = self.world.lend(line);
        let returns = None;
        self.borrowed.push(Borrowed {
            line,
            end,
            until,
            returns,
        });
    }

    /// Those whose time is over give their lines back; some have moved a module.
    fn give_back(&mut self) {
        let now = self.world.now;
        let has_ended = |one: &Borrowed| one.returns.as_ref().is_some_and(|e| e.get().is_some());
        self.borrowed.retain(|one| !has_ended(one));
        for mut one in std::mem::take(&mut self.borrowed) {
            if one.until > now || one.returns.is_some() {
                self.borrowed.push(one);
                continue;
            }
            match one.end.get() {
                None => self.world.cancel(&one.end),
                Some((_, Err(_))) => {}
                Some((_, Ok(lent))) => {
                    let moves = self.reloads.is_empty() && self.dice.one_in(2);
                    let text = moves.then(|| self.move_board(one.line)).flatten();
                    let returns = self.world.give_back(one.line, lent.loan, text.as_deref());
                    one.returns = Some(returns);
                    self.borrowed.push(one);
                }
            }
        }
    }

    /// A module of a line that is lent gets another address.
    fn move_board(&mut self, line: &str) -> Option<String> {
        let (from, to) = self.layout.move_one(line, &mut self.dice)?;
        self.world.move_board(&from, &to);
        self.moved.push([from.clone(), to.clone()]);
        let open = self.commands.iter_mut().filter(|c| c.ended.is_none());
        let asked = open.flat_map(|command| command.asked.iter_mut().map(|(_, seat, _)| seat));
        let acted = self.world.acted.iter_mut().map(|acted| &mut acted.seat);
        for seat in asked.chain(acted) {
            if *seat == from {
                *seat = to.clone();
            } else if *seat == to {
                *seat = from.clone();
            }
        }
        for number in 1..=8 {
            let (old, new) = ((from.clone(), number), (to.clone(), number));
            let moved = self.expected.insert(new.clone(), self.expected(&old));
            self.expected
                .insert(old.clone(), moved.unwrap_or(Expected::only(false, false)));
            let times = (self.owner_at.remove(&old), self.owner_at.remove(&new));
            self.owner_at.extend(times.0.map(|time| (new, time)));
            self.owner_at.extend(times.1.map(|time| (old, time)));
        }
        if self.dead.as_ref() == Some(&from) {
            self.dead = Some(to);
        } else if self.dead.as_ref() == Some(&to) {
            self.dead = Some(from);
        }
        self.layouts.push(self.layout.clone());
        Some(self.layout.text())
    }

    /// What happens until then, judged step by step.
    fn pass(&mut self, until: Micros, kills: u64) -> Result<(), String> {
        while self.world.step(until) {
            self.take_events();
            self.hear()?;
            self.judge_frames()?;
            if self.dice.one_in(kills) {
                self.kill()?;
            }
        }
        Ok(())
    }

    fn run(&mut self, orders: usize) -> Result<(), String> {
        let clients = self.dice.between(2, 8);
        let kills = [0, 0, 400, 2_000][self.dice.below(4) as usize];
        let reloads = [0, 15, 40][self.dice.below(3) as usize];
        let loans = [0, 20, 60][self.dice.below(3) as usize];
        let mut gone = false;
        while self.orders < orders {
            for _ in 0..self.dice.between(1, clients) {
                self.order();
            }
            if self.reloads.len() < 3 && self.dice.one_in(reloads) {
                self.reload();
            }
            if self.borrowed.len() < 3 && self.dice.one_in(loans) {
                self.borrow();
            }
            let pause = match self.dice.below(4) {
                0 => ms(self.dice.between(0, 20)),
                1 => ms(self.dice.between(0, 5_000)),
                _ => ms(self.dice.between(0, 300)),
            };
            self.pass(self.world.now + pause, kills)?;
            self.give_back();
            self.reloads.retain(|(_, end)| end.get().is_none());
            if self.dice.one_in(60) {
                if let Some(seat) = self.dead.take() {
                    self.world.dead_at(&seat, false);
                } else {
                    let module = self.output().module;
                    let seat = self.world.seat_of(&module).unwrap();
                    self.world.dead_at(&seat, true);
                    self.dead = Some(seat);
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
        if let Some(seat) = self.dead.take() {
            self.world.dead_at(&seat, false);
        }
        for one in &mut self.borrowed {
            one.until = self.world.now;
        }
        self.give_back();
        self.pass(self.world.now + QUIET, 0)?;
        self.judge_rest()
    }

    /// Of what is long over, nothing is asked any more.
    fn forget(&mut self) {
        if self.world.acted.len() > 4_000 {
            self.world.acted.drain(..2_000);
            self.judged -= 2_000;
        }
    }
}

/// Gives back how often the rule acted.
fn run(seed: u64, orders: usize) -> usize {
    let mut soak = Soak::new(seed);
    if let Err(why) = soak.run(orders) {
        let (orders, now, trace) = (soak.orders, soak.world.now.0, soak.trace());
        panic!("{trace}seed {seed}, order {orders}, at {now}: {why}");
    }
    soak.acts
}

/// In the suite few enough for every run. More of them, by hand, in releases' code:
/// `RAILBUS_SOAK=10000000 cargo test --profile soak -p railbus-site --lib soak::seeds`, from the
/// seed `RAILBUS_SEED` on.
#[test]
fn seeds() {
    let orders = std::env::var("RAILBUS_SOAK").ok();
    let orders: u64 = orders
        .and_then(|orders| orders.parse().ok())
        .unwrap_or(20_000);
    let first = std::env::var("RAILBUS_SEED").ok();
    let first: u64 = first.and_then(|seed| seed.parse().ok()).unwrap_or(0);
    let acts = (first..first + orders / 500).map(|seed| run(seed, 500));
    let acts: usize = acts.sum();
    assert!(acts > 0, "the rule never acted");
}
