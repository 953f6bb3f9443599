//! Drives the centre.

mod bulk;
mod commands;
mod config;
mod groups;
mod removal;

use super::HubText;
use super::bulk::{BulkWanted, GivenBulk, PreviewWanted, bulk_sites, preview};
use super::command::{GivenCommand, SentEnd};
use super::config::GivenConfig;
use super::link::{Document, HubFiles, Link, Opened};
use super::site_api::SiteWay;
use super::sites::{self, SitesWanted};
use super::streams::{LastDocument, last_of, put};
use super::view;
use crate::access::secret::{hex, random};
use crate::clock::since_boot;
use crate::listen;
use crate::nats::next;
use crate::northbound::broker::session::Tries;
use crate::{warn, warn_of};
use async_nats::{Message, Subject};
use commands::CommandCaller;
use config::{AskedConfig, NewestConfig};
use groups::SetGroups;
use railbus_api::fleet::{
    FleetBulkPreview, FleetBulkSites, FleetCommands, FleetConfig, FleetRemoval, FleetSitePoints,
    FleetSiteTold, FleetSites,
};
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_fleet::bulk::{BulkInput, BulkTold, Bulks};
use railbus_fleet::centre::{Centre, CentreInput, CentreOutput, StoreEnd};
use railbus_fleet::ledger::{CommandTold, Ledger, LedgerInput, SiteSaid};
use railbus_store::history::millis;
use railbus_words::Lang;
use removal::AskedRemoval;
use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::Instant;

/// The maximum number of requests of sites without a reply.
const REPLIES_MAX: usize = 8_192;

/// How often to check whether this process was suspended.
const TICK: Duration = Duration::from_secs(1);
/// The shortest time until something is looked at again without a connection.
const NAP: Duration = Duration::from_millis(100);
/// It was suspended if more than this passed between two checks.
const SUSPENDED: Duration = Duration::from_secs(5);
/// How long a lease that could not be stored is reported.
const TOLD: Duration = Duration::from_secs(60);

/// What is asked of the centre.
pub(super) enum HubCall {
    /// The sites that are wanted.
    Sites(SitesWanted, oneshot::Sender<FleetSites>),
    /// A site with its points; the problem if there is none of this name, or that is not known.
    Site(String, oneshot::Sender<Result<FleetSitePoints, Problem>>),
    /// How a site is asked for this; the problem if it can't be.
    Way(
        String,
        &'static str,
        oneshot::Sender<Result<SiteWay, Problem>>,
    ),
    /// A command to a site; what came of it, or the problem if it was not sent.
    Command(GivenCommand, oneshot::Sender<Result<CommandTold, Problem>>),
    /// A site is to be removed; the problem if it was not, or that is not known.
    Remove(String, oneshot::Sender<Result<FleetRemoval, Problem>>),
    /// A site is to be in these groups; the problem if it is not, or that is not known.
    Groups(
        String,
        Vec<String>,
        oneshot::Sender<Result<FleetSiteTold, Problem>>,
    ),
    /// Which configuration a site is to have, and how far it is; the problem if there is no such
    /// site, or that is not known.
    Config(String, oneshot::Sender<Result<FleetConfig, Problem>>),
    /// A site is to have this configuration; the problem if it is not, or that is not known.
    SetConfig(GivenConfig, oneshot::Sender<Result<FleetConfig, Problem>>),
    /// The newest commands.
    Commands(oneshot::Sender<FleetCommands>),
    /// An order to many sites; whether it is one.
    GiveBulk(GivenBulk, oneshot::Sender<BulkTold>),
    /// No more commands of this order are to be sent, by the wish of this caller.
    StopBulk(String, String, oneshot::Sender<BulkTold>),
    /// An order with these of its sites; the problem if there is none of this id.
    Bulk(
        String,
        BulkWanted,
        oneshot::Sender<Result<FleetBulkSites, Problem>>,
    ),
    /// The sites that an order would go to.
    Preview(PreviewWanted, oneshot::Sender<FleetBulkPreview>),
}

