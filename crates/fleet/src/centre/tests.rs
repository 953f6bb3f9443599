mod groups;
mod play;
mod points;
mod removal;

use super::*;
use crate::message::{DataEntry, DataKind, ReadingQuality, UplinkReading, UplinkValue};

/// A run of a program: installation and boot.
type Run = (u8, u8);

const FIRST: Run = (1, 1);
const RESTARTED: Run = (1, 2);
const OTHER: Run = (2, 9);

struct Hub {
    centre: Centre,
    now: Duration,
    number: u64,
    /// The latest lease and its revision.
    revision: u64,
    document: Vec<u8>,
}

impl Hub {
    /// One that has been listening for a while.
    fn new() -> Hub {
        let mut hub = Hub {
            centre: Centre::default(),
            now: Duration::from_secs(100),
            number: 0,
            revision: 0,
            document: Vec::new(),
        };
        hub.handle(CentreInput::Connected);
        hub.now += TAKEN;
        hub
    }

    fn handle(&mut self, input: CentreInput<'_>) {
        self.centre.handle(self.now, input);
    }

    fn outputs(&mut self) -> Vec<CentreOutput> {
        std::iter::from_fn(|| self.centre.poll()).collect()
    }

    /// It hears again, and has read the documents.
    fn connected(&mut self) {
        let document = self.document.clone();
        self.handle(CentreInput::Lease("p1", &document, self.revision));
        self.handle(CentreInput::Connected);
    }

    fn hello(&mut self, run: Run) -> Vec<CentreOutput> {
        self.number += 1;
        let mut hello = hello(run);
        hello.time_ms = u64::try_from(self.now.as_millis()).unwrap();
        let payload = hello.encode_to_vec();
        let session = format!("s{}", self.number);
        self.handle(CentreInput::Hello(self.number, "p1", &payload, session));
        self.outputs()
    }

    /// The session that a run gets, with what is done besides; or why it gets none.
    fn begins(&mut self, run: Run) -> Result<(String, Vec<CentreOutput>), String> {
        let asked = self.hello(run);
        if let [CentreOutput::Reply(_, answer)] = &asked[..] {
            return Err(refusal(answer));
        }
        let [
            CentreOutput::Store {
                number,
                after,
                payload,
                ..
            },
        ] = &asked[..]
        else {
            panic!("{asked:?}");
        };
        assert_eq!(*after, self.revision);
        self.revision += 1;
        self.document.clone_from(payload);
        let end = StoreEnd::Stored(self.revision);
        self.handle(CentreInput::Stored(*number, end));
        let mut outputs = self.outputs();
        let Some(CentreOutput::Reply(_, answer)) = outputs.pop() else {
            panic!("{outputs:?}");
        };
        match Welcome::decode(&*answer).unwrap().answer {
            Some(HelloAnswer::Session(session)) => Ok((session, outputs)),
            other => panic!("{other:?}"),
        }
    }

    fn says(&mut self, what: &str, message: &impl prost::Message) {
        let payload = message.encode_to_vec();
        self.handle(CentreInput::Said("p1", what, &payload));
    }

    fn beats(&mut self, session: &str, newest: u64) {
        let beat = beat(session, self.now, newest);
        self.says("beat", &beat);
    }

    /// The runs that were the site before.
    fn earlier(&self) -> Vec<u8> {
        let holder = self.centre.sites["p1"].holder.as_ref().unwrap();
        holder.lease.before.iter().map(|run| run.boot[0]).collect()
    }

    fn view(&self) -> SiteView<'_> {
        self.centre.site(self.now, "p1").unwrap()
    }

    /// Whether its points are known, and their numbers.
    fn knows(&self) -> (bool, Vec<(String, i64)>) {
        let view = self.view();
        let value = |point: &KnownPoint| match point.reading.value {
            Some(UplinkValue::Count(count)) => count,
            _ => -1,
        };
        let mut paths: Vec<&str> = view.paths.lines().collect();
        paths.sort_unstable();
        assert!(view.points.keys().eq(paths), "{}", view.paths);
        let points = view.points.iter().map(|(path, p)| (path.clone(), value(p)));
        (view.is_current, points.collect())
    }
}

fn hello((installation, boot): Run) -> Hello {
    Hello {
        installation: vec![installation; 16],
        boot: vec![boot; 16],
        epoch: "e".to_owned(),
        newest: 0,
        version: "1.2.3".to_owned(),
        clock_ms: 0,
        key_expires_s: Some(1_800_000_000),
        time_ms: 0,
    }
}

