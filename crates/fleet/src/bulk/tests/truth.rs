//! What is told of sites, of a stop, and of what could not be recorded.

use super::*;

/// What a site answered, as the state that is told of it.
#[test]
fn done_is_only_what_was_said_to_be() {
    let order = order(&["a"]);
    let state = |status, body: &str| {
        let mut hub = Hub::new();
        hub.given(&order);
        let answer = ApiAnswer {
            status,
            body: body.as_bytes().to_vec(),
            ..ApiAnswer::default()
        };
        let end = CommandEnd {
            end: Some(CommandResult::Ended(answer)),
            ..answered(&order)
        };
        let end = record(CommandKind::End(end));
        hub.handle(BulkInput::Command(("a", "b1"), &end));
        hub.states()[0].1
    };
    assert_eq!(state(200, "{\"confirmed\":\"readback\"}"), Done);
    assert_eq!(state(200, "{\"confirmed\":\"reply\"}"), Done);
    assert_eq!(
        state(200, "{\"confirmed\":\"sent\"}"),
        BulkSiteState::Unconfirmed
    );
    assert_eq!(state(504, "{\"code\":\"E0301\"}"), BulkSiteState::Failed);
    let some = "{\"results\":[{\"error\":{\"code\":\"E0301\"}}]}";
    assert_eq!(state(200, some), BulkSiteState::Failed);
}

/// What is recorded of a site counts more than that nothing is said to be sent to it.
#[test]
fn a_record_of_a_site_counts_more_than_a_list() {
    let order = order(&["a", "b", "c", "d"]);
    let mut hub = Hub::new();
    let payload = encoded(BulkKind::Order(order.clone()));
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    let sent = record(CommandKind::Intent(intent(&order)));
    let done = record(CommandKind::End(answered(&order)));
    hub.handle(BulkInput::Command(("a", "b1"), &sent));
    hub.handle(BulkInput::Command(("b", "b1"), &done));
    // A record that comes once more.
    hub.handle(BulkInput::Command(("b", "b1"), &sent));
    let end = BulkEnd {
        unsent: vec![BulkUnsent {
            why: Some(over()),
            sites: ["a", "b", "c", "x"].map(str::to_owned).to_vec(),
        }],
        stopped_by: "wu".to_owned(),
        at_ms: 3,
    };
    let payload = encoded(BulkKind::End(end));
    hub.handle(BulkInput::Record("b1", &payload, 9, Duration::ZERO));
    let states = [("a", Sent), ("b", Done), ("c", Never), ("d", Unknown)];
    assert_eq!(hub.states(), states);
    assert_eq!(hub.0.get("b1").unwrap().stopped_by, Some("wu"));
    // It was sent after all.
    hub.handle(BulkInput::Command(("c", "b1"), &sent));
    assert_eq!(hub.states()[2], ("c", Sent));
    hub.handle(BulkInput::Command(("d", "b1"), &done));
    assert_eq!(hub.states()[3], ("d", Done));
}

#[test]
fn what_was_sent_is_not_said_to_be_left_over() {
    let mut hub = Hub(Bulks::with(1), S(100));
    hub.handle(BulkInput::Connected);
    hub.given(&order(&["a", "b", "c"]));
    // It was sent, and its record was not heard yet.
    hub.told("a", CommandTold::Waiting);
    assert_eq!(begun(&hub.outputs()), ["b"]);
    assert_eq!(hub.states(), [("a", Sent), ("b", Sent), ("c", Waiting)]);
    hub.handle(BulkInput::Stop(4, "b1", "wu"));
    assert_eq!(hub.states(), [("a", Sent), ("b", Sent), ("c", Never)]);
    hub.told("b", CommandTold::Waiting);
    hub.outputs();
    hub.1 += BEGIN_MAX + S(1);
    hub.outputs();
    assert_eq!(hub.states(), [("a", Sent), ("b", Sent), ("c", Never)]);
    // The end of another process says less than this one's ledger will.
    let mut hub = Hub::new();
    hub.given(&order(&["a"]));
    let unsent = BulkUnsent {
        why: Some(gone()),
        sites: vec!["a".to_owned()],
    };
    let end = BulkEnd {
        unsent: vec![unsent],
        ..BulkEnd::default()
    };
    let payload = encoded(BulkKind::End(end));
    hub.handle(BulkInput::Record("b1", &payload, 9, Duration::ZERO));
    assert_eq!(hub.states(), [("a", Sent)]);
    hub.told("a", CommandTold::Waiting);
    assert_eq!(hub.states(), [("a", Sent)]);
}

