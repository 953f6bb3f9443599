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
use crate::uplink::is_token;
pub use known::KnownPoint;
use known::KnownSite;
use prost::Message as _;
use session::{Admission, admit};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// A site is there for so long after a heartbeat: three of them, and a little.
const ONLINE: Duration = Duration::from_secs(35);
/// A machine that was heard within this time has its site; no other gets it.
const TAKEN: Duration = Duration::from_secs(60);
/// The most sites.
const SITES_MAX: usize = 20_000;
/// How long a session that is not known may be reported in before it is looked what the last one
/// is: its document may be on its way.
const STRAY: Duration = Duration::from_secs(30);
/// For how long at the least the fastest heartbeat of a session is remembered, and twice as long at
/// the most: clocks drift, and machines that sleep have another time afterwards.
const FASTEST: Duration = Duration::from_secs(300);
/// The longest message with entries, and the longest request for a session, in bytes.
const BATCH_MAX: usize = 128 << 10;
const HELLO_MAX: usize = 1_024;
/// The length of the numbers of installations and runs, in bytes.
const NUMBER_LEN: usize = 16;
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
    /// Nothing is heard any more. Documents that come before the next
    /// [`CentreInput::Connected`] are those that there are.
    Lost,
    /// A site asks for its session: the number of the request, its name, what it said, and the name
    /// that a new session gets, which nobody can guess.
    Hello(u64, &'i str, &'i [u8], String),
    /// What a site said, and the last word of the subject.
    Said(&'i str, &'i str, &'i [u8]),
    /// The document of a site's session, and its number.
    Lease(&'i str, &'i [u8], u64),
    /// What became of the document that was asked for under this number.
    Stored(u64, LeaseEnd),
    /// The last document of this site, and its number; none if there is none, or [`None`] if that
    /// can't be known now.
    Looked(&'i str, Option<Option<(&'i [u8], u64)>>),
}

/// What became of a document that was to be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseEnd {
    /// It is stored with this number.
    Stored(u64),
    /// Another one was stored before it.
    Raced,
    /// That is not known: it may be stored later.
    Unknown,
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
    /// The request with this number gets no answer. Whoever asked asks again.
    Ignore(u64),
    /// The last document of this site's session is read.
    Look(String),
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
    /// How long ago its last heartbeat of this session came.
    pub heard: Option<Duration>,
    /// Its points are as they are shown: it is there, and all that its last heartbeat vouches for
    /// has arrived, and was said not long ago.
    pub is_current: bool,
    /// How long ago its points were as they are shown, or later.
    pub vouched: Option<Duration>,
    /// How many entries its servers still had to get at its last heartbeat; none unless it is
    /// there.
    pub behind: Option<u64>,
    /// By how many milliseconds its clock is ahead of the centre's, give or take what a message
    /// takes; none unless it is there.
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
    /// Since when this process knows.
    since: Duration,
}

/// The last heartbeat of the present session.
#[derive(Clone, Debug)]
struct HeardBeat {
    /// When it came.
    at: Duration,
    /// When it was said, but for the time that the fastest one took. One that was late does not
    /// make the site's values younger: it was on its way for as much longer as it came later than
    /// the fastest one, or for as long as what was said before it waits for an answer.
    said: Duration,
    fastest: Fastest,
    beat: Beat,
    clock_ahead_ms: i64,
}

/// The fastest heartbeats of this time and the one before: the least difference between the
/// centre's time and the site's, in milliseconds.
#[derive(Clone, Copy, Debug)]
struct Fastest {
    since: Duration,
    now_ms: i128,
    before_ms: i128,
}

/// A session that is being given: whose request it answers, and what that said.
#[derive(Debug)]
struct Grant {
    site: String,
    lease: SessionLease,
    hello: Vec<u8>,
    /// It was decided before by a document that was not the last one.
    is_again: bool,
}

