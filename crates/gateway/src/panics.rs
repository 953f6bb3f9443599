//! How many parts of the program have panicked.

use std::panic::{set_hook, take_hook};
use std::sync::Once;
use std::sync::atomic::{AtomicU64, Ordering};

static PANICS: AtomicU64 = AtomicU64::new(0);

/// Counts panics from now on. They are reported as before.
pub(crate) fn count_them() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let report = take_hook();
        set_hook(Box::new(move |panic| {
            PANICS.fetch_add(1, Ordering::Relaxed);
            report(panic);
        }));
    });
}

/// How many there were.
#[cfg_attr(
    not(any(test, feature = "fleet")),
    expect(dead_code, reason = "nothing else judges by it")
)]
pub(crate) fn count() -> u64 {
    PANICS.load(Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_counted_where_a_thread_has_ended_by_it() {
        count_them();
        let before = count();
        let ended = std::thread::spawn(|| panic!("on purpose")).join();
        assert!(ended.is_err() && count() > before);
    }
}
