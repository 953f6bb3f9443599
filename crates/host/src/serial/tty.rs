//! An open terminal with exclusive access, which is restored when it is closed.

use super::{Granted, Rs485, SerialOptions, access, holder, mark, mode, rest};
use crate::{PortError, ioctl};
use railbus_bus::PortHistory;
use railbus_wire::SerialSettings;
use rustix::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use rustix::fs::{FlockOperation, Mode, OFlags, flock};
use rustix::io::Errno;
use rustix::termios::{
    OptionalActions, QueueSelector, Termios, ioctl_tiocexcl, ioctl_tiocnxcl, isatty, tcflush,
    tcgetattr, tcsetattr,
};
use std::fs::{File, Metadata};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::task::{Context, Poll, ready};
use std::time::{Instant, SystemTime};
use tokio::io::unix::AsyncFd;

/// The major device numbers of pseudo-terminals.
const PTS_MAJORS: std::ops::RangeInclusive<u32> = 136..=143;

/// A terminal, locked and in raw mode.
#[derive(Debug)]
pub(crate) struct Tty {
    fd: Locked,
    /// The modes it had.
    before: Termios,
    /// How the driver switched the transceiver before, if that was changed.
    rs485_before: Option<ioctl::SerialRs485>,
    /// The modes it has now.
    mode: Termios,
    settings: SerialSettings,
    pts: bool,
    granted: Granted,
    past: PortHistory,
    opened: Instant,
    /// When a request was last sent that may get a reply.
    sent: Option<Instant>,
    /// Nothing can be sent: its previous state is not ours to change.
    listens_only: bool,
}

