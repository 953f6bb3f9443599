//! Commands begin in the order in which they came, also where one of them has to be written down
//! first.

use std::collections::BTreeSet;
use std::future::poll_fn;
use std::pin::pin;
use tokio::sync::oneshot;

/// Whose turn it is.
#[derive(Debug, Default)]
pub(super) struct Turns {
    /// Resolves when the last command has begun, or has ended without that.
    last: Option<oneshot::Receiver<()>>,
    /// The keys of those under way.
    keys: BTreeSet<String>,
}

/// The turn of a command.
#[derive(Debug, Default)]
pub(super) struct Turn {
    before: Option<oneshot::Receiver<()>>,
    begun: Begun,
}

/// Tells the next one when it is dropped.
#[derive(Debug, Default)]
pub(super) struct Begun(
    #[expect(dead_code, reason = "it speaks by being dropped")] Option<oneshot::Sender<()>>,
);

impl Turns {
    /// The turn of a command that has come. One that is under way already, by its key, does not
    /// begin: the next one need not wait until it has its result.
    pub(super) fn next(&mut self, key: Option<&str>) -> Turn {
        if key.is_some_and(|key| !self.keys.insert(key.to_owned())) {
            return Turn::default();
        }
        let (begun, waits) = oneshot::channel();
        Turn {
            before: self.last.replace(waits),
            begun: Begun(Some(begun)),
        }
    }

    /// A command with this key has ended.
    pub(super) fn ended(&mut self, key: Option<&str>) {
        if let Some(key) = key {
            self.keys.remove(key);
        }
    }
}

impl Turn {
    /// Waits until it is its turn.
    pub(super) async fn come(self) -> Begun {
        if let Some(before) = self.before {
            // Fails where that one ended before it began.
            let _ = before.await;
        }
        self.begun
    }
}

impl Begun {
    /// Does it. The site has a command with the first step of its future.
    pub(super) async fn with<T>(self, work: impl Future<Output = T>) -> T {
        let (mut work, mut begun) = (pin!(work), Some(self));
        poll_fn(|context| {
            let end = work.as_mut().poll(context);
            begun = None;
            end
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    #[tokio::test]
    async fn commands_begin_in_the_order_in_which_they_came() {
        let (mut turns, order) = (Turns::default(), Arc::new(Mutex::new(Vec::new())));
        let (disk, written) = oneshot::channel::<()>();
        let slow = turns.next(Some("a"));
        let fast = turns.next(None);
        let (to, also) = (Arc::clone(&order), Arc::clone(&order));
        let slow = async move {
            let begun = slow.come().await;
            written.await.unwrap();
            let work = async move {
                to.lock().unwrap().push("slow");
                std::future::pending::<()>().await;
            };
            begun.with(work).await;
        };
        let slow = tokio::spawn(slow);
        let fast = tokio::spawn(async move {
            let begun = fast.come().await;
            begun
                .with(async move { also.lock().unwrap().push("fast") })
                .await;
        });
        tokio::task::yield_now().await;
        assert!(order.lock().unwrap().is_empty());
        disk.send(()).unwrap();
        fast.await.unwrap();
        assert_eq!(*order.lock().unwrap(), ["slow", "fast"]);
        slow.abort();
    }

    #[tokio::test]
    async fn one_that_does_not_begin_holds_nobody_up() {
        let mut turns = Turns::default();
        let first = turns.next(Some("a"));
        let same = turns.next(Some("a"));
        let next = turns.next(None);
        let begun = first.come().await;
        // It waits for the result of the first, and has no turn of its own.
        let _waits = same.come().await;
        drop(begun);
        let _begun = next.come().await;
        turns.ended(Some("a"));
        assert!(turns.next(Some("a")).before.is_some());
    }
}
