//! Orders to many sites: what can be one, and what is told of it.

use super::*;
use crate::hub::sites::tests::{CLOCK_S, NOW, three};
use prost::Message as _;
use railbus_fleet::bulk::{BulkInput, BulkOutput};
use railbus_fleet::centre::StoreEnd;
use railbus_fleet::ledger::CommandTold;
use railbus_fleet::message::{BulkKind, BulkRecord};
use serde_json::json;

const PATH: &str = "/api/v1/points/oven/k1";

fn given(sites: &[&str], path: &str, key: Option<&str>) -> Result<GivenBulk, Problem> {
    let wanted = GiveBulk {
        sites: sites.iter().map(ToString::to_string).collect(),
        method: "PUT".to_owned(),
        path: path.to_owned(),
        body: json!({ "value": true, "within_ms": 300 }),
    };
    GivenBulk::new(wanted, key, ("li", "zh"))
}

#[test]
fn only_commands_go_to_many_sites() {
    let code = |sites: &[&str], path, key| {
        let given = given(sites, path, key);
        given.err().map(|problem| problem.code)
    };
    assert_eq!(code(&["a", "b"], PATH, Some("k-1")), None);
    let wrong = Some("E0806".to_owned());
    for sites in [&[][..], &["a", "a"], &["a", "b.c"]] {
        assert_eq!(code(sites, PATH, None), wrong, "{sites:?}");
    }
    assert_eq!(code(&["a"], PATH, Some("a.b")), wrong);
    assert_eq!(code(&["a"], PATH, Some("preview")), wrong);
    let refused = Some("E0937".to_owned());
    for path in [
        "/api/v1/config",
        "/api/v1/points/oven/k1/lease",
        "/fleet/v1/sites",
    ] {
        assert_eq!(code(&["a"], path, None), refused, "{path}");
    }
    let given = given(&["a"], PATH, Some("k-1")).unwrap();
    assert_eq!((given.id.as_str(), given.is_again), ("k-1", true));
    let order = given.order;
    assert_eq!((order.user.as_str(), order.language.as_str()), ("li", "zh"));
    assert_eq!(order.body, br#"{"value":true,"within_ms":300}"#);
    // A request without a body has none.
    let none = GiveBulk {
        sites: vec!["a".to_owned()],
        method: "POST".to_owned(),
        path: format!("{PATH}/toggle"),
        ..GiveBulk::default()
    };
    let none = GivenBulk::new(none, None, ("li", "")).unwrap();
    assert_eq!(none.order.body, b"");
}

fn previewed(
    select: &[(&str, &str)],
    (method, path): (&str, &str),
) -> Result<PreviewWanted, Problem> {
    let select = select.iter();
    PreviewWanted::new(&PreviewBulk {
        select: select
            .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
            .collect(),
        method: method.to_owned(),
        path: path.to_owned(),
        body: json!({ "value": true }),
    })
}

#[test]
fn a_preview_says_where_it_would_go_and_what_is_in_its_way() {
    let centre = three();
    let told = |select: &[(&str, &str)], place| {
        let wanted = previewed(select, place).unwrap();
        let told = preview(&centre, &wanted, (NOW, CLOCK_S));
        let site = |one: FleetBulkTarget| {
            let output = one.point.map(|point| point.path);
            (one.site, output, one.code.unwrap_or_default())
        };
        (
            told.sendable,
            told.sites.into_iter().map(site).collect::<Vec<_>>(),
        )
    };
    let row = |site: &str, output: Option<&str>, code: &str| {
        (site.to_owned(), output.map(str::to_owned), code.to_owned())
    };
    let k2 = told(&[], ("PUT", "/api/v1/points/oven/k2"));
    let rows = vec![
        row("plant1", Some("oven.k2"), ""),
        row("plant2", None, "E0802"),
        row("store", None, "E0168"),
    ];
    assert_eq!(k2, (2, rows));
    let group = told(&[("search", "plant")], ("POST", "/api/v1/groups/night/set"));
    assert_eq!(group.1, [row("plant1", None, ""), row("plant2", None, "")]);
}

#[test]
fn a_misspelt_selection_is_not_all_sites() {
    let code = |select: &[(&str, &str)]| {
        previewed(select, ("PUT", PATH))
            .err()
            .map(|wrong| wrong.code)
    };
    assert_eq!(code(&[("group", "north"), ("state", "online")]), None);
    for select in [
        ("grop", "north"),
        ("limit", "3"),
        ("state", "on"),
        ("search", ""),
        ("search", " \t"),
        ("group", ""),
    ] {
        assert_eq!(code(&[select]), Some("E0806".to_owned()), "{select:?}");
    }
    let wrong = PreviewBulk {
        method: "PUT".to_owned(),
        path: "/api/v1/config".to_owned(),
        ..PreviewBulk::default()
    };
    assert_eq!(PreviewWanted::new(&wrong).err().unwrap().code, "E0937");
}

#[test]
fn an_order_is_told_with_its_sites() {
    let mut bulks = Bulks::default();
    bulks.handle(NOW, BulkInput::Connected);
    let order = given(&["a", "b", "c"], PATH, None).unwrap().order;
    bulks.handle(NOW, BulkInput::Given(1, "b1", order.clone()));
    let stored = bulks.poll(NOW);
    let Some(BulkOutput::Store {
        number, payload, ..
    }) = stored
    else {
        panic!("{stored:?}");
    };
    let record = Some(BulkKind::Order(order));
    assert_eq!(payload, BulkRecord { record }.encode_to_vec());
    let code = |bulks: &Bulks| bulk_sites(bulks, "b1", &BulkWanted::default()).err();
    // Nobody is told of one that is not recorded.
    assert_eq!(
        code(&bulks).map(|problem| problem.code),
        Some("E0837".to_owned())
    );
    bulks.handle(NOW, BulkInput::Stored("b1", number, StoreEnd::Stored(4)));
    while bulks.poll(NOW).is_some() {}
    bulks.handle(NOW, BulkInput::Told(("b", "b1"), CommandTold::Offline));
    let told = |query: &[(&str, &str)]| {
        let query = query
            .iter()
            .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
        let wanted = BulkWanted::of(&query.collect()).unwrap();
        let told = bulk_sites(&bulks, "b1", &wanted).unwrap();
        let sites = told.sites.into_iter();
        (told.total, sites.map(|one| one.site).collect::<Vec<_>>())
    };
    assert_eq!(told(&[]).1, ["a", "b", "c"]);
    assert_eq!(
        told(&[("state", "sent")]),
        (2, vec!["a".to_owned(), "c".to_owned()])
    );
    let one = told(&[("state", "sent"), ("offset", "1"), ("limit", "5")]);
    assert_eq!(one, (2, vec!["c".to_owned()]));
    assert_eq!(told(&[("state", "never")]).1, ["b"]);
    let [told] = &all(&bulks)[..] else {
        panic!("there is one");
    };
    let counts = told.counts;
    assert_eq!((counts.all, counts.sent, counts.never), (3, 2, 1));
    assert_eq!((told.user.as_str(), &told.ended_at), ("li", &None));
    let wrong = BTreeMap::from([("state".to_owned(), "gone".to_owned())]);
    assert_eq!(BulkWanted::of(&wrong).unwrap_err().code, "E0806");
}

#[test]
fn what_may_have_been_recorded_is_not_refused_with_certainty() {
    let refused = |told, is_again| {
        let problem = refused("b1", told, is_again).unwrap_err();
        (problem.code, problem.may_have_acted)
    };
    let of = |code: &str, perhaps| (code.to_owned(), perhaps);
    assert_eq!(refused(BulkTold::NotStored, false), of("E0164", false));
    assert_eq!(refused(BulkTold::NotStored, true), of("E0169", true));
    assert_eq!(refused(BulkTold::NotKnown, false), of("E0169", true));
    assert_eq!(refused(BulkTold::TooMany, true), of("E0169", true));
    assert_eq!(refused(BulkTold::TooMany, false), of("E0105", false));
    assert_eq!(refused(BulkTold::OtherOrder, true), of("E0806", false));
    assert_eq!(refused(BulkTold::NoSuch, true), of("E0837", false));
}
