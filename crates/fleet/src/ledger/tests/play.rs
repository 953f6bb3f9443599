//! Two centres, sites that restart, and a network that loses, doubles, delays and reorders what it
//! carries, in virtual time and from a seed. The judge looks at what the sites' outputs did.
//!
//! `RAILBUS_SOAK=1000000 cargo test --profile soak -p railbus-fleet --lib ledger` plays so many
//! commands.

use super::*;
use crate::dice::Dice;
use std::collections::BTreeMap;

const SITES: usize = 3;
const HUBS: usize = 2;

type Key = (usize, String);
/// A hub, its connection, and the number of what it wanted.
type From = (usize, u64, u64);

/// What happens later.
#[derive(Clone, Debug)]
enum Event {
    /// A caller gives a command.
    Wanted,
    /// A store arrives at the stream: from where, name, record, expected number.
    Store(From, Key, Vec<u8>, u64),
    /// Its result arrives at the hub.
    Stored(From, Key, StoreEnd),
    /// A record arrives at a hub.
    Record(usize, u64, Key, Vec<u8>, u64),
    Read(From, Key),
    /// A request arrives at a site: in which of its sessions it was sent.
    Request(From, usize, u64, CommandRequest),
    /// The site has come so far with it: from which run, and step.
    Site(usize, u64, Key, u8, Option<From>),
    /// An answer arrives at the hub.
    Said(From, Key, Option<Vec<u8>>),
    NotDelivered(From, Key),
    /// A hub loses its connection, and has one again.
    Cut(usize),
    Back(usize),
    Restart(usize),
    /// Time to look what is due at a hub.
    Due(usize),
}

/// What a site keeps of a command on its disk.
#[derive(Clone, Debug, PartialEq)]
enum Kept {
    Begun,
    /// With this status.
    Ended(u32),
}

struct Site {
    boot: u64,
    /// When it started.
    since: u64,
    session: u64,
    is_up: bool,
    keys: BTreeMap<String, Kept>,
}

#[derive(Default)]
struct Judged {
    /// When the output was switched by a command: ms of the site's time, and until when it might.
    acts: Vec<(u64, u64)>,
    /// The records in the stream, with their numbers.
    records: Vec<(u64, CommandKind)>,
    tokens_not_sent: Vec<Vec<u8>>,
    /// How often each of its intents was sent to be carried out.
    sends: BTreeMap<u64, u32>,
    told: Vec<CommandTold>,
}

struct World {
    dice: Dice,
    now: u64,
    events: BTreeMap<(u64, u64), Event>,
    serial: u64,
    hubs: Vec<(Ledger, u64, bool)>,
    sites: Vec<Site>,
    /// The stream, in order.
    stream: Vec<(Key, Vec<u8>)>,
    judged: BTreeMap<Key, Judged>,
    /// Who waits, at which centre, for what.
    callers: BTreeMap<u64, (usize, Key, Vec<u8>)>,
    /// Commands that may still be wanted.
    left: u64,
    numbers: u64,
    is_calm: bool,
}

impl World {
    fn new(seed: u64, commands: u64) -> World {
        let site = |at| Site {
            boot: at,
            since: 0,
            session: 1,
            is_up: true,
            keys: BTreeMap::new(),
        };
        let mut world = World {
            dice: Dice(seed),
            now: 0,
            events: BTreeMap::new(),
            serial: 0,
            hubs: (0..HUBS).map(|_| (Ledger::default(), 1, true)).collect(),
            sites: (1..=SITES as u64).map(|at| site(at * 1_000)).collect(),
            stream: Vec::new(),
            judged: BTreeMap::new(),
            callers: BTreeMap::new(),
            left: commands,
            numbers: 0,
            is_calm: false,
        };
        for at in 0..HUBS {
            world.input(at, LedgerInput::Connected);
        }
        world.later(10, Event::Wanted);
        world.later(20_000, Event::Cut(0));
        world.later(33_000, Event::Cut(1));
        world.later(15_000, Event::Restart(0));
        world
    }

    fn later(&mut self, ms: u64, event: Event) {
        self.serial += 1;
        self.events.insert((self.now + ms, self.serial), event);
    }

