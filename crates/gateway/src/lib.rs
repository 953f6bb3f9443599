//! The gateway: what `railbus serve` runs. It has the lines, and other programs use it over HTTP
//! and a Unix socket. It parses no command line; next steps name commands.
//!
//! # Where things are
//! - An endpoint: the file of its subject (`points`, `control`, `history`, `config`, `scans`,
//!   `settings`, …), with a row in that file's `ROUTES`; all tables are listed in `routes`.
//!   What every handler needs: `site`. What must be so before one is called (who it is, what it
//!   may, limits, headers): `access`, `guard`, `listen`; where it listens, and with which
//!   certificate: `tcp`. Users and API tokens, with their roles
//!   and points: `access/accounts`; the role that a route needs: `Need` in its row; what a role
//!   permits: `railbus_site`'s rights. A request that switches or changes something begins as
//!   an `order`.
//! - Charts, and the columns of their download: `history`; `export` sends any long table row by
//!   row.
//! - What is sent as it changes: over a WebSocket `ws` (what can be subscribed to: `ws/topic`),
//!   over plain HTTP values in `stream` and events in `event_stream`.
//! - A system that the site is published to (events over HTTP, …): `northbound`, a folder each and
//!   a line in `northbound.rs`; its settings are declared and read in its folder, too, and so is
//!   how often it tries again. An example is the kind of the tests, in the same folder.
//!   What outlets offer by the configuration alone, for `railbus export`: [`offered`].
//! - The centre of many sites, which is another program in effect: [`hub`]; what it has in common
//!   with a site that reports to it: `nats`.
//! - Requests repeated under an `Idempotency-Key`: the header is read in `order`, its answer is
//!   in `keys`; what is kept of them is the site's. Long operations: `ops`. Exclusive access to
//!   a line over HTTP, which ends with its connection: `loan`, who may have it is in its row;
//!   for how long, the site decides. The OpenAPI document, made of the routes: `openapi`.
//!   Figures: `metrics`. Pages: `web` serves them, their sources are in the folder `web` of the
//!   repository.

#![forbid(unsafe_code)]

mod about;
pub mod access;
mod answer;
mod body;
mod capture;
mod clock;
mod compress;
mod config;
mod control;
mod deadline;
mod doc;
mod event_stream;
mod events;
mod export;
mod frame_listener;
mod frames;
mod guard;
mod history;
#[cfg(feature = "fleet")]
pub mod hub;
#[cfg(test)]
mod in_guide;
mod keys;
mod language;
mod listen;
mod loan;
mod localize;
mod metrics;
mod models;
#[cfg(feature = "fleet")]
mod nats;
mod northbound;
mod notify;
mod openapi;
mod ops;
mod order;
mod panics;
mod points;
mod ports;
mod remote_api;
mod remote_order;
#[cfg(test)]
mod rights;
mod route;
mod routes;
mod scans;
mod send;
mod settings;
mod sim;
mod site;
mod stores;
mod stream;
mod tcp;
mod texts;
mod tls;
mod web;

mod ws;

use access::Gate;
use config::Desk;
use listen::ConnectionLimit;
pub use northbound::offered;
use northbound::{DemoOutlet, Northbound};
use notify::Notify;
use railbus_api::problem::Problem;
use railbus_app::api::failures::bad_config;
use railbus_app::config_file::{self, FoundConfig};
use railbus_app::failure::Failure;
use railbus_app::own_folder::OwnFolder;
use railbus_app::render::{Format, out, records};
use railbus_app::socket::{self, Socket};
use railbus_plant::background::Background;
use railbus_plant::remote::Remote;
use railbus_site::{Config, Service};
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::width;
use routes::Audience;
use serde_json::json;
use site::Site;
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use stores::Stores;
use tcp::{Network, Reached};
use texts::GatewayText;
pub use tls::CertificateSource;
use tls::Tls;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

/// The default address.
pub const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7485);

/// The options of the daemon.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// The configuration file, if one is named.
    pub config: Option<PathBuf>,
    /// A simulated line instead of a configuration.
    pub demo: bool,
    /// Where it listens.
    pub listen: SocketAddr,
    /// Certificate and key, if it uses TLS.
    pub tls: Option<CertificateSource>,
    /// Names by which browsers reach it.
    pub names: Vec<String>,
    /// The socket, if one is named.
    pub socket: Option<PathBuf>,
    /// Only check the configuration, and report the result in this format.
    pub check: Option<Format>,
}

impl ServeOptions {
    /// How it is reached over TCP.
    fn network(&self) -> Network {
        Network {
            listen: self.listen,
            tls: self.tls.clone(),
            names: self.names.clone(),
        }
    }
}

