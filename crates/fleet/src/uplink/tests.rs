use super::*;
use crate::message::FleetRefusal;
use railbus_store::outbox::EntryKind;
use std::collections::BTreeMap;

/// Numbers from a seed.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 33) % sides
    }
}

fn identity() -> SiteIdentity {
    SiteIdentity {
        site: "plant7".to_owned(),
        installation: [7; 16],
        boot: [8; 16],
        version: "1.0.0".to_owned(),
    }
}

fn entry(number: u64) -> OutboxEntry {
    OutboxEntry {
        at: i64::try_from(number).unwrap(),
        what: EntryKind::Reading {
            path: "oven.k1".to_owned(),
            value: Some(number.to_string()),
            quality: "good".to_owned(),
            reason: None,
            time: None,
        },
    }
}

/// The disk of a site: entries from one number on.
#[derive(Default)]
struct Disk {
    epoch: u64,
    entries: BTreeMap<u64, OutboxEntry>,
    newest: u64,
    delivered: u64,
}

impl Disk {
    fn epoch(&self) -> Arc<str> {
        format!("E{}", self.epoch).into()
    }

    fn append(&mut self, count: u64) {
        for _ in 0..count {
            self.newest += 1;
            self.entries.insert(self.newest, entry(self.newest));
        }
    }

    fn head(&self) -> OutboxHead {
        OutboxHead {
            epoch: self.epoch(),
            newest: self.newest,
            delivered: self.delivered,
        }
    }

    fn read(&self, after: u64) -> Option<(Arc<str>, Piece)> {
        let found = self.entries.range(after.max(self.delivered) + 1..);
        let found: Vec<_> = found.take(READ_MAX).collect();
        let piece = Piece {
            first: *found.first()?.0,
            entries: found.iter().map(|(_, entry)| (*entry).clone()).collect(),
            missing: None,
        };
        Some((self.epoch(), piece))
    }
}

/// A site with its disk, at one moment.
struct Site {
    uplink: Uplink,
    disk: Disk,
    now: Duration,
}

impl Site {
    fn new() -> Site {
        let mut site = Site {
            uplink: Uplink::new(identity()),
            disk: Disk::default(),
            now: Duration::from_secs(5),
        };
        site.stored();
        site
    }

    fn handle(&mut self, input: UplinkInput<'_>) {
        self.uplink.handle(self.now, input);
    }

    fn stored(&mut self) {
        let head = self.disk.head();
        self.handle(UplinkInput::Stored(head));
    }

    /// All that it does now, its disk served at once.
    fn outputs(&mut self) -> Vec<UplinkOutput> {
        let mut all = Vec::new();
        while let Some(output) = self.uplink.poll(self.now, 1_700_000_000_000) {
            match &output {
                UplinkOutput::Read(after) => {
                    let read = self.disk.read(*after);
                    self.handle(UplinkInput::Read(read));
                }
                UplinkOutput::FindState => {
                    let state = (self.disk.epoch(), self.disk.newest, vec![entry(1)]);
                    self.handle(UplinkInput::State(Some(state)));
                }
                _ => all.push(output),
            }
        }
        all
    }

    fn published(&mut self) -> Vec<UpMessage> {
        let of = |output| match output {
            UplinkOutput::Publish(message) => Some(message),
            _ => None,
        };
        self.outputs().into_iter().filter_map(of).collect()
    }

    fn answer(&mut self, number: u64, answer: &[u8]) {
        self.handle(UplinkInput::Answer(number, Some(answer)));
    }

    fn is_welcome(&mut self, number: u64) {
        let answer = Some(HelloAnswer::Session("s1".to_owned()));
        self.answer(number, &Welcome { answer }.encode_to_vec());
    }

    /// Connected and welcome; what it says first.
    fn begin(&mut self) -> Vec<UpMessage> {
        self.now += GATHER;
        self.handle(UplinkInput::Connected);
        let hello = self.published();
        assert_eq!(hello.len(), 1, "{hello:?}");
        assert_eq!(hello[0].subject, "rb.up.plant7.hello");
        self.is_welcome(hello[0].answer.unwrap());
        self.published()
    }
}

fn what(messages: &[UpMessage]) -> Vec<&str> {
    let last = |message: &'_ UpMessage| message.subject.len() - "rb.up.plant7.".len();
    messages
        .iter()
        .map(|message| &message.subject[message.subject.len() - last(message)..])
        .collect()
}

const TAKEN_IN: &[u8] = br#"{"stream":"DATA","seq":7}"#;

