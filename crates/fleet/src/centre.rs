//! The centre's end of its connections to sites, without I/O: which machine is which site, which
//! sites are there, and what is known of their points.
//!
//! A site is one machine: the one that has its session. Sessions are documents written by
//! compare-and-set, so when two centres grant one at the same time, only one succeeds. Messages
//! from any other session are ignored.

mod fastest;
mod groups;
mod known;
mod removal;
mod session;
mod view;

use crate::message::{
    Beat, ConfigReport, DataBatch, FleetRefusal, Hello, HelloAnswer, SessionLease, SiteState,
    Welcome,
};
use crate::names::is_site_name;
use crate::uplink::is_token;
use fastest::Fastest;
use groups::HeardDocument;
pub use groups::{GROUPS_MAX, document_subject, site_document};
pub use known::KnownPoint;
use known::KnownSite;
use prost::Message as _;
use removal::Removal;
pub use removal::RemovalEnd;
use session::{Admission, admit};
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;
pub use view::{SiteAttention, SitePresence, SiteView};

/// A site is offline when no heartbeat came for this long: three of them and some slack.
const ONLINE: Duration = Duration::from_secs(35);
/// While its machine was heard within this time, no other machine gets the session of a site.
const TAKEN: Duration = Duration::from_secs(60);
/// The most sites.
const SITES_MAX: usize = 20_000;
/// How long heartbeats may come in an unknown session before the latest lease is read: it may still
/// be on its way from another centre.
const STRAY: Duration = Duration::from_secs(30);
/// The longest message with entries, and the longest request for a session, in bytes.
const BATCH_MAX: usize = 128 << 10;
const HELLO_MAX: usize = 1_024;
/// The length of installation and boot ids, in bytes.
const NUMBER_LEN: usize = 16;
/// How long data that a heartbeat vouches for may arrive after it.
const LACKS: Duration = Duration::from_secs(5);
/// The minimum interval between requests for a site's state.
const ASKED_AGAIN: Duration = Duration::from_secs(60);
/// The maximum number of sessions being granted.
const GRANTS_MAX: usize = 4_096;
/// How many earlier runs a lease lists.
const BEFORE_MAX: usize = 8;

/// What happened.
#[derive(Debug)]
pub enum CentreInput<'i> {
    /// The centre is subscribed.
    Connected,
    /// The connection is lost. Leases and documents passed in before the next
    /// [`CentreInput::Connected`] are the latest ones, whatever their revision.
    Lost,
    /// A site requests its session: request number, site, payload, and an unguessable name for the
    /// new session.
    Hello(u64, &'i str, &'i [u8], String),
    /// A message of a site: site, last word of the subject, payload.
    Said(&'i str, &'i str, &'i [u8]),
    /// The lease of a site: site, document, revision.
    Lease(&'i str, &'i [u8], u64),
    /// A site is to be removed: request number, site, and an unguessable name that no session gets.
    Remove(u64, &'i str, String),
    /// What people say of a site: site, document, revision.
    Document(&'i str, &'i [u8], u64),
    /// The result of [`CentreOutput::Store`] or [`CentreOutput::StoreRemoval`] with this request
    /// number.
    Stored(u64, StoreEnd),
    /// The result of [`CentreOutput::ReadLease`]: [`None`] if reading failed, `Some(None)` if there
    /// is no lease, otherwise document and revision.
    LeaseRead(&'i str, Option<Option<(&'i [u8], u64)>>),
}

/// The result of storing a document provided that another one is the latest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreEnd {
    /// Stored with this revision.
    Stored(u64),
    /// Another one was stored first.
    Conflict,
    /// Unknown: it may still be stored later.
    Unknown,
}

/// What is to be done.
#[derive(Debug, PartialEq)]
pub enum CentreOutput {
    /// Reply to this request.
    Reply(u64, Vec<u8>),
    /// Store a lease, provided the site's latest revision is `after`.
    Store {
        /// The request number.
        number: u64,
        /// The subject.
        subject: String,
        /// The document.
        payload: Vec<u8>,
        /// The expected latest revision, 0 for none.
        after: u64,
    },
    /// Store a lease that says that a site was removed, provided its latest revision is `after`.
    /// If it is stored, delete what streams held of the site before that.
    StoreRemoval {
        /// The request number.
        number: u64,
        /// The site.
        site: String,
        /// The subject.
        subject: String,
        /// The document.
        payload: Vec<u8>,
        /// The expected latest revision, 0 for none.
        after: u64,
    },
    /// The result of [`CentreInput::Remove`] with this request number.
    RemovalEnded(u64, RemovalEnd),
    /// Drop this request without a reply: the site retries.
    Drop(u64),
    /// Read the latest lease of this site from the leader of the stream.
    ReadLease(String),
    /// Send an empty request to this subject; the reply does not matter.
    Request(String),
}