/// The result of a request to a stream.
enum StreamEnd {
    /// Of storing a lease: request number, result, and the problem if there was one.
    Stored(u64, StoreEnd, Option<Problem>),
    /// Of reading the latest lease of a site; none if that failed.
    LeaseRead(String, Option<LastDocument>),
    /// Of removing a site: request number, result of storing it, whether what streams held was
    /// deleted, and the problem if there was one.
    Removed(u64, StoreEnd, bool, Option<Problem>),
    /// Of storing the groups of a site.
    GroupsStored(SetGroups, StoreEnd, Option<Problem>),
    /// Of reading the newest configuration of a site, or of storing one.
    Config(AskedConfig, NewestConfig),
    /// Of storing a record of a command.
    RecordStored(CommandId, StoreEnd, Option<Problem>),
    /// Of reading the latest one; none if that failed.
    RecordRead(CommandId, Option<LastDocument>),
    /// Of sending a command to its site.
    Sent(CommandId, SentEnd),
    /// Of storing a record of an order to many sites: its id, and the number of what was wanted.
    BulkStored((String, u64), StoreEnd, Option<Problem>),
}

/// The site and the id of a command, and the number of what was wanted.
type CommandId = (String, String, u64);

pub(super) struct Driver {
    lang: Lang,
    files: HubFiles,
    centre: Centre,
    ledger: Ledger,
    /// Who waits for what came of a command.
    callers: BTreeMap<u64, CommandCaller>,
    bulks: Bulks,
    /// Who waits for an order to be recorded, or to be stopped.
    bulk_callers: BTreeMap<u64, oneshot::Sender<BulkTold>>,
    /// Who waits for the removal of a site.
    removals: BTreeMap<u64, AskedRemoval>,
    /// The reply subjects of pending requests.
    replies: BTreeMap<u64, Subject>,
    number: u64,
    calls: mpsc::Receiver<HubCall>,
    stopped: watch::Receiver<bool>,
    /// Results of requests to streams. Not bounded itself: the centre bounds the requests.
    ends: (
        mpsc::UnboundedSender<StreamEnd>,
        mpsc::UnboundedReceiver<StreamEnd>,
    ),
    /// Why there is no connection, or what could not be stored, and when that happened.
    error: Option<(Problem, Duration)>,
    /// It was connected at least once, and so knows the sites.
    has_read: bool,
    /// When it was last checked for a suspension.
    checked_at: Duration,
}

/// Why a connection is no longer used.
enum LinkEnd {
    Stopped,
    Broken(Problem),
}

/// What happened at a connection.
enum Heard {
    Hello(Message),
    Said(Message),
    /// A document of the stream FLEET: subject, content and number.
    Fleet(String, Vec<u8>, u64),
    Record(Document),
    End(StreamEnd),
    Call(HubCall),
    /// Time to check for a suspension.
    Tick,
    Ended(LinkEnd),
}

fn ended(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_ENDED).with("reason", reason.to_string())
}

/// The connection was lost before a result of it was looked at: who waits for it is told.
fn lost(end: StreamEnd) {
    match end {
        StreamEnd::GroupsStored(set, ..) => set.lost(),
        StreamEnd::Config(asked, _) => asked.lost(),
        _ => {}
    }
}

/// The wall clock, in seconds since 1970.
fn clock_s() -> i64 {
    millis(SystemTime::now()) / 1_000
}

/// The word of a subject at this position, from 0.
fn word_of(subject: &str, at: usize) -> &str {
    subject.split('.').nth(at).unwrap_or_default()
}

impl Driver {
    pub(super) fn new(
        lang: Lang,
        files: HubFiles,
        calls: mpsc::Receiver<HubCall>,
        stopped: watch::Receiver<bool>,
    ) -> Driver {
        Driver {
            lang,
            files,
            centre: Centre::default(),
            ledger: Ledger::default(),
            callers: BTreeMap::new(),
            bulks: Bulks::default(),
            bulk_callers: BTreeMap::new(),
            removals: BTreeMap::new(),
            replies: BTreeMap::new(),
            number: 0,
            calls,
            stopped,
            ends: mpsc::unbounded_channel(),
            error: None,
            has_read: false,
            checked_at: since_boot(),
        }
    }

