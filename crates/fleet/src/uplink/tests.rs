mod play;
mod renewal;

use super::transfer::{AGAIN, GATHER, pack};
use super::*;
use crate::message::{DataBatch, FleetRefusal};
use railbus_store::outbox::{DroppedEntries, EntryKind};
use std::collections::BTreeMap;

fn new_uplink() -> Uplink {
    uplink_of([7; 16], [8; 16])
}

pub(crate) fn uplink_of(installation: [u8; 16], boot: [u8; 16]) -> Uplink {
    let mut uplink = Uplink::new(SiteIdentity {
        installation,
        boot,
        version: "1.0.0".to_owned(),
    });
    uplink.set_claims(
        &renewal::claims(1_700_000_000, 1_800_000_000),
        "token".to_owned(),
    );
    uplink
}

/// The answer to a request for a session, of a centre with the clock of [`Site::outputs`].
fn welcome(answer: HelloAnswer) -> Vec<u8> {
    let (answer, clock_ms) = (Some(answer), 1_700_000_000_000);
    Welcome { answer, clock_ms }.encode_to_vec()
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
pub(crate) struct Disk {
    epoch: u64,
    entries: BTreeMap<u64, OutboxEntry>,
    pub(crate) newest: u64,
    pub(crate) delivered: u64,
    is_failing: bool,
    /// By so much the value of an entry is greater than its number.
    pub(crate) value_from: u64,
}

impl Disk {
    fn epoch(&self) -> Arc<str> {
        format!("E{}", self.epoch).into()
    }

    pub(crate) fn append(&mut self, count: u64) {
        for _ in 0..count {
            self.newest += 1;
            let value = self.value_from + self.newest;
            self.entries.insert(self.newest, entry(value));
        }
    }

    fn head(&self) -> OutboxHead {
        OutboxHead {
            epoch: self.epoch(),
            newest: self.newest,
            delivered: self.delivered,
            is_failing: self.is_failing,
        }
    }

    fn read(&self, after: u64) -> Option<(Arc<str>, Piece)> {
        let after = after.max(self.delivered);
        let mut piece = self.piece(after + 1, self.newest);
        let to = piece.entries.first()?.at;
        piece.missing = (piece.first > after + 1).then(|| DroppedEntries {
            count: piece.first - after - 1,
            from: None,
            to,
        });
        Some((self.epoch(), piece))
    }

    fn piece(&self, first: u64, last: u64) -> Piece {
        let found = self
            .entries
            .range(first..)
            .take_while(|(number, _)| **number <= last);
        let found: Vec<_> = found.take(READ_MAX).collect();
        Piece {
            first: found.first().map_or(0, |(number, _)| **number),
            entries: found.iter().map(|(_, entry)| (*entry).clone()).collect(),
            missing: None,
        }
    }
}

/// A site with its disk, at one moment.
pub(crate) struct Site {
    pub(crate) uplink: Uplink,
    pub(crate) disk: Disk,
    pub(crate) now: Duration,
}

impl Site {
    pub(crate) fn new() -> Site {
        let mut site = Site {
            uplink: new_uplink(),
            disk: Disk::default(),
            now: Duration::from_secs(5),
        };
        site.stored();
        site
    }

    pub(crate) fn handle(&mut self, input: UplinkInput<'_>) {
        self.uplink.handle(self.now, input);
    }

    pub(crate) fn stored(&mut self) {
        let head = self.disk.head();
        self.handle(UplinkInput::Stored(head));
    }

    /// All that it does now, its disk served at once.
    pub(crate) fn outputs(&mut self) -> Vec<UplinkOutput> {
        let mut all = Vec::new();
        while let Some(output) = self.uplink.poll(self.now, 1_700_000_000_000) {
            match &output {
                UplinkOutput::Read(after) => {
                    let read = self.disk.read(*after);
                    self.handle(UplinkInput::Read(read));
                }
                UplinkOutput::ReadAgain((first, last)) => {
                    let piece = self.disk.piece(*first, *last);
                    self.handle(UplinkInput::Read(Some((self.disk.epoch(), piece))));
                }
                UplinkOutput::FindState => {
                    let last = self.disk.entries.last_key_value();
                    let points = last.map(|(_, entry)| entry.clone()).into_iter().collect();
                    let state = (self.disk.epoch(), self.disk.newest, points);
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
        self.answer(number, &welcome(HelloAnswer::Session("s1".to_owned())));
    }

    /// Connected and welcome; what it says first.
    fn begin(&mut self) -> Vec<UpMessage> {
        self.now += GATHER;
        self.handle(UplinkInput::Connected(MESSAGE_MAX));
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
    site.handle(UplinkInput::Connected(MESSAGE_MAX));
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
    let answer = welcome(HelloAnswer::Refusal(refusal));
    site.answer(hello[0].answer.unwrap(), &answer);
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
    assert_eq!(first[2].id.as_deref(), Some("plant7-E0-1-3-0"));
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
    let ended = site.outputs();
    let is_so = matches!(ended[..], [UplinkOutput::Unlisten, UplinkOutput::Fails(..)]);
    assert!(is_so, "{ended:?}");
    site.disk.append(1);
    site.stored();
    site.now += TAKEN - GATHER;
    assert_eq!(site.outputs(), []);
    site.now += GATHER;
    assert_eq!(what(&site.published()), ["hello"]);
}

#[test]
fn an_answer_that_is_no_session_gives_none() {
    let session = |name: &str| welcome(HelloAnswer::Session(name.to_owned()));
    for answer in [
        session(""),
        session("a.b"),
        session(">"),
        session(&"a".repeat(65)),
        Vec::new(),
        b"\xFF\xFF".to_vec(),
    ] {
        let mut site = Site::new();
        site.handle(UplinkInput::Connected(MESSAGE_MAX));
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
fn what_was_read_for_an_earlier_session_is_not_sent_in_this_one() {
    let mut site = Site::new();
    site.begin();
    site.disk.append(3);
    site.stored();
    site.now += GATHER;
    assert_eq!(site.uplink.poll(site.now, 0), Some(UplinkOutput::Read(0)));
    let late = site.disk.read(0);
    site.handle(UplinkInput::Lost);
    site.begin();
    assert_eq!(site.uplink.poll(site.now, 0), None, "one read at a time");
    site.handle(UplinkInput::Read(late));
    let sent = site.published();
    assert_eq!(what(&sent), ["data"]);
    assert_eq!(sent[0].id.as_deref(), Some("plant7-E0-1-3-0"));
}

/// With all that is on the disk delivered.
fn all_delivered(count: u64) -> Site {
    let mut site = Site::new();
    site.disk.append(count);
    site.stored();
    let first = site.begin();
    site.answer(first[2].answer.unwrap(), TAKEN_IN);
    site.outputs();
    site.disk.delivered = count;
    site
}

#[test]
fn what_the_centre_misses_is_sent_again_under_another_id() {
    let mut site = all_delivered(9);
    assert_eq!(site.uplink.resend("E1", (1, 2)), Err(NoResend::Epoch));
    assert_eq!(site.uplink.resend("E0", (3, 5)), Ok(()));
    assert_eq!(site.uplink.resend("E0", (7, 7)), Err(NoResend::Busy));
    let again = site.published();
    assert_eq!(what(&again), ["data"]);
    let batch = DataBatch::decode(&*again[0].payload).unwrap();
    assert_eq!(
        (batch.seq, batch.entries.len(), batch.dropped),
        (3, 3, None)
    );
    assert_ne!(again[0].id.as_deref(), Some("plant7-E0-3-5-0"));
    // Nothing is delivered by it, and what is new does not wait for it.
    site.disk.append(1);
    site.stored();
    site.now += GATHER;
    assert_eq!(what(&site.published()), ["data"]);
    site.answer(again[0].answer.unwrap(), TAKEN_IN);
    assert_eq!(site.outputs(), []);
    // The same once more has another id.
    assert_eq!(site.uplink.resend("E0", (3, 5)), Ok(()));
    assert_ne!(site.published()[0].id, again[0].id);
    // What is not delivered comes anyway.
    assert_eq!(site.uplink.resend("E0", (10, 30)), Ok(()));
    assert_eq!(site.published(), []);
    assert_eq!(site.uplink.resend("E0", (0, u64::MAX)), Ok(()));
    let batch = DataBatch::decode(&*site.published()[0].payload).unwrap();
    assert_eq!((batch.seq, batch.entries.len()), (1, 9));
}

#[test]
fn what_is_there_no_longer_is_said_to_be_gone() {
    let mut site = all_delivered(9);
    site.disk.entries = site.disk.entries.split_off(&5);
    site.uplink.resend("E0", (2, 6)).unwrap();
    let batch = DataBatch::decode(&*site.published()[0].payload).unwrap();
    assert_eq!((batch.seq, batch.entries.len()), (5, 2));
    assert_eq!(
        batch.dropped.map(|gone| (gone.count, gone.to_ms)),
        Some((3, 5))
    );
    site.uplink.resend("E0", (2, 4)).unwrap();
    let batch = DataBatch::decode(&*site.published()[0].payload).unwrap();
    assert_eq!((batch.seq, batch.entries.len()), (5, 0));
    assert_eq!(batch.dropped.map(|gone| gone.count), Some(3));
}

#[test]
fn how_all_is_is_said_again_if_it_did_not_arrive() {
    let mut site = Site::new();
    let first = site.begin();
    assert_eq!(what(&first), ["beat", "state"]);
    let number = first[1].answer.unwrap();
    site.handle(UplinkInput::Answer(number, None));
    site.now += STATE_AGAIN;
    let again = site.published();
    assert!(what(&again).contains(&"state"), "{again:?}");
    let said = again
        .iter()
        .find(|message| message.subject.ends_with("state"));
    let number = said.unwrap().answer.unwrap();
    site.answer(number, br#"{"stream":"STATE","seq":1}"#);
    site.now += STATE - BEAT;
    assert!(!what(&site.published()).contains(&"state"));
    site.now += BEAT;
    assert!(what(&site.published()).contains(&"state"));
}

#[test]
fn a_state_that_is_too_long_is_told_and_not_sent() {
    let mut site = Site::new();
    site.handle(UplinkInput::Connected(MESSAGE_MAX));
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
    let sender = Sender {
        site: "plant7",
        boot: &[8; 16],
        session: "s1",
        most: BATCH_MAX,
        other_bytes: 0,
        number: 1,
        clock_ms: 0,
    };
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
    let (batch, last) = pack(&sender, "E0", &piece((0..1_000).map(long).collect()));
    assert!(batch.encoded_len() <= BATCH_MAX, "{}", batch.encoded_len());
    assert_eq!(last, 4 + batch.entries.len() as u64);
    assert!(batch.entries.len() > 50);
    // One that is longer goes alone.
    let mut huge = long(0);
    if let EntryKind::Reading { value, .. } = &mut huge.what {
        *value = Some(format!("\"{}\"", "x".repeat(BATCH_MAX)));
    }
    let (batch, last) = pack(&sender, "E0", &piece(vec![huge, long(1)]));
    assert_eq!((batch.entries.len(), last), (1, 5));
}

#[test]
fn an_answer_that_is_later_than_its_time_counts() {
    let mut site = Site::new();
    site.disk.append(3);
    site.stored();
    let first = site.begin();
    let late = first[2].answer.unwrap();
    site.now = site.uplink.deadline().unwrap();
    let mut fails = false;
    while !fails {
        fails = site
            .outputs()
            .iter()
            .any(|output| matches!(output, UplinkOutput::Fails(UplinkFault::NotStored(_), _)));
        site.now = site.uplink.deadline().unwrap().max(site.now);
    }
    site.answer(late, TAKEN_IN);
    let delivered = UplinkOutput::Delivered("E0".into(), 3, 3);
    assert!(site.outputs().contains(&delivered));
    assert_eq!(site.uplink.behind(), 0);
}

#[test]
fn while_the_disk_takes_nothing_it_does_not_say_that_it_is_there() {
    let mut site = Site::new();
    site.begin();
    let mut head = site.disk.head();
    head.is_failing = true;
    site.handle(UplinkInput::Stored(head));
    let fails = site.outputs();
    assert!(
        matches!(
            fails[..],
            [UplinkOutput::Fails(UplinkFault::NotRecorded, _)]
        ),
        "{fails:?}"
    );
    for _ in 0..10 {
        site.now += BEAT;
        assert!(!what(&site.published()).contains(&"beat"));
    }
    site.stored();
    assert!(what(&site.published()).contains(&"beat"));
}

#[test]
fn nothing_of_a_session_is_said_after_it() {
    let mut site = Site::new();
    site.begin();
    site.now += STATE_AGAIN;
    let find = std::iter::from_fn(|| site.uplink.poll(site.now, 0));
    let asked: Vec<_> = find.collect();
    assert!(asked.contains(&UplinkOutput::FindState), "{asked:?}");
    // It is made, and not sent yet.
    let state = Some((site.disk.epoch(), 0, vec![entry(1)]));
    site.handle(UplinkInput::State(state));
    site.handle(UplinkInput::Lost);
    site.handle(UplinkInput::Connected(MESSAGE_MAX));
    let next = site.outputs();
    let is_said = |output: &&UplinkOutput| matches!(output, UplinkOutput::Publish(_));
    let said: Vec<_> = next.iter().filter(is_said).collect();
    assert!(
        matches!(said[..], [UplinkOutput::Publish(hello)] if hello.subject.ends_with("hello")),
        "{next:?}"
    );
    assert!(next.contains(&UplinkOutput::Unlisten));
}

#[test]
fn what_a_late_answer_has_said_is_not_missed_nor_counted_twice() {
    let mut site = Site::new();
    site.disk.append(3);
    site.stored();
    let first = site.begin();
    let late = first[2].answer.unwrap();
    // Sent again, with one more.
    site.now += ANSWER_MAX + Duration::from_secs(1);
    site.outputs();
    site.disk.append(1);
    site.stored();
    site.now += AGAIN.0 + GATHER;
    let again = site.published();
    let again = again
        .iter()
        .find(|message| message.subject.ends_with("data"));
    let again = again.unwrap().answer.unwrap();
    let delivered = |outputs: Vec<UplinkOutput>| {
        let of = |output| match output {
            UplinkOutput::Delivered(_, to, count) => Some((to, count)),
            _ => None,
        };
        outputs.into_iter().filter_map(of).collect::<Vec<_>>()
    };
    site.answer(late, TAKEN_IN);
    assert_eq!(delivered(site.outputs()), [(3, 3)]);
    site.answer(again, TAKEN_IN);
    assert_eq!(delivered(site.outputs()), [(4, 1)]);
    // Nothing is missing afterwards.
    site.disk.delivered = 4;
    for _ in 0..6 {
        site.now += BEAT;
        let outputs = site.outputs();
        let is_fault = |output: &UplinkOutput| matches!(output, UplinkOutput::Fails(..));
        assert!(!outputs.iter().any(is_fault), "{outputs:?}");
    }
}

#[test]
fn while_the_disk_hangs_it_does_not_say_that_it_is_there_and_says_why() {
    let mut site = Site::new();
    site.begin();
    let faults = |outputs: &[UplinkOutput]| {
        let is_it = |output: &&UplinkOutput| {
            matches!(output, UplinkOutput::Fails(UplinkFault::NotRecorded, _))
        };
        outputs.iter().filter(is_it).count()
    };
    site.handle(UplinkInput::Stuck(true));
    assert_eq!(faults(&site.outputs()), 1);
    site.handle(UplinkInput::Stuck(true));
    site.now += BEAT;
    assert_eq!(site.outputs(), []);
    // Also where the connection was lost meanwhile: this is why nothing is said.
    site.handle(UplinkInput::Lost);
    site.handle(UplinkInput::Connected(MESSAGE_MAX));
    assert_eq!(faults(&site.outputs()), 1);
    site.handle(UplinkInput::Stuck(false));
    assert_eq!(what(&site.published()), ["hello"]);
}

#[test]
fn a_heartbeat_says_how_long_messages_wait_and_a_state_under_way_is_not_said_again() {
    let mut site = Site::new();
    site.disk.append(1);
    site.stored();
    let first = site.begin();
    assert_eq!(what(&first), ["beat", "state", "data"]);
    let waits = |message: &UpMessage| Beat::decode(&*message.payload).unwrap().waits_ms;
    assert_eq!(waits(&first[0]), 0);
    site.uplink.send_state();
    site.now += Duration::from_secs(6);
    site.answer(first[2].answer.unwrap(), TAKEN_IN);
    site.now += BEAT - Duration::from_secs(6);
    // The state is older than what was sent since.
    let next = site.published();
    assert_eq!(what(&next), ["beat"]);
    assert_eq!(waits(&next[0]), 10_000);
    let stored = br#"{"stream":"STATE","seq":1}"#;
    site.answer(first[1].answer.unwrap(), stored);
    site.disk.append(1);
    site.stored();
    site.now += GATHER;
    assert_eq!(what(&site.published()), ["data"]);
    site.uplink.send_state();
    assert_eq!(what(&site.published()), ["state"]);
    site.now += BEAT - GATHER;
    let next = site.published();
    assert_eq!(what(&next), ["beat"]);
    assert_eq!(waits(&next[0]), 9_000);
}

#[test]
fn the_answer_to_an_earlier_state_is_not_that_to_the_later_one() {
    let mut site = Site::new();
    let first = site.begin();
    assert_eq!(what(&first), ["beat", "state"]);
    let mut later = Vec::new();
    while later.is_empty() {
        site.now += BEAT;
        later = site.published();
        later.retain(|message| message.subject.ends_with("state"));
    }
    let stored = br#"{"stream":"STATE","seq":1}"#;
    site.answer(first[1].answer.unwrap(), stored);
    site.now += BEAT;
    let next = site.published();
    assert_eq!(what(&next), ["beat"]);
    let beat = Beat::decode(&*next[0].payload).unwrap();
    assert_eq!(beat.waits_ms, 10_000);
}
