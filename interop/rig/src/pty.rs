//! The pseudo-terminal that a master opens as its serial port.

use railbus_wire::{Baud, Character, SerialSettings};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::ffi::OsString;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::path::Path;

/// How long a pause inside a single write of the master may be.
const PIECES: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 4_000_000,
};

/// Sent after everything that a master has sent, to know when that has arrived. No master sends
/// this.
const MARK: &[u8] = b"\0railbus: is all of it here?\0";

/// Our end, and the other one kept open so that masters can come and go.
pub struct Pty {
    ours: OwnedFd,
    theirs: OwnedFd,
}

impl Pty {
    /// A raw terminal at 9600 baud, with a symbolic link to it.
    ///
    /// # Errors
    /// Those of the system.
    pub fn open(link: &Path) -> std::io::Result<Pty> {
        let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let path = OsString::from_vec(ptsname(&ours, Vec::new())?.into_bytes());
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let theirs = rustix::fs::open(&path, flags, Mode::empty())?;
        let mut termios = tcgetattr(&theirs)?;
        termios.make_raw();
        termios.set_speed(9600)?;
        tcsetattr(&theirs, OptionalActions::Now, &termios)?;
        rustix::fs::fcntl_setfl(&ours, OFlags::RDWR | OFlags::NONBLOCK)?;
        std::os::unix::fs::symlink(path, link)?;
        Ok(Pty { ours, theirs })
    }

    /// What to wait for.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.ours.as_fd()
    }

    /// What the master sent, and the speed of its port; none if no module can have that speed. A
    /// pseudo-terminal has no parity, so the panel sets it.
    ///
    /// # Errors
    /// Those of the system.
    pub fn read<'a>(
        &self,
        buffer: &'a mut [u8],
        character: Character,
    ) -> std::io::Result<(&'a [u8], Option<SerialSettings>)> {
        let mut count = 0;
        // The kernel delivers a single write in two pieces where one of its buffers ends, and on a
        // busy machine the pause between them would end a Modbus frame.
        while count < buffer.len() {
            match rustix::io::read(&self.ours, &mut buffer[count..]) {
                Ok(more) => count += more,
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
            let mut fds = [PollFd::new(&self.ours, PollFlags::IN)];
            if poll(&mut fds, Some(&PIECES))? == 0 {
                break;
            }
        }
        let rate = tcgetattr(&self.ours)?.output_speed();
        let settings = Baud::from_rate(rate).map(|baud| SerialSettings { baud, character });
        Ok((&buffer[..count], settings))
    }

    /// Everything that the master has sent so far, while it sends nothing more: on a busy machine
    /// it may stay in the kernel for a while. Otherwise like [`Pty::read`].
    ///
    /// # Errors
    /// Those of the system.
    pub fn rest(&self, character: Character) -> std::io::Result<(Vec<u8>, Option<SerialSettings>)> {
        rustix::io::write(&self.theirs, MARK)?;
        let (mut rest, mut buffer) = (Vec::new(), [0; 512]);
        loop {
            poll(&mut [PollFd::new(&self.ours, PollFlags::IN)], None)?;
            let (bytes, settings) = self.read(&mut buffer, character)?;
            rest.extend_from_slice(bytes);
            if let Some(sent) = rest.strip_suffix(MARK) {
                return Ok((sent.to_vec(), settings));
            }
        }
    }

    /// Sends to the master; what it does not fetch is lost, as on a wire.
    pub fn write(&self, bytes: &[u8]) {
        let _ = rustix::io::write(&self.ours, bytes);
    }
}
