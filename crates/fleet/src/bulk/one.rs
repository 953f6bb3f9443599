//! One command to many sites and its state.

use super::{BulkEnd, BulkOrder, BulkUnsent, EndView, FleetRefusal, refusal, stopped, view_of};
use crate::message::CommandKind;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// Its state.
#[derive(Debug)]
pub(super) enum BulkStage {
    /// The order is being stored; who waits for that.
    Storing(Vec<u64>),
    /// There is another order of this id, which is waited for until then; and who waits.
    Elsewhere(Duration, Vec<u64>),
    /// The order could not be stored. If it was stored after all, it is ended: that is waited for
    /// until then.
    Dropped(Duration),
    /// This process carries it out: the sites that were not commanded yet, and until when they are.
    Running {
        queue: VecDeque<String>,
        until: Duration,
    },
    /// Another process carries it out, until this time at most.
    Followed(Duration),
    /// All was sent that will be, and that is being stored; or when it is stored again, and how
    /// often it was.
    Ending(BulkEnd, Option<Duration>, u32),
    /// That is stored.
    Ended,
}

/// What became of a site.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SiteStage {
    /// There is no record of its command.
    Waiting,
    /// It was commanded: there is a record.
    Sent,
    /// It was commanded, or that is not known, and this came of it.
    Done(EndView),
    /// It was not commanded, for this reason.
    Unsent(EndView),
}

#[derive(Debug)]
pub(super) struct Bulk {
    pub(super) order: BulkOrder,
    pub(super) stage: BulkStage,
    /// The number of its order in the stream; 0 until it is there.
    pub(super) place: u64,
    /// The number of its last record in the stream.
    pub(super) last: u64,
    /// The number of what is being stored.
    pub(super) pending: u64,
    /// The number of its order, if that was heard before the result of storing it.
    pub(super) seen: Option<u64>,
    /// A wish to stop it that is being stored: its number, and who waits for that.
    pub(super) stopping: Option<(u64, u64)>,
    /// Who waits for a stop, while the order is being stored.
    pub(super) stop_callers: Vec<u64>,
    /// Who stopped it.
    pub(super) stopped_by: String,
    /// When it had ended, in milliseconds since 1970.
    ended_ms: i64,
    sites: BTreeMap<String, SiteStage>,
    /// The sites for which the ledger has not answered.
    in_flight: BTreeSet<String>,
}

/// A command to many sites, for people.
#[derive(Debug)]
pub struct BulkView<'b> {
    /// Its id, and that of the command to each site.
    pub id: &'b str,
    /// What was wanted, of which sites, by whom.
    pub order: &'b BulkOrder,
    /// The number of its order in the stream.
    pub place: u64,
    /// Who stopped it.
    pub stopped_by: Option<&'b str>,
    /// When all was sent that will be, in milliseconds since 1970; none before.
    pub ended_ms: Option<i64>,
    sites: &'b BTreeMap<String, SiteStage>,
    in_flight: &'b BTreeSet<String>,
}

/// What became of a site.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum BulkSiteState {
    /// There is no record that it was commanded.
    Waiting,
    /// Commanded, or about to be, without a result.
    Sent,
    /// The site said that it was done.
    Done,
    /// The site said that it was sent to the module, which does not confirm it.
    Unconfirmed,
    /// The site said that it was not done, or not all of it.
    Failed,
    /// It was not carried out.
    Never,
    /// Whether it was carried out is not known.
    Unknown,
}

impl BulkSiteState {
    fn of(end: &EndView) -> BulkSiteState {
        match (end.how, &end.code) {
            ("answered", Some(_)) => BulkSiteState::Failed,
            ("answered", None) if end.confirmed.as_deref() == Some("sent") => {
                BulkSiteState::Unconfirmed
            }
            ("answered", None) => BulkSiteState::Done,
            ("never", _) => BulkSiteState::Never,
            _ => BulkSiteState::Unknown,
        }
    }
}

impl<'b> BulkView<'b> {
    /// Its sites, by name: what became of each, and its result.
    pub fn sites(&self) -> impl Iterator<Item = (&'b str, BulkSiteState, Option<&'b EndView>)> {
        self.sites.iter().map(|(name, stage)| match stage {
            SiteStage::Waiting if !self.in_flight.contains(name) => {
                (name.as_str(), BulkSiteState::Waiting, None)
            }
            SiteStage::Waiting | SiteStage::Sent => (name.as_str(), BulkSiteState::Sent, None),
            SiteStage::Done(end) | SiteStage::Unsent(end) => {
                (name.as_str(), BulkSiteState::of(end), Some(end))
            }
        })
    }
}

