//! A module that sends false replies, on its own pseudo-terminal.

use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

/// A pseudo-terminal, the side that others open, held open, and where that is.
fn terminal() -> (File, OwnedFd, String) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
    grantpt(&master).expect("it is ours");
    unlockpt(&master).expect("it is ours");
    let path = ptsname(&master, Vec::new()).expect("it has a name");
    let path = path.into_string().expect("text");
    // Without a slave that stays open, reading would end when the program closes its own.
    let slave = open(&path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).expect("it opens");
    let mut mode = tcgetattr(&slave).expect("it is a terminal");
    mode.make_raw();
    tcsetattr(&slave, OptionalActions::Now, &mode).expect("it is a terminal");
    (File::from(master), slave, path)
}

/// Answers each request of eight bytes as `answer` says, for as long as the test runs; returns
/// where it can be reached.
pub(crate) fn liar(answer: impl Fn(&[u8; 8]) -> Vec<u8> + Send + 'static) -> String {
    let (mut line, slave, path) = terminal();
    std::thread::spawn(move || {
        let _open = slave;
        let mut request = [0; 8];
        while line.read_exact(&mut request).is_ok() {
            if line.write_all(&answer(&request)).is_err() {
                return;
            }
        }
    });
    path
}

/// What a slave sends for a request, and how long after it each piece of it comes.
pub(crate) type Replies = Vec<(Duration, Vec<u8>)>;

/// Answers each request of eight bytes as `script` says, which gets the number of the request, from
/// 0. Replies come when they are due, whatever was requested meanwhile.
pub(crate) fn slave(script: impl Fn(usize, &[u8; 8]) -> Replies + Send + 'static) -> String {
    let (mut line, slave, path) = terminal();
    // The next program to open it must not find it in use by this test.
    drop(slave);
    std::thread::spawn(move || {
        let mut request = [0; 8];
        for number in 0.. {
            // The other end is not open yet.
            while line.read_exact(&mut request).is_err() {
                std::thread::sleep(Duration::from_millis(1));
            }
            let heard = Instant::now();
            for (after, bytes) in script(number, &request) {
                let mut line = line.try_clone().expect("a descriptor");
                std::thread::spawn(move || {
                    std::thread::sleep(after.saturating_sub(heard.elapsed()));
                    let _ = line.write_all(&bytes);
                });
            }
        }
    });
    path
}

/// Sends the same again and again, whether or not it is open, and receives nothing.
pub(crate) fn talker(bytes: &'static [u8], every: Duration) -> String {
    let (mut line, slave, path) = terminal();
    std::thread::spawn(move || {
        let _open = slave;
        while line.write_all(bytes).is_ok() {
            std::thread::sleep(every);
        }
    });
    path
}
