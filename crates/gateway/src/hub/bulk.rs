//! One command to many sites: how it is given, and what is told of it.

use super::command::GivenCommand;
use super::driver::HubCall;
use super::routes::{Calls, call};
use super::sites::{ListWindow, SitesWanted};
use super::view::{SCHEMA, end_of, point};
use crate::events::unreadable;
use axum::body::Bytes;
use railbus_api::fleet::{
    FleetBulk, FleetBulkCounts, FleetBulkPreview, FleetBulkSite, FleetBulkSites, FleetBulkState,
    FleetBulkTarget, FleetCommandEnd, FleetPresence, GiveBulk, PreviewBulk,
};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::past::moment;
use railbus_fleet::bulk::{BulkSiteState, BulkTold, BulkView, BulkWrong, Bulks};
use railbus_fleet::centre::{Centre, SitePresence};
use railbus_fleet::message::BulkOrder;
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::Duration;

/// The longest body of an order, in bytes.
pub(super) const BULK_BODY_MAX: usize = 512 << 10;
/// The parameters of one of them, with descriptions.
pub(super) const QUERY: &[(&str, &str)] = &[
    (
        "state",
        "waiting, sent, done, unconfirmed, failed, never, unknown",
    ),
    (
        "limit",
        "how many sites are listed; all where it is not said",
    ),
    ("offset", "how many are left out before these"),
];
/// The longest body that is shown, in characters.
const BODY_SHOWN: usize = 200;

/// The path of the preview, which no order can have.
const PREVIEW: &str = "preview";

/// The body of a request to a site; none if it is left out.
fn bytes(body: &Value) -> Bytes {
    match body {
        Value::Null => Bytes::new(),
        body => body.to_string().into(),
    }
}

/// An order as it was given.
pub(super) struct GivenBulk {
    pub(super) id: String,
    /// The caller gave the id: it may have been given before.
    pub(super) is_again: bool,
    pub(super) order: BulkOrder,
}

impl GivenBulk {
    /// The order of this request.
    ///
    /// # Errors
    /// [`codes::NOT_REMOTE`] if it is no command; [`codes::BAD_REQUEST`] if its key is not valid,
    /// its path or body too long, or its sites can't be.
    pub(super) fn new(
        wanted: GiveBulk,
        key: Option<&str>,
        who: (&str, &str),
    ) -> Result<GivenBulk, Problem> {
        let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
        if key == Some(PREVIEW) {
            return Err(wrong("this Idempotency-Key has another meaning here"));
        }
        let body = bytes(&wanted.body);
        let place = (wanted.method.as_str(), wanted.path.as_str());
        let given = GivenCommand::new((String::new(), key), place, body, who)?;
        let (id, is_again) = (given.id.clone(), given.is_again);
        let order = given.into_order(wanted.sites)?;
        order.check().map_err(|why| {
            wrong(match why {
                BulkWrong::Count => "a command goes to 1 to 10000 sites",
                BulkWrong::Name => "a site's name has 1 to 64 of a-z, 0-9, - and _",
                BulkWrong::Twice => "a site is named twice",
                BulkWrong::TooLong => "the names of the sites have more than 250 KB together",
            })
        })?;
        Ok(GivenBulk {
            id,
            is_again,
            order,
        })
    }
}

/// Which sites of an order are wanted.
#[derive(Clone, Debug, Default)]
pub(super) struct BulkWanted {
    state: Option<FleetBulkState>,
    window: ListWindow,
}

impl BulkWanted {
    /// Those of these parameters.
    ///
    /// # Errors
    /// [`codes::BAD_REQUEST`] if one can't be read.
    pub(super) fn of(asked: &BTreeMap<String, String>) -> Result<BulkWanted, Problem> {
        let state = match asked.get("state").map(String::as_str) {
            None => None,
            Some("waiting") => Some(FleetBulkState::Waiting),
            Some("sent") => Some(FleetBulkState::Sent),
            Some("done") => Some(FleetBulkState::Done),
            Some("unconfirmed") => Some(FleetBulkState::Unconfirmed),
            Some("failed") => Some(FleetBulkState::Failed),
            Some("never") => Some(FleetBulkState::Never),
            Some("unknown") => Some(FleetBulkState::Unknown),
            Some(_) => return Err(unreadable("state")),
        };
        Ok(BulkWanted {
            state,
            window: ListWindow::of(asked)?,
        })
    }
}

