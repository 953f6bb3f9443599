//! Updates for subscribers.

use crate::PointChange;
use crate::config::Place;
use tokio::sync::broadcast;

/// Something changed.
#[derive(Clone, Debug, PartialEq)]
pub enum Update {
    /// A point got another value.
    Point(PointChange),
    /// A point has another quality: its value became stale, or was read again; its module is
    /// silent or back; its line was lost or lent.
    Quality(Place),
    /// A module is heard, or no longer.
    Module(String),
    /// A line's port changed, or a babble began or ended.
    Line(String),
    /// There is another configuration.
    Reloaded,
    /// This subscriber was too slow: so many updates before the next one are lost to it.
    Gap(u64),
}

/// A subscriber's end.
#[derive(Debug)]
pub struct Updates(broadcast::Receiver<Update>);

impl Updates {
    pub(super) const fn new(receiver: broadcast::Receiver<Update>) -> Updates {
        Updates(receiver)
    }

    /// The next update; none once the site has gone. Can be dropped and called again without
    /// losing anything.
    pub async fn next(&mut self) -> Option<Update> {
        match self.0.recv().await {
            Ok(update) => Some(update),
            Err(broadcast::error::RecvError::Lagged(count)) => Some(Update::Gap(count)),
            Err(broadcast::error::RecvError::Closed) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_slow_subscriber_is_told_of_the_gap() {
        let sender = broadcast::Sender::new(4);
        let mut updates = Updates::new(sender.subscribe());
        for number in 0..7 {
            sender.send(Update::Module(number.to_string())).unwrap();
        }
        assert_eq!(updates.next().await, Some(Update::Gap(3)));
        assert_eq!(updates.next().await, Some(Update::Module("3".to_owned())));
        drop(sender);
        for _ in 0..3 {
            assert!(updates.next().await.is_some());
        }
        assert_eq!(updates.next().await, None);
    }
}
