//! `railbus fleet get`: the points of a site.

use super::FleetText;
use super::ls::ago;
use crate::commands::{Context, ls};
use clap::{Arg, ArgMatches, Command};
use railbus_api::fleet::{FleetPoint, FleetSite};
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{out, values};
use railbus_app::texts::AppText;
use railbus_words::{Code, Lang};
use serde_json::Value;

/// The name of the command.
pub(super) const NAME: &str = "get";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let usage = "railbus fleet get SITE [POINT…]";
    let points = Arg::new("POINT")
        .help(lang.get(FleetText::Points))
        .num_args(0..);
    super::verb(lang, NAME, FleetText::Get, usage)
        .arg(super::required(lang, "SITE", FleetText::SiteName))
        .arg(points)
}

/// Prints the points. Values that are not current are shown, and are a failure.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let name = super::text(matches, "SITE");
    let told = super::ask(context, matches, async |hub| hub.site(name).await)?;
    let wanted: Vec<&String> = matches.get_many("POINT").into_iter().flatten().collect();
    let is_of = |point: &FleetPoint, name: &str| {
        let rest = point.path.strip_prefix(name);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    let none = wanted
        .iter()
        .find(|name| !told.points.iter().any(|point| is_of(point, name)));
    if let Some(missing) = none {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &name), ("name", missing)];
        let message = lang.fill(FleetText::NoSuchPoint, values);
        let failure = Failure::new(Code::NoPoint, message);
        return Err(failure.with_try(format!("railbus fleet get {name}")));
    }
    let is_wanted =
        |point: &&FleetPoint| wanted.is_empty() || wanted.iter().any(|name| is_of(point, name));
    let points: Vec<FleetPoint> = told.points.iter().filter(is_wanted).cloned().collect();
    let mut table = Table::bare().spare(&[3]);
    for point in &points {
        table.add([
            point.path.clone(),
            value(lang, point.value.as_ref()),
            quality(lang, point),
            point.time.clone().unwrap_or_default(),
        ]);
    }
    let shown = Records {
        key: "points",
        rows: ls::json_of(&points),
        columns: &["path", "value", "quality", "reason", "since", "time"],
        value: "value",
        table,
    };
    out::result(lang, &shown.render(context.format))?;
    match told.site.current {
        true => {
            // A change is told within seconds; until then this is the last that was said.
            let ago = ago(lang, told.site.known_ms.unwrap_or_default());
            context.note(&lang.fill(FleetText::AsOf, &[("ago", &ago)]));
            Ok(())
        }
        false => Err(not_current(lang, &told.site)),
    }
}

/// A value, as it is read.
pub(super) fn value(lang: Lang, value: Option<&Value>) -> String {
    match value {
        None | Some(Value::Null) => "–".to_owned(),
        Some(Value::Bool(on)) => values::state(lang, *on).to_owned(),
        Some(Value::String(text)) => text.clone(),
        Some(number) => number.to_string(),
    }
}

/// The quality of a point, and why it is not good.
pub(super) fn quality(lang: Lang, point: &FleetPoint) -> String {
    let of_site = match point.reason.as_deref() {
        Some("site_offline") => Some(FleetText::SiteOffline),
        Some("site_unknown") => Some(FleetText::SiteUnknown),
        Some("incomplete") => Some(FleetText::Incomplete),
        _ => None,
    };
    // A reason of a newer site has no word here.
    let reason = point.reason.clone().map(Value::String);
    let reason = reason.and_then(|reason| serde_json::from_value(reason).ok());
    let word = values::quality_for(lang, point.quality, reason);
    match of_site {
        None => word.to_owned(),
        Some(why) => format!("{word}{}{}", lang.get(AppText::Comma), lang.get(why)),
    }
}

fn not_current(lang: Lang, site: &FleetSite) -> Failure {
    let message = match site.known_ms {
        Some(ms) => {
            let ago = ago(lang, ms);
            let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &site.site), ("ago", &ago)];
            lang.fill(FleetText::WereSo, values)
        }
        None => lang.fill(FleetText::NeverSo, &[("site", &site.site)]),
    };
    Failure::new(Code::NotCurrent, message).diagnosed()
}
