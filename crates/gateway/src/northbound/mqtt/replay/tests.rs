//! An outbox, a broker that fails in every way, and a receiver that keeps what is new to it.

use super::*;
use railbus_store::outbox::DroppedEntries;

/// Numbers that look like chance, the same every time.
struct Chance(u64);

impl Chance {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

fn entry(number: u64) -> OutboxEntry {
    let number = i64::try_from(number).unwrap();
    OutboxEntry {
        at: 1_000 * number,
        what: EntryKind::Reading {
            path: format!("oven.k{}", number % 8),
            value: Some(number.to_string()),
            quality: "good".to_owned(),
            reason: None,
            time: Some(1_000 * number - 30),
        },
    }
}

/// What is on the disk: entries up to `newest`, all after `deleted`.
#[derive(Default)]
struct Disk {
    newest: u64,
    deleted: u64,
}

impl Disk {
    fn state(&self) -> OutboxState {
        OutboxState {
            epoch: Arc::from("A"),
            newest: self.newest,
            before: 0,
            delivered: self.deleted,
            is_failing: false,
        }
    }

    fn read(&self, after: u64, limit: Option<usize>) -> Option<Packed> {
        let first = after.max(self.deleted) + 1;
        let last = self.newest.min(first + READ_MAX as u64 - 1);
        let piece = Piece {
            first,
            entries: (first..=last).map(entry).collect(),
            missing: None,
        };
        pack(
            ("plant", "x/batch".to_owned()),
            (Arc::from("A"), &piece),
            limit,
        )
    }
}

fn readings(message: &Message) -> (u64, Vec<Value>) {
    let told: Value = serde_json::from_slice(&message.payload).unwrap();
    assert_eq!(
        (&told["epoch"], &told["site"]),
        (&json!("A"), &json!("plant"))
    );
    let readings = told["readings"].as_array().unwrap().clone();
    (told["seq"].as_u64().unwrap(), readings)
}

#[test]
fn nothing_is_lost_and_nothing_comes_before_what_was_earlier() {
    for seed in 1..200_u64 {
        let mut chance = Chance(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let mut disk = Disk::default();
        let mut replay = Replay::default();
        replay.stored(&disk.state());
        let (mut received, mut repeated) = (0, 0);
        // With the broker, in their order.
        let mut at_broker: Vec<PieceId> = Vec::new();
        let mut now = Duration::ZERO;
        let mut asked = None;
        let is_calm = |step: u64| step > 3_000;
        for step in 0..60_000_u64 {
            if is_calm(step) && replay.behind() == 0 {
                break;
            }
            now += Duration::from_secs(chance.below(4));
            let odds = if is_calm(step) { 0 } else { 1 };
            match chance.below(40) {
                0..10 if !is_calm(step) => {
                    disk.newest += chance.below(12);
                    replay.stored(&disk.state());
                }
                // The connection is lost, with what the broker has said.
                10 if odds > 0 => {
                    replay.lost();
                    at_broker.clear();
                }
                // The program begins anew. It may not have written down the newest.
                11 if odds > 0 => {
                    replay = Replay::default();
                    disk.deleted = disk.deleted.saturating_sub(chance.below(50));
                    replay.stored(&disk.state());
                    at_broker.clear();
                    asked = None;
                }
                12..20 if !at_broker.is_empty() => {
                    let id = at_broker.remove(0);
                    let verdict = match chance.below(12) * odds {
                        11 => Verdict::NoReceiver,
                        10 => Verdict::Refused,
                        _ => Verdict::Taken,
                    };
                    if let Some((_, to)) = replay.taken(now, id, verdict) {
                        assert!(to <= received, "{seed}: {to} of {received}");
                        disk.deleted = to;
                    }
                }
                20..30 => {
                    if let Some(after) = replay.next_read(now) {
                        assert_eq!(asked.replace(after), None, "{seed}: two reads at once");
                    }
                    if chance.below(3) > 0
                        && let Some(after) = asked.take()
                    {
                        let limit = [None, Some(700)][chance.below(2) as usize];
                        let fails = chance.below(20) * odds == 19;
                        replay.read(now, disk.read(after, limit).filter(|_| !fails));
                    }
                }
                _ => {
                    if let Some((message, id)) = replay.next() {
                        at_broker.push(id);
                        assert_eq!(at_broker.len(), 1);
                        // The broker refuses some of it later: then it did not deliver it. A
                        // receiver that has it all the same knows it by its number.
                        let (first, readings) = readings(&message);
                        assert!(first <= received + 1, "{seed}: {first} after {received}");
                        for (number, reading) in (first..).zip(readings) {
                            assert_eq!(reading["value"], number, "{seed}");
                            match number == received + 1 {
                                true => received = number,
                                false => repeated += 1,
                            }
                        }
                    }
                }
            }
        }
        assert_eq!((received, replay.behind()), (disk.newest, 0), "{seed}");
        assert!(disk.newest > 1_000 && repeated > 0, "{seed}: {repeated}");
    }
}

#[test]
fn what_nobody_receives_stays_and_is_tried_again() {
    let disk = Disk {
        newest: 2_000,
        deleted: 0,
    };
    let mut replay = Replay::default();
    replay.stored(&disk.state());
    let mut now = Duration::ZERO;
    for _ in 0..5 {
        let after = replay.next_read(now).unwrap();
        assert_eq!(after, 0);
        replay.read(now, disk.read(after, None));
        let (_, id) = replay.next().unwrap();
        // One is enough to find out.
        let more = replay.next_read(now).unwrap();
        replay.read(now, disk.read(more, None));
        assert_eq!(replay.next(), None);
        assert_eq!(replay.taken(now, id, Verdict::NoReceiver), None);
        assert_eq!((replay.next_read(now), replay.behind()), (None, 2_000));
        let at = replay.deadline().unwrap();
        assert_eq!(at, now + AGAIN);
        now = at;
    }
}

#[test]
fn numbers_of_another_file_are_not_mixed_with_these() {
    let disk = Disk {
        newest: 500,
        deleted: 0,
    };
    let mut replay = Replay::default();
    replay.stored(&disk.state());
    let after = replay.next_read(Duration::ZERO).unwrap();
    let old = disk.read(after, None);
    replay.stored(&OutboxState {
        epoch: Arc::from("B"),
        newest: 10,
        before: 0,
        delivered: 0,
        is_failing: false,
    });
    replay.read(Duration::ZERO, old);
    assert_eq!(replay.next(), None);
    assert_eq!(
        (replay.behind(), replay.next_read(Duration::ZERO)),
        (10, Some(0))
    );
}

#[test]
fn a_message_is_as_long_as_the_broker_takes_and_tells_what_is_missing() {
    let gap = OutboxEntry {
        at: 5_000,
        what: EntryKind::Gap {
            from: Some(2_000),
            reason: "stopped".to_owned(),
        },
    };
    let bad = OutboxEntry {
        at: 6_000,
        what: EntryKind::Reading {
            path: "oven.k1".to_owned(),
            value: None,
            quality: "bad".to_owned(),
            reason: Some("offline".to_owned()),
            time: None,
        },
    };
    let mut entries = vec![gap, bad];
    entries.extend((8..200).map(entry));
    let piece = Piece {
        first: 6,
        entries,
        missing: Some(DroppedEntries {
            count: 3,
            from: None,
            to: 5_000,
        }),
    };
    let packed = |limit| {
        pack(
            ("plant", "x/batch".to_owned()),
            (Arc::from("A"), &piece),
            limit,
        )
    };
    let all = packed(None).unwrap();
    let told: Value = serde_json::from_slice(&all.message.payload).unwrap();
    let first = json!({
        "gap": {
            "reason": "stopped",
            "from": "1970-01-01T00:00:02.000Z",
            "to": "1970-01-01T00:00:05.000Z",
        },
    });
    assert_eq!(told["readings"][0], first);
    let second = json!({
        "path": "oven.k1", "value": null, "quality": "bad", "reason": "offline",
        "at": "1970-01-01T00:00:06.000Z",
    });
    assert_eq!(told["readings"][1], second);
    let missing = json!({"count": 3, "from": null, "to": "1970-01-01T00:00:05.000Z"});
    assert_eq!((&told["missing"], &told["seq"]), (&missing, &json!(6)));
    assert!(all.message.payload.len() <= LEN_MAX);
    let count = told["readings"].as_array().unwrap().len() as u64;
    assert_eq!(all.last, 6 + count - 1);
    assert!(all.message.is_sure && !all.message.is_retained);

    let short = packed(Some(600)).unwrap();
    assert!(short.message.payload.len() <= 600 - 7 - 32);
    assert!(short.last > 7 && short.last < all.last);
    // Never none: nothing would ever go on.
    assert_eq!(packed(Some(1)).unwrap().last, 6);
    let empty = Piece::default();
    assert_eq!(
        pack(("plant", String::new()), (Arc::from("A"), &empty), None),
        None
    );
}

/// It comes while four messages are with the broker: what was sent before it came is gone.
#[test]
fn a_receiver_that_comes_in_between_gets_nothing_before_what_was_earlier() {
    let disk = Disk {
        newest: 2_000,
        deleted: 0,
    };
    let mut replay = Replay::default();
    replay.stored(&disk.state());
    let mut at_broker = Vec::new();
    let mut newest_received = None;
    for turn in 0..30_u64 {
        let now = Duration::from_secs(turn);
        while let Some(after) = replay.next_read(now) {
            replay.read(now, disk.read(after, None));
            at_broker.extend(replay.next());
        }
        at_broker.extend(replay.next());
        if at_broker.is_empty() {
            continue;
        }
        let (message, id) = at_broker.remove(0);
        // It is away for one message.
        let verdict = match turn {
            3 => Verdict::NoReceiver,
            _ => Verdict::Taken,
        };
        if verdict == Verdict::Taken {
            let (first, readings) = readings(&message);
            let newest = newest_received.unwrap_or(0);
            assert!(first <= newest + 1, "turn {turn}: {first} after {newest}");
            newest_received = Some(newest.max(first + readings.len() as u64 - 1));
        }
        replay.taken(now, id, verdict);
    }
    assert!(newest_received.unwrap() > 500);
}