impl Tty {
    /// Opens, locks and sets up the terminal at a path. Nothing is changed before exclusive
    /// access is certain. May block, and still needs the runtime.
    pub(crate) fn open(path: &Path, options: SerialOptions) -> Result<Tty, PortError> {
        let access = match options.listen_only {
            true => OFlags::RDONLY,
            false => OFlags::RDWR,
        };
        let flags = access | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|e| refused(path, e))?;
        if !isatty(&fd) {
            return Err(PortError::NotATty);
        }
        let file = File::from(fd);
        let about = file.metadata().map_err(|e| PortError::of_loss(&e))?;
        let fd = OwnedFd::from(file);
        let pts = PTS_MAJORS.contains(&rustix::fs::major(about.rdev()));
        let fd = Locked::lock(fd, &about, pts)?;
        let before = tcgetattr(&fd)?;
        let past = if rest::is_rested(SystemTime::now(), about.mtime()) {
            PortHistory::Rested
        } else if mark::is_on(&before) {
            PortHistory::Abandoned
        } else {
            PortHistory::Unknown
        };
        let mut mode = before.clone();
        if !options.listen_only {
            mark::put(&mut mode);
        }
        let mut tty = Tty {
            mode,
            before,
            rs485_before: None,
            settings: options.settings,
            past,
            opened: Instant::now(),
            sent: None,
            listens_only: options.listen_only,
            pts,
            granted: Granted {
                low_latency: false,
                rs485: false,
            },
            fd,
        };
        if options.listen_only {
            // Opening has raised it. A port without RTS refuses; that is fine.
            let _ = ioctl::lower_rts(&tty.fd);
        }
        tty.set(options.settings)?;
        tty.ask_driver(options);
        // Bytes from before are not replies to us.
        tcflush(&tty.fd, QueueSelector::IOFlush)?;
        Ok(tty)
    }

    pub(crate) const fn settings(&self) -> SerialSettings {
        self.settings
    }

    pub(crate) const fn granted(&self) -> Granted {
        self.granted
    }

    /// Whether this is a pseudo-terminal.
    pub(crate) const fn is_pts(&self) -> bool {
        self.pts
    }

    /// What is known of earlier users.
    pub(crate) const fn past(&self) -> PortHistory {
        self.past
    }

    /// No reply can come any more to what was sent.
    pub(crate) const fn settle(&mut self) {
        self.sent = None;
    }

    /// Whether a reply may still come, to us or to the previous user.
    fn is_haunted(&self) -> bool {
        let lately = |since: Instant| since.elapsed() < rest::REST;
        self.sent.is_some_and(lately) || self.past == PortHistory::Abandoned && lately(self.opened)
    }

    /// Reads the next bytes. A terminal that was hung up is at end of file.
    pub(crate) fn poll_read(
        &self,
        cx: &mut Context<'_>,
        buffer: &mut [u8],
    ) -> Poll<io::Result<usize>> {
        loop {
            let mut ready = ready!(self.fd.0.poll_read_ready(cx))?;
            match rustix::io::read(&self.fd, &mut *buffer) {
                Ok(0) => return Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into())),
                Ok(count) => {
                    if count < buffer.len() {
                        // It is empty. New bytes make it ready again.
                        ready.clear_ready();
                    }
                    return Poll::Ready(Ok(count));
                }
                Err(Errno::AGAIN) => ready.clear_ready(),
                Err(Errno::INTR) => {}
                Err(errno) => return Poll::Ready(Err(errno.into())),
            }
        }
    }

    /// Passes a frame to the driver. If it is not taken whole it is withdrawn: the rest would be
    /// sent at an unknown time, when modules may be doing something else.
    pub(crate) fn send(&mut self, bytes: &[u8], settings: SerialSettings) -> io::Result<()> {
        if settings != self.settings {
            self.set(settings)?;
        }
        self.sent = Some(Instant::now());
        let end = match rustix::io::retry_on_intr(|| rustix::io::write(&self.fd, bytes)) {
            Ok(written) if written == bytes.len() => return Ok(()),
            Ok(_) => io::ErrorKind::WriteZero.into(),
            Err(errno) => io::Error::from(errno),
        };
        let _ = tcflush(&self.fd, QueueSelector::OFlush);
        Err(end)
    }

    /// Changes speed and format at once, without waiting for output to drain, which may take for
    /// ever: the line has already waited for the last frame to be sent.
    fn set(&mut self, settings: SerialSettings) -> rustix::io::Result<()> {
        mode::set(&mut self.mode, settings, self.pts)?;
        tcsetattr(&self.fd, OptionalActions::Now, &self.mode)?;
        self.settings = settings;
        Ok(())
    }

    /// Options that help, but that not every driver supports.
    fn ask_driver(&mut self, options: SerialOptions) {
        if options.low_latency {
            self.granted.low_latency = ioctl::set_low_latency(&self.fd).unwrap_or(false);
        }
        if let Some(rs485) = options.rs485 {
            let before = ioctl::rs485(&self.fd).ok();
            self.granted.rs485 = ioctl::set_rs485(&self.fd, request(rs485)).is_ok();
            self.rs485_before = before.filter(|_| self.granted.rs485);
        }
    }
}

impl Drop for Tty {
    /// Lowers RTS, so that the line is not driven, and restores everything except low latency,
    /// which does no harm and whose change stalls some adapters. It must not wait, so unsent output
    /// is dropped. All of this fails on a port that is gone, which is fine.
    fn drop(&mut self) {
        let _ = tcflush(&self.fd, QueueSelector::IOFlush);
        let _ = ioctl::lower_rts(&self.fd);
        if !self.listens_only {
            match self.is_haunted() {
                true => mark::put(&mut self.before),
                false => mark::take(&mut self.before),
            }
        }
        let _ = tcsetattr(&self.fd, OptionalActions::Now, &self.before);
        if let Some(before) = self.rs485_before {
            let _ = ioctl::set_rs485(&self.fd, before);
        }
    }
}

/// A terminal with exclusive access. Both locks are needed: `flock` keeps out programs that check
/// it, even as root; TIOCEXCL keeps out those that do not check, but not root.
#[derive(Debug)]
struct Locked(AsyncFd<OwnedFd>);

impl Locked {
    fn lock(fd: OwnedFd, about: &Metadata, pts: bool) -> Result<Locked, PortError> {
        let own = Some(fd.as_raw_fd());
        match flock(&fd, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::AGAIN) => {
                let holder = holder::find(about, own);
                return Err(PortError::Busy { holder });
            }
            Err(errno) => return Err(errno.into()),
        }
        if ioctl::is_exclusive(&fd)? {
            // A pseudo-terminal stays exclusive after the program that had it was killed.
            let holder = match pts {
                true => holder::find_rival(about, own),
                false => holder::find(about, own),
            };
            if holder.is_some() || !pts {
                return Err(PortError::Busy { holder });
            }
        }
        let fd = ioctl::watch(fd).map_err(|error| PortError::of_loss(&error))?;
        ioctl_tiocexcl(&fd)?;
        Ok(Locked(fd))
    }
}