    /// Runs until it is to stop.
    pub(super) async fn run(mut self) {
        let mut tries = Tries::default();
        loop {
            let begun = Instant::now();
            let files = self.files.clone();
            let Some(opened) = self.meanwhile(Opened::open(&files)).await else {
                return;
            };
            let problem = match self.connected(opened).await {
                Err(problem) => problem,
                Ok(mut link) => {
                    let end = self.serve(&mut link).await;
                    self.lost();
                    // Results of requests on this connection must not reach the next one.
                    let (_, mut ends) =
                        std::mem::replace(&mut self.ends, mpsc::unbounded_channel());
                    while let Ok(end) = ends.try_recv() {
                        lost(end);
                    }
                    tries.connected_since(begun);
                    match end {
                        LinkEnd::Stopped => return,
                        LinkEnd::Broken(problem) => problem,
                    }
                }
            };
            let (_, wait) = tries.failed();
            self.failed(problem);
            if self.meanwhile(tokio::time::sleep(wait)).await.is_none() {
                return;
            }
        }
    }

    /// Waits for something, and answers what is asked until then; none once it is to stop.
    async fn meanwhile<T>(&mut self, what: impl Future<Output = T>) -> Option<T> {
        let mut what = std::pin::pin!(what);
        loop {
            let due = self.deadline();
            let due = due.map(|due| due.saturating_sub(since_boot()));
            tokio::select! {
                () = listen::ended(&mut self.stopped) => return None,
                end = &mut what => return Some(end),
                call = self.calls.recv() => self.answer(call?, None),
                () = tokio::time::sleep(due.unwrap_or(TICK).max(NAP)) => {}
            }
            self.tell_callers();
        }
    }

    fn handle(&mut self, input: CentreInput<'_>) {
        self.centre.set_clock(millis(SystemTime::now()));
        self.centre.handle(since_boot(), input);
    }

    /// A document of the stream FLEET: a lease, or what people say of a site.
    fn fleet_document(&mut self, subject: &str, payload: &[u8], number: u64) {
        let site = word_of(subject, 3);
        match word_of(subject, 2) {
            "lease" => self.handle(CentreInput::Lease(site, payload, number)),
            "site" => self.handle(CentreInput::Document(site, payload, number)),
            _ => {}
        }
    }

    fn lost(&mut self) {
        self.handle(CentreInput::Lost);
        // First: results that the ledger tells now must not let further sites have their turn.
        self.note_bulk(BulkInput::Lost);
        self.note(LedgerInput::Lost);
        self.tell_callers();
        self.removals_lost();
    }

    /// When the ledger or an order goes on by itself.
    fn deadline(&self) -> Option<Duration> {
        let all = [self.ledger.deadline(), self.bulks.deadline()];
        all.into_iter().flatten().min()
    }

    fn note(&mut self, input: LedgerInput<'_>) {
        self.ledger.set_clock(millis(SystemTime::now()));
        self.ledger.handle(since_boot(), input);
    }

    /// Reports a problem, once.
    fn failed(&mut self, problem: Problem) {
        let is_told = self
            .error
            .as_ref()
            .is_some_and(|(told, _)| *told == problem);
        if !is_told {
            warn_of(self.lang, &Failure::of_problem(self.lang, &problem));
        }
        self.error = Some((problem, since_boot()));
    }

