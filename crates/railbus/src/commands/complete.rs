//! `railbus complete`: the names that fit at the end of a command line, for the completion scripts.
//! Asks the daemon that the command would use, or else reads the configuration; never opens a port,
//! gives up soon, and prints nothing if something is wrong.

use crate::args;
use crate::backend::{Backend, Options};
use crate::cli;
use crate::commands::help::TOPICS;
use crate::commands::schema::SCHEMAS;
use crate::texts::Text;
use clap::{Arg, ArgMatches, Command};
use railbus_api::types::Kind;
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_device::PointKind;
use railbus_site::Config;
use railbus_words::Lang;
use railbus_words::{Code, findings};
use std::path::PathBuf;
use std::sync::mpsc;
use std::time::Duration;

/// The name of the command.
pub(crate) const NAME: &str = "complete";

/// How long the daemon may take to answer; after that it does without.
const DAEMON: Duration = Duration::from_millis(300);

/// How long a completion may take in all.
const PATIENCE: Duration = DAEMON.saturating_add(Duration::from_millis(100));

/// Its parser; it is not meant for people.
pub(crate) fn define(lang: Lang) -> Command {
    args::verb(lang, NAME, Text::CompleteAbout, "railbus complete -- WORD…")
        .hide(true)
        .arg(
            Arg::new("WORD")
                .help(lang.get(Text::CompleteWords))
                .num_args(0..)
                .allow_hyphen_values(true)
                .trailing_var_arg(true),
        )
}

/// Prints the names, one per line.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let words = matches.get_many::<String>("WORD").into_iter().flatten();
    let words: Vec<String> = words.cloned().collect();
    let options = Options {
        config: matches.get_one("config").cloned(),
        socket: matches.get_one("socket").cloned(),
        direct: matches.get_flag("direct"),
        lang,
        ..Options::default()
    };
    let (sender, names) = mpsc::channel();
    // A file on a network that hangs must not hang the shell.
    std::thread::spawn(move || sender.send(candidates(options, &words)));
    let names = names.recv_timeout(PATIENCE).unwrap_or_default();
    let lines = names.into_iter().map(|name| name + "\n");
    out::result(lang, &lines.collect::<String>())
}

/// The candidates for the last of the words, which may be empty or incomplete.
fn candidates(options: Options, words: &[String]) -> Vec<String> {
    let Some((current, before)) = words.split_last() else {
        return Vec::new();
    };
    let before: Vec<&str> = before.iter().map(String::as_str).collect();
    let verb = before
        .iter()
        .copied()
        .find(|word| cli::names().any(|name| name == *word));
    let site = || names(options, &before);
    let all: Vec<String> = match (before.last().copied(), verb) {
        (Some("-l" | "--line"), _) => site().lines,
        (_, Some("get" | "watch" | "wait" | "history" | "read")) => site().paths(current, |_| true),
        (_, Some("set" | "pulse" | "write")) => site().paths(current, |point| point.is_output),
        (Some("run"), Some("scene")) => site().scenes,
        (_, Some("config" | "plan" | "apply")) if !current.starts_with('-') => site().modules,
        (_, Some("doctor")) => codes_of_findings().collect(),
        (_, Some("explain")) => {
            let codes = Code::all().map(|code| code.name().to_owned());
            codes.chain(codes_of_findings()).collect()
        }
        (_, Some("schema")) => SCHEMAS.iter().map(|(name, _)| (*name).to_owned()).collect(),
        (_, Some("help")) => cli::names().chain(TOPICS).map(str::to_owned).collect(),
        _ => Vec::new(),
    };
    all.into_iter()
        .filter(|name| name.starts_with(current.as_str()))
        .collect()
}

fn codes_of_findings() -> impl Iterator<Item = String> {
    findings::all().map(|finding| finding.code.to_owned())
}

/// Everything on the site that has a name.
#[derive(Default)]
struct Names {
    lines: Vec<String>,
    modules: Vec<String>,
    scenes: Vec<String>,
    points: Vec<Named>,
}

/// A point.
struct Named {
    module: String,
    path: String,
    is_output: bool,
}

impl Names {
    /// Modules, and the points of the module that has been typed so far.
    fn paths(self, current: &str, wanted: impl Fn(&Named) -> bool) -> Vec<String> {
        let of = current.split_once('.').map(|(module, _)| module);
        let modules = self.modules.into_iter().filter(|_| of.is_none());
        let points = self
            .points
            .into_iter()
            .filter(|point| of.is_none_or(|module| module == point.module) && wanted(point));
        modules.chain(points.map(|point| point.path)).collect()
    }
}

/// The names of the site that the words so far mean; none if there is no such site.
fn names(mut options: Options, before: &[&str]) -> Names {
    let after = |flag: &str| {
        let at = before.iter().position(|word| *word == flag)?;
        before.get(at + 1).map(PathBuf::from)
    };
    options.config = after("--config").or(options.config);
    options.socket = after("--socket").or(options.socket);
    options.direct |= before.contains(&"--direct");
    let told = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .ok()
        .and_then(|runtime| {
            let told = async { tokio::time::timeout(DAEMON, told(&options)).await };
            runtime.block_on(told).ok().flatten()
        });
    told.unwrap_or_else(|| {
        let found = config_file::read(options.lang, options.config.as_deref());
        found.map(|found| written(found.config)).unwrap_or_default()
    })
}

/// The names that the daemon reports, if one serves this site.
async fn told(options: &Options) -> Option<Names> {
    let daemon = Backend::daemon(options).await.ok()??;
    let (lines, modules, points, scenes) = tokio::join!(
        daemon.lines(),
        daemon.modules(),
        daemon.points(&[], false),
        daemon.scenes()
    );
    Some(Names {
        lines: lines.ok()?.into_iter().map(|line| line.line).collect(),
        modules: modules.ok()?.into_iter().map(|one| one.module).collect(),
        scenes: scenes.ok()?.into_iter().map(|one| one.scene).collect(),
        points: points
            .ok()?
            .into_iter()
            .map(|point| Named {
                is_output: point.kind == Kind::Output,
                module: point.module,
                path: point.path,
            })
            .collect(),
    })
}

/// The names of a configuration.
fn written(config: Config) -> Names {
    let points = config.modules.iter().flat_map(|(name, module)| {
        let setup = module.setup;
        setup.points().map(move |point| {
            let (prefix, number) = setup.label(point);
            Named {
                module: name.clone(),
                path: format!("{name}.{prefix}{number}"),
                is_output: point.kind == PointKind::Output,
            }
        })
    });
    Names {
        points: points.collect(),
        lines: config.lines.into_keys().collect(),
        modules: config.modules.into_keys().collect(),
        scenes: config.scenes.into_keys().collect(),
    }
}
