//! The centre's end of its connections to sites, without I/O: which machine is which site, which
//! sites are there, and what is known of their points.
//!
//! A site is one machine: the one that has its session. A session is given under a number of the
//! document that says so, so that of two centres that give one at once only one succeeds. What is
//! said outside the present session counts for nothing.

mod known;
mod session;

use crate::message::{
    Beat, DataBatch, FleetRefusal, Hello, HelloAnswer, SessionLease, SiteState, Welcome,
};
use crate::names::is_site_name;
use known::KnownSite;
pub use known::{KnownPoint, POINTS_MAX};
use prost::Message as _;
use session::{Admission, admit};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// A site is there for so long after a heartbeat: three of them, and a little.
pub const ONLINE: Duration = Duration::from_secs(35);
/// A machine that was heard within this time has its site; no other gets it.
pub const TAKEN: Duration = Duration::from_secs(60);
/// The most sites.
pub const SITES_MAX: usize = 20_000;
/// What a heartbeat vouches for may arrive so long after it.
const LACKS: Duration = Duration::from_secs(5);
/// The interval in which a site is asked how all its points are.
const ASKED_AGAIN: Duration = Duration::from_secs(60);
/// The most sessions that are being given.
const GRANTS_MAX: usize = 4_096;
/// How many earlier runs of a machine are remembered.
const BEFORE_MAX: usize = 8;

/// What happened.
#[derive(Debug)]
pub enum CentreInput<'i> {
    /// From now on all is heard.
    Connected,
    /// Nothing is heard any more.
    Lost,
    /// A site asks for its session: the number of the request, its name, what it said, and the name
    /// that a new session gets, which nobody can guess.
    Hello(u64, &'i str, &'i [u8], String),
    /// What a site said, and the last word of the subject.
    Said(&'i str, &'i str, &'i [u8]),
    /// The document of a site's session, and its number.
    Lease(&'i str, &'i [u8], u64),
    /// The document that was asked for under this number is stored with that one; or it is not, or
    /// that is not known.
    Stored(u64, Option<u64>),
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub enum CentreOutput {
    /// The answer to the request with this number.
    Reply(u64, Vec<u8>),
    /// The document of a session is stored if the last one of its site has this number, 0 for none.
    Store {
        /// The number of the request.
        number: u64,
        /// Where it is stored.
        subject: String,
        /// The document.
        payload: Vec<u8>,
        /// The number of the last one.
        after: u64,
    },
    /// A site is asked at this subject, without content; its answer is of no importance.
    Ask(String),
}

/// Whether a site is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SitePresence {
    /// The centre has not been listening for long enough to say.
    Unknown,
    /// Its heartbeats come.
    Online,
    /// They don't.
    Offline,
}

/// What the centre knows of a site.
#[derive(Clone, Debug)]
pub struct SiteView<'c> {
    /// Its name.
    pub name: &'c str,
    /// Whether it is there.
    pub presence: SitePresence,
    /// How long ago its last heartbeat of this session was said.
    pub heard: Option<Duration>,
    /// Its points are as they are shown: it is there, and all that its last heartbeat vouches for
    /// has arrived.
    pub is_current: bool,
    /// How long ago its points were as they are shown, at the latest.
    pub vouched: Option<Duration>,
    /// How many entries its servers still have to get.
    pub behind: u64,
    /// By how many milliseconds its clock is ahead of the centre's, give or take what a message
    /// takes.
    pub clock_ahead_ms: Option<i64>,
    /// The version of railbus there.
    pub version: &'c str,
    /// Until when its key is valid, in seconds since 1970; none where it does not expire.
    pub key_expires_s: Option<i64>,
    /// How long ago another machine with its key asked for its session, and did not get it.
    pub copy: Option<Duration>,
    /// Its points, by path.
    pub points: &'c BTreeMap<String, KnownPoint>,
}

/// Which machine is the site now.
#[derive(Clone, Debug)]
struct Holder {
    lease: SessionLease,
    /// The number of its document.
    revision: u64,
}