#[test]
fn a_stop_counts_also_before_the_order_is_known_to_be_recorded() {
    let stop = encoded(BulkKind::Stop("wu".to_owned()));
    let order = order(&["a", "b"]);
    // At another process, which heard of it sooner; or here.
    for is_here in [false, true] {
        let mut hub = Hub::new();
        hub.handle(BulkInput::Given(1, "b1", order.clone()));
        let (number, payload, _) = hub.store();
        match is_here {
            true => hub.handle(BulkInput::Stop(2, "b1", "wu")),
            false => {
                hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
                hub.handle(BulkInput::Record("b1", &stop, 6, Duration::ZERO));
                assert!(hub.0.get("b1").is_none(), "not known to be recorded");
            }
        }
        hub.handle(BulkInput::Stored("b1", number, StoreEnd::Stored(5)));
        let outputs = hub.outputs();
        assert_eq!(begun(&outputs), Vec::<&str>::new());
        let told = |output: &&BulkOutput| matches!(output, BulkOutput::Tell(_, BulkTold::Known));
        assert_eq!(
            outputs.iter().filter(told).count(),
            1 + usize::from(is_here)
        );
        let Some(BulkOutput::Store { after, payload, .. }) = outputs.last() else {
            panic!("{outputs:?}");
        };
        assert_eq!(*after, if is_here { 5 } else { 6 });
        let BulkKind::End(end) = kind(payload) else {
            panic!("no end");
        };
        assert_eq!(
            (end.stopped_by.as_str(), end.unsent[0].sites.len()),
            ("wu", 2)
        );
        assert_eq!(hub.states(), [("a", Never), ("b", Never)]);
    }
}

#[test]
fn a_stop_that_is_not_known_to_be_recorded_is_not_said_to_be() {
    let payload = encoded(BulkKind::Order(order(&["a"])));
    let told = |end, heard: Option<BulkKind>| {
        let mut hub = Hub::new();
        hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
        hub.handle(BulkInput::Stop(4, "b1", "wu"));
        let (number, ..) = hub.store();
        hub.handle(BulkInput::Stop(5, "b1", "li"));
        assert_eq!(hub.outputs(), [BulkOutput::Tell(5, BulkTold::TooMany)]);
        if let Some(heard) = heard {
            let heard = encoded(heard);
            hub.handle(BulkInput::Record("b1", &heard, 6, Duration::ZERO));
        }
        hub.handle(BulkInput::Stored("b1", number, end));
        let outputs = hub.outputs();
        let [BulkOutput::Tell(4, told)] = outputs[..] else {
            panic!("{outputs:?}");
        };
        told
    };
    assert_eq!(told(StoreEnd::Stored(6), None), BulkTold::Known);
    assert_eq!(told(StoreEnd::Unknown, None), BulkTold::NotKnown);
    assert_eq!(told(StoreEnd::Conflict, None), BulkTold::NotKnown);
    let by_li = BulkKind::Stop("li".to_owned());
    assert_eq!(told(StoreEnd::Conflict, Some(by_li)), BulkTold::Known);
    let end = BulkKind::End(BulkEnd::default());
    assert_eq!(told(StoreEnd::Conflict, Some(end)), BulkTold::Known);
    // The connection is lost first.
    let mut hub = Hub::new();
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    hub.handle(BulkInput::Stop(4, "b1", "wu"));
    hub.handle(BulkInput::Lost);
    assert_eq!(hub.outputs(), [BulkOutput::Tell(4, BulkTold::NotKnown)]);
    hub.handle(BulkInput::Stop(4, "b1", "wu"));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(4, BulkTold::NotStored)]);
}

