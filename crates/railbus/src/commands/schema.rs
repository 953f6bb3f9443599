//! `railbus schema`: the published schemas of every command's JSON output.

mod texts;

use crate::args;
use crate::commands::Context;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::json;
use texts::SchemaText;

/// The name of the command.
pub(crate) const NAME: &str = "schema";

/// Name and text of each schema: that of a command has the command's name.
pub(crate) const SCHEMAS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/schemas.rs"));

/// The name of the schema of the configuration file.
const FILE: &str = "config-file";

/// All of them.
fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
    let file = (FILE, railbus_site::config::SCHEMA);
    SCHEMAS.iter().copied().chain([file])
}

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, SchemaText::About, "railbus schema [COMMAND]")
        .before_help(args::examples(lang, SchemaText::Examples))
        .arg(Arg::new("NAME").help(lang.get(SchemaText::Name)))
}

/// Prints a schema, or the names of all.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let Some(name) = matches.get_one::<String>("NAME") else {
        return out::result(lang, &list().render(context.format));
    };
    match all().find(|(known, _)| known == name) {
        Some((_, text)) => out::result(lang, text),
        None => {
            let message = lang.fill(Text::NoSuchCommand, &[("name", name)]);
            Err(Failure::new(Code::Usage, message).with_try("railbus schema"))
        }
    }
}

fn list() -> Records {
    let mut table = Table::bare();
    for (name, _) in all() {
        table.add([name.to_owned()]);
    }
    let rows = all().map(|(name, _)| json!({ "name": name }));
    Records {
        key: "schemas",
        rows: rows.collect(),
        columns: &["name"],
        value: "name",
        table,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli;
    use serde_json::Value;

    /// These print no documents, only scripts, pages, and what shells and Wireshark ask for.
    const WITHOUT: [&str; 4] = ["extcap", "completions", "man", "complete"];

    #[test]
    fn every_command_has_a_schema_and_every_schema_a_command() {
        for name in cli::names() {
            let found = SCHEMAS.iter().any(|(known, _)| *known == name);
            let wanted = !WITHOUT.contains(&name);
            assert_eq!(found, wanted, "schemas/{name}.json");
        }
        for (name, _) in SCHEMAS {
            let known = *name == "error" || cli::names().any(|known| known == *name);
            assert!(known, "schemas/{name}.json is of no command");
        }
    }

    #[test]
    fn schemas_are_sound_and_agree_on_what_they_share() {
        let mut shared: Vec<(String, Value)> = Vec::new();
        for (name, text) in SCHEMAS {
            let schema: Value = serde_json::from_str(text).unwrap();
            let valid = jsonschema::meta::is_valid(&schema);
            assert!(valid, "{name}");
            assert!(jsonschema::validator_for(&schema).is_ok(), "{name}");
            for (key, part) in schema["$defs"].as_object().into_iter().flatten() {
                match shared.iter().find(|(known, _)| known == key) {
                    Some((_, known)) => assert_eq!(known, part, "{name}: {key}"),
                    None => shared.push((key.clone(), part.clone())),
                }
            }
        }
    }
}
