mod play;
mod truth;

use super::*;
use crate::message::{ApiAnswer, CommandEnd, CommandIntent, CommandResult};
use std::sync::Arc;

const S: fn(u64) -> Duration = Duration::from_secs;

fn order(sites: &[&str]) -> BulkOrder {
    BulkOrder {
        method: "PUT".to_owned(),
        path: "/api/v1/points/oven/k1".to_owned(),
        body: b"{\"value\":true}".to_vec(),
        user: "li".to_owned(),
        sites: sites.iter().map(ToString::to_string).collect(),
        token: vec![1],
        ..BulkOrder::default()
    }
}

/// The command of an order.
fn intent(order: &BulkOrder) -> CommandIntent {
    CommandIntent {
        method: order.method.clone(),
        path: order.path.clone(),
        body: order.body.clone(),
        user: order.user.clone(),
        is_bulk: true,
        ..CommandIntent::default()
    }
}

fn record(kind: CommandKind) -> Vec<u8> {
    let record = Some(kind);
    CommandRecord { record }.encode_to_vec()
}

fn answered(order: &BulkOrder) -> CommandEnd {
    CommandEnd {
        intent: Some(intent(order)),
        end: Some(CommandResult::Ended(ApiAnswer {
            status: 200,
            body: b"{\"value\":true,\"confirmed\":\"readback\"}".to_vec(),
            ..ApiAnswer::default()
        })),
        at_ms: 7,
    }
}

/// A process of the centre.
struct Hub(Bulks, Duration);

impl Hub {
    fn new() -> Hub {
        let mut hub = Hub(Bulks::default(), S(100));
        hub.handle(BulkInput::Connected);
        hub
    }

    fn handle(&mut self, input: BulkInput<'_>) {
        self.0.handle(self.1, input);
    }

    fn outputs(&mut self) -> Vec<BulkOutput> {
        std::iter::from_fn(|| self.0.poll(self.1)).collect()
    }

    /// The number, content and condition of the only thing that is to be stored.
    fn store(&mut self) -> (u64, Vec<u8>, u64) {
        let outputs = self.outputs();
        match &outputs[..] {
            [
                BulkOutput::Store {
                    number,
                    payload,
                    after,
                    id,
                },
            ] if id == "b1" => (*number, payload.clone(), *after),
            other => panic!("{other:?}"),
        }
    }

    /// An order is given and stored, as the first record of the stream.
    fn given(&mut self, order: &BulkOrder) -> Vec<BulkOutput> {
        self.handle(BulkInput::Given(1, "b1", order.clone()));
        let (number, _, after) = self.store();
        assert_eq!(after, 0);
        self.handle(BulkInput::Stored("b1", number, StoreEnd::Stored(5)));
        self.outputs()
    }

    fn told(&mut self, site: &str, told: CommandTold) {
        self.handle(BulkInput::Told((site, "b1"), told));
    }

    fn states(&self) -> Vec<(&str, BulkSiteState)> {
        let view = self.0.get("b1").expect("it is known");
        view.sites().map(|(name, state, _)| (name, state)).collect()
    }

    /// The code and the reason of a site.
    fn why(&self, site: &str) -> (String, String) {
        let view = self.0.get("b1").expect("it is known");
        let mut sites = view.sites();
        let (_, _, end) = sites.find(|(name, ..)| *name == site).expect("it is there");
        let end = end.expect("it has an end");
        (end.code.clone().unwrap_or_default(), end.reason.clone())
    }
}

fn begun(outputs: &[BulkOutput]) -> Vec<&str> {
    let mut sites = Vec::new();
    for output in outputs {
        if let BulkOutput::Begin { site, .. } = output {
            sites.push(site.as_str());
        }
    }
    sites
}

fn kind(payload: &[u8]) -> BulkKind {
    BulkRecord::decode(payload).unwrap().record.unwrap()
}

use BulkSiteState::{Done, Never, Sent, Unknown, Waiting};

