//! The way to the centre in virtual time, from a seed, with everything that can go wrong on it.

use super::{Disk, Site, TAKEN_IN, new_uplink, welcome};
use crate::dice::Dice;
use crate::message::{Beat, DataBatch, DataEntry, FleetRefusal, HelloAnswer, SiteState};
use crate::uplink::{MESSAGE_MAX, NoResend, Session, UpMessage, UplinkInput, UplinkOutput};
use prost::Message as _;
use railbus_store::outbox::{OutboxEntry, Piece};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// The centre as it should be written: what is true of the one point is what its entry with the
/// highest number says.
#[derive(Default)]
struct Receiver {
    /// By epoch: the highest number, and the value.
    newest: BTreeMap<String, (u64, i64)>,
}

impl Receiver {
    fn hears(&mut self, epoch: &str, seq: u64, value: i64) {
        let known = self.newest.entry(epoch.to_owned()).or_default();
        *known = (*known).max((seq, value));
    }
}

/// What is on its way to the site.
enum Coming {
    Answer(u64, Vec<u8>),
    Read(Option<(Arc<str>, Piece)>),
    State(Option<(Arc<str>, u64, Vec<OutboxEntry>)>),
}

/// What the servers, the centre and the disk do, from a seed: answers that are lost, late, doubled
/// and out of order, connections and sessions that end, servers that lose what they acknowledged,
/// disks that are slow, drop the oldest or begin anew, and restarts.
struct Play {
    seed: u64,
    dice: Dice,
    site: Site,
    /// What the stream has: by epoch and number.
    stored: BTreeMap<(String, u64), i64>,
    /// What it ever had, or was told to be dropped.
    told: BTreeSet<(String, u64)>,
    /// What the site recorded and did not drop.
    appended: BTreeMap<(String, u64), i64>,
    ids: BTreeSet<String>,
    coming: Vec<(Duration, Coming)>,
    receiver: Receiver,
    session: Option<String>,
    sessions: u32,
    is_connected: bool,
    /// Everything goes well.
    is_calm: bool,
}

impl Play {
    fn key(&self, number: u64) -> (String, u64) {
        (self.site.disk.epoch().to_string(), number)
    }

    fn comes(&mut self, most_ms: u64, what: Coming) {
        let most = if self.is_calm { 50 } else { most_ms };
        let late = Duration::from_millis(self.dice.roll(most));
        self.coming.push((self.site.now + late, what));
    }

    fn happens(&mut self, one_in: u64) -> bool {
        !self.is_calm && self.dice.roll(one_in) == 0
    }

    fn outputs(&mut self) {
        while let Some(output) = self.site.uplink.poll(self.site.now, 1_700_000_000_000) {
            match output {
                UplinkOutput::Publish(message) => self.published(&message),
                UplinkOutput::Read(after) => {
                    let read = self.site.disk.read(after).filter(|_| !self.happens(20));
                    self.comes(3_000, Coming::Read(read));
                }
                UplinkOutput::ReadAgain((first, last)) => {
                    let piece = self.site.disk.piece(first, last);
                    let read = Some((self.site.disk.epoch(), piece));
                    self.comes(3_000, Coming::Read(read));
                }
                UplinkOutput::FindState => {
                    let disk = &self.site.disk;
                    let points = disk.entries.last_key_value();
                    let points = points.map(|(_, entry)| entry.clone()).into_iter().collect();
                    let state = Some((disk.epoch(), disk.newest, points));
                    self.comes(3_000, Coming::State(state));
                }
                UplinkOutput::Delivered(epoch, to, _) => {
                    let seed = self.seed;
                    assert_eq!(epoch, self.site.disk.epoch(), "{seed}");
                    assert!(to > self.site.disk.delivered, "{seed}: delivered twice");
                    for number in self.site.disk.delivered + 1..=to {
                        let key = self.key(number);
                        assert!(self.told.contains(&key), "{seed}: {key:?} was nowhere");
                    }
                    self.site.disk.delivered = to;
                }
                _ => {}
            }
        }
    }

    /// The session of a message is the one that the centre gave last, and has not ended.
    fn is_in_session(&self, session: &str) {
        assert_eq!(Some(session), self.session.as_deref(), "{}", self.seed);
    }

