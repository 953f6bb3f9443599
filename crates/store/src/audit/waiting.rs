//! Who waits for a record of the log.

use super::NotWritten;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What is to be done once a record is written, or is not waited for any longer. It is called on
/// the thread of the log, or of whoever gives up: it must not wait for either.
pub type Then = Box<dyn FnOnce(Result<(), NotWritten>) + Send>;

/// Those who wait for a record of the log. They are called once, in their order: by the log's
/// thread, or by [`Waiting::give_up`], whichever is first.
#[derive(Clone)]
pub struct Waiting(Arc<Mutex<Queue>>);

struct Queue {
    thens: Vec<Then>,
    /// How it ended; they are being called, or have been.
    end: Option<Result<(), NotWritten>>,
    /// All have been called.
    is_over: bool,
}

impl std::fmt::Debug for Waiting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Waiting")
            .field("end", &self.queue().end)
            .finish_non_exhaustive()
    }
}

impl Waiting {
    pub(super) fn new(then: Then) -> Waiting {
        Waiting(Arc::new(Mutex::new(Queue {
            thens: vec![then],
            end: None,
            is_over: false,
        })))
    }

    /// Has this called behind all others that wait for the record.
    ///
    /// # Errors
    /// It comes back where they all have been called.
    pub fn also(&self, then: Then) -> Result<(), Then> {
        let mut queue = self.queue();
        if queue.is_over {
            return Err(then);
        }
        queue.thens.push(then);
        Ok(())
    }

    /// Waits no longer: the record counts as not written, unless the log was faster. What waits is
    /// called before this returns, unless the log's thread is calling it.
    pub fn give_up(&self) {
        self.end(Err(NotWritten));
    }

    /// Whether all who waited have been called.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.queue().is_over
    }

    pub(super) fn end(&self, end: Result<(), NotWritten>) {
        let mut queue = self.queue();
        if queue.end.is_some() {
            return;
        }
        queue.end = Some(end);
        while !queue.thens.is_empty() {
            let thens = std::mem::take(&mut queue.thens);
            // What is called may ask for more.
            drop(queue);
            for then in thens {
                // One that panics, which standard error reports, affects neither the others nor
                // the log.
                let _ = catch_unwind(AssertUnwindSafe(|| then(end)));
            }
            queue = self.queue();
        }
        queue.is_over = true;
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn all_are_called_once_and_in_their_order() {
        let (told, calls) = mpsc::channel();
        let then = |number: u8| -> Then {
            let told = told.clone();
            Box::new(move |end| told.send((number, end)).unwrap())
        };
        let waiting = Waiting::new(then(1));
        assert!(waiting.also(then(2)).is_ok());
        assert!(!waiting.is_over());
        waiting.end(Ok(()));
        waiting.give_up();
        assert!(waiting.is_over());
        assert!(waiting.also(then(3)).is_err());
        assert_eq!(
            calls.try_iter().collect::<Vec<_>>(),
            [(1, Ok(())), (2, Ok(()))]
        );
    }

    #[test]
    fn who_comes_while_others_are_called_is_called_after_them() {
        let (told, calls) = mpsc::channel();
        let waiting = Waiting::new(Box::new(|_| {}));
        let (same, late) = (waiting.clone(), told.clone());
        let first = move |end| {
            let then = Box::new(move |end| late.send((2, end)).unwrap());
            assert!(same.also(then).is_ok());
            told.send((1, end)).unwrap();
        };
        assert!(waiting.also(Box::new(first)).is_ok());
        waiting.give_up();
        let all: Vec<_> = calls.try_iter().collect();
        assert_eq!(all, [(1, Err(NotWritten)), (2, Err(NotWritten))]);
    }

    #[test]
    fn one_that_panics_keeps_nobody_from_the_result() {
        let (told, calls) = mpsc::channel();
        let waiting = Waiting::new(Box::new(|_| panic!("for the test")));
        assert!(
            waiting
                .also(Box::new(move |end| told.send(end).unwrap()))
                .is_ok()
        );
        waiting.end(Ok(()));
        assert_eq!(calls.try_iter().collect::<Vec<_>>(), [Ok(())]);
    }
}
