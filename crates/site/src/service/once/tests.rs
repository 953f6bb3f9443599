//! Tests of the keys.

use super::*;
use std::sync::atomic::{AtomicUsize, Ordering};

struct Place(PathBuf);

impl Place {
    fn new(name: &str) -> Place {
        let unique = format!("railbus-keys-{}-{name}", std::process::id());
        Place(std::env::temp_dir().join(unique))
    }

    fn keys(&self) -> Once {
        let keys = Once::open(Some(&self.0));
        assert!(keys.file.is_ok(), "{:?}", keys.file);
        keys
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn named(key: &str, caller: &str, body: &str) -> CommandKey {
    CommandKey {
        key: key.to_owned(),
        caller: caller.to_owned(),
        command: vec![b"toggle".to_vec(), body.as_bytes().to_vec()],
    }
}

type Told = Result<Json, KeyRefusal>;

async fn ask(keys: &Once, key: &str, who: &str, body: &str, answer: &'static str) -> Told {
    let work = async move { told(answer) };
    keys.carry_out(named(key, who, body), work).await
}

fn told(answer: &str) -> Json {
    Json::from(answer)
}

#[tokio::test]
async fn a_key_stands_for_one_command_also_after_a_restart() {
    let place = Place::new("one");
    for (round, answer) in ["1", "2"].into_iter().enumerate() {
        let keys = place.keys();
        let first = ask(&keys, "a", "li", "k1", answer).await;
        assert_eq!(first, Ok(told("1")), "round {round}");
        let other = ask(&keys, "a", "li", "k2", "3").await;
        assert_eq!(other, Err(KeyRefusal::OtherCommand));
        // Somebody else's is another one, and tells nothing of this.
        let others = ask(&keys, "a", "wang", "k1", "3").await;
        assert_eq!(others, Ok(told("3")), "round {round}");
    }
}

/// What the file says of these, one after the other: a key of somebody, and how many hours ago
/// it was done.
fn text_of(rows: impl Iterator<Item = (String, &'static str, u64)>) -> Vec<u8> {
    let now = millis(SystemTime::now());
    let mut text = Vec::new();
    for (key, who, hours) in rows {
        let begin = Begin {
            key: key.clone(),
            who: who.to_owned(),
            command: digest(who, &named(&key, who, "k1").command),
            at_ms: now - hours * 3_600_000,
        };
        let end = Row::End {
            key,
            who: Some(who.to_owned()),
            answer: told("1"),
        };
        for row in [Row::Begin(begin), end] {
            serde_json::to_writer(&mut text, &row).unwrap();
            text.push(b'\n');
        }
    }
    text
}

/// While the program ran the old ones were forgotten before the new ones came.
#[tokio::test]
async fn old_keys_push_no_new_ones_out_after_a_restart() {
    let place = Place::new("old");
    let old = (0..100).map(|number| (format!("old{number}"), "li", 30));
    let new = (0..200).map(|number| (format!("new{number}"), "wang", 1));
    std::fs::create_dir_all(&place.0).unwrap();
    std::fs::write(place.0.join(NAME), text_of(old.chain(new))).unwrap();
    let keys = place.keys();
    for number in 0..200 {
        let again = ask(&keys, &format!("new{number}"), "wang", "k1", "2").await;
        assert_eq!(again, Ok(told("1")), "new{number}");
    }
}

/// "Never" is said only of what can't have been forgotten.
#[tokio::test]
async fn what_is_known_of_a_command_is_told_without_carrying_it_out() {
    let place = Place::new("told");
    let keys = place.keys();
    let given = Some(Instant::now());
    let of = |keys: &Once, key: &str, given| keys.told(&named(key, "li", "k1"), given);
    assert_eq!(of(&keys, "a", given), Ok(KeyTold::Never));
    assert_eq!(ask(&keys, "a", "li", "k1", "1").await, Ok(told("1")));
    assert_eq!(of(&keys, "a", given), Ok(KeyTold::Ended(told("1"))));
    let other = keys.told(&named("a", "li", "k2"), given);
    assert_eq!(other, Err(KeyRefusal::OtherCommand));
    assert_eq!(
        keys.told(&named("a", "wang", "k1"), given),
        Ok(KeyTold::Never)
    );
    let under_way = keys.slot(
        "b",
        "li",
        &digest("li", &named("b", "li", "k1").command),
        Instant::now(),
    );
    assert_eq!(of(&keys, "b", given), Ok(KeyTold::UnderWay));
    under_way.unwrap().set(None).unwrap();
    assert_eq!(of(&keys, "b", given), Ok(KeyTold::Begun));
    // A run before may have had it.
    assert_eq!(
        keys.told(&named("c", "li", "k1"), None),
        Ok(KeyTold::Forgotten)
    );
    // Others are forgotten: those before may be among them, later ones are not.
    for number in 0..KEYS_MAX {
        let end = ask(&keys, &number.to_string(), "li", "k1", "1").await;
        assert!(end.is_ok());
    }
    assert_eq!(of(&keys, "a", given), Ok(KeyTold::Forgotten));
    let later = Some(Instant::now());
    assert_eq!(
        keys.told(&named("c", "li", "k1"), later),
        Ok(KeyTold::Never)
    );
    // A restart knows what was written down.
    let keys = place.keys();
    let last = (KEYS_MAX - 1).to_string();
    let end = keys.told(&named(&last, "li", "k1"), None);
    assert_eq!(end, Ok(KeyTold::Ended(told("1"))));
    // So do those whose day is over.
    let keys = Once::open(None);
    let given = Some(Instant::now());
    keys.slot("a", "li", "k1", Instant::now()).unwrap();
    assert_eq!(of(&keys, "c", given), Ok(KeyTold::Never));
    let tomorrow = Instant::now() + AGE_MAX + Duration::from_secs(1);
    keys.slot("d", "li", "k1", tomorrow).unwrap();
    assert_eq!(of(&keys, "c", given), Ok(KeyTold::Forgotten));
}

#[tokio::test]
async fn nobody_pushes_the_keys_of_others_out() {
    let place = Place::new("share");
    let keys = place.keys();
    for number in 0..10 {
        ask(&keys, &format!("own{number}"), "wang", "k1", "1")
            .await
            .unwrap();
    }
    for number in 0..KEYS_MAX + 20 {
        ask(&keys, &number.to_string(), "li", "k1", "1")
            .await
            .unwrap();
    }
    assert_eq!(lock(&keys.known).keys.len(), KEYS_MAX);
    let again = place.keys();
    for keys in [&keys, &again] {
        for number in 0..10 {
            let end = ask(keys, &format!("own{number}"), "wang", "k1", "2").await;
            assert_eq!(end, Ok(told("1")), "{number}");
        }
    }
    assert_eq!(ask(&again, "0", "li", "k1", "2").await, Ok(told("2")));
}

#[test]
fn who_has_the_most_gives_way() {
    let way = |keys: &[(&'static str, bool)], asker| gives_way(keys.iter().copied(), asker);
    let two = [("li", true), ("wang", true), ("li", true)];
    assert_eq!(way(&two, "zhao"), Some(0), "the oldest of li");
    assert_eq!(way(&two, "li"), Some(0));
    assert_eq!(way(&two, "wang"), Some(0));
    // Whose commands are all under way waits for them, and takes no place of others.
    let busy = [("li", false), ("wang", true), ("li", false)];
    assert_eq!(way(&busy, "li"), None);
    assert_eq!(way(&busy, "zhao"), Some(1));
}

/// The clock on the wall is set by a year while the program runs.
#[tokio::test]
async fn a_key_lasts_a_day_whatever_the_clock_on_the_wall_says() {
    let place = Place::new("clock");
    let keys = place.keys();
    let now = Instant::now();
    let first = keys.slot("a", "li", "k1", now).unwrap();
    first.set(Some(told("1"))).unwrap();
    let again = keys.slot("a", "li", "k1", now + AGE_MAX).unwrap();
    assert!(Arc::ptr_eq(&first, &again));
    let late = now + AGE_MAX + Duration::from_secs(1);
    let anew = keys.slot("a", "li", "k1", late).unwrap();
    assert!(!Arc::ptr_eq(&first, &anew), "it is over");

    // What an earlier run wrote down with a clock that went ahead is as old as nothing, and is
    // so at every start.
    let year = Duration::from_secs(365 * 24 * 3_600);
    let row = Row::Begin(Begin {
        key: "b".to_owned(),
        who: "li".to_owned(),
        command: "k1".to_owned(),
        at_ms: millis(SystemTime::now() + year),
    });
    keys.write(row).await.unwrap();
    let keys = place.keys();
    let aged = |keys: &Once| lock(&keys.known).keys.back().unwrap().aged;
    assert!(aged(&keys) < Duration::from_secs(60), "{:?}", aged(&keys));
    let text = std::fs::read_to_string(place.0.join(NAME)).unwrap();
    let Ok(Row::Begin(begin)) = serde_json::from_str(text.lines().last().unwrap()) else {
        panic!("{text}");
    };
    assert!(begin.at_ms <= millis(SystemTime::now()));
}

/// A full disk takes a part of a line, and does not let it be taken back either.
#[tokio::test]
async fn a_line_that_was_torn_hides_none_after_it() {
    let place = Place::new("torn");
    let keys = place.keys();
    let file = keys.file.clone().unwrap();
    let path = place.0.join(NAME);
    let whole = std::mem::replace(&mut lock(&file).file, File::open(&path).unwrap());
    let refused = ask(&keys, "a", "li", "k1", "1").await;
    assert!(
        matches!(refused, Err(KeyRefusal::NotKept(_))),
        "{refused:?}"
    );
    let mut part = append_to(&path).unwrap();
    part.write_all(b"{\"begin\":{\"key\":\"a\"").unwrap();
    lock(&file).file = whole;
    ask(&keys, "b", "li", "k1", "1").await.unwrap();
    // A write that fails later takes back what is its own.
    let len = std::fs::metadata(&path).unwrap().len();
    assert_eq!(lock(&file).len, len);
    let keys = place.keys();
    let again = ask(&keys, "b", "li", "k1", "2").await;
    assert_eq!(again, Ok(told("1")));
}

#[tokio::test]
async fn who_asks_at_the_same_time_waits_for_the_one_answer() {
    let place = Place::new("same");
    let keys = place.keys();
    let count = Arc::new(AtomicUsize::new(0));
    let ask = || {
        let count = Arc::clone(&count);
        keys.carry_out(named("a", "li", ""), async move {
            tokio::task::yield_now().await;
            let times = count.fetch_add(1, Ordering::Relaxed) + 1;
            told(&times.to_string())
        })
    };
    let (one, two, three) = tokio::join!(ask(), ask(), ask());
    assert_eq!(count.load(Ordering::Relaxed), 1);
    assert_eq!(one, Ok(told("1")));
    assert_eq!((&two, &three), (&one, &one));
}

/// The start of a command is in the file before it starts, and its result before it is reported.
#[tokio::test]
async fn it_is_written_down_before_it_begins_and_before_it_is_told() {
    let place = Place::new("before");
    let keys = place.keys();
    let path = place.0.join(NAME);
    let rows = move || std::fs::read_to_string(&path).unwrap().lines().count();
    let counts = rows.clone();
    let work = async move { Json::from(counts()) };
    let end = keys.carry_out(named("a", "li", "k1"), work).await;
    assert_eq!((end, rows()), (Ok(Json::from(1)), 2));
}

#[tokio::test]
async fn what_began_and_has_no_end_is_not_done_again() {
    let place = Place::new("cut");
    let keys = place.keys();
    let command = digest("li", &named("a", "li", "k1").command);
    let begin = |key: &str| {
        let (key, who, command) = (key.to_owned(), "li".to_owned(), command.clone());
        let at_ms = millis(SystemTime::now());
        Row::Begin(Begin {
            key,
            who,
            command,
            at_ms,
        })
    };
    keys.write(begin("a")).await.unwrap();
    // A line that was torn began nothing, and spoils nothing.
    let mut file = append_to(&place.0.join(NAME)).unwrap();
    file.write_all(b"{\"begin\":{\"key\":\"b\"").unwrap();
    for _ in 0..2 {
        let keys = place.keys();
        let end = ask(&keys, "a", "li", "k1", "again").await;
        assert_eq!(end, Err(KeyRefusal::Begun));
    }
    let keys = place.keys();
    assert!(ask(&keys, "b", "li", "k1", "1").await.is_ok());
}

#[tokio::test]
async fn a_task_that_breaks_off_is_not_done_again() {
    let place = Place::new("broken");
    let keys = place.keys();
    let end = keys.carry_out(named("a", "li", "k1"), async { panic!("a test") });
    assert_eq!(end.await, Err(KeyRefusal::Begun));
    for keys in [&keys, &place.keys()] {
        let again = ask(keys, "a", "li", "k1", "2").await;
        assert_eq!(again, Err(KeyRefusal::Begun));
    }
}

#[tokio::test]
async fn old_keys_are_forgotten_and_those_under_way_are_not() {
    let place = Place::new("bound");
    let keys = place.keys();
    let start = Instant::now();
    let slot = |key: &str, command| keys.slot(key, "li", command, start);
    let under_way = slot("scene", "evening").unwrap();
    for number in 0..KEYS_MAX {
        let slot = slot(&number.to_string(), "").unwrap();
        let _ = slot.set(Some(told("1")));
    }
    assert!(slot("0", "another").is_ok(), "it is forgotten");
    let again = slot("scene", "evening").unwrap();
    assert!(Arc::ptr_eq(&under_way, &again), "it is not done twice");
    let held: Vec<_> = (0..KEYS_MAX).map(|n| slot(&format!("h{n}"), "")).collect();
    assert!(
        held.iter().filter(|slot| slot.is_err()).count() >= 1,
        "no room"
    );

    let day = AGE_MAX + Duration::from_secs(1);
    let row = |key: &str, at: SystemTime| {
        let (key, who, command) = (key.to_owned(), String::new(), String::new());
        let row = Row::Begin(Begin {
            key,
            who,
            command,
            at_ms: millis(at),
        });
        serde_json::to_string(&row).unwrap() + "\n"
    };
    let now = SystemTime::now();
    let names = |text: String| {
        std::fs::write(place.0.join(NAME), text).unwrap();
        let (_, kept) = KeyFile::open(&place.0).unwrap();
        let names = kept.into_iter().map(|one| one.begin.key);
        names.collect::<Vec<_>>()
    };
    assert_eq!(names(row("old", now - day) + &row("new", now)), ["new"]);
    let many = (0..KEYS_MAX + 9).map(|n| row(&n.to_string(), now));
    let kept = names(many.collect());
    assert_eq!((kept.len(), kept[0].as_str()), (KEYS_MAX, "9"));
}

#[tokio::test]
async fn the_file_does_not_grow_for_ever() {
    let place = Place::new("file");
    let keys = place.keys();
    let long = "x".repeat(60_000);
    for number in 0..120 {
        let answer = told(&long);
        let key = named("same", "li", &number.to_string());
        let end = keys.carry_out(key, async move { answer }).await;
        assert!(end.is_ok());
        lock(&keys.known).keys.clear();
    }
    let len = std::fs::metadata(place.0.join(NAME)).unwrap().len();
    assert!(len < 2 * SLACK, "{len}");
}

#[tokio::test]
async fn without_a_disk_nothing_is_done_under_a_key() {
    let place = Place::new("none");
    std::fs::write(&place.0, "a file, no folder").unwrap();
    for keys in [Once::open(Some(&place.0)), Once::open(None)] {
        let refused = ask(&keys, "a", "li", "k1", "1").await;
        assert!(
            matches!(refused, Err(KeyRefusal::NotKept(_))),
            "{refused:?}"
        );
    }
    std::fs::remove_file(&place.0).unwrap();
}

/// Whatever is refused meanwhile: what was carried out is not carried out again after it.
#[tokio::test]
async fn a_disk_that_refuses_for_long_makes_no_key_forgotten() {
    let place = Place::new("refuses");
    let keys = place.keys();
    ask(&keys, "a", "li", "k1", "1").await.unwrap();
    let file = Arc::clone(keys.file.as_ref().unwrap());
    let read_only = File::open(place.0.join(NAME)).unwrap();
    let whole = std::mem::replace(&mut lock(&file).file, read_only);
    for number in 0..=KEYS_MAX {
        let refused = ask(&keys, &number.to_string(), "li", "k1", "2").await;
        assert!(matches!(refused, Err(KeyRefusal::NotKept(_))));
    }
    lock(&file).file = whole;
    let again = ask(&keys, "a", "li", "k1", "2").await;
    assert_eq!(again, Ok(told("1")));
}

#[tokio::test]
async fn a_key_has_a_length() {
    let place = Place::new("length");
    let keys = place.keys();
    let long = "k".repeat(KEY_LEN_MAX + 1);
    for (key, is_one) in [("", false), (&long[1..], true), (&long[..], false)] {
        let end = ask(&keys, key, "li", "k1", "1").await;
        assert_eq!(end.is_ok(), is_one, "{key}: {end:?}");
    }
}
