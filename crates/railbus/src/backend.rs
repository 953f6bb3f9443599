//! Whoever does what a command asks for: the daemon, if one runs, or a site opened here and now.
//!
//! Both give the same answers in the same types, so that no command knows which one it talks to.

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
use railbus_app::config_file::{self, Why};
pub(crate) use railbus_client::{Borrowed, Detail, Frames, Remote};
use railbus_device::{Family, Layout};
use railbus_host::Tap;
use railbus_wire::{Character, Protocol};
use railbus_words::Lang;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What the flags say about whom to ask.
#[derive(Clone, Debug, Default)]
pub(crate) struct Wanted {
    /// The configuration, where a flag names one.
    pub(crate) config: Option<PathBuf>,
    /// The daemon's socket, where a flag names one.
    pub(crate) socket: Option<PathBuf>,
    /// Not through a daemon.
    pub(crate) direct: bool,
    /// No configuration at all: this port, and this module on it.
    pub(crate) ad_hoc: Option<AdHoc>,
    /// The language in which a configuration's problems are told.
    pub(crate) lang: Lang,
    /// Read all modules again and again, as `watch` needs; else only what is asked for is read.
    pub(crate) polls: bool,
}

impl Wanted {
    const fn goes_direct(&self) -> bool {
        self.direct || self.ad_hoc.is_some()
    }
}

/// A line and a module on it, named by flags alone: `-l PORT -m MODEL -a ADDR`.
#[derive(Clone, Debug, Default)]
pub(crate) struct AdHoc {
    /// The port; the line is called `line`.
    pub(crate) port: String,
    /// Its speed; 9600 if not said.
    pub(crate) baud: Option<u32>,
    /// Its character format; 8N1 if not said.
    pub(crate) format: Option<Character>,
    /// The module; none for frames of one's own.
    pub(crate) module: Option<AdHocModule>,
}

/// The module of an [`AdHoc`] line.
#[derive(Clone, Debug)]
pub(crate) struct AdHocModule {
    /// What it is called: by its model, unless said otherwise.
    pub(crate) name: String,
    /// Its kind.
    pub(crate) family: Family,
    /// Its address.
    pub(crate) address: u8,
    /// The protocol; the model's own if not said.
    pub(crate) protocol: Option<Protocol>,
    /// Its ASCII frames carry a checksum.
    pub(crate) checksum: bool,
    /// Outputs and inputs of a 0x55 board, and how it uses its bits.
    pub(crate) outputs: Option<u8>,
    pub(crate) inputs: Option<u8>,
    pub(crate) layout: Option<Layout>,
}

/// Whoever does what a command asks for.
#[derive(Debug)]
pub(crate) enum Backend {
    /// A site opened here.
    Local(Local),
    /// The daemon, over its socket.
    Daemon(Remote),
}

/// What passes on one line, one piece after the other.
#[derive(Debug)]
pub(crate) enum Tape {
    /// On a line opened here, whose time began then.
    Local(Tap, u64),
    /// On a line of the daemon.
    Daemon(Frames),
}

impl Tape {
    /// The next piece; none once the line was closed or the daemon has gone.
    pub(crate) async fn next(&mut self) -> Option<FrameEvent> {
        match self {
            Tape::Local(tap, start) => Some(convert::passed(*start, tap.next().await?)),
            Tape::Daemon(frames) => frames.next().await?.ok(),
        }
    }
}

/// What happens, one after the other.
#[derive(Debug)]
pub(crate) enum Watch {
    /// On a site opened here.
    Local(local::Watch),
    /// At the daemon.
    Daemon(railbus_client::Watch),
}

impl Watch {
    /// The next thing that happens; none once the site was closed. Can be dropped and called
    /// again without losing anything.
    pub(crate) async fn next(&mut self) -> Option<Result<WatchEvent, Problem>> {
        match self {
            Watch::Local(watch) => watch.next().await.map(Ok),
            Watch::Daemon(watch) => watch.next().await,
        }
    }
}

