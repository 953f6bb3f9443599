//! A PTY that looks like a serial port: any master can open it through a link.

use railbus_app::failure::Failure;
use railbus_app::texts::AppText;
use railbus_wire::{Baud, Character, SerialSettings};
use railbus_words::Code;
use railbus_words::Lang;
use rustix::fs::inotify;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush, tcgetattr, tcsetattr,
};
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

/// The folder of PTY slaves.
const SLAVES: &str = "/dev/pts";

/// Why there is no PTY.
#[derive(Debug)]
pub(super) enum OpenError {
    /// The system does not provide one.
    Pty(io::Error),
    /// The path of the link is taken by something else.
    Foreign,
    /// The link can't be made.
    Link(io::Error),
}

impl OpenError {
    pub(super) fn into_failure(self, lang: Lang, path: &Path, elsewhere: &str) -> Failure {
        let path = path.display();
        match self {
            OpenError::Pty(error) => {
                Failure::new(Code::Pty, lang.get(AppText::NoPty).to_owned()).because(error)
            }
            OpenError::Foreign => {
                let message = lang.fill(AppText::ForeignPath, &[("path", &path)]);
                Failure::new(Code::ForeignPath, message).with_try(elsewhere)
            }
            OpenError::Link(error) => {
                let message = lang.fill(AppText::NoLink, &[("path", &path)]);
                Failure::new(Code::Link, message)
                    .because(error)
                    .with_try(elsewhere)
            }
        }
    }
}

/// The PTY and the link to it.
pub(super) struct Pty {
    master: AsyncFd<OwnedFd>,
    /// Kept open so that the master survives when a client closes its end.
    slave: OwnedFd,
    /// Reports when clients open and close the slave.
    watch: AsyncFd<OwnedFd>,
    clients: usize,
    link: Link,
}

impl Pty {
    /// Creates a PTY and the link to it.
    pub(super) fn open(path: &Path) -> Result<Pty, OpenError> {
        let (master, slave, name) = pair().map_err(no_pty)?;
        let watch = watch(&name).map_err(no_pty)?;
        Ok(Pty {
            master: readable(master).map_err(no_pty)?,
            slave,
            watch: readable(watch).map_err(no_pty)?,
            clients: 0,
            link: Link::make(path, name)?,
        })
    }

    /// The path of the link.
    pub(super) fn path(&self) -> &Path {
        &self.link.path
    }

    /// Waits for data from a client: the number of bytes, and its port settings.
    pub(super) async fn event(&mut self, buffer: &mut [u8]) -> io::Result<(usize, SerialSettings)> {
        loop {
            tokio::select! {
                biased;
                ready = self.watch.readable() => {
                    ready?.clear_ready();
                    self.count_clients();
                }
                ready = self.master.readable() => {
                    let read = ready?.try_io(|master| Ok(rustix::io::read(master, &mut *buffer)?));
                    if let Ok(count) = read {
                        return Ok((count?, self.settings()?));
                    }
                }
            }
        }
    }

    /// Sends to the client, if there is one. What does not fit is lost, as with any serial port
    /// that is not read.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        // The client may have come just now.
        self.count_clients();
        if self.clients > 0 {
            let _ = rustix::io::write(self.master.get_ref(), bytes);
        }
    }

    /// Handles clients that have connected and disconnected. A new one finds no old data in its
    /// port.
    fn count_clients(&mut self) {
        let mut buffer = [MaybeUninit::uninit(); 1_024];
        let mut events = inotify::Reader::new(self.watch.get_ref(), &mut buffer);
        while let Ok(event) = events.next() {
            if event.events().contains(inotify::ReadFlags::OPEN) {
                if self.clients == 0 {
                    let _ = tcflush(&self.slave, QueueSelector::IFlush);
                }
                self.clients += 1;
            } else {
                self.clients = self.clients.saturating_sub(1);
                if self.clients == 0 {
                    // A killed client leaves the port in exclusive mode; a real port is released
                    // once no process has it open.
                    let _ = ioctl_tiocnxcl(&self.slave);
                }
            }
        }
    }

    /// The speed set by the client; its input speed may still be that of the client before. A PTY
    /// has no parity, so that is the line's own.
    fn settings(&self) -> io::Result<SerialSettings> {
        let rate = tcgetattr(&self.slave)?.output_speed();
        Ok(SerialSettings {
            // An unsupported speed is as wrong as the highest one, which hardly any module
            // supports.
            baud: Baud::from_rate(rate).unwrap_or(Baud::B115200),
            character: Character::N1,
        })
    }
}

#[expect(
    deprecated,
    reason = "the successor is unsafe, and asks for what an OwnedFd promises: its file stays open"
)]
fn readable(fd: OwnedFd) -> io::Result<AsyncFd<OwnedFd>> {
    AsyncFd::with_interest(fd, Interest::READABLE)
}

fn no_pty(error: impl Into<io::Error>) -> OpenError {
    OpenError::Pty(error.into())
}

/// A non-blocking master, its slave, raw and at 9600, and the slave's name.
fn pair() -> rustix::io::Result<(OwnedFd, OwnedFd, PathBuf)> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    rustix::io::ioctl_fionbio(&master, true)?;
    let name = ptsname(&master, Vec::new())?;
    let name = PathBuf::from(name.to_string_lossy().into_owned());
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let slave = rustix::fs::open(&name, flags, Mode::empty())?;
    let mut settings = tcgetattr(&slave)?;
    settings.make_raw();
    settings.set_speed(9_600)?;
    tcsetattr(&slave, OptionalActions::Now, &settings)?;
    Ok((master, slave, name))
}

fn watch(slave: &Path) -> Result<OwnedFd, Errno> {
    use inotify::{CreateFlags, WatchFlags};
    let watch = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
    let both = WatchFlags::OPEN | WatchFlags::CLOSE;
    inotify::add_watch(&watch, slave, both)?;
    Ok(watch)
}

/// A link to the slave, which is removed when the program ends.
struct Link {
    path: PathBuf,
    slave: PathBuf,
}

impl Link {
    fn make(path: &Path, slave: PathBuf) -> Result<Link, OpenError> {
        match std::fs::symlink_metadata(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(OpenError::Link(error)),
            Ok(_) if is_ours(path) => std::fs::remove_file(path).map_err(OpenError::Link)?,
            Ok(_) => return Err(OpenError::Foreign),
        }
        std::os::unix::fs::symlink(&slave, path).map_err(OpenError::Link)?;
        Ok(Link {
            path: path.to_owned(),
            slave,
        })
    }
}

/// Whether this is a link left behind by a simulator.
fn is_ours(path: &Path) -> bool {
    std::fs::read_link(path).is_ok_and(|target| target.starts_with(SLAVES))
}

impl Drop for Link {
    /// Another simulator may have put its own link here meanwhile.
    fn drop(&mut self) {
        if std::fs::read_link(&self.path).is_ok_and(|target| target == self.slave) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}
