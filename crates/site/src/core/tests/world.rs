//! Everything around a core, in virtual time: modules whose relays are known, a line that does one
//! thing at a time, a disk and an audit log that may refuse. What is random comes from a seed.

mod lines;

use super::super::*;
pub(super) use super::chance::{Dice, Faults};
use crate::rights::Who;
use crate::service::lock;
use crate::{CommandError, Rights};
use jiff::tz::TimeZone;
pub(super) use lines::Seat;
use lines::{Board, Wire};
use railbus_device::{Bank, Point, PointKind};
use railbus_host::{Fault, LineState};
use railbus_store::history::{Event as Told, EventKind, Severity};
use railbus_wire::Channel;
use std::collections::VecDeque;
use std::sync::Mutex;
use std::time::Duration;

/// Something that a module did by a frame.
#[derive(Clone, Debug)]
pub(super) struct Acted {
    pub(super) at: Micros,
    /// The name that it has on its line.
    pub(super) module: String,
    pub(super) seat: Seat,
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
    Ended(usize, &'static str),
    /// The caller of a procedure is answered.
    Answer(Tell),
    Kept(Vec<Kept>, Result<(), ErrorKind>),
    /// A line finds its port, or finds it gone.
    Finds(LineId),
    Closed(LineId),
    Changed(RequestId, LineId, ModuleChanges),
    Stored(RequestId, Store),
    /// A module ends a pulse of its own, unless something newer was done to the output.
    Jogged(Seat, u32, bool, u64),
    /// All modules are asked.
    Poll,
}

/// Called with what a procedure ended with.
type Ends<T> = Arc<Mutex<Option<(Micros, T)>>>;

/// What waits for the end of a procedure.
pub(super) struct End<T>(Ends<T>, TaskId);

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
    /// The configuration that the next start finds.
    pub(super) file: Arc<Mutex<Config>>,
    pub(super) now: Micros,
    /// When the process was started.
    booted: Micros,
    clock: Arc<Mutex<Micros>>,
    due: BTreeMap<(Micros, u64), Due>,
    newest: u64,
    boards: BTreeMap<Seat, Board>,
    lines: BTreeMap<LineId, Wire>,
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
    /// When the audit log has written all that it has.
    logged: Micros,
    /// When it has which end.
    ends: BTreeMap<RequestId, Micros>,
    /// Ports that are gone.
    down: BTreeSet<String>,
    pub(super) events: Vec<Told>,
    /// The configurations that were in force, and from when on.
    pub(super) named: Vec<(Micros, Arc<Config>)>,
    /// The modules are read again and again.
    pub(super) polls: bool,
    /// The clock on the wall is so much behind.
    pub(super) wall_behind: Micros,
    /// How long each write of the disk takes, where that is not left to chance.
    pub(super) disk_takes: Option<Micros>,
    /// The same of the audit log before a command.
    pub(super) audit_takes: Option<Micros>,
    /// The same after it.
    pub(super) end_takes: Option<Micros>,
    /// How long a port hangs that is being closed.
    pub(super) port_hangs: Micros,
    /// Rules act, from the start of the process on.
    pub(super) has_rules: bool,
    /// The system refuses to open lines.
    pub(super) refuses_lines: bool,
}

pub(super) const fn ms(millis: u64) -> Micros {
    Micros::from_millis(millis)
}

/// A pulse of so many milliseconds.
pub(super) fn pulse(width: u64) -> Pulse {
    Pulse {
        width: Some(ms(width)),
        ..Pulse::default()
    }
}

const POLL_EVERY: Micros = ms(250);

impl World {
    pub(super) fn new(text: &str, seed: u64) -> World {
        let file = Arc::new(Mutex::new(Config::parse(text).unwrap()));
        let mut world = World {
            core: None,
            file,
            now: Micros::ZERO,
            booted: Micros::ZERO,
            clock: Arc::default(),
            due: BTreeMap::new(),
            newest: 0,
            boards: BTreeMap::new(),
            lines: BTreeMap::new(),
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
            logged: Micros::ZERO,
            ends: BTreeMap::new(),
            down: BTreeSet::new(),
            events: Vec::new(),
            named: Vec::new(),
            polls: true,
            wall_behind: Micros::ZERO,
            disk_takes: None,
            audit_takes: None,
            end_takes: None,
            port_hangs: Micros::ZERO,
            has_rules: false,
            refuses_lines: false,
        };
        world.start();
        world
    }

