//! What changes while nobody is told.

use super::*;
use railbus_store::outbox::OutboxEntry;
use std::collections::BTreeSet;

#[tokio::test]
async fn what_changes_while_the_broker_is_away_comes_as_the_past() {
    let mut stage = Stage::connected(true).await;
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    stage.answer();
    assert_eq!(
        stage.delivered,
        [2],
        "all of it was told live, or in the birth"
    );
    stage.handle(Input::Lost);
    for on in [false, true, false] {
        stage.happens("oven.k1", on, PointQuality::Good);
    }
    stage.happens("oven.k1", false, PointQuality::Stale);
    stage.stored();
    stage.settle();
    stage.handle(Input::Connected(8));
    stage.handle(Input::Subscribed);
    let told = stage.settle();
    let at = |back: u64| stage.now - BEGIN - back;
    assert_eq!(told[..2], ["NBIRTH", "DBIRTH oven"]);
    let past = format!(
        "DDATA oven k1=false/192@{} k1=true/192@{} k1=false/192@{} k1=false/500@{}",
        at(3),
        at(2),
        at(1),
        at(0)
    );
    assert_eq!(told[2..], [past]);
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    assert_eq!(stage.settle(), ["DDATA oven k1=true/192"]);
    stage.answer();
    assert_eq!(stage.delivered, [2, 7]);
    assert_eq!(stage.settle(), [""; 0]);
}

#[tokio::test]
async fn what_arrived_before_it_was_on_the_disk_is_delivered() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    assert_eq!(stage.delivered, [1], "it was before the births");
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.settle();
    stage.answer();
    stage.stored();
    stage.settle();
    assert_eq!(stage.delivered, [1, 2]);
    assert_eq!(stage.node.waiting(), 0);
}

#[tokio::test]
async fn what_did_not_arrive_comes_again() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.answer();
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    assert_eq!(stage.settle(), ["DDATA oven k1=true"]);
    // The connection is lost before the broker has said that it has it.
    stage.handle(Input::Lost);
    stage.handle(Input::Connected(8));
    stage.handle(Input::Subscribed);
    let past = format!("DDATA oven k1=true/192@{}", stage.now - BEGIN);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven", &past]);
    stage.handle(Input::Lost);
    stage.handle(Input::Connected(9));
    stage.handle(Input::Subscribed);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven", &past]);
    stage.answer();
    stage.handle(Input::Lost);
    stage.handle(Input::Connected(10));
    stage.handle(Input::Subscribed);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven"]);
}

#[tokio::test]
async fn the_past_of_a_silent_module_waits_for_it() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.answer();
    stage.handle(Input::Lost);
    stage.happens("oven.k1", true, PointQuality::Good);
    let first = stage.now - BEGIN;
    stage.modules(&[("oven", false), ("pump", true)]);
    stage.happens("pump.do1", true, PointQuality::Good);
    let second = stage.now - BEGIN;
    stage.stored();
    stage.handle(Input::Connected(8));
    stage.handle(Input::Subscribed);
    let told = stage.settle();
    let pump = format!("DDATA pump do1=true/192@{second}");
    assert_eq!(told, ["NBIRTH", "DBIRTH pump", &pump]);
    stage.answer();
    assert_eq!(
        stage.delivered.last(),
        Some(&3),
        "nothing holds the outbox up"
    );
    stage.modules(&[("oven", true)]);
    let oven = format!("DDATA oven k1=true/192@{first}");
    let told = stage.settle();
    assert_eq!(told, ["DBIRTH oven", &oven, "NDATA Modules/Answering=2"]);
}

/// Times that come once more are not taken for those that were told.
#[tokio::test]
async fn nothing_is_lost_where_the_clock_is_set_back() {
    let mut stage = Stage::connected(true).await;
    stage.now += 3_600_000;
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    let back = stage.now;
    stage.now -= 1_800_000;
    stage.happens("oven.k1", false, PointQuality::Good);
    let past = format!("DDATA oven k1=false/192@{}", stage.now - BEGIN);
    stage.stored();
    stage.now = back;
    stage.handle(Input::Connected(8));
    stage.handle(Input::Subscribed);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven", &past]);
}