#[test]
fn an_order_is_recorded_then_sent_then_its_end_is_recorded() {
    let mut hub = Hub::new();
    let order = order(&["a", "b", "c"]);
    let outputs = hub.given(&order);
    assert_eq!(outputs[0], BulkOutput::Tell(1, BulkTold::Known));
    assert_eq!(begun(&outputs), ["a", "b", "c"]);
    hub.handle(BulkInput::Command(
        ("a", "b1"),
        &record(CommandKind::Intent(intent(&order))),
    ));
    assert_eq!(hub.states(), [("a", Sent), ("b", Sent), ("c", Sent)]);
    hub.told("a", CommandTold::End(Arc::new(answered(&order))));
    hub.told("b", CommandTold::Offline);
    assert_eq!(hub.outputs(), []);
    hub.told("c", CommandTold::Waiting);
    let (number, payload, after) = hub.store();
    assert_eq!(after, 5);
    let BulkKind::End(end) = kind(&payload) else {
        panic!("no end");
    };
    let [unsent] = &end.unsent[..] else {
        panic!("{end:?}");
    };
    assert_eq!(unsent.sites, ["b"]);
    // The record of c, which the ledger stores.
    hub.handle(BulkInput::Command(
        ("c", "b1"),
        &record(CommandKind::Intent(intent(&order))),
    ));
    hub.handle(BulkInput::Stored("b1", number, StoreEnd::Stored(9)));
    assert_eq!(hub.states(), [("a", Done), ("b", Never), ("c", Sent)]);
    assert_eq!(hub.why("b").0, "E0168");
    // What comes of it later is known, too.
    hub.handle(BulkInput::Command(
        ("c", "b1"),
        &record(CommandKind::End(answered(&order))),
    ));
    assert_eq!(hub.states()[2], ("c", Done));
    assert_eq!((hub.outputs(), hub.0.deadline()), (Vec::new(), None));
}

#[test]
fn so_many_are_commanded_at_a_time() {
    let mut hub = Hub::new();
    let names: Vec<String> = (0..600).map(|at| format!("p{at:03}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let order = order(&names);
    let outputs = hub.given(&order);
    assert_eq!(begun(&outputs), &names[..256]);
    hub.told("p007", CommandTold::Waiting);
    hub.told("p007", CommandTold::Waiting);
    assert_eq!(begun(&hub.outputs()), ["p256"]);
    // Another order has its turn after it.
    let other = BulkOrder {
        sites: vec!["x".to_owned()],
        ..order
    };
    hub.handle(BulkInput::Given(2, "b2", other));
    let outputs = hub.outputs();
    let [BulkOutput::Store { number, .. }] = outputs[..] else {
        panic!("{outputs:?}");
    };
    hub.handle(BulkInput::Stored("b2", number, StoreEnd::Stored(6)));
    assert_eq!(begun(&hub.outputs()), Vec::<&str>::new());
    hub.told("p008", CommandTold::Waiting);
    assert_eq!(begun(&hub.outputs()), ["p257"]);
}

#[test]
fn what_was_not_begun_is_stopped() {
    let mut hub = Hub::new();
    let names: Vec<String> = (0..300).map(|at| format!("p{at:03}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    hub.given(&order(&names));
    hub.handle(BulkInput::Stop(4, "b2", "wu"));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(4, BulkTold::NoSuch)]);
    hub.handle(BulkInput::Stop(4, "b1", "wu"));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(4, BulkTold::Known)]);
    let states = hub.states();
    assert_eq!((states[255].1, states[256].1), (Sent, Never));
    assert_eq!(hub.why("p299").0, "E0185");
    for name in &names[..256] {
        hub.told(name, CommandTold::Waiting);
    }
    let (_, payload, _) = hub.store();
    let BulkKind::End(end) = kind(&payload) else {
        panic!("no end");
    };
    assert_eq!(
        (end.stopped_by.as_str(), end.unsent[0].sites.len()),
        ("wu", 44)
    );
}