fn beat(session: &str, now: Duration, newest: u64) -> Beat {
    Beat {
        session: session.to_owned(),
        time_ms: u64::try_from(now.as_millis()).unwrap(),
        epoch: "e".to_owned(),
        newest,
        ..Beat::default()
    }
}

fn refusal(answer: &[u8]) -> String {
    match Welcome::decode(answer).unwrap().answer {
        Some(HelloAnswer::Refusal(refusal)) => {
            assert_eq!(refusal.code, "E0935");
            refusal.reason
        }
        other => panic!("{other:?}"),
    }
}

fn entry(path: &str, value: i64) -> DataEntry {
    DataEntry {
        at_ms: value,
        what: Some(DataKind::Reading(UplinkReading {
            path: path.to_owned(),
            value: Some(UplinkValue::Count(value)),
            quality: ReadingQuality::Good.into(),
            ..UplinkReading::default()
        })),
    }
}

fn state(session: &str, seq: u64, points: &[(&str, i64)]) -> SiteState {
    SiteState {
        session: session.to_owned(),
        epoch: "e".to_owned(),
        seq,
        points: points.iter().map(|(path, v)| entry(path, *v)).collect(),
    }
}

fn batch(session: &str, seq: u64, points: &[(&str, i64)]) -> DataBatch {
    DataBatch {
        session: session.to_owned(),
        epoch: "e".to_owned(),
        seq,
        dropped: None,
        entries: points.iter().map(|(path, v)| entry(path, *v)).collect(),
    }
}

fn named(points: &[(&str, i64)]) -> Vec<(String, i64)> {
    points.iter().map(|(p, v)| ((*p).to_owned(), *v)).collect()
}

#[test]
fn a_site_is_one_machine() {
    let mut hub = Hub::new();
    let (first, outputs) = hub.begins(FIRST).unwrap();
    assert_eq!(outputs, []);
    let view = hub.view();
    assert_eq!(
        (view.version, view.key_expires_s),
        ("1.2.3", Some(1_800_000_000))
    );
    hub.beats(&first, 0);
    let taken = "another machine reports as this site".to_owned();
    assert_eq!(hub.view().duplicate, None);
    assert_eq!(hub.begins(OTHER), Err(taken.clone()));
    assert_eq!(hub.view().duplicate, Some(Duration::ZERO));
    // The same run has lost its connection.
    let (second, outputs) = hub.begins(FIRST).unwrap();
    assert_eq!(outputs, []);
    assert_ne!(first, second);
    // A restart gets the session at once; the previous run is told, in case it still runs.
    hub.beats(&second, 0);
    let (third, outputs) = hub.begins(RESTARTED).unwrap();
    let end = CentreOutput::Request(format!("rb.down.p1.{second}.end"));
    assert_eq!(outputs, [end]);
    // If it does, it is a copy of the disk.
    hub.beats(&third, 0);
    assert_eq!(hub.begins(FIRST), Err(taken.clone()));
    // It is told again for each heartbeat in its old session, but not for any other session.
    hub.beats(&second, 0);
    let end = CentreOutput::Request(format!("rb.down.p1.{second}.end"));
    assert_eq!(hub.outputs(), [end]);
    hub.beats("other", 0);
    assert_eq!(hub.outputs(), []);
    // It gets the session once the other one is silent.
    hub.now += TAKEN - Duration::from_millis(1);
    assert_eq!(hub.begins(FIRST), Err(taken));
    hub.now += Duration::from_millis(1);
    assert!(hub.begins(FIRST).is_ok());
    assert_eq!(hub.earlier(), [2]);
    // However many runs there were, eight of them are remembered.
    for boot in 10..30 {
        hub.begins((1, boot)).unwrap();
    }
    assert_eq!(hub.earlier(), (21..29).collect::<Vec<_>>());
}

#[test]
fn a_centre_that_just_connected_does_not_guess_presence() {
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    let unknown = "whether another machine reports as this site is not known yet".to_owned();
    hub.handle(CentreInput::Lost);
    assert_eq!(hub.view().presence, SitePresence::Unknown);
    hub.now += TAKEN;
    assert_eq!(hub.begins(OTHER), Err(unknown.clone()));
    hub.connected();
    assert_eq!(hub.begins(OTHER), Err(unknown));
    assert_eq!(hub.view().presence, SitePresence::Unknown);
    assert_eq!(hub.view().duplicate, None);
    hub.now += ONLINE;
    assert_eq!(hub.view().presence, SitePresence::Unknown);
    hub.now += Duration::from_millis(1);
    assert_eq!(hub.view().presence, SitePresence::Offline);
    hub.now += TAKEN - ONLINE;
    assert!(hub.begins(OTHER).is_ok());
}

