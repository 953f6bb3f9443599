//! The flags that every command has, and the runtime that commands run in.

use super::trace::{TraceText, Tracers};
use crate::args::{LAST, flag};
use crate::backend::{AdHoc, AdHocModule, Backend, DaemonClient, FarSite, Options};
use crate::texts::Text;
use clap::builder::FalseyValueParser;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, value_parser};
use railbus_api::problem::Problem;
use railbus_app::address;
use railbus_app::config_file::{self, ConfigOrigin};
use railbus_app::failure::Failure;
use railbus_app::render::Format;
use railbus_app::render::colour::{Colour, Paint};
use railbus_device::Family;
use railbus_host::LineName;
use railbus_wire::{Baud, Character, Micros, Protocol};
use railbus_words::Code;
use railbus_words::Lang;
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::io::IsTerminal;
use std::path::PathBuf;

/// Environment variables that replace flags. The configuration and the language have their own ways
/// of looking.
const ENVIRONMENT: [(&str, &str); 13] = [
    ("line", "RAILBUS_LINE"),
    ("output", "RAILBUS_OUTPUT"),
    ("color", "RAILBUS_COLOR"),
    ("quiet", "RAILBUS_QUIET"),
    ("direct", "RAILBUS_DIRECT"),
    ("socket", "RAILBUS_SOCKET"),
    ("timeout", "RAILBUS_TIMEOUT"),
    ("model", "RAILBUS_MODEL"),
    ("address", "RAILBUS_ADDRESS"),
    ("protocol", "RAILBUS_PROTOCOL"),
    ("baud", "RAILBUS_BAUD"),
    ("format", "RAILBUS_FORMAT"),
    ("checksummed", "RAILBUS_ASCII_CHECKSUM"),
];

/// The flag of [`far_flag`]. Other commands have a `--site` of another meaning.
pub(super) const FAR: &str = "far-site";

/// What the flags say.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) lang: Lang,
    pub(crate) format: Format,
    pub(crate) colour: Colour,
    pub(crate) quiet: bool,
    /// How many times `-v` was given.
    pub(crate) verbose: u8,
    /// A line of the configuration; a port is in `options`.
    pub(crate) line: Option<String>,
    pub(crate) timeout: Option<Micros>,
    pub(crate) options: Options,
    /// The tasks that print the traffic, with `-v`.
    tracers: Tracers,
    /// The note whose daemon is used was printed.
    has_told: Cell<bool>,
    /// The lines that this command has borrowed from daemons.
    borrowed: RefCell<Vec<(DaemonClient, String)>>,
}

/// The files of a site, and the daemon that serves it.
#[derive(Debug)]
pub(crate) struct Files {
    pub(crate) config: PathBuf,
    /// The state folder.
    pub(crate) state: PathBuf,
    pub(crate) daemon: Option<DaemonClient>,
}

/// The flags that every command has.
pub(crate) fn global_flags(lang: Lang) -> Vec<Arg> {
    let with = |name, help, value: &'static str| flag(lang, name, help).value_name(value);
    let choice =
        |arg: Arg, names: Vec<&'static str>| arg.value_parser(names).hide_possible_values(true);
    let switch = |name, help| {
        let flag = flag(lang, name, help).action(ArgAction::SetTrue);
        flag.value_parser(FalseyValueParser::new())
    };
    let families = Family::ALL.map(Family::name).to_vec();
    let protocols = Protocol::ALL.map(Protocol::name).to_vec();
    let flags = vec![
        with("line", Text::LineFlag, "LINE").short('l'),
        choice(
            with("output", Text::OutputFlag, "FORMAT").short('o'),
            Format::NAMES.to_vec(),
        ),
        choice(
            with("color", Text::ColorFlag, "WHEN"),
            Colour::NAMES.to_vec(),
        ),
        switch("quiet", Text::QuietFlag).short('q'),
        flag(lang, "log-file", TraceText::LogFile)
            .value_name("FILE")
            .value_parser(value_parser!(PathBuf)),
        with("config", Text::ConfigFlag, "FILE").value_parser(value_parser!(PathBuf)),
        switch("direct", Text::DirectFlag),
        with("socket", Text::SocketFlag, "PATH").value_parser(value_parser!(PathBuf)),
        with("timeout", Text::TimeoutFlag, "TIME").value_parser(duration),
        choice(with("model", Text::ModelFlag, "MODEL").short('m'), families),
        with("address", Text::AddressFlag, "ADDR")
            .short('a')
            .value_parser(address),
        choice(
            with("protocol", Text::ProtocolFlag, "PROTO").short('p'),
            protocols,
        ),
        choice(with("baud", Text::BaudFlag, "N"), Baud::NAMES.to_vec()),
        choice(
            with("format", Text::FormatFlag, "8N1"),
            Character::ALL.map(Character::name).to_vec(),
        ),
        switch("checksummed", Text::ChecksumFlag).long("ascii-checksum"),
    ];
    let global = |arg: Arg| {
        let mut known = ENVIRONMENT.into_iter();
        let variable = known.find(|(flag, _)| arg.get_id() == flag);
        let arg = match variable {
            Some((_, name)) => arg.env(name).hide_env(true),
            None => arg,
        };
        arg.global(true).display_order(LAST)
    };
    flags.into_iter().map(global).collect()
}

