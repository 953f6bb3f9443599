//! One command to many sites.

use super::commands::CommandCaller;
use super::{Driver, StreamEnd};
use crate::clock::since_boot;
use crate::hub::bulk::GivenBulk;
use crate::hub::command::GivenCommand;
use crate::hub::link::Link;
use crate::hub::streams::put;
use railbus_api::problem::Problem;
use railbus_fleet::bulk::{BULK, BulkInput, BulkOutput, BulkTold};
use railbus_fleet::message::FleetRefusal;
use railbus_store::history::millis;
use std::time::SystemTime;
use tokio::sync::oneshot;

impl Driver {
    pub(super) fn note_bulk(&mut self, input: BulkInput<'_>) {
        self.bulks.set_clock(millis(SystemTime::now()));
        self.bulks.handle(since_boot(), input);
    }

    /// A caller gives an order.
    pub(super) fn give_bulk(&mut self, given: GivenBulk, to: oneshot::Sender<BulkTold>) {
        // Its caller is gone: nothing is switched.
        if to.is_closed() {
            return;
        }
        let GivenBulk { id, order, .. } = given;
        self.number += 1;
        self.bulk_callers.insert(self.number, to);
        self.note_bulk(BulkInput::Given(self.number, &id, order));
    }

    /// A caller wants no more of its commands to be sent.
    pub(super) fn stop_bulk(&mut self, id: &str, who: &str, to: oneshot::Sender<BulkTold>) {
        self.number += 1;
        self.bulk_callers.insert(self.number, to);
        self.note_bulk(BulkInput::Stop(self.number, id, who));
    }

    /// Carries out what is to be done for orders. Without a connection only callers are answered.
    pub(super) fn drive_bulks(&mut self, link: Option<&Link>) {
        while let Some(output) = self.bulks.poll(since_boot()) {
            match output {
                BulkOutput::Tell(number, told) => {
                    if let Some(caller) = self.bulk_callers.remove(&number) {
                        // Fails if the caller is gone.
                        let _ = caller.send(told);
                    }
                }
                BulkOutput::Begin { id, site } => self.begin(&id, &site, link),
                BulkOutput::Store {
                    number,
                    id,
                    payload,
                    after,
                } => {
                    let Some(link) = link else { continue };
                    let (streams, ends) = (link.streams.clone(), self.ends.0.clone());
                    tokio::spawn(async move {
                        let subject = format!("rb.cmd.{BULK}.{id}");
                        let (end, problem) = put(&streams, subject, payload, after).await;
                        // Fails once the centre has ended.
                        let _ = ends.send(StreamEnd::BulkStored((id, number), end, problem));
                    });
                }
            }
        }
    }

    /// Gives the command of an order to a site.
    fn begin(&mut self, id: &str, site: &str, link: Option<&Link>) {
        let Some(order) = self.bulks.order(id) else {
            return;
        };
        let given = GivenCommand::of_order(order, (site, id));
        let caller = CommandCaller::Bulk(site.to_owned(), id.to_owned());
        self.given(given, link, caller);
    }

    /// A site was not commanded.
    pub(super) fn bulk_refused(&mut self, site: &str, id: &str, problem: &Problem) {
        let reason = problem
            .with
            .get("reason")
            .and_then(|reason| reason.as_str());
        let why = FleetRefusal {
            code: problem.code.clone(),
            reason: reason.unwrap_or_default().to_owned(),
        };
        self.note_bulk(BulkInput::Refused((site, id), why));
    }
}