#[test]
fn of_two_centres_granting_a_session_one_succeeds() {
    let mut hub = Hub::new();
    let asked = hub.hello(FIRST);
    let CentreOutput::Store {
        number, payload, ..
    } = &asked[0]
    else {
        panic!("{asked:?}");
    };
    // A request in the meantime is dropped.
    assert_eq!(hub.hello(OTHER), [CentreOutput::Drop(2)]);
    // The other centre was first.
    let other = SessionLease {
        session: "other".to_owned(),
        boot: vec![9; 16],
        ..SessionLease::decode(&**payload).unwrap()
    };
    let other = other.encode_to_vec();
    hub.handle(CentreInput::Lease("p1", &other, 1));
    hub.handle(CentreInput::Stored(*number, StoreEnd::Unknown));
    assert_eq!(hub.outputs(), [CentreOutput::Drop(*number)]);
    hub.beats("other", 0);
    assert_eq!(hub.view().presence, SitePresence::Online);
    // An older document says nothing.
    hub.handle(CentreInput::Lease("p1", payload, 1));
    assert_eq!(hub.outputs(), []);
    hub.beats("s1", 0);
    hub.now += ONLINE + Duration::from_millis(1);
    hub.beats("s1", 0);
    assert_eq!(hub.view().presence, SitePresence::Offline);
    assert_eq!(hub.outputs(), [CentreOutput::ReadLease("p1".to_owned())]);
    hub.handle(CentreInput::LeaseRead("p1", None));
    assert_eq!(hub.outputs(), []);
    // A session that another one followed before it was told is not told.
    let asked = hub.hello((1, 9));
    assert!(
        matches!(asked[..], [CentreOutput::Store { after: 1, .. }]),
        "{asked:?}"
    );
    hub.handle(CentreInput::Lease("p1", payload, 3));
    hub.outputs();
    hub.handle(CentreInput::Stored(hub.number, StoreEnd::Stored(2)));
    assert_eq!(hub.outputs(), [CentreOutput::Drop(hub.number)]);
}

#[test]
fn after_a_conflict_the_latest_lease_is_read_and_the_request_decided_again() {
    for is_taken in [false, true] {
        let mut hub = Hub::new();
        let asked = hub.hello(FIRST);
        let CentreOutput::Store {
            number, payload, ..
        } = &asked[0]
        else {
            panic!("{asked:?}");
        };
        hub.handle(CentreInput::Stored(*number, StoreEnd::Conflict));
        assert_eq!(hub.outputs(), [CentreOutput::ReadLease("p1".to_owned())]);
        assert_eq!(hub.hello(FIRST), [CentreOutput::Drop(2)]);
        let mut other = SessionLease::decode(&**payload).unwrap();
        other.session = "other".to_owned();
        other.installation[0] += u8::from(is_taken);
        other.boot[0] += 1;
        let other = other.encode_to_vec();
        hub.handle(CentreInput::LeaseRead("p1", Some(Some((&other, 7)))));
        let again = hub.outputs();
        match &again[..] {
            [CentreOutput::Reply(1, answer)] if is_taken => {
                assert_eq!(refusal(answer), "another machine reports as this site");
                continue;
            }
            [
                CentreOutput::Store {
                    number: 1,
                    after: 7,
                    ..
                },
            ] if !is_taken => {}
            _ => panic!("{again:?}"),
        }
        // Once.
        hub.handle(CentreInput::Stored(1, StoreEnd::Conflict));
        assert_eq!(hub.outputs(), [CentreOutput::Drop(1)]);
    }
}

#[test]
fn a_machine_is_not_silent_before_it_could_say_anything() {
    let mut hub = Hub::new();
    let (first, _) = hub.begins(FIRST).unwrap();
    let taken = "another machine reports as this site".to_owned();
    assert_eq!(hub.begins(OTHER), Err(taken.clone()));
    assert_eq!(hub.view().presence, SitePresence::Unknown);
    hub.beats(&first, 0);
    assert_eq!(hub.view().presence, SitePresence::Online);
    hub.now += ONLINE;
    hub.begins(FIRST).unwrap();
    assert_eq!(hub.begins(OTHER), Err(taken));
    assert_eq!(hub.view().presence, SitePresence::Unknown);
    hub.now += ONLINE + Duration::from_millis(1);
    assert_eq!(hub.view().presence, SitePresence::Offline);
    hub.now += TAKEN - ONLINE;
    assert!(hub.begins(OTHER).is_ok());
}

