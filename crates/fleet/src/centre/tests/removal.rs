//! A site that is removed, and comes back.

use super::*;
use crate::centre::removal::RemovalEnd;

/// A name that no session gets.
const REMOVED: &str = "removed";

impl Hub {
    /// One with a site that is offline, and whose points are known; and its session.
    fn left() -> (Hub, String) {
        let mut hub = Hub::new();
        let (session, _) = hub.begins(FIRST).unwrap();
        hub.says("state", &state(&session, 5, &[("m.k1", 1), ("m.k2", 2)]));
        hub.beats(&session, 5);
        assert!(hub.begins(OTHER).is_err());
        hub.now += TAKEN;
        hub.outputs();
        (hub, session)
    }

    /// A process that knows what this one knows.
    fn other(&self) -> Hub {
        let mut other = Hub::new();
        other.now = self.now;
        other.number = 100;
        other.document.clone_from(&self.document);
        other.revision = self.revision;
        let document = self.document.clone();
        other.handle(CentreInput::Lease("p1", &document, self.revision));
        other.now += TAKEN;
        other
    }

    fn removes(&mut self) -> Vec<CentreOutput> {
        self.number += 1;
        let name = REMOVED.to_owned();
        self.handle(CentreInput::Remove(self.number, "p1", name));
        self.outputs()
    }

    /// How it ends that the site is removed, where that is decided at once.
    fn refuses(&mut self) -> RemovalEnd {
        match self.removes()[..] {
            [CentreOutput::RemovalEnded(number, end)] if number == self.number => end,
            ref other => panic!("{other:?}"),
        }
    }

    /// Begins to remove it: the request, and the document that is to be stored.
    fn begins_removal(&mut self) -> (u64, Vec<u8>) {
        match &self.removes()[..] {
            [
                CentreOutput::StoreRemoval {
                    number,
                    site,
                    subject,
                    payload,
                    after,
                },
            ] => {
                assert_eq!((&**site, &**subject), ("p1", "rb.fleet.lease.p1"));
                assert_eq!(*after, self.revision);
                (*number, payload.clone())
            }
            other => panic!("{other:?}"),
        }
    }

    /// Its document is stored.
    fn stores(&mut self, number: u64, document: &[u8]) -> Vec<CentreOutput> {
        self.revision += 1;
        self.document = document.to_vec();
        let end = StoreEnd::Stored(self.revision);
        self.handle(CentreInput::Stored(number, end));
        self.outputs()
    }

    fn is_gone(&self) -> bool {
        let is_listed = self.centre.sites(self.now).count() > 0;
        let is_there = self.centre.site(self.now, "p1").is_some();
        assert_eq!(is_listed, is_there);
        !is_there
    }
}

fn end_of(session: &str) -> CentreOutput {
    CentreOutput::Request(format!("rb.down.p1.{session}.end"))
}

#[test]
fn only_a_site_that_is_known_to_be_offline_is_removed() {
    let mut hub = Hub::new();
    assert_eq!(hub.refuses(), RemovalEnd::NoSite);
    let (session, _) = hub.begins(FIRST).unwrap();
    // It just got its session.
    assert_eq!(hub.refuses(), RemovalEnd::NotOffline);
    hub.beats(&session, 0);
    hub.now += ONLINE;
    assert_eq!(hub.refuses(), RemovalEnd::NotOffline);
    hub.now += Duration::from_millis(1);
    hub.handle(CentreInput::Lost);
    assert_eq!(hub.refuses(), RemovalEnd::NotOffline);
    hub.connected();
    hub.now += ONLINE;
    assert_eq!(hub.refuses(), RemovalEnd::NotOffline);
    hub.now += Duration::from_millis(1);
    // It asks for a session at this moment.
    let asked = hub.hello(FIRST);
    assert!(matches!(asked[..], [CentreOutput::Store { .. }]));
    assert_eq!(hub.refuses(), RemovalEnd::NotOffline);
    let asked = CentreInput::Stored(hub.number - 1, StoreEnd::Unknown);
    hub.handle(asked);
    hub.outputs();
    let (number, document) = hub.begins_removal();
    // Only once at a time.
    assert_eq!(hub.refuses(), RemovalEnd::Busy);
    let done = hub.stores(number, &document);
    assert_eq!(
        done,
        [
            end_of(&session),
            CentreOutput::RemovalEnded(number, RemovalEnd::Removed)
        ]
    );
    assert!(hub.is_gone());
    assert_eq!(hub.refuses(), RemovalEnd::NoSite);
}

