//! What the centre knows, as its API has it.

use super::{bulk, config};
use railbus_api::fleet::{
    FleetAttention, FleetCommand, FleetCommandEnd, FleetCommands, FleetPoint, FleetPresence,
    FleetSite, FleetSitePoints,
};
use railbus_api::types::Quality;
use railbus_app::api::past::moment;
use railbus_fleet::bulk::Bulks;
use railbus_fleet::centre::{KnownPoint, SiteAttention, SitePresence, SiteView};
use railbus_fleet::ledger::{CommandView, EndView, Ledger};
use railbus_fleet::message::{ReadingQuality, UplinkValue};
use serde_json::Value;
use std::time::Duration;

/// The version of the API.
pub(super) const SCHEMA: u8 = 1;

/// A site with its points.
pub(super) fn site_points(view: &SiteView<'_>, clock_s: i64) -> FleetSitePoints {
    let points = view.points.iter();
    FleetSitePoints {
        schema: SCHEMA,
        site: site(view, clock_s),
        points: points
            .map(|(path, known)| point(view, path, known))
            .collect(),
    }
}

/// The newest commands, the newest last.
pub(super) fn commands(ledger: &Ledger, bulks: &Bulks) -> FleetCommands {
    let command = |view: &CommandView| {
        let (method, path, body) = view.what.clone();
        FleetCommand {
            site: view.site.clone(),
            id: view.id.clone(),
            user: view.user.clone(),
            at: moment(view.at_ms),
            method,
            path,
            body,
            end: view
                .end
                .as_ref()
                .map_or_else(FleetCommandEnd::default, end_of),
        }
    };
    FleetCommands {
        schema: SCHEMA,
        open: ledger.open(),
        commands: ledger.recent().map(command).collect(),
        bulk: bulk::all(bulks),
    }
}

/// The result of a command.
pub(super) fn end_of(end: &EndView) -> FleetCommandEnd {
    FleetCommandEnd {
        how: Some(end.how.to_owned()),
        code: end.code.clone(),
        title: None,
        confirmed: end.confirmed.clone(),
        reason: Some(end.reason.clone()).filter(|reason| !reason.is_empty()),
        end_at: Some(moment(end.at_ms)),
    }
}

/// A site at this time, in seconds since 1970.
pub(super) fn site(view: &SiteView<'_>, clock_s: i64) -> FleetSite {
    let ms = |time: Duration| u64::try_from(time.as_millis()).unwrap_or(u64::MAX);
    FleetSite {
        site: view.name.to_owned(),
        presence: presence(view.presence),
        heard_ms: view.heard.map(ms),
        current: view.is_current,
        known_ms: view.vouched.map(ms),
        behind: view.behind,
        points: view.points.len(),
        clock_ahead_ms: view.clock_ahead_ms,
        version: view.version.to_owned(),
        key_until: view
            .key_expires_s
            .map(|at| moment(at.saturating_mul(1_000))),
        duplicate_ms: view.duplicate.map(ms),
        groups: view.groups.to_vec(),
        config: view.config.map(config::brief),
        attention: view.attention(clock_s).map(attention).collect(),
    }
}

/// Whether a site is there.
pub(super) const fn presence(presence: SitePresence) -> FleetPresence {
    match presence {
        SitePresence::Online => FleetPresence::Online,
        SitePresence::Offline => FleetPresence::Offline,
        SitePresence::Unknown => FleetPresence::Unknown,
    }
}

const fn attention(why: SiteAttention) -> FleetAttention {
    match why {
        SiteAttention::Offline => FleetAttention::Offline,
        SiteAttention::NotCurrent => FleetAttention::NotCurrent,
        SiteAttention::Duplicate => FleetAttention::Duplicate,
        SiteAttention::Clock => FleetAttention::Clock,
        SiteAttention::Key => FleetAttention::Key,
        SiteAttention::Config => FleetAttention::Config,
    }
}

/// A point of a site, as good as it is known.
pub(super) fn point(view: &SiteView<'_>, path: &str, known: &KnownPoint) -> FleetPoint {
    let reading = &known.reading;
    let quality = match reading.quality() {
        ReadingQuality::Good => Quality::Good,
        ReadingQuality::Stale => Quality::Stale,
        // One of a newer version.
        ReadingQuality::Bad | ReadingQuality::Unspecified => Quality::Bad,
    };
    let own = Some(reading.reason.clone()).filter(|reason| !reason.is_empty());
    // What was said is so no longer, or that is not known.
    let (quality, reason) = match (view.is_current, view.presence) {
        (true, _) => (quality, own),
        (false, presence) => {
            let reason = match presence {
                SitePresence::Offline => "site_offline",
                SitePresence::Unknown => "site_unknown",
                SitePresence::Online => "incomplete",
            };
            let quality = match quality {
                Quality::Good => Quality::Stale,
                other => other,
            };
            (quality, Some(reason.to_owned()))
        }
    };
    FleetPoint {
        path: path.to_owned(),
        value: reading.value.as_ref().map(value),
        quality,
        reason,
        since: moment(known.at_ms),
        time: reading.read_ms.map(moment),
    }
}

fn value(value: &UplinkValue) -> Value {
    match value {
        UplinkValue::On(on) => Value::from(*on),
        UplinkValue::Count(count) => Value::from(*count),
        UplinkValue::Number(number) => Value::from(*number),
        UplinkValue::Text(text) => Value::from(text.clone()),
    }
}
