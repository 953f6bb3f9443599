//! Ctrl-C.

use super::Context;
use railbus_app::failure::Failure;
use railbus_words::Code;
use std::future::Future;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

/// The signals that end a command. Once this is created, they no longer end the process at once.
#[derive(Debug)]
pub(super) struct Stop {
    interrupt: Signal,
    terminate: Signal,
    /// Becomes true when something borrowed must be given back.
    over: Option<watch::Receiver<bool>>,
}

impl Stop {
    pub(super) fn new(context: &Context) -> Result<Stop, Failure> {
        let system = |error| Failure::of(context.lang, Code::System).because(error);
        Ok(Stop {
            interrupt: signal(SignalKind::interrupt()).map_err(system)?,
            terminate: signal(SignalKind::terminate()).map_err(system)?,
            over: None,
        })
    }

    /// From now on this becoming true is a reason to stop, too.
    pub(super) fn when(&mut self, over: watch::Receiver<bool>) {
        self.over = Some(over);
    }

    /// Waits for a reason to stop.
    pub(super) async fn requested(&mut self) {
        let over = async {
            match &mut self.over {
                Some(over) => _ = over.wait_for(|over| *over).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
            () = over => self.over = None,
        }
    }

    /// The result of the work, or none if a signal came first; then the work is dropped.
    pub(super) async fn or<T>(&mut self, work: impl Future<Output = T>) -> Option<T> {
        tokio::select! {
            done = work => Some(done),
            () = self.requested() => None,
        }
    }
}

/// The failure of a command that was stopped.
pub(super) fn interrupted(context: &Context) -> Failure {
    let page = Code::Interrupted.page();
    Failure::new(Code::Interrupted, page.title(context.lang).to_owned())
}