#[tokio::test]
async fn what_a_picture_has_skipped_comes_as_the_past() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    // The outbox has two changes, of which the node is told the end only.
    let entries = [true, false].map(|on| {
        stage.now += 1;
        (on, stage.now)
    });
    stage.skipped("oven.k1", &entries);
    let told = stage.settle();
    stage.stored();
    let at = |which: usize| entries[which].1 - BEGIN;
    let past = format!("DDATA oven k1=true/192@{} k1=false/192@{}", at(0), at(1));
    assert_eq!(told, [""; 0], "it is as it was");
    assert_eq!(stage.settle(), [past]);
}

#[tokio::test]
async fn the_broker_is_asked_at_once_where_much_waits() {
    let mut stage = Stage::connected(true).await;
    stage.answer();
    stage.handle(Input::Lost);
    for round in 0..5_000 {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
    }
    stage.stored();
    stage.handle(Input::Connected(8));
    stage.handle(Input::Subscribed);
    stage.settle();
    let (now, asked) = (stage.now, stage.asked);
    for _ in 0..10 {
        let last = stage.last;
        stage.handle(Input::Arrived(last));
        stage.settle();
    }
    assert!(stage.asked > asked, "without waiting");
    assert!(
        stage.delivered.last() > Some(&4_000),
        "{:?}",
        stage.delivered
    );
    assert_eq!(stage.now, now);
}

#[tokio::test]
async fn what_a_module_told_last_is_told_before_its_death() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.happens_with("oven.k1", true, &[("oven", false)]);
    let told = stage.settle();
    assert_eq!(told[..2], ["DDATA oven k1=true", "DDEATH oven"]);
    stage.stored();
    stage.answer();
    assert_eq!(stage.delivered.last(), Some(&2));
}

#[tokio::test]
async fn what_is_only_in_memory_is_missing_after_a_restart() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    stage.happens("oven.k1", true, PointQuality::Good);
    let first = stage.now;
    stage.happens("oven.k1", false, PointQuality::Good);
    let last = stage.now;
    stage.modules(&[("oven", false), ("pump", true)]);
    stage.stored();
    stage.connect(8);
    stage.settle();
    stage.answer();
    assert_eq!(stage.held, Some((first, last)), "it is written down");
    assert_eq!(stage.delivered.last(), Some(&3), "and then it is deleted");

    let mut again = Stage::after(Some((first, last))).await;
    again.modules(&[("pump", true)]);
    again.connect(9);
    let told = again.settle();
    assert_eq!(told, ["NBIRTH", "DBIRTH pump"]);
    assert_eq!(again.judge.missing, Some((Some(first), last)));
    assert_eq!(again.held, Some((first, last)), "it may not have arrived");
    again.answer();
    assert_eq!(again.held, None);

    // Where its module comes back, nothing is missing.
    stage.modules(&[("oven", true)]);
    assert_eq!(stage.settle().len(), 3);
    stage.answer();
    assert_eq!(stage.held, None);
}

/// Its death says how it is: of a silent module, why its values are bad is not waited with.
#[tokio::test]
async fn what_needs_no_message_is_delivered_without_one() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.modules(&[("oven", false)]);
    stage.settle();
    stage.answer();
    stage.happens("oven.k1", false, PointQuality::Bad(BadReason::Offline));
    stage.stored();
    assert_eq!(stage.settle(), [""; 0]);
    assert_eq!(stage.delivered.last(), Some(&2));
    assert_eq!((stage.held, stage.node.waiting()), (None, 0));
}