/// Gives an order, and returns it with its sites.
pub(super) async fn give(
    calls: &Calls,
    given: GivenBulk,
    wanted: BulkWanted,
) -> Result<FleetBulkSites, Problem> {
    let (id, is_again) = (given.id.clone(), given.is_again);
    let told = call(calls, |to| HubCall::GiveBulk(given, to)).await;
    // The centre is stopping: it may have been recorded.
    let told = told.map_err(|problem| problem.perhaps_acted(true))?;
    refused(&id, told, is_again)?;
    see(calls, id, wanted).await
}

/// Stops an order, by the wish of this caller, and returns it with its sites.
pub(super) async fn stop(
    calls: &Calls,
    id: String,
    who: String,
    wanted: BulkWanted,
) -> Result<FleetBulkSites, Problem> {
    let of = id.clone();
    let told = call(calls, |to| HubCall::StopBulk(of, who, to)).await;
    let told = told.map_err(|problem| problem.perhaps_acted(true))?;
    refused(&id, told, true)?;
    see(calls, id, wanted).await
}

/// An order with its sites.
pub(super) async fn see(
    calls: &Calls,
    id: String,
    wanted: BulkWanted,
) -> Result<FleetBulkSites, Problem> {
    call(calls, |to| HubCall::Bulk(id, wanted, to)).await?
}

/// The problem of an order that is not carried out, or of which that is not known.
fn refused(id: &str, told: BulkTold, is_again: bool) -> Result<(), Problem> {
    let open = || {
        let reason = "it is not known whether it was recorded before";
        let problem = Problem::new(codes::COMMAND_OPEN).with("id", id);
        problem.with("reason", reason).perhaps_acted(true)
    };
    Err(match told {
        BulkTold::Known => return Ok(()),
        BulkTold::OtherOrder => Problem::new(codes::BAD_REQUEST)
            .with("reason", "this Idempotency-Key stands for another command"),
        BulkTold::NoSuch => no_bulk(id),
        BulkTold::NotStored if !is_again => {
            let reason = "not sent: it could not be recorded first";
            Problem::new(codes::FLEET_NOT_STORED).with("reason", reason)
        }
        BulkTold::NotStored | BulkTold::NotKnown => open(),
        BulkTold::TooMany if is_again => open(),
        BulkTold::TooMany => Problem::new(codes::OVERLOADED)
            .with("reason", "too many commands to several sites at a time"),
    })
}

fn no_bulk(id: &str) -> Problem {
    Problem::new(codes::NO_SUCH_BULK).with("id", id)
}

/// An order with the sites that are wanted.
pub(super) fn bulk_sites(
    bulks: &Bulks,
    id: &str,
    wanted: &BulkWanted,
) -> Result<FleetBulkSites, Problem> {
    let view = bulks.get(id).ok_or_else(|| no_bulk(id))?;
    let (mut total, mut sites) = (0, Vec::new());
    for (site, state, result) in view.sites() {
        let state = state_of(state);
        if wanted.state.is_some_and(|wanted| wanted != state) {
            continue;
        }
        if wanted.window.has(total) {
            sites.push(FleetBulkSite {
                site: site.to_owned(),
                state,
                end: result.map_or_else(FleetCommandEnd::default, end_of),
            });
        }
        total += 1;
    }
    Ok(FleetBulkSites {
        schema: SCHEMA,
        connected: bulks.is_connected(),
        bulk: bulk(&view),
        total,
        sites,
    })
}

/// All orders, the newest last.
pub(super) fn all(bulks: &Bulks) -> Vec<FleetBulk> {
    bulks.iter().map(|view| bulk(&view)).collect()
}

fn bulk(view: &BulkView<'_>) -> FleetBulk {
    let body = String::from_utf8_lossy(&view.order.body);
    let mut counts = FleetBulkCounts::default();
    for (_, state, _) in view.sites() {
        counts.all += 1;
        *match state {
            BulkSiteState::Waiting => &mut counts.waiting,
            BulkSiteState::Sent => &mut counts.sent,
            BulkSiteState::Done => &mut counts.done,
            BulkSiteState::Unconfirmed => &mut counts.unconfirmed,
            BulkSiteState::Failed => &mut counts.failed,
            BulkSiteState::Never => &mut counts.never,
            BulkSiteState::Unknown => &mut counts.unknown,
        } += 1;
    }
    FleetBulk {
        id: view.id.to_owned(),
        user: view.order.user.clone(),
        at: moment(view.order.at_ms),
        method: view.order.method.clone(),
        path: view.order.path.clone(),
        body: body.chars().take(BODY_SHOWN).collect(),
        counts,
        stopped_by: view.stopped_by.map(str::to_owned),
        ended_at: view.ended_ms.map(moment),
    }
}

