//! The events of a site, one by one, for a subscriber.

use super::convert;
use railbus_api::types::{Quality, Reason, Value, WatchEvent};
use railbus_site::{Batch, Follower, News, Picture, PointStatus, Service, paths};
use std::collections::{BTreeMap, VecDeque};

/// A subscriber of a site. Its backlog is bounded: the site keeps a limited number of batches and
/// drops the oldest, and here the events of one are pending.
#[derive(Debug)]
pub struct Watching {
    service: Service,
    selectors: Vec<String>,
    follower: Follower,
    waiting: VecDeque<WatchEvent>,
    /// The value and quality last reported, by path.
    told: BTreeMap<String, (Option<Value>, Quality, Option<Reason>)>,
}

impl Watching {
    /// Starts with the state of every point.
    pub fn new(service: Service, selectors: &[String]) -> Watching {
        Watching {
            follower: service.follow(),
            service,
            selectors: selectors.to_vec(),
            waiting: VecDeque::new(),
            told: BTreeMap::new(),
        }
    }

    /// The next event; `None` once the site has gone. Cancel-safe.
    pub async fn next(&mut self) -> Option<WatchEvent> {
        loop {
            if let Some(event) = self.waiting.pop_front() {
                return Some(event);
            }
            match self.follower.next().await? {
                News::Picture(picture) => self.take_picture(&picture),
                News::Batch(batch) => self.take_batch(&batch),
            }
        }
    }

    fn take_picture(&mut self, picture: &Picture) {
        match self.follower.missed() {
            // The beginning, or another configuration: everything is sent.
            0 => self.told.clear(),
            dropped => self.waiting.push_back(WatchEvent::Gap { dropped }),
        }
        for status in &picture.points {
            self.tell(status);
        }
    }

    fn take_batch(&mut self, batch: &Batch) {
        for status in &batch.lines {
            let line = convert::line(status.clone());
            self.waiting.push_back(WatchEvent::Line { line });
        }
        for status in &batch.modules {
            let module = convert::module(&self.service, status.clone());
            self.waiting.push_back(WatchEvent::Module { module });
        }
        for reading in &batch.points {
            self.tell(&reading.status);
        }
    }

    /// Reports a point unless nothing has changed.
    fn tell(&mut self, status: &PointStatus) {
        if !paths::selects(&self.selectors, &status.module, &status.label) {
            return;
        }
        let point = convert::point(status.clone());
        let now = (point.value, point.quality, point.reason);
        let before = self.told.insert(point.path.clone(), now);
        if before != Some(now) {
            let before = before.and_then(|(value, ..)| value);
            self.waiting.push_back(WatchEvent::Point { point, before });
        }
    }
}
