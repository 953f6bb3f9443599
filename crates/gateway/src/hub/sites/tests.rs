//! Searching the sites.

use super::*;
use prost::Message as _;
use railbus_api::fleet::FleetAttention;
use railbus_fleet::centre::{CentreInput, site_document};
use railbus_fleet::message::{
    Beat, DataEntry, DataKind, ReadingQuality, SessionLease, SiteState, UplinkReading,
};
use std::time::Instant;

/// Long after the centre has connected.
pub(in crate::hub) const NOW: Duration = Duration::from_secs(1_000);
pub(in crate::hub) const CLOCK_S: i64 = 1_795_910_400;

/// Sites of this name and these points, each with or without a heartbeat just now.
fn fleet(sites: impl IntoIterator<Item = (String, bool, Vec<String>)>) -> Centre {
    let mut centre = Centre::default();
    centre.set_clock(CLOCK_S * 1_000);
    centre.handle(Duration::ZERO, CentreInput::Connected);
    for (revision, (name, is_online, paths)) in (1..).zip(sites) {
        let lease = SessionLease {
            session: "s".to_owned(),
            version: "0.1.0".to_owned(),
            ..SessionLease::default()
        };
        let entry = |path: String| DataEntry {
            at_ms: 0,
            what: Some(DataKind::Reading(UplinkReading {
                path,
                quality: ReadingQuality::Good.into(),
                ..UplinkReading::default()
            })),
        };
        let state = SiteState {
            session: "s".to_owned(),
            epoch: "e".to_owned(),
            seq: 1,
            points: paths.into_iter().map(entry).collect(),
        };
        let beat = Beat {
            session: "s".to_owned(),
            epoch: "e".to_owned(),
            newest: 1,
            clock_ms: CLOCK_S * 1_000,
            ..Beat::default()
        };
        let lease = lease.encode_to_vec();
        centre.handle(Duration::ZERO, CentreInput::Lease(&name, &lease, revision));
        let said = [
            ("state", state.encode_to_vec()),
            ("beat", beat.encode_to_vec()),
        ];
        for (what, payload) in said
            .into_iter()
            .filter(|(what, _)| *what == "state" || is_online)
        {
            centre.handle(NOW, CentreInput::Said(&name, what, &payload));
        }
    }
    centre
}

fn wanted(query: &[(&str, &str)]) -> Result<SitesWanted, Problem> {
    let asked = query
        .iter()
        .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
    SitesWanted::of(&asked.collect())
}

fn asked(centre: &Centre, query: &[(&str, &str)]) -> FleetSites {
    let wanted = wanted(query).unwrap();
    sites((centre, 0), &wanted, (NOW, CLOCK_S), None)
}

pub(in crate::hub) fn three() -> Centre {
    let own = |paths: &[&str]| paths.iter().map(|path| (*path).to_owned()).collect();
    fleet([
        ("plant1".to_owned(), true, own(&["oven.k1", "oven.k2"])),
        ("plant2".to_owned(), true, own(&["Hall.Temp", "oven.k1"])),
        ("store".to_owned(), false, own(&["hall.door"])),
    ])
}

#[test]
fn sites_are_found_by_words_and_by_state() {
    let centre = three();
    for (query, names) in [
        (&[][..], &["plant1", "plant2", "store"][..]),
        (&[("search", "")], &["plant1", "plant2", "store"]),
        (&[("search", "  OVEN  plant ")], &["plant1", "plant2"]),
        (&[("search", "hall.temp")], &["plant2"]),
        (&[("search", "hall")], &["plant2", "store"]),
        (&[("search", "oven.k2 0.1")], &["plant1"]),
        (&[("search", "nothing")], &[]),
        (&[("state", "online")], &["plant1", "plant2"]),
        (&[("state", "offline")], &["store"]),
        (&[("state", "unknown")], &[]),
        (&[("state", "attention")], &["store"]),
        (&[("state", "online"), ("search", "hall")], &["plant2"]),
    ] {
        let told = asked(&centre, query);
        let found: Vec<_> = told.sites.iter().map(|site| site.site.as_str()).collect();
        assert_eq!(found, names, "{query:?}");
        assert_eq!(told.total, names.len(), "{query:?}");
        let counts = FleetCounts {
            all: 3,
            online: 2,
            offline: 1,
            unknown: 0,
            attention: 1,
        };
        assert_eq!(told.counts, counts, "of all sites, whatever is wanted");
    }
    let told = asked(&centre, &[]);
    let why: Vec<_> = told
        .sites
        .iter()
        .map(|site| site.attention.clone())
        .collect();
    assert_eq!(why, [vec![], vec![], vec![FleetAttention::Offline]]);
    let json = serde_json::to_value(&told.sites).unwrap();
    assert_eq!(json[0].get("attention"), None);
    assert_eq!(json[2]["attention"], serde_json::json!(["offline"]));
}

