//! The input of a board's UART.

use crate::qmp::Qmp;
use crate::taken::is_taken;
use std::io::{self, Write};
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How many characters fit into QEMU's multiplexer and its UART.
const ROOM: usize = 32;

/// How long QEMU may take for them. It takes none while others are there that the board does not
/// read: they come when there is room.
const PATIENCE: Duration = Duration::from_millis(500);

/// How often to check again.
const LOOK_AGAIN: Duration = Duration::from_micros(200);

/// The state register of the line's UART, and the bit for a received character.
const STATE: u32 = 0x4000_4004;
const IS_FULL_IN: u32 = 1 << 1;

/// Whatever is written at once reaches the board as one burst, without a pause: QEMU takes it while
/// the board's processor, and with it the board's clock, is halted. Otherwise a busy machine could
/// delay QEMU between two characters while the clock goes on; and a pause ends a Modbus frame.
///
/// A burst that does not fit into QEMU's buffers comes in pieces. By the board's clock the first
/// piece takes the time of its characters, and the next one is there before they are over.
#[derive(Debug)]
pub struct Ear {
    qmp: Arc<Mutex<Qmp>>,
    line: UnixStream,
}

impl Ear {
    pub(crate) fn new(qmp: Arc<Mutex<Qmp>>, line: UnixStream) -> Ear {
        Ear { qmp, line }
    }

    /// Whether the board's processor has read everything.
    fn is_heard(&self) -> io::Result<bool> {
        let mut qmp = self.qmp.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(qmp.word(STATE)? & IS_FULL_IN == 0)
    }
}

impl Write for Ear {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut qmp = self.qmp.lock().unwrap_or_else(PoisonError::into_inner);
        let piece = &bytes[..bytes.len().min(ROOM)];
        let mut line = &self.line;
        qmp.while_halted(|| {
            line.write_all(piece)?;
            until(|| is_taken(line))
        })?;
        drop(qmp);
        if piece.len() < bytes.len() {
            until(|| self.is_heard())?;
        }
        Ok(piece.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Waits patiently until a condition holds.
fn until(mut holds: impl FnMut() -> io::Result<bool>) -> io::Result<()> {
    let patient_until = Instant::now() + PATIENCE;
    while !holds()? && Instant::now() < patient_until {
        // The kernel and QEMU send no notice of this.
        std::thread::sleep(LOOK_AGAIN);
    }
    Ok(())
}
