//! Two machines with one key and two centres in virtual time, seeded: messages lost, late and out
//! of order, leases lost or stored without anybody being told, machines that sleep, restarts of
//! all, and a site that is removed and comes back. The judge knows what each machine recorded, and
//! when.

use crate::centre::{
    Centre, CentreInput, CentreOutput, ONLINE, RemovalEnd, SitePresence, StoreEnd,
};
use crate::dice::Dice;
use crate::message::{SessionLease, UplinkValue};
use crate::uplink::tests::{Site, uplink_of};
use crate::uplink::{UpMessage, UplinkInput, UplinkOutput};
use prost::Message as _;
use std::collections::BTreeMap;
use std::time::Duration;

const SITE: &str = "plant7";
/// How long a message takes at the most, in milliseconds.
const LATE_MS: u64 = 3_000;
/// The same of a request for a session, which a centre may get round to late.
const HELLO_LATE_MS: u64 = 25_000;
/// Where nothing goes wrong.
const CALM_MS: u64 = 50;
/// The values of a machine are its number times this, and the numbers of its entries.
const OF_MACHINE: u64 = 1_000_000;
/// What servers say of data that is stored.
const STORED: [(&str, &[u8]); 2] = [
    ("data", br#"{"stream":"DATA","seq":1}"#),
    ("state", br#"{"stream":"STATE","seq":1}"#),
];

/// What is on its way.
enum Coming {
    Hello(usize, u64, Vec<u8>),
    Said(usize, String, Vec<u8>),
    Lease(usize, Vec<u8>, u64),
    Stored(usize, u64, StoreEnd),
    /// The last document at that time; it may not be known.
    LeaseRead(usize, Option<Option<(Vec<u8>, u64)>>),
    Answer(usize, u64, Vec<u8>),
    /// A request to the machine subscribed to this subject.
    Asked(String),
}

struct Machine {
    site: Site,
    installation: u8,
    is_on: bool,
    is_connected: bool,
    /// For how long it slept by now, and until when it does.
    slept: Duration,
    wakes: Duration,
    /// The subject at which it listens, without its last word, and the session.
    listens: Option<(String, String)>,
    /// When it had which newest value.
    recorded: Vec<(Duration, u64)>,
}

struct World {
    seed: u64,
    dice: Dice,
    now: Duration,
    machines: Vec<Machine>,
    /// One that is away has none.
    hubs: Vec<Option<Centre>>,
    /// Requests for sessions: of which machine, and their number there.
    asked: BTreeMap<u64, (usize, u64)>,
    number: u64,
    boots: u8,
    /// The documents of the site's sessions, and its last state.
    leases: Vec<Vec<u8>>,
    state: Option<Vec<u8>>,
    /// Which machine got which session.
    holders: BTreeMap<String, usize>,
    coming: Vec<(Duration, Coming)>,
    is_calm: bool,
    /// How often points were said to be known.
    known: u64,
    copies: u64,
    /// How often the site was removed, and how often it was back before.
    removed: u64,
    outrun: u64,
}

impl Machine {
    /// Its time stands still meanwhile.
    fn sleeps(&mut self, now: Duration, seconds: u64) {
        if now >= self.wakes {
            self.wakes = now + Duration::from_secs(seconds);
            self.slept += Duration::from_secs(seconds);
        }
    }

    /// Its own time.
    fn time(&self, now: Duration) -> Duration {
        now.max(self.wakes) - self.slept
    }
}

impl World {
    fn comes(&mut self, what: Coming) {
        let most = match &what {
            _ if self.is_calm => CALM_MS,
            // Others were asked meanwhile.
            Coming::Hello(..) => HELLO_LATE_MS,
            _ => LATE_MS,
        };
        let at = self.now + Duration::from_millis(self.dice.roll(most));
        self.coming.push((at, what));
    }

    fn happens(&mut self, one_in: u64) -> bool {
        !self.is_calm && self.dice.roll(one_in) == 0
    }

    fn starts(&mut self, at: usize) {
        self.boots += 1;
        let machine = &mut self.machines[at];
        machine.site.uplink = uplink_of([machine.installation; 16], [self.boots; 16]);
        machine.listens = None;
        machine.site.now = machine.time(self.now);
        machine.site.stored();
        if machine.is_connected {
            machine.site.handle(UplinkInput::Connected(1 << 20));
        }
    }

    fn run(&mut self, at: usize) {
        let machine = &mut self.machines[at];
        if !machine.is_on || self.now < machine.wakes {
            return;
        }
        machine.site.now = machine.time(self.now);
        for output in machine.site.outputs() {
            let machine = &mut self.machines[at];
            match output {
                UplinkOutput::Publish(message) => self.published(at, message),
                UplinkOutput::Listen(subjects, session) => {
                    self.holders.insert(session.clone(), at);
                    let subject = subjects.trim_end_matches('*').to_owned();
                    machine.listens = Some((subject, session));
                }
                UplinkOutput::Unlisten => machine.listens = None,
                UplinkOutput::Delivered(_, to, _) => {
                    machine.site.disk.delivered = to;
                    machine.site.stored();
                }
                _ => {}
            }
        }
    }

    fn published(&mut self, at: usize, message: UpMessage) {
        assert!(self.machines[at].is_connected, "{}", self.seed);
        let what = message.subject.rsplit('.').next().unwrap();
        let up: Vec<_> = (0..self.hubs.len())
            .filter(|hub| self.hubs[*hub].is_some())
            .collect();
        if what == "hello" {
            if !up.is_empty() && !self.happens(8) {
                let hub = up[usize::try_from(self.dice.roll(up.len() as u64)).unwrap()];
                self.number += 1;
                let number = message.answer.unwrap();
                self.asked.insert(self.number, (at, number));
                self.comes(Coming::Hello(hub, self.number, message.payload));
            }
            return;
        }
        for hub in up {
            if !self.happens(8) {
                let said = Coming::Said(hub, what.to_owned(), message.payload.clone());
                self.comes(said);
            }
        }
        if self.happens(8) {
            return;
        }
        if what == "state" {
            self.state = Some(message.payload);
        }
        let answer = STORED.iter().find(|(word, _)| *word == what);
        if let (Some(number), Some((_, answer))) = (message.answer, answer) {
            self.comes(Coming::Answer(at, number, answer.to_vec()));
        }
    }

    fn run_hub(&mut self, hub: usize) {
        while let Some(output) = self.hubs[hub].as_mut().and_then(Centre::poll) {
            match output {
                CentreOutput::Reply(number, answer) => {
                    let (at, number) = self.asked[&number];
                    if !self.happens(8) {
                        self.comes(Coming::Answer(at, number, answer));
                    }
                }
                CentreOutput::Store {
                    number,
                    subject,
                    payload,
                    after,
                }
                | CentreOutput::StoreRemoval {
                    number,
                    subject,
                    payload,
                    after,
                    ..
                } => {
                    assert_eq!(subject, format!("rb.fleet.lease.{SITE}"));
                    let is_stored = after == self.leases.len() as u64 && !self.happens(10);
                    if is_stored {
                        self.leases.push(payload.clone());
                    }
                    let revision = self.leases.len() as u64;
                    if is_stored {
                        for hub in 0..self.hubs.len() {
                            self.comes(Coming::Lease(hub, payload.clone(), revision));
                        }
                    }
                    // What became of it may never be heard.
                    let end = match is_stored {
                        _ if self.happens(5) => StoreEnd::Unknown,
                        true => StoreEnd::Stored(revision),
                        false => StoreEnd::Conflict,
                    };
                    self.comes(Coming::Stored(hub, number, end));
                }
                CentreOutput::RemovalEnded(_, end) => {
                    self.removed += u64::from(end == RemovalEnd::Removed);
                    self.outrun += u64::from(end == RemovalEnd::NotOffline);
                }
                CentreOutput::Drop(number) => {
                    assert!(self.asked.contains_key(&number), "{}", self.seed);
                }
                CentreOutput::ReadLease(site) => {
                    assert_eq!(site, SITE);
                    let last = self.leases.last().cloned();
                    let last = last.map(|last| (last, self.leases.len() as u64));
                    let found = (!self.happens(5)).then_some(last);
                    self.comes(Coming::LeaseRead(hub, found));
                }
                CentreOutput::Request(subject) => {
                    if !self.happens(8) {
                        self.comes(Coming::Asked(subject));
                    }
                }
            }
        }
        self.judge(hub);
    }

    /// What a centre shows as known was so when it says, or is so since.
    fn judge(&mut self, hub: usize) {
        let Some(centre) = &self.hubs[hub] else {
            return;
        };
        let Some(view) = centre.site(self.now, SITE) else {
            return;
        };
        self.copies += u64::from(view.duplicate == Some(Duration::ZERO));
        if !view.is_current {
            return;
        }
        self.known += 1;
        let lease = &centre.sites[SITE].holder.as_ref().unwrap().lease;
        let at = self.holders[&lease.session];
        let was = self.now - view.vouched.unwrap() - Duration::from_millis(LATE_MS);
        assert!(view.vouched.unwrap() <= ONLINE, "{}", self.seed);
        let recorded = &self.machines[at].recorded;
        let value = match view.points.values().next().map(|p| &p.reading.value) {
            Some(Some(UplinkValue::Count(value))) => u64::try_from(*value).unwrap(),
            None => 0,
            other => panic!("{}: {other:?}", self.seed),
        };
        let from = recorded.iter().rev().find(|(time, _)| *time <= was);
        let from = from.map_or(0, |(_, value)| *value);
        let newest = recorded.last().map_or(0, |(_, value)| *value);
        let (seed, now) = (self.seed, self.now);
        // Numbers go on where a disk was copied; the machine is in the thousands of the value.
        assert!(
            (from..=newest).contains(&value),
            "{seed}, {now:?}: {value} of machine {at}, which had {from} then and {newest} now"
        );
    }

    fn records(&mut self, at: usize, count: u64) {
        let machine = &mut self.machines[at];
        if self.now < machine.wakes {
            return;
        }
        machine.site.now = machine.time(self.now);
        machine.site.disk.append(count);
        let newest = machine.site.disk.value_from + machine.site.disk.newest;
        machine.recorded.push((self.now, newest));
        machine.site.stored();
    }

    fn chance(&mut self) {
        let at = usize::try_from(self.dice.roll(2)).unwrap();
        let hub = usize::try_from(self.dice.roll(2)).unwrap();
        let roll = self.dice.roll(12);
        if self.is_calm {
            return;
        }
        match roll {
            0 => {
                let machine = &mut self.machines[at];
                machine.is_connected = !machine.is_connected;
                machine.site.now = machine.time(self.now);
                machine.site.handle(match machine.is_connected {
                    true => UplinkInput::Connected(1 << 20),
                    false => UplinkInput::Lost,
                });
            }
            1 if self.boots < 200 => self.starts(at),
            2 => {
                self.machines[1].is_on = !self.machines[1].is_on;
                self.starts(1);
            }
            3 => match self.hubs[hub] {
                Some(_) => self.hubs[hub] = None,
                None => self.hub_starts(hub),
            },
            4 => {
                // It does not hear for a moment, and may have missed anything.
                let now = self.now;
                let revision = self.leases.len() as u64;
                if let Some(centre) = &mut self.hubs[hub] {
                    centre.handle(now, CentreInput::Lost);
                    if let Some(lease) = self.leases.last() {
                        centre.handle(now, CentreInput::Lease(SITE, lease, revision));
                    }
                    centre.handle(now, CentreInput::Connected);
                }
            }
            5 if self.happens(4) => self.machines[at].sleeps(self.now, self.dice.roll(90)),
            // The servers lose what they have acknowledged.
            6 if self.happens(10) => self.leases.clear(),
            // Somebody removes it where it is offline.
            7 => {
                self.number += 1;
                let (now, number) = (self.now, self.number);
                let offline = Some(SitePresence::Offline);
                if let Some(centre) = &mut self.hubs[hub]
                    && centre.site(now, SITE).map(|view| view.presence) == offline
                {
                    let name = format!("removed{number}");
                    centre.handle(now, CentreInput::Remove(number, SITE, name));
                    self.run_hub(hub);
                }
            }
            _ => {
                let count = 1 + self.dice.roll(3);
                self.records(at, count);
            }
        }
        self.run(0);
        self.run(1);
    }

    fn hub_starts(&mut self, hub: usize) {
        let mut centre = Centre::default();
        let revision = self.leases.len() as u64;
        if let Some(lease) = self.leases.last() {
            centre.handle(self.now, CentreInput::Lease(SITE, lease, revision));
        }
        if let Some(state) = &self.state {
            centre.handle(self.now, CentreInput::Said(SITE, "state", state));
        }
        centre.handle(self.now, CentreInput::Connected);
        self.hubs[hub] = Some(centre);
        self.run_hub(hub);
    }

    fn arrives(&mut self, what: Coming) {
        let now = self.now;
        let (hub, input) = match &what {
            Coming::Answer(at, number, answer) => {
                let machine = &mut self.machines[*at];
                machine.site.now = machine.time(now);
                if machine.is_connected {
                    let answer = UplinkInput::Answer(*number, Some(answer));
                    machine.site.handle(answer);
                }
                return self.run(*at);
            }
            Coming::Asked(subject) => return self.asks(subject),
            Coming::Hello(hub, number, payload) => {
                let session = format!("s{number}");
                (hub, CentreInput::Hello(*number, SITE, payload, session))
            }
            Coming::Said(hub, what, payload) => (hub, CentreInput::Said(SITE, what, payload)),
            Coming::Lease(hub, payload, revision) => {
                (hub, CentreInput::Lease(SITE, payload, *revision))
            }
            Coming::Stored(hub, number, end) => (hub, CentreInput::Stored(*number, *end)),
            Coming::LeaseRead(hub, found) => {
                let found = found.as_ref().map(|found| {
                    let found = found.as_ref();
                    found.map(|(payload, revision)| (payload.as_slice(), *revision))
                });
                (hub, CentreInput::LeaseRead(SITE, found))
            }
        };
        if let Some(centre) = &mut self.hubs[*hub] {
            centre.handle(now, input);
        }
        self.run_hub(*hub);
    }

    fn asks(&mut self, subject: &str) {
        let (before, what) = subject.rsplit_once('.').unwrap();
        for at in 0..self.machines.len() {
            let machine = &mut self.machines[at];
            let listens = machine.listens.clone();
            let Some((_, session)) = listens.filter(|(own, _)| own[..own.len() - 1] == *before)
            else {
                continue;
            };
            machine.site.now = machine.time(self.now);
            match what {
                "end" => machine.site.handle(UplinkInput::Ended(&session)),
                "state" => machine.site.uplink.send_state(),
                other => panic!("{other}"),
            }
            self.run(at);
        }
    }

    fn step(&mut self) {
        let machines = self.machines.iter().filter(|machine| machine.is_on);
        let due = machines.filter_map(|machine| {
            let due = machine.site.uplink.deadline()?;
            Some((due + machine.slept).max(machine.wakes))
        });
        let chance = self.now + Duration::from_millis(1 + self.dice.roll(8_000));
        self.coming.sort_by_key(|(at, _)| *at);
        let coming = self.coming.first().map(|(at, _)| *at);
        let next = due.chain(coming).chain([chance]).min().unwrap();
        self.now = next.max(self.now);
        if coming.is_some_and(|at| at <= self.now) {
            let (_, what) = self.coming.remove(0);
            self.arrives(what);
        } else if chance <= self.now {
            self.chance();
        }
        self.run(0);
        self.run(1);
        self.run_hub(0);
        self.run_hub(1);
    }
}

fn machine(number: u8, installation: u8) -> Machine {
    let mut site = Site::new();
    site.disk.value_from = u64::from(number) * OF_MACHINE;
    Machine {
        site,
        installation,
        is_on: true,
        is_connected: false,
        slept: Duration::ZERO,
        wakes: Duration::ZERO,
        listens: None,
        recorded: Vec::new(),
    }
}

fn play(seed: u64) -> [u64; 4] {
    // The second machine has a copy of the disk, or the key alone.
    let second = if seed.is_multiple_of(2) { 1 } else { 2 };
    let mut world = World {
        seed,
        dice: Dice(seed),
        now: Duration::from_secs(1_000),
        machines: vec![machine(1, 1), machine(2, second)],
        hubs: vec![None, None],
        asked: BTreeMap::new(),
        number: 0,
        boots: 0,
        leases: Vec::new(),
        state: None,
        holders: BTreeMap::new(),
        coming: Vec::new(),
        is_calm: false,
        known: 0,
        copies: 0,
        removed: 0,
        outrun: 0,
    };
    world.starts(0);
    world.starts(1);
    world.machines[1].is_on = false;
    while world.now < Duration::from_secs(3_000) {
        world.step();
    }
    world.is_calm = true;
    for hub in 0..2 {
        if world.hubs[hub].is_none() {
            world.hub_starts(hub);
        }
    }
    for at in 0..2 {
        let machine = &mut world.machines[at];
        let is_restarted = !machine.is_on || seed % 4 < 2;
        let was_connected = std::mem::replace(&mut machine.is_connected, true);
        machine.is_on = true;
        if is_restarted {
            world.starts(at);
        } else if !was_connected {
            let machine = &mut world.machines[at];
            machine.site.now = machine.time(world.now);
            machine.site.handle(UplinkInput::Connected(1 << 20));
        }
    }
    while world.now < Duration::from_secs(4_500) {
        world.step();
    }
    let lease = SessionLease::decode(&**world.leases.last().unwrap()).unwrap();
    let holder = world.holders[&lease.session];
    let own = world.machines[holder].listens.as_ref();
    assert_eq!(own.map(|(_, name)| name), Some(&lease.session), "{seed}");
    let other = &world.machines[1 - holder];
    assert_eq!(other.listens, None, "{seed}: two have a session");
    for centre in world.hubs.iter().flatten() {
        let view = centre.site(world.now, SITE).unwrap();
        assert_eq!(view.presence, SitePresence::Online, "{seed}");
        assert!(view.is_current, "{seed}");
    }
    let copy = |centre: &Centre| centre.site(world.now, SITE).unwrap().duplicate;
    let copies = world.hubs.iter().flatten().filter_map(copy);
    let last = copies.min().unwrap();
    assert!(last < Duration::from_secs(310), "{seed}: {last:?}");
    [world.known, world.copies, world.removed, world.outrun]
}

#[test]
fn whatever_two_machines_and_two_centres_do_what_is_shown_as_known_was_so() {
    let mut all = [0; 4];
    for seed in 0..40 {
        for (sum, count) in all.iter_mut().zip(play(seed)) {
            *sum += count;
        }
    }
    // A judge that never has to judge proves nothing.
    let [known, copies, removed, outrun] = all;
    assert!(known > 10_000, "{known}");
    assert!(copies > 100, "{copies}");
    assert!(removed > 30, "{removed}");
    assert!(outrun > 0, "{outrun}");
}
