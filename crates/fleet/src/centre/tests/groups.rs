//! What people say of sites.

use super::*;
use crate::message::SiteDocument;

fn names(groups: &[&str]) -> Vec<String> {
    groups.iter().map(|group| (*group).to_owned()).collect()
}

impl Hub {
    fn document(&mut self, groups: &[&str], revision: u64) {
        let document = site_document(&names(groups)).unwrap();
        self.handle(CentreInput::Document("p1", &document, revision));
    }

    fn groups(&self) -> Vec<String> {
        self.view().groups.to_vec()
    }

    /// It is removed, by another process.
    fn removed(&mut self, revision: u64) {
        let removal = SessionLease {
            session: "removed".to_owned(),
            removed_ms: 1,
            ..SessionLease::default()
        };
        self.document_of_lease(&removal, revision);
    }

    fn document_of_lease(&mut self, lease: &SessionLease, revision: u64) {
        self.document = lease.encode_to_vec();
        self.revision = revision;
        let document = self.document.clone();
        self.handle(CentreInput::Lease("p1", &document, revision));
        self.outputs();
    }
}

#[test]
fn a_site_is_in_the_groups_of_its_latest_document() {
    let mut hub = Hub::new();
    // Before it ever reported.
    hub.document(&["west", "north", "west"], 1);
    assert_eq!(hub.centre.sites(hub.now).count(), 0);
    assert!(hub.centre.site(hub.now, "p1").is_none());
    assert!(hub.centre.groups().is_empty());
    let named = hub.centre.named_site(hub.now, "p1").unwrap();
    assert_eq!(
        (named.groups, named.presence),
        (&*names(&["north", "west"]), SitePresence::Unknown)
    );
    hub.begins(FIRST).unwrap();
    assert_eq!(hub.groups(), ["north", "west"]);
    hub.document(&["south", "west"], 5);
    hub.document(&["north"], 4);
    assert_eq!(hub.groups(), ["south", "west"]);
    let counts: Vec<_> = hub.centre.groups().into_iter().collect();
    assert_eq!(counts, [("south", 1), ("west", 1)]);
    hub.document(&[], 6);
    assert!(hub.groups().is_empty());
    // Sessions change nothing of it.
    hub.document(&["east"], 7);
    hub.begins(RESTARTED).unwrap();
    assert_eq!(hub.groups(), ["east"]);
    hub.handle(CentreInput::Document("p1", b"\xFF", 9));
    assert_eq!(hub.centre.unreadable(), 1);
    hub.handle(CentreInput::Document("No Name", b"", 9));
    assert_eq!(hub.groups(), ["east"]);
}

#[test]
fn after_a_connection_was_lost_only_documents_that_are_there_count() {
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    hub.document(&["north"], 9);
    hub.handle(CentreInput::Lost);
    assert_eq!(hub.groups(), ["north"]);
    // Numbers of a stream that was made anew are lower.
    hub.document(&["south"], 3);
    hub.connected();
    assert_eq!(hub.groups(), ["south"]);
    hub.handle(CentreInput::Lost);
    hub.connected();
    assert!(hub.groups().is_empty());
}

#[test]
fn what_was_said_of_a_site_before_it_was_removed_does_not_count() {
    for is_before in [true, false] {
        let mut hub = Hub::new();
        hub.begins(FIRST).unwrap();
        hub.document(&["north"], 5);
        hub.removed(7);
        // One that comes late, and one that was stored since.
        hub.document(&["north"], 6);
        if !is_before {
            hub.document(&["south"], 8);
        }
        let kept: &[&str] = if is_before { &[] } else { &["south"] };
        hub.begins(FIRST).unwrap();
        assert_eq!(hub.groups(), kept);
    }
    // One that was stored since, and comes first.
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    hub.document(&["south"], 8);
    hub.removed(7);
    hub.begins(FIRST).unwrap();
    assert_eq!(hub.groups(), ["south"]);
    // Where it was not heard that it was removed.
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    hub.document(&["north"], 5);
    hub.handle(CentreInput::Lost);
    hub.removed(7);
    hub.document(&["south"], 8);
    hub.handle(CentreInput::Connected);
    hub.begins(FIRST).unwrap();
    assert_eq!(hub.groups(), ["south"]);
}

#[test]
fn groups_are_named_as_sites_are_and_are_not_many() {
    let many = |count: usize| {
        (0..count)
            .map(|nth| format!("g{nth:02}"))
            .collect::<Vec<_>>()
    };
    assert!(site_document(&many(GROUPS_MAX)).is_some());
    assert!(site_document(&many(GROUPS_MAX + 1)).is_none());
    for bad in ["", "North", "a b", "a.b", &"a".repeat(65)] {
        assert_eq!(site_document(&names(&[bad])), None, "{bad}");
    }
    // A document by others.
    let mut hub = Hub::new();
    hub.begins(FIRST).unwrap();
    let mut groups = many(GROUPS_MAX + 9);
    groups.push("A\u{1b}".to_owned());
    let document = SiteDocument { groups }.encode_to_vec();
    hub.handle(CentreInput::Document("p1", &document, 1));
    assert_eq!(hub.groups(), many(GROUPS_MAX));
}