    fn published(&mut self, message: &UpMessage) {
        assert!(self.is_connected, "{}: it is not connected", self.seed);
        let is_lost = self.happens(8);
        let answer = match message.subject.rsplit('.').next().unwrap() {
            "hello" => {
                self.sessions += 1;
                let name = format!("s{}", self.sessions);
                let is_refused = self.happens(4);
                self.session = (!is_refused).then(|| name.clone());
                welcome(match is_refused {
                    true => HelloAnswer::Refusal(FleetRefusal::default()),
                    false => HelloAnswer::Session(name),
                })
            }
            "data" => {
                let batch = DataBatch::decode(&*message.payload).unwrap();
                self.is_in_session(&batch.session);
                let refuses = self.happens(10);
                if !is_lost && !refuses && self.ids.insert(message.id.clone().unwrap()) {
                    self.stores(&batch);
                }
                match refuses {
                    true => br#"{"error":{"description":"no leader"}}"#.to_vec(),
                    false => TAKEN_IN.to_vec(),
                }
            }
            "state" => {
                let state = SiteState::decode(&*message.payload).unwrap();
                self.is_in_session(&state.session);
                if let Some(DataEntry { at_ms, .. }) = state.points.first() {
                    self.receiver.hears(&state.epoch, state.seq, *at_ms);
                }
                br#"{"stream":"STATE","seq":1}"#.to_vec()
            }
            _ => {
                let beat = Beat::decode(&*message.payload).unwrap();
                self.is_in_session(&beat.session);
                assert!(beat.delivered <= beat.newest, "{}", self.seed);
                assert!(!self.site.disk.is_failing, "{}: it can't vouch", self.seed);
                // Whoever has all up to this number knows what is so.
                let known = self.receiver.newest.get(&beat.epoch).copied();
                if let Some((seq, value)) = known.filter(|(seq, _)| *seq >= beat.newest) {
                    assert_eq!(value, i64::try_from(seq).unwrap(), "{}", self.seed);
                }
                return;
            }
        };
        if !is_lost && let Some(number) = message.answer {
            let times = if self.happens(10) { 2 } else { 1 };
            for _ in 0..times {
                self.comes(15_000, Coming::Answer(number, answer.clone()));
            }
        }
    }

    fn stores(&mut self, batch: &DataBatch) {
        let key = |seq| (batch.epoch.clone(), seq);
        for (entry, seq) in batch.entries.iter().zip(batch.seq..) {
            self.stored.insert(key(seq), entry.at_ms);
            self.told.insert(key(seq));
            self.receiver.hears(&batch.epoch, seq, entry.at_ms);
        }
        if let Some(dropped) = batch.dropped {
            self.told
                .extend((batch.seq - dropped.count..batch.seq).map(key));
        }
    }

    /// Something that happens by itself.
    fn chance(&mut self) {
        match self.dice.roll(20) {
            0 if !self.is_calm => {
                self.is_connected = !self.is_connected;
                self.site.handle(match self.is_connected {
                    true => UplinkInput::Connected(MESSAGE_MAX),
                    false => UplinkInput::Lost,
                });
            }
            1 if !self.is_calm && self.is_connected => {
                // Only who listens can be told.
                let own = self.session.clone().map(Session::Has);
                if own.is_some_and(|own| own == self.site.uplink.session)
                    && let Some(session) = self.session.take()
                {
                    self.site.handle(UplinkInput::Ended(&session));
                }
            }
            2 if self.happens(5) => {
                // The file was broken: what the servers do not have of it is lost.
                self.appended.retain(|key, _| self.stored.contains_key(key));
                self.site.disk = Disk {
                    epoch: self.site.disk.epoch + 1,
                    ..Disk::default()
                };
                self.site.stored();
            }
            3 if !self.is_calm => {
                // A restart: what is on the disk stays.
                self.site.uplink = new_uplink();
                self.site.stored();
                self.coming.clear();
                self.session = None;
                if self.is_connected {
                    self.site.handle(UplinkInput::Connected(MESSAGE_MAX));
                }
            }
            4 | 5 if !self.is_calm => {
                // A loss of power: servers lose what they have acknowledged.
                let from = self.dice.roll(self.site.disk.newest + 1);
                let lost = from..from + self.dice.roll(2_500);
                let epoch = self.site.disk.epoch();
                let is_lost =
                    |(its, number): &(String, u64)| *its == *epoch && lost.contains(number);
                self.stored.retain(|key, _| !is_lost(key));
            }
            14 if !self.is_calm => {
                self.site.disk.is_failing = !self.site.disk.is_failing;
                self.site.stored();
            }
            6..=12 => self.asks_again(),
            13 if !self.is_calm => {
                // The oldest are too old, delivered or not; the newest stays.
                let first = self.dice.roll(self.site.disk.newest + 1);
                let first = first.min(self.site.disk.newest);
                let kept = self.site.disk.entries.split_off(&first);
                for number in std::mem::replace(&mut self.site.disk.entries, kept).into_keys() {
                    let key = self.key(number);
                    self.appended.remove(&key);
                }
            }
            _ if self.is_calm => {}
            _ => {
                let count = match self.dice.roll(20) {
                    0 => 1_500,
                    _ => self.dice.roll(4),
                };
                let before = self.site.disk.newest;
                self.site.disk.append(count);
                for number in before + 1..=self.site.disk.newest {
                    let key = self.key(number);
                    self.appended.insert(key, i64::try_from(number).unwrap());
                }
                self.site.stored();
            }
        }
    }

