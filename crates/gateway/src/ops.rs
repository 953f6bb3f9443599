//! Long-running operations: started by one request, followed and cancelled by others.

mod routes;

pub(super) use routes::ROUTES;

use railbus_api::ops::{OpInfo, OpState, ScanResult};
use railbus_api::problem::{Problem, codes};
use railbus_store::Ulids;
use railbus_words::time::rfc3339;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;
use tokio::sync::{oneshot, watch};

/// How many are remembered.
const OPS_MAX: usize = 32;

/// An operation: its state, and whether it has been cancelled.
#[derive(Clone, Debug)]
pub(super) struct Op {
    told: watch::Sender<OpInfo>,
    cancel: watch::Sender<bool>,
    /// The task that waits for an answer.
    asks: Arc<Mutex<Option<oneshot::Sender<bool>>>>,
}

impl Op {
    /// Its state.
    pub(super) fn info(&self) -> OpInfo {
        self.told.borrow().clone()
    }

    /// Its state, whenever that changes.
    pub(super) fn follow(&self) -> watch::Receiver<OpInfo> {
        self.told.subscribe()
    }

    /// Updates its state.
    pub(super) fn tell(&self, change: impl FnOnce(&mut OpInfo)) {
        self.told.send_modify(change);
    }

    /// Resolves when it is cancelled.
    pub(super) async fn cancelled(&self) {
        // This handle owns the sender.
        let _ = self.cancel.subscribe().wait_for(|cancel| *cancel).await;
    }

    /// Cancels it, as a client can.
    pub(super) fn end_early(&self) {
        self.cancel.send_replace(true);
    }

    /// Waits for an answer from a client.
    pub(super) fn ask(&self) -> oneshot::Receiver<bool> {
        let (asks, answer) = oneshot::channel();
        *self.asks.lock().unwrap_or_else(PoisonError::into_inner) = Some(asks);
        answer
    }

    /// Gives the answer; false if nothing was asked.
    fn answer(&self, go: bool) -> bool {
        let asks = self
            .asks
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        asks.is_some_and(|asks| asks.send(go).is_ok())
    }

    fn is_running(&self) -> bool {
        self.told.borrow().state == OpState::Running
    }
}

/// Operations that run, and those that have ended lately.
#[derive(Debug, Default)]
pub(super) struct Ops {
    all: Mutex<VecDeque<Op>>,
    ulids: Ulids,
}

impl Ops {
    fn all(&self) -> MutexGuard<'_, VecDeque<Op>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An operation by its id.
    pub(super) fn get(&self, number: &str) -> Result<Op, Problem> {
        let all = self.all();
        let found = all.iter().find(|op| op.told.borrow().op == number);
        let unknown = || Problem::new(codes::NO_SUCH_PAGE).with("reason", "no such operation");
        found.cloned().ok_or_else(unknown)
    }

    /// A new operation. Its id is a ULID: they sort by time.
    pub(super) fn begins_now(&self, kind: &str, lines: Vec<String>, who: String) -> OpInfo {
        OpInfo {
            op: self.ulids.next(SystemTime::now()),
            kind: kind.to_owned(),
            lines,
            who,
            started: rfc3339(jiff::Timestamp::now()),
            state: OpState::Running,
            done: 0,
            total: 0,
            percent: 0.0,
            found: 0,
            left_ms: 0,
            estimate_ms: 0,
            result: ScanResult::default(),
            settings: None,
            error: None,
        }
    }

    /// Registers a new operation. There is only one per line at a time.
    pub(super) fn begin(&self, info: OpInfo) -> Result<Op, Problem> {
        let mut all = self.all();
        for running in all.iter().filter(|op| op.is_running()) {
            let told = running.told.borrow();
            if let Some(line) = told.lines.iter().find(|line| info.lines.contains(line)) {
                let kind = match (told.kind.as_str(), info.kind.as_str()) {
                    ("scan", "scan") => codes::SCAN_RUNS,
                    _ => codes::LINE_AT_WORK,
                };
                let problem = Problem::new(kind).with("line", line.as_str());
                return Err(problem.with("op", told.op.as_str()));
            }
        }
        if all.len() >= OPS_MAX {
            let oldest = all.iter().position(|op| !op.is_running());
            let oldest = oldest.ok_or_else(|| Problem::new(codes::OVERLOADED))?;
            all.remove(oldest);
        }
        let op = Op {
            told: watch::Sender::new(info),
            cancel: watch::Sender::new(false),
            asks: Arc::default(),
        };
        all.push_back(op.clone());
        Ok(op)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(line: &str) -> OpInfo {
        Ops::default().begins_now("scan", vec![line.to_owned()], "li".to_owned())
    }

    #[test]
    fn a_line_is_scanned_once_at_a_time_and_old_ends_are_forgotten() {
        let ops = Ops::default();
        let first = ops.begin(info("main")).unwrap();
        let refused = ops.begin(info("main")).unwrap_err();
        assert_eq!((refused.code.as_str(), refused.status), ("E0210", 409));
        let other = ops.begin(info("other")).unwrap();
        for _ in 0..OPS_MAX {
            first.tell(|info| info.state = OpState::Done);
            let next = ops.begin(info("main")).unwrap();
            next.tell(|info| info.state = OpState::Done);
        }
        assert_eq!(ops.all().len(), OPS_MAX);
        assert!(ops.get(&first.info().op).is_err(), "the oldest that ended");
        assert!(ops.get(&other.info().op).is_ok(), "it runs");
    }
}
