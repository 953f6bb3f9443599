//! A virtual line, driven by the real clock.

use super::answers;
use super::frames::Frames;
use super::keep::Keeper;
use super::orders::LineOrder;
use super::pty::Pty;
use super::stage::Stage;
use super::tcp::Tcp;
use crate::i18n::Lang;
use railbus_sim::demo::Demo;
use railbus_sim::{Chunks, Input, Line, LineConfig, Output};
use railbus_wire::{Instant, Micros, Settings};
use std::io;
use std::pin::pin;
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc, oneshot};
use tokio::time::sleep_until;

/// Clients are not read while the host has more than this to send: they wait, and nothing
/// piles up here.
const BACKLOG: Micros = Micros::from_millis(500);

/// How many entries of the trace are kept between two looks at it.
const TRACE: usize = 1_024;

/// So much of what a line tells is handed out in one go.
const TOLD_MAX: u32 = 1_024;
/// The deadline of a line that has more to tell.
const BEHIND: Instant = Instant(0);

/// Real time, counted from the start, as many times faster as is wanted.
#[derive(Clone, Copy)]
pub(super) struct Clock {
    start: tokio::time::Instant,
    speed: f64,
}

impl Clock {
    pub(super) fn new(speed: f64) -> Clock {
        let start = tokio::time::Instant::now();
        Clock { start, speed }
    }

    fn now(&self) -> Instant {
        let passed = self.start.elapsed().as_secs_f64() * self.speed;
        Instant((passed * 1e6) as u64)
    }

    fn when(&self, at: Instant) -> tokio::time::Instant {
        /// Far enough for a deadline, and not beyond what the clock can count.
        const YEAR: f64 = 31_536_000.0;
        let passed = at.0 as f64 / 1e6 / self.speed;
        // Rounded up: a deadline that has come has really come.
        self.start + Duration::from_micros((passed.min(YEAR) * 1e6).ceil() as u64)
    }
}

/// The signals that end it. From its making on they no longer end the program at once, which
/// would leave the link behind.
pub(super) struct Stop {
    signals: [Signal; 3],
}

impl Stop {
    pub(super) fn new() -> io::Result<Stop> {
        Ok(Stop {
            signals: [
                signal(SignalKind::interrupt())?,
                signal(SignalKind::terminate())?,
                signal(SignalKind::hangup())?,
            ],
        })
    }

    /// Waits for one of them.
    pub(super) async fn requested(&mut self) {
        let [interrupt, terminate, hangup] = &mut self.signals;
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            _ = hangup.recv() => {}
        }
    }
}

/// The line that is served.
pub(super) enum Scene {
    Demo(Box<Demo>),
    Stage(Box<Stage>),
}

impl Scene {
    /// The demo line.
    pub(super) fn demo(config: LineConfig) -> io::Result<Scene> {
        let demo = Demo::new(Instant(0), config).map_err(io::Error::other)?;
        Ok(Scene::Demo(Box::new(demo)))
    }

    fn handle(&mut self, now: Instant, input: Input<'_>) {
        match self {
            Scene::Demo(demo) => demo.handle(now, input),
            Scene::Stage(stage) => stage.handle(now, input),
        }
    }

    fn poll(&mut self) -> Output<'_> {
        match self {
            Scene::Demo(demo) => demo.poll(),
            Scene::Stage(stage) => stage.poll(),
        }
    }

    fn line(&self) -> &Line {
        match self {
            Scene::Demo(demo) => demo.line(),
            Scene::Stage(stage) => stage.line(),
        }
    }

    fn line_mut(&mut self) -> &mut Line {
        match self {
            Scene::Demo(demo) => demo.line_mut(),
            Scene::Stage(stage) => stage.line_mut(),
        }
    }

    /// How the master is set that sends these characters at this speed over a PTY, which keeps
    /// no parity: as the module that they are for, or else as the line.
    fn settings(&self, bytes: &[u8], of_port: Settings) -> Settings {
        let line = self.line();
        let modules = line.addressed(bytes);
        let mut serials = modules.map(|module| line.engine(module).active().serial);
        let fitting = serials.find(|serial| serial.baud == of_port.baud);
        fitting.unwrap_or(of_port)
    }
}

/// What lines are made of in real time.
pub(super) fn line_config(seed: u64, traced: bool) -> LineConfig {
    LineConfig {
        seed,
        // Each character goes out as soon as it has ended.
        chunks: Chunks::Single,
        trace: if traced { TRACE } else { 0 },
        ..LineConfig::default()
    }
}

