//! Everything around a core, in virtual time: modules whose relays are known, a line that does one
//! thing at a time, a disk and an audit log that may refuse. What is random comes from a seed.

use super::super::*;
pub(super) use super::chance::{Dice, Faults};
use crate::Failure;
use railbus_device::{Bank, Observation, Point, PointKind};
use railbus_host::{Confirmed, Done, Event, Evidence, Fault, LineState, Presence};
use railbus_store::history::{Event as Told, EventKind, Severity};
use railbus_wire::{Channel, Instant};
use std::collections::VecDeque;
use std::sync::Mutex;
use std::time::Duration;

/// Something that a module did by a frame.
#[derive(Clone, Debug)]
pub(super) struct Acted {
    pub(super) at: Micros,
    pub(super) module: String,
    pub(super) set: Bank,
    /// What it found.
    pub(super) before: u32,
}

/// An entry of the audit log.
#[derive(Clone, Debug)]
pub(super) struct Logged {
    pub(super) module: String,
    pub(super) who: String,
    pub(super) what: String,
    pub(super) began: Micros,
    pub(super) ended: Option<(Micros, &'static str)>,
}

/// Something under way outside the core.
enum Due {
    /// The line has done its work.
    Ran(RequestId, At, Op, Result<(), Fault>, Micros),
    /// A module has the request whose reply gets lost.
    Obeys(At, Op),
    Begun(RequestId, usize),
    Ended(RequestId, usize, &'static str),
    Kept(Vec<Kept>, Result<(), ErrorKind>),
    /// All modules are asked.
    Poll,
}

struct Module {
    at: At,
    relays: u32,
    is_dead: bool,
    is_silent: bool,
    welded: u32,
}

/// Called with what a procedure ended with.
type Ends<T> = Arc<Mutex<Option<(Micros, T)>>>;

/// What waits for the end of a procedure.
pub(super) struct End<T>(Ends<T>);

impl<T: Clone> End<T> {
    /// When and how it ended.
    pub(super) fn get(&self) -> Option<(Micros, T)> {
        self.0.lock().unwrap().clone()
    }

    pub(super) fn now(&self) -> T {
        self.get().unwrap().1
    }
}

pub(super) struct World {
    pub(super) core: Option<Core>,
    config: Config,
    pub(super) now: Micros,
    /// When the process was started.
    booted: Micros,
    clock: Arc<Mutex<Micros>>,
    due: BTreeMap<(Micros, u64), Due>,
    newest: u64,
    modules: BTreeMap<String, Module>,
    /// By line: until when it is busy.
    busy: BTreeMap<LineId, Micros>,
    pub(super) dice: Dice,
    pub(super) faults: Faults,
    pub(super) acted: Vec<Acted>,
    pub(super) log: Vec<Logged>,
    /// The numbers of those that have not ended.
    pub(super) open: BTreeSet<usize>,
    /// What the disk has.
    pub(super) disk: Vec<Kept>,
    /// It has refused what is newer.
    pub(super) is_disk_behind: bool,
    pub(super) updates: VecDeque<Update>,
    pub(super) news: Vec<News>,
    /// Writes are acknowledged, and the outputs not read after them.
    pub(super) only_acknowledged: bool,
    /// Lines whose port is gone.
    down: BTreeSet<LineId>,
    /// The modules are read again and again.
    pub(super) polls: bool,
    /// The clock on the wall is so much behind.
    pub(super) wall_behind: Micros,
    /// How long each write of the disk takes, where that is not left to chance.
    pub(super) disk_takes: Option<Micros>,
}

pub(super) const fn ms(millis: u64) -> Micros {
    Micros::from_millis(millis)
}

const POLL_EVERY: Micros = ms(250);

impl World {
    pub(super) fn new(text: &str, seed: u64) -> World {
        let config = Config::parse(text).unwrap();
        let mut world = World {
            core: None,
            config,
            now: Micros::ZERO,
            booted: Micros::ZERO,
            clock: Arc::default(),
            due: BTreeMap::new(),
            newest: 0,
            modules: BTreeMap::new(),
            busy: BTreeMap::new(),
            dice: Dice::new(seed),
            faults: Faults::default(),
            acted: Vec::new(),
            log: Vec::new(),
            open: BTreeSet::new(),
            disk: Vec::new(),
            is_disk_behind: false,
            updates: VecDeque::new(),
            news: Vec::new(),
            only_acknowledged: false,
            down: BTreeSet::new(),
            polls: true,
            wall_behind: Micros::ZERO,
            disk_takes: None,
        };
        world.start();
        world
    }

