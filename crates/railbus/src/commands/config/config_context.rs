//! What every command of the group needs: the configuration, its modules, and the journal's folder.

use crate::args;
use crate::backend;
use crate::commands::Context;
use crate::commands::random_id;
use clap::{Arg, ArgMatches, value_parser};
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::store_failure;
use railbus_commission::Log;
use railbus_site::Config;
use railbus_store::journal::JournalFile;
use railbus_words::Code;
use railbus_words::Lang;
use std::path::PathBuf;

use super::texts::ConfigText;
use railbus_app::settings::target::{NoTarget, Target};

/// What every command of the group needs.
#[derive(Debug)]
pub(super) struct ConfigContext {
    pub(super) config: Config,
    /// The configuration file; none if flags describe port and module.
    pub(super) file: Option<PathBuf>,
    state: PathBuf,
}

/// `--state`, the folder of the journal.
pub(super) fn state_flag(lang: Lang) -> Arg {
    args::flag(lang, "state", ConfigText::StateFlag)
        .value_name("DIR")
        .value_parser(value_parser!(PathBuf))
}

impl ConfigContext {
    /// From the flags and the configuration.
    pub(super) fn of(context: &Context, matches: &ArgMatches) -> Result<ConfigContext, Failure> {
        let failed = |problem| context.failure(&problem);
        let (config, file, state) = match &context.options.ad_hoc {
            Some(ad_hoc) => {
                let config = backend::described(ad_hoc).map_err(failed)?;
                (config, None, config_file::state_folder(None))
            }
            None => {
                let files = context.block(context.files())?;
                let found = config_file::read(context.lang, Some(&files.config));
                (
                    found.map_err(failed)?.config,
                    Some(files.config),
                    files.state,
                )
            }
        };
        let named = matches
            .try_get_one::<PathBuf>("state")
            .ok()
            .flatten()
            .cloned();
        Ok(ConfigContext {
            config,
            file,
            state: named.unwrap_or(state),
        })
    }

    /// The module of that name.
    pub(super) fn target(&self, context: &Context, name: &str) -> Result<Target, Failure> {
        let lang = context.lang;
        Target::of(&self.config, name).map_err(|why| match why {
            NoTarget::Line(line) => Failure::of(lang, Code::NoLine).because(line),
            NoTarget::Module => {
                let known: Vec<&str> = self.config.modules.keys().map(String::as_str).collect();
                Failure::of(lang, Code::NoModule)
                    .because(name)
                    .because(known.join(" "))
            }
        })
    }

    /// The modules of the selector: one name, or all of a line or of the site.
    pub(super) fn targets(
        &self,
        context: &Context,
        names: &[String],
    ) -> Result<Vec<Target>, Failure> {
        if !names.is_empty() {
            return names
                .iter()
                .map(|name| self.target(context, name))
                .collect();
        }
        let of_line = |line: &String| context.line.as_ref().is_none_or(|wanted| wanted == line);
        let all = self
            .config
            .modules
            .iter()
            .filter(|(_, module)| of_line(&module.line));
        let all: Result<Vec<Target>, Failure> =
            all.map(|(name, _)| self.target(context, name)).collect();
        let all = all?;
        if all.is_empty() {
            return Err(Failure::of(context.lang, Code::NothingToDo));
        }
        Ok(all)
    }

    /// The identifier of this site: a random number, generated when it is first needed and stored
    /// beside the journal.
    pub(super) fn site(&self, context: &Context) -> Result<String, Failure> {
        let failed = |error: std::io::Error| {
            let told = format!("{}: {error}", self.state.display());
            Failure::of(context.lang, Code::Journal).because(told)
        };
        let file = self.state.join("site");
        if let Ok(name) = std::fs::read_to_string(&file) {
            return Ok(name.trim().to_owned());
        }
        drop(self.store(context)?);
        let name = random_id().map_err(failed)?;
        std::fs::write(&file, format!("{name}\n")).map_err(failed)?;
        Ok(name)
    }

    /// The journal, locked by this command.
    pub(super) fn store(&self, context: &Context) -> Result<JournalFile, Failure> {
        JournalFile::open(&self.state)
            .map_err(|error| store_failure(context.lang, &self.state, &error))
    }

    /// The journal, for reading.
    pub(super) fn log(&self, context: &Context) -> Result<Log, Failure> {
        JournalFile::peek(&self.state).map_err(|error| {
            let told = format!("{}: {error}", self.state.display());
            Failure::of(context.lang, Code::Journal).because(told)
        })
    }
}