#[test]
fn a_part_of_them_is_listed_and_all_are_counted() {
    let centre = three();
    for (query, names) in [
        (&[("limit", "0")][..], &[][..]),
        (&[("limit", "2")], &["plant1", "plant2"]),
        (&[("limit", "2"), ("offset", "2")], &["store"]),
        (&[("offset", "1")], &["plant2", "store"]),
        (&[("offset", "9"), ("limit", "9")], &[]),
        (
            &[("limit", "18446744073709551615"), ("offset", "1")],
            &["plant2", "store"],
        ),
    ] {
        let told = asked(&centre, query);
        let found: Vec<_> = told.sites.iter().map(|site| site.site.as_str()).collect();
        assert_eq!((found.as_slice(), told.total), (names, 3), "{query:?}");
    }
    let told = asked(
        &centre,
        &[("search", "plant"), ("limit", "1"), ("offset", "1")],
    );
    assert_eq!((told.sites[0].site.as_str(), told.total), ("plant2", 2));
}

#[test]
fn what_can_t_be_read_is_refused() {
    let long = "a".repeat(SEARCH_MAX + 1);
    for query in [
        ("state", "away"),
        ("state", ""),
        ("limit", "-1"),
        ("limit", "many"),
        ("offset", ""),
        ("search", "a b c d e f g h i"),
        ("search", &long),
    ] {
        assert_eq!(wanted(&[query]).unwrap_err().code, "E0806", "{query:?}");
    }
    assert!(wanted(&[("search", &long[1..]), ("later", "x")]).is_ok());
}

/// Prints how long searches take, with `--nocapture`. Of a large fleet:
/// `RAILBUS_SITES=10000 cargo test --release -p railbus-gateway --lib large_fleet`.
#[test]
#[expect(clippy::print_stdout, reason = "for whoever measures")]
fn a_large_fleet_is_searched() {
    let count = std::env::var("RAILBUS_SITES").ok();
    let count: usize = count.and_then(|count| count.parse().ok()).unwrap_or(200);
    let site = |number: usize| {
        let point = |label: usize| format!("module{}.value{label}", label % 5);
        let is_online = !number.is_multiple_of(10);
        let paths = (0..50).map(point).collect();
        (format!("plant{number}"), is_online, paths)
    };
    let centre = fleet((0..count).map(site));
    for (query, total) in [
        (&[("limit", "0")][..], count),
        (&[("limit", "100")], count),
        (&[("search", "module4.value49 nothing")], 0),
        (
            &[("search", "module4.value49 plant"), ("limit", "100")],
            count,
        ),
        (&[("search", "a e o u l m n t"), ("limit", "100")], count),
        (
            &[("search", "value"), ("state", "offline")],
            count.div_ceil(10),
        ),
        (&[], count),
    ] {
        let begun = Instant::now();
        let told = asked(&centre, query);
        println!("{:?}: {query:?}", begun.elapsed());
        assert_eq!(told.total, total, "{query:?}");
    }
}

#[test]
fn sites_are_listed_by_their_groups() {
    let mut centre = three();
    for (revision, (site, groups)) in (10..).zip([
        ("plant1", &["north", "pumps"][..]),
        ("plant2", &["north"]),
        // One that never reported.
        ("plant9", &["north", "west"]),
    ]) {
        let groups: Vec<_> = groups.iter().map(|group| (*group).to_owned()).collect();
        let document = site_document(&groups).unwrap();
        centre.handle(NOW, CentreInput::Document(site, &document, revision));
    }
    let names = |query: &[(&str, &str)]| {
        let told = asked(&centre, query);
        assert_eq!(told.counts.all, 3);
        let groups: Vec<_> = told.groups.iter().map(|g| (&*g.group, g.sites)).collect();
        assert_eq!(groups, [("north", 2), ("pumps", 1)]);
        let names = told.sites.into_iter().map(|site| site.site);
        names.collect::<Vec<_>>()
    };
    assert_eq!(names(&[("group", "north")]), ["plant1", "plant2"]);
    assert_eq!(names(&[("group", "nor")]), [""; 0]);
    assert_eq!(names(&[("group", "west")]), [""; 0]);
    assert_eq!(names(&[("search", "nor oven.k2")]), ["plant1"]);
    assert_eq!(names(&[("group", "north"), ("search", "hall")]), ["plant2"]);
    assert_eq!(asked(&centre, &[]).sites[0].groups, ["north", "pumps"]);
    let none = serde_json::to_value(asked(&three(), &[])).unwrap();
    assert_eq!(
        (none.get("groups"), none["sites"][0].get("groups")),
        (None, None)
    );
}