#[test]
fn another_process_stops_it_too() {
    let mut hub = Hub::new();
    let order = order(&["a", "b"]);
    let payload = encoded(BulkKind::Order(order));
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    assert_eq!((hub.outputs(), hub.states()[0].1), (Vec::new(), Waiting));
    hub.handle(BulkInput::Stop(4, "b1", "wu"));
    let (number, payload, after) = hub.store();
    assert_eq!(
        (kind(&payload), after),
        (BulkKind::Stop("wu".to_owned()), 5)
    );
    // The one that carries it out says what was not sent.
    hub.handle(BulkInput::Stored("b1", number, StoreEnd::Stored(6)));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(4, BulkTold::Known)]);
    assert_eq!(hub.states()[0].1, Waiting);
    hub.handle(BulkInput::Record("b1", &payload, 6, Duration::ZERO));
    assert_eq!(hub.0.get("b1").unwrap().stopped_by, Some("wu"));
    hub.handle(BulkInput::Stop(5, "b1", "li"));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(5, BulkTold::Known)]);

    // And that one hears it.
    let mut owner = Hub::new();
    let names: Vec<String> = (0..300).map(|at| format!("p{at:03}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    owner.given(&self::order(&names));
    owner.handle(BulkInput::Record("b1", &payload, 6, Duration::ZERO));
    owner.told("p000", CommandTold::Waiting);
    assert_eq!(owner.outputs(), []);
    assert_eq!(owner.states()[299].1, Never);
}

#[test]
fn of_two_processes_one_carries_it_out() {
    let (mut hub, order) = (Hub::new(), order(&["a"]));
    let theirs = BulkOrder {
        token: vec![2],
        ..order.clone()
    };
    let heard = encoded(BulkKind::Order(theirs.clone()));
    let conflict = |hub: &mut Hub| {
        hub.handle(BulkInput::Given(1, "b1", order.clone()));
        hub.handle(BulkInput::Given(2, "b1", order.clone()));
        let (number, ..) = hub.store();
        number
    };
    // The other one's record comes after the refusal, or before it.
    let number = conflict(&mut hub);
    hub.handle(BulkInput::Stored("b1", number, StoreEnd::Conflict));
    assert_eq!(hub.outputs(), []);
    hub.handle(BulkInput::Record("b1", &heard, 5, Duration::ZERO));
    let known = |number| BulkOutput::Tell(number, BulkTold::Known);
    assert_eq!(hub.outputs(), [known(1), known(2)]);
    let mut other = Hub::new();
    let number = conflict(&mut other);
    other.handle(BulkInput::Record("b1", &heard, 5, Duration::ZERO));
    assert_eq!(other.outputs(), [known(1), known(2)]);
    other.handle(BulkInput::Stored("b1", number, StoreEnd::Conflict));
    assert_eq!(
        (other.outputs(), other.states()),
        (Vec::new(), vec![("a", Waiting)])
    );
    // Of another order it is not an answer, and of none there is one in time.
    let mut third = Hub::new();
    let number = conflict(&mut third);
    third.handle(BulkInput::Stored("b1", number, StoreEnd::Conflict));
    let another = BulkOrder {
        path: "/other".to_owned(),
        ..theirs
    };
    let another = encoded(BulkKind::Order(another));
    third.handle(BulkInput::Record("b1", &another, 5, Duration::ZERO));
    assert_eq!(
        third.outputs()[0],
        BulkOutput::Tell(1, BulkTold::OtherOrder)
    );
    let mut fourth = Hub::new();
    let number = conflict(&mut fourth);
    fourth.handle(BulkInput::Stored("b1", number, StoreEnd::Conflict));
    fourth.1 += S(5);
    assert_eq!(fourth.outputs()[0], BulkOutput::Tell(1, BulkTold::NotKnown));
    assert!(fourth.0.get("b1").is_none());
}

#[test]
fn what_could_not_be_recorded_is_not_sent() {
    let (mut hub, order) = (Hub::new(), order(&["a", "b"]));
    hub.handle(BulkInput::Given(1, "b1", order.clone()));
    let (number, payload, _) = hub.store();
    hub.handle(BulkInput::Stored("b1", number, StoreEnd::Unknown));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(1, BulkTold::NotStored)]);
    hub.handle(BulkInput::Given(2, "b1", order));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(2, BulkTold::NotKnown)]);
    // It was, after all.
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    let (_, payload, after) = hub.store();
    let BulkKind::End(end) = kind(&payload) else {
        panic!("no end");
    };
    assert_eq!(
        (after, &end.unsent[0].sites[..]),
        (5, &["a".to_owned(), "b".to_owned()][..])
    );
    assert_eq!(hub.states(), [("a", Never), ("b", Never)]);
}