/// The command that serves.
const SERVE: &str = "railbus serve";

/// Whether it may listen where it is to.
fn may_listen(lang: Lang, wanted: &ServeOptions) -> Result<(), Failure> {
    let state = match wanted.demo {
        true => None,
        false => config_file::path(wanted.config.as_deref())
            .ok()
            .map(|file| config_file::state_folder(Some(&file))),
    };
    // The demo starts without users each time.
    let add = (!wanted.demo).then_some("railbus user add NAME --role admin");
    let network = wanted.network();
    network.may_listen(lang, state.as_deref(), (SERVE, add))
}

/// Serves until it is stopped.
///
/// # Errors
/// It may not listen there, or something that it needs is not available.
pub fn run(lang: Lang, wanted: &ServeOptions) -> Result<(), Failure> {
    may_listen(lang, wanted)?;
    if let Some(format) = wanted.check {
        return check(lang, wanted, format);
    }
    panics::count_them();
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| system(lang, error))?
        .block_on(open_and_serve(lang, wanted))
}

/// How long to wait for ports before the daemon reports that it serves: a network port may take
/// longer.
const TRIED_WITHIN: Duration = Duration::from_secs(1);

/// The system refuses something that it usually grants.
fn system(lang: Lang, error: impl ToString) -> Failure {
    Failure::new(
        Code::System,
        lang.get(GatewayText::CantServeSite).to_owned(),
    )
    .because(error)
}

/// Reads the configuration, and checks the settings of its outlets.
///
/// # Errors
/// There is none, it can't be read, or something is wrong with it.
pub fn read_config(lang: Lang, named: Option<&Path>) -> Result<FoundConfig, Problem> {
    let found = config_file::read(lang, named)?;
    let text = config_file::text_of(&found.path)?;
    let name = found.path.display().to_string();
    northbound::check(lang, &name, &text, &found.config)?;
    Ok(found)
}

/// Checks the configuration and reports the result.
fn check(lang: Lang, wanted: &ServeOptions, format: Format) -> Result<(), Failure> {
    let found = read_config(lang, wanted.config.as_deref());
    let found = found.map_err(|problem| Failure::of_problem(lang, &problem))?;
    let (lines, modules) = (found.config.lines.len(), found.config.modules.len());
    let path = found.path.display().to_string();
    if format.is_json() {
        let told = json!({ "file": path, "lines": lines, "modules": modules });
        return out::result(lang, &records::line(told));
    }
    let values: &[(&str, &dyn std::fmt::Display)] =
        &[("file", &path), ("lines", &lines), ("modules", &modules)];
    out::result(
        lang,
        &format!("{}\n", lang.fill(GatewayText::ServeChecked, values)),
    )
}

/// The site, and where it comes from.
struct Source {
    config: Config,
    file: PathBuf,
    /// The state folder.
    state: PathBuf,
    /// Locked: another daemon of this folder fails before it changes anything.
    access: Arc<Gate>,
    /// Ends with the daemon, after the lines.
    demo: Option<Demo>,
}

/// The demo line, and the folder of its site, which is removed last.
struct Demo {
    line: Background,
    outlets: Vec<DemoOutlet>,
    _folder: OwnFolder,
}

impl Source {
    fn open(lang: Lang, wanted: &ServeOptions) -> Result<Source, Failure> {
        let refused = |problem: Problem| Failure::of_problem(lang, &problem);
        if wanted.demo {
            return Source::demo(lang, wanted.listen == LISTEN);
        }
        // If there is none anywhere, one is created here.
        let file = config_file::path(wanted.config.as_deref());
        let file = file.unwrap_or_else(|_| config_file::real(Path::new(config_file::NAME)));
        let state = config_file::state_folder(Some(&file));
        let access = Arc::new(Gate::open(&state).map_err(refused)?);
        // What was on trial is not used. If it can't be taken back yet, its integration goes on
        // with that.
        if let Err(problem) = northbound::recover(&file, &state) {
            warn_of(lang, &Failure::of_problem(lang, &problem));
        }
        // A site may start empty: its first line is added in the browser.
        let config = match file.exists() {
            true => read_config(lang, Some(&file)).map_err(refused)?.config,
            false => Config::default(),
        };
        Ok(Source {
            config,
            state,
            file,
            access,
            demo: None,
        })
    }

