//! One QEMU with a board and its chips.

use crate::qmp::{self, Qmp};
use crate::{Ear, Turn};
use railbus_conformance::Outside;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde_json::json;
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Starts QEMU and ends it at the end of standard input, which comes when our process ends. Only
/// QEMU keeps standard output open, so its end is the end of QEMU.
const SHELL: &str = r#""$@" </dev/null & exec >&-; read -r _; kill -KILL $!; wait $!"#;

/// The line and the console, in the order of QEMU's `-serial`.
///
/// The UART takes one character at a time, and QEMU's own thread delivers the next one only when
/// the processor has read the last: on a busy machine the pause between two is long enough to end a
/// Modbus frame. A multiplexer has room for a short frame and delivers it by itself (see [`Ear`]).
/// It would interpret an escape character; number 256 means that there is none.
const QEMU: &[&str] = &[
    "qemu-system-arm",
    "-M",
    "mps2-an385",
    "-display",
    "none",
    "-monitor",
    "none",
    "-S",
    "-chardev",
    "socket,id=line,path=line,mux=on",
    "-echr",
    "256",
    "-serial",
    "chardev:line",
    "-serial",
    "unix:console",
    "-qmp",
    "unix:qmp",
    "-drive",
    "if=none,id=ee,file=ee.bin,format=raw,cache=unsafe",
    "-device",
    "at24c-eeprom,bus=i2c,address=0x50,rom-size=4096,drive=ee",
    "-device",
    "pca9552,bus=i2c,address=0x60,id=io0",
    "-device",
    "pca9552,bus=i2c,address=0x61,id=io1",
    "-device",
    "pca9552,bus=i2c,address=0x62,id=in0",
    "-device",
    "tmp105,bus=i2c,address=0x48,id=ai0",
    "-device",
    "tmp105,bus=i2c,address=0x49,id=ai1",
    "-kernel",
];

/// The clock divider register of the line's UART, and the clock.
const DIVIDER: u32 = 0x4000_4010;
const CLOCK: u32 = 25_000_000;

/// The register with the time: it counts down, and wraps around here.
const TIME: u32 = 0x4000_0004;
const ROUND: u64 = 25 << 27;

/// How long QEMU may take to start.
const STARTS: Timespec = Timespec {
    tv_sec: 60,
    tv_nsec: 0,
};

/// A board that has power for as long as this lives.
#[derive(Debug)]
pub struct Emulator {
    qmp: Arc<Mutex<Qmp>>,
    line: UnixStream,
    console: BufReader<UnixStream>,
    qemu: Child,
}