/// The machine that has the session.
#[derive(Clone, Debug)]
struct Holder {
    lease: SessionLease,
    /// The stream sequence of the lease.
    revision: u64,
    /// When this process learnt of it.
    since: Duration,
}

/// The last heartbeat of the present session.
#[derive(Clone, Debug)]
struct HeardBeat {
    /// When it arrived.
    at: Duration,
    /// When it was sent, estimated, so that a delayed heartbeat does not make values look fresher
    /// than they are. Its delay is what it took longer than the fastest heartbeat, or how long
    /// earlier messages of the site have been waiting for an acknowledgement, if that is longer.
    said: Duration,
    fastest: Fastest,
    beat: Beat,
    clock_ahead_ms: i64,
}

/// A session being granted.
#[derive(Debug)]
struct Grant {
    site: String,
    lease: SessionLease,
    hello: Vec<u8>,
    /// The first attempt was decided by an outdated lease.
    is_retry: bool,
}

#[derive(Debug, Default)]
struct CentreSite {
    holder: Option<Holder>,
    beat: Option<HeardBeat>,
    known: KnownSite,
    /// What people say of it.
    document: Option<HeardDocument>,
    /// The last state of an unknown session, encoded.
    early_state: Vec<u8>,
    /// The latest unknown session, and since when heartbeats come in unknown ones.
    unknown: Option<(String, Duration)>,
    /// The latest lease is being read; the known revision when that began.
    reading_lease: Option<u64>,
    /// A request to decide again after that: number, payload, and name of the session.
    retry: Option<(u64, Vec<u8>, String)>,
    /// When another machine was last refused.
    duplicate: Option<Duration>,
    /// When the last heartbeat that confirmed all values was sent.
    vouched: Option<Duration>,
    /// Since when data is missing that a heartbeat vouches for.
    incomplete_since: Option<Duration>,
    /// When its state was last requested.
    state_requested: Option<Duration>,
}

/// All sites of a fleet, as one centre process knows them.
#[derive(Debug, Default)]
pub struct Centre {
    sites: BTreeMap<String, CentreSite>,
    /// Since when the centre is subscribed.
    listens: Option<Duration>,
    grants: BTreeMap<u64, Grant>,
    removals: BTreeMap<u64, Removal>,
    outputs: VecDeque<CentreOutput>,
    /// The wall clock, in milliseconds since 1970.
    clock_ms: i64,
    /// How many messages could not be decoded.
    unreadable: u64,
}

impl Centre {
    /// The time of the wall clock, in milliseconds since 1970. Only what is shown depends on it.
    pub const fn set_clock(&mut self, clock_ms: i64) {
        self.clock_ms = clock_ms;
    }

    /// Something happened, at this time since the start.
    pub fn handle(&mut self, now: Duration, input: CentreInput<'_>) {
        match input {
            CentreInput::Connected => self.connected(now),
            CentreInput::Lost => self.lost(),
            CentreInput::Hello(number, site, payload, session) => {
                self.hello(now, number, (site, payload, session), false);
            }
            CentreInput::Said(site, what, payload) => self.said(now, site, what, payload),
            CentreInput::Lease(site, payload, revision) => {
                self.lease_document(now, site, (payload, revision), false);
            }
            CentreInput::Document(site, payload, revision) => {
                self.document(site, payload, revision);
            }
            CentreInput::Remove(number, site, name) => self.remove(now, number, site, name),
            CentreInput::Stored(number, end) => self.stored(now, number, end),
            CentreInput::LeaseRead(site, found) => self.lease_read(now, site, found),
        }
    }

    /// What is to be done.
    pub fn poll(&mut self) -> Option<CentreOutput> {
        self.outputs.pop_front()
    }

