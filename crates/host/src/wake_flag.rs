//! A waker that remembers that it was called.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Wake, Waker};

/// Wakes a task and remembers that it did. A source that is seldom ready is polled with this waker,
/// and only when the flag is set: bytes are most of what wakes a line's task, and asking the alarm
/// and the jobs each time would cost more than reading them.
#[derive(Debug)]
pub(crate) struct WakeFlag {
    shared: Arc<Shared>,
    waker: Waker,
    /// A copy of the shared one, to compare with: the task is hardly ever another.
    task: Waker,
}

#[derive(Debug)]
struct Shared {
    is_set: AtomicBool,
    task: Mutex<Waker>,
}

impl WakeFlag {
    /// A flag that is set: nothing was polled with its waker yet.
    pub(crate) fn new() -> WakeFlag {
        let shared = Arc::new(Shared {
            is_set: AtomicBool::new(true),
            task: Mutex::new(Waker::noop().clone()),
        });
        let waker = Waker::from(Arc::clone(&shared));
        WakeFlag {
            shared,
            waker,
            task: Waker::noop().clone(),
        }
    }

    /// The waker that sets it.
    pub(crate) const fn waker(&self) -> &Waker {
        &self.waker
    }

    /// Sets it, where what it stands for has to be polled again without being woken.
    pub(crate) fn set(&self) {
        self.shared.is_set.store(true, Ordering::Release);
    }

    /// Whether it was set, and clears it; from now on this task is woken when it is set.
    pub(crate) fn take(&mut self, cx: &Context<'_>) -> bool {
        // In this order: whoever sets the flag too late to be seen here wakes this task.
        if !self.task.will_wake(cx.waker()) {
            self.task.clone_from(cx.waker());
            self.shared.lock().clone_from(cx.waker());
        }
        self.shared.is_set.swap(false, Ordering::AcqRel)
    }
}

impl Shared {
    fn lock(&self) -> std::sync::MutexGuard<'_, Waker> {
        self.task.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wake for Shared {
    fn wake(self: Arc<Shared>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Shared>) {
        self.is_set.store(true, Ordering::Release);
        self.lock().wake_by_ref();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    #[derive(Default)]
    struct Count(AtomicUsize);

    impl Wake for Count {
        fn wake(self: Arc<Count>) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn it_is_taken_once_and_wakes_the_task_that_took_it_last() {
        let counts = [(); 2].map(|()| Arc::new(Count::default()));
        let wakers = counts
            .each_ref()
            .map(|count| Waker::from(Arc::clone(count)));
        let takes =
            |flag: &mut WakeFlag, task: usize| flag.take(&Context::from_waker(&wakers[task]));
        let mut flag = WakeFlag::new();
        assert!(takes(&mut flag, 0) && !takes(&mut flag, 0));
        flag.waker().wake_by_ref();
        assert!(takes(&mut flag, 1) && !takes(&mut flag, 1));
        let waker = flag.waker().clone();
        waker.wake();
        flag.set();
        assert!(takes(&mut flag, 1) && !takes(&mut flag, 1));
        assert_eq!(counts.map(|count| count.0.load(Ordering::Relaxed)), [1, 1]);
    }
}