impl Bulk {
    pub(super) fn new(order: BulkOrder, stage: BulkStage, pending: u64) -> Bulk {
        let sites = order.sites.iter();
        let sites = sites
            .map(|site| (site.clone(), SiteStage::Waiting))
            .collect();
        Bulk {
            order,
            stage,
            place: 0,
            last: 0,
            pending,
            seen: None,
            stopping: None,
            stop_callers: Vec::new(),
            stopped_by: String::new(),
            ended_ms: 0,
            sites,
            in_flight: BTreeSet::new(),
        }
    }

    pub(super) fn view<'b>(&'b self, id: &'b str) -> BulkView<'b> {
        BulkView {
            id,
            order: &self.order,
            place: self.place,
            stopped_by: Some(self.stopped_by.as_str()).filter(|who| !who.is_empty()),
            ended_ms: self.has_ended().then_some(self.ended_ms),
            sites: &self.sites,
            in_flight: &self.in_flight,
        }
    }

    /// Whether this process carries it out, or is about to.
    pub(super) const fn is_running(&self) -> bool {
        matches!(
            self.stage,
            BulkStage::Storing(_) | BulkStage::Running { .. } | BulkStage::Ending(..)
        )
    }

    /// Whether it needs this process.
    pub(super) const fn is_ours(&self) -> bool {
        !matches!(self.stage, BulkStage::Followed(_) | BulkStage::Ended)
    }

    pub(super) const fn has_ended(&self) -> bool {
        matches!(self.stage, BulkStage::Ended)
    }

    pub(super) fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// Whether this process gave its command to the ledger, and has no answer.
    pub(super) fn has_begun(&self, site: &str) -> bool {
        self.in_flight.contains(site)
    }

    /// Who waits for its order to be stored.
    pub(super) fn callers(&mut self) -> Vec<u64> {
        match &mut self.stage {
            BulkStage::Storing(callers) | BulkStage::Elsewhere(_, callers) => {
                std::mem::take(callers)
            }
            _ => Vec::new(),
        }
    }