const fn state_of(state: BulkSiteState) -> FleetBulkState {
    match state {
        BulkSiteState::Waiting => FleetBulkState::Waiting,
        BulkSiteState::Sent => FleetBulkState::Sent,
        BulkSiteState::Done => FleetBulkState::Done,
        BulkSiteState::Unconfirmed => FleetBulkState::Unconfirmed,
        BulkSiteState::Failed => FleetBulkState::Failed,
        BulkSiteState::Never => FleetBulkState::Never,
        BulkSiteState::Unknown => FleetBulkState::Unknown,
    }
}

/// What is asked before an order is given.
pub(super) struct PreviewWanted {
    sites: SitesWanted,
    /// The path of the output, if it is for one.
    output: Option<String>,
}

impl PreviewWanted {
    /// That of this request.
    ///
    /// # Errors
    /// [`codes::NOT_REMOTE`] if it is no command; [`codes::BAD_REQUEST`] if it can't be read.
    pub(super) fn new(wanted: &PreviewBulk) -> Result<PreviewWanted, Problem> {
        let body = bytes(&wanted.body);
        let place = (wanted.method.as_str(), wanted.path.as_str());
        GivenCommand::new((String::new(), None), place, body, ("", ""))?;
        // One that is misspelt would select all.
        let known = ["search", "state", "group"];
        let unknown = wanted
            .select
            .keys()
            .find(|key| !known.contains(&key.as_str()));
        // An empty one, as a script may have by mistake, would, too.
        let is_empty = |(_, text): &(&String, &String)| text.trim().is_empty();
        let empty = wanted.select.iter().find(is_empty).map(|(key, _)| key);
        if let Some(key) = unknown.or(empty) {
            return Err(unreadable(key));
        }
        Ok(PreviewWanted {
            sites: SitesWanted::of(&wanted.select)?,
            output: output(&wanted.path),
        })
    }
}

/// The output that a command is for: `oven.k1` of `/api/v1/points/oven/k1/toggle`.
fn output(path: &str) -> Option<String> {
    let path = path.split('?').next().unwrap_or_default();
    let rest = path.strip_prefix("/api/v1/points/")?;
    let mut parts = rest.split('/');
    let (module, label) = (parts.next()?, parts.next()?);
    // Other letters can't stand in a name.
    (!path.contains('%')).then(|| format!("{module}.{label}"))
}

/// The sites that are wanted, at this time since the start, and what would become of each.
pub(super) fn preview(
    centre: &Centre,
    wanted: &PreviewWanted,
    (now, clock_s): (Duration, i64),
) -> FleetBulkPreview {
    let mut sites = Vec::new();
    for view in centre.sites(now) {
        if !wanted.sites.finds(&view, clock_s) {
            continue;
        }
        let output = wanted.output.as_ref();
        let known = output.and_then(|path| {
            let known = view.points.get(path)?;
            Some(point(&view, path, known))
        });
        // What it has is known only where all has arrived.
        let has_none = output.is_some() && known.is_none() && view.is_current;
        let (presence, code) = match view.presence {
            SitePresence::Online if has_none => (FleetPresence::Online, Some("E0802")),
            SitePresence::Online => (FleetPresence::Online, None),
            SitePresence::Offline => (FleetPresence::Offline, Some("E0168")),
            SitePresence::Unknown => (FleetPresence::Unknown, Some("E0168")),
        };
        sites.push(FleetBulkTarget {
            site: view.name.to_owned(),
            presence,
            point: known,
            code: code.map(str::to_owned),
        });
    }
    let is_sendable = |site: &&FleetBulkTarget| site.presence == FleetPresence::Online;
    FleetBulkPreview {
        schema: SCHEMA,
        sendable: sites.iter().filter(is_sendable).count(),
        sites,
    }
}

#[cfg(test)]
mod tests;
