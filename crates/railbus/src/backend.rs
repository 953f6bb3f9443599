//! What carries a command out: the daemon, if one runs, or a site opened for this command.
//!
//! Both return the same answers in the same types, so no command knows which one it talks to.

mod local;

use local::Local;
pub(crate) use local::described;
use railbus_api::control::{BatchAnswer, GroupInfo, GroupRequest, SceneInfo, SceneRequest};
use railbus_api::problem::{Problem, codes};
use railbus_api::sending::{SendAnswer, SendRequest};
use railbus_api::types::{
    FrameEvent, LineInfo, ModuleInfo, OutputsRequest, OutputsWritten, PointInfo, PortState,
    PulseRequest, Pulsed, ToggleRequest, WatchEvent, WriteRequest, Written,
};
use railbus_app::api::{convert, failures};
use railbus_app::config_file::{self, ConfigOrigin};
use railbus_client::HubClient;
pub(crate) use railbus_client::{Borrowed, DaemonClient, Frames, Resolution};
use railbus_device::{Family, Layout};
use railbus_host::Tap;
use railbus_wire::{Character, Protocol};
use railbus_words::Lang;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What the flags say about where a command is carried out.
#[derive(Clone, Debug, Default)]
pub(crate) struct Options {
    /// The configuration file, if a flag names one.
    pub(crate) config: Option<PathBuf>,
    /// The daemon's socket, if a flag names one.
    pub(crate) socket: Option<PathBuf>,
    /// A site of a fleet, asked through its centre.
    pub(crate) far: Option<FarSite>,
    /// Do not use a daemon.
    pub(crate) direct: bool,
    /// No configuration: this port, and this module on it.
    pub(crate) ad_hoc: Option<AdHoc>,
    /// The language in which problems of a configuration are reported.
    pub(crate) lang: Lang,
    /// Poll all modules, as `watch` needs; otherwise only what is asked for is read.
    pub(crate) polls: bool,
}

/// A site of a fleet.
#[derive(Clone, Debug)]
pub(crate) struct FarSite {
    /// Its name.
    pub(crate) name: String,
    /// The socket of the centre, if a flag names one.
    pub(crate) hub: Option<PathBuf>,
}

impl Options {
    const fn goes_direct(&self) -> bool {
        self.direct || self.ad_hoc.is_some()
    }
}

/// A line and a module on it, described by flags alone: `-l PORT -m MODEL -a ADDR`.
#[derive(Clone, Debug, Default)]
pub(crate) struct AdHoc {
    /// The port; the line is called `line`.
    pub(crate) port: String,
    /// Its baud rate; 9600 by default.
    pub(crate) baud: Option<u32>,
    /// Its character format; 8N1 by default.
    pub(crate) format: Option<Character>,
    /// The module; none for raw frames.
    pub(crate) module: Option<AdHocModule>,
}

/// The module of an [`AdHoc`] line.
#[derive(Clone, Debug)]
pub(crate) struct AdHocModule {
    /// Its name: by default that of its model.
    pub(crate) name: String,
    /// Its family.
    pub(crate) family: Family,
    /// Its address.
    pub(crate) address: u8,
    /// The protocol; by default the model's own.
    pub(crate) protocol: Option<Protocol>,
    /// Its ASCII frames carry a checksum.
    pub(crate) checksum: bool,
    /// Outputs and inputs of a 0x55 board, and how it uses its bits.
    pub(crate) outputs: Option<u8>,
    pub(crate) inputs: Option<u8>,
    pub(crate) layout: Option<Layout>,
}

/// What carries a command out.
#[derive(Debug)]
pub(crate) enum Backend {
    /// A site opened here.
    Local(Local),
    /// The daemon, over its socket.
    Daemon(DaemonClient),
}

/// The traffic of one line, event by event.
#[derive(Debug)]
pub(crate) enum Traffic {
    /// On a line opened here; the time in microseconds at which its clock started.
    Local(Tap, u64),
    /// On a line of the daemon.
    Daemon(Frames),
}

impl Traffic {
    /// The next event; none once the line was closed or the daemon has gone.
    pub(crate) async fn next(&mut self) -> Option<FrameEvent> {
        match self {
            Traffic::Local(tap, start) => Some(convert::passed(*start, tap.next().await?)),
            Traffic::Daemon(frames) => frames.next().await?.ok(),
        }
    }
}

/// What happens on the site, event by event.
#[derive(Debug)]
pub(crate) enum Watch {
    /// On a site opened here.
    Local(local::Watch),
    /// At the daemon.
    Daemon(railbus_client::Watch),
}