/// The flag that means a site of a fleet, of commands that can ask one.
pub(crate) fn far_flag(lang: Lang) -> Arg {
    flag(lang, FAR, Text::FarFlag)
        .long("site")
        .short('s')
        .value_name("SITE")
}

/// The socket of the centre of a fleet, if one is named. The variable that names a socket means
/// that of a site's daemon.
pub(crate) fn hub_socket(matches: &ArgMatches) -> Option<PathBuf> {
    let is_named = matches.value_source("socket") == Some(ValueSource::CommandLine);
    matches.get_one("socket").filter(|_| is_named).cloned()
}

/// A duration with its unit.
pub(crate) fn duration(text: &str) -> Result<Micros, String> {
    Micros::parse(text).ok_or_else(String::new)
}

impl Context {
    pub(crate) fn of(lang: Lang, matches: &ArgMatches) -> Result<Context, Failure> {
        let named = |name: &str| matches.get_one::<String>(name).map(String::as_str);
        let family = named("model").and_then(Family::from_name);
        let address = matches.get_one("address").copied();
        Context::with(lang, matches, (family, address))
    }

    /// The same for commands where a flag with a model does not name a module.
    pub(crate) fn of_line(lang: Lang, matches: &ArgMatches) -> Result<Context, Failure> {
        Context::with(lang, matches, (None, None))
    }

    fn with(
        lang: Lang,
        matches: &ArgMatches,
        module: (Option<Family>, Option<u8>),
    ) -> Result<Context, Failure> {
        let text = |name: &str| matches.get_one::<String>(name).cloned();
        let format = text("output").and_then(|name| Format::from_name(&name));
        let line = text("line");
        let ad_hoc = ad_hoc(lang, matches, line.as_deref(), module)?;
        // Most commands do not have this flag.
        let far = matches.try_get_one::<String>(FAR).ok().flatten();
        let far = far.map(|name| FarSite {
            name: name.clone(),
            hub: hub_socket(matches),
        });
        // Flags that it would ignore: they say that another site is meant, or follow a line.
        let in_the_way = [
            ("--direct", matches.get_flag("direct")),
            ("--config", matches.contains_id("config")),
            ("--line", ad_hoc.is_some()),
            ("-v", matches.get_count("verbose") > 0),
        ];
        let in_the_way = in_the_way.into_iter().find(|(_, is_there)| *is_there);
        if let (Some(_), Some((name, _))) = (&far, in_the_way) {
            let message = lang.fill(Text::Conflict, &[("name", &name)]);
            return Err(Failure::new(Code::Usage, message));
        }
        Ok(Context {
            lang,
            format: format.unwrap_or_default(),
            colour: text("color")
                .and_then(|name| Colour::from_name(&name))
                .unwrap_or_default(),
            quiet: matches.get_flag("quiet"),
            verbose: matches.get_count("verbose"),
            line: line.filter(|_| ad_hoc.is_none()),
            timeout: matches.get_one("timeout").copied(),
            tracers: Tracers::new(matches.get_one("log-file").cloned()),
            has_told: Cell::new(false),
            borrowed: RefCell::default(),
            options: Options {
                config: matches.get_one("config").cloned(),
                socket: matches.get_one("socket").cloned(),
                far,
                direct: matches.get_flag("direct"),
                ad_hoc,
                lang,
                polls: false,
            },
        })
    }

    /// The daemon to use, if there is one and no flag forbids it. If nothing in this folder says
    /// which site is meant, a note says whose daemon it is.
    pub(crate) async fn daemon(&self) -> Result<Option<DaemonClient>, Failure> {
        let daemon = Backend::daemon(&self.options).await;
        let daemon = daemon.map_err(|problem| self.failure(&problem))?;
        if let Some(daemon) = &daemon
            && self.options.socket.is_none()
            && !daemon.is_far()
            && self.format == Format::Table
            && std::io::stderr().is_terminal()
            && config_file::chosen(self.options.config.as_deref()).is_err()
            && !self.has_told.replace(true)
        {
            let site = daemon.name(self.lang);
            self.note(&self.lang.fill(Text::ThroughDaemon, &[("site", &site)]));
        }
        Ok(daemon)
    }

