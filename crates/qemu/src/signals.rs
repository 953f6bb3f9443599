//! The signals that end the program.

use std::io;
use std::sync::mpsc::SyncSender;
use tokio::runtime::Builder;
use tokio::signal::unix::{SignalKind, signal};

/// From now on each of these signals is sent to the listener as this word. They no longer end the
/// program at once, which would leave its folders behind.
pub(crate) fn tell<T: Clone + Send + 'static>(listener: SyncSender<T>, word: T) -> io::Result<()> {
    let runtime = Builder::new_current_thread().enable_io().build()?;
    let entered = runtime.enter();
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let mut hangup = signal(SignalKind::hangup())?;
    drop(entered);
    std::thread::spawn(move || {
        runtime.block_on(async {
            loop {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                    _ = hangup.recv() => {}
                }
                if listener.send(word.clone()).is_err() {
                    break;
                }
            }
        });
    });
    Ok(())
}
