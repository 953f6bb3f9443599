//! `railbus config`: settings that are stored in modules. A group of commands, one file each.

mod backup;
pub(crate) mod boards;
mod borrow;
mod config_context;
mod drive;
mod file;
mod find;
mod guided;
mod log;
pub(crate) mod plan;
mod restore;
mod set;
mod show;
mod texts;

use super::config_check;
use crate::args;
use clap::{ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_words::Lang;
use texts::ConfigText;

/// The name of the group.
pub(crate) const NAME: &str = "config";

/// One command of the group: its name, its definition, and what it does.
struct Sub {
    name: &'static str,
    define: fn(Lang) -> Command,
    run: fn(Lang, &ArgMatches) -> Result<(), Failure>,
}

/// All of them, in the order of the help.
const SUBS: &[Sub] = &[
    Sub {
        name: config_check::CHECK,
        define: config_check::define_check,
        run: config_check::run_check,
    },
    Sub {
        name: config_check::PATH,
        define: config_check::define_path,
        run: config_check::run_path,
    },
    Sub {
        name: show::NAME,
        define: show::define,
        run: show::run,
    },
    Sub {
        name: show::GET,
        define: show::define_get,
        run: show::get,
    },
    Sub {
        name: set::NAME,
        define: set::define,
        run: set::run,
    },
    Sub {
        name: restore::DIFF,
        define: restore::define_diff,
        run: restore::diff,
    },
    Sub {
        name: backup::NAME,
        define: backup::define,
        run: backup::run,
    },
    Sub {
        name: restore::NAME,
        define: restore::define,
        run: restore::run,
    },
    Sub {
        name: log::NAME,
        define: log::define,
        run: log::run,
    },
    Sub {
        name: log::UNDO,
        define: log::define_undo,
        run: log::undo,
    },
    Sub {
        name: log::RECOVER,
        define: log::define_recover,
        run: log::recover,
    },
    Sub {
        name: guided::CALIBRATE,
        define: guided::define_calibrate,
        run: guided::calibrate,
    },
    Sub {
        name: guided::FACTORY,
        define: guided::define_factory,
        run: guided::factory,
    },
];

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, ConfigText::About, "railbus config COMMAND")
        .before_help(args::examples(lang, ConfigText::Examples))
        .subcommand_required(true)
        .subcommand_help_heading(lang.get(crate::texts::Text::Commands))
        .subcommands(SUBS.iter().map(|sub| (sub.define)(lang)))
}

/// Runs a command of the group.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    // The parser accepts no arguments without a known command.
    let Some((name, matches)) = matches.subcommand() else {
        return Ok(());
    };
    let sub = SUBS.iter().find(|sub| sub.name == name);
    sub.map_or(Ok(()), |sub| (sub.run)(lang, matches))
}