#[test]
fn a_stream_that_was_restored_has_other_numbers() {
    let order = order(&["a"]);
    let payload = encoded(BulkKind::Order(order.clone()));
    let mut hub = Hub::new();
    hub.handle(BulkInput::Record("b1", &payload, 50, Duration::ZERO));
    hub.handle(BulkInput::Lost);
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    hub.handle(BulkInput::Connected);
    hub.handle(BulkInput::Stop(4, "b1", "wu"));
    let (_, _, after) = hub.store();
    assert_eq!(after, 5);
    // Read again where nothing was lost, it changes nothing.
    let mut hub = Hub::new();
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    let stop = encoded(BulkKind::Stop("li".to_owned()));
    hub.handle(BulkInput::Record("b1", &stop, 6, Duration::ZERO));
    hub.handle(BulkInput::Record("b1", &payload, 5, Duration::ZERO));
    hub.1 += TAKEN_OVER;
    let (_, _, after) = hub.store();
    assert_eq!(after, 6);
}

#[test]
fn an_order_given_again_is_the_same_only_if_all_of_it_is() {
    let one = order(&["a"]);
    let mut hub = Hub::new();
    hub.given(&one);
    hub.outputs();
    let changes: [fn(&mut BulkOrder); 5] = [
        |one| one.method = "POST".to_owned(),
        |one| one.path = "/other".to_owned(),
        |one| one.body = b"{}".to_vec(),
        |one| one.user = "wu".to_owned(),
        |one| one.sites.push("b".to_owned()),
    ];
    for change in changes {
        let mut other = one.clone();
        change(&mut other);
        hub.handle(BulkInput::Given(2, "b1", other));
        assert_eq!(hub.outputs(), [BulkOutput::Tell(2, BulkTold::OtherOrder)]);
    }
    let again = BulkOrder {
        token: vec![9],
        at_ms: 9,
        language: "zh".to_owned(),
        ..one
    };
    hub.handle(BulkInput::Given(2, "b1", again));
    assert_eq!(hub.outputs(), [BulkOutput::Tell(2, BulkTold::Known)]);
}

#[test]
fn what_waits_is_bounded() {
    let one = order(&["a"]);
    let mut hub = Hub::new();
    let most = u64::try_from(CALLERS_MAX).unwrap();
    for caller in 0..=most {
        hub.handle(BulkInput::Given(caller, "b1", one.clone()));
    }
    let told = hub.outputs().pop();
    assert_eq!(told, Some(BulkOutput::Tell(most, BulkTold::TooMany)));
    // What can't be recorded does not keep others from it, but not without bound.
    let mut hub = Hub::new();
    let held = u64::try_from(HELD_MAX).unwrap();
    for caller in 0..=held {
        let id = format!("d{caller}");
        hub.handle(BulkInput::Given(caller, &id, one.clone()));
        let outputs = hub.outputs();
        let [BulkOutput::Store { number, .. }] = outputs[..] else {
            assert_eq!(caller, held);
            assert_eq!(outputs, [BulkOutput::Tell(caller, BulkTold::TooMany)]);
            break;
        };
        hub.handle(BulkInput::Stored(&id, number, StoreEnd::Unknown));
        hub.outputs();
    }
    hub.1 += DROPPED;
    hub.outputs();
    assert_eq!(hub.0.bulks.len(), 0);
    // While it is cut off, whether they were recorded can't be seen.
    hub.handle(BulkInput::Given(1, "e", one.clone()));
    let [BulkOutput::Store { number, .. }] = hub.outputs()[..] else {
        panic!("it is not stored");
    };
    hub.handle(BulkInput::Stored("e", number, StoreEnd::Unknown));
    hub.handle(BulkInput::Lost);
    hub.1 += S(2 * DROPPED.as_secs());
    hub.outputs();
    assert_eq!(hub.0.bulks.len(), 1);
    hub.handle(BulkInput::Connected);
    hub.outputs();
    assert_eq!(hub.0.bulks.len(), 0);
    // A stream with many of them is read.
    for number in 1..500 {
        let payload = encoded(BulkKind::Order(one.clone()));
        let id = format!("f{number}");
        hub.handle(BulkInput::Record(&id, &payload, number, Duration::ZERO));
        assert!(hub.0.bulks.len() <= KEPT);
    }
}

