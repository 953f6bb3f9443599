//! A virtual line, driven by the real clock.

use super::answers;
use super::frames::Frames;
use super::keep::Keeper;
use super::orders::{Directory, LineOrder};
use super::panel;
use super::pty::Pty;
use super::stage::Stage;
use super::tcp::Tcp;
use railbus_api::sim::SimLineInfo;
use railbus_sim::{Chunks, Input, Output, VirtualLineConfig};
use railbus_wire::{Instant, Micros, SerialSettings};
use railbus_words::Lang;
use std::io;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc, oneshot};
use tokio::time::sleep_until;

/// Clients are not read while the host has more than this to send: they wait, and nothing
/// accumulates here.
const BACKLOG: Micros = Micros::from_millis(500);

/// How many trace entries are kept between two reads of it.
const TRACE: usize = 1_024;

/// How much of a line's output is delivered in one go.
const TOLD_MAX: u32 = 1_024;
/// The deadline of a line with more output.
const BEHIND: Instant = Instant(0);

/// Real time since the start, multiplied by the speed factor.
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
        /// Far enough for a deadline, and within the range of the clock.
        const YEAR: f64 = 31_536_000.0;
        let passed = at.0 as f64 / 1e6 / self.speed;
        // Rounded up: a deadline must really have passed.
        self.start + Duration::from_micros((passed.min(YEAR) * 1e6).ceil() as u64)
    }
}

/// The signals that end it. Once this exists they no longer end the program at once, which would
/// leave the link behind.
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

/// The parameters of lines in real time.
pub(super) fn line_config(seed: u64, traced: bool) -> VirtualLineConfig {
    VirtualLineConfig {
        seed,
        // A frame is delivered when its last character has ended: one by one, a busy machine would
        // tear apart frames that no module tears apart.
        chunks: Chunks::Whole,
        trace: if traced { TRACE } else { 0 },
        ..VirtualLineConfig::default()
    }
}

/// A job on a line, and who waits for the result.
#[derive(Debug)]
pub(super) enum Job {
    /// To be answered in words.
    Tell(LineOrder, oneshot::Sender<Vec<String>>),
    /// To be answered with the state of the line afterwards.
    Show(Vec<LineOrder>, oneshot::Sender<SimLineInfo>),
}

/// A completed job, and its answer.
enum Done {
    Tell(Vec<String>, oneshot::Sender<Vec<String>>),
    Show(oneshot::Sender<SimLineInfo>),
}

/// The source of jobs.
pub(super) struct Jobs {
    pub(super) lang: Lang,
    pub(super) directory: Arc<Directory>,
    pub(super) receiver: mpsc::Receiver<Job>,
}

/// A line and its connections.
pub(super) struct Served {
    pub(super) stage: Box<Stage>,
    /// The settings of masters that can't report them, and the parity of those that report only a
    /// speed.
    pub(super) serial: SerialSettings,
    pub(super) pty: Option<Pty>,
    /// The path of the PTY that is unplugged.
    pub(super) unplugged: Option<PathBuf>,
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
    let mut done = None;
    loop {
        let deadline = served.drain()?;
        if deadline == BEHIND {
            tokio::task::yield_now().await;
        }
        if let Some(done) = done.take() {
            served.answer(clock.now(), done);
        }
        let free_at = served.stage.line().host_free_at();
        let has_room = free_at.since(clock.now()) < BACKLOG;
        let is_idle = free_at <= clock.now();
        tokio::select! {
            () = &mut stop => return Ok(()),
            () = sleep_until(clock.when(deadline)) => {
                served.stage.handle(clock.now(), Input::Timeout);
            }
            (job, lang) = next_job(served.jobs.as_mut()) => {
                done = Some(served.perform(lang, clock.now(), job));
            }
            event = heard_by_pty(served.pty.as_mut(), &mut buffer), if has_room => {
                let (count, of_port) = event?;
                let bytes = &buffer[..count];
                // A frame may arrive in parts; its first characters carry the address.
                if is_idle || settings.baud != of_port.baud {
                    let character = served.serial.character;
                    let heard_at = SerialSettings { character, ..of_port };
                    settings = served.stage.settings_for(bytes, heard_at);
                }
                served.stage.handle(clock.now(), Input::Send { bytes, settings });
            }
            bytes = heard_by_tcp(served.tcp.as_mut()), if has_room => {
                let settings = served.serial;
                served.stage.handle(clock.now(), Input::Send { bytes: &bytes, settings });
            }
        }
    }
}

impl Served {
    /// Delivers what the host receives; returns when to continue. A line with more output than this
    /// machine can handle falls behind, and still accepts commands.
    fn drain(&mut self) -> io::Result<Instant> {
        let mut told = 0;
        let deadline = loop {
            told += 1;
            if told > TOLD_MAX {
                break BEHIND;
            }
            match self.stage.poll() {
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
        if let (Some(frames), Some(trace)) = (&mut self.frames, self.stage.line_mut().trace_mut()) {
            frames.show(trace);
        }
        if let Some(keeper) = &mut self.keeper {
            keeper.keep(&self.stage)?;
        }
        Ok(deadline)
    }

    /// Executes a job. Its effects are processed before it is answered.
    fn perform(&mut self, lang: Lang, now: Instant, job: Job) -> Done {
        match job {
            Job::Tell(order, sender) => {
                let told = answers::perform(lang, &mut self.stage, now, order);
                Done::Tell(told, sender)
            }
            Job::Show(orders, sender) => {
                // A mere query, too, must see the current state.
                self.stage.handle(now, Input::Timeout);
                for order in orders {
                    match order {
                        LineOrder::Plug(plugged) => self.plug(plugged),
                        order => {
                            let _ = answers::perform(lang, &mut self.stage, now, order);
                        }
                    }
                }
                Done::Show(sender)
            }
        }
    }

    /// The caller may have gone.
    fn answer(&self, now: Instant, done: Done) {
        match (done, &self.jobs) {
            (Done::Tell(told, sender), _) => drop(sender.send(told)),
            (Done::Show(sender), Some(jobs)) => {
                let plugged = self.unplugged.is_none();
                let info = panel::line(&self.stage, &jobs.directory, now, plugged);
                drop(sender.send(info));
            }
            (Done::Show(_), None) => {}
        }
    }

    /// Unplugs the adapter, or plugs it in. If that fails it stays unplugged, which observers are
    /// told.
    fn plug(&mut self, plugged: bool) {
        if plugged && let Some(path) = self.unplugged.take() {
            self.pty = Pty::open(&path).ok();
            self.unplugged = self.pty.is_none().then_some(path);
        } else if !plugged && let Some(pty) = self.pty.take() {
            self.unplugged = Some(pty.path().to_owned());
        }
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

async fn heard_by_pty(
    pty: Option<&mut Pty>,
    buffer: &mut [u8],
) -> io::Result<(usize, SerialSettings)> {
    match pty {
        Some(pty) => pty.event(buffer).await,
        None => std::future::pending().await,
    }
}

/// The next data from a client over TCP; never any if there is no TCP.
async fn heard_by_tcp(tcp: Option<&mut Tcp>) -> Vec<u8> {
    match tcp {
        Some(tcp) => tcp.received().await,
        None => std::future::pending().await,
    }
}
