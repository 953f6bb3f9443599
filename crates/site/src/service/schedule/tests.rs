//! What is to be done later, on a disk that works and on one that does not.

use super::*;
use railbus_device::Point;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Wake, Waker};

fn place(index: u8) -> Place {
    let kind = PointKind::Output;
    Place::new("oven", Point { kind, index })
}

const HOUR: Duration = Duration::from_secs(3_600);

fn after(seconds: u64) -> Promise {
    Promise::after(Duration::from_secs(seconds), Some(false))
}

#[tokio::test]
async fn what_is_promised_outlives_who_promised_it() {
    let folder = std::env::temp_dir().join(format!("railbus-schedule-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let schedule = Schedule::open(&folder, Boards::new()).unwrap();
    let _pulse = schedule.add((place(0), Why::Pulse), after(60));
    let _lease = schedule.add((place(1), Why::Lease), after(60));
    schedule
        .must_stay_off(vec![(place(2), Duration::from_secs(9))])
        .await;
    schedule.take_over(&[place(1)], None).await.unwrap();

    let again = Schedule::open(&folder, Boards::new()).unwrap();
    let keys: Vec<Key> = again.take_up().into_iter().map(|(key, ..)| key).collect();
    assert_eq!(keys, [(place(0), Why::Pulse)]);
    assert_eq!(again.off()[0].0, place(2));
    let left = again.left(&place(0)).pulse.unwrap();
    assert!(left <= Duration::from_secs(60) && left > Duration::from_secs(30));

    std::fs::write(folder.join("promises.json"), "{").unwrap();
    assert!(
        Schedule::open(&folder, Boards::new())
            .unwrap()
            .take_up()
            .is_empty()
    );
    assert!(folder.join("promises.json.unreadable").exists());
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A lease that stays as it is ends nothing: the pulse beside it does.
#[tokio::test]
async fn only_what_ends_in_a_state_has_another_end() {
    let schedule = Schedule::default();
    let _lease = schedule.add((place(0), Why::Lease), Promise::after(HOUR, None));
    let pulse = schedule.add((place(0), Why::Pulse), after(60));
    assert!(!schedule.has_other_end(pulse.number, &place(0), Some(false)));
    let _lease = schedule.add((place(0), Why::Lease), Promise::after(HOUR, Some(true)));
    assert!(schedule.has_other_end(pulse.number, &place(0), Some(false)));
}

/// The end of an older pulse is not the end of a newer one.
#[tokio::test]
async fn whoever_takes_an_output_over_leaves_the_others_without_an_end() {
    let schedule = Schedule::default();
    let key = (place(0), Why::Pulse);
    let mut older = schedule.add(key.clone(), after(9));
    let newer = schedule.add(key.clone(), after(9));
    let owner = Some((newer.number, after(60)));
    schedule.take_over(&[place(0)], owner).await.unwrap();
    assert!(older.due.changed().await.is_err(), "it is not to be done");
    assert_eq!(schedule.time_of(older.number), Time::Over);
    assert_eq!(schedule.time_of(newer.number), Time::NotYet);
    assert!(schedule.due(&key) > Some(Duration::from_secs(30)));
    assert_eq!(schedule.held(|_| true).len(), 1);
}

/// The disk refuses a takeover, and takes it with what somebody else keeps, just then.
#[test]
fn a_takeover_beside_another_keep_is_done_or_refused_and_never_half() {
    let folder = std::env::temp_dir().join(format!("railbus-beside-{}", std::process::id()));
    let draft = folder.join("promises.json.new");
    let schedule = Arc::new(Schedule::open(&folder, Boards::new()).unwrap());
    let pulse = schedule.add((place(0), Why::Pulse), after(60));
    let run = tokio::runtime::Builder::new_current_thread;
    // The disk is slow for as long as its one thread is held up.
    let slow = run().max_blocking_threads(1).build().unwrap();
    slow.block_on(schedule.keep()).unwrap();
    std::fs::create_dir(&draft).unwrap();
    let (go_on, held_up) = std::sync::mpsc::channel::<()>();
    slow.spawn_blocking(move || held_up.recv());

    let own = Arc::clone(&schedule);
    let woken = Arc::new(Woken::default());
    let waker = Waker::from(Arc::clone(&woken));
    let mut taking = Box::pin(async move { own.take_over(&[place(0)], None).await });
    let on_slow = slow.enter();
    let first = taking.as_mut().poll(&mut Context::from_waker(&waker));
    drop(on_slow);
    assert!(first.is_pending(), "it is being written");
    go_on.send(()).unwrap();
    while !woken.0.load(Ordering::SeqCst) {
        std::thread::yield_now();
    }
    std::fs::remove_dir(&draft).unwrap();
    // The other one waits for the file already, and nothing is taken back before it is there.
    let mut actions = lock(&schedule.actions);
    let newest = (actions.version, actions.promises());
    let mut beside = Box::pin(schedule.file.write(actions.version, || newest));
    let waits = beside.as_mut().poll(&mut Context::from_waker(&waker));
    assert!(waits.is_pending(), "the file is taken");
    let taking = std::thread::spawn(move || run().build().unwrap().block_on(taking));
    let beside = std::thread::scope(|scope| {
        let writing = scope.spawn(move || run().build().unwrap().block_on(beside));
        writing.join().unwrap().unwrap()
    });
    let gone = |_: &u64, action: &mut Action| action.left_out.is_some_and(|at| at <= beside);
    actions.by_number.extract_if(.., gone).for_each(drop);
    drop(actions);

    let end = taking.join().unwrap();
    let is_there = schedule.time_of(pulse.number) != Time::Over;
    let again = Schedule::open(&folder, Boards::new()).unwrap();
    let is_kept = !again.take_up().is_empty();
    // Where it is refused, that is said with the words that the pulse ends still.
    assert_eq!((is_there, is_kept), (end.is_err(), end.is_err()), "{end:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[derive(Default)]
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Woken>) {
        self.0.store(true, Ordering::SeqCst);
    }
}

/// A disk that refuses for days does not fill the memory.
#[tokio::test]
async fn what_can_not_be_written_down_does_not_pile_up() {
    let folder = std::env::temp_dir().join(format!("railbus-piles-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("promises.json.new")).unwrap();
    let schedule = Schedule::open(&folder, Boards::new()).unwrap();
    for _ in 0..100 {
        let _limit = schedule.add((place(0), Why::MaxOn), after(9));
        assert!(schedule.keep().await.is_err());
        schedule.leave_out(|_| true);
    }
    assert!(lock(&schedule.actions).by_number.len() <= 2);
    std::fs::remove_dir_all(&folder).unwrap();
}
