//! Two processes of the centre, a stream that delays and loses answers, and a ledger that does what
//! one may, in virtual time and from a seed. The judge looks at which sites were switched.

use super::*;
use crate::dice::Dice;

const SITES: usize = 40;
const HUBS: usize = 2;

/// A hub, its connection, and the number of what it wanted.
type From = (usize, u64, u64);

#[derive(Clone, Debug)]
enum Event {
    /// A record arrives at the stream: under this subject, after this number.
    Store(From, String, Vec<u8>, u64),
    Stored(From, String, StoreEnd),
    /// A record arrives at a hub.
    Heard(usize, u64, usize),
    /// A site is commanded: its record arrives at the stream, or not, and is known to, or not.
    Command(From, String),
    /// The site acts.
    Act(From, String),
    Told(From, String, CommandTold),
    Cut(usize),
    Back(usize),
    /// A process of the centre is killed.
    Killed(usize),
    Stop(usize),
    Due(usize),
}

struct World {
    dice: Dice,
    now: u64,
    events: BTreeMap<(u64, u64), Event>,
    number: u64,
    hubs: Vec<Bulks>,
    /// How often each was connected; none while it is not.
    connections: Vec<(u64, bool)>,
    /// Subject and record.
    stream: Vec<(String, Vec<u8>, u64)>,
    order: BulkOrder,
    acted: BTreeSet<String>,
    begun: BTreeSet<String>,
    told: usize,
    killed: Option<usize>,
    /// The sites that any hub has reported as not commanded.
    left: BTreeSet<String>,
}

