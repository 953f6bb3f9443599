//! The pseudo terminal that a master opens as its serial port.

use crate::Hub;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

/// The kernel may hand over what was written at once in two pieces. QEMU paces no characters, so
/// that a pause between them would be one inside the frame, and end it.
const PIECES: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 2_000_000,
};

/// Our end, and the other one kept open so that masters may come and go.
#[derive(Debug)]
pub struct Pty {
    ours: File,
    theirs: File,
    link: PathBuf,
}

impl Pty {
    /// A raw terminal at 9600 baud, with a symbolic link to it, which goes when this does.
    ///
    /// # Errors
    /// What the system says; also where something lies at the link's place already.
    pub fn open(link: &Path) -> io::Result<Pty> {
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
        std::os::unix::fs::symlink(path, link)?;
        Ok(Pty {
            ours: File::from(ours),
            theirs: File::from(theirs),
            link: link.to_owned(),
        })
    }

    /// The master becomes a member of this line.
    ///
    /// # Errors
    /// What the system says.
    pub fn join(&self, hub: &Hub) -> io::Result<()> {
        let port = self.theirs.try_clone()?;
        let speed = move |_| tcgetattr(&port).ok().map(|termios| termios.output_speed());
        hub.join(
            Sent(self.ours.try_clone()?),
            Heard(self.ours.try_clone()?),
            speed,
        );
        Ok(())
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.link);
    }
}

/// What the master sends, a whole burst at a time.
struct Sent(File);

impl Read for Sent {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut count = self.0.read(buffer)?;
        while count < buffer.len() {
            let mut fds = [PollFd::new(&self.0, PollFlags::IN)];
            if poll(&mut fds, Some(&PIECES))? == 0 || fds[0].revents() != PollFlags::IN {
                break;
            }
            count += self.0.read(&mut buffer[count..])?;
        }
        Ok(count)
    }
}

/// What the master is to hear. What it does not fetch is lost, as on a wire.
struct Heard(File);

impl Write for Heard {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut fds = [PollFd::new(&self.0, PollFlags::OUT)];
        if poll(&mut fds, Some(&Timespec::default()))? == 0 {
            return Ok(bytes.len());
        }
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
