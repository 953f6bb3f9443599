//! `railbus scan`: finds the modules on a line. It only reads.

mod add;
mod asked;
mod keep;
mod options;
mod run;
mod show;
mod texts;

use super::place::{self, Access, Place};
use super::{Context, stop};
use crate::args;
use crate::backend::Backend;
use asked::Asked;
use clap::{ArgMatches, Command};
use keep::Keep;
use options::Options;
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_commission::scan::{Known, Scanner, Scope};
use railbus_device::Family;
use railbus_host::LineName;
use railbus_wire::{Address, Protocol};
use railbus_words::Code;
use railbus_words::Lang;
use run::{End, Report};
use show::Live;
use texts::ScanText;

/// The name of the command.
pub(crate) const NAME: &str = "scan";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus scan [--quick|--full|--deep] [--addr 1-32] [--follow] [--add]";
    let verb = args::verb(lang, NAME, ScanText::About, usage);
    options::define(
        lang,
        verb.before_help(args::examples(lang, ScanText::Examples)),
    )
}

/// Scans and prints what was found, even after Ctrl-C.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of_line(lang, matches)?;
    let options = Options::of(&context, matches);
    if Scope::of(&options.wish, Vec::new()).runs.is_empty() {
        let failure = Failure::of(lang, Code::ScanNothing);
        return Err(failure.because(lang.get(ScanText::NothingToAsk)));
    }
    let (place, options, report, keep) = context.block(scan(&context, options))?;
    Live::new(&context, &place, options.follow).end(&report, &options.wish)?;
    match report.end {
        End::Complete => keep.drop(),
        End::Interrupted | End::TimeUp | End::Lost(_) => {
            keep.put(&report.scanner);
        }
        End::Noise | End::Unread => {}
    }
    if options.add {
        add::add(&context, &place, report.scanner.found(), &options)?;
    }
    verdict(&context, &place, report)
}

/// Finds the line and scans it.
async fn scan(
    context: &Context,
    options: Options,
) -> Result<(Place, Options, Report, Keep), Failure> {
    let mut stop = stop::Stop::new(context)?;
    let (place, known, daemon) = match place::find(context).await? {
        Access::Here(place) => {
            let known = configured(context, &place);
            (place, known, None)
        }
        Access::Daemon(backend) => {
            let place = place::of(context, &backend).await?;
            let known = polled(context, &place, &backend).await?;
            (place, known, Some(backend))
        }
    };
    let options = options.on(&place);
    // A scan of some addresses only needs to know the modules at these.
    let known: Vec<Known> = match &options.wish.addresses {
        None => known,
        Some(addresses) => {
            let is_asked = |known: &Known| addresses.contains(&known.address.0);
            known.into_iter().filter(is_asked).collect()
        }
    };
    let keep = Keep::of(context, &place, &options.wish).await;
    let scope = Scope::of(&options.wish, known);
    if has_own_speed(&place.port) && scope.runs.iter().any(|run| run.settings != place.settings) {
        let failure = Failure::of(context.lang, Code::ScanFixedSpeed);
        return Err(failure
            .because(&place.port)
            .with_fact("line", place.line.as_str()));
    }
    let scanner = match options.resume {
        true => keep.resume(context, scope)?,
        false => Scanner::new(scope),
    };
    let asked = match daemon {
        None => Asked::open(context, &place).await?,
        Some(backend) => Asked::Daemon(backend),
    };
    let mut live = Live::new(context, &place, options.follow);
    live.begin(options.wish.depth, &scanner);
    let limits = (&mut stop, options.max_time);
    let report = run::scan(context, &place, asked, scanner, limits, &mut live).await?;
    Ok((place, options, report, keep))
}

/// Whether the port is a serial server, which sets its own speed.
const fn has_own_speed(port: &LineName) -> bool {
    matches!(port, LineName::Tcp { .. } | LineName::ModbusTcp { .. })
}

/// The modules that the configuration has on this line. None if flags alone describe the line, or
/// if the configuration can't be read.
fn configured(context: &Context, place: &Place) -> Vec<Known> {
    if context.options.ad_hoc.is_some() {
        return Vec::new();
    }
    let read = config_file::read(context.lang, context.options.config.as_deref());
    let Ok(found) = read else { return Vec::new() };
    let modules = found.config.modules_of(&place.line);
    let known = modules.map(|(name, module)| Known {
        name: name.clone(),
        family: module.setup.family,
        settings: module.setup.serial,
        protocol: module.setup.protocol,
        address: module.setup.address,
        checksum: module.setup.checksum,
    });
    known.collect()
}

/// The modules that the daemon has on this line.
async fn polled(
    context: &Context,
    place: &Place,
    backend: &Backend,
) -> Result<Vec<Known>, Failure> {
    let modules = backend.modules().await;
    let modules = modules.map_err(|problem| context.failure(&problem))?;
    let of_line = modules
        .into_iter()
        .filter(|module| module.line == place.line);
    let known = of_line.filter_map(|module| {
        let mut protocols = Protocol::ALL.into_iter();
        Some(Known {
            family: Family::from_name(&module.model)?,
            settings: place::settings(module.baud, module.format.as_deref(), place.settings),
            protocol: protocols.find(|protocol| protocol.name() == module.protocol)?,
            address: Address(module.address),
            checksum: module.checksum.unwrap_or_default(),
            name: module.module,
        })
    });
    Ok(known.collect())
}

/// The failure with which the command ends, if any.
fn verdict(context: &Context, place: &Place, report: Report) -> Result<(), Failure> {
    let line = place.line.as_str();
    let probes = report.scanner.counts().probes;
    let nobody = report.scanner.found().is_empty();
    match report.end {
        End::Unread => Ok(()),
        End::Interrupted => Err(stop::interrupted(context)),
        End::Lost(failure) => Err(failure),
        End::Noise => Err(Failure::of(context.lang, Code::ScanNoise).with_fact("line", line)),
        End::TimeUp => Err(Failure::of(context.lang, Code::ScanTimeUp).with_fact("line", line)),
        End::Complete if nobody => {
            let failure = Failure::of(context.lang, Code::NoReply).with_fact("line", line);
            Err(failure.with_fact("probes", probes))
        }
        End::Complete => Ok(()),
    }
}
