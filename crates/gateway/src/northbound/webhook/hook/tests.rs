use super::*;
use railbus_store::history::{EventKind, Severity};
use std::sync::atomic::AtomicUsize;
use tokio::sync::mpsc;

fn event(id: usize) -> Arc<Event> {
    Arc::new(Event {
        id: id.to_string(),
        ..Event::new(EventKind::Alarm, Severity::Info, "x")
    })
}

/// A webhook at work in virtual time, whose receiver follows a script, which gets the time,
/// address and event of each attempt.
struct Stage {
    hook: Arc<Hook<'static>>,
    counts: &'static OutletCounts,
    tries: mpsc::UnboundedReceiver<(u64, String, String)>,
    told: mpsc::UnboundedReceiver<Tried>,
}

impl Stage {
    fn new(script: impl Fn(usize) -> Result<u16, Failed> + Send + 'static) -> Stage {
        let counts: &OutletCounts = Box::leak(Box::default());
        let hook = Arc::new(Hook::new("http://a", counts));
        let ((tried, tries), (tell, told)) = (mpsc::unbounded_channel(), mpsc::unbounded_channel());
        let begun = Instant::now();
        let count = AtomicUsize::new(0);
        let send = async move |url: String, event: Arc<Event>| {
            let seconds = begun.elapsed().as_secs();
            tried.send((seconds, url, event.id.clone())).unwrap();
            script(count.fetch_add(1, Relaxed))
        };
        let at_work = Arc::clone(&hook);
        // On this thread, as the webhook itself.
        let work = async move { at_work.work(send, |tried| tell.send(tried).unwrap()).await };
        tokio::task::spawn_local(work);
        Stage {
            hook,
            counts,
            tries,
            told,
        }
    }

    async fn next(&mut self) -> (u64, String) {
        let (at, _, id) = self.tries.recv().await.unwrap();
        (at, id)
    }

    /// Lets everything end that needs no time.
    async fn settle(&self) {
        for _ in 0..2 * QUEUE_MAX {
            tokio::task::yield_now().await;
        }
    }

    /// The reported failures: the code, the number of the attempt, and the seconds to the next.
    fn failures(&mut self) -> Vec<(String, u32, Option<u64>)> {
        let told = std::iter::from_fn(|| self.told.try_recv().ok());
        told.filter_map(|tried| match tried {
            Tried::Failed(problem, tries, wait) => {
                Some((problem.code, tries, wait.map(|wait| wait.as_secs())))
            }
            Tried::Delivered => None,
        })
        .collect()
    }
}

/// Runs this in virtual time, on one thread.
fn played(play: impl Future<Output = ()>) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .start_paused(true)
        .build()
        .unwrap();
    tokio::task::LocalSet::new().block_on(&runtime, play);
}

#[test]
fn an_event_is_tried_ten_times_and_then_the_next_has_its_turn() {
    played(async {
        let mut stage = Stage::new(|_| Err(Failed::Slow));
        stage.hook.push(event(1));
        stage.hook.push(event(2));
        let mut at = Vec::new();
        for _ in 0..10 {
            let (seconds, id) = stage.next().await;
            assert_eq!(id, "1");
            at.push(seconds);
        }
        assert_eq!(at, [0, 1, 3, 7, 15, 31, 63, 127, 255, 511]);
        assert_eq!(stage.next().await, (511, "2".to_owned()));
        stage.settle().await;
        let counts = stage.counts;
        assert_eq!(
            (counts.given_up.load(Relaxed), counts.queue.load(Relaxed)),
            (1, 1)
        );
        let told = stage.failures();
        assert_eq!(told.len(), 11);
        let slow = |tries, wait| ("E0859".to_owned(), tries, wait);
        assert_eq!(told[0], slow(1, Some(1)));
        assert_eq!(told[9..], [slow(10, None), slow(1, Some(1))]);
    });
}