/// The last heartbeat of the present session.
#[derive(Clone, Debug)]
struct HeardBeat {
    /// When it was said: one that comes late does not make the site's values younger. On the way it
    /// was for as much longer as it came later than the fastest one of this session.
    at: Duration,
    /// The least difference between the centre's time and the site's, in milliseconds.
    offset_ms: i128,
    beat: Beat,
    clock_ahead_ms: i64,
}

/// A session that is being given: whose request it answers.
#[derive(Debug)]
struct Grant {
    site: String,
    lease: SessionLease,
}

#[derive(Debug, Default)]
struct CentreSite {
    holder: Option<Holder>,
    beat: Option<HeardBeat>,
    known: KnownSite,
    /// How all points are, of a session that is not known yet.
    early: Option<SiteState>,
    /// When another machine asked last.
    copy: Option<Duration>,
    /// Since when something is missing that a heartbeat vouches for.
    lacks: Option<Duration>,
    /// When it was asked last how its points are.
    asked: Option<Duration>,
}

/// All sites of a fleet, as one process of the centre knows them.
#[derive(Debug, Default)]
pub struct Centre {
    sites: BTreeMap<String, CentreSite>,
    /// Since when all is heard.
    listens: Option<Duration>,
    grants: BTreeMap<u64, Grant>,
    outputs: VecDeque<CentreOutput>,
    /// The wall clock, in milliseconds since 1970.
    clock_ms: i64,
    /// How many messages were not understood.
    bad: u64,
}

impl Centre {
    /// The time of the wall clock, in milliseconds since 1970. Only what is shown depends on it.
    pub const fn set_clock(&mut self, clock_ms: i64) {
        self.clock_ms = clock_ms;
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: CentreInput<'_>) {
        match input {
            CentreInput::Connected => self.listens = Some(now),
            CentreInput::Lost => {
                self.listens = None;
                // Who asked asks again.
                self.grants.clear();
            }
            CentreInput::Hello(number, site, payload, session) => {
                self.hello(now, number, site, payload, session);
            }
            CentreInput::Said(site, what, payload) => self.said(now, site, what, payload),
            CentreInput::Lease(site, payload, revision) => match SessionLease::decode(payload) {
                Ok(lease) => self.holds(site, Holder { lease, revision }),
                Err(_) => self.bad += 1,
            },
            CentreInput::Stored(number, revision) => self.stored(number, revision),
        }
    }

    /// What is to be done.
    pub fn poll(&mut self) -> Option<CentreOutput> {
        self.outputs.pop_front()
    }

    /// How many messages were not understood.
    #[must_use]
    pub const fn bad(&self) -> u64 {
        self.bad
    }

