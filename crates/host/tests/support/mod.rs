//! Modules simulated by a thread, over a pseudo-terminal or a connection.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use railbus_device::{Eeprom, Engine, Input, Options, Output, Setup};
use railbus_host::{Config, Family, LineName, LineOptions, Module, Plan, Protocol};
use railbus_wire::{Address, Instant, Micros, SerialSettings};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// How long a test waits for something that must come.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// Waits for something that must come, with a timeout.
pub async fn soon<T>(work: impl Future<Output = T>) -> T {
    let end = tokio::time::timeout(PATIENCE, work).await;
    end.expect("it did not come")
}

/// A pseudo-terminal: our end, and the path of the other.
pub fn pty() -> (OwnedFd, PathBuf) {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let master = openpt(flags).expect("a pseudo-terminal");
    grantpt(&master).expect("granted");
    unlockpt(&master).expect("unlocked");
    let path = ptsname(&master, Vec::new()).expect("a path");
    let path = Path::new(std::ffi::OsStr::from_bytes(path.to_bytes())).to_owned();
    (master, path)
}

/// A path of our own for symbolic links.
pub fn temporary(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("railbus-{}-{name}", std::process::id()));
    let _ = std::fs::remove_file(&path);
    path
}

/// A module as it leaves the factory, but for its address and protocol.
pub fn setup(family: Family, address: u8, protocol: Protocol) -> Setup {
    Setup {
        protocol,
        ..Setup::new(family, Address(address))
    }
}

/// A module that is addressed only when a test wants it.
pub fn module(setup: &Setup) -> Module {
    Module::new(*setup).expect("a possible module")
}

/// A line with these modules.
pub fn config(name: LineName, setups: &[Setup], plan: Plan) -> LineOptions {
    let mut config = LineOptions::new(name);
    config.bus = Config {
        settle: Micros::from_millis(10),
        ..Config::default()
    };
    let add = |config: LineOptions, setup| config.with(module(setup), plan);
    setups.iter().fold(config, add)
}

/// Modules simulated by a thread until this is dropped or stopped.
pub struct Player {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Vec<Engine>>>,
}

impl Player {
    /// Simulates modules at our end of a pseudo-terminal or connection. With `paced` each byte
    /// takes its time, as on a wire.
    pub fn start(wire: OwnedFd, setups: &[Setup], paced: bool) -> Player {
        let stop = Arc::new(AtomicBool::new(false));
        let mut play = Play {
            wire,
            clock: std::time::Instant::now(),
            engines: setups.iter().map(engine).collect(),
            paced,
            stop: Arc::clone(&stop),
        };
        let thread = thread::spawn(move || {
            play.run();
            play.engines
        });
        Player {
            stop,
            thread: Some(thread),
        }
    }

    /// Stops it, closes its end, and returns the modules.
    pub fn stop(mut self) -> Vec<Engine> {
        self.stop.store(true, Ordering::Relaxed);
        let thread = self.thread.take().expect("not stopped before");
        thread.join().expect("the player did not panic")
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn engine(setup: &Setup) -> Engine {
    let options = Options::default();
    Engine::new(setup, Eeprom::of(setup), options, Instant(0)).expect("a possible module")
}

struct Play {
    wire: OwnedFd,
    clock: std::time::Instant,
    engines: Vec<Engine>,
    paced: bool,
    stop: Arc<AtomicBool>,
}

impl Play {
    fn now(&self) -> Instant {
        Instant(self.clock.elapsed().as_micros() as u64)
    }

    fn run(&mut self) {
        let mut buffer = [0; 512];
        while !self.stop.load(Ordering::Relaxed) {
            let deadline = self.drain();
            if !self.wait(deadline) {
                self.tell(Input::Timeout);
                continue;
            }
            match rustix::io::read(&self.wire, &mut buffer) {
                Ok(0) => return,
                Ok(count) => {
                    self.pace(count);
                    self.tell(Input::Bytes(&buffer[..count]));
                }
                // The other end is not open now.
                Err(Errno::IO) => thread::sleep(Duration::from_millis(2)),
                Err(_) => return,
            }
        }
    }

    /// Whether bytes came before the deadline, or before it is time to look around.
    fn wait(&self, deadline: Option<Instant>) -> bool {
        let look_around = Micros::from_millis(20);
        let left = deadline.map_or(look_around, |at| at.since(self.now()).min(look_around));
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: left.0 as i64 * 1000,
        };
        let mut wires = [PollFd::new(&self.wire, PollFlags::IN)];
        poll(&mut wires, Some(&timeout)).is_ok_and(|ready| ready > 0)
    }

    fn tell(&mut self, input: Input<'_>) {
        let now = self.now();
        for engine in &mut self.engines {
            engine.handle(now, input);
        }
    }

    fn drain(&mut self) -> Option<Instant> {
        let mut deadline = None;
        for index in 0..self.engines.len() {
            loop {
                let reply = match self.engines[index].poll() {
                    Output::Transmit(bytes) => bytes.to_vec(),
                    Output::Effect(_) => continue,
                    Output::Wait(at) => {
                        deadline = deadline.into_iter().chain(at).min();
                        break;
                    }
                };
                self.pace(reply.len());
                let _ = rustix::io::write(&self.wire, &reply);
                let now = self.now();
                self.engines[index].handle(now, Input::Sent);
            }
        }
        deadline
    }

    fn pace(&self, bytes: usize) {
        if self.paced {
            thread::sleep(Duration::from_micros(
                SerialSettings::FACTORY.frame_time(bytes).0,
            ));
        }
    }
}
