//! When the core is to be told of the time. Whoever drives the core sets this under its lock, which
//! wakes no task; the task that tells the time is woken when the time has come.

use railbus_wire::Micros;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::time::{Instant, Sleep, sleep_until};

/// Where nothing is to be done, it is looked after that nevertheless in a year.
const FAR: Micros = Micros::from_secs(365 * 24 * 3_600);

/// The alarm of a site.
#[derive(Debug)]
pub(super) struct Alarm {
    sleep: Pin<Box<Sleep>>,
    start: Instant,
    /// The time of the site for which it is set; none once that has come.
    at: Option<Micros>,
}

impl Alarm {
    /// For a site that was started at this moment, inside a runtime.
    pub(super) fn new(start: Instant) -> Alarm {
        Alarm {
            sleep: Box::pin(sleep_until(moment(start, FAR))),
            start,
            at: Some(FAR),
        }
    }

    /// Rings at this time of the site and not before, or not at all.
    pub(super) fn set(&mut self, at: Option<Micros>) {
        let at = at.unwrap_or(FAR);
        if self.at != Some(at) {
            self.at = Some(at);
            self.sleep.as_mut().reset(moment(self.start, at));
        }
    }

    /// Whether it rings. It is to be set again before it is asked again.
    pub(super) fn poll(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        ready!(self.sleep.as_mut().poll(cx));
        self.at = None;
        Poll::Ready(())
    }
}

fn moment(start: Instant, at: Micros) -> Instant {
    start + Duration::from_micros(at.0)
}