    /// The process starts; modules and disk are as they were.
    pub(super) fn start(&mut self) {
        self.booted = self.now;
        let now = self.time();
        let config = lock(&self.file).clone();
        let names: Vec<String> = config.lines.keys().cloned().collect();
        self.core = Some(Core::new(now, config.clone(), true, self.disk.clone()));
        for name in names {
            let id = self.state().line_opens(&name).unwrap();
            self.plug(&name, id, &config);
            self.tell(Input::Opened(&name, id, Ok(now.site)));
            self.line_is(id, LineState::Up);
        }
        self.core.as_mut().unwrap().take_up(now);
        self.add(Micros(1), Due::Poll);
        self.drain();
        if self.has_rules {
            self.run_rules();
        }
    }

    /// Rules act from now on.
    pub(super) fn run_rules(&mut self) {
        self.has_rules = true;
        let now = self.time();
        self.core.as_mut().unwrap().change(now, |state| {
            let config = state.site.config();
            state.rules.start(config, TimeZone::UTC, now.site);
        });
        self.drain();
    }

    /// The next start finds another configuration.
    pub(super) fn become_other(&mut self, text: &str) {
        *lock(&self.file) = Config::parse(text).unwrap();
    }

    /// Takes another configuration, which is written if the disk does not refuse it.
    pub(super) fn reload(&mut self, text: &str, is_written: bool) -> End<Option<Reloaded>> {
        let (config, store) = self.to_store(text, is_written);
        self.order(move |core| async move {
            let reloaded = core.reload(&Rights::all(), config, Some(store)).await;
            reloaded.ok().flatten()
        })
    }

    /// The same for somebody with these rights.
    pub(super) fn reload_as(
        &mut self,
        rights: Rights,
        text: &str,
    ) -> End<Result<Option<Reloaded>, CommandError>> {
        let (config, store) = self.to_store(text, true);
        self.order(move |core| async move { core.reload(&rights, config, Some(store)).await })
    }

    fn to_store(&self, text: &str, is_written: bool) -> (Config, Store) {
        let config = Config::parse(text).unwrap();
        let (file, written) = (Arc::clone(&self.file), config.clone());
        let store = Store(Box::pin(async move {
            if is_written {
                *lock(&file) = written;
            }
            is_written
        }));
        (config, store)
    }

    /// Exclusive access to a line.
    pub(super) fn lend(&mut self, line: &str) -> End<Result<Exclusive, CommandError>> {
        let line = line.to_owned();
        self.order(move |core| async move { core.lend_line(&line).await })
    }

    /// The holder is gone, or has finished, and the file is as it says by now.
    pub(super) fn give_back(&mut self, line: &str, loan: LoanId, text: Option<&str>) -> End<()> {
        let line = line.to_owned();
        let config = text.map(|text| Config::parse(text).unwrap());
        if let Some(config) = &config {
            *lock(&self.file) = config.clone();
        }
        self.order(move |core| async move { core.give_back(&line, loan, config).await })
    }

    /// Whoever waits for this is gone.
    pub(super) fn cancel<T>(&mut self, end: &End<T>) {
        let now = self.time();
        self.core.as_mut().unwrap().cancel(now, end.1);
        self.drain();
    }

    /// What was dropped at the start is reported.
    pub(super) fn tell_dropped_ends(&mut self) {
        let now = self.time();
        let core = self.core.as_mut().unwrap();
        core.change(now, State::tell_dropped_ends);
        self.drain();
    }

    /// Ends the site.
    pub(super) fn close(&mut self) -> End<()> {
        self.order(|core| async move { core.close_site().await })
    }