    /// Only one demo can listen at the usual address: it has the outlets of the demo, too.
    fn demo(lang: Lang, is_usual: bool) -> Result<Source, Failure> {
        let folder = OwnFolder::make("railbus-demo").map_err(|error| system(lang, error))?;
        let line = Background::start(lang, folder.path().join("line"))?;
        let port = line.path().display().to_string();
        let (text, outlets) = match is_usual {
            true => northbound::of_demo(),
            false => Default::default(),
        };
        let text = railbus_plant::demo::text(&port) + &text;
        let file = folder.path().join(config_file::NAME);
        std::fs::write(&file, &text).map_err(|error| system(lang, error))?;
        let config = Config::parse(&text).map_err(|problems| {
            Failure::of_problem(lang, &bad_config(lang, config_file::NAME, &problems))
        })?;
        // Its own, whatever is set as the state folder of real sites.
        let state = folder.path().join(".railbus");
        let access = Gate::open(&state);
        let access = access.map_err(|problem| Failure::of_problem(lang, &problem))?;
        let demo = Demo {
            line,
            outlets,
            _folder: folder,
        };
        Ok(Source {
            config,
            file,
            state,
            access: Arc::new(access),
            demo: Some(demo),
        })
    }
}

impl Source {
    /// The lines that are simulated here.
    fn simulated(&self) -> Vec<Remote> {
        let demo = self.demo.iter();
        demo.map(|demo| demo.line.remote().clone()).collect()
    }
}

async fn open_and_serve(lang: Lang, wanted: &ServeOptions) -> Result<(), Failure> {
    let mut signals = Signals::new().map_err(|error| system(lang, error))?;
    // Listen first: a second daemon fails here, before it touches a line.
    let tcp = tcp::bind(lang, wanted.listen, SERVE).await?;
    let socket = listen_on_socket(lang, wanted.socket.as_deref(), socket::DAEMON)?;
    let source = Source::open(lang, wanted)?;
    let access = Arc::clone(&source.access);
    let service = Service::start_in(source.config.clone(), &source.state);
    let service = service.map_err(|error| system(lang, error))?;
    let name = site::name_of(source.demo.is_some(), &source.file);
    let northbound = Northbound::new(&name, &source.state, &service, &access);
    let stores = Stores::open(&service, &source.state);
    stores::tell_of_keys(&service);
    service.run_rules();

    // Clients may send requests as soon as it reports that it serves: by then every port was tried.
    let tried = async {
        for line in source.config.lines.keys() {
            // The reason for a failure is part of the line's status.
            let _ = service.opened(line).await;
        }
    };
    let _ = tokio::time::timeout(TRIED_WITHIN, tried).await;
    let reached = Reached::open(lang, &tcp, &wanted.network(), &source.state)?;
    let Reached { front, tls, origin } = reached;
    announce(lang, &source, &access, &origin, tls.as_deref(), &socket);
    let desk = Arc::new(Desk::new(&source.file, &source.state, &source.config));
    northbound.run(desk.changes());
    let (stop, stopped) = watch::channel(false);
    let site = Site {
        service: service.clone(),
        lang,
        demo: source.demo.is_some(),
        simulated: source.simulated().into(),
        stop: stopped.clone(),
        sockets: ws::SocketLimit::new(),
        printer: Arc::default(),
        ops: Arc::new(ops::Ops::default()),
        desk: Arc::clone(&desk),
        northbound: Arc::clone(&northbound),
        access,
        origin: origin.into(),
        tls: tls.clone(),
    };
    let [limit, socket_limit] = [ConnectionLimit::new(), ConnectionLimit::new()];
    let for_remote = routes::handlers(site.clone(), Audience::Remote);
    northbound.serve_api(for_remote, stopped.clone());
    northbound.serve_config(site.clone());
    let over_tcp = routes::router(site.clone(), Some(front));
    let mut listening = vec![tokio::spawn(listen::tcp(
        tcp,
        tls.clone(),
        over_tcp,
        limit.clone(),
        stopped.clone(),
    ))];
    if let Ok(socket) = socket {
        let over_socket = routes::router(site, None);
        let unix = listen::unix(socket, over_socket, socket_limit.clone(), stopped);
        listening.push(tokio::spawn(unix));
    }

    let notify = Notify::of_environment();
    notify.tell(notify::READY);
    let asked = async {
        while signals.next().await == Asked::Reload {
            reload(lang, &service, &desk).await;
            tcp::reload_tls(lang, tls.as_deref());
        }
    };
    tokio::select! {
        () = asked => {}
        () = notify.stay_alive() => {}
    }
    notify.tell(notify::STOPPING);
    deadline::after(deadline::END_MAX, move || cut_off(lang));
    // Fails if there is no receiver left.
    let _ = stop.send(true);
    for task in listening {
        // Fails if it panicked, which was reported.
        let _ = task.await;
    }
    tokio::join!(limit.emptied(), socket_limit.emptied());
    service.close().await;
    // Outlets are notified of the stop, too.
    tokio::join!(stores.close(&service), northbound.close());
    Ok(())
}

