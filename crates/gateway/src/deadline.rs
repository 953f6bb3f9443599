//! The end of the daemon comes in time, whatever hangs.

use std::sync::mpsc;
use std::time::Duration;

/// From being told to end to the end.
///
/// What is waited for until then has bounds of its own: connections 0.6 s, the release of pulses
/// and leases 1.4 s, policies 1.2 s, what is under way on the lines 1 s, webhooks 0.5 s. Together
/// that is less, so only what has no bound is ever cut off: a disk or a driver that hangs.
pub(super) const END_MAX: Duration = Duration::from_secs(5);

/// Does this when the time has passed, unless the program has ended by then. It is a thread of its
/// own, for whatever hangs may be what all the rest waits for.
pub(super) fn after(time: Duration, cut_off: impl FnOnce() + Send + 'static) {
    let watch = move || {
        let (_never, ended) = mpsc::channel::<()>();
        let _ = ended.recv_timeout(time);
        cut_off();
    };
    // Where there are no threads left, the bounds of each part must do.
    let _ = std::thread::Builder::new()
        .name("deadline".to_owned())
        .spawn(watch);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_comes_while_the_rest_hangs() {
        let (sender, cut_off) = mpsc::channel();
        after(Duration::from_millis(20), move || sender.send(()).unwrap());
        // Nothing else runs meanwhile.
        assert!(cut_off.recv().is_ok());
    }
}