    /// Applies the documents read on a connection, then subscribes.
    async fn connected(&mut self, opened: Result<Opened, Problem>) -> Result<Link, Problem> {
        let mut opened = opened?;
        for document in std::mem::take(&mut opened.documents) {
            let (subject, payload) = (&document.subject, &document.payload);
            if subject.starts_with("rb.cmd.") {
                self.record(&document);
                continue;
            }
            match subject.starts_with("rb.up.") {
                true => {
                    let site = word_of(subject, 2);
                    self.handle(CentreInput::Said(site, "state", payload));
                }
                false => self.fleet_document(subject, payload, document.number),
            }
        }
        let (link, keys) = opened.subscribe(&self.files).await?;
        self.handle(CentreInput::Connected);
        self.note(LedgerInput::Connected);
        self.note_bulk(BulkInput::Connected);
        self.error = None;
        if let Err(problem) = keys {
            // It lasts as long as the connection.
            self.failed(problem);
        }
        self.has_read = true;
        self.checked_at = since_boot();
        let server = link.server();
        warn(&self.lang.fill(HubText::Connected, &[("server", &server)]));
        Ok(link)
    }

    async fn serve(&mut self, link: &mut Link) -> LinkEnd {
        loop {
            let mut stopped = self.stopped.clone();
            let driven = tokio::select! {
                // A stalled connection must not delay the shutdown.
                () = listen::ended(&mut stopped) => return LinkEnd::Stopped,
                driven = self.drive(link) => driven,
            };
            if let Err(problem) = driven {
                return LinkEnd::Broken(problem);
            }
            let heard = self.next(link).await;
            if self.was_suspended() {
                if let Heard::Call(call) = heard {
                    self.lost();
                    self.answer(call, None);
                }
                // Queued leases may be older than the known ones.
                return LinkEnd::Broken(ended(&"this process was suspended"));
            }
            match heard {
                Heard::Hello(message) => self.hello(message),
                Heard::Said(message) => {
                    let what = message.subject.rsplit('.').next().unwrap_or_default();
                    let site = word_of(&message.subject, 2);
                    self.handle(CentreInput::Said(site, what, &message.payload));
                }
                Heard::Fleet(subject, payload, number) => {
                    self.fleet_document(&subject, &payload, number);
                }
                Heard::Record(document) => self.record(&document),
                Heard::End(end) => self.stream_end(end),
                Heard::Tick => {}
                Heard::Call(call) => self.answer(call, Some(link)),
                Heard::Ended(end) => return end,
            }
        }
    }

    async fn next(&mut self, link: &mut Link) -> Heard {
        let broken = |reason: &dyn ToString| Heard::Ended(LinkEnd::Broken(ended(reason)));
        let due = self.deadline();
        let due = due.map(|due| due.saturating_sub(since_boot()));
        let wait = due.map_or(TICK, |due| due.min(TICK));
        tokio::select! {
            () = listen::ended(&mut self.stopped) => Heard::Ended(LinkEnd::Stopped),
            _ = link.is_up.wait_for(|is_up| !is_up) => broken(&"disconnected"),
            hello = next(&mut link.hellos) => hello.map_or_else(|| broken(&"closed"), Heard::Hello),
            said = next(&mut link.said) => said.map_or_else(|| broken(&"closed"), Heard::Said),
            document = next(&mut link.fleet) => match document {
                Some(Ok(document)) => match document.info() {
                    Ok(info) => {
                        let subject = document.subject.to_string();
                        Heard::Fleet(subject, document.payload.to_vec(), info.stream_sequence)
                    }
                    Err(error) => broken(&error),
                },
                Some(Err(error)) => broken(&error),
                None => broken(&"closed"),
            },
            record = next(&mut link.commands) => match record {
                Some(Ok(record)) => match record.info() {
                    Ok(info) => Heard::Record(Document {
                        subject: record.subject.to_string(),
                        payload: record.payload.to_vec(),
                        number: info.stream_sequence,
                        age: Duration::ZERO,
                    }),
                    Err(error) => broken(&error),
                },
                Some(Err(error)) => broken(&error),
                None => broken(&"closed"),
            },
            // There is always a sender.
            Some(end) = self.ends.1.recv() => Heard::End(end),
            () = tokio::time::sleep(wait) => Heard::Tick,
            call = self.calls.recv() => match call {
                Some(call) => Heard::Call(call),
                None => Heard::Ended(LinkEnd::Stopped),
            },
        }
    }