    /// The process starts; modules and disk are as they were.
    pub(super) fn start(&mut self) {
        self.booted = self.now;
        let now = self.time();
        let mut core = Core::new(now, self.config.clone(), true, self.disk.clone());
        for (number, line) in self.config.lines.keys().enumerate() {
            let id = LineId(number as u64);
            core.handle(now, Input::Opened(line, id, now.site));
            for (index, (name, _)) in self.config.modules_of(line).enumerate() {
                let at = At {
                    line: id,
                    module: ModuleId(index),
                };
                let module = self.modules.entry(name.clone()).or_insert(Module {
                    at,
                    relays: 0,
                    is_dead: false,
                    is_silent: true,
                    welded: 0,
                });
                module.is_silent = true;
            }
            let up = LineEvent::State(LineState::Up);
            core.handle(now, Input::Line(id, line, &up));
        }
        core.take_up(now);
        self.core = Some(core);
        self.add(Micros(1), Due::Poll);
        self.drain();
    }

    /// The next start finds another configuration.
    pub(super) fn become_other(&mut self, text: &str) {
        self.config = Config::parse(text).unwrap();
    }

    /// Another board gets the name of a module, and what was promised of it is dropped, as a
    /// reload leaves it that could not wait any longer. The board itself stays as it is.
    pub(super) fn exchange(&mut self, module: &str) {
        let config = Arc::clone(self.state().site.config());
        let now = self.time();
        let core = self.core.as_mut().unwrap();
        let at = core.change(now, |context| {
            context.with(|state| {
                let left = state.schedule.held(|place| place.module == module);
                let left: Vec<u64> = left.into_iter().map(|(number, ..)| number).collect();
                state.drop_of(&boards(&config), &left, |place| place.module == module);
                for line in state.lines.values_mut() {
                    if let Some(slot) = line.modules.iter_mut().find(|slot| *slot == module) {
                        slot.clear();
                        line.modules.push(module.to_owned());
                    }
                }
                state.reconfigure(config, |other| other != module, |other| other == module);
                state.at(module).unwrap()
            })
        });
        let board = Module {
            at,
            relays: 0,
            is_dead: false,
            is_silent: true,
            welded: 0,
        };
        let before = self.modules.insert(module.to_owned(), board);
        self.modules
            .insert(format!("{module} before"), before.unwrap());
        self.drain();
    }

    /// The process is killed. Frames that are on their way may still be obeyed.
    pub(super) fn kill(&mut self) {
        self.core = None;
        let due = std::mem::take(&mut self.due);
        for (_, one) in due {
            match one {
                Due::Ran(_, at, op, Ok(()), _) | Due::Obeys(at, op) if self.dice.one_in(2) => {
                    self.obey(at, &op);
                }
                Due::Kept(kept, Ok(())) if self.dice.one_in(2) => self.disk = kept,
                _ => {}
            }
        }
        self.busy.clear();
        self.down.clear();
    }

    pub(super) fn time(&self) -> Now {
        Now {
            site: self.now - self.booted,
            wall: SystemTime::UNIX_EPOCH
                + Duration::from_micros(1_000_000_000_000 + self.now.0 - self.wall_behind.0),
        }
    }

    fn add(&mut self, after: Micros, due: Due) {
        self.newest += 1;
        let at = self.now + after;
        self.due.insert((at, self.newest), due);
    }

    /// Starts a procedure.
    pub(super) fn order<T, F>(&mut self, procedure: impl FnOnce(Context) -> F) -> End<T>
    where
        T: Send + 'static,
        F: Future<Output = T> + Send + 'static,
    {
        let ends: Ends<T> = Ends::default();
        let (told, clock) = (Arc::clone(&ends), Arc::clone(&self.clock));
        let now = self.time();
        *self.clock.lock().unwrap() = self.now;
        let end = move |value| *told.lock().unwrap() = Some((*clock.lock().unwrap(), value));
        self.core.as_mut().unwrap().start(now, procedure, end);
        self.drain();
        End(ends)
    }

    /// Switches one output, as whoever is named.
    pub(super) fn write(
        &mut self,
        who: &str,
        output: (&str, u8),
        on: bool,
    ) -> End<Result<WriteDone, Failure>> {
        let (module, who) = (output.0.to_owned(), who_is(who));
        let set = [(k(output.1), on)];
        self.order(move |core| async move {
            core.write(&who, &module, &set, WriteTerms::default()).await
        })
    }

