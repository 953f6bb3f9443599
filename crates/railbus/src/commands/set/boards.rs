//! `railbus set --all-boards`: switches every 0x55 board of a line at once (choice 34).

use crate::commands::Context;
use crate::commands::config::boards::{Line, switch};
use crate::texts::Text;
use clap::ArgMatches;
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::values;
use railbus_app::texts::AppText;
use railbus_words::Code;
use serde_json::json;

/// Switches them, and reports what each known one reads back.
pub(super) fn run(context: &Context, matches: &ArgMatches) -> Result<(), Failure> {
    let lang = context.lang;
    let on = matches
        .get_one::<String>("all-boards")
        .is_some_and(|state| state == "on");
    let line = Line::of(context, matches)?;
    if matches.get_flag("dry-run") {
        let told = lang.get(Text::WouldSend);
        return out::result(
            lang,
            &format!("{told}  {}  {}\n", line.name(), Line::frame(on)),
        );
    }
    let typed = matches.get_one::<String>("confirm").map(String::as_str);
    if typed != Some("broadcast") {
        let failure = Failure::of(lang, Code::NeedsYes).because(Line::frame(on));
        return Err(failure.with_try(format!(
            "railbus set -l {} --all-boards {} --confirm broadcast",
            line.name(),
            if on { "on" } else { "off" }
        )));
    }
    let states = context.block(switch(context, &line, on))?;
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for (name, state) in &states {
        let told = match (state.outputs, state.as_commanded) {
            (None, _) => lang.get(AppText::Unheard).to_owned(),
            (Some(_), true) => format!(
                "{}  {}",
                values::state(lang, on),
                values::confirmed(lang, railbus_api::types::Confirmed::Readback)
            ),
            (Some(_), false) => Failure::of(lang, Code::NotVerified).message().to_owned(),
        };
        table.add([name.clone(), told]);
        rows.push(json!({
            "module": name,
            "outputs": state.outputs.map(|outputs| outputs.on),
            "as_commanded": state.as_commanded,
            "may_have_acted": !state.as_commanded,
        }));
    }
    let columns = &["module", "as_commanded"];
    let records = Records {
        key: "boards",
        rows,
        columns,
        value: "as_commanded",
        table,
    };
    out::result(lang, &records.render(context.format))?;
    // A broadcast is not answered: a board that does not show the state now may still have
    // switched.
    let failed = states.iter().filter(|(_, state)| !state.as_commanded);
    let perhaps: Vec<String> = failed.map(|(name, _)| name.clone()).collect();
    let failed = perhaps.len();
    if failed == 0 {
        return Ok(());
    }
    let count = states.len();
    let values: &[(&str, &dyn std::fmt::Display)] = &[("failed", &failed), ("count", &count)];
    Err(Failure::new(Code::Partial, lang.fill(Text::SomeFailed, values)).perhaps_acted_on(perhaps))
}