impl World {
    fn new(seed: u64) -> World {
        let names: Vec<String> = (0..SITES).map(|at| format!("p{at:02}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut world = World {
            dice: Dice(seed),
            now: 0,
            events: BTreeMap::new(),
            number: 0,
            // Fewer than sites: some are left over.
            hubs: (0..HUBS).map(|_| Bulks::with(8)).collect(),
            connections: vec![(1, true); HUBS],
            stream: Vec::new(),
            order: order(&names),
            acted: BTreeSet::new(),
            begun: BTreeSet::new(),
            told: 0,
            killed: None,
            left: BTreeSet::new(),
        };
        for hub in 0..HUBS {
            world.input(hub, BulkInput::Connected);
        }
        world
    }

    fn later(&mut self, ms: u64, event: Event) {
        self.number += 1;
        self.events.insert((self.now + ms, self.number), event);
    }

    fn pause(&mut self) -> u64 {
        match self.dice.roll(10) {
            0 => self.dice.roll(9_000),
            _ => self.dice.roll(50),
        }
    }

    fn is_connected(&self, (hub, connection, _): From) -> bool {
        self.connections[hub] == (connection, true)
    }

    fn input(&mut self, hub: usize, input: BulkInput<'_>) {
        if self.killed == Some(hub) {
            return;
        }
        self.hubs[hub].handle(Duration::from_millis(self.now), input);
        self.outputs(hub);
    }

    fn outputs(&mut self, hub: usize) {
        if self.killed == Some(hub) {
            return;
        }
        let (connection, is_up) = self.connections[hub];
        while let Some(output) = self.hubs[hub].poll(Duration::from_millis(self.now)) {
            match output {
                BulkOutput::Store {
                    number,
                    id,
                    payload,
                    after,
                } => {
                    assert!(is_up, "stored without a connection");
                    let (from, ms) = ((hub, connection, number), self.pause());
                    self.later(ms, Event::Store(from, format!("BULK.{id}"), payload, after));
                }
                BulkOutput::Begin { site, .. } => {
                    assert!(is_up, "begun without a connection");
                    assert!(self.begun.insert(site.clone()), "{site} was begun twice");
                    let ms = self.pause();
                    self.later(ms, Event::Command((hub, connection, 0), site));
                }
                BulkOutput::Tell(..) => self.told += 1,
            }
        }
        if let Some(due) = self.hubs[hub].deadline() {
            let due = u64::try_from(due.as_millis()).unwrap().max(self.now + 1);
            self.later(due - self.now, Event::Due(hub));
        }
    }

    /// A record is in the stream, and hubs hear of it.
    fn append(&mut self, subject: String, payload: Vec<u8>) -> u64 {
        self.stream.push((subject, payload, self.now));
        let place = self.stream.len() - 1;
        for hub in 0..HUBS {
            if let (connection, true) = self.connections[hub] {
                self.later(20, Event::Heard(hub, connection, place));
            }
        }
        u64::try_from(place).unwrap() + 1
    }

    fn last_of(&self, subject: &str) -> u64 {
        let last = self.stream.iter().rposition(|(of, ..)| of == subject);
        last.map_or(0, |place| u64::try_from(place).unwrap() + 1)
    }

    fn hear(&mut self, hub: usize, place: usize, age: u64) {
        let (subject, payload, _) = self.stream[place].clone();
        let (site, id) = subject.split_once('.').unwrap();
        let number = u64::try_from(place).unwrap() + 1;
        match site == BULK {
            true => {
                let age = Duration::from_millis(age);
                self.input(hub, BulkInput::Record(id, &payload, number, age));
            }
            false => self.input(hub, BulkInput::Command((site, id), &payload)),
        }
    }

    fn command(&mut self, from: From, site: String) {
        let told = |world: &mut World, told| {
            let ms = world.pause();
            world.later(ms, Event::Told(from, site.clone(), told));
        };
        if !self.is_connected(from) {
            return told(self, CommandTold::NotStored);
        }
        let subject = format!("{site}.b1");
        let intent = record(CommandKind::Intent(intent(&self.order)));
        match self.dice.roll(10) {
            0 | 1 => told(self, CommandTold::Offline),
            // It is recorded, but that is not known: it is not sent, and ended as such.
            2 => {
                self.append(subject.clone(), intent);
                let never = CommandResult::Never(refusal("E0164", ""));
                let end = Some(never);
                let end = CommandEnd {
                    end,
                    ..answered(&self.order)
                };
                self.append(subject, record(CommandKind::End(end)));
                told(self, CommandTold::NotStored);
            }
            3 => told(self, CommandTold::NotStored),
            _ => {
                self.append(subject, intent);
                let ms = self.pause();
                self.later(ms, Event::Act(from, site));
            }
        }
    }

    fn act(&mut self, from: From, site: String) {
        assert!(!self.left.contains(&site), "{site} was said to be left");
        self.acted.insert(site.clone());
        let end = answered(&self.order);
        let told = match self.is_connected(from) && self.dice.roll(4) > 0 {
            true => CommandTold::End(Arc::new(end.clone())),
            false => CommandTold::Waiting,
        };
        self.append(format!("{site}.b1"), record(CommandKind::End(end)));
        let ms = self.pause();
        self.later(ms, Event::Told(from, site, told));
    }

    fn event(&mut self, event: Event) {
        match event {
            Event::Store(from, subject, payload, after) => {
                let last = self.last_of(&subject);
                let (is_lost, is_unknown) = (self.dice.roll(8) == 0, self.dice.roll(8) == 0);
                let mut end = match last == after && !is_lost {
                    true => StoreEnd::Stored(self.append(subject.clone(), payload)),
                    false if is_lost => StoreEnd::Unknown,
                    false => StoreEnd::Conflict,
                };
                if is_unknown {
                    end = StoreEnd::Unknown;
                }
                let ms = self.pause();
                self.later(ms, Event::Stored(from, subject, end));
            }
            Event::Stored(from, subject, end) => {
                if self.is_connected(from) {
                    let id = subject.split_once('.').unwrap().1;
                    self.input(from.0, BulkInput::Stored(id, from.2, end));
                }
            }
            Event::Heard(hub, connection, place) => {
                if self.connections[hub] == (connection, true) {
                    self.hear(hub, place, 0);
                }
            }
            Event::Command(from, site) => self.command(from, site),
            Event::Act(from, site) => self.act(from, site),
            // The ledger answers also without a connection.
            Event::Told((hub, ..), site, told) => {
                self.input(hub, BulkInput::Told((&site, "b1"), told));
            }
            Event::Cut(hub) => {
                if self.connections[hub].1 {
                    self.connections[hub].1 = false;
                    self.input(hub, BulkInput::Lost);
                    let ms = self.dice.roll(60_000);
                    self.later(ms, Event::Back(hub));
                }
            }
            Event::Back(hub) if self.killed == Some(hub) => {}
            Event::Back(hub) => {
                self.connections[hub].0 += 1;
                self.connections[hub].1 = true;
                // The stream is read before anything else.
                for place in 0..self.stream.len() {
                    let age = self.now - self.stream[place].2;
                    self.hear(hub, place, age);
                }
                self.input(hub, BulkInput::Connected);
            }
            Event::Killed(hub) => {
                self.connections[hub].1 = false;
                self.killed = Some(hub);
            }
            Event::Stop(hub) => self.input(hub, BulkInput::Stop(9, "b1", "wu")),
            Event::Due(hub) => self.outputs(hub),
        }
    }

    fn run(&mut self) {
        let order = self.order.clone();
        self.input(0, BulkInput::Given(1, "b1", order.clone()));
        if self.dice.roll(2) == 0 {
            let again = BulkOrder {
                token: vec![2],
                ..order
            };
            self.input(1, BulkInput::Given(2, "b1", again));
        }
        for _ in 0..self.dice.roll(3) {
            let (hub, ms) = (usize::from(self.dice.roll(2) == 0), self.dice.roll(10_000));
            self.later(ms, Event::Cut(hub));
        }
        if self.dice.roll(2) == 0 {
            let (hub, ms) = (usize::from(self.dice.roll(2) == 0), self.dice.roll(3_000));
            self.later(ms, Event::Stop(hub));
        }
        if self.dice.roll(4) == 0 {
            let ms = self.dice.roll(1_000);
            self.later(ms, Event::Killed(0));
        }
        let mut steps = 0_u32;
        while let Some((at, event)) = self.events.pop_first() {
            steps += 1;
            assert!(steps < 200_000, "it goes on for ever");
            self.now = at.0;
            self.event(event);
            self.watch();
        }
    }

    /// No hub ever reports a site as not commanded that acts, before or afterwards.
    fn watch(&mut self) {
        for (at, hub) in self.hubs.iter().enumerate() {
            let view = hub.get("b1").filter(|_| self.killed != Some(at));
            for (site, state, _) in view.iter().flat_map(BulkView::sites) {
                if state == Never {
                    assert!(!self.acted.contains(site), "hub {at}: {site} acted");
                    self.left.insert(site.to_owned());
                }
            }
        }
    }

    fn judge(&self) {
        let states = |hub: &Bulks| -> Option<Vec<(String, BulkSiteState)>> {
            let view = hub.get("b1")?;
            assert!(view.ended_ms.is_some(), "it has no end");
            let sites = view.sites();
            Some(
                sites
                    .map(|(name, state, _)| (name.to_owned(), state))
                    .collect(),
            )
        };
        let told = states(&self.hubs[1]);
        if self.killed.is_none() {
            assert_eq!(states(&self.hubs[0]), told, "they tell it differently");
        }
        for (site, state) in told.into_iter().flatten() {
            let expected = match self.acted.contains(&site) {
                true => Done,
                false => Never,
            };
            assert_eq!(state, expected, "{site}");
        }
    }
}

/// Each site is commanded at most once, both processes tell the same, and what they tell is so.
#[test]
fn what_is_told_of_each_site_is_so() {
    let (mut acted, mut left) = (0, 0);
    for seed in 1..=500 {
        let mut world = World::new(seed);
        world.run();
        world.judge();
        assert!(world.told > 0 || world.killed.is_some());
        acted += world.acted.len();
        left += SITES - world.acted.len();
    }
    // Both happen.
    assert!(acted > 3_000 && left > 3_000, "{acted} {left}");
}
