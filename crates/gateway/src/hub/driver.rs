//! Drives the centre.

use super::HubText;
use super::link::{HubFiles, Link, next};
use super::view;
use crate::access::secret::{hex, random};
use crate::northbound::broker::session::Tries;
use crate::{warn, warn_of};
use async_nats::jetstream::context::PublishErrorKind;
use async_nats::jetstream::message::PublishMessage;
use async_nats::{Message, Subject};
use railbus_api::fleet::{FleetSitePoints, FleetSites};
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_fleet::centre::{Centre, CentreInput, CentreOutput};
use railbus_store::history::millis;
use railbus_words::Lang;
use std::collections::BTreeMap;
use std::time::SystemTime;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::Instant;

/// How many requests of sites are remembered that are not answered: many never are.
const REPLIES_MAX: usize = 8_192;

/// What is asked of the centre.
pub(super) enum HubCall {
    /// All sites.
    Sites(oneshot::Sender<FleetSites>),
    /// A site with its points; none if there is none of this name.
    Site(String, oneshot::Sender<Option<FleetSitePoints>>),
}

/// What became of a document that was to be stored: its number.
type StoredEnd = (u64, Result<u64, Option<Problem>>);

pub(super) struct Driver {
    lang: Lang,
    files: HubFiles,
    centre: Centre,
    began: Instant,
    /// Where the answers to requests of sites go.
    replies: BTreeMap<u64, Subject>,
    number: u64,
    calls: mpsc::Receiver<HubCall>,
    stopped: watch::Receiver<bool>,
    stored: (
        mpsc::UnboundedSender<StoredEnd>,
        mpsc::UnboundedReceiver<StoredEnd>,
    ),
    /// Why it has no connection, or what was not stored.
    error: Option<Problem>,
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
    Lease(String, Vec<u8>, u64),
    Stored(StoredEnd),
    Call(HubCall),
    Ended(LinkEnd),
}

fn ended(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_ENDED).with("reason", reason.to_string())
}

