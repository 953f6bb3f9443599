//! A configuration for many sites, without I/O: a few get it first, then more, and it halts by
//! itself where too many refuse it or take it back. docs/decisions/0063
//!
//! What became of each site is what the site says of its version, so any process of the centre can
//! go on with it: it is told again what was said before.

use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet};

/// The most sites that try it at a time.
const TRYING_MAX: usize = 200;
/// How many of all sites have it after each wave, in a hundredth; before the first one, the
/// canaries.
const WAVES: [usize; 3] = [1, 10, 100];
/// It halts if more than one of so many sites did not keep it.
const FAILED_OF: usize = 50;

/// How a site ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RolloutEnd {
    /// It works with it.
    Kept,
    /// It refused it, or took it back.
    Failed,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RolloutInput<'i> {
    /// A site is online, or is not.
    Online(&'i str, bool),
    /// A site got its document before: by this process or an earlier one.
    Given(&'i str),
    /// What became of the version at a site.
    Ended(&'i str, RolloutEnd),
    /// Somebody stops it.
    Stop,
    /// Somebody lets it go on, whatever failed so far.
    GoOn,
}

/// How it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RolloutState {
    /// Sites get it, or are waited for.
    Running,
    /// Too many did not keep it: no more get it.
    Halted,
    /// Somebody stopped it.
    Stopped,
    /// Each site has its end.
    Done,
}

/// A site of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct RolloutSite {
    /// The wave that it is in.
    wave: usize,
    is_online: bool,
    is_given: bool,
    end: Option<RolloutEnd>,
}

/// A configuration on its way to many sites.
#[derive(Debug)]
pub struct Rollout {
    sites: BTreeMap<String, RolloutSite>,
    /// The sites of each wave, in the order in which they get it.
    waves: Vec<Vec<String>>,
    /// The wave that is under way.
    wave: usize,
    is_stopped: bool,
    is_halted: bool,
    /// How many had ended, and how many of them failed, when somebody let it go on.
    forgiven: (usize, usize),
}

/// How many sites are how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RolloutCounts {
    /// All of them.
    pub all: usize,
    /// They got it, and try it.
    pub trying: usize,
    /// They work with it.
    pub kept: usize,
    /// They refused it, or took it back.
    pub failed: usize,
}

impl Rollout {
    /// One of this id to these sites; those named as canaries get it first. Without canaries it is
    /// one site.
    #[must_use]
    pub fn new(id: &str, sites: &BTreeSet<String>, canaries: &BTreeSet<String>) -> Rollout {
        // In an order that has nothing to do with names: what names have in common may be what is
        // wrong with the configuration.
        let mut order: Vec<&String> = sites.iter().collect();
        order.sort_by_cached_key(|site| Sha256::digest(format!("{id} {site}").as_bytes()));
        let is_first = |site: &&String| canaries.contains(*site);
        let (mut first, rest): (Vec<&String>, Vec<&String>) = order.into_iter().partition(is_first);
        let mut rest = rest.into_iter();
        if first.is_empty() {
            first.extend(rest.next());
        }
        let mut waves = vec![first.len()];
        let mut ordered = first;
        ordered.extend(rest);
        for hundredth in WAVES {
            let until = (sites.len() * hundredth).div_ceil(100);
            waves.push(until.max(waves.last().copied().unwrap_or_default()));
        }
        let mut rollout = Rollout {
            sites: BTreeMap::new(),
            waves: Vec::new(),
            wave: 0,
            is_stopped: false,
            is_halted: false,
            forgiven: (0, 0),
        };
        let mut ordered = ordered.into_iter();
        let mut before = 0;
        for until in waves {
            let wave = rollout.waves.len();
            let names: Vec<String> = ordered.by_ref().take(until - before).cloned().collect();
            before = until;
            for name in &names {
                let site = RolloutSite {
                    wave,
                    ..RolloutSite::default()
                };
                rollout.sites.insert(name.clone(), site);
            }
            rollout.waves.push(names);
        }
        rollout
    }

    /// How it is.
    #[must_use]
    pub fn state(&self) -> RolloutState {
        let is_done = self.sites.values().all(|site| site.end.is_some());
        match (is_done, self.is_stopped, self.is_halted) {
            (true, ..) => RolloutState::Done,
            (false, true, _) => RolloutState::Stopped,
            (false, false, true) => RolloutState::Halted,
            (false, false, false) => RolloutState::Running,
        }
    }

    /// The number of the wave that is under way, from 0.
    #[must_use]
    pub const fn wave(&self) -> usize {
        self.wave
    }

    /// How many sites are how.
    #[must_use]
    pub fn counts(&self) -> RolloutCounts {
        let mut counts = RolloutCounts {
            all: self.sites.len(),
            ..RolloutCounts::default()
        };
        for site in self.sites.values() {
            match site.end {
                Some(RolloutEnd::Kept) => counts.kept += 1,
                Some(RolloutEnd::Failed) => counts.failed += 1,
                None if site.is_given => counts.trying += 1,
                None => {}
            }
        }
        counts
    }

    /// Something happened.
    pub fn handle(&mut self, input: RolloutInput<'_>) {
        match input {
            RolloutInput::Online(name, is_online) => {
                if let Some(site) = self.sites.get_mut(name) {
                    site.is_online = is_online;
                }
            }
            RolloutInput::Given(name) => {
                if let Some(site) = self.sites.get_mut(name) {
                    site.is_given = true;
                }
            }
            RolloutInput::Ended(name, end) => {
                if let Some(site) = self.sites.get_mut(name) {
                    site.is_given = true;
                    site.end = Some(end);
                }
                self.look();
            }
            RolloutInput::Stop => self.is_stopped = true,
            RolloutInput::GoOn => {
                let counts = self.counts();
                self.forgiven = (counts.kept + counts.failed, counts.failed);
                (self.is_stopped, self.is_halted) = (false, false);
            }
        }
    }

    /// Whether too many did not keep it.
    fn look(&mut self) {
        let counts = self.counts();
        let (ended, failed) = self.forgiven;
        let failed = counts.failed.saturating_sub(failed);
        let ended = (counts.kept + counts.failed).saturating_sub(ended);
        if failed * FAILED_OF > ended {
            self.is_halted = true;
        }
    }

    /// The next site to get its document, which counts as given from then on; none for now.
    pub fn poll(&mut self) -> Option<String> {
        if self.is_halted || self.is_stopped || self.counts().trying >= TRYING_MAX {
            return None;
        }
        while self.is_over(self.wave) && self.wave + 1 < self.waves.len() {
            self.wave += 1;
        }
        // Those of earlier waves that have come since, too.
        let begun = self.waves.iter().take(self.wave + 1).flatten();
        let is_next = |name: &&String| {
            let site = self.sites.get(*name);
            site.is_some_and(|site| site.is_online && !site.is_given)
        };
        let name = begun.clone().find(is_next)?.clone();
        if let Some(site) = self.sites.get_mut(&name) {
            site.is_given = true;
        }
        Some(name)
    }

    /// Whether nothing more is waited for in a wave: each of its sites that is there has its end,
    /// and one has at all.
    fn is_over(&self, wave: usize) -> bool {
        let mut sites = self.sites.values().filter(|site| site.wave == wave);
        let is_left = |site: &RolloutSite| site.is_online && site.end.is_none();
        let is_empty = sites.clone().next().is_none();
        let has_one = sites.clone().any(|site| site.end.is_some());
        (is_empty || has_one) && !sites.any(is_left)
    }
}

#[cfg(test)]
mod tests;