/// Something to be done on a line, and who waits for the answer.
pub(super) type Job = (LineOrder, oneshot::Sender<Vec<String>>);

/// Where jobs come from.
pub(super) struct Jobs {
    pub(super) lang: Lang,
    pub(super) receiver: mpsc::Receiver<Job>,
}

/// A line and all that leads to it.
pub(super) struct Served {
    pub(super) scene: Scene,
    /// What masters are set to that can't say it, and the parity of those that say only a speed.
    pub(super) serial: Settings,
    pub(super) pty: Option<Pty>,
    pub(super) tcp: Option<Tcp>,
    pub(super) frames: Option<Frames>,
    pub(super) jobs: Option<Jobs>,
    pub(super) keeper: Option<Keeper>,
}

/// Serves a line until `stop` ends it.
pub(super) async fn serve(
    clock: Clock,
    mut served: Served,
    stop: impl Future<Output = ()>,
) -> io::Result<()> {
    let mut stop = pin!(stop);
    let mut buffer = [0; 512];
    let mut settings = served.serial;
    let mut answer = None;
    loop {
        let deadline = served.drain()?;
        if deadline == BEHIND {
            tokio::task::yield_now().await;
        }
        if let Some((sender, lines)) = answer.take() {
            let sender: oneshot::Sender<Vec<String>> = sender;
            // Whoever asked may have gone.
            let _ = sender.send(lines);
        }
        let free_at = served.scene.line().host_free_at();
        let has_room = free_at.since(clock.now()) < BACKLOG;
        let is_idle = free_at <= clock.now();
        tokio::select! {
            () = &mut stop => return Ok(()),
            () = sleep_until(clock.when(deadline)) => {
                served.scene.handle(clock.now(), Input::Timeout);
            }
            (job, lang) = next_job(served.jobs.as_mut()) => {
                let (order, sender) = job;
                if let Scene::Stage(stage) = &mut served.scene {
                    answer = Some((sender, answers::perform(lang, stage, clock.now(), order)));
                }
            }
            event = heard_by_pty(served.pty.as_mut(), &mut buffer), if has_room => {
                let (count, of_port) = event?;
                let bytes = &buffer[..count];
                // A frame may come in parts; its first characters say whom it is for.
                if is_idle || settings.baud != of_port.baud {
                    let character = served.serial.character;
                    settings = served.scene.settings(bytes, Settings { character, ..of_port });
                }
                served.scene.handle(clock.now(), Input::Send { bytes, settings });
            }
            bytes = heard_by_tcp(served.tcp.as_mut()), if has_room => {
                let settings = served.serial;
                served.scene.handle(clock.now(), Input::Send { bytes: &bytes, settings });
            }
        }
    }
}

impl Served {
    /// Hands out what the host hears; gives back when to come again. A line that has more to
    /// tell than this machine can bear falls behind, and still hears its orders.
    fn drain(&mut self) -> io::Result<Instant> {
        let mut told = 0;
        let deadline = loop {
            told += 1;
            if told > TOLD_MAX {
                break BEHIND;
            }
            match self.scene.poll() {
                Output::Heard { bytes, .. } => {
                    if let Some(pty) = &mut self.pty {
                        pty.send(bytes);
                    }
                    if let Some(tcp) = &self.tcp {
                        tcp.send(bytes);
                    }
                }
                Output::Effect { .. } => {}
                Output::Wait(at) => break at.unwrap_or(Instant(u64::MAX)),
            }
        };
        if let (Some(frames), Some(trace)) = (&mut self.frames, self.scene.line_mut().trace_mut()) {
            frames.show(trace);
        }
        if let (Some(keeper), Scene::Stage(stage)) = (&mut self.keeper, &self.scene) {
            keeper.keep(stage)?;
        }
        Ok(deadline)
    }
}

async fn next_job(jobs: Option<&mut Jobs>) -> (Job, Lang) {
    match jobs {
        Some(jobs) => match jobs.receiver.recv().await {
            Some(job) => (job, jobs.lang),
            None => std::future::pending().await,
        },
        None => std::future::pending().await,
    }
}

async fn heard_by_pty(pty: Option<&mut Pty>, buffer: &mut [u8]) -> io::Result<(usize, Settings)> {
    match pty {
        Some(pty) => pty.event(buffer).await,
        None => std::future::pending().await,
    }
}

/// What a client sends next over TCP; never anything where there is no TCP.
async fn heard_by_tcp(tcp: Option<&mut Tcp>) -> Vec<u8> {
    match tcp {
        Some(tcp) => tcp.received().await,
        None => std::future::pending().await,
    }
}