    /// How long something takes on its way, in ms; none if it is lost.
    fn way(&mut self) -> Option<u64> {
        if self.is_calm {
            return Some(5);
        }
        match self.dice.roll(100) {
            0..4 => None,
            // Later than any deadline.
            4..8 => Some(2_000 + self.dice.roll(30_000)),
            _ => Some(1 + self.dice.roll(300)),
        }
    }

    fn is_connected(&self, hub: usize, connection: u64) -> bool {
        self.hubs[hub].1 == connection && self.hubs[hub].2
    }

    fn input(&mut self, hub: usize, input: LedgerInput<'_>) {
        let now = Duration::from_millis(self.now);
        self.hubs[hub].0.handle(now, input);
        self.outputs(hub);
    }

    fn outputs(&mut self, hub: usize) {
        let now = Duration::from_millis(self.now);
        while let Some(output) = self.hubs[hub].0.poll(now) {
            let connection = self.hubs[hub].1;
            match output {
                LedgerOutput::Store {
                    number: of,
                    site,
                    id,
                    payload,
                    after,
                } => {
                    let key = (number(&site), id);
                    let from = (hub, connection, of);
                    let store = Event::Store(from, key.clone(), payload, after);
                    match self.way() {
                        Some(ms) => self.later(ms, store),
                        None => {
                            let unknown = StoreEnd::Unknown;
                            self.later(5_000, Event::Stored(from, key, unknown));
                        }
                    }
                }
                LedgerOutput::Read(of, site, id) => {
                    let ms = self.way().unwrap_or(5_000);
                    let from = (hub, connection, of);
                    self.later(ms, Event::Read(from, (number(&site), id)));
                }
                LedgerOutput::Send(of, site, request) => {
                    self.send((hub, connection, of), number(&site), request);
                }
                LedgerOutput::Tell(caller, told) => {
                    let (_, key, token) = self.callers.remove(&caller).expect("told once");
                    let judged = self.judged.entry(key).or_default();
                    if matches!(told, CommandTold::NotStored | CommandTold::TooMany) {
                        judged.tokens_not_sent.push(token);
                    }
                    judged.told.push(told);
                }
            }
        }
        if let Some(due) = self.hubs[hub].0.deadline() {
            let ms = u64::try_from(due.as_millis()).unwrap();
            let wait = ms.saturating_sub(self.now).max(1);
            self.later(wait, Event::Due(hub));
        }
    }

    fn send(&mut self, from: From, site: usize, request: CommandRequest) {
        let key = (site, request.id.clone());
        let session = self.sites[site].session;
        if !request.tell {
            let judged = self.judged.entry(key.clone()).or_default();
            let its = judged.records.first().map_or(0, |(number, _)| *number);
            *judged.sends.entry(its).or_default() += 1;
        }
        if !self.sites[site].is_up {
            return self.later(1_000, Event::NotDelivered(from, key));
        }
        let timeout = Event::Said(from, key, None);
        self.later(20_000, timeout);
        let times = if self.dice.roll(20) == 0 { 2 } else { 1 };
        for _ in 0..times {
            if let Some(ms) = self.way() {
                let arrives = Event::Request(from, site, session, request.clone());
                self.later(ms, arrives);
            }
        }
    }

    fn answer(&mut self, to: From, key: Key, outcome: CommandOutcome) {
        if let Some(ms) = self.way() {
            self.later(ms, Event::Said(to, key, Some(said(outcome))));
        }
    }