    /// The centre asks for what it misses.
    fn asks_again(&mut self) {
        let missing = |number: &u64| {
            let key = self.key(*number);
            !self.stored.contains_key(&key) && self.appended.contains_key(&key)
        };
        let mut missing = (1..=self.site.disk.delivered).filter(missing);
        if let Some(first) = missing.next() {
            let last = missing.next_back().unwrap_or(first);
            let epoch = self.site.disk.epoch();
            let end = self.site.uplink.resend(&epoch, (first, last));
            assert_ne!(end, Err(NoResend::Epoch), "{}", self.seed);
        }
    }

    fn step(&mut self) {
        self.outputs();
        self.coming.sort_by_key(|(at, _)| *at);
        let chance = self.site.now + Duration::from_millis(1 + self.dice.roll(20_000));
        let coming = self.coming.first().map(|(at, _)| *at);
        let next = [coming, self.site.uplink.deadline(), Some(chance)];
        let next = next.into_iter().flatten().min().unwrap();
        self.site.now = next.max(self.site.now);
        if coming.is_some_and(|at| at <= self.site.now) {
            match self.coming.remove(0).1 {
                Coming::Answer(number, answer) if self.is_connected => {
                    self.site.answer(number, &answer);
                }
                Coming::Answer(..) => {}
                Coming::Read(read) => self.site.handle(UplinkInput::Read(read)),
                Coming::State(state) => self.site.handle(UplinkInput::State(state)),
            }
        } else if chance <= self.site.now {
            self.chance();
        }
    }
}

fn play(seed: u64) {
    let mut play = Play {
        seed,
        dice: Dice(seed),
        site: Site::new(),
        stored: BTreeMap::new(),
        told: BTreeSet::new(),
        appended: BTreeMap::new(),
        ids: BTreeSet::new(),
        coming: Vec::new(),
        receiver: Receiver::default(),
        session: None,
        sessions: 0,
        is_connected: false,
        is_calm: false,
    };
    while play.site.now < Duration::from_secs(1_200) {
        play.step();
    }
    play.is_calm = true;
    play.site.disk.is_failing = false;
    play.site.stored();
    if !play.is_connected {
        play.is_connected = true;
        play.site.handle(UplinkInput::Connected(MESSAGE_MAX));
    }
    while play.site.now < Duration::from_secs(2_000) {
        play.step();
    }
    assert_eq!(play.site.uplink.behind(), 0, "{seed}: something is left");
    for (key, at) in &play.appended {
        assert_eq!(play.stored.get(key), Some(at), "{seed}: {key:?}");
    }
    // The value of the point is the number of its entry.
    let newest = play.site.disk.newest;
    if newest > 0 {
        let known = play.receiver.newest.get(&*play.site.disk.epoch());
        let is = (newest, i64::try_from(newest).unwrap());
        assert_eq!(known, Some(&is), "{seed}: what the centre takes for true");
    }
}

#[test]
fn whatever_is_lost_late_doubled_or_reordered_all_arrives_and_nothing_is_said_to_that_did_not() {
    for seed in 0..30 {
        play(seed);
    }
}