impl Drop for Locked {
    fn drop(&mut self) {
        let _ = ioctl_tiocnxcl(&self.0);
        let _ = flock(&self.0, FlockOperation::Unlock);
    }
}

impl AsFd for Locked {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Why a terminal could not be opened.
fn refused(path: &Path, errno: Errno) -> PortError {
    match errno {
        // A pseudo-terminal whose other end is closed gives IO, a driver without its device one of
        // the others.
        Errno::NOENT | Errno::NOTDIR | Errno::LOOP => PortError::Missing,
        Errno::NXIO | Errno::NODEV | Errno::IO => PortError::Missing,
        Errno::ACCESS | Errno::PERM => PortError::Permission(access::of(path)),
        Errno::ISDIR => PortError::NotATty,
        Errno::BUSY => {
            let about = std::fs::metadata(path).ok();
            let holder = about.and_then(|about| holder::find(&about, None));
            PortError::Busy { holder }
        }
        other => other.into(),
    }
}

/// The options in the kernel's form.
fn request(rs485: Rs485) -> ioctl::SerialRs485 {
    let bits = [
        (true, ioctl::RS485_ENABLED),
        (rs485.rts_high_on_send, ioctl::RS485_RTS_ON_SEND),
        (!rs485.rts_high_on_send, ioctl::RS485_RTS_AFTER_SEND),
        (rs485.listen_on_send, ioctl::RS485_RX_DURING_TX),
        (rs485.terminate, ioctl::RS485_TERMINATE_BUS),
    ];
    let flags = bits.into_iter().filter(|(wanted, _)| *wanted);
    let millis = |time: std::time::Duration| u32::try_from(time.as_millis()).unwrap_or(u32::MAX);
    ioctl::SerialRs485 {
        flags: flags.fold(0, |flags, (_, bit)| flags | bit),
        delay_rts_before_send: millis(rs485.delay_before_send),
        delay_rts_after_send: millis(rs485.delay_after_send),
        ..ioctl::SerialRs485::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn refusals_are_told_by_what_they_mean() {
        let null = Path::new("/dev/null");
        assert_eq!(refused(null, Errno::NOENT), PortError::Missing);
        assert_eq!(refused(null, Errno::IO), PortError::Missing);
        assert_eq!(refused(null, Errno::NODEV), PortError::Missing);
        assert_eq!(refused(null, Errno::ISDIR), PortError::NotATty);
        assert_eq!(refused(null, Errno::NOMEM), PortError::Io(12));
        match refused(null, Errno::ACCESS) {
            PortError::Permission(access) => assert_eq!(access.mode, 0o666),
            other => panic!("{other:?}"),
        }
        assert!(matches!(refused(null, Errno::BUSY), PortError::Busy { .. }));
    }

    #[test]
    fn what_is_no_terminal_is_refused() {
        let open = |path: &str| Tty::open(Path::new(path), SerialOptions::default()).err();
        assert_eq!(open("/dev/null"), Some(PortError::NotATty));
        assert_eq!(open("/dev"), Some(PortError::NotATty));
        assert_eq!(open("/dev/none such"), Some(PortError::Missing));
    }

    #[test]
    fn rs485_is_asked_for_in_the_kernels_words() {
        let asked = request(Rs485::default());
        assert_eq!(asked.flags, 0b000_0011);
        let asked = request(Rs485 {
            rts_high_on_send: false,
            listen_on_send: true,
            terminate: true,
            delay_before_send: Duration::from_millis(3),
            delay_after_send: Duration::from_millis(1),
        });
        assert_eq!(asked.flags, 0b011_0101);
        assert_eq!(asked.delay_rts_before_send, 3);
        assert_eq!(asked.delay_rts_after_send, 1);
    }
}