/// It did not end in time: the process ends anyway, and says so.
fn cut_off(lang: Lang) {
    let failure = Failure::of(lang, Code::CutOff);
    warn_of(lang, &failure);
    std::process::exit(failure.code().exit().into());
}

/// Listens on the socket that is named, which must be available; otherwise on the first of the
/// usual places of this name that is.
fn listen_on_socket(
    lang: Lang,
    named: Option<&Path>,
    name: &str,
) -> Result<Result<Socket, (PathBuf, std::io::Error)>, Failure> {
    if let Some(path) = named {
        let listening = Socket::listen(lang, path);
        return listening
            .map(Ok)
            .map_err(|error| no_socket(lang, path, &error));
    }
    let mut tried = Err((PathBuf::new(), std::io::ErrorKind::NotFound.into()));
    for path in socket::places(name) {
        tried = Socket::listen(lang, &path).map_err(|error| (path, error));
        if tried.is_ok() {
            break;
        }
    }
    Ok(tried)
}

fn no_socket(lang: Lang, path: &Path, error: &std::io::Error) -> Failure {
    let path = path.display();
    let message = lang.fill(GatewayText::NoSocket, &[("path", &path)]);
    Failure::new(Code::Listen, message).because(error)
}

/// Reloads the configuration. If it has errors they are reported, and everything stays as it was.
async fn reload(lang: Lang, service: &Service, desk: &Desk) {
    match desk.reload(service, lang).await {
        Ok(config::Changed { reloaded: done, .. }) => {
            let lists = [&done.kept, &done.opened, &done.closed];
            let [kept, opened, closed] = lists.map(|lines| match lines.as_slice() {
                [] => "–".to_owned(),
                lines => lines.join(" "),
            });
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("kept", &kept), ("opened", &opened), ("closed", &closed)];
            say(&lang.fill(GatewayText::Reloaded, values));
        }
        Err(problem) => {
            warn_of(lang, &Failure::of_problem(lang, &problem));
            warn(lang.get(GatewayText::NotReloaded));
        }
    }
}

/// Prints what is served, and how to connect.
fn announce(
    lang: Lang,
    source: &Source,
    access: &Gate,
    origin: &str,
    tls: Option<&Tls>,
    socket: &Result<Socket, (PathBuf, std::io::Error)>,
) {
    let version = env!("CARGO_PKG_VERSION");
    let file = source.file.display().to_string();
    let what = match &source.demo {
        Some(_) => lang.get(GatewayText::ServesDemo).to_owned(),
        None if source.file.exists() => file,
        None => lang.fill(GatewayText::ServesNew, &[("file", &file)]),
    };
    let socket = match socket {
        Ok(socket) => socket.path().display().to_string(),
        Err((path, error)) => format!("– ({}: {error})", path.display()),
    };
    // If there is a user already, there is no link.
    let setup = access.setup_link(origin).map(|link| {
        let once = lang.get(GatewayText::ServeSetup);
        format!("\n  setup   {link}   {once}")
    });
    let tls = tls.map(|tls| format!("\n  tls     SHA-256 {}", tls.fingerprint()));
    let outlets = source.demo.iter().flat_map(|demo| &demo.outlets);
    let told = outlets.map(|outlet| {
        let [en, zh] = outlet.about;
        let about = match lang {
            Lang::En => en,
            Lang::Zh => zh,
        };
        format!("\n  {:<7} {}   {about}", outlet.name, outlet.listen)
    });
    let outlets: String = told.collect();
    say(&format!(
        "railbus {version}  {what}\n  web     {origin}/{}{}\n  api     {origin}/api/v1\n  \
         socket  {socket}{outlets}\n  {}",
        setup.unwrap_or_default(),
        tls.unwrap_or_default(),
        lang.get(GatewayText::ServeStop)
    ));
}

/// Stdout may be closed; the site is served anyway.
fn say(text: &str) {
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "{text}").and_then(|()| stdout.flush());
}

fn warn(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

fn warn_of(lang: Lang, failure: &Failure) {
    warn(&failure.render_within(lang, width::of_errors()));
}

/// What a signal asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    Stop,
    Reload,
}

/// The signals. Once this is created, they no longer end the process at once.
struct Signals {
    interrupt: Signal,
    terminate: Signal,
    hangup: Signal,
}

impl Signals {
    fn new() -> std::io::Result<Signals> {
        Ok(Signals {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hangup: signal(SignalKind::hangup())?,
        })
    }

    async fn next(&mut self) -> Asked {
        tokio::select! {
            _ = self.interrupt.recv() => Asked::Stop,
            _ = self.terminate.recv() => Asked::Stop,
            _ = self.hangup.recv() => Asked::Reload,
        }
    }
}
