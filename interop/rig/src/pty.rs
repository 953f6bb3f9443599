//! The pseudo terminal that a master opens as its serial port.

use railbus_wire::{Baud, Character, Settings};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::ffi::OsString;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::path::Path;

/// So long may a pause be inside what the master wrote at once.
const PIECES: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 4_000_000,
};

/// What is sent behind all that a master has sent, to know when that is here. No master sends this.
const MARK: &[u8] = b"\0railbus: is all of it here?\0";

/// Our end, and the other one kept open so that masters may come and go.
pub struct Pty {
    ours: OwnedFd,
    theirs: OwnedFd,
}

impl Pty {
    /// A raw terminal at 9600 baud, with a symbolic link to it.
    ///
    /// # Errors
    /// What the system says.
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

    /// What the master sent, and at which speed its port is set; nothing where none of our
    /// modules can have that speed. A pseudo terminal has no parity, so the panel says it.
    ///
    /// # Errors
    /// What the system says.
    pub fn read<'a>(
        &self,
        buffer: &'a mut [u8],
        character: Character,
    ) -> std::io::Result<(&'a [u8], Option<Settings>)> {
        let mut count = 0;
        // The kernel hands over what was written at once in two pieces where one of its buffers
        // ends, and a busy machine makes a pause between them that would end a Modbus frame.
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
        let settings = Baud::from_rate(rate).map(|baud| Settings { baud, character });
        Ok((&buffer[..count], settings))
    }

    /// All that the master has sent so far, who sends nothing meanwhile: on a busy machine it may
    /// lie for a while in the kernel. Else as [`Pty::read`].
    ///
    /// # Errors
    /// What the system says.
    pub fn rest(&self, character: Character) -> std::io::Result<(Vec<u8>, Option<Settings>)> {
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

    /// Gives the master what it hears; what it does not fetch is lost, as on a wire.
    pub fn write(&self, bytes: &[u8]) {
        let _ = rustix::io::write(&self.ours, bytes);
    }
}
