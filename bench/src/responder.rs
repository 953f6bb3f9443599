//! The other end of the pseudo-terminal: modules that answer at once, or on a virtual wire whose
//! characters take their time.

use crate::scene::{Scene, Step};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::OwnedFd;
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use rustix::time::Timespec;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

/// Sleeping ends this long before a deadline; the rest is spent spinning.
const SPIN: Duration = Duration::from_micros(200);
/// How long, beyond 3.5 characters, it spins for the next request after a reply.
const SPIN_FOR_REQUEST: Duration = Duration::from_millis(1);
/// No master measured here is silent for this long.
const PATIENCE: Timespec = Timespec {
    tv_sec: 20,
    tv_nsec: 0,
};

/// The modules at this end.
pub trait Modules {
    /// From the end of a request to the reply.
    fn turnaround(&self) -> Duration;
    /// The exchange that begins with these bytes, if they are a whole request.
    fn answer(&mut self, request: &[u8]) -> Option<&Step>;
}

impl Modules for &Scene {
    fn turnaround(&self) -> Duration {
        Duration::from_micros(self.turnaround.0)
    }

    fn answer(&mut self, request: &[u8]) -> Option<&Step> {
        Scene::answer(self, request)
    }
}

/// How a virtual wire behaves.
#[derive(Clone, Copy)]
pub struct Wire {
    /// Its speed, at 10 bits a character.
    pub baud: u32,
    /// A request that comes earlier than 3.5 characters after the last one is not answered.
    pub strict: bool,
    /// It keeps its deadlines by spinning, on whatever core it has; otherwise by sleeping, and
    /// being late makes the wire slower.
    pub spins: bool,
}

/// One request and its outcome.
pub struct Heard {
    /// When the request began.
    pub began: Instant,
    /// When its reply had ended, or the request if there was none.
    pub ended: Instant,
    /// It came earlier than 3.5 characters after the last one.
    pub too_early: bool,
    /// It was answered.
    pub answered: bool,
    /// The silence that its module needs before it.
    pub gap: Duration,
}

/// Our end of a pseudo-terminal in raw mode.
pub struct Pty {
    fd: OwnedFd,
    /// The terminal that a master opens.
    pub path: PathBuf,
}

impl Pty {
    /// Creates one.
    pub fn new() -> Result<Pty, String> {
        let make = || -> rustix::io::Result<Pty> {
            let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
            let fd = openpt(flags)?;
            grantpt(&fd)?;
            unlockpt(&fd)?;
            let mut mode = tcgetattr(&fd)?;
            mode.make_raw();
            tcsetattr(&fd, OptionalActions::Now, &mode)?;
            rustix::io::ioctl_fionbio(&fd, true)?;
            let path = ptsname(&fd, Vec::new())?;
            Ok(Pty {
                fd,
                path: PathBuf::from(path.to_string_lossy().into_owned()),
            })
        };
        make().map_err(|why| format!("no pseudo-terminal: {why}"))
    }

    /// Answers until the master closes its end; returns the requests.
    pub fn serve(
        &self,
        mut modules: impl Modules,
        wire: Option<Wire>,
    ) -> Result<Vec<Heard>, String> {
        let turnaround = modules.turnaround();
        let mut record: Vec<Heard> = Vec::with_capacity(100_000);
        let mut request = Vec::with_capacity(300);
        let mut began = Instant::now();
        let mut buffer = [0; 300];
        loop {
            let spin_until = match (wire, record.last()) {
                (Some(wire), Some(last)) if wire.spins => {
                    Some(last.ended + wire.silence() + SPIN_FOR_REQUEST)
                }
                _ => None,
            };
            let Some(count) = self.read(&mut buffer, spin_until)? else {
                return Ok(record);
            };
            if request.is_empty() {
                began = Instant::now();
            }
            request.extend_from_slice(&buffer[..count]);
            let Some(step) = modules.answer(&request) else {
                continue;
            };
            let mut heard = Heard {
                began,
                ended: began,
                too_early: false,
                answered: true,
                gap: Duration::from_micros(step.gap.0),
            };
            match wire {
                None => self.write(&step.reply)?,
                Some(wire) => {
                    heard.too_early = record
                        .last()
                        .is_some_and(|last| began < last.ended + wire.silence());
                    heard.ended = began.max(record.last().map_or(began, |last| last.ended))
                        + wire.character() * step.request.len() as u32;
                    heard.answered = !(wire.strict && heard.too_early);
                    if heard.answered {
                        heard.ended += turnaround;
                        for byte in &step.reply {
                            heard.ended += wire.character();
                            // A responder that was held up is a slower wire.
                            heard.ended = heard.ended.max(wait_until(heard.ended, wire.spins));
                            self.write(std::slice::from_ref(byte))?;
                        }
                    }
                }
            }
            record.push(heard);
            request.clear();
        }
    }

    /// The next bytes; none when the master has closed its end.
    fn read(
        &self,
        buffer: &mut [u8],
        spin_until: Option<Instant>,
    ) -> Result<Option<usize>, String> {
        loop {
            match rustix::io::read(&self.fd, &mut *buffer) {
                Ok(count) => return Ok(Some(count)),
                Err(Errno::IO) => return Ok(None),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) if spin_until.is_some_and(|until| Instant::now() < until) => {
                    std::hint::spin_loop();
                }
                Err(Errno::AGAIN) => {
                    let mut wanted = [PollFd::new(&self.fd, PollFlags::IN)];
                    if poll(&mut wanted, Some(&PATIENCE)).is_ok_and(|ready| ready == 0) {
                        return Err("the master says nothing any more".to_owned());
                    }
                }
                Err(why) => return Err(format!("the pseudo-terminal cannot be read: {why}")),
            }
        }
    }

    /// Writes these bytes; it is not an error if the other end is closed.
    pub fn write(&self, bytes: &[u8]) -> Result<(), String> {
        match rustix::io::write(&self.fd, bytes) {
            // The master may have closed its end already.
            Ok(_) | Err(Errno::IO) => Ok(()),
            Err(why) => Err(format!("the pseudo-terminal takes nothing: {why}")),
        }
    }
}

impl Wire {
    /// The time of a character.
    pub fn character(self) -> Duration {
        Duration::from_secs(10) / self.baud
    }

    /// The time of 3.5 characters.
    pub fn silence(self) -> Duration {
        Duration::from_secs(35) / self.baud
    }
}

/// Waits for a moment; the time then.
fn wait_until(at: Instant, spins: bool) -> Instant {
    loop {
        let now = Instant::now();
        match at.checked_duration_since(now) {
            None => return now,
            Some(left) if !spins => thread::sleep(left),
            Some(left) if left > SPIN * 2 => thread::sleep(left - SPIN),
            Some(_) => std::hint::spin_loop(),
        }
    }
}