#[test]
fn without_a_connection_nothing_more_begins() {
    let mut hub = Hub::new();
    let names: Vec<String> = (0..300).map(|at| format!("p{at:03}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let order = order(&names);
    hub.given(&order);
    for name in &names[..256] {
        let command = record(CommandKind::Intent(intent(&order)));
        hub.handle(BulkInput::Command((name, "b1"), &command));
    }
    hub.told("p000", CommandTold::Waiting);
    // Its turn came, but it was not given to the ledger yet.
    let begin = hub.0.poll(hub.1);
    assert_eq!(
        begin,
        Some(BulkOutput::Begin {
            id: "b1".to_owned(),
            site: "p256".to_owned()
        })
    );
    hub.told("p001", CommandTold::Waiting);
    hub.handle(BulkInput::Lost);
    hub.told("p256", CommandTold::NotStored);
    for name in &names[2..256] {
        hub.told(name, CommandTold::Waiting);
    }
    assert_eq!(hub.outputs(), []);
    assert_eq!(hub.why("p256").0, "E0164");
    assert_eq!(hub.why("p257").0, "E0185");
    assert_eq!((hub.states()[255].1, hub.states()[299].1), (Sent, Never));
    hub.handle(BulkInput::Connected);
    let (_, payload, _) = hub.store();
    assert!(matches!(kind(&payload), BulkKind::End(_)));
}

#[test]
fn of_a_process_that_is_gone_the_rest_is_not_sent() {
    let (mut hub, order) = (Hub::new(), order(&["a", "b"]));
    let payload = encoded(BulkKind::Order(order.clone()));
    hub.handle(BulkInput::Record("b1", &payload, 5, S(60)));
    let command = record(CommandKind::Intent(intent(&order)));
    hub.handle(BulkInput::Command(("a", "b1"), &command));
    hub.1 += S(299);
    assert_eq!((hub.outputs(), hub.states()[1].1), (Vec::new(), Waiting));
    // While it is cut off it can't tell.
    hub.handle(BulkInput::Lost);
    hub.1 += S(10);
    assert_eq!((hub.outputs(), hub.states()[1].1), (Vec::new(), Waiting));
    hub.handle(BulkInput::Connected);
    let (number, _, after) = hub.store();
    assert_eq!(after, 5);
    assert_eq!(hub.states(), [("a", Sent), ("b", Never)]);
    // Another process was first.
    hub.handle(BulkInput::Stored("b1", number, StoreEnd::Conflict));
    let end = encoded(BulkKind::End(BulkEnd {
        stopped_by: String::new(),
        at_ms: 3,
        unsent: vec![BulkUnsent {
            why: Some(over()),
            sites: vec!["b".to_owned()],
        }],
    }));
    hub.handle(BulkInput::Record("b1", &end, 8, Duration::ZERO));
    assert_eq!(hub.why("b").1, over().reason);
    hub.1 += S(60);
    assert_eq!(hub.outputs(), []);
    assert_eq!(hub.0.get("b1").unwrap().ended_ms, Some(3));
}

#[test]
fn after_its_time_no_site_is_commanded() {
    let mut hub = Hub::new();
    let names: Vec<String> = (0..300).map(|at| format!("p{at:03}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    hub.given(&order(&names));
    hub.1 += BEGIN_MAX;
    assert_eq!(hub.outputs(), []);
    hub.told("p000", CommandTold::Waiting);
    assert_eq!(hub.outputs(), []);
    assert_eq!(hub.why("p256").1, over().reason);
    assert_eq!(hub.states()[255].1, Sent);
}

#[test]
fn another_command_of_its_id_is_none_of_it() {
    let (mut hub, order) = (Hub::new(), order(&["a"]));
    hub.given(&order);
    let changes: [fn(&mut CommandIntent); 4] = [
        |one| one.method = "POST".to_owned(),
        |one| one.path = "/other".to_owned(),
        |one| one.body = b"{}".to_vec(),
        |one| one.user = "wu".to_owned(),
    ];
    for change in changes {
        let mut other = intent(&order);
        change(&mut other);
        let end = CommandEnd {
            intent: Some(other),
            ..answered(&order)
        };
        let end = record(CommandKind::End(end));
        hub.handle(BulkInput::Command(("a", "b1"), &end));
        assert_eq!(hub.states(), [("a", Sent)]);
    }
    hub.told("a", CommandTold::OtherCommand);
    assert_eq!(hub.states(), [("a", Never)]);
    assert_eq!(hub.why("a").0, "E0806");
    // The same one, given to this site alone, is carried out once for both.
    let mut hub = Hub::new();
    hub.given(&order);
    let single = CommandIntent {
        is_bulk: false,
        ..intent(&order)
    };
    let end = CommandEnd {
        intent: Some(single),
        ..answered(&order)
    };
    hub.told("a", CommandTold::End(Arc::new(end)));
    assert_eq!(hub.states(), [("a", Done)]);
    // An unknown result is reported as unknown, until a record arrives.
    let mut hub = Hub::new();
    hub.given(&order);
    hub.told("a", CommandTold::NotKnown);
    assert_eq!(hub.states(), [("a", Unknown)]);
    let end = record(CommandKind::End(answered(&order)));
    hub.handle(BulkInput::Command(("a", "b1"), &end));
    assert_eq!(hub.states(), [("a", Done)]);
}

#[test]
fn only_an_order_is_one() {
    let wrong = |sites: &[&str]| order(sites).check().err();
    assert_eq!(wrong(&["a", "b"]), None);
    assert_eq!(wrong(&[]), Some(BulkWrong::Count));
    assert_eq!(wrong(&["a", "B"]), Some(BulkWrong::Name));
    assert_eq!(wrong(&["a", "b", "a"]), Some(BulkWrong::Twice));
    let many = |count: usize, len: usize| {
        let names: Vec<String> = (0..count).map(|at| format!("{at:0len$}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        wrong(&names)
    };
    assert_eq!(many(BULK_SITES_MAX, 20), None);
    assert_eq!(many(BULK_SITES_MAX + 1, 20), Some(BulkWrong::Count));
    assert_eq!(many(BULK_SITES_MAX, 30), Some(BulkWrong::TooLong));
    let mut hub = Hub::new();
    let empty = encoded(BulkKind::Order(order(&[])));
    for payload in [
        &empty[..],
        b"\xff",
        &record(CommandKind::Intent(intent(&order(&["a"])))),
    ] {
        hub.handle(BulkInput::Record("b1", payload, 5, Duration::ZERO));
    }
    assert_eq!((hub.0.unreadable(), hub.0.iter().count()), (3, 0));
}

#[test]
fn the_newest_are_kept_and_so_many_go_on() {
    let mut hub = Hub::new();
    for number in 1..=u64::try_from(KEPT + 3).unwrap() {
        let payload = encoded(BulkKind::Order(order(&["a"])));
        let id = format!("b{number}");
        hub.handle(BulkInput::Record(&id, &payload, number, Duration::ZERO));
    }
    hub.outputs();
    let places: Vec<u64> = hub.0.iter().map(|view| view.place).collect();
    assert_eq!((places.len(), places[0]), (KEPT, 4));
    for number in 0..=u64::try_from(RUNNING_MAX).unwrap() {
        let id = format!("c{number}");
        hub.handle(BulkInput::Given(number, &id, order(&["a"])));
    }
    let last = hub.outputs().pop();
    let caller = u64::try_from(RUNNING_MAX).unwrap();
    let stored = hub.0.number;
    assert_eq!(last, Some(BulkOutput::Tell(caller, BulkTold::TooMany)));
    assert_eq!(stored, caller);
}