    /// Who waits for a stop of it.
    pub(super) fn stops(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.stop_callers)
    }

    /// The next site that is commanded, if this process does that.
    pub(super) fn begin(&mut self) -> Option<String> {
        let BulkStage::Running { queue, .. } = &mut self.stage else {
            return None;
        };
        let site = queue.pop_front()?;
        self.in_flight.insert(site.clone());
        Some(site)
    }

    /// Whether no site is left, and the ledger has answered for each.
    pub(super) fn is_sent(&self) -> bool {
        let is_empty = matches!(&self.stage, BulkStage::Running { queue, .. } if queue.is_empty());
        is_empty && self.in_flight.is_empty()
    }

    /// A record of the command of a site.
    pub(super) fn command(&mut self, site: &str, id: &str, record: &CommandKind) {
        let intent = match record {
            CommandKind::Intent(intent) => Some(intent),
            CommandKind::End(end) => end.intent.as_ref(),
        };
        // The id may also be that of another command. An identical one is carried out once for
        // both.
        let is_ours = intent.is_some_and(|intent| {
            intent.method == self.order.method
                && intent.path == self.order.path
                && intent.body == self.order.body
                && intent.user == self.order.user
        });
        let (true, Some(stage)) = (is_ours, self.sites.get_mut(site)) else {
            return;
        };
        let end = view_of((site, id), record).and_then(|view| view.end);
        match (end, &stage) {
            (Some(end), _) => *stage = SiteStage::Done(end),
            (None, SiteStage::Waiting | SiteStage::Unsent(_)) => *stage = SiteStage::Sent,
            (None, SiteStage::Sent | SiteStage::Done(_)) => {}
        }
    }

    /// The ledger has answered that it was sent.
    pub(super) fn sent(&mut self, site: &str) {
        self.in_flight.remove(site);
        if let Some(stage @ SiteStage::Waiting) = self.sites.get_mut(site) {
            *stage = SiteStage::Sent;
        }
    }

    /// The ledger has answered.
    pub(super) fn settled(&mut self, site: &str) {
        self.in_flight.remove(site);
    }

    /// A site was not commanded.
    pub(super) fn not_sent(&mut self, site: &str, why: &FleetRefusal, at_ms: i64) {
        self.in_flight.remove(site);
        if let Some(stage @ SiteStage::Waiting) = self.sites.get_mut(site) {
            *stage = SiteStage::Unsent(view("never", why, at_ms));
        }
    }

    /// Whether a site was commanded is not known.
    pub(super) fn not_known(&mut self, site: &str, at_ms: i64) {
        self.in_flight.remove(site);
        if let Some(stage @ SiteStage::Waiting) = self.sites.get_mut(site) {
            let why = refusal("E0169", "it is not known whether it was sent before");
            *stage = SiteStage::Done(view("unknown", &why, at_ms));
        }
    }

    /// Sites that were not commanded so far will not be.
    pub(super) fn unsent_rest(&mut self, why: &FleetRefusal, at_ms: i64) {
        if let BulkStage::Running { queue, .. } = &mut self.stage {
            queue.clear();
        }
        for (site, stage) in &mut self.sites {
            if *stage == SiteStage::Waiting && !self.in_flight.contains(site) {
                *stage = SiteStage::Unsent(view("never", why, at_ms));
            }
        }
    }

    /// A stop was requested. If another process carries it out, that one records which sites are
    /// left.
    pub(super) fn stopped(&mut self, who: &str, at_ms: i64) {
        if self.stopped_by.is_empty() {
            who.clone_into(&mut self.stopped_by);
        }
        if matches!(self.stage, BulkStage::Running { .. }) {
            self.unsent_rest(&stopped(), at_ms);
        }
    }

    /// What is recorded at the end.
    pub(super) fn end(&self, at_ms: i64) -> BulkEnd {
        let mut unsent: BTreeMap<(&str, &str), Vec<String>> = BTreeMap::new();
        for (site, stage) in &self.sites {
            if let SiteStage::Unsent(end) = stage {
                let code = end.code.as_deref().unwrap_or_default();
                let sites = unsent.entry((code, &end.reason)).or_default();
                sites.push(site.clone());
            }
        }
        let unsent = unsent.into_iter();
        BulkEnd {
            unsent: unsent
                .map(|((code, reason), sites)| BulkUnsent {
                    why: Some(refusal(code, reason)),
                    sites,
                })
                .collect(),
            stopped_by: self.stopped_by.clone(),
            at_ms,
        }
    }

    /// Its end is recorded.
    pub(super) fn ended(&mut self, end: &BulkEnd) {
        for unsent in &end.unsent {
            let why = unsent.why.clone().unwrap_or_default();
            let sites = unsent.sites.iter();
            // This process has begun some of them, and learns from its ledger what came of that.
            for site in sites.filter(|site| !self.in_flight.contains(*site)) {
                if let Some(stage @ (SiteStage::Waiting | SiteStage::Unsent(_))) =
                    self.sites.get_mut(site)
                {
                    *stage = SiteStage::Unsent(view("never", &why, end.at_ms));
                }
            }
        }
        // All that was sent has a record before this one. Of the others that is not known.
        let left: Vec<String> = self
            .sites
            .iter()
            .filter(|(site, stage)| {
                **stage == SiteStage::Waiting && !self.in_flight.contains(*site)
            })
            .map(|(site, _)| site.clone())
            .collect();
        for site in left {
            self.not_known(&site, end.at_ms);
        }
        if self.stopped_by.is_empty() {
            self.stopped_by.clone_from(&end.stopped_by);
        }
        self.ended_ms = end.at_ms;
        self.stage = BulkStage::Ended;
    }
}

/// What came of a site without a record.
fn view(how: &'static str, why: &FleetRefusal, at_ms: i64) -> EndView {
    EndView {
        how,
        code: Some(why.code.clone()).filter(|code| !code.is_empty()),
        confirmed: None,
        reason: why.reason.clone(),
        at_ms,
    }
}

/// Whether it is the same order, given again.
pub(super) fn is_same(one: &BulkOrder, other: &BulkOrder) -> bool {
    one.method == other.method
        && one.path == other.path
        && one.user == other.user
        && one.body == other.body
        && one.sites == other.sites
}
