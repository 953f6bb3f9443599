//! When Home Assistant is told of the modules again.

use super::super::told::ONLINE;
use super::Node;
use std::time::Duration;

impl Node {
    /// Home Assistant says whether it is there. After it has come back it is told all again, but
    /// not by all gateways at the same time.
    pub(super) fn told_status(&mut self, now: Duration, payload: &[u8]) {
        let Some(discovery) = self.topics.discovery() else {
            return;
        };
        let link = self.link.as_mut().filter(|_| !self.is_ending);
        if let Some(link) = link.filter(|_| payload == ONLINE.as_bytes()) {
            link.describes.get_or_insert(now + discovery.spread());
        }
    }

    /// Has Home Assistant told of all modules again, if it is time.
    pub(super) fn describe_again(&mut self, now: Duration) {
        let link = self.link.as_mut().filter(|_| !self.is_ending);
        let is_due = |link: &&mut super::Link| link.describes.is_some_and(|at| at <= now);
        if let Some(link) = link.filter(is_due) {
            link.describes = None;
            let all = self.told.described();
            all.into_iter().for_each(|topic| self.due(topic));
        }
    }
}

#[cfg(test)]
mod tests;
