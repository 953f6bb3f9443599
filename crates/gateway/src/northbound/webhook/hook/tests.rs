use super::*;
use std::collections::BTreeSet;
use tokio::sync::mpsc;

fn wish(url: &str, enabled: bool) -> Webhook {
    Webhook {
        url: url.to_owned(),
        events: BTreeSet::new(),
        severity: Severity::Info,
        lines: BTreeSet::new(),
        modules: BTreeSet::new(),
        enabled,
    }
}

fn event(id: usize) -> Arc<Event> {
    Arc::new(Event {
        id: id.to_string(),
        ..Event::new(EventKind::Alarm, Severity::Info, "x")
    })
}

/// A webhook at work in virtual time, whose receiver follows a script: of each try it is told
/// when it came, for which address, and with which event.
struct Stage {
    hook: Arc<Hook>,
    tries: mpsc::UnboundedReceiver<(u64, String, String)>,
    told: mpsc::UnboundedReceiver<Event>,
}

impl Stage {
    fn new(script: impl Fn(usize) -> Result<u16, Failed> + Send + 'static) -> Stage {
        let hook = Arc::new(Hook::new("alerts", wish("http://a", true)));
        let ((tried, tries), (tell, told)) = (mpsc::unbounded_channel(), mpsc::unbounded_channel());
        let begun = Instant::now();
        let count = std::sync::atomic::AtomicUsize::new(0);
        let send = move |url: String, event: Arc<Event>| {
            let seconds = begun.elapsed().as_secs();
            let end = script(count.fetch_add(1, std::sync::atomic::Ordering::Relaxed));
            tried.send((seconds, url, event.id.clone())).unwrap();
            async move { end }
        };
        tokio::spawn(Arc::clone(&hook).work(send, move |event| tell.send(event).unwrap()));
        Stage { hook, tries, told }
    }

    async fn next(&mut self) -> (u64, String) {
        let (at, _, id) = self.tries.recv().await.unwrap();
        (at, id)
    }

    /// Lets everything end that needs no time.
    async fn settle(&self) -> (Figures, usize) {
        for _ in 0..2 * QUEUE_MAX {
            tokio::task::yield_now().await;
        }
        self.hook.figures()
    }

    fn codes(&mut self) -> Vec<String> {
        let told = std::iter::from_fn(|| self.told.try_recv().ok());
        told.filter_map(|event| event.code).collect()
    }
}

#[tokio::test(start_paused = true)]
async fn an_event_is_tried_ten_times_and_then_the_next_has_its_turn() {
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
    let (figures, waiting) = stage.settle().await;
    assert_eq!((figures.given_up, figures.in_a_row, waiting), (1, 11, 1));
    let error = figures.error.unwrap();
    assert_eq!((error.tries, error.problem.code.as_str()), (1, "E0859"));
    assert_eq!(stage.codes(), [FAILS], "once, however often it fails");
}

#[tokio::test(start_paused = true)]
async fn order_is_kept_over_a_receiver_that_fails_for_a_while() {
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
    let (figures, waiting) = stage.settle().await;
    assert_eq!((figures.delivered, figures.in_a_row, waiting), (3, 0, 0));
    assert_eq!(stage.codes(), [FAILS, WORKS]);
}

#[tokio::test(start_paused = true)]
async fn what_is_refused_for_good_is_not_sent_again() {
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
    let (figures, _) = stage.settle().await;
    assert_eq!((figures.refused, figures.delivered), (2, 1));
}

#[tokio::test(start_paused = true)]
async fn the_oldest_go_where_too_many_wait() {
    let mut stage = Stage::new(|at| if at == 0 { Err(Failed::Slow) } else { Ok(200) });
    stage.hook.push(event(0));
    stage.next().await;
    (1..=QUEUE_MAX + 3).for_each(|id| stage.hook.push(event(id)));
    let (figures, waiting) = stage.settle().await;
    assert_eq!((figures.dropped, waiting), (3, QUEUE_MAX + 1));
    let mut ids = Vec::new();
    for _ in 0..=QUEUE_MAX {
        ids.push(stage.next().await.1);
    }
    let wanted = std::iter::once(0).chain(4..=QUEUE_MAX + 3);
    assert!(
        ids.iter().cloned().eq(wanted.map(|id| id.to_string())),
        "{ids:?}"
    );
}

#[tokio::test(start_paused = true)]
async fn another_address_is_tried_at_once_and_none_at_all_ends_it() {
    let mut stage = Stage::new(|_| Err(Failed::Slow));
    stage.hook.push(event(1));
    for _ in 0..6 {
        stage.next().await;
    }
    // The next try would be in 32 s.
    stage.settle().await;
    stage.hook.set(wish("http://b", true));
    let (at, url, _) = stage.tries.recv().await.unwrap();
    assert_eq!((at, url.as_str()), (31, "http://b"));
    stage.settle().await;
    stage.hook.push(event(2));
    stage.hook.set(wish("http://b", false));
    let (_, waiting) = stage.settle().await;
    assert_eq!(waiting, 0);
    assert!(stage.tries.try_recv().is_err());
}

#[test]
fn nothing_is_tried_for_longer_than_an_hour() {
    let hour = |passed| again(&Failed::Slow, 9, Duration::from_secs(passed));
    assert_eq!(hour(3_600 - 256), Some(Duration::from_secs(256)));
    assert_eq!(hour(3_600), None);
    let far = Failed::Refused(503, Some(Duration::from_secs(86_400)));
    assert_eq!(again(&far, 1, Duration::ZERO), Some(WAIT_MAX));
}