    /// Notes a borrowed line: it is given back before this command ends.
    pub(crate) fn has_borrowed(&self, daemon: &DaemonClient, line: &str) {
        self.borrowed
            .borrow_mut()
            .push((daemon.clone(), line.to_owned()));
    }

    /// The files of the site: those of the daemon, or our own.
    pub(crate) async fn files(&self) -> Result<Files, Failure> {
        if let Some(daemon) = self.daemon().await? {
            return Ok(Files {
                config: daemon.config().to_owned(),
                state: daemon.state().to_owned(),
                daemon: Some(daemon),
            });
        }
        let config = config_file::path(self.options.config.as_deref());
        let config = config.map_err(|problem| self.failure(&problem))?;
        Ok(Files {
            state: config_file::state_folder(Some(&config)),
            config,
            daemon: None,
        })
    }

    /// The configuration for commands that only read it, and why it is that one: the one found
    /// here, or else that of the daemon.
    pub(crate) fn config(&self) -> Result<(PathBuf, ConfigOrigin), Failure> {
        let own = config_file::chosen(self.options.config.as_deref());
        if self.options.socket.is_none() && (own.is_ok() || self.options.direct) {
            return own.map_err(|problem| self.failure(&problem));
        }
        match (self.block(self.daemon())?, own) {
            (Some(daemon), _) => Ok((daemon.config().to_owned(), ConfigOrigin::Daemon)),
            (None, own) => own.map_err(|problem| self.failure(&problem)),
        }
    }

    /// The daemon, or a site opened here.
    pub(crate) async fn open(&self) -> Result<Backend, Failure> {
        let backend = match self.daemon().await? {
            Some(daemon) => Backend::Daemon(daemon),
            None => {
                let backend = Backend::here(&self.options).await;
                backend.map_err(|problem| self.failure(&problem))?
            }
        };
        if self.verbose > 0 {
            self.tracers.follow(self, &backend).await?;
        }
        Ok(backend)
    }

    /// A problem as a failure in the user's language.
    pub(crate) fn failure(&self, problem: &Problem) -> Failure {
        Failure::of_problem(self.lang, problem)
    }

    /// The colours of the result.
    pub(crate) fn paint(&self) -> Paint {
        Paint::of(self.colour, &std::io::stdout())
    }

    /// Prints a note on stderr, unless `-q` suppresses it.
    pub(crate) fn note(&self, text: &str) {
        if !self.quiet {
            railbus_app::render::out::note(text);
        }
    }

    /// Runs a command to its end.
    pub(crate) fn block<T>(
        &self,
        command: impl Future<Output = Result<T, Failure>>,
    ) -> Result<T, Failure> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| Failure::of(self.lang, Code::System).because(error))?;
        let end = runtime.block_on(command);
        runtime.block_on(self.tracers.finish());
        for (daemon, line) in self.borrowed.take() {
            runtime.block_on(daemon.has_back(&line));
        }
        end
    }
}

/// The port and module that flags describe, if they do.
fn ad_hoc(
    lang: Lang,
    matches: &ArgMatches,
    line: Option<&str>,
    (family, address): (Option<Family>, Option<u8>),
) -> Result<Option<AdHoc>, Failure> {
    let text = |name: &str| matches.get_one::<String>(name).map(String::as_str);
    let missing = |name: &str| {
        let message = lang.fill(Text::MissingArgument, &[("name", &name)]);
        Failure::new(Code::Usage, message).with_try("railbus -l /dev/ttyUSB0 -m erc8 -a 3 get erc8")
    };
    let is_port = line.is_some_and(|line| line.parse::<LineName>().is_ok());
    let (port, module) = match (line, family, address) {
        (Some(port), Some(family), Some(address)) => (port, Some((family, address))),
        (_, Some(_), None) => return Err(missing("--address")),
        (_, None, Some(_)) => return Err(missing("--model")),
        (None, Some(_), Some(_)) => return Err(missing("--line")),
        (Some(port), None, None) if is_port => (port, None),
        (_, None, None) => return Ok(None),
    };
    let protocol = text("protocol");
    let protocol = Protocol::ALL
        .into_iter()
        .find(|known| protocol == Some(known.name()));
    let format = text("format");
    let baud = text("baud").and_then(|baud| baud.parse().ok());
    Ok(Some(AdHoc {
        port: port.to_owned(),
        baud: baud.and_then(Baud::from_rate).map(Baud::rate),
        format: format.and_then(Character::from_name),
        module: module.map(|(family, address)| AdHocModule {
            name: family.name().to_owned(),
            family,
            address,
            protocol,
            checksum: matches.get_flag("checksummed"),
            outputs: None,
            inputs: None,
            layout: None,
        }),
    }))
}
