//! What people say of a site: the groups that it is in.
//!
//! Leases and these documents are in one stream, so their revisions tell which came first: what was
//! said of a site before it was removed does not count for the next one of this name.

use super::{Centre, CentreSite, SITES_MAX, SiteView};
use crate::message::SiteDocument;
use crate::names::is_site_name;
use prost::Message as _;
use std::collections::BTreeMap;
use std::time::Duration;

/// The most groups of a site.
pub const GROUPS_MAX: usize = 16;

/// The maximum number of names that never had a session and are in groups: they take up entries
/// that sites need.
const UNREPORTED_MAX: usize = 2_000;

/// The document with what people say of a site.
#[derive(Debug)]
pub(super) struct HeardDocument {
    groups: Vec<String>,
    /// The stream sequence of the document; 0 if the connection was lost since.
    revision: u64,
    /// It is there at the present connection.
    is_there: bool,
}

impl HeardDocument {
    /// The connection is lost: any document may be the latest, or none.
    pub(super) const fn lost(&mut self) {
        self.revision = 0;
        self.is_there = false;
    }

    /// Whether it is older than a lease.
    pub(super) const fn is_before(&self, revision: u64) -> bool {
        self.revision < revision
    }
}

/// The subject of the document with what people say of a site.
#[must_use]
pub fn document_subject(site: &str) -> String {
    format!("rb.fleet.site.{site}")
}

/// The document of a site in these groups; none if they are more than [`GROUPS_MAX`], or one can't
/// be named so: 1 to 64 of `a-z`, `0-9`, `-` and `_`.
#[must_use]
pub fn site_document(groups: &[String]) -> Option<Vec<u8>> {
    let groups = sorted(groups.to_vec());
    let is_fit = groups.len() <= GROUPS_MAX && groups.iter().all(|group| is_site_name(group));
    is_fit.then(|| SiteDocument { groups }.encode_to_vec())
}

fn sorted(mut groups: Vec<String>) -> Vec<String> {
    groups.sort_unstable();
    groups.dedup();
    groups
}

impl Centre {
    /// How many sites each group has, by its name.
    #[must_use]
    pub fn groups(&self) -> BTreeMap<&str, usize> {
        let mut groups = BTreeMap::new();
        for site in self.sites.values().filter(|site| site.is_there()) {
            for group in site.groups() {
                *groups.entry(group.as_str()).or_default() += 1;
            }
        }
        groups
    }

    /// A site at this time, also one of which only people said something, and which never reported.
    #[must_use]
    pub fn named_site(&self, now: Duration, name: &str) -> Option<SiteView<'_>> {
        let (name, site) = self.sites.get_key_value(name)?;
        Some(self.view(now, name, site))
    }

    /// Whether something can be said of a site of this name: it is known, or there is place for it.
    #[must_use]
    pub fn has_place(&self, name: &str) -> bool {
        let unreported = || {
            self.sites
                .values()
                .filter(|site| site.holder.is_none())
                .count()
        };
        self.sites.contains_key(name)
            || self.sites.len() < SITES_MAX && unreported() < UNREPORTED_MAX
    }

    /// The centre is subscribed: what was not read at this connection is there no longer.
    pub(super) fn connected(&mut self, now: Duration) {
        self.listens = Some(now);
        for site in self.sites.values_mut() {
            site.document.take_if(|document| !document.is_there);
        }
    }

    /// A document arrived.
    pub(super) fn document(&mut self, name: &str, payload: &[u8], revision: u64) {
        let Ok(SiteDocument { groups }) = SiteDocument::decode(payload) else {
            self.unreadable += 1;
            return;
        };
        let Some(site) = self.entry(name) else {
            return;
        };
        let holder = site.holder.as_ref();
        let removal = holder.filter(|holder| holder.lease.is_removal());
        let is_before = |document: &HeardDocument| document.is_before(revision);
        if removal.is_some_and(|removal| removal.revision > revision)
            || !site.document.as_ref().is_none_or(is_before)
        {
            return;
        }
        // One of a newer version may have more.
        let mut groups = sorted(groups);
        groups.retain(|group| is_site_name(group));
        groups.truncate(GROUPS_MAX);
        site.document = Some(HeardDocument {
            groups,
            revision,
            is_there: true,
        });
    }
}

impl CentreSite {
    /// The groups that it is in.
    pub(super) fn groups(&self) -> &[String] {
        let document = self.document.as_ref();
        document.map_or(&[], |document| &document.groups)
    }
}