    fn wanted(&mut self) {
        if self.left == 0 {
            return;
        }
        self.left -= 1;
        let site = usize::try_from(self.dice.roll(SITES as u64)).unwrap();
        let hub = usize::try_from(self.dice.roll(HUBS as u64)).unwrap();
        // Some come again, with the same id or as another command under it.
        let id = match self.dice.roll(10) {
            0 if self.numbers > 0 => format!("c{}", self.dice.roll(self.numbers) + 1),
            _ => {
                self.numbers += 1;
                format!("c{}", self.numbers)
            }
        };
        let token = self.serial.to_le_bytes().to_vec();
        let path = if self.dice.roll(20) == 0 { "/y" } else { "/x" };
        let its = &self.sites[site];
        let within = 200 + self.dice.roll(5_000);
        let wanted = CommandIntent {
            boot: its.boot.to_le_bytes().to_vec(),
            // As the last heartbeat told, which is up to 10 s old and was on its way.
            valid_until_ms: (self.now - its.since + within).saturating_sub(self.dice.roll(300)),
            token: token.clone(),
            ..intent(path, 0)
        };
        self.serial += 1;
        let caller = self.serial;
        self.callers
            .insert(caller, (hub, (site, id.clone()), token));
        let name = format!("p{site}");
        let wait = Duration::from_millis(within) + S(15);
        let given = LedgerInput::Given(caller, (&name, &id), wanted, wait);
        self.input(hub, given);
        let pause = self.dice.roll(200);
        self.later(pause, Event::Wanted);
    }

    fn store(&mut self, from: From, key: Key, payload: Vec<u8>, after: u64) {
        let judged = self.judged.entry(key.clone()).or_default();
        let last = judged.records.last().map_or(0, |(number, _)| *number);
        let end = if last == after {
            let number = self.stream.len() as u64 + 1;
            let record = CommandRecord::decode(&*payload).unwrap().record.unwrap();
            judged.records.push((number, record));
            self.stream.push((key.clone(), payload.clone()));
            for to in 0..HUBS {
                // In order, and not lost as long as there is a connection.
                let its = self.hubs[to].1;
                let record = Event::Record(to, its, key.clone(), payload.clone(), number);
                self.later(3, record);
            }
            StoreEnd::Stored(number)
        } else {
            StoreEnd::Conflict
        };
        match self.way() {
            Some(ms) if ms < 5_000 => self.later(ms, Event::Stored(from, key, end)),
            _ => {
                let unknown = StoreEnd::Unknown;
                self.later(5_000, Event::Stored(from, key, unknown));
            }
        }
    }

    /// A request at a site, which does what docs/decisions/0056 says.
    fn request(&mut self, to: From, site: usize, session: u64, request: CommandRequest) {
        let own = &self.sites[site];
        if !own.is_up || own.session != session {
            return;
        }
        let key = (site, request.id.clone());
        let is_this_run = request.boot == own.boot.to_le_bytes();
        let is_late = self.now - own.since > request.valid_until_ms;
        let why = FleetRefusal::default();
        let outcome = match own.keys.get(&request.id) {
            Some(Kept::Ended(status)) => ended(*status),
            // Under way, or begun before a restart.
            Some(Kept::Begun) if is_this_run => CommandOutcome::Later(why),
            Some(Kept::Begun) => ended(504),
            None if is_this_run && !is_late && !request.tell => {
                let run = own.boot;
                let pause = self.pause();
                self.later(pause, Event::Site(site, run, key.clone(), 0, Some(to)));
                self.sites[site].keys.insert(request.id, Kept::Begun);
                return;
            }
            None if is_this_run && !is_late => CommandOutcome::Later(why),
            None if is_this_run => CommandOutcome::Never(why),
            None if !request.tell => CommandOutcome::Later(why),
            None => CommandOutcome::Lost(why),
        };
        self.answer(to, key, outcome);
    }

    /// How long a line takes for something, in ms.
    fn pause(&mut self) -> u64 {
        let most = if self.dice.roll(4) == 0 { 3_000 } else { 100 };
        self.dice.roll(most)
    }

    /// The next step of a command that a site has begun.
    fn site(&mut self, site: usize, run: u64, key: Key, step: u8, to: Option<From>) {
        if self.sites[site].boot != run {
            return;
        }
        let its_time = self.now - self.sites[site].since;
        match step {
            0 => {
                let judged = self.judged.entry(key.clone()).or_default();
                let until = judged.records.iter().find_map(|(_, record)| match record {
                    CommandKind::Intent(intent) => Some(intent.valid_until_ms),
                    CommandKind::End(_) => None,
                });
                let until = until.unwrap_or_default();
                // What has not been sent by then is not sent any more.
                if its_time <= until {
                    judged.acts.push((its_time, until));
                }
                let pause = self.pause();
                self.later(pause, Event::Site(site, run, key, 1, to));
            }
            _ => {
                // What was not sent in time has ended with that.
                let acted = self.judged[&key].acts.len();
                let status = if acted == 1 { 200 } else { 503 };
                let kept = Kept::Ended(status);
                self.sites[site].keys.insert(key.1.clone(), kept);
                if let Some(to) = to {
                    self.answer(to, key, ended(status));
                }
            }
        }
    }

