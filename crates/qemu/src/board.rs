//! A board on a bench.

use crate::hub::is_same;
use crate::machine::is_silence;
use crate::{Emulator, Folder, Hub, Turn};
use railbus_conformance::{Bench, Outside};
use railbus_device::{Eeprom, Family, Options, Setup};
use railbus_nvm::{Record, slot_image};
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The size of the EEPROM in bytes.
const EEPROM: usize = 4096;

/// How many times [`PAUSE`] may pass before an expected reply comes. While a busy machine delays
/// QEMU the board's clock goes on, so one long pause counts once.
const PAUSES: usize = 80;

/// How long the board may take to show something, however busy the machine is.
const PATIENCE: Duration = Duration::from_secs(40);

/// This long without bytes is silence, by the board's clock, as all durations below. A reply that
/// is later is not lost: it comes instead of the next one, or at the end of the case.
const SILENCE: Duration = Duration::from_millis(80);

/// The silence after a reply; longer than the gap that any family requires before a request.
const PAUSE: Duration = Duration::from_millis(25);

/// After this time everything the board has sent so far has arrived.
const SAID: Duration = Duration::from_millis(1);

/// How often outputs are read again.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// The program of a family, in the folder where `cargo xtask firmware build` puts it.
#[must_use]
pub fn family_image(images: &Path, family: Family) -> PathBuf {
    images.join(format!("mps2-an385-{}.elf", family.name()))
}

/// A board in QEMU with its EEPROM and its surroundings.
#[derive(Debug)]
pub struct Board {
    machine: Option<Emulator>,
    outside: Outside,
    image: PathBuf,
    folder: Folder,
}

impl Board {
    /// A powered module in its factory state, except for `setup` and `options`.
    ///
    /// # Errors
    /// If there is no such module, or QEMU does not start.
    pub fn new(images: &Path, setup: &Setup, options: Options) -> io::Result<Board> {
        Board::with(images, setup, options, Eeprom::of(setup))
    }

    /// A module with these settings.
    ///
    /// # Errors
    /// As above.
    pub fn with(
        images: &Path,
        setup: &Setup,
        options: Options,
        eeprom: Eeprom,
    ) -> io::Result<Board> {
        let folder = Folder::new()?;
        let record = Record::new(setup, options, eeprom).map_err(io::Error::other)?;
        let mut bytes = vec![0xFF; EEPROM];
        let slot = slot_image(&record.encode(), 1);
        bytes[..slot.bytes().len()].copy_from_slice(slot.bytes());
        std::fs::write(folder.path().join("ee.bin"), bytes)?;
        let mut board = Board {
            machine: None,
            outside: Outside::of(setup),
            image: family_image(images, setup.family),
            folder,
        };
        board.power_on()?;
        Ok(board)
    }

    /// Switches the power on, if it is off.
    ///
    /// # Errors
    /// If QEMU does not start.
    pub fn power_on(&mut self) -> io::Result<()> {
        if self.machine.is_none() {
            let mut machine = Emulator::start(&self.image, self.folder.path())?;
            machine.surround(&self.outside)?;
            machine.go()?;
            self.machine = Some(machine);
        }
        Ok(())
    }

    /// Switches the power off. The EEPROM keeps its content.
    pub fn power_off(&mut self) {
        self.machine = None;
    }

    /// The machine.
    ///
    /// # Errors
    /// If there is no power.
    pub fn machine(&mut self) -> io::Result<&mut Emulator> {
        self.machine
            .as_mut()
            .ok_or_else(|| io::Error::other("the board has no power"))
    }

    /// Whether the board listens at this speed; waits some time for it.
    ///
    /// # Errors
    /// If there is no power.
    pub fn runs_at(&mut self, rate: u32) -> io::Result<bool> {
        self.runs(|one| is_same(one, rate))
    }