/// Why nobody is reached at the socket that was named.
fn unreached(lang: Lang, socket: &Path, problem: Problem) -> Problem {
    let reason = match std::os::unix::net::UnixStream::connect(socket) {
        // Somebody answers, and says something else.
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

/// A daemon answers, and serves another site than the one meant.
fn other_site(lang: Lang, daemon: &Remote, file: &Path) -> Problem {
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

/// Calls the same of both.
macro_rules! either {
    ($self:ident . $method:ident ( $($argument:expr),* )) => {
        match $self {
            Backend::Local(local) => local.$method($($argument),*).await,
            Backend::Daemon(remote) => remote.$method($($argument),*).await,
        }
    };
}

impl Backend {
    /// A site from the flags, or from a configuration, opened here. To be called inside a tokio
    /// runtime with I/O and time enabled.
    pub(crate) async fn here(wanted: &Wanted) -> Result<Backend, Problem> {
        Local::open(wanted).await.map(Backend::Local)
    }

    /// The daemon that serves what is meant, or none where the line is to be opened here.
    ///
    /// A socket that was named is meant: where nobody answers there, no port is opened instead. A
    /// configuration that was named is meant, too, whatever else is served beside it. Where only
    /// the folder says which site is meant, a daemon of another one is refused, lest the wrong
    /// relay moves (docs/decisions/0025).
    pub(crate) async fn daemon(wanted: &Wanted) -> Result<Option<Remote>, Problem> {
        if wanted.goes_direct() {
            return Ok(None);
        }
        let own = config_file::chosen(wanted.config.as_deref()).ok();
        if let Some(socket) = &wanted.socket {
            let daemon = Remote::at(socket).await;
            let daemon = daemon.map_err(|problem| unreached(wanted.lang, socket, problem))?;
            return match &wanted.config {
                Some(file) if !daemon.serves(file) => Err(other_site(wanted.lang, &daemon, file)),
                _ => Ok(Some(daemon)),
            };
        }
        let found = Remote::usual().await;
        let Some((file, why)) = own else {
            return found.into_iter().next().transpose();
        };
        let mut refused = None;
        for daemon in found {
            match daemon {
                Ok(daemon) if daemon.serves(&file) => return Ok(Some(daemon)),
                Ok(daemon) => {
                    refused.get_or_insert_with(|| other_site(wanted.lang, &daemon, &file))
                }
                // It may be the one that is meant.
                Err(problem) => refused.get_or_insert_with(|| {
                    let file = config_file::real(&file);
                    problem.with_hint(format!("railbus --config {} ls", file.display()))
                }),
            };
        }
        match (refused, why) {
            (Some(problem), Why::Place) => Err(problem),
            _ => Ok(None),
        }
    }

    /// The lines that have a port, and what passes on each of them from now on.
    pub(crate) async fn tapes(&self) -> Vec<(LineInfo, Tape)> {
        match self {
            Backend::Local(local) => {
                let taps = local.taps().await.into_iter();
                taps.map(|(line, now, tap)| (line, Tape::Local(tap, convert::start_of(now))))
                    .collect()
            }
            Backend::Daemon(remote) => {
                let mut tapes = Vec::new();
                for line in remote.lines().await.unwrap_or_default() {
                    if let Ok(frames) = remote.frames(Some(&line.line)).await {
                        tapes.push((line, Tape::Daemon(frames)));
                    }
                }
                tapes
            }
        }
    }

    /// Whether it is the daemon, which reads by itself, and whose values have an age.
    pub(crate) const fn is_daemon(&self) -> bool {
        matches!(self, Backend::Daemon(_))
    }

    /// All lines.
    pub(crate) async fn lines(&self) -> Result<Vec<LineInfo>, Problem> {
        either!(self.lines())
    }

    /// The lines that have no port now, and why.
    pub(crate) async fn lines_down(&self) -> Vec<(LineInfo, Problem)> {
        let lines = self.lines().await.unwrap_or_default().into_iter();
        let down = lines.filter(|line| matches!(line.state, PortState::Absent | PortState::Busy));
        down.map(|line| {
            let why = match self {
                Backend::Local(local) => local.line_closed(&line.line),
                Backend::Daemon(_) => failures::line_down(&line),
            };
            (line, why)
        })
        .collect()
    }

    /// All modules. Here every one of them is asked first.
    pub(crate) async fn modules(&self) -> Result<Vec<ModuleInfo>, Problem> {
        either!(self.modules())
    }

    /// The points that one of the selectors names: `pump`, `pump.do0`, `*.di*`; all where there
    /// are none. `fresh` asks the line first, as it always is here.
    pub(crate) async fn points(
        &self,
        selectors: &[String],
        fresh: bool,
    ) -> Result<Vec<PointInfo>, Problem> {
        either!(self.points(selectors, fresh))
    }

    /// The same as they are known now, without asking the line.
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

    /// Switches several outputs of one module, in as few frames as it can take.
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

    /// Plays a scene, up to the first step that fails. With a daemon it is played to its end,
    /// whether or not anybody waits for that.
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

    /// Switches an output over.
    pub(crate) async fn toggle(
        &self,
        path: &str,
        wanted: ToggleRequest,
    ) -> Result<Written, Problem> {
        either!(self.toggle(path, wanted))
    }

    /// Begins a pulse. One that the host times here ends only while this process lives: see
    /// [`Backend::finish`].
    pub(crate) async fn pulse(&self, path: &str, wanted: PulseRequest) -> Result<Pulsed, Problem> {
        either!(self.pulse(path, wanted))
    }

    /// Sends a frame of one's own.
    pub(crate) async fn send(
        &self,
        line: &str,
        wanted: SendRequest,
    ) -> Result<SendAnswer, Problem> {
        either!(self.send_frame(line, wanted))
    }

    /// What happens from now on, after every point as it is.
    pub(crate) async fn watch(&self, selectors: &[String]) -> Result<Watch, Problem> {
        match self {
            Backend::Local(local) => local.watch(selectors).await.map(Watch::Local),
            Backend::Daemon(remote) => remote.watch(selectors).await.map(Watch::Daemon),
        }
    }

    /// Ends what was begun: outputs of pulses that are timed here are released when their time
    /// has come, or at once where `now` says so; then ports are closed. To be called before the
    /// program ends.
    pub(crate) async fn finish(self, now: bool) {
        if let Backend::Local(local) = self {
            local.finish(now).await;
        }
    }
}