#[test]
fn an_end_that_can_not_be_stored_is_given_up() {
    let mut hub = Hub::new();
    hub.given(&order(&["a"]));
    hub.told("a", CommandTold::Offline);
    let mut stores = 0;
    while hub.0.get("b1").unwrap().ended_ms.is_none() {
        for output in hub.outputs() {
            if let BulkOutput::Store { number, .. } = output {
                stores += 1;
                hub.handle(BulkInput::Stored("b1", number, StoreEnd::Unknown));
            }
        }
        hub.1 += STORE_AGAIN;
    }
    assert_eq!(stores, STORES_MAX + 1);
    assert_eq!(hub.states(), [("a", Never)]);
}

#[test]
fn a_site_whose_turn_had_come_is_left_where_the_connection_is_lost() {
    let mut hub = Hub(Bulks::with(2), S(100));
    hub.handle(BulkInput::Connected);
    hub.given(&order(&["a", "b", "c", "d", "e"]));
    hub.told("a", CommandTold::Waiting);
    hub.told("b", CommandTold::Waiting);
    // One of two was given to the ledger.
    let first = hub.0.poll(hub.1);
    assert!(matches!(first, Some(BulkOutput::Begin { site, .. }) if site == "c"));
    hub.handle(BulkInput::Lost);
    let why = FleetRefusal {
        code: "E0836".to_owned(),
        reason: "none".to_owned(),
    };
    hub.handle(BulkInput::Refused(("c", "b1"), why));
    assert_eq!(hub.why("c"), ("E0836".to_owned(), "none".to_owned()));
    let code = |site| hub.why(site).0;
    assert_eq!(
        (code("d"), code("e")),
        ("E0185".to_owned(), "E0185".to_owned())
    );
    hub.handle(BulkInput::Connected);
    let (_, payload, _) = hub.store();
    let BulkKind::End(end) = kind(&payload) else {
        panic!("no end");
    };
    let sites: Vec<usize> = end.unsent.iter().map(|unsent| unsent.sites.len()).collect();
    assert_eq!(sites, [2, 1]);
}

/// Another order of this id is not stopped by that.
#[test]
fn a_stop_of_an_order_that_is_not_carried_out_here_is_not_confirmed() {
    let order = order(&["a"]);
    let theirs = BulkOrder {
        token: vec![2],
        ..order.clone()
    };
    let theirs = encoded(BulkKind::Order(theirs));
    let told = |end: Option<StoreEnd>| {
        let mut hub = Hub::new();
        hub.handle(BulkInput::Given(1, "b1", order.clone()));
        let (number, ..) = hub.store();
        hub.handle(BulkInput::Stop(2, "b1", "wu"));
        match end {
            Some(end) => hub.handle(BulkInput::Stored("b1", number, end)),
            None => hub.handle(BulkInput::Record("b1", &theirs, 5, Duration::ZERO)),
        }
        let outputs = hub.outputs();
        let of = |output: &BulkOutput| match output {
            BulkOutput::Tell(2, told) => Some(*told),
            _ => None,
        };
        (outputs.iter().find_map(of), hub)
    };
    for end in [None, Some(StoreEnd::Conflict), Some(StoreEnd::Unknown)] {
        assert_eq!(told(end).0, Some(BulkTold::NotKnown), "{end:?}");
    }
    let (_, hub) = told(None);
    assert_eq!(hub.0.get("b1").unwrap().stopped_by, None);
    let mut hub = Hub::new();
    hub.handle(BulkInput::Given(1, "b1", order));
    hub.store();
    hub.handle(BulkInput::Stop(2, "b1", "wu"));
    hub.handle(BulkInput::Lost);
    assert!(
        hub.outputs()
            .contains(&BulkOutput::Tell(2, BulkTold::NotKnown))
    );
}