#[test]
fn order_is_kept_over_a_receiver_that_fails_for_a_while() {
    played(async {
        let fails = |at: usize| {
            if at < 4 {
                Err(Failed::Refused(503, None))
            } else {
                Ok(204)
            }
        };
        let mut stage = Stage::new(fails);
        (1..=3).for_each(|id| stage.hook.push(event(id)));
        let mut seen = Vec::new();
        for _ in 0..7 {
            seen.push(stage.next().await);
        }
        let ids: Vec<&str> = seen.iter().map(|(_, id)| id.as_str()).collect();
        assert_eq!(ids, ["1", "1", "1", "1", "1", "2", "3"]);
        assert_eq!(seen[6].0, 15, "no wait once it takes them");
        stage.settle().await;
        let counts = stage.counts;
        assert_eq!(
            (counts.sent.load(Relaxed), counts.queue.load(Relaxed)),
            (3, 0)
        );
        assert_eq!(stage.failures().len(), 4);
        assert!(!stage.hook.delivers());
    });
}

#[test]
fn what_is_refused_for_good_is_not_sent_again() {
    played(async {
        let mut stage = Stage::new(|at| match at {
            0 => Err(Failed::Refused(404, None)),
            1 => Err(Failed::Refused(302, None)),
            2 => Err(Failed::Refused(429, Some(Duration::from_secs(40)))),
            3 => Err(Failed::Refused(408, None)),
            _ => Ok(200),
        });
        (1..=3).for_each(|id| stage.hook.push(event(id)));
        let mut seen = Vec::new();
        for _ in 0..5 {
            seen.push(stage.next().await);
        }
        let wanted = [(0, "1"), (0, "2"), (0, "3"), (40, "3"), (42, "3")];
        assert_eq!(seen, wanted.map(|(at, id)| (at, id.to_owned())));
        stage.settle().await;
        let counts = stage.counts;
        assert_eq!(
            (counts.refused.load(Relaxed), counts.sent.load(Relaxed)),
            (2, 1)
        );
    });
}

#[test]
fn the_oldest_go_where_too_many_wait() {
    played(async {
        let mut stage = Stage::new(|at| if at == 0 { Err(Failed::Slow) } else { Ok(200) });
        stage.hook.push(event(0));
        stage.next().await;
        (1..=QUEUE_MAX + 3).for_each(|id| stage.hook.push(event(id)));
        stage.settle().await;
        let counts = stage.counts;
        let wanted = (3, QUEUE_MAX + 1);
        assert_eq!(
            (counts.dropped.load(Relaxed), counts.queue.load(Relaxed)),
            wanted
        );
        let mut ids = Vec::new();
        for _ in 0..=QUEUE_MAX {
            ids.push(stage.next().await.1);
        }
        let wanted = std::iter::once(0).chain(4..=QUEUE_MAX + 3);
        assert!(
            ids.iter().cloned().eq(wanted.map(|id| id.to_string())),
            "{ids:?}"
        );
    });
}

#[test]
fn another_address_is_tried_at_once() {
    played(async {
        let mut stage = Stage::new(|_| Err(Failed::Slow));
        stage.hook.push(event(1));
        for _ in 0..6 {
            stage.next().await;
        }
        // The next try would be in 32 s.
        stage.settle().await;
        stage.hook.set("http://b");
        let (at, url, _) = stage.tries.recv().await.unwrap();
        assert_eq!((at, url.as_str()), (31, "http://b"));
    });
}

#[test]
fn nothing_is_tried_for_longer_than_an_hour() {
    let hour = |passed| again(&Failed::Slow, 9, Duration::from_secs(passed));
    assert_eq!(hour(3_600 - 256), Some(Duration::from_secs(256)));
    assert_eq!(hour(3_600), None);
    let far = Failed::Refused(503, Some(Duration::from_secs(86_400)));
    assert_eq!(again(&far, 1, Duration::ZERO), Some(WAIT_MAX));
}