    /// Whether anything is heard.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.listens.is_some()
    }

    /// All sites at this time, by name.
    pub fn sites(&self, now: Duration) -> impl Iterator<Item = SiteView<'_>> {
        let sites = self.sites.iter().filter(|(_, site)| site.holder.is_some());
        sites.map(move |(name, site)| self.view(now, name, site))
    }

    /// A site at this time; none if no machine ever had this name.
    #[must_use]
    pub fn site(&self, now: Duration, name: &str) -> Option<SiteView<'_>> {
        let (name, site) = self.sites.get_key_value(name)?;
        let is_there = site.holder.is_some();
        is_there.then(|| self.view(now, name, site))
    }

    fn view<'c>(&'c self, now: Duration, name: &'c str, site: &'c CentreSite) -> SiteView<'c> {
        let ago = |at: Duration| now.saturating_sub(at);
        let heard = site.beat.as_ref().map(|beat| ago(beat.at));
        let presence = match (self.listens, heard) {
            (Some(_), Some(heard)) if heard <= ONLINE => SitePresence::Online,
            (Some(since), _) if ago(since) > ONLINE => SitePresence::Offline,
            _ => SitePresence::Unknown,
        };
        let lease = site.holder.as_ref().map(|holder| &holder.lease);
        let beat = site.beat.as_ref();
        let has_all = beat.is_some_and(|beat| site.known.has_all(&beat.beat));
        SiteView {
            name,
            presence,
            heard,
            is_current: presence == SitePresence::Online && has_all,
            vouched: site.known.vouched().map(ago),
            behind: beat.map_or(0, |b| b.beat.newest.saturating_sub(b.beat.delivered)),
            clock_ahead_ms: beat.map(|beat| beat.clock_ahead_ms),
            version: lease.map_or("", |lease| &lease.version),
            key_expires_s: lease.and_then(|lease| lease.key_expires_s),
            copy: site.copy.map(ago),
            points: site.known.points(),
        }
    }

    /// A site of this name; none if there are too many.
    fn entry(&mut self, name: &str) -> Option<&mut CentreSite> {
        let is_new = !self.sites.contains_key(name);
        if is_new && (self.sites.len() >= SITES_MAX || !is_site_name(name)) {
            return None;
        }
        Some(self.sites.entry(name.to_owned()).or_default())
    }

    fn hello(&mut self, now: Duration, number: u64, name: &str, payload: &[u8], session: String) {
        let Ok(hello) = Hello::decode(payload) else {
            self.bad += 1;
            return;
        };
        let is_pending = self.grants.values().any(|grant| grant.site == name);
        if is_pending || self.grants.len() >= GRANTS_MAX {
            // It asks again.
            return;
        }
        let (listens, clock_ms) = (self.listens, self.clock_ms);
        let Some(site) = self.entry(name) else {
            return;
        };
        let heard = site.beat.as_ref().map(|beat| beat.at);
        let holder = site.holder.as_ref();
        let admission = admit(now, &hello, holder.map(|h| &h.lease), heard, listens);
        let after = holder.map_or(0, |holder| holder.revision);
        let before = match admission {
            Admission::Taken => {
                site.copy = Some(now);
                return self.refuses(number, "another machine reports as this site");
            }
            Admission::NotKnown => {
                return self.refuses(
                    number,
                    "whether another machine reports as this site is not known yet",
                );
            }
            Admission::Admitted(before) => before,
        };
        let lease = SessionLease {
            session,
            installation: hello.installation,
            boot: hello.boot,
            before,
            version: hello.version,
            granted_ms: clock_ms,
            key_expires_s: hello.key_expires_s,
        };
        self.outputs.push_back(CentreOutput::Store {
            number,
            subject: format!("rb.fleet.lease.{name}"),
            payload: lease.encode_to_vec(),
            after,
        });
        let site = name.to_owned();
        self.grants.insert(number, Grant { site, lease });
    }

    fn refuses(&mut self, number: u64, reason: &str) {
        let refusal = FleetRefusal {
            code: "E0935".to_owned(),
            reason: reason.to_owned(),
        };
        self.replies(number, HelloAnswer::Refusal(refusal));
    }

    fn replies(&mut self, number: u64, answer: HelloAnswer) {
        let answer = Some(answer);
        let reply = CentreOutput::Reply(number, Welcome { answer }.encode_to_vec());
        self.outputs.push_back(reply);
    }

    fn stored(&mut self, number: u64, revision: Option<u64>) {
        let (Some(Grant { site, lease }), Some(revision)) = (self.grants.remove(&number), revision)
        else {
            // It asks again. If the document is stored after all, it comes as one.
            return;
        };
        let session = lease.session.clone();
        self.holds(&site, Holder { lease, revision });
        let is_present = self.sites.get(&site).is_some_and(|its| its.is_in(&session));
        // Another one may have been given meanwhile.
        if is_present {
            self.replies(number, HelloAnswer::Session(session));
        }
    }

    /// A machine has the session of a site from now on, unless another got it later.
    fn holds(&mut self, name: &str, holder: Holder) {
        let Some(site) = self.entry(name) else {
            return;
        };
        let is_older = |had: &Holder| had.revision >= holder.revision;
        if site.holder.as_ref().is_some_and(is_older) {
            return;
        }
        let (session, boot) = (holder.lease.session.clone(), holder.lease.boot.clone());
        let had = site.holder.replace(holder);
        site.beat = None;
        site.lacks = None;
        site.known.begin();
        if let Some(early) = site.early.take().filter(|early| early.session == session) {
            site.known.state(early);
        }
        // Who reports there may not know of it: a copy that was here first.
        if let Some(had) = had.filter(|had| had.lease.boot != boot) {
            let subject = format!("rb.down.{name}.{}.end", had.lease.session);
            self.outputs.push_back(CentreOutput::Ask(subject));
        }
    }

    fn said(&mut self, now: Duration, name: &str, what: &str, payload: &[u8]) {
        let clock_ms = self.clock_ms;
        let is_understood = match what {
            "beat" => Beat::decode(payload).map(|beat| self.beat(now, name, beat, clock_ms)),
            "data" => DataBatch::decode(payload).map(|batch| self.batch(name, batch)),
            "state" => SiteState::decode(payload).map(|state| self.state(name, state)),
            // Requests come with their numbers; what a newer site says is not for this centre.
            _ => return,
        };
        self.bad += u64::from(is_understood.is_err());
    }

    fn beat(&mut self, now: Duration, name: &str, beat: Beat, clock_ms: i64) {
        let Some(site) = self.sites.get_mut(name) else {
            return;
        };
        if site.was_in(&beat.session) {
            // It has not heard that its session has ended.
            let subject = format!("rb.down.{name}.{}.end", beat.session);
            self.outputs.push_back(CentreOutput::Ask(subject));
        }
        let last = site.beat.as_ref();
        // Of two that were said in one session the later one counts.
        if !site.is_in(&beat.session) || last.is_some_and(|l| l.beat.time_ms > beat.time_ms) {
            return;
        }
        let millis = |time: Duration| i128::try_from(time.as_millis()).unwrap_or(i128::MAX);
        let offset_ms = millis(now) - i128::from(beat.time_ms);
        let offset_ms = last.map_or(offset_ms, |last| last.offset_ms.min(offset_ms));
        let said_ms = u64::try_from(offset_ms + i128::from(beat.time_ms)).unwrap_or_default();
        let at = Duration::from_millis(said_ms);
        let has_all = site.known.beat(at, &beat);
        let clock_ahead_ms = beat.clock_ms.saturating_sub(clock_ms);
        let session = beat.session.clone();
        site.beat = Some(HeardBeat {
            at,
            offset_ms,
            beat,
            clock_ahead_ms,
        });
        if has_all {
            site.lacks = None;
            return;
        }
        let since = *site.lacks.get_or_insert(now);
        let is_due = |asked: Duration| now.saturating_sub(asked) >= ASKED_AGAIN;
        if now.saturating_sub(since) >= LACKS && site.asked.is_none_or(is_due) {
            site.asked = Some(now);
            let subject = format!("rb.down.{name}.{session}.state");
            self.outputs.push_back(CentreOutput::Ask(subject));
        }
    }

    fn batch(&mut self, name: &str, batch: DataBatch) {
        if let Some(site) = self.sites.get_mut(name)
            && site.is_in(&batch.session)
        {
            site.known.batch(batch);
        }
    }

    fn state(&mut self, name: &str, state: SiteState) {
        let Some(site) = self.entry(name) else {
            return;
        };
        match site.is_in(&state.session) {
            true => site.known.state(state),
            // Its document may be on its way from another centre.
            false => site.early = Some(state),
        }
    }
}

impl CentreSite {
    fn is_in(&self, session: &str) -> bool {
        let holder = self.holder.as_ref();
        holder.is_some_and(|holder| holder.lease.session == session)
    }

    /// Whether this session is one of those that ended.
    fn was_in(&self, session: &str) -> bool {
        let before = self.holder.iter().flat_map(|holder| &holder.lease.before);
        before.into_iter().any(|run| run.session == session)
    }
}

#[cfg(test)]
mod tests;