impl Emulator {
    /// Switches a board with this program on; `folder` contains its EEPROM as `ee.bin`. The
    /// processor does not run before [`Emulator::go`].
    ///
    /// # Errors
    /// If QEMU does not start, with its message.
    pub fn start(image: &Path, folder: &Path) -> io::Result<Emulator> {
        let sockets = ["line", "console", "qmp"].map(|name| listen(&folder.join(name)));
        let [line, console, qmp] = sockets;
        let says = folder.join("qemu.txt");
        let mut qemu = Command::new("sh")
            .args(["-c", SHELL, "sh"])
            .args(QEMU)
            .arg(image.canonicalize().map_err(|error| named(image, &error))?)
            .current_dir(folder)
            // Ctrl-C is for us; the end of our standard input is for QEMU.
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(&says)?)
            .spawn()?;
        let mut connect = |listener: io::Result<UnixListener>| accept(&listener?, &mut qemu, &says);
        let (line, console, qmp) = (connect(line)?, connect(console)?, connect(qmp)?);
        Ok(Emulator {
            qmp: Arc::new(Mutex::new(Qmp::new(qmp)?)),
            line,
            console: BufReader::new(console),
            qemu,
        })
    }

    /// Lets the processor run.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn go(&mut self) -> io::Result<()> {
        self.qmp().go()
    }

    /// Halts the processor: the state does not change until it runs again.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn halt(&mut self) -> io::Result<()> {
        self.qmp().halt()
    }

    fn qmp(&self) -> MutexGuard<'_, Qmp> {
        self.qmp.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a function that tells the speed of the board's UART, for as long as it has power.
    /// QEMU's UART understands every speed; a line of several boards must filter by speed.
    ///
    /// A reply is sent at the speed of its request: when it arrives here, the board may already
    /// have changed its speed.
    pub fn speed(&self) -> impl FnMut(Turn) -> Option<u32> + Send + use<> {
        let qmp = Arc::clone(&self.qmp);
        let mut heard_at = None;
        move |turn| {
            if turn == Turn::Hears || heard_at.is_none() {
                let mut qmp = qmp.lock().unwrap_or_else(PoisonError::into_inner);
                heard_at = CLOCK.checked_div(qmp.word(DIVIDER).ok()?);
            }
            heard_at
        }
    }

    /// How long the program has been running, by the board's own clock, which wraps around every
    /// 134 s and starts with the program.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn clock(&self) -> io::Result<Duration> {
        let left = u64::from(self.qmp().word(TIME)?);
        let ticks = (ROUND - 1).saturating_sub(left);
        Ok(Duration::from_micros(ticks * 1_000_000 / u64::from(CLOCK)))
    }

    /// The time since then, if it is less than one round of the clock.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn since(&self, then: Duration) -> io::Result<Duration> {
        let round = Duration::from_micros(ROUND * 1_000_000 / u64::from(CLOCK));
        let now = self.clock()?;
        Ok(now.checked_sub(then).unwrap_or(now + round - then))
    }

    /// The input of the board's UART.
    ///
    /// # Errors
    /// If the limit of open files is reached.
    pub fn ear(&self) -> io::Result<Ear> {
        Ok(Ear::new(Arc::clone(&self.qmp), self.line.try_clone()?))
    }

    /// The board's end of the line.
    #[must_use]
    pub const fn line(&self) -> &UnixStream {
        &self.line
    }

    /// The outputs as seen at their terminals: bit n = output n is on.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn outputs(&mut self) -> io::Result<u32> {
        let leds = (0..32).map(|led| match led {
            0..16 => qmp::get("io0", &format!("led{led}")),
            _ => qmp::get("io1", &format!("led{}", led - 16)),
        });
        let states = self.qmp().execute(&leds.collect::<Vec<_>>())?;
        let bits = (0..).zip(states);
        Ok(bits.fold(0, |on, (led, state)| on | u32::from(state == "on") << led))
    }

    /// Sets the surroundings of the board. A LED of `in0` that is on is a pin pulled low.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn surround(&mut self, outside: &Outside) -> io::Result<()> {
        let low = !outside.levels & 0xFF
            | u32::from(outside.dip & 0x1F) << 8
            | u32::from(outside.init) << 15;
        let pins = (0..16).map(|led| {
            let state = if low >> led & 1 == 1 { "on" } else { "off" };
            qmp::set("in0", &format!("led{led}"), json!(state))
        });
        let analogs = ["ai0", "ai1"].into_iter().zip(outside.analogs);
        let analogs = analogs.map(|(chip, hundredths)| {
            qmp::set(chip, "temperature", json!(millidegrees(hundredths)))
        });
        let commands: Vec<_> = pins.chain(analogs).collect();
        self.qmp().execute(&commands).map(|_| ())
    }

    /// The module's report on its console, up to its last line.
    ///
    /// # Errors
    /// If there is none.
    pub fn report(&mut self) -> io::Result<String> {
        let console = self.console.get_mut();
        console.set_read_timeout(Some(Duration::from_secs(30)))?;
        console.write_all(b"?")?;
        let mut said = String::new();
        // The first report is sent when it starts.
        for _ in 0..2 {
            said.clear();
            while !said.lines().any(|line| line.starts_with("up ")) {
                let mut line = String::new();
                if self.console.read_line(&mut line)? == 0 {
                    return Err(io::Error::other("the console is gone"));
                }
                said.push_str(&line);
            }
            self.console
                .get_ref()
                .set_read_timeout(Some(Duration::from_secs(2)))?;
            if !self.has_more()? {
                break;
            }
        }
        Ok(said)
    }

    fn has_more(&mut self) -> io::Result<bool> {
        match self.console.fill_buf() {
            Ok(more) => Ok(!more.is_empty()),
            Err(error) if is_silence(&error) => Ok(false),
            Err(error) => Err(error),
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        drop(self.qemu.stdin.take());
        let _ = self.qemu.wait();
    }
}

/// Whether a read ended because there was nothing to read.
pub(crate) fn is_silence(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
    )
}

/// The setting of a TMP105 to show this many sixteenths of a degree: it rounds towards 0.
fn millidegrees(hundredths: i16) -> i32 {
    let exact = i32::from(hundredths) * 125;
    exact / 2 + exact % 2
}

fn listen(path: &Path) -> io::Result<UnixListener> {
    let _ = std::fs::remove_file(path);
    UnixListener::bind(path).map_err(|error| named(path, &error))
}

/// Waits for QEMU to connect, or to end.
fn accept(listener: &UnixListener, qemu: &mut Child, says: &Path) -> io::Result<UnixStream> {
    let ended = qemu
        .stdout
        .as_ref()
        .ok_or_else(|| io::Error::other("it has no output"))?;
    let mut fds = [
        PollFd::new(listener, PollFlags::IN),
        PollFd::new(ended, PollFlags::IN),
    ];
    poll(&mut fds, Some(&STARTS))?;
    if !fds[0].revents().is_empty() {
        return Ok(listener.accept()?.0);
    }
    let said = std::fs::read_to_string(says).unwrap_or_default();
    drop(qemu.stdin.take());
    let _ = qemu.wait();
    Err(io::Error::other(format!(
        "QEMU does not start: {}",
        said.trim()
    )))
}

fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// QEMU's own calculation, in its integers.
    fn shown(millidegrees: i32) -> i32 {
        millidegrees * 0x800 / 128_000
    }

    #[test]
    fn every_hundredth_can_be_shown() {
        for hundredths in -2000..=2000 {
            assert_eq!(shown(millidegrees(hundredths)), i32::from(hundredths));
        }
    }
}