impl Watch {
    /// The next event; none once the site was closed. Cancel-safe: if it is dropped, no event is
    /// lost.
    pub(crate) async fn next(&mut self) -> Option<Result<WatchEvent, Problem>> {
        match self {
            Watch::Local(watch) => watch.next().await.map(Ok),
            Watch::Daemon(watch) => watch.next().await,
        }
    }
}

/// Why there is no daemon at the socket that was named.
fn unreached(lang: Lang, socket: &Path, problem: Problem) -> Problem {
    let reason = match std::os::unix::net::UnixStream::connect(socket) {
        // Something answers, but not as a daemon does.
        Ok(_) => return problem,
        Err(error) => match error.kind() {
            ErrorKind::PermissionDenied => [
                "no permission to open this socket",
                "没有打开此套接字的权限",
            ],
            ErrorKind::NotFound => ["there is no such socket", "没有此套接字"],
            _ => ["nothing answers at this socket", "此套接字无程序应答"],
        },
    };
    problem.with(
        "reason",
        format!("{}: {}", lang.of(reason), socket.display()),
    )
}

/// A daemon answers, but serves another site.
fn other_site(lang: Lang, daemon: &DaemonClient, file: &Path) -> Problem {
    let (socket, file) = (daemon.socket().display(), config_file::real(file));
    let (served, file) = (daemon.name(lang), file.display());
    let reasons = match lang {
        Lang::En => {
            format!("the daemon at {socket} serves {served}; the configuration here is {file}")
        }
        Lang::Zh => format!("{socket} 的守护进程的配置：{served}；此处的配置：{file}"),
    };
    Problem::new(codes::OTHER_SITE)
        .with("socket", socket.to_string())
        .with("served", daemon.config().display().to_string())
        .with("config", file.to_string())
        .with("reason", reasons)
        .with_hint(format!("railbus --socket {socket} ls"))
        .with_hint(format!("railbus --config {file} ls"))
}

/// Calls the same method of whichever it is.
macro_rules! either {
    ($self:ident . $method:ident ( $($argument:expr),* )) => {
        match $self {
            Backend::Local(local) => local.$method($($argument),*).await,
            Backend::Daemon(remote) => remote.$method($($argument),*).await,
        }
    };
}

impl Backend {
    /// Opens a site, described by the flags or by a configuration. Must be called inside a tokio
    /// runtime with I/O and time enabled.
    pub(crate) async fn here(options: &Options) -> Result<Backend, Problem> {
        Local::open(options).await.map(Backend::Local)
    }

    /// The daemon to use, or none if the line is to be opened here.
    ///
    /// A socket named by a flag must be served: if it is not, no port is opened instead. A
    /// configuration named by a flag is the one to use, whatever else is served. If only the
    /// working directory says which site is meant, a daemon that serves another site is refused, so
    /// that the wrong relay can't be switched (docs/decisions/0025).
    pub(crate) async fn daemon(options: &Options) -> Result<Option<DaemonClient>, Problem> {
        if let Some(far) = &options.far {
            let hub = HubClient::find(far.hub.as_deref()).await?;
            return Ok(Some(DaemonClient::far(&hub, &far.name)));
        }
        if options.goes_direct() {
            return Ok(None);
        }
        let own = config_file::chosen(options.config.as_deref()).ok();
        if let Some(socket) = &options.socket {
            let daemon = DaemonClient::at(socket).await;
            let daemon = daemon.map_err(|problem| unreached(options.lang, socket, problem))?;
            return match &options.config {
                Some(file) if !daemon.serves(file) => Err(other_site(options.lang, &daemon, file)),
                _ => Ok(Some(daemon)),
            };
        }
        let found = DaemonClient::usual().await;
        let Some((file, why)) = own else {
            return found.into_iter().next().transpose();
        };
        let mut refused = None;
        for daemon in found {
            match daemon {
                Ok(daemon) if daemon.serves(&file) => return Ok(Some(daemon)),
                Ok(daemon) => {
                    refused.get_or_insert_with(|| other_site(options.lang, &daemon, &file))
                }
                // It may be the right one.
                Err(problem) => refused.get_or_insert_with(|| {
                    let file = config_file::real(&file);
                    problem.with_hint(format!("railbus --config {} ls", file.display()))
                }),
            };
        }
        match (refused, why) {
            (Some(problem), ConfigOrigin::Place) => Err(problem),
            _ => Ok(None),
        }
    }

    /// The lines that have a port, and their traffic from now on.
    pub(crate) async fn traffic(&self) -> Vec<(LineInfo, Traffic)> {
        match self {
            Backend::Local(local) => {
                let taps = local.taps().await.into_iter();
                taps.map(|(line, now, tap)| (line, Traffic::Local(tap, convert::start_of(now))))
                    .collect()
            }
            Backend::Daemon(remote) => {
                let mut found = Vec::new();
                for line in remote.lines().await.unwrap_or_default() {
                    if let Ok(frames) = remote.frames(Some(&line.line)).await {
                        found.push((line, Traffic::Daemon(frames)));
                    }
                }
                found
            }
        }
    }

