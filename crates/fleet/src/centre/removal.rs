//! A site that is gone is removed, unless it comes back at the same moment.
//!
//! That it was removed is its latest lease, stored like any other: of a removal and a session that
//! are stored for the same revision, one succeeds. Afterwards only that lease is kept of the site,
//! so that an older one which arrives late does not bring the site back.

use super::session::before;
use super::{Centre, CentreOutput, CentreSite, SitePresence, StoreEnd, lease_subject};
use crate::message::{SessionLease, SiteState};
use prost::Message as _;
use std::time::Duration;

/// The maximum number of sites being removed.
const REMOVALS_MAX: usize = 64;

/// The result of a removal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RemovalEnd {
    /// The site is removed.
    Removed,
    /// There is none of this name, or another process removed it first.
    NoSite,
    /// It is not known to be offline, or came back at the same moment.
    NotOffline,
    /// It was not removed: too many others are being removed, this one is, or something else was
    /// stored at the same moment and can't be read.
    Busy,
    /// Unknown: it may still be stored later.
    Unknown,
}

/// A site being removed.
#[derive(Debug)]
pub(super) struct Removal {
    site: String,
    lease: SessionLease,
    /// What it follows.
    after: u64,
    /// Something else was stored first, and is being read.
    has_conflict: bool,
}

impl Centre {
    /// A site is to be removed.
    pub(super) fn remove(&mut self, now: Duration, number: u64, name: &str, session: String) {
        let Some(presence) = self.site(now, name).map(|view| view.presence) else {
            return self.ended(number, RemovalEnd::NoSite);
        };
        let is_pending = self.removals.values().any(|removal| removal.site == name);
        if is_pending || self.removals.len() >= REMOVALS_MAX {
            return self.ended(number, RemovalEnd::Busy);
        }
        let asks = self.grants.values().any(|grant| grant.site == name);
        let Some(site) = self.sites.get(name) else {
            return self.ended(number, RemovalEnd::NoSite);
        };
        let holder = site.holder.as_ref().filter(|_| site.retry.is_none());
        let Some(holder) = holder.filter(|_| presence == SitePresence::Offline && !asks) else {
            return self.ended(number, RemovalEnd::NotOffline);
        };
        let after = holder.revision;
        let lease = SessionLease {
            session,
            // Machines that still use an earlier session get its end.
            before: before(&holder.lease, &[]),
            // 0 would mean that it was not removed.
            removed_ms: self.clock_ms.max(1),
            ..SessionLease::default()
        };
        self.outputs.push_back(CentreOutput::StoreRemoval {
            number,
            site: name.to_owned(),
            subject: lease_subject(name),
            payload: lease.encode_to_vec(),
            after,
        });
        let removal = Removal {
            site: name.to_owned(),
            lease,
            after,
            has_conflict: false,
        };
        self.removals.insert(number, removal);
    }

    fn ended(&mut self, number: u64, end: RemovalEnd) {
        self.outputs
            .push_back(CentreOutput::RemovalEnded(number, end));
    }

    /// The result of storing a removal.
    pub(super) fn removal_stored(&mut self, now: Duration, number: u64, end: StoreEnd) {
        let Some(mut removal) = self.removals.remove(&number) else {
            return;
        };
        match end {
            StoreEnd::Stored(revision) => {
                self.set_holder(now, &removal.site, (removal.lease, revision), false);
                self.ended(number, RemovalEnd::Removed);
            }
            StoreEnd::Conflict => {
                let name = removal.site.clone();
                // Another process removed it, and its entry was dropped for a new site.
                if !self.sites.contains_key(&name) {
                    return self.ended(number, RemovalEnd::NoSite);
                }
                removal.has_conflict = true;
                self.removals.insert(number, removal);
                self.read_lease(&name);
            }
            // If it is stored after all, it arrives as a lease.
            StoreEnd::Unknown => self.ended(number, RemovalEnd::Unknown),
        }
    }

    /// The latest lease of a site was read, or could not be: removals that something else preceded
    /// end.
    pub(super) fn removals_decided(&mut self, name: &str, is_read: bool) {
        let site = self.sites.get(name).filter(|site| site.is_there());
        let latest = site.map(|site| site.holder.as_ref().map_or(0, |holder| holder.revision));
        let removals = self.removals.iter();
        let decided = removals.filter(|(_, removal)| removal.site == name && removal.has_conflict);
        let decided: Vec<(u64, u64)> = decided
            .map(|(number, removal)| (*number, removal.after))
            .collect();
        for (number, after) in decided {
            self.removals.remove(&number);
            let end = match latest {
                None => RemovalEnd::NoSite,
                Some(latest) if is_read && latest != after => RemovalEnd::NotOffline,
                // The document that was stored first has not arrived yet.
                Some(_) => RemovalEnd::Busy,
            };
            self.ended(number, end);
        }
    }

    /// Drops a name that no site has and that is in no group, to make room for a site.
    pub(super) fn drops_unused_name(&mut self) -> bool {
        let is_unused = |site: &CentreSite| {
            !site.is_there() && site.reading_lease.is_none() && site.groups().is_empty()
        };
        let found = self.sites.iter().find(|(_, site)| is_unused(site));
        let Some(name) = found.map(|(name, _)| name.clone()) else {
            return false;
        };
        self.sites.remove(&name).is_some()
    }
}

impl CentreSite {
    /// It was removed: nothing is known of it any more.
    pub(super) fn forget(&mut self) {
        self.known = super::KnownSite::default();
        self.duplicate = None;
        self.vouched = None;
        self.state_requested = None;
        let removed = self.holder.as_ref().map_or(0, |holder| holder.revision);
        // What was said of it since is of the next site of this name.
        self.document
            .take_if(|document| document.is_before(removed));
        // The state of the next session may arrive before its lease.
        let early = SiteState::decode(&*self.early_state).ok();
        if early.is_some_and(|early| self.was_in(&early.session)) {
            self.early_state.clear();
        }
    }
}
