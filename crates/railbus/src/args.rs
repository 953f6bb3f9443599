//! What the definitions of all commands have in common: their form, their flags, their help.

use crate::texts::Text;
use clap::builder::StyledStr;
use clap::{Arg, ArgAction, Command};
use railbus_words::{Lang, Phrase};

/// Flags that every command has are listed below its own.
pub(crate) const LAST: usize = 1_000;

/// The help as it is printed. The parser ends every heading with an ASCII colon.
pub(crate) fn page(lang: Lang, help: &StyledStr) -> String {
    let colon = lang.of([":", "："]);
    let headings = [Text::Options, Text::Commands].map(|text| lang.get(text));
    headings
        .into_iter()
        .fold(help.to_string(), |page, heading| {
            page.replace(&format!("\n{heading}:\n"), &format!("\n{heading}{colon}\n"))
        })
}

/// A command with what all commands have: help in the language, and `-h`.
pub(crate) fn verb(
    lang: Lang,
    name: &'static str,
    about: impl Phrase,
    usage: &'static str,
) -> Command {
    let template = format!(
        "{{about-with-newline}}\n{{before-help}}{}{{usage}}\n\n{{all-args}}{{after-help}}\n",
        lang.get(Text::Usage)
    );
    Command::new(name)
        .about(lang.get(about))
        .override_usage(usage)
        .help_template(template)
        .next_help_heading(lang.get(Text::Options))
        .subcommand_help_heading(lang.get(Text::Commands))
        .disable_help_flag(true)
        .disable_help_subcommand(true)
        .disable_version_flag(true)
        .arg(
            flag(lang, "help", Text::Help)
                .short('h')
                .action(ArgAction::Help)
                .display_order(LAST),
        )
}

/// Examples, to stand at the head of a command's help.
pub(crate) fn examples(lang: Lang, examples: impl Phrase) -> String {
    format!("{}\n{}", lang.get(Text::Examples), lang.get(examples))
}

/// A flag whose long form is its name.
pub(crate) fn flag(lang: Lang, name: &'static str, help: impl Phrase) -> Arg {
    Arg::new(name).long(name).help(lang.get(help))
}
