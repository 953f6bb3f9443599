//! One webhook at work: what waits for it, what is tried again and when, and what came of it.

use super::request::Failed;
use jiff::Timestamp;
use railbus_api::webhooks::WebhookError;
use railbus_site::config::Webhook;
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::time::rfc3339;
use std::collections::VecDeque;
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
/// After so many tries that failed in a row, it is told as an event.
const TOLD_AFTER: u32 = 3;
/// What is told of a webhook itself. No webhook is told of it: it would never end.
const FAILS: &str = "webhook_fails";
const WORKS: &str = "webhook_works";

/// Whether an event is about webhooks themselves.
pub(super) fn is_own(event: &Event) -> bool {
    matches!(event.code.as_deref(), Some(FAILS | WORKS))
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

/// What came of everything so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Figures {
    /// Events that were taken.
    pub(super) delivered: u64,
    /// Events that the receiver refused for good.
    pub(super) refused: u64,
    /// Events that were tried as often as they may be.
    pub(super) given_up: u64,
    /// Events that were never tried, or not to the end, because too many waited.
    pub(super) dropped: u64,
    pub(super) last: Option<Timestamp>,
    pub(super) error: Option<WebhookError>,
    /// How many tries in a row have failed.
    pub(super) in_a_row: u32,
}

/// A webhook.
pub(super) struct Hook {
    name: String,
    now: Mutex<Now>,
    /// Something waits.
    news: Notify,
    /// It was configured anew.
    changed: Notify,
}

struct Now {
    wish: Webhook,
    queue: VecDeque<Arc<Event>>,
    /// One event is on its way.
    is_trying: bool,
    is_told: bool,
    figures: Figures,
}

impl Hook {
    pub(super) fn new(name: &str, wish: Webhook) -> Hook {
        Hook {
            name: name.to_owned(),
            now: Mutex::new(Now {
                wish,
                queue: VecDeque::new(),
                is_trying: false,
                is_told: false,
                figures: Figures::default(),
            }),
            news: Notify::new(),
            changed: Notify::new(),
        }
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Is configured so from now on. What waits for a try is tried at once.
    pub(super) fn set(&self, wish: Webhook) {
        let mut now = self.now();
        if now.wish == wish {
            return;
        }
        if !wish.enabled {
            now.queue.clear();
        }
        now.wish = wish;
        drop(now);
        self.changed.notify_waiters();
    }

    /// Has one more event to tell.
    pub(super) fn push(&self, event: Arc<Event>) {
        let mut now = self.now();
        if now.queue.len() >= QUEUE_MAX {
            now.queue.pop_front();
            now.figures.dropped += 1;
        }
        now.queue.push_back(event);
        drop(now);
        self.news.notify_one();
    }

    /// So many events were missed before it was known whether they are for it.
    pub(super) fn missed(&self, count: u64) {
        self.now().figures.dropped += count;
    }

    /// What came of everything, and how many events wait.
    pub(super) fn figures(&self) -> (Figures, usize) {
        let now = self.now();
        let waiting = now.queue.len() + usize::from(now.is_trying);
        (now.figures.clone(), waiting)
    }

    /// The next event, as soon as there is one.
    async fn next(&self) -> Arc<Event> {
        loop {
            {
                let mut now = self.now();
                now.is_trying = false;
                if let Some(event) = now.queue.pop_front() {
                    now.is_trying = true;
                    return event;
                }
            }
            self.news.notified().await;
        }
    }

    /// The address, where anything is to be sent at all.
    fn url(&self) -> Option<String> {
        let now = self.now();
        now.wish.enabled.then(|| now.wish.url.clone())
    }

    /// Delivers one event after the other, for ever. What is to be told as an event of the site
    /// goes to `tell`.
    pub(super) async fn work<F>(
        self: Arc<Hook>,
        send: impl Fn(String, Arc<Event>) -> F,
        tell: impl Fn(Event),
    ) where
        F: Future<Output = Result<u16, Failed>>,
    {
        loop {
            let event = self.next().await;
            let begun = Instant::now();
            let mut tries = 0;
            while let Some(url) = self.url() {
                tries += 1;
                let end = send(url, Arc::clone(&event)).await;
                let (wait, news) = self.note(end, tries, begun.elapsed());
                news.into_iter().for_each(&tell);
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

    /// Notes what came of a try: when the next one is, and what is to be told.
    fn note(
        &self,
        end: Result<u16, Failed>,
        tries: u32,
        passed: Duration,
    ) -> (Option<Duration>, Option<Event>) {
        let mut now = self.now();
        let Err(failed) = end else {
            now.figures.delivered += 1;
            now.figures.last = Some(Timestamp::now());
            now.figures.in_a_row = 0;
            let was_told = std::mem::replace(&mut now.is_told, false);
            return (None, was_told.then(|| self.event(Severity::Info, WORKS)));
        };
        let wait = again(&failed, tries, passed);
        let problem = failed.problem();
        let code = problem.code.clone();
        let figures = &mut now.figures;
        figures.in_a_row = figures.in_a_row.saturating_add(1);
        figures.error = Some(WebhookError {
            at: rfc3339(Timestamp::now()),
            tries,
            problem,
        });
        match (wait, &failed) {
            (Some(_), _) => {}
            (None, Failed::Refused(status, _)) if *status < 500 => figures.refused += 1,
            (None, _) => figures.given_up += 1,
        }
        let is_news = wait.is_none() || figures.in_a_row >= TOLD_AFTER;
        let was_told = now.is_told;
        now.is_told |= is_news;
        let event = (is_news && !was_told).then(|| self.event(Severity::Warning, FAILS).text(code));
        (wait, event)
    }

    fn event(&self, severity: Severity, code: &str) -> Event {
        Event::new(EventKind::System, severity, code).what(&self.name)
    }
}

#[cfg(test)]
mod tests;
