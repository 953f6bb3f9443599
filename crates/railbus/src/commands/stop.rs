//! Ctrl-C.

use super::Context;
use crate::failure::{Code, Failure};
use std::future::Future;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// The signals that end a command. From its making on they no longer end the program at once.
#[derive(Debug)]
pub(super) struct Stop {
    interrupt: Signal,
    terminate: Signal,
}

impl Stop {
    pub(super) fn new(context: &Context) -> Result<Stop, Failure> {
        let system = |error| Failure::of(context.lang, Code::System).because(error);
        Ok(Stop {
            interrupt: signal(SignalKind::interrupt()).map_err(system)?,
            terminate: signal(SignalKind::terminate()).map_err(system)?,
        })
    }

    /// Waits for one.
    pub(super) async fn requested(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }

    /// The work's result, or none where a signal came first; the work is dropped then.
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
