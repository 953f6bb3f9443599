//! What is known of points.

use super::*;
use crate::centre::known::POINTS_MAX;

#[test]
fn points_are_known_where_all_is_there_that_a_heartbeat_vouches_for() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    let s = &session;
    hub.beats(s, 7);
    assert_eq!(hub.knows(), (false, vec![]));
    assert_eq!(hub.view().vouched, None);
    // Without the state, entries have nothing that they could be added to.
    hub.says("data", &batch(s, 7, &[("a", 7)]));
    assert_eq!(hub.knows(), (false, vec![]));
    hub.says("state", &state(s, 6, &[("a", 3), ("b", 6)]));
    assert_eq!(hub.knows(), (false, named(&[("a", 3), ("b", 6)])));
    hub.says("data", &batch(s, 7, &[("a", 7)]));
    assert_eq!(hub.knows(), (true, named(&[("a", 7), ("b", 6)])));
    assert_eq!(hub.view().vouched, Some(Duration::ZERO));
    // What comes behind a gap is shown, and is not all.
    hub.says("data", &batch(s, 9, &[("a", 9)]));
    hub.now += Duration::from_secs(1);
    hub.beats(s, 9);
    assert_eq!(hub.knows(), (false, named(&[("a", 9), ("b", 6)])));
    assert_eq!(hub.view().vouched, Some(Duration::from_secs(1)));
    // An entry that comes late does not replace a later one.
    hub.says("data", &batch(s, 8, &[("a", 8)]));
    assert_eq!(hub.knows(), (true, named(&[("a", 9), ("b", 6)])));
    assert_eq!(hub.view().vouched, Some(Duration::ZERO));
    // Nor does an older state, nor brings what came before it back what it has no more.
    hub.says("state", &state(s, 8, &[("b", 6)]));
    assert_eq!(hub.knows(), (true, named(&[("a", 9), ("b", 6)])));
    hub.says("state", &state(s, 10, &[("b", 6)]));
    hub.says("data", &batch(s, 8, &[("a", 8), ("a", 9), ("b", 10)]));
    assert_eq!(hub.knows(), (true, named(&[("b", 6)])));
    // Of a point that came after the state, the state says nothing.
    hub.says("data", &batch(s, 12, &[("c", 12)]));
    hub.says("state", &state(s, 11, &[("b", 11)]));
    assert_eq!(hub.knows(), (true, named(&[("b", 11), ("c", 12)])));
    hub.beats(s, 12);
    assert_eq!(hub.knows(), (true, named(&[("b", 11), ("c", 12)])));
    // Heartbeats end.
    hub.now += ONLINE;
    assert!(hub.knows().0);
    assert_eq!(hub.view().behind, Some(12));
    hub.now += Duration::from_millis(1);
    assert_eq!(hub.view().behind, None);
    assert_eq!(hub.knows(), (false, named(&[("b", 11), ("c", 12)])));
}

#[test]
fn what_is_said_in_another_session_or_of_other_numbers_counts_for_nothing() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    let s = &session;
    hub.beats(s, 1);
    hub.says("state", &state(s, 1, &[("a", 1)]));
    assert_eq!(hub.knows(), (true, named(&[("a", 1)])));
    hub.says("state", &state("other", 5, &[("a", 5)]));
    hub.says("data", &batch("other", 2, &[("a", 2)]));
    hub.beats("other", 5);
    assert_eq!(hub.knows(), (true, named(&[("a", 1)])));
    let epoch = "f".to_owned();
    hub.says(
        "data",
        &DataBatch {
            epoch: epoch.clone(),
            ..batch(s, 2, &[("a", 2)])
        },
    );
    assert_eq!(hub.knows(), (true, named(&[("a", 1)])));
    let begun = SiteState {
        epoch: epoch.clone(),
        ..state(s, 5, &[("a", 0)])
    };
    hub.says("state", &begun);
    assert_eq!(hub.knows(), (false, named(&[("a", 0)])));
    hub.says(
        "beat",
        &Beat {
            epoch,
            ..beat(s, hub.now, 0)
        },
    );
    assert_eq!(hub.knows(), (true, named(&[("a", 0)])));
    // With a new session all has to be said again.
    let (session, _) = hub.begins(FIRST).unwrap();
    assert_eq!(hub.knows(), (false, named(&[("a", 0)])));
    hub.beats(&session, 0);
    assert_eq!(hub.knows(), (false, named(&[("a", 0)])));
}