    pub(super) fn pulse(
        &mut self,
        who: &str,
        output: (&str, u8),
        pulse: Pulse,
    ) -> End<Result<PulseDone, Failure>> {
        let (module, who, point) = (output.0.to_owned(), who_is(who), k(output.1));
        self.order(move |core| async move { core.pulse(&who, &module, point, pulse).await })
    }

    pub(super) fn lease(
        &mut self,
        who: &str,
        output: (&str, u8),
        (on, time): (bool, Micros),
    ) -> End<Result<Leased, Failure>> {
        let (module, who, point) = (output.0.to_owned(), who_is(who), k(output.1));
        self.order(
            move |core| async move { core.lease(&who, &module, point, (on, time), false).await },
        )
    }

    /// Lets time pass, and everything happen that comes to be meanwhile.
    pub(super) fn pass(&mut self, time: Micros) {
        let until = self.now + time;
        while self.step(until) {}
        self.now = until;
        self.tell(Input::Time);
    }

    /// The next thing that happens by then; false where there is none.
    pub(super) fn step(&mut self, until: Micros) -> bool {
        let outside = self.due.first_key_value().map(|((at, _), _)| *at);
        let inside = self.core.as_ref().and_then(Core::deadline);
        let inside = inside.map(|at| self.booted + at);
        let Some(next) = [outside, inside].into_iter().flatten().min() else {
            return false;
        };
        if next > until {
            return false;
        }
        let next = next.max(self.now);
        self.now = next;
        match outside.is_some_and(|at| at <= next) {
            true => self.happens(),
            false => self.tell(Input::Time),
        }
        true
    }

    fn happens(&mut self) {
        let Some((_, due)) = self.due.pop_first() else {
            return;
        };
        match due {
            Due::Ran(request, at, op, end, took) => self.ran(request, at, op, end, took),
            Due::Obeys(at, op) => self.obey(at, &op),
            Due::Begun(request, entry) => {
                let refused = self.dice.one_in(self.faults.audit);
                let begun = match refused {
                    true => Err(Failure::NotAudited),
                    false => Ok(Begun {
                        id: entry.to_string(),
                        event: Box::new(Told::new(EventKind::Write, Severity::Info, "write")),
                    }),
                };
                if refused {
                    self.open.remove(&entry);
                    self.log[entry].ended = Some((self.now, "not_audited"));
                }
                self.tell(Input::Done(request, Reply::Begun(begun)));
            }
            Due::Ended(request, entry, end) => {
                self.open.remove(&entry);
                self.log[entry].ended = Some((self.now, end));
                self.tell(Input::Done(request, Reply::Ended));
            }
            Due::Kept(kept, end) => {
                self.is_disk_behind = end.is_err();
                // One that failed at its last step is there all the same.
                if end.is_ok() || self.dice.one_in(4) {
                    self.disk = kept;
                }
                self.tell(Input::Kept(end));
            }
            Due::Poll => {
                if self.polls {
                    self.poll();
                }
                self.add(POLL_EVERY, Due::Poll);
            }
        }
    }

    fn tell(&mut self, input: Input<'_>) {
        let now = self.time();
        *self.clock.lock().unwrap() = self.now;
        if let Some(core) = &mut self.core {
            core.handle(now, input);
        }
        self.drain();
    }

    fn drain(&mut self) {
        while let Some(output) = self.core.as_mut().and_then(Core::poll) {
            match output {
                Output::Run {
                    request,
                    at,
                    op,
                    expires,
                    ..
                } => self.run(request, at, op, self.booted + expires),
                Output::Begin {
                    request,
                    module,
                    note,
                    ..
                } => {
                    let entry = self.log.len();
                    self.open.insert(entry);
                    self.log.push(Logged {
                        module,
                        who: note.origin.who,
                        what: note.what,
                        began: self.now,
                        ended: None,
                    });
                    let after = ms(self.dice.between(1, 3));
                    self.add(after, Due::Begun(request, entry));
                }
                Output::End {
                    request,
                    begun,
                    end,
                    ..
                } => {
                    let entry = begun.id.parse().unwrap();
                    let after = ms(self.dice.between(0, 2));
                    self.add(after, Due::Ended(request, entry, end.name()));
                }
                Output::Keep(kept) => {
                    let end = match self.dice.one_in(self.faults.disk) {
                        true => Err(ErrorKind::StorageFull),
                        false => Ok(()),
                    };
                    let by_chance = match self.dice.one_in(self.faults.slow_disk) {
                        true => ms(self.dice.between(500, 3_000)),
                        false => ms(self.dice.between(1, 8)),
                    };
                    let after = self.disk_takes.unwrap_or(by_chance);
                    self.add(after, Due::Kept(kept, end));
                }
                Output::News(news) => self.news.push(news),
                Output::Publish(update) => {
                    self.updates.push_back(update);
                    if self.updates.len() > 64 {
                        self.updates.pop_front();
                    }
                }
            }
        }
    }

