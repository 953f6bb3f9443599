//! The events of a site, one by one, for a subscriber.

use super::{ask, convert, paths};
use railbus_api::types::{PointInfo, Quality, Reason, Value, WatchEvent};
use railbus_site::{Service, Update, Updates};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;
use tokio::time::{Interval, MissedTickBehavior, interval};

/// Interval at which points are checked for a change of quality without a new reading.
const LOOK: Duration = Duration::from_secs(1);

/// A subscriber of a site. Its backlog is bounded: the site keeps a limited number of updates and
/// drops the oldest, and here no more events are pending than the site has points, modules and
/// lines.
#[derive(Debug)]
pub struct Watching {
    service: Service,
    selectors: Vec<String>,
    updates: Updates,
    look: Interval,
    waiting: VecDeque<WatchEvent>,
    /// The value and quality last reported, by path.
    told: BTreeMap<String, (Option<Value>, Quality, Option<Reason>)>,
}

impl Watching {
    /// Starts with the state of every point.
    pub fn new(service: Service, selectors: &[String]) -> Watching {
        let mut look = interval(LOOK);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut watching = Watching {
            updates: service.subscribe(),
            service,
            selectors: selectors.to_vec(),
            look,
            waiting: VecDeque::new(),
            told: BTreeMap::new(),
        };
        watching.look_at_all();
        watching
    }

    /// The next event; `None` once the site has gone. Cancel-safe.
    pub async fn next(&mut self) -> Option<WatchEvent> {
        loop {
            if let Some(event) = self.waiting.pop_front() {
                return Some(event);
            }
            tokio::select! {
                update = self.updates.next() => self.take(update?),
                _ = self.look.tick() => self.look_at_all(),
            }
        }
    }

    fn take(&mut self, update: Update) {
        match update {
            Update::Point(change) => {
                let status = self.service.point(&change.module, change.point);
                if let Some(status) = status {
                    self.tell(convert::point(status));
                }
            }
            Update::Module(name) => {
                if let Some(status) = self.service.module(&name) {
                    let module = convert::module(&self.service, status);
                    self.waiting.push_back(WatchEvent::Module { module });
                }
                self.look_at_all();
            }
            Update::Line(name) => {
                if let Some(status) = self.service.line(&name) {
                    let line = convert::line(status);
                    self.waiting.push_back(WatchEvent::Line { line });
                }
                self.look_at_all();
            }
            Update::Reloaded => {
                self.told.clear();
                self.look_at_all();
            }
            Update::Gap(dropped) => {
                self.waiting.push_back(WatchEvent::Gap { dropped });
                self.look_at_all();
            }
        }
    }

    fn look_at_all(&mut self) {
        for point in ask::points(&self.service, &self.selectors) {
            self.tell(point);
        }
    }

    /// Reports a point unless nothing has changed.
    fn tell(&mut self, point: PointInfo) {
        if !paths::selects(&self.selectors, &point.module, &point.label) {
            return;
        }
        let now = (point.value, point.quality, point.reason);
        let before = self.told.insert(point.path.clone(), now);
        if before != Some(now) {
            let before = before.and_then(|(value, ..)| value);
            self.waiting.push_back(WatchEvent::Point { point, before });
        }
    }
}
