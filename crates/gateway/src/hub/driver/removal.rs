//! Sites that are removed.

use super::{Driver, StreamEnd, ended};
use crate::access::secret::{hex, random};
use crate::clock::since_boot;
use crate::hub::link::Link;
use crate::hub::streams::{ends, purge, put};
use crate::hub::view::SCHEMA;
use crate::warn_of;
use railbus_api::fleet::FleetRemoval;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_fleet::centre::{CentreInput, RemovalEnd, StoreEnd};
use tokio::sync::oneshot;

/// A removal that somebody waits for.
pub(super) struct AskedRemoval {
    site: String,
    /// What streams held of the site was deleted.
    is_purged: bool,
    /// Why it was not stored, or that is not known.
    problem: Option<Problem>,
    to: oneshot::Sender<Result<FleetRemoval, Problem>>,
}

impl Driver {
    /// A site is to be removed.
    pub(super) fn remove(
        &mut self,
        site: String,
        is_connected: bool,
        to: oneshot::Sender<Result<FleetRemoval, Problem>>,
    ) {
        let is_there = self.centre.site(since_boot(), &site).is_some();
        let found = match (is_there, is_connected) {
            (false, _) => Err(self.no_site(&site)),
            (true, false) => Err(self.disconnected()),
            (true, true) => random::<16>().map_err(|error| ended(&error)),
        };
        let name = match found {
            Ok(name) => hex(&name),
            Err(problem) => {
                // Fails if the client is gone.
                let _ = to.send(Err(problem));
                return;
            }
        };
        self.number += 1;
        let number = self.number;
        let asked = AskedRemoval {
            site: site.clone(),
            is_purged: false,
            problem: None,
            to,
        };
        self.removals.insert(number, asked);
        self.handle(CentreInput::Remove(number, &site, name));
    }

    /// Stores it, and deletes what streams held of the site before that.
    ///
    /// How far they were is read first. If the site comes back, what it says in its new session is
    /// behind that: its session is stored after the removal.
    pub(super) fn store_removal(
        &self,
        link: &Link,
        (number, site): (u64, String),
        (subject, payload, after): (String, Vec<u8>, u64),
    ) {
        let (streams, told) = (link.streams.clone(), self.ends.0.clone());
        tokio::spawn(async move {
            let removed = match ends(&streams).await {
                // Nothing was stored: it can be tried again as it is.
                Err(problem) => StreamEnd::Removed(number, StoreEnd::Unknown, false, Some(problem)),
                Ok(ends) => match put(&streams, subject, payload, after).await {
                    (StoreEnd::Stored(revision), _) => {
                        let purged = purge(&streams, &site, (ends, revision)).await;
                        let stored = StoreEnd::Stored(revision);
                        StreamEnd::Removed(number, stored, purged.is_ok(), purged.err())
                    }
                    (end, problem) => {
                        let problem = problem.map(|problem| problem.perhaps_acted(true));
                        StreamEnd::Removed(number, end, false, problem)
                    }
                },
            };
            // Fails once the centre has ended.
            let _ = told.send(removed);
        });
    }

    /// It was stored, or not.
    pub(super) fn removal_stored(
        &mut self,
        number: u64,
        (end, is_purged): (StoreEnd, bool),
        problem: Option<Problem>,
    ) {
        if let Some(problem) = &problem {
            warn_of(self.lang, &Failure::of_problem(self.lang, problem));
        }
        if let Some(asked) = self.removals.get_mut(&number) {
            asked.is_purged = is_purged;
            asked.problem = problem;
        }
        self.handle(CentreInput::Stored(number, end));
    }

    /// Tells who waits for it.
    pub(super) fn removal_ended(&mut self, number: u64, end: RemovalEnd) {
        let Some(asked) = self.removals.remove(&number) else {
            return;
        };
        let not = |code| Problem::new(code).with("name", &*asked.site);
        let told = match end {
            RemovalEnd::Removed => Ok(FleetRemoval {
                schema: SCHEMA,
                removed: asked.site,
                purged: asked.is_purged,
            }),
            RemovalEnd::NoSite => Err(not(codes::NO_SUCH_SITE)),
            RemovalEnd::NotOffline => Err(not(codes::SITE_THERE)),
            RemovalEnd::Busy => Err(not(codes::SITE_CHANGING)),
            RemovalEnd::Unknown => {
                let stored = || Problem::new(codes::FLEET_NOT_STORED).perhaps_acted(true);
                Err(asked.problem.unwrap_or_else(stored))
            }
        };
        // Fails if the client is gone.
        let _ = asked.to.send(told);
    }

    /// The connection is lost: what became of them is not known.
    pub(super) fn removals_lost(&mut self) {
        let problem = self.disconnected().perhaps_acted(true);
        for asked in std::mem::take(&mut self.removals).into_values() {
            let _ = asked.to.send(Err(problem.clone()));
        }
    }
}
