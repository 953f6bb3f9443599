//! Who gets the session of a site.

use super::{BEFORE_MAX, TAKEN};
use crate::message::{EarlierRun, Hello, SessionLease};
use std::time::Duration;

/// Whether a machine gets a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Admission {
    /// It does. These are the runs that had it before.
    Admitted(Vec<EarlierRun>),
    /// Another machine has it.
    Taken,
    /// Another machine had it, and it is not known whether that is still there.
    NotKnown,
    /// The same run has asked later than this.
    Older,
}

/// Whether a machine that asks gets the session of its site. `lease` is the last one, `heard` when
/// its machine was heard last or got it, `listens` since when all is heard.
///
/// A run of the program that asks again has lost its connection. Another run of the same
/// installation is a restart, unless it ran before the present one: no run comes back after a
/// restart, so that is a copy of the disk.
pub(super) fn admit(
    now: Duration,
    hello: &Hello,
    lease: Option<&SessionLease>,
    heard: Option<Duration>,
    listens: Option<Duration>,
) -> Admission {
    let Some(lease) = lease else {
        return Admission::Admitted(Vec::new());
    };
    let is_recent = |at: Duration| now.saturating_sub(at) < TAKEN;
    let is_silent = !heard.is_some_and(is_recent) && !listens.is_none_or(is_recent);
    if lease.boot == hello.boot {
        // A machine that was put back to an earlier state has an earlier time.
        return match hello.time_ms < lease.time_ms && !is_silent {
            true => Admission::Older,
            false => Admission::Admitted(lease.before.clone()),
        };
    }
    let is_before = lease.before.iter().any(|run| run.boot == hello.boot);
    let is_restart = lease.installation == hello.installation && !is_before;
    if is_restart {
        return Admission::Admitted(before(lease, hello));
    }
    if heard.is_some_and(is_recent) {
        return Admission::Taken;
    }
    if listens.is_none_or(is_recent) {
        return Admission::NotKnown;
    }
    // The other one is silent: this machine has its place.
    Admission::Admitted(before(lease, hello))
}

/// The runs that had it before this one.
fn before(lease: &SessionLease, hello: &Hello) -> Vec<EarlierRun> {
    let last = EarlierRun {
        boot: lease.boot.clone(),
        session: lease.session.clone(),
    };
    let before = lease.before.iter().chain([&last]);
    let before: Vec<_> = before.filter(|run| run.boot != hello.boot).collect();
    let skipped = before.len().saturating_sub(BEFORE_MAX);
    before.into_iter().skip(skipped).cloned().collect()
}