    /// The process is killed. Frames that are on their way may still be obeyed.
    pub(super) fn kill(&mut self) {
        self.core = None;
        let is_jog = |_: &(Micros, u64), due: &mut Due| matches!(due, Due::Jogged(..));
        let jogs: BTreeMap<_, _> = self.due.extract_if(.., is_jog).collect();
        for (_, one) in std::mem::replace(&mut self.due, jogs) {
            match one {
                Due::Ran(_, at, op, Ok(()), _) | Due::Obeys(at, op) if self.dice.one_in(2) => {
                    self.obey(at, &op);
                }
                Due::Kept(kept, Ok(())) if self.dice.one_in(2) => self.disk = kept,
                _ => {}
            }
        }
        self.lines.clear();
        self.ends.clear();
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

    /// The audit log writes one record after the other.
    fn log(&mut self, after: Micros, due: Due) {
        self.logged = self.logged.max(self.now + after);
        self.add(self.logged - self.now, due);
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
        let task = self.core.as_mut().unwrap().start(now, procedure, end);
        self.drain();
        End(ends, task)
    }

    /// Switches one output, as whoever is named.
    pub(super) fn write(
        &mut self,
        who: &str,
        output: (&str, u8),
        on: bool,
    ) -> End<Result<WriteDone, CommandError>> {
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
    ) -> End<Result<PulseDone, CommandError>> {
        let (module, who, point) = (output.0.to_owned(), who_is(who), k(output.1));
        self.order(move |core| async move { core.pulse(&who, &module, point, pulse).await })
    }

    pub(super) fn lease(
        &mut self,
        who: &str,
        output: (&str, u8),
        (on, time): (bool, Micros),
    ) -> End<Result<Leased, CommandError>> {
        let (module, who, point) = (output.0.to_owned(), who_is(who), k(output.1));
        self.order(move |core| async move {
            core.lease(&who, &module, point, (on, time), LeaseTerms::default())
                .await
        })
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
                    true => Err(CommandError::NotAudited),
                    false => Ok(OpenAuditEntry {
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
            Due::Ended(entry, end) => {
                self.open.remove(&entry);
                self.log[entry].ended = Some((self.now, end));
            }
            Due::Answer(Tell(tell)) => {
                *self.clock.lock().unwrap() = self.now;
                tell();
            }
            Due::Kept(kept, end) => {
                self.is_disk_behind = end.is_err();
                // One that failed at its last step is there all the same.
                if end.is_ok() || self.dice.one_in(4) {
                    self.disk = kept;
                }
                self.tell(Input::Kept(end));
            }
            Due::Finds(line) => self.finds(line),
            Due::Closed(line) => self.has_closed(line),
            Due::Jogged(seat, mask, on, since) => self.has_jogged(seat, mask, on, since),
            Due::Changed(request, line, change) => self.has_changed(request, line, change),
            Due::Stored(request, Store(mut write)) => {
                let mut noop = std::task::Context::from_waker(Waker::noop());
                let written = write.as_mut().poll(&mut noop);
                let stored = written == std::task::Poll::Ready(true);
                self.tell(Input::Done(request, Reply::Stored(stored)));
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

    /// Which configuration is in force since when.
    fn note_config(&mut self) {
        let Some(core) = &self.core else {
            return;
        };
        let config = core.state.site.config();
        if self
            .named
            .last()
            .is_none_or(|(_, last)| !Arc::ptr_eq(last, config))
        {
            self.named.push((self.now, Arc::clone(config)));
        }
    }

    fn drain(&mut self) {
        self.note_config();
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
                    let by_chance = ms(self.dice.between(1, 3));
                    let after = self.audit_takes.unwrap_or(by_chance);
                    self.log(after, Due::Begun(request, entry));
                }
                Output::End {
                    request,
                    begun,
                    end,
                    ..
                } => {
                    let entry = begun.id.parse().unwrap();
                    let by_chance = ms(self.dice.between(0, 2));
                    let after = self.end_takes.unwrap_or(by_chance);
                    self.log(after, Due::Ended(entry, end.name()));
                    self.ends.insert(request, self.logged);
                }
                Output::Answer { after, tell } => {
                    let at = self.ends.get(&after).copied().unwrap_or_default();
                    self.add(at.max(self.now) - self.now, Due::Answer(tell));
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
                Output::Open { line, id, config } => self.opens(&line, id, &config),
                Output::Close(id) => self.closes(id),
                Output::Change {
                    request,
                    line,
                    change,
                } => {
                    let after = ms(self.dice.between(0, 5));
                    self.add(after, Due::Changed(request, line, change));
                }
                Output::Store { request, store } => {
                    let by_chance = ms(self.dice.between(1, 8));
                    let after = self.disk_takes.unwrap_or(by_chance);
                    self.add(after, Due::Stored(request, store));
                }
                Output::Event(event) => self.events.push(*event),
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

pub(super) fn who_is(who: &str) -> Who {
    Who::program(who)
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