/// The name of a site in a subject that begins with two other words, or three.
fn site_of(subject: &str, at: usize) -> &str {
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
            began: Instant::now(),
            replies: BTreeMap::new(),
            number: 0,
            calls,
            stopped,
            stored: mpsc::unbounded_channel(),
            error: None,
        }
    }

    /// Runs until it is to stop.
    pub(super) async fn run(mut self) {
        let mut tries = Tries::default();
        loop {
            let begun = Instant::now();
            let files = self.files.clone();
            let Some(opened) = self.meanwhile(Link::open(&files)).await else {
                return;
            };
            let problem = match opened {
                Err(problem) => problem,
                Ok(mut link) => {
                    self.connected(&mut link);
                    let end = self.serve(&mut link).await;
                    self.handle(CentreInput::Lost);
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
            tokio::select! {
                () = stop(&mut self.stopped) => return None,
                end = &mut what => return Some(end),
                call = self.calls.recv() => self.answer(call?),
            }
        }
    }

    fn handle(&mut self, input: CentreInput<'_>) {
        self.centre.set_clock(millis(SystemTime::now()));
        self.centre.handle(self.began.elapsed(), input);
    }

    /// Something is wrong; it is said once.
    fn failed(&mut self, problem: Problem) {
        let is_told = self.error.as_ref().is_some_and(|told| *told == problem);
        if !is_told {
            warn_of(self.lang, &Failure::of_problem(self.lang, &problem));
        }
        self.error = Some(problem);
    }

    fn connected(&mut self, link: &mut Link) {
        let documents = std::mem::take(&mut link.documents);
        for (subject, payload, number) in &documents {
            match subject.starts_with("rb.up.") {
                true => {
                    let site = site_of(subject, 2);
                    self.handle(CentreInput::Said(site, "state", payload));
                }
                false => {
                    let site = site_of(subject, 3);
                    self.handle(CentreInput::Lease(site, payload, *number));
                }
            }
        }
        self.handle(CentreInput::Connected);
        self.error = None;
        let server = link.server();
        warn(&self.lang.fill(HubText::Connected, &[("server", &server)]));
    }

    async fn serve(&mut self, link: &mut Link) -> LinkEnd {
        loop {
            if let Err(problem) = self.drive(link).await {
                return LinkEnd::Broken(problem);
            }
            match self.next(link).await {
                Heard::Hello(message) => self.hello(message),
                Heard::Said(message) => {
                    let what = message.subject.rsplit('.').next().unwrap_or_default();
                    let site = site_of(&message.subject, 2);
                    self.handle(CentreInput::Said(site, what, &message.payload));
                }
                Heard::Lease(site, payload, number) => {
                    self.handle(CentreInput::Lease(&site, &payload, number));
                }
                Heard::Stored((number, end)) => self.was_stored(number, end),
                Heard::Call(call) => self.answer(call),
                Heard::Ended(end) => return end,
            }
        }
    }

    async fn next(&mut self, link: &mut Link) -> Heard {
        let broken = |reason: &dyn ToString| Heard::Ended(LinkEnd::Broken(ended(reason)));
        tokio::select! {
            () = stop(&mut self.stopped) => Heard::Ended(LinkEnd::Stopped),
            _ = link.is_up.wait_for(|is_up| !is_up) => broken(&"disconnected"),
            hello = next(&mut link.hellos) => hello.map_or_else(|| broken(&"closed"), Heard::Hello),
            said = next(&mut link.said) => said.map_or_else(|| broken(&"closed"), Heard::Said),
            lease = next(&mut link.leases) => match lease {
                Some(Ok(lease)) => {
                    let number = lease.info().map_or(0, |info| info.stream_sequence);
                    let site = site_of(&lease.subject, 3).to_owned();
                    Heard::Lease(site, lease.payload.to_vec(), number)
                }
                Some(Err(error)) => broken(&error),
                None => broken(&"closed"),
            },
            // There is always a sender.
            Some(end) = self.stored.1.recv() => Heard::Stored(end),
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
        let (number, site) = (self.number, site_of(&message.subject, 2));
        let hello = CentreInput::Hello(number, site, &message.payload, hex(&session));
        self.handle(hello);
    }

    fn was_stored(&mut self, number: u64, end: Result<u64, Option<Problem>>) {
        let is_stored = |problem: &Problem| problem.code == codes::FLEET_NOT_STORED.code;
        match &end {
            Ok(_) if self.error.as_ref().is_some_and(is_stored) => self.error = None,
            Err(Some(problem)) => self.failed(problem.clone()),
            _ => {}
        }
        self.handle(CentreInput::Stored(number, end.ok()));
    }

    async fn drive(&mut self, link: &mut Link) -> Result<(), Problem> {
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
                CentreOutput::Ask(subject) => {
                    // Whoever does not hear it is asked again.
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
        let (streams, stored) = (link.streams.clone(), self.stored.0.clone());
        tokio::spawn(async move {
            let message = PublishMessage::build()
                .payload(payload.into())
                .expected_last_subject_sequence(after);
            let end = match streams.send_publish(subject, message).await {
                Ok(sent) => sent.await.map(|stored| stored.sequence),
                Err(error) => Err(error),
            };
            let end = end.map_err(|error| match error.kind() {
                // Another centre was first.
                PublishErrorKind::WrongLastSequence => None,
                _ => {
                    let reason = error.to_string();
                    Some(Problem::new(codes::FLEET_NOT_STORED).with("reason", reason))
                }
            });
            // Fails once the centre has ended.
            let _ = stored.send((number, end));
        });
    }

    fn answer(&self, call: HubCall) {
        let now = self.began.elapsed();
        // Whoever asked may be gone.
        match call {
            HubCall::Sites(to) => {
                _ = to.send(view::sites(&self.centre, now, self.error.clone()));
            }
            HubCall::Site(name, to) => {
                let site = self.centre.site(now, &name);
                _ = to.send(site.as_ref().map(view::site_points));
            }
        }
    }
}

/// Waits until it is to stop.
async fn stop(stopped: &mut watch::Receiver<bool>) {
    // Fails where there is nobody left who could say so.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}