    /// A line does one thing after the other.
    fn run(&mut self, request: RequestId, at: At, op: Op, expires: Micros) {
        let now = self.now;
        if self.down.contains(&at.line) {
            let end = Err(Fault::Closed);
            return self.add(ms(0), Due::Ran(request, at, op, end, ms(0)));
        }
        let free = self
            .busy
            .get(&at.line)
            .copied()
            .unwrap_or_default()
            .max(now);
        if free > expires {
            let end = Err(Fault::Expired);
            return self.add(free - now, Due::Ran(request, at, op, end, ms(0)));
        }
        let is_dead = self.module_at(at).is_some_and(|module| module.is_dead);
        let lost = Fault::NoReply(Evidence::default());
        let (mut end, took) = match &op {
            _ if is_dead || self.dice.one_in(self.faults.request_lost) => (Err(lost), 100),
            _ if self.dice.one_in(self.faults.refused) => {
                (Err(Fault::Refused(railbus_host::Refusal::Invalid)), 20)
            }
            _ => (Ok(()), self.dice.between(20, 60)),
        };
        if matches!(op, Op::Write(_)) && end.is_ok() && self.dice.one_in(self.faults.reply_lost) {
            // It is obeyed all the same.
            self.add(free - now + ms(10), Due::Obeys(at, op));
            end = Err(lost);
        }
        let ends = free + ms(took);
        self.busy.insert(at.line, ends);
        self.add(ends - now, Due::Ran(request, at, op, end, ms(took)));
    }

    fn module_at(&mut self, at: At) -> Option<&mut Module> {
        self.modules.values_mut().find(|module| module.at == at)
    }

    fn name_at(&self, at: At) -> String {
        let found = self.modules.iter().find(|(_, module)| module.at == at);
        found.map(|(name, _)| name.clone()).unwrap_or_default()
    }

    fn obey(&mut self, at: At, op: &Op) {
        let (Op::Write(bank) | Op::WriteSilent(bank), name) = (op, self.name_at(at)) else {
            return;
        };
        let now = self.now;
        let Some(module) = self.modules.get_mut(&name) else {
            return;
        };
        let before = module.relays;
        let moves = bank.mask & !module.welded;
        module.relays = before & !moves | bank.on & moves;
        self.acted.push(Acted {
            at: now,
            module: name,
            set: *bank,
            before,
        });
    }

    fn ran(&mut self, request: RequestId, at: At, op: Op, end: Result<(), Fault>, took: Micros) {
        let name = self.name_at(at);
        let end = end.map(|()| {
            self.obey(at, &op);
            let relays = self.modules[&name].relays;
            let unread = match op {
                Op::WriteSilent(_) => Some(Confirmed::Sent),
                Op::Write(_) if self.only_acknowledged => Some(Confirmed::Reply),
                _ => None,
            };
            if let Some(confirmed) = unread {
                let seen = None;
                return Ok(Done {
                    confirmed,
                    took,
                    seen,
                });
            }
            let seen = seen(relays);
            self.saw(at, &op, seen);
            let confirmed = match op {
                Op::Write(bank) if relays & bank.mask != bank.on => return Err(Fault::NotVerified),
                _ => Confirmed::Readback,
            };
            Ok(Done {
                confirmed,
                took,
                seen: Some(seen),
            })
        });
        self.tell(Input::Done(request, Reply::Ran(end.and_then(|end| end))));
    }

    /// A reading comes in that began then.
    pub(super) fn reads(&mut self, module: &str, relays: u32, asked: Micros) {
        let at = self.modules[module].at;
        self.saw_since(at, &Op::ReadOutputs, seen(relays), asked);
    }

    pub(super) fn saw(&mut self, at: At, op: &Op, seen: Observation) {
        self.saw_since(at, op, seen, self.now);
    }

    pub(super) fn saw_since(&mut self, at: At, op: &Op, seen: Observation, asked: Micros) {
        let time = |at: Micros| Instant(0) + (at - self.booted);
        let event = LineEvent::Bus(Event::Seen {
            module: at.module,
            op: *op,
            seen,
            asked: time(asked),
            heard: time(self.now),
        });
        self.line(at, &event);
    }

