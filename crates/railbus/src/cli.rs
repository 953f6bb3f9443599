//! The command line: one definition per command, from which its parser and its help are made.

use crate::args::{LAST, flag, page, verb};
use crate::commands::{
    audit, bench, complete, completions, config, doctor, explain, export, extcap, fleet,
};
use crate::commands::{
    decode, get, global_flags, help, history, ls, man, outlet, pulse, raw, replay, scan,
};
use crate::commands::{scene, schema, serve, set, sim, sniff, token, user, version, wait, watch};
use crate::texts::Text;
use crate::usage;
use clap::error::ErrorKind;
use clap::{ArgAction, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_words::Lang;
use std::ffi::OsString;
use std::io::Write;

/// A command: its name, its definition, and what it does.
struct Verb {
    name: &'static str,
    define: fn(Lang) -> Command,
    run: fn(Lang, &ArgMatches) -> Result<(), Failure>,
}

/// All commands, in the order of the help.
const VERBS: &[Verb] = &[
    Verb {
        name: scan::NAME,
        define: scan::define,
        run: scan::run,
    },
    Verb {
        name: ls::NAME,
        define: ls::define,
        run: ls::run,
    },
    Verb {
        name: get::NAME,
        define: get::define,
        run: get::run,
    },
    Verb {
        name: set::NAME,
        define: set::define,
        run: set::run,
    },
    Verb {
        name: pulse::NAME,
        define: pulse::define,
        run: pulse::run,
    },
    Verb {
        name: scene::NAME,
        define: scene::define,
        run: scene::run,
    },
    Verb {
        name: watch::NAME,
        define: watch::define,
        run: watch::run,
    },
    Verb {
        name: wait::NAME,
        define: wait::define,
        run: wait::run,
    },
    Verb {
        name: history::NAME,
        define: history::define,
        run: history::run,
    },
    Verb {
        name: audit::NAME,
        define: audit::define,
        run: audit::run,
    },
    Verb {
        name: raw::NAME,
        define: raw::define,
        run: raw::run,
    },
    Verb {
        name: sniff::NAME,
        define: sniff::define,
        run: sniff::run,
    },
    Verb {
        name: decode::NAME,
        define: decode::define,
        run: decode::run,
    },
    Verb {
        name: replay::NAME,
        define: replay::define,
        run: replay::run,
    },
    Verb {
        name: doctor::NAME,
        define: doctor::define,
        run: doctor::run,
    },
    Verb {
        name: bench::NAME,
        define: bench::define,
        run: bench::run,
    },
    Verb {
        name: config::NAME,
        define: config::define,
        run: config::run,
    },
    Verb {
        name: config::plan::NAME,
        define: config::plan::define,
        run: config::plan::run,
    },
    Verb {
        name: config::plan::APPLY,
        define: config::plan::define_apply,
        run: config::plan::apply,
    },
    Verb {
        name: sim::NAME,
        define: sim::define,
        run: sim::run,
    },
    Verb {
        name: serve::NAME,
        define: serve::define,
        run: serve::run,
    },
    Verb {
        name: outlet::NAME,
        define: outlet::define,
        run: outlet::run,
    },
    Verb {
        name: fleet::NAME,
        define: fleet::define,
        run: fleet::run,
    },
    Verb {
        name: user::NAME,
        define: user::define,
        run: user::run,
    },
    Verb {
        name: token::NAME,
        define: token::define,
        run: token::run,
    },
    Verb {
        name: export::NAME,
        define: export::define,
        run: export::run,
    },
    Verb {
        name: extcap::NAME,
        define: extcap::define,
        run: extcap::run,
    },
    Verb {
        name: explain::NAME,
        define: explain::define,
        run: explain::run,
    },
    Verb {
        name: completions::NAME,
        define: completions::define,
        run: completions::run,
    },
    Verb {
        name: man::NAME,
        define: man::define,
        run: man::run,
    },
    Verb {
        name: schema::NAME,
        define: schema::define,
        run: schema::run,
    },
    Verb {
        name: help::NAME,
        define: help::define,
        run: help::run,
    },
    Verb {
        name: version::NAME,
        define: version::define,
        run: version::run,
    },
    Verb {
        name: complete::NAME,
        define: complete::define,
        run: complete::run,
    },
];

/// The width of the help, however wide the terminal is.
const WIDTH: usize = 80;

/// Runs the command that the arguments name.
pub(crate) fn run(lang: Lang, arguments: Vec<OsString>) -> Result<(), Failure> {
    let named = |argument: &OsString| names().find(|name| argument == name);
    let verb = arguments.iter().skip(1).find_map(named);
    let matches = match define(lang).try_get_matches_from(arguments) {
        Ok(matches) => matches,
        Err(error) if is_answer(error.kind()) => {
            // A reader that closed the pipe is not an error.
            let _ = write!(std::io::stdout(), "{}", page(lang, &error.render()));
            return Ok(());
        }
        Err(error) => return Err(usage::failure(lang, &error, verb)),
    };
    // The parser accepts no arguments without a known command.
    let Some((name, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let verb = VERBS.iter().find(|verb| verb.name == name);
    verb.map_or(Ok(()), |verb| (verb.run)(lang, matches))
}

const fn is_answer(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::DisplayHelp | ErrorKind::DisplayVersion)
}

/// The names of all commands, in the order of the help.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    VERBS.iter().map(|verb| verb.name)
}

/// The whole command line.
pub(crate) fn define(lang: Lang) -> Command {
    let root = verb(lang, "railbus", Text::About, "railbus COMMAND")
        .version(env!("CARGO_PKG_VERSION"))
        .subcommand_required(true)
        .max_term_width(WIDTH)
        .subcommands(VERBS.iter().map(|verb| (verb.define)(lang)))
        .after_help(lang.get(Text::Environment));
    root.arg(
        flag(lang, "version", Text::Version)
            .short('V')
            .action(ArgAction::Version)
            .display_order(LAST),
    )
    .arg(
        flag(lang, "lang", Text::LangFlag)
            .value_name("LANG")
            .value_parser(["en", "zh"])
            .hide_possible_values(true)
            .display_order(LAST)
            .global(true),
    )
    .arg(
        flag(lang, "verbose", Text::Verbose)
            .short('v')
            .action(ArgAction::Count)
            .env("RAILBUS_VERBOSE")
            .hide_env(true)
            .display_order(LAST)
            .global(true),
    )
    .args(global_flags(lang))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definitions_are_sound() {
        for lang in [Lang::En, Lang::Zh] {
            define(lang).debug_assert();
        }
    }

    #[test]
    fn chinese_help_is_all_chinese() {
        let text = |arguments: &[&str]| {
            let error = define(Lang::Zh).try_get_matches_from(arguments).err();
            error
                .map(|error| error.render().to_string())
                .unwrap_or_default()
        };
        let root = [vec!["railbus", "-h"]];
        let verbs = VERBS.iter().map(|verb| vec!["railbus", verb.name, "-h"]);
        for arguments in root.into_iter().chain(verbs) {
            let help = text(&arguments);
            for english in ["Usage", "Options", "Commands", "Print", "default"] {
                assert!(!help.contains(english), "{english} in {help}");
            }
        }
    }
}