    fn run(&mut self) {
        while let Some(((at, _), event)) = self.events.pop_first() {
            self.now = at;
            match event {
                Event::Wanted => self.wanted(),
                Event::Store(from, key, payload, after) => self.store(from, key, payload, after),
                Event::Stored((hub, connection, of), key, end) => {
                    if self.is_connected(hub, connection) {
                        let name = format!("p{}", key.0);
                        self.input(hub, LedgerInput::Stored((&name, &key.1), of, end));
                    }
                }
                Event::Record(hub, connection, key, payload, number) => {
                    if self.is_connected(hub, connection) {
                        let name = format!("p{}", key.0);
                        let record = LedgerInput::Record((&name, &key.1), &payload, number, S(0));
                        self.input(hub, record);
                    }
                }
                Event::Read((hub, connection, of), key) => {
                    if self.is_connected(hub, connection) {
                        let records = &self.judged[&key].records;
                        let last = records.last().map(|(number, kind)| {
                            let payload = record(kind.clone());
                            (payload, *number)
                        });
                        let is_read = self.is_calm || self.dice.roll(10) > 0;
                        let last = last.filter(|_| is_read);
                        let found = last.as_ref().map(|(payload, at)| (payload.as_slice(), *at));
                        let name = format!("p{}", key.0);
                        self.input(
                            hub,
                            LedgerInput::Read((&name, &key.1), of, is_read.then_some(found)),
                        );
                    }
                }
                Event::Request(from, site, session, request) => {
                    self.request(from, site, session, request);
                }
                Event::Site(site, run, key, step, to) => self.site(site, run, key, step, to),
                Event::Said((hub, connection, of), key, payload) => {
                    if self.is_connected(hub, connection) {
                        let name = format!("p{}", key.0);
                        let said = match &payload {
                            Some(payload) => SiteSaid::Answer(payload),
                            None => SiteSaid::Nothing,
                        };
                        self.input(hub, LedgerInput::Said((&name, &key.1), of, said));
                    }
                }
                Event::NotDelivered((hub, connection, of), key) => {
                    if self.is_connected(hub, connection) {
                        let name = format!("p{}", key.0);
                        let said = LedgerInput::Said((&name, &key.1), of, SiteSaid::NotDelivered);
                        self.input(hub, said);
                    }
                }
                Event::Cut(hub) => {
                    self.hubs[hub].2 = false;
                    // Some are started anew instead, and know nothing any more.
                    match self.dice.roll(3) {
                        0 => self.restarted(hub),
                        _ => self.input(hub, LedgerInput::Lost),
                    }
                    let away = 100 + self.dice.roll(20_000);
                    self.later(away, Event::Back(hub));
                    if self.left > 0 {
                        self.later(40_000, Event::Cut(hub));
                    }
                }
                Event::Back(hub) => {
                    self.hubs[hub].1 += 1;
                    for at in 0..self.stream.len() {
                        let ((site, id), payload) = self.stream[at].clone();
                        let name = format!("p{site}");
                        let number = at as u64 + 1;
                        let record = LedgerInput::Record((&name, &id), &payload, number, S(0));
                        let now = Duration::from_millis(self.now);
                        self.hubs[hub].0.handle(now, record);
                    }
                    self.hubs[hub].2 = true;
                    self.input(hub, LedgerInput::Connected);
                }
                Event::Restart(site) => {
                    let own = &mut self.sites[site];
                    own.is_up = !own.is_up;
                    own.session += 1;
                    // It was killed, with what it was at.
                    if !own.is_up && self.dice.roll(2) == 0 {
                        own.boot += 1;
                        own.since = self.now;
                    }
                    let is_up = self.sites[site].is_up;
                    let pause = if is_up { 8_000 } else { 3_000 };
                    if self.left > 0 || !is_up {
                        let next = if is_up { (site + 1) % SITES } else { site };
                        self.later(pause, Event::Restart(next));
                    }
                }
                Event::Due(hub) => {
                    if self.hubs[hub]
                        .0
                        .deadline()
                        .is_some_and(|due| due <= Duration::from_millis(self.now))
                    {
                        self.outputs(hub);
                    }
                }
            }
            if self.left == 0 && !self.is_calm && self.sites.iter().all(|site| site.is_up) {
                self.is_calm = true;
            }
        }
    }

