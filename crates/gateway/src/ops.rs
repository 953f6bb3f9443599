//! What takes its time: begun by one request, looked at and ended by others.

use super::access::Need;
use super::answer;
use super::doc::Doc;
use super::order::Order;
use super::routes::{Answer, Route, Site};
use axum::extract::{Path, State};
use axum::routing::{delete, get, post};
use railbus_api::ops::{OpAnswer, OpInfo, OpState, Ops as OpList, ScanResult};
use railbus_api::problem::{Problem, codes};
use railbus_api::types::SCHEMA;
use railbus_store::Ulids;
use railbus_words::time::rfc3339;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;
use tokio::sync::{oneshot, watch};

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[
    Route::new("GET", "/ops", Need::VIEWER, || get(list))
        .doc(Doc::new("What runs, and what ended lately").answers::<OpList>()),
    Route::new("GET", "/ops/{op}", Need::VIEWER, || get(look))
        .doc(Doc::new("How something is that takes its time").answers::<OpInfo>()),
    Route::new("DELETE", "/ops/{op}", Need::ENGINEER, || delete(cancel))
        .doc(Doc::new("End it; what was found stays").answers::<OpInfo>()),
    Route::new("POST", "/ops/{op}/answer", Need::ENGINEER, || post(reply)).doc(
        Doc::new("Answer what it asks")
            .takes::<OpAnswer>()
            .answers::<OpInfo>(),
    ),
];

/// How many are remembered.
const OPS_MAX: usize = 32;

/// One of them: how it is, and whether it shall end.
#[derive(Clone, Debug)]
pub(super) struct Op {
    told: watch::Sender<OpInfo>,
    cancel: watch::Sender<bool>,
    /// Who waits for an answer.
    asks: Arc<Mutex<Option<oneshot::Sender<bool>>>>,
}

impl Op {
    /// How it is.
    pub(super) fn info(&self) -> OpInfo {
        self.told.borrow().clone()
    }

    /// How it is, whenever that changes.
    pub(super) fn follow(&self) -> watch::Receiver<OpInfo> {
        self.told.subscribe()
    }

    /// Says how it is now.
    pub(super) fn tell(&self, change: impl FnOnce(&mut OpInfo)) {
        self.told.send_modify(change);
    }

    /// Until somebody wants it to end.
    pub(super) async fn cancelled(&self) {
        // The sender is this very handle's.
        let _ = self.cancel.subscribe().wait_for(|cancel| *cancel).await;
    }

    /// Asks it to end, as somebody outside may.
    pub(super) fn end_early(&self) {
        self.cancel.send_replace(true);
    }

    /// Waits for an answer from outside.
    pub(super) fn ask(&self) -> oneshot::Receiver<bool> {
        let (asks, answer) = oneshot::channel();
        *self.asks.lock().unwrap_or_else(PoisonError::into_inner) = Some(asks);
        answer
    }

    /// Gives the answer; false where nothing is asked.
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

/// What runs, and what ended lately.
#[derive(Debug, Default)]
pub(super) struct Ops {
    all: Mutex<VecDeque<Op>>,
    ulids: Ulids,
}

impl Ops {
    fn all(&self) -> MutexGuard<'_, VecDeque<Op>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One by its number.
    pub(super) fn get(&self, number: &str) -> Result<Op, Problem> {
        let all = self.all();
        let found = all.iter().find(|op| op.told.borrow().op == number);
        let unknown = || Problem::new(codes::NO_SUCH_PAGE).with("reason", "no such operation");
        found.cloned().ok_or_else(unknown)
    }

    /// One that begins now, of which nothing is done yet. Its number is a ULID: they sort by time.
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

    /// Takes note of a new one. There is only one on a line at a time.
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

async fn list(State(site): State<Site>) -> Answer {
    let ops = site.ops.all().iter().map(Op::info).collect();
    let schema = SCHEMA;
    answer::json(Ok(OpList { schema, ops }))
}

async fn look(State(site): State<Site>, Path(op): Path<String>) -> Answer {
    answer::json(site.ops.get(&op).map(|op| op.info()))
}

async fn cancel(State(site): State<Site>, Path(op): Path<String>) -> Answer {
    let op = match site.ops.get(&op) {
        Ok(op) => op,
        Err(problem) => return answer::problem(&problem),
    };
    op.end_early();
    let mut told = op.follow();
    let ended = told.wait_for(|info| info.state != OpState::Running).await;
    let info = ended.map(|info| info.clone());
    answer::json(info.map_err(|_| Problem::new(codes::INTERNAL)))
}

async fn reply(Path(number): Path<String>, order: Order) -> Answer {
    let told = order.read::<OpAnswer>().and_then(|answer| {
        let op = order.site.ops.get(&number)?;
        let nothing = || Problem::new(codes::BAD_REQUEST).with("reason", "it asks nothing now");
        op.answer(answer.go).then(|| op.info()).ok_or_else(nothing)
    });
    answer::json(told)
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
