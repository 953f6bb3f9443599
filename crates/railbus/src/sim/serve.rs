//! The virtual line, driven by the real clock.

use super::frames::Frames;
use super::pty::Pty;
use super::tcp::Tcp;
use railbus_sim::demo::Demo;
use railbus_sim::{Chunks, Input, LineConfig, Output};
use railbus_wire::{Instant, Micros, Settings};
use std::io;
use std::pin::pin;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::time::sleep_until;

/// Clients are not read while the host has more than this to send: they wait, and nothing
/// piles up here.
const BACKLOG: Micros = Micros::from_millis(500);

/// How many entries of the trace are kept between two looks at it.
const TRACE: usize = 1_024;

/// Real time, counted from the start.
struct Clock {
    start: tokio::time::Instant,
}

impl Clock {
    fn now(&self) -> Instant {
        let passed = self.start.elapsed().as_micros();
        Instant(u64::try_from(passed).unwrap_or(u64::MAX))
    }

    fn when(&self, at: Instant) -> tokio::time::Instant {
        self.start + std::time::Duration::from_micros(at.0)
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

/// Serves the demo line until `stop` ends it.
pub(super) async fn serve(
    seed: u64,
    stop: impl Future<Output = ()>,
    mut pty: Pty,
    mut tcp: Option<Tcp>,
    mut frames: Option<Frames>,
) -> io::Result<()> {
    let mut stop = pin!(stop);
    let clock = Clock {
        start: tokio::time::Instant::now(),
    };
    let mut demo = demo_line(seed, frames.is_some())?;
    let mut buffer = [0; 512];
    loop {
        let deadline = drain(&mut demo, &mut pty, tcp.as_ref());
        if let (Some(frames), Some(trace)) = (&mut frames, demo.line_mut().trace_mut()) {
            frames.show(trace);
        }
        let backlog = demo.line().host_free_at().since(clock.now());
        let has_room = backlog < BACKLOG;
        tokio::select! {
            () = &mut stop => return Ok(()),
            () = sleep_until(clock.when(deadline)) => demo.handle(clock.now(), Input::Timeout),
            event = pty.event(&mut buffer), if has_room => {
                let (count, settings) = event?;
                let bytes = &buffer[..count];
                demo.handle(clock.now(), Input::Send { bytes, settings });
            }
            bytes = received(tcp.as_mut()), if has_room => {
                let settings = Settings::FACTORY;
                demo.handle(clock.now(), Input::Send { bytes: &bytes, settings });
            }
        }
    }
}

/// What a client sends next over TCP; never anything where there is no TCP.
async fn received(tcp: Option<&mut Tcp>) -> Vec<u8> {
    match tcp {
        Some(tcp) => tcp.received().await,
        None => std::future::pending().await,
    }
}

fn demo_line(seed: u64, traced: bool) -> io::Result<Demo> {
    let config = LineConfig {
        seed,
        // Each character goes out as soon as it has ended.
        chunks: Chunks::Single,
        trace: if traced { TRACE } else { 0 },
        ..LineConfig::default()
    };
    Demo::new(Instant(0), config).map_err(io::Error::other)
}

/// Hands out what the host hears; gives back when to come again.
fn drain(demo: &mut Demo, pty: &mut Pty, tcp: Option<&Tcp>) -> Instant {
    loop {
        match demo.poll() {
            Output::Heard { bytes, .. } => {
                pty.send(bytes);
                if let Some(tcp) = tcp {
                    tcp.send(bytes);
                }
            }
            Output::Effect { .. } => {}
            Output::Wait(at) => return at.unwrap_or(Instant(u64::MAX)),
        }
    }
}
