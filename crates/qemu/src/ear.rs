//! What a board hears through.

use crate::qmp::Qmp;
use crate::taken::is_taken;
use std::io::{self, Write};
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// So many characters have room in QEMU's multiplexer and its UART.
const ROOM: usize = 32;

/// So long QEMU gets to take more where others lie there still that the board does not take: what
/// finds no room comes when there is some.
const WITHOUT_ROOM: Duration = Duration::from_millis(500);

/// So long QEMU and the board may take for them else. They take under a millisecond unless the
/// machine is very busy.
const PATIENCE: Duration = Duration::from_secs(30);

/// It is looked again after so long.
const LOOK_AGAIN: Duration = Duration::from_micros(200);

/// The state of the line's UART, and the bit that says that a character lies there.
const STATE: u32 = 0x4000_4004;
const IS_FULL_IN: u32 = 1 << 1;

/// What is written at once comes to the board as one burst, without a pause: QEMU takes it while
/// the board's processor, and with it the board's clock, stands still. Without that a busy machine
/// holds QEMU up between two characters while the clock goes on; and a pause ends a Modbus frame.
///
/// A burst that is longer than QEMU has room for comes in pieces. By the board's clock the first
/// takes the time of its characters, and the next one is there before they are over.
#[derive(Debug)]
pub struct Ear {
    qmp: Arc<Mutex<Qmp>>,
    line: UnixStream,
    patience: Duration,
}

impl Ear {
    pub(crate) fn new(qmp: Arc<Mutex<Qmp>>, line: UnixStream) -> Ear {
        Ear {
            qmp,
            line,
            patience: PATIENCE,
        }
    }

    /// The board's processor has taken what lay there, or stands still, and takes it when it runs.
    fn is_heard(&self) -> io::Result<bool> {
        let mut qmp = self.qmp.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(qmp.is_halted() || !is_full(&mut qmp)?)
    }
}

fn is_full(qmp: &mut Qmp) -> io::Result<bool> {
    Ok(qmp.word(STATE)? & IS_FULL_IN != 0)
}

impl Write for Ear {
    /// # Errors
    /// Where QEMU is gone, or does not take what it has room for, or the board does not.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut qmp = self.qmp.lock().unwrap_or_else(PoisonError::into_inner);
        let piece = &bytes[..bytes.len().min(ROOM)];
        let mut line = &self.line;
        let has_room = !is_full(&mut qmp)?;
        qmp.while_halted(|| {
            line.write_all(piece)?;
            match has_room {
                true => until("QEMU to take the line's bytes", self.patience, || {
                    is_taken(line)
                }),
                false => settle(WITHOUT_ROOM, || is_taken(line)).map(|_| ()),
            }
        })?;
        drop(qmp);
        if piece.len() < bytes.len() {
            let what = "the board to take what lies in its receiver";
            until(what, self.patience, || self.is_heard())?;
        }
        Ok(piece.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Waits until something is so.
///
/// # Errors
/// Where it is not for so long: what was waited for.
fn until(
    what: &str,
    patience: Duration,
    holds: impl FnMut() -> io::Result<bool>,
) -> io::Result<()> {
    match settle(patience, holds)? {
        true => Ok(()),
        false => Err(io::Error::new(
            io::ErrorKind::TimedOut,
            format!("waited {patience:?} for {what}"),
        )),
    }
}

/// Waits until something is so, at most so long; whether it is.
fn settle(patience: Duration, mut holds: impl FnMut() -> io::Result<bool>) -> io::Result<bool> {
    let end = Instant::now() + patience;
    loop {
        // What is so is so, however late it is looked at.
        let is_over = Instant::now() >= end;
        match holds()? {
            true => return Ok(true),
            false if is_over => return Ok(false),
            // The kernel and QEMU send no notice of this.
            false => std::thread::sleep(LOOK_AGAIN),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Ear, Qmp, until};
    use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
    use std::os::unix::net::UnixStream;
    use std::sync::{Arc, Mutex};
    use std::thread;
    use std::time::Duration;

    /// A monitor that says of every word that it is this one.
    fn monitor(word: u32) -> Arc<Mutex<Qmp>> {
        let (ours, theirs) = UnixStream::pair().expect("a pair");
        thread::spawn(move || {
            let mut says = theirs.try_clone().expect("a second handle");
            let _ = writeln!(says, r#"{{"QMP": {{}}}}"#);
            for line in BufReader::new(theirs).lines().map_while(Result::ok) {
                let _ = match line.contains("xp /1xw") {
                    true => writeln!(says, r#"{{"return": "40004004: {word:#010x}"}}"#),
                    false => writeln!(says, r#"{{"return": {{}}}}"#),
                };
            }
        });
        let mut qmp = Qmp::new(ours).expect("it answers");
        qmp.go().expect("it runs");
        Arc::new(Mutex::new(qmp))
    }

    fn ear(word: u32, patience: Duration) -> (Ear, UnixStream) {
        let (line, theirs) = UnixStream::pair().expect("a pair");
        let mut ear = Ear::new(monitor(word), line);
        ear.patience = patience;
        (ear, theirs)
    }

    #[test]
    fn what_was_waited_for_in_vain_is_told() {
        until("this", Duration::ZERO, || Ok(true)).expect("it is so");
        let why = until("that", Duration::ZERO, || Ok(false)).expect_err("it is not so");
        assert_eq!(why.kind(), ErrorKind::TimedOut);
        assert!(why.to_string().ends_with("for that"), "{why}");
    }

    #[test]
    fn bytes_that_nobody_takes_are_no_success() {
        let (mut empty, _theirs) = ear(0, Duration::ZERO);
        let why = empty.write_all(b"$016\r").expect_err("nobody takes them");
        assert!(why.to_string().contains("QEMU to take"), "{why}");
        // Where others lie there still they come when there is room.
        let (mut full, _theirs) = ear(2, Duration::ZERO);
        full.write_all(b"$016\r").expect("they wait");
        // A longer burst waits for the board, since its second piece needs the first one's room.
        let why = full
            .write_all(&[0x55; 40])
            .expect_err("the board takes none");
        assert!(why.to_string().contains("the board to take"), "{why}");
    }

    #[test]
    fn a_long_burst_comes_whole() {
        let (mut ear, mut theirs) = ear(0, super::PATIENCE);
        let takes = thread::spawn(move || {
            let mut heard = [0; 100];
            theirs.read_exact(&mut heard).map(|()| heard)
        });
        ear.write_all(&[0x55; 100]).expect("it is taken");
        assert_eq!(
            takes.join().expect("no panic").expect("it came"),
            [0x55; 100]
        );
    }
}
