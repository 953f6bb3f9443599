//! Who gets the session of a site.

use super::{BEFORE_MAX, TAKEN};
use crate::message::{EarlierRun, Hello, SessionLease};
use std::time::Duration;

/// The decision on a request for a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Admission {
    /// Granted; these runs had the session before.
    Admitted(Vec<EarlierRun>),
    /// Another machine has the session.
    Taken,
    /// Another machine had it, and may still be there.
    NotKnown,
    /// A later request of the same run was already granted.
    Older,
}

/// Whether a machine gets the session it requests. `lease` is the latest one, `heard` when its
/// machine was last heard or got the session, `listens` since when the centre is subscribed.
///
/// The same run asking again has lost its connection. Another run of the same installation is a
/// restart, unless it had the session before: a run never comes back after a restart, so that is a
/// copy of the disk.
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
    if lease.is_removal() {
        return Admission::Admitted(before(lease, &hello.boot));
    }
    let is_recent = |at: Duration| now.saturating_sub(at) < TAKEN;
    let is_silent = !heard.is_some_and(is_recent) && !listens.is_none_or(is_recent);
    if lease.boot == hello.boot {
        // A machine restored from a snapshot has an earlier time.
        return match hello.time_ms < lease.time_ms && !is_silent {
            true => Admission::Older,
            false => Admission::Admitted(lease.before.clone()),
        };
    }
    let is_before = lease.before.iter().any(|run| run.boot == hello.boot);
    let is_restart = lease.installation == hello.installation && !is_before;
    if is_restart {
        return Admission::Admitted(before(lease, &hello.boot));
    }
    if heard.is_some_and(is_recent) {
        return Admission::Taken;
    }
    if listens.is_none_or(is_recent) {
        return Admission::NotKnown;
    }
    // The other machine is silent: this one replaces it.
    Admission::Admitted(before(lease, &hello.boot))
}

/// The runs that had the session before this one, when it follows this lease.
pub(super) fn before(lease: &SessionLease, boot: &[u8]) -> Vec<EarlierRun> {
    let last = EarlierRun {
        boot: lease.boot.clone(),
        session: lease.session.clone(),
    };
    // Of a site that was removed, nobody had the last session.
    let last = Some(&last).filter(|_| !lease.is_removal());
    let before = lease.before.iter().chain(last);
    let before: Vec<_> = before.filter(|run| run.boot != boot).collect();
    let skipped = before.len().saturating_sub(BEFORE_MAX);
    before.into_iter().skip(skipped).cloned().collect()
}