    fn hello(&mut self, message: Message) {
        let Some(reply) = message.reply else {
            return;
        };
        let Ok(session) = random::<16>() else {
            return;
        };
        self.number += 1;
        if self.replies.len() >= REPLIES_MAX {
            self.replies.pop_first();
        }
        self.replies.insert(self.number, reply);
        let (number, site) = (self.number, word_of(&message.subject, 2));
        let hello = CentreInput::Hello(number, site, &message.payload, hex(&session));
        self.handle(hello);
    }

    /// Whether this process was suspended: queued messages are then older than they look, and the
    /// connection is made anew.
    fn was_suspended(&mut self) -> bool {
        let now = since_boot();
        let passed = now.saturating_sub(std::mem::replace(&mut self.checked_at, now));
        let is_old = |(problem, at): &(Problem, Duration)| {
            problem.code == codes::FLEET_NOT_STORED.code && now.saturating_sub(*at) > TOLD
        };
        if self.error.as_ref().is_some_and(is_old) {
            self.error = None;
        }
        passed > SUSPENDED
    }

    fn stream_end(&mut self, end: StreamEnd) {
        match end {
            StreamEnd::Stored(number, end, problem) => {
                if let Some(problem) = problem {
                    self.failed(problem);
                }
                self.handle(CentreInput::Stored(number, end));
            }
            StreamEnd::LeaseRead(site, found) => {
                let found = found.as_ref().map(|found| {
                    let found = found.as_ref();
                    found.map(|(payload, number)| (payload.as_slice(), *number))
                });
                self.handle(CentreInput::LeaseRead(&site, found));
            }
            StreamEnd::GroupsStored(set, end, problem) => self.groups_stored(set, end, problem),
            StreamEnd::Config(asked, newest) => self.config_known(asked, newest),
            StreamEnd::Removed(number, end, is_purged, problem) => {
                self.removal_stored(number, (end, is_purged), problem);
            }
            StreamEnd::RecordStored((site, id, number), end, problem) => {
                if let Some(problem) = problem {
                    self.failed(problem);
                }
                self.note(LedgerInput::Stored((&site, &id), number, end));
            }
            StreamEnd::RecordRead((site, id, of), found) => {
                let found = found.as_ref().map(|found| {
                    let found = found.as_ref();
                    found.map(|(payload, number)| (payload.as_slice(), *number))
                });
                self.note(LedgerInput::Read((&site, &id), of, found));
            }
            StreamEnd::BulkStored((id, number), end, problem) => {
                if let Some(problem) = problem {
                    self.failed(problem);
                }
                self.note_bulk(BulkInput::Stored(&id, number, end));
            }
            StreamEnd::Sent((site, id, number), end) => {
                let said = match &end {
                    SentEnd::Answer(payload) => SiteSaid::Answer(payload),
                    SentEnd::NotDelivered => SiteSaid::NotDelivered,
                    SentEnd::Nothing => SiteSaid::Nothing,
                };
                self.note(LedgerInput::Said((&site, &id), number, said));
            }
        }
    }

    /// There is no site of this name; before the first connection that is not known.
    fn no_site(&self, name: &str) -> Problem {
        match self.has_read {
            true => Problem::new(codes::NO_SUCH_SITE).with("name", name),
            false => self.disconnected(),
        }
    }

    /// Why there is no connection.
    fn disconnected(&self) -> Problem {
        match &self.error {
            Some((problem, _)) => problem.clone(),
            None => ended(&"disconnected"),
        }
    }