#[test]
fn a_site_that_comes_back_is_a_new_one() {
    // The same run, a restart, and another machine.
    for run in [FIRST, RESTARTED, OTHER] {
        let (mut hub, first) = Hub::left();
        let mut other = hub.other();
        assert_eq!(hub.knows().1, named(&[("m.k1", 1), ("m.k2", 2)]));
        let (number, document) = hub.begins_removal();
        hub.stores(number, &document);
        other.handle(CentreInput::Lease("p1", &document, 2));
        assert_eq!(other.outputs(), [end_of(&first)]);
        other.revision = 2;
        for hub in [&mut hub, &mut other] {
            assert!(hub.is_gone());
            // What arrives of it late shows nothing, and is told that it has ended.
            hub.says("state", &state(&first, 6, &[("m.k1", 9)]));
            hub.says("data", &batch(&first, 7, &[("m.k1", 9)]));
            hub.beats(&first, 7);
            assert_eq!(hub.outputs(), [end_of(&first)]);
            assert!(hub.is_gone());
            // No other machine has to be silent first: there is none.
            let (session, outputs) = hub.begins(run).unwrap();
            assert_eq!(outputs, []);
            assert_eq!(hub.knows(), (false, named(&[])));
            assert_eq!((hub.view().vouched, hub.view().duplicate), (None, None));
            hub.beats(&session, 3);
            hub.says("state", &state(&first, 9, &[("m.k1", 9)]));
            assert_eq!(hub.knows(), (false, named(&[])));
            hub.says("state", &state(&session, 3, &[("m.k2", 3)]));
            hub.beats(&session, 3);
            assert_eq!(hub.knows(), (true, named(&[("m.k2", 3)])));
            let lease = SessionLease::decode(&*hub.document).unwrap();
            assert!(lease.before.iter().all(|run| run.session == first));
            assert_eq!(lease.before.len(), usize::from(run != FIRST));
        }
    }
}

#[test]
fn the_state_of_the_next_session_may_arrive_before_its_lease_and_only_that_one_counts() {
    for is_next in [true, false] {
        let (mut hub, first) = Hub::left();
        let said = if is_next { "next" } else { &first };
        hub.now += TAKEN;
        let next = SessionLease {
            session: "next".to_owned(),
            removed_ms: 0,
            ..SessionLease::decode(&*hub.document).unwrap()
        };
        let (_, document) = hub.begins_removal();
        if is_next {
            hub.says("state", &state(said, 1, &[("m.k1", 4)]));
        }
        hub.handle(CentreInput::Lease("p1", &document, 2));
        if !is_next {
            hub.says("state", &state(said, 9, &[("m.k1", 4)]));
        }
        hub.handle(CentreInput::Lease("p1", &next.encode_to_vec(), 3));
        let known = if is_next { &[("m.k1", 4)][..] } else { &[] };
        assert_eq!(hub.knows().1, named(known));
    }
}

#[test]
fn a_state_of_a_session_that_is_over_is_not_kept() {
    let (mut hub, first) = Hub::left();
    // A session of which this process did not hear.
    hub.says("state", &state("unheard", 9, &[("m.k1", 4)]));
    assert!(!hub.centre.sites["p1"].early_state.is_empty());
    let (_, document) = hub.begins_removal();
    let mut removal = SessionLease::decode(&*document).unwrap();
    removal.before.push(crate::message::EarlierRun {
        boot: vec![3; 16],
        session: "unheard".to_owned(),
    });
    hub.handle(CentreInput::Lease("p1", &removal.encode_to_vec(), 3));
    assert!(hub.centre.sites["p1"].early_state.is_empty());
    for session in [&first, "unheard"] {
        hub.says("state", &state(session, 9, &[("m.k1", 4)]));
        assert!(hub.centre.sites["p1"].early_state.is_empty());
    }
}

#[test]
fn of_a_removal_and_a_return_that_are_stored_at_once_the_first_one_counts() {
    for is_back_first in [false, true] {
        let (mut hub, first) = Hub::left();
        let mut other = hub.other();
        let (number, removal) = hub.begins_removal();
        let asked = other.hello(RESTARTED);
        let [
            CentreOutput::Store {
                number: wanted,
                payload,
                after: 1,
                ..
            },
        ] = &asked[..]
        else {
            panic!("{asked:?}");
        };
        let (loser, read) = match is_back_first {
            true => {
                other.stores(*wanted, payload);
                (&mut hub, payload)
            }
            false => {
                hub.stores(number, &removal);
                (&mut other, &removal)
            }
        };
        let lost = if is_back_first { number } else { *wanted };
        loser.handle(CentreInput::Stored(lost, StoreEnd::Conflict));
        let reads = CentreOutput::ReadLease("p1".to_owned());
        assert_eq!(loser.outputs(), [reads]);
        loser.handle(CentreInput::LeaseRead("p1", Some(Some((read, 2)))));
        loser.revision = 2;
        let outputs = loser.outputs();
        if is_back_first {
            let ended = CentreOutput::RemovalEnded(number, RemovalEnd::NotOffline);
            assert_eq!(outputs, [end_of(&first), ended]);
            assert!(!hub.is_gone() && !other.is_gone());
            // Its values are old ones of the same site.
            assert_eq!(hub.knows().1, named(&[("m.k1", 1), ("m.k2", 2)]));
            continue;
        }
        // The site is admitted, as a new one.
        let [
            ..,
            CentreOutput::Store {
                number,
                payload,
                after: 2,
                ..
            },
        ] = &outputs[..]
        else {
            panic!("{outputs:?}");
        };
        other.stores(*number, payload);
        hub.handle(CentreInput::Lease("p1", payload, 3));
        // The document of before that comes now says nothing.
        other.handle(CentreInput::Lease("p1", &removal, 2));
        for hub in [&hub, &other] {
            assert!(!hub.is_gone());
            assert_eq!(hub.knows(), (false, named(&[])));
        }
    }
}