#[tokio::test]
async fn several_gaps_are_told_as_one_and_kept_until_then() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    stage.gap(10, 20);
    stage.gap(50, 60);
    stage.stored();
    stage.settle();
    assert_eq!(stage.delivered.last(), Some(&1));
    stage.connect(8);
    stage.settle();
    assert_eq!(stage.judge.missing, Some((Some(BEGIN + 10), BEGIN + 60)));
    stage.handle(Input::Lost);
    stage.connect(9);
    stage.settle();
    assert_eq!(stage.delivered.last(), Some(&1), "it did not arrive");
    stage.answer();
    assert_eq!(stage.delivered.last(), Some(&3));
    stage.gap(70, 80);
    stage.stored();
    let told = stage.settle().concat();
    assert!(told.contains("NDATA Missing/From"), "{told}");
    assert_eq!(stage.judge.missing, Some((Some(BEGIN + 10), BEGIN + 80)));
}

/// Two messages of one batch, of which only the first has arrived.
#[tokio::test]
async fn a_part_of_a_batch_is_not_taken_for_all_of_it() {
    let mut stage = Stage::connected(true).await;
    stage.modules(&[("pump", true)]);
    stage.stored();
    stage.settle();
    stage.answer();
    stage.together(&[("pump.do1", true), ("oven.k1", true)]);
    let (_, first) = stage.one();
    stage.stored();
    stage.handle(Input::Went(first));
    stage.handle(Input::Arrived(first));
    stage.handle(Input::Lost);
    stage.connect(8);
    let told = stage.settle().concat();
    assert!(told.contains("DDATA pump do1=true/192@"), "{told}");
}

#[tokio::test]
async fn a_value_of_another_type_is_not_told_as_none() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.handle(Input::Lost);
    stage.happens("oven.k1", true, PointQuality::Good);
    let Some(OutboxEntry {
        what: EntryKind::Reading { value, .. },
        ..
    }) = stage.entries.last_mut()
    else {
        panic!("a reading");
    };
    *value = Some("7".to_owned());
    stage.stored();
    stage.connect(8);
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven"]);
    assert_eq!(stage.node.counted().dropped, 1);
}

#[tokio::test]
async fn only_so_much_of_the_past_is_on_its_way() {
    let mut stage = Stage::connected(true).await;
    stage.answer();
    stage.handle(Input::Lost);
    for round in 0..2_000 {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
    }
    stage.stored();
    stage.connect(8);
    let told = stage.settle();
    let bytes: usize = told.iter().map(String::len).sum();
    assert!(
        told.len() > 3 && told.len() < 15,
        "{} messages, {bytes}",
        told.len()
    );
    assert!(
        stage.asked > 0,
        "and it is asked at once whether it arrived"
    );
}

#[tokio::test]
async fn what_could_not_be_read_is_tried_again_later() {
    let mut backlog = Backlog::default();
    let devices = Devices::new();
    backlog.stored(&OutboxState {
        epoch: Arc::from("e"),
        newest: 9,
        before: 0,
        delivered: 0,
        is_failing: false,
    });
    assert_eq!(backlog.next_read(Duration::ZERO), Some(0));
    assert_eq!(backlog.next_read(Duration::ZERO), None, "it is being read");
    backlog.read(Duration::ZERO, None, &devices);
    assert_eq!(backlog.next_read(Duration::ZERO), None);
    let again = backlog.deadline().unwrap();
    assert_eq!(backlog.next_read(again), Some(0));
    // What another file has is not what this one has.
    let piece = Piece {
        first: 1,
        entries: vec![],
        missing: None,
    };
    backlog.read(again, Some((Arc::from("other"), piece)), &devices);
    assert_eq!(backlog.next_read(again), Some(0));
}