    /// Whether it is the daemon, which polls by itself, so its values have an age.
    pub(crate) const fn is_daemon(&self) -> bool {
        matches!(self, Backend::Daemon(_))
    }

    /// All lines.
    pub(crate) async fn lines(&self) -> Result<Vec<LineInfo>, Problem> {
        either!(self.lines())
    }

    /// The lines whose port is not open, and why.
    pub(crate) async fn lines_down(&self) -> Result<Vec<(LineInfo, Problem)>, Problem> {
        let lines = self.lines().await?.into_iter();
        let down = lines.filter(|line| matches!(line.state, PortState::Absent | PortState::Busy));
        let down = down.map(|line| {
            let why = match self {
                Backend::Local(local) => local.line_closed(&line.line),
                Backend::Daemon(remote) => remote.of_its_site(failures::line_down(&line)),
            };
            (line, why)
        });
        Ok(down.collect())
    }

    /// All modules. A site opened here reads each of them first.
    pub(crate) async fn modules(&self) -> Result<Vec<ModuleInfo>, Problem> {
        either!(self.modules())
    }

    /// The points that match one of the selectors: `pump`, `pump.do0`, `*.di*`; all points if there
    /// are no selectors. `fresh` reads them from the line first; a site opened here always does.
    pub(crate) async fn points(
        &self,
        selectors: &[String],
        fresh: bool,
    ) -> Result<Vec<PointInfo>, Problem> {
        either!(self.points(selectors, fresh))
    }

    /// The same from the cache, without reading the line.
    pub(crate) async fn known(&self, selectors: &[String]) -> Result<Vec<PointInfo>, Problem> {
        match self {
            Backend::Local(local) => Ok(local.known(selectors)),
            Backend::Daemon(remote) => remote.points(selectors, false).await,
        }
    }

    /// Switches one output.
    pub(crate) async fn write(&self, path: &str, wanted: WriteRequest) -> Result<Written, Problem> {
        either!(self.write(path, wanted))
    }

    /// Switches several outputs of one module, in as few frames as possible.
    pub(crate) async fn outputs(
        &self,
        module: &str,
        wanted: OutputsRequest,
    ) -> Result<OutputsWritten, Problem> {
        either!(self.outputs(module, wanted))
    }

    /// All scenes.
    pub(crate) async fn scenes(&self) -> Result<Vec<SceneInfo>, Problem> {
        either!(self.scenes())
    }

    /// Runs a scene up to the first step that fails. A daemon runs it to its end even if the caller
    /// goes away.
    pub(crate) async fn play(
        &self,
        scene: &str,
        wanted: SceneRequest,
    ) -> Result<BatchAnswer, Problem> {
        either!(self.play(scene, wanted))
    }

    /// All groups.
    pub(crate) async fn groups(&self) -> Result<Vec<GroupInfo>, Problem> {
        either!(self.groups())
    }

    /// Switches a group.
    pub(crate) async fn set_group(
        &self,
        group: &str,
        wanted: GroupRequest,
    ) -> Result<BatchAnswer, Problem> {
        either!(self.set_group(group, wanted))
    }

    /// Toggles an output.
    pub(crate) async fn toggle(
        &self,
        path: &str,
        wanted: ToggleRequest,
    ) -> Result<Written, Problem> {
        either!(self.toggle(path, wanted))
    }

    /// Starts a pulse. One that is timed here, by the host, ends only while this process lives: see
    /// [`Backend::finish`].
    pub(crate) async fn pulse(&self, path: &str, wanted: PulseRequest) -> Result<Pulsed, Problem> {
        either!(self.pulse(path, wanted))
    }

    /// Sends a raw frame.
    pub(crate) async fn send(
        &self,
        line: &str,
        wanted: SendRequest,
    ) -> Result<SendAnswer, Problem> {
        either!(self.send_frame(line, wanted))
    }

    /// What happens from now on, preceded by the present value of every point.
    pub(crate) async fn watch(&self, selectors: &[String]) -> Result<Watch, Problem> {
        match self {
            Backend::Local(local) => local.watch(selectors).await.map(Watch::Local),
            Backend::Daemon(remote) => remote.watch(selectors).await.map(Watch::Daemon),
        }
    }

    /// Ends what was started: outputs of pulses that are timed here are released when their time
    /// has come, or at once with `now`; then the ports are closed. Must be called before the
    /// program exits.
    pub(crate) async fn finish(self, now: bool) {
        if let Backend::Local(local) = self {
            local.finish(now).await;
        }
    }
}
