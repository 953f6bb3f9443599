//! `railbus serve`: the daemon. It has the lines, and everyone else asks it: over HTTP on this
//! machine, and over a Unix socket.

pub(crate) mod access;
mod answer;
mod doc;
mod frames;
mod guard;
mod keys;
mod listen;
mod loan;
mod openapi;
mod points;
mod routes;
pub(crate) mod socket;
mod spoken;
mod stream;
mod web;

use crate::api::failures::bad_config;
use crate::api::problem::Problem;
use crate::cli;
use crate::config_file;
use crate::failure::{Code, Failure};
use crate::i18n::Lang;
use crate::render::{Format, out, records};
use crate::sim::background::Background;
use crate::texts::Text;
use access::Access;
use access::secret::{hex, random};
use clap::{ArgAction, ArgMatches, Command, value_parser};
use keys::Keys;
use listen::Room;
use railbus_site::{Config, Service};
use routes::Site;
use serde_json::json;
use socket::Socket;
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

/// The name of the command.
pub(crate) const NAME: &str = "serve";

/// Where it listens unless it is told otherwise.
const LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7485);

/// What the arguments say.
struct Wanted {
    config: Option<PathBuf>,
    demo: bool,
    listen: SocketAddr,
    socket: Option<PathBuf>,
    check: bool,
}

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus serve [--demo|--config FILE] [--listen ADDR] [--check]";
    let switch = |name, help| cli::flag(lang, name, help).action(ArgAction::SetTrue);
    cli::verb(lang, NAME, Text::ServeAbout, usage)
        .before_help(cli::examples(lang, Text::ServeExamples))
        .arg(switch("demo", Text::ServeDemo))
        .arg(
            cli::flag(lang, "listen", Text::ServeListen)
                .value_name("ADDR")
                .value_parser(value_parser!(SocketAddr)),
        )
        .arg(switch("check", Text::ServeCheck))
}

/// Serves until it is stopped.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let wanted = Wanted {
        config: matches.get_one("config").cloned(),
        demo: matches.get_flag("demo"),
        listen: matches.get_one("listen").copied().unwrap_or(LISTEN),
        socket: matches.get_one("socket").cloned(),
        check: matches.get_flag("check"),
    };
    if !wanted.listen.ip().is_loopback() {
        let port = wanted.listen.port();
        return Err(Failure::of(lang, Code::NotLoopback)
            .with_try(format!("railbus serve --listen 127.0.0.1:{port}"))
            .with_try(format!("ssh -L {port}:127.0.0.1:{port} HOST")));
    }
    if wanted.check {
        let format = matches.get_one::<String>("output");
        let format = format.and_then(|name| Format::from_name(name));
        return check(lang, &wanted, format.unwrap_or_default());
    }
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| system(lang, error))?
        .block_on(open_and_serve(lang, &wanted))
}

/// How long ports may take to be tried before the daemon says that it serves: a network may take
/// longer than people wait.
const TRIED_WITHIN: Duration = Duration::from_secs(1);

/// The system refuses what it always grants.
fn system(lang: Lang, error: impl ToString) -> Failure {
    Failure::new(Code::System, lang.get(Text::CantServeSite).to_owned()).because(error)
}

/// Reads the configuration and says what is in it.
fn check(lang: Lang, wanted: &Wanted, format: Format) -> Result<(), Failure> {
    let found = config_file::read(lang, wanted.config.as_deref());
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
        &format!("{}\n", lang.fill(Text::ServeChecked, values)),
    )
}

/// The site, and where it comes from.
struct Source {
    config: Config,
    /// What is to be remembered lies here.
    state: PathBuf,
    /// None for the demo.
    file: Option<PathBuf>,
    /// Ends with the daemon, after the lines.
    _demo: Option<Background>,
    /// Goes away with the demo.
    _folder: Option<Temporary>,
}

/// A folder that goes away with this.
struct Temporary(PathBuf);