    /// Whether the board listens at one of the wanted speeds; waits some time for it.
    fn runs(&mut self, wanted: impl Fn(u32) -> bool) -> io::Result<bool> {
        let until = Instant::now() + PATIENCE;
        let mut speed = self.machine()?.speed();
        loop {
            let runs = speed(Turn::Hears).is_some_and(&wanted);
            if runs || Instant::now() > until {
                return Ok(runs);
            }
            // QEMU sends no notice when a register changes.
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    /// Joins the board to a line for as long as it has power. When this returns it listens: what is
    /// sent while its program is starting is lost.
    ///
    /// # Errors
    /// If there is no power, or the board does not start to listen.
    pub fn join(&mut self, hub: &Hub) -> io::Result<()> {
        if !self.runs(|_| true)? {
            return Err(io::Error::other("the board does not listen"));
        }
        let machine = self.machine()?;
        hub.join(machine.line().try_clone()?, machine.ear()?, machine.speed());
        Ok(())
    }

    /// Waits for a silence by the board's clock, if the board has power.
    ///
    /// # Errors
    /// If QEMU is gone.
    pub fn keep_silence(&mut self) -> io::Result<()> {
        let Some(machine) = &self.machine else {
            return Ok(());
        };
        let began = machine.clock()?;
        loop {
            let passed = machine.since(began)?;
            if passed >= SILENCE {
                return Ok(());
            }
            // QEMU sends no notice when the guest clock reaches a time, so it is read again.
            std::thread::sleep(SILENCE - passed);
        }
    }

    /// The surroundings of the board; change them with [`Bench::surround`].
    #[must_use]
    pub const fn outside(&self) -> &Outside {
        &self.outside
    }

    /// Sends bytes in one go.
    ///
    /// # Errors
    /// If there is no power.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.machine()?.ear()?.write_all(bytes)
    }

    /// Receives until there was silence for this long, by the board's clock.
    ///
    /// # Errors
    /// If there is no power.
    pub fn hear(&mut self, silence: Duration, said: &mut Vec<u8>) -> io::Result<()> {
        let machine = self.machine()?;
        let mut spoke = machine.clock()?;
        loop {
            let silent = machine.since(spoke)?;
            // Nothing sent before that is still on its way.
            if read(machine.line(), SAID, said)? {
                spoke = machine.clock()?;
            } else if silent >= silence {
                return Ok(());
            } else if read(machine.line(), silence - silent, said)? {
                spoke = machine.clock()?;
            }
        }
    }

    /// Receives this many bytes, patiently.
    fn hear_so_many(&mut self, worth: usize, said: &mut Vec<u8>) -> io::Result<()> {
        for _ in 0..PAUSES {
            if said.len() >= worth {
                break;
            }
            self.hear(PAUSE, said)?;
        }
        Ok(())
    }
}

impl Bench for Board {
    type Error = io::Error;

    fn ask(&mut self, request: &[u8], worth: usize) -> io::Result<Vec<u8>> {
        let mut said = Vec::new();
        self.send(request)?;
        if worth == 0 {
            self.hear(SILENCE, &mut said)?;
            return Ok(said);
        }
        self.hear_so_many(worth, &mut said)?;
        Ok(said)
    }

    fn outputs(&mut self, expected: u32) -> io::Result<u32> {
        let until = Instant::now() + PATIENCE;
        loop {
            let outputs = self.machine()?.outputs()?;
            if outputs == expected || Instant::now() > until {
                return Ok(outputs);
            }
            // QEMU sends no notice when a pin changes.
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    /// The firmware reads its inputs when a frame begins.
    fn surround(&mut self, outside: &Outside) -> io::Result<()> {
        self.outside = *outside;
        self.machine()?.surround(outside)
    }

    fn power_cycle(&mut self) -> io::Result<()> {
        self.power_off();
        self.power_on()
    }

    fn wait(&mut self, millis: u64) -> io::Result<Vec<u8>> {
        let (mut said, wait) = (Vec::new(), Duration::from_millis(millis));
        let machine = self.machine()?;
        let began = machine.clock()?;
        loop {
            let passed = machine.since(began)?;
            read(machine.line(), SAID, &mut said)?;
            if passed >= wait {
                return Ok(said);
            }
            read(machine.line(), wait - passed, &mut said)?;
        }
    }
}

/// Reads what arrives within this time; returns whether anything did.
fn read(mut line: &UnixStream, within: Duration, said: &mut Vec<u8>) -> io::Result<bool> {
    line.set_read_timeout(Some(within))?;
    let mut buffer = [0; 512];
    match line.read(&mut buffer) {
        Ok(0) => Err(io::Error::other("QEMU has ended")),
        Ok(count) => {
            said.extend_from_slice(&buffer[..count]);
            Ok(true)
        }
        Err(error) if is_silence(&error) => Ok(false),
        Err(error) => Err(error),
    }
}
