//! `railbus help`: a command's help, or a page on a topic that concerns all commands.

mod texts;

use crate::args;
use crate::cli;
use crate::commands::Context;
use crate::commands::explain::exit_codes;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::{out, records};
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::json;
use texts::HelpText;

/// The name of the command.
pub(crate) const NAME: &str = "help";

/// The topics besides the commands.
pub(crate) const TOPICS: [&str; 5] = ["exit-codes", "addressing", "units", "protocols", "safety"];

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, HelpText::About, "railbus help [TOPIC]")
        .before_help(args::examples(lang, HelpText::Examples))
        .arg(
            Arg::new("TOPIC")
                .help(lang.get(HelpText::Topic))
                .num_args(0..=2),
        )
}

/// Prints the page.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let given = matches.get_many::<String>("TOPIC").into_iter().flatten();
    let words: Vec<&str> = given.map(String::as_str).collect();
    let text = match words.as_slice() {
        ["exit-codes"] => exit_codes(lang).render(context.format),
        ["addressing"] => page(lang, HelpText::Addressing),
        ["units"] => page(lang, HelpText::Units),
        ["protocols"] => page(lang, HelpText::Protocols),
        ["safety"] => page(lang, HelpText::Safety),
        words => of_command(lang, words)?,
    };
    if context.format.is_json() && words != ["exit-codes"] {
        let page = json!({ "topic": words.join(" "), "text": text });
        return out::result(lang, &records::line(page));
    }
    out::result(lang, &text)
}

fn page(lang: Lang, text: HelpText) -> String {
    format!("{}\n", lang.get(text))
}

/// What `railbus COMMAND --help` says.
fn of_command(lang: Lang, words: &[&str]) -> Result<String, Failure> {
    let mut command = cli::define(lang);
    // Only this adds the global flags to commands of a group.
    command.build();
    let mut found = &mut command;
    for word in words {
        found = found.find_subcommand_mut(word).ok_or_else(|| {
            let message = lang.fill(Text::NoSuchCommand, &[("name", word)]);
            let tries = TOPICS
                .into_iter()
                .map(|topic| format!("railbus help {topic}"));
            tries.fold(Failure::new(Code::Usage, message), Failure::with_try)
        })?;
    }
    Ok(args::page(lang, &found.render_help()))
}