    /// A centre is started anew: its callers have no connection any more.
    fn restarted(&mut self, hub: usize) {
        self.hubs[hub].0 = Ledger::default();
        self.callers.retain(|_, (its, ..)| *its != hub);
    }

    fn judge(&self) {
        let mut ends: BTreeMap<&str, u64> = BTreeMap::new();
        for (key, judged) in &self.judged {
            let of = format!("{key:?}: {:?} {:?}", judged.records, judged.told);
            assert!(judged.acts.len() <= 1, "switched twice: {of}");
            for (at, until) in &judged.acts {
                assert!(at <= until, "after its deadline: {of}");
            }
            let [(_, CommandKind::Intent(intent)), (_, CommandKind::End(end))] =
                &judged.records[..]
            else {
                assert!(judged.records.is_empty(), "not one end: {of}");
                assert!(judged.acts.is_empty(), "not written down: {of}");
                continue;
            };
            let result = end.end.as_ref().unwrap();
            let acts = judged.acts.len();
            let how = match result {
                CommandResult::Ended(answer) if answer.status == 200 => "done",
                CommandResult::Ended(answer) if answer.status == 503 => "expired",
                CommandResult::Ended(_) => "begun",
                CommandResult::Never(_) => "never",
                CommandResult::Unknown(_) => "unknown",
            };
            *ends.entry(how).or_default() += 1;
            let is_not = how == "never" || how == "expired";
            assert!(!is_not || acts == 0, "{how}, and it was: {of}");
            assert!(how != "done" || acts == 1, "done, and it was not: {of}");
            let most = judged.sends.values().max();
            assert!(most.is_none_or(|most| *most <= 1), "sent twice: {of}");
            for told in &judged.told {
                match told {
                    CommandTold::End(its) => {
                        let its = its.end.as_ref().unwrap();
                        // A result that could not be stored is reported, too: another centre may
                        // store another reason, or that it is not known.
                        let is_both_never = matches!(
                            (its, result),
                            (CommandResult::Never(_), CommandResult::Never(_))
                        );
                        let is_so = its == result || is_both_never || how == "unknown";
                        assert!(is_so, "told another end: {its:?}, {of}");
                    }
                    CommandTold::OtherCommand
                    | CommandTold::Waiting
                    | CommandTold::NotKnown
                    | CommandTold::TooMany
                    | CommandTold::NotStored => {}
                    CommandTold::Offline => panic!("{of}"),
                }
            }
            if judged.tokens_not_sent.contains(&intent.token) {
                assert_eq!(acts, 0, "said not to be sent, and it was: {of}");
            }
        }
        assert!(self.callers.is_empty(), "without an answer");
        for (ledger, ..) in &self.hubs {
            assert_eq!(ledger.open(), 0, "without an end");
        }
        // All of them happen, or this proves nothing.
        let all = ["begun", "done", "expired", "never", "unknown"];
        assert!(all.iter().all(|how| ends.contains_key(how)), "{ends:?}");
    }
}

fn number(site: &str) -> usize {
    site.trim_start_matches('p').parse().unwrap()
}

fn ended(status: u32) -> CommandOutcome {
    CommandOutcome::Ended(ApiAnswer {
        status,
        ..ApiAnswer::default()
    })
}

/// Exactly one end each, no output switched twice, none after its deadline, and no end that is not
/// so.
#[test]
fn each_command_has_one_end_and_it_is_true() {
    let all = std::env::var("RAILBUS_SOAK").ok();
    let all = all.and_then(|text| text.parse().ok()).unwrap_or(20_000);
    for seed in 0..(all / 2_000).max(1) {
        let mut world = World::new(seed + 1, 2_000);
        world.run();
        world.judge();
    }
}
