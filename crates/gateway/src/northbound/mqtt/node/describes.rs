//! When Home Assistant is told of the modules again.

use super::super::told::ONLINE;
use super::Node;
use std::time::Duration;

/// Home Assistant drops most of a message of a module that comes while it is busy with the one
/// before: what is something else is told once more after this time.
const AGAIN_WAIT: Duration = Duration::from_secs(10);

impl Node {
    /// Home Assistant says whether it is there. After it has come back it is told all again, but
    /// not by all gateways at the same time.
    pub(super) fn told_status(&mut self, now: Duration, payload: &[u8]) {
        let Some(discovery) = self.topics.discovery() else {
            return;
        };
        let link = self.link.as_mut();
        if let Some(link) = link.filter(|_| payload == ONLINE.as_bytes()) {
            let at = now + discovery.spread();
            link.describes = Some(link.describes.map_or(at, |before| before.min(at)));
        }
    }

    /// These topics have something else now.
    pub(super) fn described(&mut self, now: Duration, changed: &[String]) {
        if let Some(link) = &mut self.link
            && self.told.describes(changed)
        {
            link.describes = Some(now + AGAIN_WAIT);
        }
    }

    /// Has Home Assistant told of all modules again, if it is time.
    pub(super) fn describe_again(&mut self, now: Duration) {
        let link = self.link.as_mut().filter(|_| !self.is_ending);
        let is_due = |link: &&mut super::Link| link.describes.is_some_and(|at| at <= now);
        if let Some(link) = link.filter(is_due) {
            link.describes = self.told.is_moving().then_some(now + AGAIN_WAIT);
            let all = self.told.described();
            all.into_iter().for_each(|topic| self.due(topic));
        }
    }
}

#[cfg(test)]
mod tests;