#[tokio::test]
async fn a_silent_module_holds_so_many_changes_and_no_more() {
    let mut stage = Stage::connected(true).await;
    stage.stored();
    stage.settle();
    stage.answer();
    stage.modules(&[("oven", false)]);
    let entry = stage.entries[0].clone();
    let more = super::super::super::backlog::HELD_MAX + 5;
    stage.piece = more;
    for nth in 0..more {
        let mut entry = entry.clone();
        entry.at = i64::try_from(BEGIN - 100_000 + nth as u64).unwrap();
        stage.entries.push(entry);
    }
    stage.stored();
    stage.settle();
    assert_eq!(stage.node.counted().dropped, 5);
    let missing = stage.judge.missing.unwrap();
    assert_eq!(missing, (Some(BEGIN - 100_000), BEGIN - 100_000 + 4));
}

#[tokio::test]
async fn a_rebirth_brings_nothing_of_the_past_again() {
    let mut stage = Stage::connected(true).await;
    stage.happens("oven.k1", true, PointQuality::Good);
    stage.stored();
    stage.settle();
    let rebirth = Metric::new("Node Control/Rebirth", 0, Some(MetricValue::Boolean(true)));
    stage.command("NCMD/n", &Payload::new(vec![rebirth]));
    assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven"]);
    stage.answer();
    assert_eq!(stage.delivered.last(), Some(&2));
}

#[tokio::test]
async fn the_past_has_a_fifth_of_the_messages_while_there_is_news() {
    let mut stage = Stage::connected(true).await;
    stage.answer();
    stage.handle(Input::Lost);
    for round in 0..30 {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
    }
    stage.stored();
    stage.handle(Input::Connected(8));
    stage.handle(Input::Subscribed);
    // Both wait from here on.
    for round in 0..20 {
        stage.happens("oven.k1", round % 2 == 0, PointQuality::Good);
    }
    let told = stage.settle();
    let is_past: Vec<bool> = told.iter().map(|message| message.contains('@')).collect();
    let news = is_past.iter().rposition(|is_past| !is_past).unwrap();
    let past = is_past[..news].iter().filter(|is_past| **is_past).count();
    assert!(past > 0 && past * 5 <= news + 1, "{past} of {news}");
}

/// Whatever happens to the connection and to the modules, a host gets every change of the outputs
/// once at least, and none again that it is known to have.
#[tokio::test]
async fn no_change_is_lost_over_any_outages() {
    for seed in 1..=60 {
        random(seed).await;
    }
}