#[test]
fn of_two_processes_that_remove_a_site_the_second_one_finds_none() {
    let (mut hub, _) = Hub::left();
    let mut other = hub.other();
    let (number, removal) = hub.begins_removal();
    let (second, _) = other.begins_removal();
    hub.stores(number, &removal);
    other.handle(CentreInput::Stored(second, StoreEnd::Conflict));
    other.outputs();
    let mut blind = Hub::left().0;
    let (third, _) = blind.begins_removal();
    blind.handle(CentreInput::Stored(third, StoreEnd::Conflict));
    blind.outputs();
    other.handle(CentreInput::LeaseRead("p1", Some(Some((&removal, 2)))));
    let ended = CentreOutput::RemovalEnded(second, RemovalEnd::NoSite);
    assert_eq!(other.outputs().last(), Some(&ended));
    assert!(other.is_gone());
    // What can't be read is not known to be there no longer.
    blind.handle(CentreInput::LeaseRead("p1", None));
    let ended = CentreOutput::RemovalEnded(third, RemovalEnd::Busy);
    assert_eq!(blind.outputs(), [ended]);
    assert!(!blind.is_gone());
    // Nor is a site back because what was stored first is not there yet.
    let mut early = Hub::left().0;
    let (fourth, _) = early.begins_removal();
    early.handle(CentreInput::Stored(fourth, StoreEnd::Conflict));
    early.outputs();
    let (known, revision) = (early.document.clone(), early.revision);
    let latest = Some(Some((&*known, revision)));
    early.handle(CentreInput::LeaseRead("p1", latest));
    let ended = CentreOutput::RemovalEnded(fourth, RemovalEnd::Busy);
    assert_eq!(early.outputs(), [ended]);
}

#[test]
fn a_lease_of_before_a_removal_brings_no_site_back() {
    let (mut hub, _) = Hub::left();
    let before = hub.document.clone();
    let (number, removal) = hub.begins_removal();
    // Whether it is stored is not known; it was.
    hub.handle(CentreInput::Stored(number, StoreEnd::Unknown));
    let ended = CentreOutput::RemovalEnded(number, RemovalEnd::Unknown);
    assert_eq!(hub.outputs(), [ended]);
    assert!(!hub.is_gone());
    hub.handle(CentreInput::Lease("p1", &removal, 2));
    hub.handle(CentreInput::Lease("p1", &before, 1));
    assert!(hub.is_gone());
    // After another connection the documents that are there count.
    hub.handle(CentreInput::Lost);
    hub.handle(CentreInput::Lease("p1", &removal, 2));
    hub.handle(CentreInput::Connected);
    assert!(hub.is_gone());
    hub.now += TAKEN;
    hub.revision = 2;
    assert!(hub.begins(FIRST).is_ok());
}

#[test]
fn a_removal_on_its_way_ends_with_the_connection() {
    let (mut hub, _) = Hub::left();
    let (number, _) = hub.begins_removal();
    hub.handle(CentreInput::Lost);
    hub.handle(CentreInput::Stored(number, StoreEnd::Stored(2)));
    assert_eq!(hub.outputs(), []);
    assert!(!hub.is_gone());
}

#[test]
fn sites_that_were_removed_leave_their_place_to_others() {
    let mut centre = Centre::default();
    let now = Duration::from_secs(1);
    // Nobody says anything of it, and it never was there.
    centre.handle(now, CentreInput::Document("nobody", &[], 1));
    let lease = |removed_ms| {
        let session = "s".to_owned();
        let lease = SessionLease {
            session,
            removed_ms,
            ..SessionLease::default()
        };
        lease.encode_to_vec()
    };
    for nth in 0..SITES_MAX {
        let document = lease(i64::from(nth % 1_000 == 7));
        centre.handle(now, CentreInput::Lease(&format!("p{nth}"), &document, 1));
    }
    let there = SITES_MAX - SITES_MAX / 1_000;
    assert_eq!(centre.sites(now).count(), there);
    for nth in 0..SITES_MAX / 1_000 + 5 {
        centre.handle(now, CentreInput::Lease(&format!("q{nth}"), &lease(0), 1));
    }
    assert_eq!(centre.sites(now).count(), SITES_MAX);
    assert_eq!(centre.sites.len(), SITES_MAX);
}