    /// How many messages could not be decoded.
    #[must_use]
    pub const fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Whether the centre is subscribed.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.listens.is_some()
    }

    /// All sites at this time, by name.
    pub fn sites(&self, now: Duration) -> impl Iterator<Item = SiteView<'_>> {
        let sites = self.sites.iter().filter(|(_, site)| site.is_there());
        sites.map(move |(name, site)| self.view(now, name, site))
    }

    /// A site at this time; none if no machine ever had this name, or none since it was removed.
    #[must_use]
    pub fn site(&self, now: Duration, name: &str) -> Option<SiteView<'_>> {
        let (name, site) = self.sites.get_key_value(name)?;
        site.is_there().then(|| self.view(now, name, site))
    }

    fn view<'c>(&'c self, now: Duration, name: &'c str, site: &'c CentreSite) -> SiteView<'c> {
        let ago = |at: Duration| now.saturating_sub(at);
        let holder = site.holder.as_ref();
        let beat = site.beat.as_ref();
        let heard = beat.map(|beat| ago(beat.at));
        let is_new = holder.is_some_and(|holder| ago(holder.since) <= ONLINE);
        let presence = match (self.listens, heard) {
            _ if !site.is_there() => SitePresence::Unknown,
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
            session: lease.map_or("", |lease| &lease.session),
            time: present.map(|beat| {
                // It was sent before it arrived: the site's time has come further.
                let since = u64::try_from(ago(beat.at).as_millis()).unwrap_or(u64::MAX);
                (&*beat.beat.boot, beat.beat.time_ms.saturating_add(since))
            }),
            version: lease.map_or("", |lease| &lease.version),
            config: beat.and_then(|beat| beat.beat.config.as_ref()),
            key_expires_s: beat
                .and_then(|beat| beat.beat.key_expires_s)
                .or_else(|| lease.and_then(|lease| lease.key_expires_s)),
            duplicate: site.duplicate.map(ago),
            groups: site.groups(),
            points: site.known.points(),
            paths: site.known.paths(),
        }
    }

    /// A site of this name; none if there are too many.
    fn entry(&mut self, name: &str) -> Option<&mut CentreSite> {
        if !self.sites.contains_key(name) {
            let has_place =
                |centre: &mut Centre| centre.sites.len() < SITES_MAX || centre.drops_unused_name();
            if !is_site_name(name) || !has_place(self) {
                return None;
            }
        }
        Some(self.sites.entry(name.to_owned()).or_default())
    }

    /// The connection is lost: presence is unknown, and any lease may be the latest.
    fn lost(&mut self) {
        self.listens = None;
        self.outputs.clear();
        self.grants.clear();
        self.removals.clear();
        for site in self.sites.values_mut() {
            site.beat = None;
            site.incomplete_since = None;
            site.reading_lease = None;
            site.retry = None;
            if let Some(document) = &mut site.document {
                document.lost();
            }
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
        is_retry: bool,
    ) {
        let hello = (payload.len() <= HELLO_MAX).then(|| Hello::decode(payload).ok());
        let is_fit = |hello: &Hello| {
            hello.installation.len() == NUMBER_LEN && hello.boot.len() == NUMBER_LEN
        };
        let Some(hello) = hello.flatten().filter(is_fit) else {
            self.unreadable += 1;
            return self.outputs.push_back(CentreOutput::Drop(number));
        };
        let is_pending = self.grants.values().any(|grant| grant.site == name);
        let is_full = self.grants.len() >= GRANTS_MAX;
        let (listens, clock_ms) = (self.listens, self.clock_ms);
        let site = self.entry(name);
        let site = site.filter(|site| !is_pending && !is_full && site.retry.is_none());
        let Some(site) = site else {
            return self.outputs.push_back(CentreOutput::Drop(number));
        };
        let beat = site.beat.as_ref().map(|beat| beat.at);
        let holder = site.holder.as_ref();
        let heard = holder.map(|holder| holder.since).max(beat);
        let admission = admit(now, &hello, holder.map(|h| &h.lease), heard, listens);
        let after = holder.map_or(0, |holder| holder.revision);
        let before = match admission {
            Admission::Taken => {
                site.duplicate = Some(now);
                return self.refuse(number, "another machine reports as this site");
            }
            Admission::NotKnown => {
                return self.refuse(
                    number,
                    "whether another machine reports as this site is not known yet",
                );
            }
            Admission::Older => return self.outputs.push_back(CentreOutput::Drop(number)),
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
            removed_ms: 0,
        };
        self.outputs.push_back(CentreOutput::Store {
            number,
            subject: lease_subject(name),
            payload: lease.encode_to_vec(),
            after,
        });
        let grant = Grant {
            site: name.to_owned(),
            lease,
            hello: payload.to_vec(),
            is_retry,
        };
        self.grants.insert(number, grant);
    }

    fn refuse(&mut self, number: u64, reason: &str) {
        let refusal = FleetRefusal {
            code: "E0935".to_owned(),
            reason: reason.to_owned(),
        };
        self.reply(number, HelloAnswer::Refusal(refusal));
    }

    fn reply(&mut self, number: u64, answer: HelloAnswer) {
        let welcome = Welcome {
            answer: Some(answer),
            clock_ms: self.clock_ms,
        };
        let reply = CentreOutput::Reply(number, welcome.encode_to_vec());
        self.outputs.push_back(reply);
    }

    fn stored(&mut self, now: Duration, number: u64, end: StoreEnd) {
        let Some(grant) = self.grants.remove(&number) else {
            return self.removal_stored(now, number, end);
        };
        let (name, session) = (grant.site, grant.lease.session.clone());
        match end {
            StoreEnd::Stored(revision) => {
                let lease = grant.lease;
                self.set_holder(now, &name, (lease, revision), false);
                let site = self.sites.get(&name);
                // Another session may have been granted meanwhile.
                if site.is_some_and(|site| site.is_in(&session)) {
                    return self.reply(number, HelloAnswer::Session(session));
                }
            }
            // There is a newer lease that has not arrived here yet.
            StoreEnd::Conflict if !grant.is_retry => {
                if let Some(site) = self.sites.get_mut(&name) {
                    site.retry = Some((number, grant.hello, session));
                    return self.read_lease(&name);
                }
            }
            StoreEnd::Conflict | StoreEnd::Unknown => {}
        }
        // The site retries. If the lease is stored after all, it arrives as one.
        self.outputs.push_back(CentreOutput::Drop(number));
    }

    fn read_lease(&mut self, name: &str) {
        if let Some(site) = self
            .sites
            .get_mut(name)
            .filter(|site| site.reading_lease.is_none())
        {
            site.reading_lease = Some(site.holder.as_ref().map_or(0, |holder| holder.revision));
            self.outputs
                .push_back(CentreOutput::ReadLease(name.to_owned()));
        }
    }

    /// The latest lease was read.
    fn lease_read(&mut self, now: Duration, name: &str, found: Option<Option<(&[u8], u64)>>) {
        let Some(site) = self.sites.get_mut(name) else {
            return;
        };
        let Some(looks) = site.reading_lease.take() else {
            return;
        };
        let revision = site.holder.as_ref().map_or(0, |holder| holder.revision);
        let (again, stray) = (site.retry.take(), site.unknown.take());
        let is_read = found.is_some();
        // A newer lease may have arrived in between.
        if let (Some(found), true) = (found, revision == looks) {
            match found {
                Some(document) => self.lease_document(now, name, document, true),
                None => {
                    if let Some(holder) = &mut site.holder {
                        holder.revision = 0;
                    }
                }
            }
            let site = self.sites.get(name);
            let stray = stray.filter(|(stray, _)| site.is_some_and(|site| !site.is_in(stray)));
            if let Some((stray, _)) = stray {
                self.end_session(name, &stray);
            }
        }
        self.removals_decided(name, is_read);
        if let Some((number, payload, session)) = again {
            self.hello(now, number, (name, &payload, session), true);
        }
    }

    /// A lease arrived; `is_last` if it is known to be the latest.
    fn lease_document(
        &mut self,
        now: Duration,
        name: &str,
        (payload, revision): (&[u8], u64),
        is_last: bool,
    ) {
        match SessionLease::decode(payload) {
            Ok(lease) => self.set_holder(now, name, (lease, revision), is_last),
            Err(_) => self.unreadable += 1,
        }
    }

    /// A machine has the session of a site from now on, unless a newer lease is known.
    fn set_holder(
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
        let (since, is_removal) = (now, lease.is_removal());
        let had = site.holder.replace(Holder {
            lease,
            revision,
            since,
        });
        site.beat = None;
        site.incomplete_since = None;
        site.unknown = None;
        if is_removal {
            site.forget();
        } else {
            site.known.begin();
            let early = SiteState::decode(&*std::mem::take(&mut site.early_state));
            if let Some(early) = early.ok().filter(|early| early.session == session) {
                site.known.state(early);
            }
        }
        // Another machine may still be using the previous session.
        let had = had.filter(|had| had.lease.boot != boot && !had.lease.is_removal());
        if let Some(had) = had {
            self.end_session(name, &had.lease.session);
        }
    }

    /// Tells the machine using this session that it has ended.
    fn end_session(&mut self, name: &str, session: &str) {
        let subject = format!("rb.down.{name}.{session}.end");
        self.outputs.push_back(CentreOutput::Request(subject));
    }

    fn said(&mut self, now: Duration, name: &str, what: &str, payload: &[u8]) {
        let is_understood = match what {
            "beat" => Beat::decode(payload).map(|beat| self.beat(now, name, beat)),
            "data" if payload.len() > BATCH_MAX => {
                self.unreadable += 1;
                return;
            }
            "data" => DataBatch::decode(payload).map(|batch| self.batch(name, batch)),
            "state" => SiteState::decode(payload).map(|state| self.state(name, state, payload)),
            // Requests are passed in separately; other messages are from a newer version.
            _ => return,
        };
        self.unreadable += u64::from(is_understood.is_err());
    }

    fn beat(&mut self, now: Duration, name: &str, mut beat: Beat) {
        let clock_ms = self.clock_ms;
        beat.config = beat.config.filter(ConfigReport::is_short);
        let Some(site) = self.entry(name) else {
            return;
        };
        if site.was_in(&beat.session) {
            // It missed that its session has ended.
            return self.end_session(name, &beat.session);
        }
        if !site.is_in(&beat.session) {
            return self.unknown_session(now, name, beat.session);
        }
        let last = site.beat.as_ref();
        // An older heartbeat of this session, out of order.
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
        let since = *site.incomplete_since.get_or_insert(now);
        let is_due = |asked: Duration| now.saturating_sub(asked) >= ASKED_AGAIN;
        if now.saturating_sub(since) >= LACKS && site.state_requested.is_none_or(is_due) {
            site.state_requested = Some(now);
            let subject = format!("rb.down.{name}.{session}.state");
            self.outputs.push_back(CentreOutput::Request(subject));
        }
    }

    /// A heartbeat in an unknown session: its lease is still on its way or was lost, or the site
    /// missed the reply with its newer session.
    fn unknown_session(&mut self, now: Duration, name: &str, session: String) {
        let Some(site) = self.sites.get_mut(name).filter(|_| is_token(&session)) else {
            return;
        };
        // The time counts for all of them: several machines may be sending.
        let since = site.unknown.as_ref().map_or(now, |(_, since)| *since);
        site.unknown = Some((session, since));
        if now.saturating_sub(since) >= STRAY {
            self.read_lease(name);
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
            // One of an earlier session is not so any more.
            false if site.was_in(&state.session) => {}
            // The lease may still be on its way from another centre.
            false => site.early_state = payload.to_vec(),
        }
    }
}

/// The subject of the documents with the sessions of a site.
fn lease_subject(name: &str) -> String {
    format!("rb.fleet.lease.{name}")
}

impl CentreSite {
    /// Whether a machine had this name since it was last removed.
    fn is_there(&self) -> bool {
        let holder = self.holder.as_ref();
        holder.is_some_and(|holder| !holder.lease.is_removal())
    }

    /// Whether everything has arrived that the last heartbeat vouches for.
    fn completes(&mut self) -> bool {
        let beat = self.beat.as_ref();
        let Some(beat) = beat.filter(|beat| self.known.has_all(&beat.beat)) else {
            return false;
        };
        self.vouched = Some(beat.said);
        self.incomplete_since = None;
        true
    }

    fn is_in(&self, session: &str) -> bool {
        let holder = self.holder.as_ref();
        holder.is_some_and(|holder| holder.lease.session == session)
    }

    /// Whether this is one of the earlier sessions.
    fn was_in(&self, session: &str) -> bool {
        let before = self.holder.iter().flat_map(|holder| &holder.lease.before);
        before.into_iter().any(|run| run.session == session)
    }
}

#[cfg(test)]
mod tests;
