//! The daemon exits in time, whatever hangs.

use std::sync::mpsc;
use std::time::Duration;

/// The most time from the signal to the exit.
///
/// Each part of the shutdown has its own timeout: connections 0.6 s, the release of pulses and
/// leases 1.4 s, policies 1.2 s, commands in progress on the lines 1 s, outlets 1 s. Together
/// that is less, so only what has no timeout is ever cut off: a disk or a driver that hangs.
pub(super) const END_MAX: Duration = Duration::from_secs(5);

/// Calls this when the time has passed, unless the process has exited by then. On a thread of its
/// own, since everything else may be waiting for what hangs.
pub(super) fn after(time: Duration, cut_off: impl FnOnce() + Send + 'static) {
    let watch = move || {
        let (_never, ended) = mpsc::channel::<()>();
        let _ = ended.recv_timeout(time);
        cut_off();
    };
    // Without threads left, the timeouts of each part must do.
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
        // This thread does nothing else.
        assert!(cut_off.recv().is_ok());
    }
}
