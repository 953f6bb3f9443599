//! `railbus doctor`: what is wrong with machine, port, line, modules, configuration, daemon and
//! fleet, and how to fix it. It only reads, except with `--fix`.

mod chosen;
mod daemon;
mod fix;
mod fleet;
mod served;
mod show;
mod texts;

use super::explain::no_such_code;
use super::{Context, stop};
use crate::args;
use crate::backend::{Backend, described};
use clap::{Arg, ArgAction, ArgMatches, Command};
use jiff::Timestamp;
use railbus_app::config_file;
pub(in crate::commands) use railbus_app::doctor::line::Chosen;
use railbus_app::doctor::{CheckState, Finding, Section, line, of_config, port, system};
use railbus_app::failure::Failure;
use railbus_app::machine::Machine;
use railbus_app::machine::users::User;
use railbus_site::Config;
use railbus_words::Lang;
use railbus_words::{Code, findings};
use std::path::Path;
use std::time::Duration;
use texts::DoctorText;

/// The name of the command.
pub(crate) const NAME: &str = "doctor";

/// How long it listens to a line before it reads the modules.
const LISTEN: Duration = Duration::from_secs(2);

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus doctor [CODE] [-l LINE] [--fix [--yes]]";
    args::verb(lang, NAME, DoctorText::About, usage)
        .before_help(args::examples(lang, DoctorText::Examples))
        .arg(Arg::new("CODE").help(lang.get(DoctorText::Code)))
        .arg(args::flag(lang, "fix", DoctorText::Fix).action(ArgAction::SetTrue))
        .arg(
            args::flag(lang, "yes", DoctorText::Yes)
                .short('y')
                .action(ArgAction::SetTrue)
                .requires("fix"),
        )
}

/// The lines of the flags or of the configuration, for commands that only read.
pub(super) fn chosen_lines(context: &Context) -> Result<Vec<Chosen>, Failure> {
    let failed = |problem| context.failure(&problem);
    let config = match &context.options.ad_hoc {
        Some(ad_hoc) => described(ad_hoc).map_err(failed)?,
        None => {
            let named = context.options.config.as_deref();
            config_file::read(context.lang, named)
                .map_err(failed)?
                .config
        }
    };
    chosen::chosen(context, &config)
}

/// Checks everything, prints the findings, and fixes what it may.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let code = matches.get_one::<String>("CODE");
    if let Some(code) = code
        && findings::find(code).is_none()
    {
        return Err(no_such_code(lang, code));
    }
    let mut found = context.block(examine(&context, &Machine::this()))?;
    if let Some(code) = code {
        found.retain(|finding| finding.is(code));
    }
    show::result(&context, &found)?;
    if matches.get_flag("fix") {
        return fix::run(&context, &found, matches.get_flag("yes"));
    }
    let errors = found
        .iter()
        .filter(|finding| finding.state == CheckState::Error)
        .count();
    if errors == 0 {
        return Ok(());
    }
    let codes: Vec<&str> = found
        .iter()
        .filter(|finding| finding.state == CheckState::Error)
        .filter_map(|finding| finding.code)
        .collect();
    let message = lang.fill(DoctorText::Unhealthy, &[("errors", &errors)]);
    let failure = Failure::new(Code::Unhealthy, message).with_fact("codes", codes.clone());
    let explain = |code: &&str| format!("railbus explain {code}");
    Err(codes.iter().map(explain).fold(failure, Failure::with_try))
}

/// All findings, section by section.
async fn examine(context: &Context, machine: &Machine) -> Result<Vec<Finding>, Failure> {
    let lang = context.lang;
    let mut stop = stop::Stop::new(context)?;
    let user = User::this(machine);
    let variable = |name: &str| std::env::var(name).ok();
    let mut found = system::check(lang, variable, Timestamp::now());
    let socket = context.options.socket.as_deref();
    // In parallel, so that one that hangs delays nothing else.
    let (daemon, of_sockets, of_fleet) = tokio::join!(
        context.daemon(),
        daemon::check(lang, socket, &user),
        fleet::check(context, super::fleet::now())
    );
    let served = daemon.as_ref().ok().and_then(Option::as_ref);
    let served = served.map(|daemon| daemon.config().to_owned());
    let config = configuration(context, machine, served.as_deref())?;
    found.extend(port::adapters(machine, &user));
    let work = async {
        match daemon {
            Ok(Some(daemon)) => served::examine(context, &Backend::Daemon(daemon)).await,
            Ok(None) => here(context, machine, &user, &config).await,
            // It is not known whose lines are meant, so none is opened here.
            Err(why) => Ok(vec![daemon::refused(&why)]),
        }
    };
    let end = stop.or(work).await;
    found.extend(end.ok_or_else(|| stop::interrupted(context))??);
    found.extend(config.findings);
    found.extend(of_sockets);
    found.extend(of_fleet);
    found.sort_by_key(|finding| finding.section);
    Ok(found)
}

/// The lines to open here: the one of the flags, or those of the configuration.
async fn here(
    context: &Context,
    machine: &Machine,
    user: &User,
    config: &Configuration,
) -> Result<Vec<Finding>, Failure> {
    let mut lines = tokio::task::JoinSet::new();
    let chosen = chosen::chosen(context, &config.config)?;
    for (number, line) in chosen.into_iter().enumerate() {
        let (lang, machine, user) = (context.lang, machine.clone(), user.clone());
        lines.spawn(async move {
            let found = line::examine(lang, &machine, &user, &line, LISTEN).await;
            (number, found)
        });
    }
    // In parallel: each takes two seconds.
    let mut found = lines.join_all().await;
    found.sort_by_key(|(number, _)| *number);
    Ok(found
        .into_iter()
        .flat_map(|(_, findings)| findings)
        .collect())
}

/// The configuration and its findings.
struct Configuration {
    config: Config,
    findings: Vec<Finding>,
}

/// `served` is the configuration of the daemon, if one is used.
fn configuration(
    context: &Context,
    machine: &Machine,
    served: Option<&Path>,
) -> Result<Configuration, Failure> {
    let lang = context.lang;
    let of = |config: Config, findings: Vec<Finding>| Ok(Configuration { config, findings });
    if let Some(ad_hoc) = &context.options.ad_hoc {
        let config = described(ad_hoc).map_err(|problem| context.failure(&problem))?;
        return of(config, Vec::new());
    }
    let named = served.or(context.options.config.as_deref());
    let read = config_file::read(lang, named).map_err(|problem| context.failure(&problem));
    let found = match read {
        Ok(found) => found,
        Err(why) if why.code() == Code::NoConfig => {
            let finding = Finding::warning(Section::Config, "D401", String::new());
            return of(Config::default(), vec![finding]);
        }
        Err(why) => {
            let detail = format!("{} {}", why.code().name(), why.message());
            let finding = Finding::error(Section::Config, "D402", detail);
            return of(Config::default(), vec![finding]);
        }
    };
    let findings = of_config(lang, machine, &found);
    of(found.config, findings)
}