#[test]
fn a_request_that_comes_after_a_later_one_of_the_same_run_is_none() {
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    let day = Duration::from_secs(86_400);
    let late = Hello {
        time_ms: 5,
        ..hello(FIRST)
    };
    let late = late.encode_to_vec();
    let asks = |hub: &mut Hub| {
        hub.handle(CentreInput::Hello(7, "p1", &late, "s".to_owned()));
        hub.outputs()
    };
    assert_eq!(asks(&mut hub), [CentreOutput::Drop(7)]);
    assert!(hub.begins(FIRST).is_ok());
    // A machine restored from a snapshot gets the session once the site is silent.
    hub.now += day;
    let asked = asks(&mut hub);
    assert!(
        matches!(asked[..], [CentreOutput::Store { .. }]),
        "{asked:?}"
    );
}

#[test]
fn a_machine_beside_the_one_that_has_the_session_is_told() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    let mut looks = 0;
    for _ in 0..5 {
        for other in ["copy1", "copy2"] {
            hub.beats(&session, 0);
            hub.beats(other, 0);
        }
        looks += hub.outputs().len();
        hub.now += Duration::from_secs(10);
    }
    assert_eq!(looks, 1);
    let document = hub.document.clone();
    hub.handle(CentreInput::LeaseRead("p1", Some(Some((&document, 1)))));
    let told = CentreOutput::Request("rb.down.p1.copy2.end".to_owned());
    assert_eq!(hub.outputs(), [told]);
    assert_eq!(hub.view().presence, SitePresence::Online);
}

#[test]
fn an_unknown_session_is_ended_unless_it_is_the_latest() {
    for is_last in [false, true] {
        let mut hub = Hub::new();
        hub.begins(FIRST).unwrap();
        let far = SessionLease {
            session: "far".to_owned(),
            ..SessionLease::decode(&*hub.document).unwrap()
        };
        let far = far.encode_to_vec();
        for nth in 0..5 {
            hub.beats("far", 0);
            // Its document may be on its way; and it is looked once at a time.
            let is_due = nth == 3;
            let look = is_due.then(|| CentreOutput::ReadLease("p1".to_owned()));
            assert_eq!(hub.outputs(), Vec::from_iter(look));
            hub.now += Duration::from_secs(10);
        }
        // Numbers of a stream that was made anew are lower.
        let found = match is_last {
            true => (&far, 1),
            false => (&hub.document.clone(), 1),
        };
        hub.handle(CentreInput::LeaseRead("p1", Some(Some((found.0, found.1)))));
        let told = CentreOutput::Request("rb.down.p1.far.end".to_owned());
        match is_last {
            true => assert_eq!(hub.outputs(), []),
            false => assert_eq!(hub.outputs(), [told]),
        }
        hub.beats("far", 0);
        let presence = hub.view().presence;
        assert_eq!(presence == SitePresence::Online, is_last, "{presence:?}");
        // What is no name of a session goes into no subject.
        for _ in 0..9 {
            hub.now += Duration::from_secs(10);
            hub.beats("far.>", 0);
            assert_eq!(hub.outputs(), []);
        }
    }
}

#[test]
fn a_lease_read_earlier_does_not_replace_a_newer_one() {
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    let document = hub.document.clone();
    for _ in 0..4 {
        hub.beats("far", 0);
        hub.now += Duration::from_secs(10);
    }
    assert_eq!(hub.outputs(), [CentreOutput::ReadLease("p1".to_owned())]);
    let (session, _) = hub.begins(RESTARTED).unwrap();
    hub.outputs();
    hub.handle(CentreInput::LeaseRead("p1", Some(Some((&document, 1)))));
    assert_eq!(hub.outputs(), []);
    hub.beats(&session, 0);
    assert_eq!(hub.view().presence, SitePresence::Online);
}

#[test]
fn after_a_connection_was_lost_the_documents_that_are_there_count() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.revision = 9;
    let document = hub.document.clone();
    hub.handle(CentreInput::Lease("p1", &document, 9));
    hub.beats(&session, 0);
    // What was to be done at that connection is not done at the next one.
    let asks = hello(OTHER).encode_to_vec();
    hub.handle(CentreInput::Hello(7, "p1", &asks, "s".to_owned()));
    hub.handle(CentreInput::Lost);
    assert_eq!(hub.outputs(), []);
    assert_eq!(hub.view().presence, SitePresence::Unknown);
    hub.revision = 3;
    hub.connected();
    assert_eq!(hub.view().heard, None);
    hub.beats(&session, 0);
    assert_eq!(hub.view().presence, SitePresence::Online);
    assert!(hub.begins(FIRST).is_ok());
    assert_eq!(hub.revision, 4);
}