    pub(super) fn line(&mut self, at: At, event: &LineEvent) {
        let line = self.config.lines.keys().nth(at.line.0 as usize).unwrap();
        let line = line.clone();
        self.tell(Input::Line(at.line, &line, event));
    }

    /// Every module says how it is, if it can.
    fn poll(&mut self) {
        let names: Vec<String> = self.modules.keys().cloned().collect();
        for name in names {
            let module = self.modules.get_mut(&name).unwrap();
            let (at, relays) = (module.at, module.relays);
            if self.down.contains(&at.line) {
                continue;
            }
            if std::mem::replace(&mut module.is_silent, module.is_dead) != module.is_dead {
                let presence = match module.is_dead {
                    true => Presence::Silent,
                    false => Presence::Online,
                };
                let module = at.module;
                self.line(at, &LineEvent::Bus(Event::Presence { module, presence }));
            }
            if !self.modules[&name].is_dead {
                self.saw(at, &Op::ReadOutputs, seen(relays));
            }
        }
    }

    /// The relays of a module, bit by bit.
    pub(super) fn relays(&self, module: &str) -> u32 {
        self.modules[module].relays
    }

    /// The port of a line goes, or comes back. What is under way is cut short.
    pub(super) fn unplug(&mut self, number: u64, is_gone: bool) {
        let line = LineId(number);
        if !is_gone {
            self.down.remove(&line);
            return self.line_is(line, LineState::Up);
        }
        self.down.insert(line);
        let is_of = |_: &(Micros, u64), due: &mut Due| match due {
            Due::Ran(_, at, ..) | Due::Obeys(at, _) => at.line == line,
            _ => false,
        };
        let cut: Vec<Due> = self.due.extract_if(.., is_of).map(|(_, due)| due).collect();
        for due in cut {
            let (at, op, request) = match due {
                Due::Ran(request, at, op, end, _) => (at, op, Some((request, end.is_ok()))),
                Due::Obeys(at, op) => (at, op, None),
                _ => continue,
            };
            if request.is_none_or(|(_, is_ok)| is_ok) && self.dice.one_in(2) {
                self.obey(at, &op);
            }
            if let Some((request, _)) = request {
                self.tell(Input::Done(request, Reply::Ran(Err(Fault::Unknown))));
            }
        }
        let gone = Arc::new(railbus_host::PortError::Gone);
        self.line_is(line, LineState::Absent(gone));
    }

    fn line_is(&mut self, line: LineId, state: LineState) {
        let module = ModuleId(0);
        self.line(At { line, module }, &LineEvent::State(state));
    }

    /// The lines are busy for so long.
    pub(super) fn hold_line(&mut self, time: Micros) {
        for number in 0..self.config.lines.len() {
            self.busy.insert(LineId(number as u64), self.now + time);
        }
    }

    /// Moves relays by hand.
    pub(super) fn move_by_hand(&mut self, module: &str, relays: u32) {
        self.modules.get_mut(module).unwrap().relays = relays;
    }

    /// Switches a module off its line, or on again.
    pub(super) fn dead(&mut self, module: &str, is_dead: bool) {
        self.modules.get_mut(module).unwrap().is_dead = is_dead;
    }

    /// Welds relays as they are.
    pub(super) fn weld(&mut self, module: &str, relays: u32) {
        self.modules.get_mut(module).unwrap().welded = relays;
    }

    pub(super) fn state(&mut self) -> &mut State {
        let now = self.time();
        self.core.as_mut().unwrap().state(now)
    }

    /// What was written down, and how it ended.
    pub(super) fn audit(&self) -> Vec<(&str, Option<&'static str>)> {
        let each = self.log.iter();
        each.map(|entry| (&*entry.what, entry.ended.map(|(_, end)| end)))
            .collect()
    }
}

fn seen(relays: u32) -> Observation {
    Observation::Channels {
        outputs: Bank::new(0xFF, relays),
        inputs: Bank::default(),
    }
}

pub(super) fn who_is(who: &str) -> Who {
    Who::new(railbus_store::audit::Origin::program(who))
}

/// Output k1, k2, …
pub(super) fn k(number: u8) -> Point {
    Point {
        kind: PointKind::Output,
        index: number - 1,
    }
}

pub(super) fn at(module: &str, number: u8) -> Place {
    Place::new(module, k(number))
}

/// The bit of an output in [`World::relays`].
pub(super) fn bit(number: u8) -> u32 {
    Channel::new(number - 1).unwrap().mask()
}
