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
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The kernel may deliver in two pieces what was written at once. QEMU paces no characters, so a
/// pause between the pieces would be inside the frame, and end it.
const PIECES: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 2_000_000,
};

/// Sent after everything a master has sent, to know when the line has carried that. No master sends
/// this.
const MARK: &[u8] = b"\0railbus: is all of it heard?\0";

/// How long the mark may take, however busy the machine is.
const PATIENCE: Duration = Duration::from_secs(40);

/// Our end; the other end is kept open so that masters may come and go.
#[derive(Debug)]
pub struct Pty {
    ours: File,
    theirs: File,
    link: PathBuf,
    waiting: Waiting,
    heard: Arc<AtomicUsize>,
}

/// The waiter for the mark.
type Waiting = Arc<Mutex<Option<Sender<()>>>>;

impl Pty {
    /// A raw terminal at 9600 baud, with a symbolic link to it, which is removed with this.
    ///
    /// # Errors
    /// Those of the system, and if the link's path already exists.
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
            waiting: Waiting::default(),
            heard: Arc::default(),
        })
    }

    /// Joins the master to a line.
    ///
    /// # Errors
    /// Those of the system.
    pub fn join(&self, hub: &Hub) -> io::Result<()> {
        let port = self.theirs.try_clone()?;
        let speed = move |_| tcgetattr(&port).ok().map(|termios| termios.output_speed());
        hub.join(
            Sent {
                file: self.ours.try_clone()?,
                waiting: Arc::clone(&self.waiting),
                carried: None,
            },
            Heard {
                file: self.ours.try_clone()?,
                bytes: Arc::clone(&self.heard),
            },
            speed,
        );
        Ok(())
    }

    /// Waits until the line has carried everything the master has sent, which must send nothing
    /// meanwhile: on a busy machine it may stay in the kernel for a while.
    ///
    /// # Errors
    /// If that does not happen, or those of the system.
    pub fn settle(&self) -> io::Result<()> {
        let (tell, carried) = channel();
        *self.waiting.lock().unwrap_or_else(PoisonError::into_inner) = Some(tell);
        (&self.theirs).write_all(MARK)?;
        wait(&carried)
    }

    /// How many bytes were sent to the master so far.
    #[must_use]
    pub fn heard(&self) -> usize {
        self.heard.load(Ordering::SeqCst)
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.link);
    }
}

fn wait(carried: &Receiver<()>) -> io::Result<()> {
    let why = "the line does not carry what was sent";
    carried
        .recv_timeout(PATIENCE)
        .map_err(|_| io::Error::new(io::ErrorKind::TimedOut, why))
}

/// What the master sends, a whole burst at a time.
struct Sent {
    file: File,
    waiting: Waiting,
    /// Notified when everything is carried and the line asks for more.
    carried: Option<Sender<()>>,
}

impl Sent {
    fn burst(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut count = self.file.read(buffer)?;
        while count < buffer.len() {
            let mut fds = [PollFd::new(&self.file, PollFlags::IN)];
            if poll(&mut fds, Some(&PIECES))? == 0 || fds[0].revents() != PollFlags::IN {
                break;
            }
            count += self.file.read(&mut buffer[count..])?;
        }
        Ok(count)
    }
}

impl Read for Sent {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            if let Some(carried) = self.carried.take() {
                // The waiting call may have given up.
                let _ = carried.send(());
            }
            let count = self.burst(buffer)?;
            let Some(before) = buffer[..count].strip_suffix(MARK) else {
                return Ok(count);
            };
            let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            self.carried = waiting.take();
            if !before.is_empty() {
                return Ok(before.len());
            }
        }
    }
}

/// The bytes for the master. Those it does not read are lost, as on a wire.
struct Heard {
    file: File,
    bytes: Arc<AtomicUsize>,
}

impl Write for Heard {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.bytes.fetch_add(bytes.len(), Ordering::SeqCst);
        let mut fds = [PollFd::new(&self.file, PollFlags::OUT)];
        if poll(&mut fds, Some(&Timespec::default()))? == 0 {
            return Ok(bytes.len());
        }
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Pty;
    use crate::{Folder, Hub};
    use std::io::{Read, Write};
    use std::os::unix::net::UnixStream;

    #[test]
    fn all_that_was_sent_is_carried_when_the_line_has_settled() {
        let (folder, hub) = (Folder::new().expect("a folder"), Hub::new());
        let pty = Pty::open(&folder.path().join("line")).expect("a terminal");
        pty.join(&hub).expect("it joins");
        let (mut ours, theirs) = UnixStream::pair().expect("a pair");
        hub.join(theirs.try_clone().expect("a second handle"), theirs, |_| {
            Some(9600)
        });
        ours.set_nonblocking(true).expect("a socket");
        let mut heard = [0; 64];
        for sent in [&b"$016\r"[..], b"", b"$026\r"] {
            (&pty.theirs).write_all(sent).expect("there is room");
            pty.settle().expect("it is carried");
            let count = ours.read(&mut heard).unwrap_or(0);
            assert_eq!(&heard[..count], sent);
        }
        assert_eq!(pty.heard(), 0);
    }
}
