//! Commands to sites.

use super::{Driver, StreamEnd};
use crate::clock::since_boot;
use crate::hub::command::{self, GivenCommand, SentEnd};
use crate::hub::link::{Document, Link};
use crate::hub::streams::{last_of, put};
use railbus_api::problem::Problem;
use railbus_fleet::bulk::{BULK, BulkInput};
use railbus_fleet::ledger::{CommandName, CommandTold, LedgerInput, LedgerOutput};
use railbus_store::history::millis;
use std::time::SystemTime;
use tokio::sync::oneshot;

/// Who waits for what came of a command.
pub(super) enum CommandCaller {
    Client(oneshot::Sender<Result<CommandTold, Problem>>),
    /// It is one of an order to many sites: its site, and the id of both.
    Bulk(String, String),
}

impl Driver {
    /// Answers callers. All other outputs of the ledger need a connection.
    pub(super) fn tell_callers(&mut self) {
        while let Some(output) = self.ledger.poll(since_boot()) {
            if let LedgerOutput::Tell(number, told) = output {
                self.tell(number, told);
            }
        }
        self.drive_bulks(None);
    }

    fn tell(&mut self, number: u64, told: CommandTold) {
        match self.callers.remove(&number) {
            // Fails if the caller is gone.
            Some(CommandCaller::Client(to)) => _ = to.send(Ok(told)),
            Some(CommandCaller::Bulk(site, id)) => {
                self.note_bulk(BulkInput::Told((&site, &id), told));
            }
            None => {}
        }
    }

    /// Carries out the outputs of the ledger and of orders to many sites, of which each gives some
    /// to the other.
    pub(super) fn drive_commands(&mut self, link: &mut Link) {
        loop {
            self.drive_ledger(link);
            self.drive_bulks(Some(link));
            let now = since_boot();
            if self.deadline().is_none_or(|due| due > now) {
                return;
            }
        }
    }

    /// Carries out the outputs of the ledger.
    fn drive_ledger(&mut self, link: &mut Link) {
        while let Some(output) = self.ledger.poll(since_boot()) {
            let ends = self.ends.0.clone();
            match output {
                LedgerOutput::Tell(number, told) => self.tell(number, told),
                LedgerOutput::Store {
                    number,
                    site,
                    id,
                    payload,
                    after,
                } => {
                    let streams = link.streams.clone();
                    let subject = format!("rb.cmd.{site}.{id}");
                    tokio::spawn(async move {
                        let (end, problem) = put(&streams, subject, payload, after).await;
                        // Fails once the centre has ended.
                        let _ =
                            ends.send(StreamEnd::RecordStored((site, id, number), end, problem));
                    });
                }
                LedgerOutput::Read(number, site, id) => {
                    let streams = link.streams.clone();
                    tokio::spawn(async move {
                        let subject = format!("rb.cmd.{site}.{id}");
                        let found = last_of(&streams, "LEDGER", &subject).await;
                        let _ = ends.send(StreamEnd::RecordRead((site, id, number), found));
                    });
                }
                LedgerOutput::Send(number, site, request) => {
                    let now = since_boot();
                    let known = self.centre.site(now, &site);
                    let known = known.filter(|known| !known.session.is_empty());
                    let way = known.map(|known| link.way(&site, known.session, "cmd"));
                    tokio::spawn(async move {
                        let end = match way {
                            Some(way) => command::send(way, &request).await,
                            // It never had a session: there is nobody to send it to.
                            None => SentEnd::NotDelivered,
                        };
                        let _ = ends.send(StreamEnd::Sent((site, request.id, number), end));
                    });
                }
            }
        }
    }

    /// A record of a command, or of an order to many sites.
    pub(super) fn record(&mut self, document: &Document) {
        let Document {
            subject,
            payload,
            number,
            age,
        } = document;
        match command_of(subject) {
            Some((BULK, id)) => self.note_bulk(BulkInput::Record(id, payload, *number, *age)),
            Some(name) => {
                self.note(LedgerInput::Record(name, payload, *number, *age));
                self.note_bulk(BulkInput::Command(name, payload));
            }
            None => {}
        }
    }

    /// A caller gives a command.
    pub(super) fn given(
        &mut self,
        given: GivenCommand,
        link: Option<&Link>,
        caller: CommandCaller,
    ) {
        // Its caller is gone: nothing is switched.
        if matches!(&caller, CommandCaller::Client(to) if to.is_closed()) {
            return;
        }
        let now = since_boot();
        let site = self.centre.site(now, &given.site);
        let time = site.as_ref().map(|site| site.time);
        let at_ms = millis(SystemTime::now());
        let found = match (time, link) {
            // What was given to a site that was removed since is known, too.
            (None, Some(_))
                if given.is_again && self.centre.named_site(now, &given.site).is_some() =>
            {
                given.intent(now, None, at_ms)
            }
            (None, _) => Err(self.no_site(&given.site)),
            // It may have been given before: then it is told what came of it.
            (Some(None), Some(_)) | (Some(_), None) if given.is_again => {
                given.intent(now, None, at_ms)
            }
            (Some(_), None) => Err(self.disconnected()),
            (Some(None), Some(_)) => Err(command::offline(&given.site)),
            (Some(Some(time)), Some(_)) => given.intent(now, Some(time), at_ms),
        };
        let intent = match found {
            Ok(intent) => intent,
            Err(problem) => {
                let is_certain = self.has_read || !given.is_again;
                let problem = problem.perhaps_acted(!is_certain);
                return match caller {
                    // Fails if the client is gone.
                    CommandCaller::Client(to) => _ = to.send(Err(problem)),
                    CommandCaller::Bulk(site, id) => self.bulk_refused(&site, &id, &problem),
                };
            }
        };
        self.number += 1;
        self.callers.insert(self.number, caller);
        let name = (&*given.site, &*given.id);
        self.note(LedgerInput::Given(self.number, name, intent, given.wait()));
    }
}

/// The site and the id in the subject of a command.
fn command_of(subject: &str) -> Option<CommandName<'_>> {
    subject.strip_prefix("rb.cmd.")?.split_once('.')
}