async fn random(seed: u64) {
    let mut state = seed;
    let mut dice = move |sides: u64| {
        // xorshift64*
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % sides
    };
    let mut stage = Stage::new(None, true).await;
    stage.modules(&[("oven", true), ("pump", true)]);
    // What is on its way, and what the host has: each change by its place and its time.
    let mut flying: Vec<(u64, Message)> = Vec::new();
    let (mut known, mut arrived) = (BTreeSet::new(), BTreeSet::new());
    let (mut is_connected, mut asked, mut bd_seq) = (false, None, 0_u8);
    let (mut stored, mut online) = (0, true);
    let paths = ["oven.k1", "oven.k2", "pump.do1"];
    let mut values = [false; 3];
    for step in 0..700 {
        let is_last = step > 500;
        match dice(if is_last { 5 } else { 12 }) {
            0..=2 if !is_last => {
                // Of a module that does not answer nothing new is known.
                let mut changes = Vec::new();
                for _ in 0..=dice(3) {
                    let which = usize::try_from(if online { dice(3) } else { 2 }).unwrap();
                    values[which] = !values[which];
                    changes.push((paths[which], values[which]));
                }
                stage.together(&changes);
            }
            3 => {
                // The broker has what went before the question.
                if let Some(number) = asked.take() {
                    let (come, rest) = flying.into_iter().partition(|(of, _)| *of <= number);
                    flying = rest;
                    let come: Vec<(u64, Message)> = come;
                    for (_, message) in &come {
                        let of_host = changes(message);
                        // How it is at a birth is no change that was told; and of several messages
                        // that are of one moment, all must have arrived.
                        if message.topic.contains("DATA") && flying.is_empty() {
                            arrived.extend(of_host.iter().cloned());
                        }
                        stage.judge.heard(message);
                        known.extend(of_host);
                    }
                    stage.handle(Input::Arrived(number));
                }
            }
            4 | 5 => {
                stored = stage.entries.len() as u64;
                stage.stored();
            }
            6 if is_connected && !is_last => {
                // Of what was on its way, some is lost.
                let kept = usize::try_from(dice(flying.len() as u64 + 1)).unwrap();
                for (_, message) in flying.drain(..).take(kept) {
                    stage.judge.heard(&message);
                    known.extend(changes(&message));
                }
                stage.handle(Input::Lost);
                (is_connected, asked) = (false, None);
            }
            7 if !is_last => {
                online = !online;
                match dice(3) {
                    0 => stage.modules(&[("oven", online)]),
                    1 => stage.figures(&[("oven", online)]),
                    // Its last reading comes with it.
                    _ => {
                        values[0] = !values[0];
                        stage.happens_with(paths[0], values[0], &[("oven", online)]);
                    }
                }
            }
            8 | 9 if !is_connected => {
                stage.handle(Input::Connected(bd_seq));
                stage.handle(Input::Subscribed);
                bd_seq = bd_seq.wrapping_add(1);
                is_connected = true;
            }
            _ => stage.now += 700,
        }
        if is_last && !is_connected {
            stage.handle(Input::Connected(bd_seq));
            stage.handle(Input::Subscribed);
            is_connected = true;
        }
        if is_last && !online {
            online = true;
            stage.modules(&[("oven", true)]);
        }
        while let Some(output) = stage.node.poll(stage.now()) {
            match output {
                Output::Publish(number, message) => {
                    for change in changes(&message) {
                        let is_past = brief_of(&message).contains('@');
                        let is_again = is_past && arrived.contains(&change);
                        assert!(!is_again, "seed {seed}: {change:?} again");
                    }
                    flying.push((number, message));
                    stage.handle(Input::Went(number));
                }
                Output::Ask => asked = flying.last().map(|(number, _)| *number),
                Output::Read(after) => {
                    let first = after + 1;
                    let rest = stage.entries.iter().skip(usize::try_from(after).unwrap());
                    let rest = rest.take(usize::try_from(stored - after).unwrap());
                    let entries: Vec<_> = rest.take(7).cloned().collect();
                    let piece = Piece {
                        first,
                        entries,
                        missing: None,
                    };
                    stage.handle(Input::Read(Some((Arc::from("e"), piece))));
                }
                Output::Delivered(_, to) => {
                    // What the outbox may delete, the host has, or it waits for its module.
                    assert!(to <= stored, "seed {seed}");
                }
                _ => {}
            }
        }
    }
    for entry in &stage.entries {
        let EntryKind::Reading { path, time, .. } = &entry.what else {
            panic!("a reading");
        };
        let (module, label) = path.split_once('.').unwrap();
        let change = (
            module.to_owned(),
            label.to_owned(),
            u64::try_from(time.unwrap()).unwrap(),
        );
        assert!(known.contains(&change), "seed {seed}: {change:?} is lost");
    }
    assert!(stage.entries.len() > 50);
}

fn brief_of(message: &Message) -> String {
    let payload = Payload::parse(&message.payload).unwrap();
    payload.metrics.iter().map(brief).collect()
}

/// The changes of outputs that a message tells, each with its place and its time.
fn changes(message: &Message) -> Vec<(String, String, u64)> {
    let payload = Payload::parse(&message.payload).unwrap();
    let device = message
        .topic
        .split('/')
        .nth(4)
        .unwrap_or_default()
        .to_owned();
    let its = payload.metrics.into_iter();
    let its = its.filter(|metric| matches!(metric.value, Some(MetricValue::Boolean(_))));
    its.map(|metric| {
        (
            device.clone(),
            metric.name.unwrap(),
            metric.timestamp.unwrap(),
        )
    })
    .collect()
}
