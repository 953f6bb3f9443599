//! `railbus fleet remove`: a site that is gone for good.

use super::FleetText;
use crate::commands::Context;
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_words::Lang;
use serde_json::json;

/// The name of the command.
pub(super) const NAME: &str = "remove";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    super::verb(lang, NAME, FleetText::Remove, "railbus fleet remove SITE").arg(super::required(
        lang,
        "SITE",
        FleetText::SiteName,
    ))
}

/// Removes a site that is offline.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let name = super::text(matches, "SITE");
    super::named(lang, name, FleetText::BadName)?;
    let done = super::ask(context, matches, async |hub| hub.remove(name).await)?;
    let site = &done.removed;
    let text = match context.format {
        Format::Table => lang.fill(FleetText::Removed, &[("site", site)]) + "\n",
        Format::Value | Format::Csv => format!("{site}\n"),
        _ => records::line(json!({ "removed": site, "purged": done.purged })),
    };
    out::result(lang, &text)?;
    if !done.purged {
        context.note(&lang.fill(FleetText::NotPurged, &[("site", site)]));
    }
    // Its key is as good as before.
    context.note(&lang.fill(FleetText::KeepOut, &[("site", site)]));
    Ok(())
}
