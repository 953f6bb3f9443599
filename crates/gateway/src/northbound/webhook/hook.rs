//! One webhook at work: what waits for it, and what is tried again and when.

use super::request::Failed;
use crate::northbound::supervisor::OutletCounts;
use railbus_api::problem::Problem;
use railbus_store::history::Event;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::Instant;

/// How many events wait for one webhook before the oldest are dropped.
pub(super) const QUEUE_MAX: usize = 256;
/// How often an event is tried.
const TRIES_MAX: u32 = 10;
/// The longest wait between two tries, and the longest time of all of them.
const WAIT_MAX: Duration = Duration::from_secs(300);
const AGE_MAX: Duration = Duration::from_secs(3_600);
/// Events about webhooks themselves. They are not sent by webhooks: it would never end.
const OWN: [&str; 2] = ["webhook_fails", "webhook_works"];

/// Whether an event is about webhooks themselves.
pub(super) fn is_own(event: &Event) -> bool {
    event
        .code
        .as_deref()
        .is_some_and(|code| OWN.contains(&code))
}

/// After which time an event is tried again that was tried so often, the first time so long ago.
fn again(failed: &Failed, tries: u32, passed: Duration) -> Option<Duration> {
    let asked = match failed {
        // A receiver that is busy or broken may not be so later; one that understood and refused
        // will refuse again.
        Failed::Refused(408 | 429 | 500.., wait) => *wait,
        Failed::Refused(..) => return None,
        _ => None,
    };
    let wait = Duration::from_secs(1 << tries.saturating_sub(1).min(9));
    let wait = wait.max(asked.unwrap_or_default()).min(WAIT_MAX);
    (tries < TRIES_MAX && passed + wait <= AGE_MAX).then_some(wait)
}

/// What came of a try.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Tried {
    Delivered,
    /// Why not, how often the event was tried, and when it is tried again, if at all.
    Failed(Problem, u32, Option<Duration>),
}

/// A webhook.
pub(super) struct Hook<'c> {
    now: Mutex<Now>,
    counts: &'c OutletCounts,
    /// Something waits.
    news: Notify,
    /// It has another address.
    changed: Notify,
}

struct Now {
    url: String,
    queue: VecDeque<Arc<Event>>,
    /// One event is on its way.
    is_trying: bool,
    /// The last try failed.
    is_failing: bool,
}

fn more(count: &AtomicU64, by: u64) {
    count.fetch_add(by, Relaxed);
}

impl Hook<'_> {
    pub(super) fn new<'c>(url: &str, counts: &'c OutletCounts) -> Hook<'c> {
        Hook {
            now: Mutex::new(Now {
                url: url.to_owned(),
                queue: VecDeque::new(),
                is_trying: false,
                is_failing: false,
            }),
            counts,
            news: Notify::new(),
            changed: Notify::new(),
        }
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts what waits.
    fn count(&self, now: &Now) {
        let waiting = now.queue.len() + usize::from(now.is_trying);
        self.counts.queue.store(waiting, Relaxed);
    }

    /// Was configured anew. What waits for a try is tried at once.
    pub(super) fn set(&self, url: &str) {
        url.clone_into(&mut self.now().url);
        self.changed.notify_waiters();
    }

    /// Has one more event to send.
    pub(super) fn push(&self, event: Arc<Event>) {
        let mut now = self.now();
        if now.queue.len() >= QUEUE_MAX {
            now.queue.pop_front();
            more(&self.counts.dropped, 1);
        }
        now.queue.push_back(event);
        self.count(&now);
        drop(now);
        self.news.notify_one();
    }

    /// So many events were missed before it was known whether they are for it.
    pub(super) fn missed(&self, count: u64) {
        more(&self.counts.dropped, count);
    }

    /// Whether anything waits that is likely to be delivered.
    pub(super) fn delivers(&self) -> bool {
        let now = self.now();
        (now.is_trying || !now.queue.is_empty()) && !now.is_failing
    }

    /// The next event, as soon as there is one.
    async fn next(&self) -> Arc<Event> {
        loop {
            {
                let mut now = self.now();
                let event = now.queue.pop_front();
                now.is_trying = event.is_some();
                self.count(&now);
                if let Some(event) = event {
                    return event;
                }
            }
            self.news.notified().await;
        }
    }

    /// Delivers one event after the other, and never returns. The result of each attempt goes to
    /// `tell`.
    pub(super) async fn work(
        &self,
        send: impl AsyncFn(String, Arc<Event>) -> Result<u16, Failed>,
        tell: impl Fn(Tried),
    ) {
        loop {
            let event = self.next().await;
            let begun = Instant::now();
            let mut tries = 0;
            loop {
                tries += 1;
                let url = self.now().url.clone();
                let end = send(url, Arc::clone(&event)).await;
                let tried = self.note(end, tries, begun.elapsed());
                let wait = match &tried {
                    Tried::Failed(_, _, wait) => *wait,
                    Tried::Delivered => None,
                };
                tell(tried);
                let Some(wait) = wait else {
                    break;
                };
                tokio::select! {
                    () = tokio::time::sleep(wait) => {}
                    () = self.changed.notified() => {}
                }
            }
        }
    }

    /// Counts what came of a try.
    fn note(&self, end: Result<u16, Failed>, tries: u32, passed: Duration) -> Tried {
        self.now().is_failing = end.is_err();
        let Err(failed) = end else {
            more(&self.counts.sent, 1);
            return Tried::Delivered;
        };
        let wait = again(&failed, tries, passed);
        match (wait, &failed) {
            (Some(_), _) => {}
            (None, Failed::Refused(status, _)) if *status < 500 => more(&self.counts.refused, 1),
            (None, _) => more(&self.counts.given_up, 1),
        }
        Tried::Failed(failed.problem(), tries, wait)
    }
}

#[cfg(test)]
mod tests;