#[test]
fn a_heartbeat_that_was_late_is_as_old_as_it_is() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    hub.beats(&session, 0);
    let said = beat(&session, hub.now + Duration::from_secs(10), 0);
    hub.now += Duration::from_secs(40);
    hub.says("beat", &said);
    let half_a_minute = Some(Duration::from_secs(30));
    let view = hub.view();
    assert_eq!(
        (view.heard, view.vouched),
        (Some(Duration::ZERO), half_a_minute)
    );
    assert!(view.is_current);
    hub.now += Duration::from_secs(6);
    let view = hub.view();
    let is_there = view.presence == SitePresence::Online;
    assert_eq!((is_there, view.is_current), (true, false));
    // One of before says nothing.
    let before = beat(&session, hub.now - Duration::from_secs(37), 0);
    hub.says("beat", &before);
    assert_eq!(hub.view().heard, Some(Duration::from_secs(6)));
    // A clock that is wrong makes nothing younger than it is.
    let ahead = Beat {
        time_ms: u64::MAX,
        ..said
    };
    hub.says("beat", &ahead);
    hub.now += Duration::from_secs(3);
    assert_eq!(hub.view().heard, Some(Duration::from_secs(3)));
}

#[test]
fn the_fastest_heartbeat_of_the_last_minutes_counts() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    let late = Duration::from_secs(5);
    // The first one is late as well, and is not known to be.
    for is_late in [true, false, true] {
        let sent = hub.now - if is_late { late } else { Duration::ZERO };
        hub.says("beat", &beat(&session, sent, 0));
        hub.now += Duration::from_secs(10);
    }
    assert_eq!(hub.view().vouched, Some(late + Duration::from_secs(10)));
    for _ in 0..30 {
        hub.beats(&session, 0);
        hub.now += Duration::from_secs(10);
    }
    hub.says("beat", &beat(&session, hub.now - late, 0));
    assert_eq!(hub.view().vouched, Some(late));
}

#[test]
fn a_heartbeat_behind_messages_that_wait_is_as_late_as_they_are() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    for (waits, is_current) in [(20, true), (40, false)] {
        let late = Beat {
            waits_ms: waits * 1_000,
            ..beat(&session, hub.now, 0)
        };
        hub.says("beat", &late);
        let view = hub.view();
        assert_eq!(view.vouched, Some(Duration::from_secs(waits)));
        assert_eq!(view.is_current, is_current);
        assert_eq!(view.presence, SitePresence::Online);
    }
}

#[test]
fn a_machine_that_slept_is_there_and_is_current_again_after_a_while() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    let slept = Duration::from_secs(70);
    let mut current = Vec::new();
    for nth in 0..100 {
        let its = hub.now - if nth > 9 { slept } else { Duration::ZERO };
        hub.says("beat", &beat(&session, its, 0));
        assert_eq!(hub.view().presence, SitePresence::Online);
        current.push(hub.view().is_current);
        assert!(hub.begins(OTHER).is_err());
        hub.now += if nth == 9 {
            slept
        } else {
            Duration::from_secs(10)
        };
    }
    let later = current.iter().rposition(|is_current| !is_current).unwrap();
    assert!((10..10 + 2 * 30).contains(&later), "{later}");
    assert!(current[..10].iter().all(|is_current| *is_current));
}

#[test]
fn what_is_no_message_is_counted_and_changes_nothing() {
    let mut hub = Hub::new();
    let short = Hello {
        boot: vec![1; 15],
        ..hello(FIRST)
    };
    let long = Hello {
        version: "1".repeat(HELLO_MAX),
        ..hello(FIRST)
    };
    for payload in [
        b"\xFF".to_vec(),
        short.encode_to_vec(),
        long.encode_to_vec(),
    ] {
        hub.handle(CentreInput::Hello(1, "p1", &payload, "s".to_owned()));
        assert_eq!(hub.outputs(), [CentreOutput::Drop(1)]);
    }
    let much = batch(&"s".repeat(BATCH_MAX), 1, &[]);
    hub.says("data", &much);
    for what in ["beat", "data", "state"] {
        hub.handle(CentreInput::Said("p1", what, b"\xFF"));
    }
    hub.handle(CentreInput::Lease("p1", b"\xFF", 1));
    assert_eq!(hub.centre.unreadable(), 8);
    hub.handle(CentreInput::Said("p1", "other", b"\xFF"));
    hub.handle(CentreInput::Lease("No Name", b"", 1));
    assert_eq!(hub.centre.unreadable(), 8);
    assert_eq!(hub.outputs(), []);
    assert_eq!(hub.centre.sites(hub.now).count(), 0);
}