#[test]
fn a_state_that_comes_before_the_document_of_its_session_counts_after_it() {
    let mut hub = Hub::new();
    hub.says("state", &state("far", 4, &[("a", 4)]));
    assert!(hub.centre.site(hub.now, "p1").is_none());
    let lease = SessionLease {
        session: "far".to_owned(),
        ..SessionLease::default()
    };
    let lease = lease.encode_to_vec();
    hub.handle(CentreInput::Lease("p1", &lease, 1));
    assert_eq!(hub.knows(), (false, named(&[("a", 4)])));
    hub.beats("far", 4);
    assert!(hub.knows().0);
}

#[test]
fn what_is_missing_is_asked_for() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    let mut asked = Vec::new();
    for _ in 0..20 {
        hub.now += Duration::from_secs(10);
        hub.beats(&session, 3);
        let outputs = hub.outputs();
        if !outputs.is_empty() {
            let ask = CentreOutput::Request(format!("rb.down.p1.{session}.state"));
            assert_eq!(outputs, [ask]);
            asked.push(hub.now);
        }
    }
    assert_eq!(asked.len(), 4);
    assert!(asked.windows(2).all(|two| two[1] - two[0] == ASKED_AGAIN));
    hub.says("state", &state(&session, 3, &[]));
    hub.now += ASKED_AGAIN;
    hub.beats(&session, 3);
    assert_eq!(hub.outputs(), []);
}

#[test]
fn a_site_that_says_too_much_is_not_known() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    let paths: Vec<String> = (0..=POINTS_MAX).map(|n| n.to_string()).collect();
    let points: Vec<_> = paths.iter().map(|path| (path.as_str(), 1)).collect();
    for (seq, some) in (1..).step_by(1_000).zip(points.chunks(1_000)) {
        hub.says("data", &batch(&session, seq, some));
    }
    let count = u64::try_from(points.len()).unwrap();
    hub.beats(&session, count);
    let (is_current, known) = hub.knows();
    assert_eq!((is_current, known.len()), (false, POINTS_MAX));
    hub.says("state", &state(&session, count, &points));
    assert!(!hub.knows().0);
    let long = "m".repeat(300);
    hub.says("state", &state(&session, count, &[(&long, 1)]));
    assert!(!hub.knows().0);
    // Spans in front of which something is missing are forgotten at some number.
    hub.says("state", &state(&session, count, &[]));
    let many = 10_000;
    for n in 1..many {
        hub.says("data", &batch(&session, count + 2 * n, &[("a", 1)]));
    }
    assert_eq!(hub.knows(), (true, named(&[("a", 1)])));
    for n in 0..many {
        hub.says("data", &batch(&session, count + 2 * n + 1, &[("a", 1)]));
    }
    hub.beats(&session, count + 2 * many - 1);
    assert!(!hub.knows().0);
}

#[test]
fn a_site_whose_points_change_all_the_time_is_not_asked_how_they_are() {
    let mut hub = Hub::new();
    let (session, _) = hub.begins(FIRST).unwrap();
    hub.says("state", &state(&session, 0, &[]));
    for nth in 1..30 {
        // What it vouches for comes a second after it.
        hub.beats(&session, nth);
        assert_eq!(hub.outputs(), []);
        hub.now += Duration::from_secs(1);
        hub.says("data", &batch(&session, nth, &[("a", 1)]));
        hub.now += Duration::from_secs(9);
    }
}
