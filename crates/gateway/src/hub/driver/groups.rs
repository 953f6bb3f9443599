//! The groups that sites are in.

use super::{Driver, StreamEnd, clock_s, ended};
use crate::clock::since_boot;
use crate::hub::link::Link;
use crate::hub::streams::{last_of, put};
use crate::hub::view::{self, SCHEMA};
use railbus_api::fleet::FleetSiteTold;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::centre::{CentreInput, StoreEnd, document_subject, site_document};
use railbus_fleet::is_site_name;
use tokio::sync::mpsc::error::SendError;
use tokio::sync::oneshot;

/// A document of a site that somebody wants to be stored.
pub(super) struct SetGroups {
    site: String,
    document: Vec<u8>,
    to: oneshot::Sender<Result<FleetSiteTold, Problem>>,
}

impl SetGroups {
    /// The connection is lost: whether they were stored is not known.
    pub(super) fn lost(self) {
        // Fails if the client is gone.
        let _ = self
            .to
            .send(Err(ended(&"disconnected").perhaps_acted(true)));
    }
}

impl Driver {
    /// A site is to be in these groups, also before it ever reported.
    pub(super) fn set_groups(
        &self,
        site: String,
        groups: &[String],
        link: Option<&Link>,
        to: oneshot::Sender<Result<FleetSiteTold, Problem>>,
    ) {
        let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
        let document = match (is_site_name(&site), site_document(groups), link) {
            _ if !self.centre.has_place(&site) => Err(wrong("the fleet has too many sites")),
            (false, _, _) => Err(wrong("a site's name has 1 to 64 of a-z, 0-9, - and _")),
            (true, None, _) => Err(wrong(
                "a site is in at most 16 groups, each named with 1 to 64 of a-z, 0-9, - and _",
            )),
            (true, Some(_), None) => Err(self.disconnected()),
            (true, Some(document), Some(link)) => Ok((document, link)),
        };
        let (document, link) = match document {
            Ok(document) => document,
            Err(problem) => {
                // Fails if the client is gone.
                let _ = to.send(Err(problem));
                return;
            }
        };
        let (streams, ends) = (link.streams.clone(), self.ends.0.clone());
        let set = SetGroups { site, document, to };
        tokio::spawn(async move {
            let subject = document_subject(&set.site);
            let (end, problem) = match last_of(&streams, "FLEET", &subject).await {
                None => {
                    let problem = Problem::new(codes::FLEET_STREAMS);
                    let problem = problem.with("reason", "the stream can't be read");
                    (StoreEnd::Unknown, Some(problem))
                }
                Some(last) => {
                    let after = last.map_or(0, |(_, revision)| revision);
                    let (end, problem) = put(&streams, subject, set.document.clone(), after).await;
                    (end, problem.map(|problem| problem.perhaps_acted(true)))
                }
            };
            // Fails once the connection has ended.
            if let Err(SendError(StreamEnd::GroupsStored(set, ..))) =
                ends.send(StreamEnd::GroupsStored(set, end, problem))
            {
                set.lost();
            }
        });
    }

    /// They were stored, or not.
    pub(super) fn groups_stored(&mut self, set: SetGroups, end: StoreEnd, why: Option<Problem>) {
        let SetGroups { site, document, to } = set;
        let told = match end {
            StoreEnd::Stored(revision) => {
                self.handle(CentreInput::Document(&site, &document, revision));
                let view = self.centre.named_site(since_boot(), &site);
                let told = view.map(|view| FleetSiteTold {
                    schema: SCHEMA,
                    site: view::site(&view, clock_s()),
                });
                // Others took the last place meanwhile.
                told.ok_or_else(|| self.no_site(&site).perhaps_acted(true))
            }
            StoreEnd::Conflict => Err(Problem::new(codes::SITE_CHANGING).with("name", site)),
            StoreEnd::Unknown => {
                let stored = || Problem::new(codes::FLEET_NOT_STORED).perhaps_acted(true);
                Err(why.unwrap_or_else(stored))
            }
        };
        // Fails if the client is gone.
        let _ = to.send(told);
    }
}