#[derive(Debug, Default)]
struct CentreSite {
    holder: Option<Holder>,
    beat: Option<HeardBeat>,
    known: KnownSite,
    /// How all points are, of a session that is not known yet, as it was said.
    early: Vec<u8>,
    /// A session that is not known and was reported in last, and since when any is.
    stray: Option<(String, Duration)>,
    /// The number of the last document when it was asked which one that is.
    looks: Option<u64>,
    /// A request that is decided again then: its number, what it said, and the name of the session.
    again: Option<(u64, Vec<u8>, String)>,
    /// When another machine asked last.
    copy: Option<Duration>,
    /// When the last heartbeat was sent whose values are all there.
    vouched: Option<Duration>,
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
            CentreInput::Lost => self.lost(),
            CentreInput::Hello(number, site, payload, session) => {
                self.hello(now, number, (site, payload, session), false);
            }
            CentreInput::Said(site, what, payload) => self.said(now, site, what, payload),
            CentreInput::Lease(site, payload, revision) => {
                self.document(now, site, (payload, revision), false);
            }
            CentreInput::Stored(number, end) => self.stored(now, number, end),
            CentreInput::Looked(site, found) => self.looked(now, site, found),
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
        let holder = site.holder.as_ref();
        let beat = site.beat.as_ref();
        let heard = beat.map(|beat| ago(beat.at));
        let is_new = holder.is_some_and(|holder| ago(holder.since) <= ONLINE);
        let presence = match (self.listens, heard) {
            (None, _) => SitePresence::Unknown,
            (Some(_), Some(heard)) if heard <= ONLINE => SitePresence::Online,
            (Some(since), None) if ago(since) <= ONLINE || is_new => SitePresence::Unknown,
            (Some(_), _) => SitePresence::Offline,
        };
        let present = beat.filter(|_| presence == SitePresence::Online);
        let has_all = |beat: &HeardBeat| site.known.has_all(&beat.beat) && ago(beat.said) <= ONLINE;
        let lease = holder.map(|holder| &holder.lease);
        SiteView {
            name,
            presence,
            heard,
            is_current: present.is_some_and(has_all),
            vouched: site.vouched.map(ago),
            behind: present.map(|b| b.beat.newest.saturating_sub(b.beat.delivered)),
            clock_ahead_ms: present.map(|beat| beat.clock_ahead_ms),
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

    /// What was heard is no longer so, and any document may be the last one.
    fn lost(&mut self) {
        self.listens = None;
        self.outputs.clear();
        self.grants.clear();
        for site in self.sites.values_mut() {
            site.beat = None;
            site.lacks = None;
            site.looks = None;
            site.again = None;
            if let Some(holder) = &mut site.holder {
                holder.revision = 0;
            }
        }
    }

    /// A site asks for its session.
    fn hello(
        &mut self,
        now: Duration,
        number: u64,
        (name, payload, session): (&str, &[u8], String),
        is_again: bool,
    ) {
        let hello = (payload.len() <= HELLO_MAX).then(|| Hello::decode(payload).ok());
        let is_fit = |hello: &Hello| {
            hello.installation.len() == NUMBER_LEN && hello.boot.len() == NUMBER_LEN
        };
        let Some(hello) = hello.flatten().filter(is_fit) else {
            self.bad += 1;
            return self.outputs.push_back(CentreOutput::Ignore(number));
        };
        let is_pending = self.grants.values().any(|grant| grant.site == name);
        let is_full = self.grants.len() >= GRANTS_MAX;
        let (listens, clock_ms) = (self.listens, self.clock_ms);
        let site = self.entry(name);
        let site = site.filter(|site| !is_pending && !is_full && site.again.is_none());
        let Some(site) = site else {
            return self.outputs.push_back(CentreOutput::Ignore(number));
        };
        let beat = site.beat.as_ref().map(|beat| beat.at);
        let holder = site.holder.as_ref();
        let heard = holder.map(|holder| holder.since).max(beat);
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
            Admission::Older => return self.outputs.push_back(CentreOutput::Ignore(number)),
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
            time_ms: hello.time_ms,
        };
        self.outputs.push_back(CentreOutput::Store {
            number,
            subject: format!("rb.fleet.lease.{name}"),
            payload: lease.encode_to_vec(),
            after,
        });
        let grant = Grant {
            site: name.to_owned(),
            lease,
            hello: payload.to_vec(),
            is_again,
        };
        self.grants.insert(number, grant);
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

    fn stored(&mut self, now: Duration, number: u64, end: LeaseEnd) {
        let Some(grant) = self.grants.remove(&number) else {
            return;
        };
        let (name, session) = (grant.site, grant.lease.session.clone());
        match end {
            LeaseEnd::Stored(revision) => {
                let lease = grant.lease;
                self.holds(now, &name, (lease, revision), false);
                let site = self.sites.get(&name);
                // Another one may have been given meanwhile.
                if site.is_some_and(|site| site.is_in(&session)) {
                    return self.replies(number, HelloAnswer::Session(session));
                }
            }
            // There is a document that this process has not heard of.
            LeaseEnd::Raced if !grant.is_again => {
                if let Some(site) = self.sites.get_mut(&name) {
                    site.again = Some((number, grant.hello, session));
                    return self.look(&name);
                }
            }
            LeaseEnd::Raced | LeaseEnd::Unknown => {}
        }
        // It asks again. If the document is stored after all, it comes as one.
        self.outputs.push_back(CentreOutput::Ignore(number));
    }

    fn look(&mut self, name: &str) {
        if let Some(site) = self.sites.get_mut(name).filter(|site| site.looks.is_none()) {
            site.looks = Some(site.holder.as_ref().map_or(0, |holder| holder.revision));
            self.outputs.push_back(CentreOutput::Look(name.to_owned()));
        }
    }

    /// Which document is the last one.
    fn looked(&mut self, now: Duration, name: &str, found: Option<Option<(&[u8], u64)>>) {
        let Some(site) = self.sites.get_mut(name) else {
            return;
        };
        let Some(looks) = site.looks.take() else {
            return;
        };
        let revision = site.holder.as_ref().map_or(0, |holder| holder.revision);
        let (again, stray) = (site.again.take(), site.stray.take());
        // One that came meanwhile may be a later one.
        if let (Some(found), true) = (found, revision == looks) {
            match found {
                Some(document) => self.document(now, name, document, true),
                None => {
                    if let Some(holder) = &mut site.holder {
                        holder.revision = 0;
                    }
                }
            }
            let site = self.sites.get(name);
            let stray = stray.filter(|(stray, _)| site.is_some_and(|site| !site.is_in(stray)));
            if let Some((stray, _)) = stray {
                self.ends(name, &stray);
            }
        }
        if let Some((number, payload, session)) = again {
            self.hello(now, number, (name, &payload, session), true);
        }
    }

    /// A document that is there; the last one, if that is certain.
    fn document(
        &mut self,
        now: Duration,
        name: &str,
        (payload, revision): (&[u8], u64),
        is_last: bool,
    ) {
        match SessionLease::decode(payload) {
            Ok(lease) => self.holds(now, name, (lease, revision), is_last),
            Err(_) => self.bad += 1,
        }
    }

    /// A machine has the session of a site from now on, unless another got it later.
    fn holds(
        &mut self,
        now: Duration,
        name: &str,
        (lease, revision): (SessionLease, u64),
        is_last: bool,
    ) {
        let Some(site) = self.entry(name) else {
            return;
        };
        if let Some(had) = &mut site.holder {
            if had.revision >= revision && !is_last {
                return;
            }
            if had.lease.session == lease.session {
                had.revision = revision;
                return;
            }
        }
        let (session, boot) = (lease.session.clone(), lease.boot.clone());
        let since = now;
        let had = site.holder.replace(Holder {
            lease,
            revision,
            since,
        });
        site.beat = None;
        site.lacks = None;
        site.stray = None;
        site.known.begin();
        let early = SiteState::decode(&*std::mem::take(&mut site.early));
        if let Some(early) = early.ok().filter(|early| early.session == session) {
            site.known.state(early);
        }
        // Who reports there may not know of it: a copy that was here first.
        if let Some(had) = had.filter(|had| had.lease.boot != boot) {
            self.ends(name, &had.lease.session);
        }
    }

    /// Whoever reports in this session is told that it has ended.
    fn ends(&mut self, name: &str, session: &str) {
        let subject = format!("rb.down.{name}.{session}.end");
        self.outputs.push_back(CentreOutput::Ask(subject));
    }

    fn said(&mut self, now: Duration, name: &str, what: &str, payload: &[u8]) {
        let is_understood = match what {
            "beat" => Beat::decode(payload).map(|beat| self.beat(now, name, beat)),
            "data" if payload.len() > BATCH_MAX => {
                self.bad += 1;
                return;
            }
            "data" => DataBatch::decode(payload).map(|batch| self.batch(name, batch)),
            "state" => SiteState::decode(payload).map(|state| self.state(name, state, payload)),
            // Requests come with their numbers; what a newer site says is not for this centre.
            _ => return,
        };
        self.bad += u64::from(is_understood.is_err());
    }

    fn beat(&mut self, now: Duration, name: &str, beat: Beat) {
        let clock_ms = self.clock_ms;
        let Some(site) = self.entry(name) else {
            return;
        };
        if site.was_in(&beat.session) {
            // It has not heard that its session has ended.
            return self.ends(name, &beat.session);
        }
        if !site.is_in(&beat.session) {
            return self.strays(now, name, beat.session);
        }
        let last = site.beat.as_ref();
        // Of two that were said in one session the later one counts.
        if last.is_some_and(|last| last.beat.time_ms > beat.time_ms) {
            return;
        }
        let fastest = Fastest::with(last.map(|last| last.fastest), now, &beat);
        let waited = now.saturating_sub(Duration::from_millis(beat.waits_ms));
        let said = fastest.said(&beat).min(waited);
        let clock_ahead_ms = beat.clock_ms.saturating_sub(clock_ms);
        let session = beat.session.clone();
        site.beat = Some(HeardBeat {
            at: now,
            said,
            fastest,
            beat,
            clock_ahead_ms,
        });
        if site.completes() {
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

    /// A site reports in a session that is not known: by a document that is on its way, or that was
    /// lost, or it has not heard which session it got.
    fn strays(&mut self, now: Duration, name: &str, session: String) {
        let Some(site) = self.sites.get_mut(name).filter(|_| is_token(&session)) else {
            return;
        };
        // Whichever it is: there may be several.
        let since = site.stray.as_ref().map_or(now, |(_, since)| *since);
        site.stray = Some((session, since));
        if now.saturating_sub(since) >= STRAY {
            self.look(name);
        }
    }

    fn batch(&mut self, name: &str, batch: DataBatch) {
        if let Some(site) = self.sites.get_mut(name)
            && site.is_in(&batch.session)
        {
            site.known.batch(batch);
            site.completes();
        }
    }

    fn state(&mut self, name: &str, state: SiteState, payload: &[u8]) {
        let Some(site) = self.entry(name) else {
            return;
        };
        match site.is_in(&state.session) {
            true => {
                site.known.state(state);
                site.completes();
            }
            // Its document may be on its way from another centre.
            false => site.early = payload.to_vec(),
        }
    }
}

impl Fastest {
    /// With one more heartbeat.
    fn with(last: Option<Fastest>, now: Duration, beat: &Beat) -> Fastest {
        let millis = i128::try_from(now.as_millis()).unwrap_or(i128::MAX);
        let its = millis - i128::from(beat.time_ms);
        let Some(last) = last else {
            return Fastest {
                since: now,
                now_ms: its,
                before_ms: its,
            };
        };
        if now.saturating_sub(last.since) < FASTEST {
            let now_ms = last.now_ms.min(its);
            return Fastest { now_ms, ..last };
        }
        Fastest {
            since: now,
            now_ms: its,
            before_ms: last.now_ms,
        }
    }

    /// When a heartbeat was said, by this centre's time.
    fn said(&self, beat: &Beat) -> Duration {
        let millis = self.now_ms.min(self.before_ms) + i128::from(beat.time_ms);
        Duration::from_millis(u64::try_from(millis).unwrap_or_default())
    }
}

impl CentreSite {
    /// Whether everything is there that the last heartbeat vouches for.
    fn completes(&mut self) -> bool {
        let beat = self.beat.as_ref();
        let Some(beat) = beat.filter(|beat| self.known.has_all(&beat.beat)) else {
            return false;
        };
        self.vouched = Some(beat.said);
        self.lacks = None;
        true
    }

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