    async fn drive(&mut self, link: &mut Link) -> Result<(), Problem> {
        self.drive_commands(link);
        while let Some(output) = self.centre.poll() {
            match output {
                CentreOutput::Reply(number, payload) => {
                    if let Some(reply) = self.replies.remove(&number) {
                        let sent = link.client.publish(reply, payload.into()).await;
                        sent.map_err(|error| ended(&error))?;
                    }
                }
                CentreOutput::Store {
                    number,
                    subject,
                    payload,
                    after,
                } => self.store(link, number, subject, payload, after),
                CentreOutput::StoreRemoval {
                    number,
                    site,
                    subject,
                    payload,
                    after,
                } => self.store_removal(link, (number, site), (subject, payload, after)),
                CentreOutput::RemovalEnded(number, end) => self.removal_ended(number, end),
                CentreOutput::Drop(number) => _ = self.replies.remove(&number),
                CentreOutput::ReadLease(site) => self.read_lease(link, site),
                CentreOutput::Request(subject) => {
                    // If it does not arrive, the request is repeated later.
                    let reply = link.client.new_inbox();
                    let sent = link
                        .client
                        .publish_with_reply(subject, reply, Vec::new().into())
                        .await;
                    sent.map_err(|error| ended(&error))?;
                }
            }
        }
        Ok(())
    }

    fn store(&self, link: &mut Link, number: u64, subject: String, payload: Vec<u8>, after: u64) {
        let (streams, ends) = (link.streams.clone(), self.ends.0.clone());
        tokio::spawn(async move {
            let (end, problem) = put(&streams, subject, payload, after).await;
            // Fails once the centre has ended.
            let _ = ends.send(StreamEnd::Stored(number, end, problem));
        });
    }

    fn read_lease(&self, link: &mut Link, site: String) {
        let (streams, ends) = (link.streams.clone(), self.ends.0.clone());
        tokio::spawn(async move {
            let subject = format!("rb.fleet.lease.{site}");
            let found = last_of(&streams, "FLEET", &subject).await;
            // Fails once the centre has ended.
            let _ = ends.send(StreamEnd::LeaseRead(site, found));
        });
    }

    fn answer(&mut self, call: HubCall, link: Option<&Link>) {
        let (now, clock_s) = (since_boot(), clock_s());
        // Sending fails if the client is gone.
        match call {
            HubCall::Sites(wanted, to) => {
                let error = self.error.as_ref().map(|(problem, _)| problem.clone());
                let unreadable = self.ledger.unreadable();
                let unreadable = unreadable.saturating_add(self.bulks.unreadable());
                let known = (&self.centre, unreadable);
                _ = to.send(sites::sites(known, &wanted, (now, clock_s), error));
            }
            HubCall::Site(name, to) => {
                let site = self.centre.site(now, &name);
                let site = site.as_ref().map(|site| view::site_points(site, clock_s));
                _ = to.send(site.ok_or_else(|| self.no_site(&name)));
            }
            HubCall::Way(name, what, to) => {
                let site = self.centre.site(now, &name);
                let way = match (site, link) {
                    (None, _) => Err(self.no_site(&name)),
                    (Some(_), None) => Err(self.disconnected()),
                    (Some(site), Some(link)) => Ok(link.way(site.name, site.session, what)),
                };
                _ = to.send(way);
            }
            HubCall::Groups(name, groups, to) => self.set_groups(name, &groups, link, to),
            HubCall::Config(name, to) => self.config(name, link, to),
            HubCall::SetConfig(given, to) => self.set_config(given, link, to),
            HubCall::Remove(name, to) => self.remove(name, link.is_some(), to),
            HubCall::Command(given, to) => self.given(given, link, CommandCaller::Client(to)),
            HubCall::Commands(to) => _ = to.send(view::commands(&self.ledger, &self.bulks)),
            HubCall::GiveBulk(given, to) => self.give_bulk(given, to),
            HubCall::StopBulk(id, who, to) => self.stop_bulk(&id, &who, to),
            HubCall::Bulk(id, wanted, to) => _ = to.send(bulk_sites(&self.bulks, &id, &wanted)),
            HubCall::Preview(wanted, to) => {
                _ = to.send(preview(&self.centre, &wanted, (now, clock_s)));
            }
        }
    }
}
