//! `railbus fleet group`: the groups that a site is in.

use super::FleetText;
use crate::commands::Context;
use clap::{Arg, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out, records};
use railbus_words::Lang;
use serde_json::json;

/// The name of the command.
pub(super) const NAME: &str = "group";

/// Its parser and help.
pub(super) fn define(lang: Lang) -> Command {
    let groups = Arg::new("GROUP")
        .help(lang.get(FleetText::Groups))
        .num_args(0..);
    super::verb(
        lang,
        NAME,
        FleetText::Group,
        "railbus fleet group SITE [GROUP…]",
    )
    .arg(super::required(lang, "SITE", FleetText::SiteName))
    .arg(groups)
}

/// Sets the groups of a site.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let name = super::text(matches, "SITE");
    let groups = matches.get_many::<String>("GROUP").into_iter().flatten();
    let groups: Vec<String> = groups.cloned().collect();
    for group in &groups {
        super::named(lang, group, FleetText::BadGroup)?;
    }
    super::named(lang, name, FleetText::BadName)?;
    let told = super::ask(context, matches, async |hub| {
        hub.set_groups(name, &groups).await
    })?;
    let is_known = !told.site.version.is_empty();
    let (site, groups) = (told.site.site, told.site.groups);
    let text = match context.format {
        Format::Table if groups.is_empty() => {
            lang.fill(FleetText::InNoGroup, &[("site", &site)]) + "\n"
        }
        Format::Table => {
            let groups = groups.join(" ");
            let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &site), ("groups", &groups)];
            lang.fill(FleetText::InGroups, values) + "\n"
        }
        Format::Value | Format::Csv => groups.iter().map(|group| format!("{group}\n")).collect(),
        _ => records::line(json!({ "site": site, "groups": groups })),
    };
    out::result(lang, &text)?;
    if !is_known {
        context.note(&lang.fill(FleetText::NeverReported, &[("site", &site)]));
    }
    Ok(())
}