impl Temporary {
    fn make(lang: Lang) -> Result<Temporary, Failure> {
        let name = random::<8>().map_err(|error| system(lang, error))?;
        let path = std::env::temp_dir().join(format!("railbus-demo-{}", hex(&name)));
        let made = std::fs::DirBuilder::new().mode(0o700).create(&path);
        made.map_err(|error| system(lang, error))?;
        Ok(Temporary(path))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Source {
    fn open(lang: Lang, wanted: &Wanted) -> Result<Source, Failure> {
        let refused = |problem: Problem| Failure::of_problem(lang, &problem);
        if wanted.demo {
            let link = format!("railbus-demo-{}", std::process::id());
            let demo = Background::start(lang, std::env::temp_dir().join(link))?;
            let port = demo.path().display().to_string();
            let text = include_str!("serve/demo.toml").replace("PORT", &port);
            let config = Config::parse(&text)
                .map_err(|problems| refused(bad_config(lang, "demo.toml", &problems)))?;
            let folder = Temporary::make(lang)?;
            return Ok(Source {
                config,
                state: folder.0.clone(),
                file: None,
                _demo: Some(demo),
                _folder: Some(folder),
            });
        }
        let found = config_file::read(lang, wanted.config.as_deref()).map_err(refused)?;
        Ok(Source {
            config: found.config,
            state: config_file::state_folder(Some(&found.path)),
            file: Some(found.path),
            _demo: None,
            _folder: None,
        })
    }
}

async fn open_and_serve(lang: Lang, wanted: &Wanted) -> Result<(), Failure> {
    let mut signals = Signals::new().map_err(|error| system(lang, error))?;
    // The places to listen first: a second daemon fails here, before it touches a line.
    let tcp = TcpListener::bind(wanted.listen).await.map_err(|error| {
        let message = lang.fill(Text::NoTcp, &[("address", &wanted.listen)]);
        Failure::new(Code::Listen, message)
            .because(error)
            .with_try("railbus serve --listen 127.0.0.1:0")
    })?;
    let address = tcp.local_addr().map_err(|error| system(lang, error))?;
    let socket = listen_on_socket(lang, wanted)?;
    let source = Source::open(lang, wanted)?;
    let access = Access::open(&source.state);
    let access = access.map_err(|problem| Failure::of_problem(lang, &problem))?;
    let service = Service::start(source.config.clone()).map_err(|error| system(lang, error))?;

    // Who hears that it serves may ask at once: every port was tried by then.
    let tried = async {
        for line in source.config.lines.keys() {
            // The reason why not is a part of the line's status.
            let _ = service.opened(line).await;
        }
    };
    let _ = tokio::time::timeout(TRIED_WITHIN, tried).await;
    let origin = format!("http://{address}");
    announce(lang, &source, &access, &origin, &socket);
    let (stop, stopped) = watch::channel(false);
    let site = Site {
        service: service.clone(),
        lang,
        demo: source.file.is_none(),
        stop: stopped.clone(),
        keys: Arc::new(Keys::default()),
        file: source.file.as_deref().map(Arc::from),
        access: Arc::new(access),
        origin: origin.into(),
        is_tls: false,
    };
    let room = Room::new();
    let over_tcp = routes::router(site.clone(), Some(address.port()));
    let mut listening = vec![tokio::spawn(listen::tcp(
        tcp,
        over_tcp,
        room.clone(),
        stopped.clone(),
    ))];
    if let Ok(socket) = socket {
        let over_socket = routes::router(site, None);
        let unix = listen::unix(socket, over_socket, room.clone(), stopped);
        listening.push(tokio::spawn(unix));
    }

    while signals.next().await == Asked::Reload {
        reload(lang, &service, source.file.as_deref()).await;
    }
    // Fails where nobody listens any more.
    let _ = stop.send(true);
    for task in listening {
        // Fails where it panicked, which was told.
        let _ = task.await;
    }
    room.emptied().await;
    service.close().await;
    Ok(())
}

/// The socket that was named must be there; of the usual ones, the first that can be had.
fn listen_on_socket(
    lang: Lang,
    wanted: &Wanted,
) -> Result<Result<Socket, (PathBuf, std::io::Error)>, Failure> {
    let named = |path: &Path| Socket::listen(lang, path).map_err(|error| (path.to_owned(), error));
    if let Some(path) = &wanted.socket {
        return named(path).map(Ok).map_err(|(path, error)| {
            let path = path.display();
            let message = lang.fill(Text::NoSocket, &[("path", &path)]);
            Failure::new(Code::Listen, message).because(error)
        });
    }
    let mut tried = Err((PathBuf::new(), std::io::ErrorKind::NotFound.into()));
    for path in socket::places() {
        tried = named(&path);
        if tried.is_ok() {
            break;
        }
    }
    Ok(tried)
}

/// Takes the configuration again. Where it has problems they are told, and all stays as it was.
async fn reload(lang: Lang, service: &Service, file: Option<&Path>) {
    let Some(path) = file else {
        return complain(lang.get(Text::NoReload));
    };
    let name = path.display().to_string();
    let read = match config_file::text_of(path) {
        Ok(text) => service.reload(&text).await,
        Err(problem) => return complain(&Failure::of_problem(lang, &problem).render(lang)),
    };
    match read {
        Ok(done) => {
            let lists = [&done.kept, &done.opened, &done.closed];
            let [kept, opened, closed] = lists.map(|lines| match lines.as_slice() {
                [] => "–".to_owned(),
                lines => lines.join(" "),
            });
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("kept", &kept), ("opened", &opened), ("closed", &closed)];
            say(&lang.fill(Text::Reloaded, values));
        }
        Err(problems) => {
            let problem = bad_config(lang, &name, &problems);
            complain(&Failure::of_problem(lang, &problem).render(lang));
            complain(lang.get(Text::NotReloaded));
        }
    }
}

/// Says what is served, and how to connect.
fn announce(
    lang: Lang,
    source: &Source,
    access: &Access,
    origin: &str,
    socket: &Result<Socket, (PathBuf, std::io::Error)>,
) {
    let version = env!("CARGO_PKG_VERSION");
    let what = match &source.file {
        None => lang.get(Text::ServesDemo).to_owned(),
        Some(file) => file.display().to_string(),
    };
    let socket = match socket {
        Ok(socket) => socket.path().display().to_string(),
        Err((path, error)) => format!("– ({}: {error})", path.display()),
    };
    // Where there is a user already there is no link.
    let setup = access.setup_link(origin).map(|link| {
        let once = lang.get(Text::ServeSetup);
        format!("\n  setup   {link}   {once}")
    });
    say(&format!(
        "railbus {version}  {what}\n  web     {origin}/{}\n  api     {origin}/api/v1\n  \
         socket  {socket}\n  {}",
        setup.unwrap_or_default(),
        lang.get(Text::ServeStop)
    ));
}

/// Who reads it may have gone; the site is served all the same.
fn say(text: &str) {
    let mut stdout = std::io::stdout();
    let _ = writeln!(stdout, "{text}").and_then(|()| stdout.flush());
}

fn complain(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// What a signal asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    Stop,
    Reload,
}

/// The signals. From their making on they no longer end the program at once.
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