#[test]
fn without_a_session_nothing_is_said() {
    let mut site = Site::new();
    site.disk.append(5);
    site.stored();
    assert_eq!(site.outputs(), []);
    site.handle(UplinkInput::Connected);
    let hello = site.published();
    assert_eq!(what(&hello), ["hello"]);
    let said = Hello::decode(&*hello[0].payload).unwrap();
    assert_eq!((said.epoch.as_str(), said.newest), ("E0", 5));
    // Nobody is there.
    site.handle(UplinkInput::Answer(hello[0].answer.unwrap(), None));
    assert_eq!(
        site.outputs(),
        [UplinkOutput::Fails(UplinkFault::Away, AWAY)]
    );
    site.now = site.uplink.deadline().unwrap();
    let hello = site.published();
    assert_eq!(what(&hello), ["hello"]);
    // Nobody answers.
    site.now = site.uplink.deadline().unwrap();
    assert_eq!(
        site.outputs(),
        [UplinkOutput::Fails(UplinkFault::Away, AWAY)]
    );
    // Another has it. An answer that comes late says nothing.
    site.is_welcome(hello[0].answer.unwrap());
    assert_eq!(site.outputs(), []);
    site.now = site.uplink.deadline().unwrap();
    let hello = site.published();
    let refusal = FleetRefusal {
        code: "E0917".to_owned(),
        reason: "taken".to_owned(),
    };
    let answer = Some(HelloAnswer::Refusal(refusal));
    site.answer(
        hello[0].answer.unwrap(),
        &Welcome { answer }.encode_to_vec(),
    );
    let fault = UplinkFault::NoSession("E0917".to_owned(), "taken".to_owned());
    assert_eq!(site.outputs(), [UplinkOutput::Fails(fault, TAKEN)]);
    assert_eq!(site.uplink.deadline(), Some(site.now + TAKEN));
}

#[test]
fn with_a_session_it_says_that_it_is_there_how_all_is_and_what_changed() {
    let mut site = Site::new();
    site.disk.append(3);
    site.stored();
    let first = site.begin();
    assert_eq!(what(&first), ["beat", "state", "data"]);
    let beat = Beat::decode(&*first[0].payload).unwrap();
    assert_eq!(
        (beat.session.as_str(), beat.newest, beat.time_ms),
        ("s1", 3, 6_000)
    );
    let state = SiteState::decode(&*first[1].payload).unwrap();
    assert_eq!((state.seq, state.points.len()), (3, 1));
    let batch = DataBatch::decode(&*first[2].payload).unwrap();
    assert_eq!((batch.seq, batch.entries.len()), (1, 3));
    assert_eq!(first[2].id.as_deref(), Some("plant7-E0-1-3"));
    site.answer(first[2].answer.unwrap(), TAKEN_IN);
    let ends = site.outputs();
    assert_eq!(
        ends,
        [
            UplinkOutput::Delivered("E0".into(), 3, 3),
            UplinkOutput::Works
        ]
    );
    assert_eq!(site.uplink.behind(), 0);
    // A change waits a second for others; a beat comes every 10 s.
    site.disk.append(1);
    site.stored();
    assert_eq!(site.outputs(), []);
    assert_eq!(site.uplink.deadline(), Some(site.now + GATHER));
    site.now += GATHER;
    assert_eq!(what(&site.published()), ["data"]);
    site.now += BEAT - GATHER;
    assert_eq!(what(&site.published()), ["beat"]);
}

#[test]
fn a_session_that_the_centre_ends_is_asked_for_again() {
    let mut site = Site::new();
    site.begin();
    site.handle(UplinkInput::Ended("s0"));
    assert_eq!(site.outputs(), []);
    site.handle(UplinkInput::Ended("s1"));
    assert!(matches!(site.outputs()[..], [UplinkOutput::Fails(..)]));
    site.disk.append(1);
    site.stored();
    site.now += TAKEN - GATHER;
    assert_eq!(site.outputs(), []);
    site.now += GATHER;
    assert_eq!(what(&site.published()), ["hello"]);
}

#[test]
fn an_answer_that_is_no_session_gives_none() {
    let session = |name: &str| {
        let answer = Some(HelloAnswer::Session(name.to_owned()));
        Welcome { answer }.encode_to_vec()
    };
    for answer in [
        session(""),
        session("a.b"),
        session(">"),
        session(&"a".repeat(65)),
        Welcome { answer: None }.encode_to_vec(),
        b"\xFF\xFF".to_vec(),
    ] {
        let mut site = Site::new();
        site.handle(UplinkInput::Connected);
        let hello = site.published();
        site.answer(hello[0].answer.unwrap(), &answer);
        let fails = site.outputs();
        let is_none = matches!(
            fails[..],
            [UplinkOutput::Fails(UplinkFault::NoSession(..), _)]
        );
        assert!(is_none, "{fails:?}");
    }
}

#[test]
fn what_is_not_taken_in_is_sent_again_under_the_same_id() {
    let mut site = Site::new();
    site.disk.append(2);
    site.stored();
    let first = site.begin();
    for (answer, reason) in [
        (
            Some(&br#"{"error":{"description":"no space"}}"#[..]),
            "no space",
        ),
        (
            Some(&br#"{"stream":"EVENT","seq":1}"#[..]),
            "another stream answers",
        ),
        (None, "no stream takes it"),
    ] {
        let mut site = Site::new();
        site.disk.append(2);
        site.stored();
        let sent = site.begin();
        site.handle(UplinkInput::Answer(sent[2].answer.unwrap(), answer));
        let fault = UplinkFault::NotStored(reason.to_owned());
        assert_eq!(site.outputs(), [UplinkOutput::Fails(fault, AGAIN.0)]);
        site.now += AGAIN.0;
        let again = site.published();
        assert_eq!((what(&again), &again[0].id), (vec!["data"], &first[2].id));
        assert_eq!(again[0].payload, first[2].payload);
    }
}

#[test]
fn a_state_that_is_too_long_is_told_and_not_sent() {
    let mut site = Site::new();
    site.handle(UplinkInput::Connected);
    let hello = site.published();
    site.is_welcome(hello[0].answer.unwrap());
    let mut found = Vec::new();
    while let Some(output) = site.uplink.poll(site.now, 0) {
        if output == UplinkOutput::FindState {
            let points = vec![entry(1); 60_000];
            site.handle(UplinkInput::State(Some(("E0".into(), 1, points))));
        }
        found.push(output);
    }
    let is_told = |output: &UplinkOutput| {
        matches!(output, UplinkOutput::Fails(UplinkFault::StateTooLong(_), _))
    };
    assert_eq!(
        found.iter().filter(|output| is_told(output)).count(),
        1,
        "{found:?}"
    );
    let is_state = |output: &UplinkOutput| match output {
        UplinkOutput::Publish(message) => message.subject.ends_with("state"),
        _ => false,
    };
    assert!(!found.iter().any(is_state));
}

#[test]
fn no_message_is_longer_than_a_slow_line_takes() {
    let long = |number| OutboxEntry {
        what: EntryKind::Reading {
            path: "m".repeat(60),
            value: Some(format!("\"{}\"", "x".repeat(1_000))),
            quality: "bad".to_owned(),
            reason: Some("offline".to_owned()),
            time: Some(number),
        },
        ..entry(1)
    };
    let piece = |entries: Vec<OutboxEntry>| Piece {
        first: 5,
        entries,
        missing: None,
    };
    let (batch, last) = pack("E0", &piece((0..1_000).map(long).collect()));
    assert!(batch.encoded_len() <= BATCH_MAX, "{}", batch.encoded_len());
    assert_eq!(last, 4 + batch.entries.len() as u64);
    assert!(batch.entries.len() > 50);
    // One that is longer goes alone.
    let mut huge = long(0);
    if let EntryKind::Reading { value, .. } = &mut huge.what {
        *value = Some(format!("\"{}\"", "x".repeat(BATCH_MAX)));
    }
    let (batch, last) = pack("E0", &piece(vec![huge, long(1)]));
    assert_eq!((batch.entries.len(), last), (1, 5));
}

/// What the servers and the centre do, from a seed: answers that are lost, late, doubled and out
/// of order, connections that end, sessions that end, disks that begin anew.
fn play(seed: u64) {
    let mut dice = Dice(seed);
    let mut site = Site::new();
    // What the stream has: by epoch and number, and all ids.
    let mut stored: BTreeMap<(String, u64), i64> = BTreeMap::new();
    let mut appended: BTreeMap<(String, u64), i64> = BTreeMap::new();
    let mut ids: BTreeMap<String, Vec<u8>> = BTreeMap::new();
    let mut under_way: Vec<(Duration, u64, Option<Vec<u8>>)> = Vec::new();
    let (mut session, mut sessions, mut is_connected) = (None, 0, false);
    let until = Duration::from_secs(1_200);
    let mut is_calm = false;
    loop {
        if !is_calm && site.now > until {
            // Everything goes well from here on.
            is_calm = true;
            if !is_connected {
                is_connected = true;
                site.handle(UplinkInput::Connected);
            }
        }
        if is_calm && site.now > until + Duration::from_secs(700) {
            break;
        }
        for output in site.outputs() {
            match output {
                UplinkOutput::Publish(message) => {
                    assert!(is_connected, "{seed}: it is not connected");
                    let is_lost = !is_calm && dice.roll(8) == 0;
                    let kind = message.subject.rsplit('.').next().unwrap().to_owned();
                    let answer = match kind.as_str() {
                        "hello" => {
                            sessions += 1;
                            let name = format!("s{sessions}");
                            let answer = match !is_calm && dice.roll(4) == 0 {
                                true => HelloAnswer::Refusal(FleetRefusal::default()),
                                false => {
                                    session = Some(name.clone());
                                    HelloAnswer::Session(name)
                                }
                            };
                            let answer = Some(answer);
                            Some(Welcome { answer }.encode_to_vec())
                        }
                        "data" => {
                            let batch = DataBatch::decode(&*message.payload).unwrap();
                            let refuses = !is_calm && dice.roll(10) == 0;
                            if !is_lost && !refuses {
                                let id = message.id.clone().unwrap();
                                let first = ids.entry(id).or_insert_with(|| {
                                    for (entry, seq) in batch.entries.iter().zip(batch.seq..) {
                                        stored.insert((batch.epoch.clone(), seq), entry.at_ms);
                                    }
                                    message.payload.clone()
                                });
                                // A server keeps the first one only.
                                let kept = DataBatch::decode(&**first).unwrap();
                                assert_eq!(kept.seq, batch.seq, "{seed}");
                            }
                            Some(match refuses {
                                true => br#"{"error":{"description":"no leader"}}"#.to_vec(),
                                false => TAKEN_IN.to_vec(),
                            })
                        }
                        "beat" => {
                            let beat = Beat::decode(&*message.payload).unwrap();
                            assert!(beat.delivered <= beat.newest, "{seed}");
                            None
                        }
                        _ => None,
                    };
                    if let (Some(number), Some(answer), false) = (message.answer, answer, is_lost) {
                        let times = if !is_calm && dice.roll(10) == 0 { 2 } else { 1 };
                        for _ in 0..times {
                            let most = if is_calm { 50 } else { 15_000 };
                            let late = Duration::from_millis(dice.roll(most));
                            under_way.push((site.now + late, number, Some(answer.clone())));
                        }
                    }
                }
                UplinkOutput::Delivered(epoch, to, _) => {
                    assert_eq!(epoch, site.disk.epoch(), "{seed}");
                    assert!(to > site.disk.delivered, "{seed}: delivered twice");
                    for number in site.disk.delivered + 1..=to {
                        let key = (epoch.to_string(), number);
                        assert!(stored.contains_key(&key), "{seed}: {key:?} is nowhere");
                    }
                    site.disk.delivered = to;
                    site.disk.entries = site.disk.entries.split_off(&(to + 1));
                }
                _ => {}
            }
        }
        // What comes next: an answer, a deadline, or something that happens.
        under_way.sort_by_key(|(at, ..)| *at);
        let chance = site.now + Duration::from_millis(1 + dice.roll(20_000));
        let next = [
            under_way.first().map(|(at, ..)| *at),
            site.uplink.deadline(),
            Some(chance),
        ];
        let next = next.into_iter().flatten().min().unwrap();
        site.now = next.max(site.now);
        if under_way.first().is_some_and(|(at, ..)| *at <= site.now) {
            let (_, number, answer) = under_way.remove(0);
            if is_connected {
                site.handle(UplinkInput::Answer(number, answer.as_deref()));
            }
        } else if chance <= site.now {
            match dice.roll(20) {
                0 if !is_calm => {
                    is_connected = !is_connected;
                    site.handle(match is_connected {
                        true => UplinkInput::Connected,
                        false => UplinkInput::Lost,
                    });
                    under_way.clear();
                }
                1 if !is_calm => {
                    if let Some(session) = session.take() {
                        site.handle(UplinkInput::Ended(&session));
                    }
                }
                2 if !is_calm && dice.roll(5) == 0 => {
                    // The file was broken: what it had is lost, and said to be.
                    let keep = |(epoch, number): &(String, u64)| {
                        *epoch != *site.disk.epoch() || *number <= site.disk.delivered
                    };
                    appended.retain(|key, _| keep(key));
                    site.disk = Disk {
                        epoch: site.disk.epoch + 1,
                        ..Disk::default()
                    };
                    site.stored();
                }
                3 => {
                    // A restart: what is on the disk stays.
                    site.uplink = Uplink::new(identity());
                    site.stored();
                    under_way.clear();
                    if is_connected {
                        site.handle(UplinkInput::Connected);
                    }
                }
                _ => {
                    let count = match dice.roll(20) {
                        0 => 1_500,
                        _ => dice.roll(4),
                    };
                    let before = site.disk.newest;
                    site.disk.append(if is_calm { 0 } else { count });
                    for number in before + 1..=site.disk.newest {
                        let at = i64::try_from(number).unwrap();
                        appended.insert((site.disk.epoch().to_string(), number), at);
                    }
                    site.stored();
                }
            }
        }
    }
    assert_eq!(site.uplink.behind(), 0, "{seed}: something is left");
    for (key, at) in &appended {
        assert_eq!(stored.get(key), Some(at), "{seed}: {key:?}");
    }
}

#[test]
fn whatever_is_lost_late_doubled_or_reordered_all_arrives_and_nothing_is_said_to_that_did_not() {
    for seed in 0..60 {
        play(seed);
    }
}
