//! A board on a bench.

use crate::hub::is_same;
use crate::machine::is_silence;
use crate::{Folder, Hub, Machine, Turn};
use railbus_cases::{Bench, Outside};
use railbus_device::{Eeprom, Family, Options, Setup};
use railbus_keep::{Record, slot_image};
use railbus_wire::Protocol;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How many bytes the EEPROM has.
const EEPROM: usize = 4096;

/// So long a reply that must come may take.
const PATIENCE: Duration = Duration::from_secs(2);

/// So often a Modbus request is sent where a reply must come. A host that is busy holds up QEMU
/// between two characters, and a pause ends a Modbus frame: the module is right to ignore both
/// halves. One that answers no whole frame answers none of these either.
const SENT: u32 = 5;

/// So long nothing may come for it to be silence. A reply that is later than this is not lost: it
/// comes instead of the next one, or at the end of the case.
const SILENCE: Duration = Duration::from_millis(80);

/// Silence behind a reply; longer than the gap that any family wants before a request.
const PAUSE: Duration = Duration::from_millis(25);

/// Outputs are looked at again after so long.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// The program of a family, in the folder where `cargo xtask firmware build` puts them.
#[must_use]
pub fn family_image(images: &Path, family: Family) -> PathBuf {
    images.join(format!("mps2-an385-{}.elf", family.name()))
}

/// A board in QEMU with its EEPROM, and what lies around it.
#[derive(Debug)]
pub struct Board {
    machine: Option<Machine>,
    outside: Outside,
    image: PathBuf,
    folder: Folder,
    /// How many times longer than usual anything may take.
    slower: u32,
    protocol: Protocol,
    repeated: u32,
}

impl Board {
    /// A module fresh from the factory, but for what `setup` and `options` say, and powered.
    ///
    /// # Errors
    /// Where there is no such module, or QEMU does not start.
    pub fn new(images: &Path, setup: &Setup, options: Options) -> io::Result<Board> {
        Board::with(images, setup, options, Eeprom::of(setup))
    }

    /// A module that keeps these settings.
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
            slower: 1,
            protocol: setup.protocol,
            repeated: 0,
        };
        board.power_on()?;
        Ok(board)
    }

    /// Waits so many times longer, for a machine that turned out to be busy.
    #[must_use]
    pub fn slower(mut self, times: u32) -> Board {
        self.slower = times;
        self
    }

    /// How many requests had to be sent again.
    #[must_use]
    pub const fn repeated(&self) -> u32 {
        self.repeated
    }

    /// Puts power on, if there is none.
    ///
    /// # Errors
    /// Where QEMU does not start.
    pub fn power_on(&mut self) -> io::Result<()> {
        if self.machine.is_none() {
            let mut machine = Machine::start(&self.image, self.folder.path())?;
            machine.surround(&self.outside)?;
            machine.go()?;
            self.machine = Some(machine);
        }
        Ok(())
    }

    /// Takes the power away. The EEPROM keeps what was written.
    pub fn power_off(&mut self) {
        self.machine = None;
    }

    /// The machine.
    ///
    /// # Errors
    /// Where there is no power.
    pub fn machine(&mut self) -> io::Result<&mut Machine> {
        self.machine
            .as_mut()
            .ok_or_else(|| io::Error::other("the board has no power"))
    }

    /// Whether the board listens at this speed, for which it is given some time.
    ///
    /// # Errors
    /// Where there is no power.
    pub fn runs_at(&mut self, rate: u32) -> io::Result<bool> {
        let until = Instant::now() + PATIENCE * self.slower;
        let mut speed = self.machine()?.speed();
        loop {
            let runs = speed(Turn::Hears).is_some_and(|one| is_same(one, rate));
            if runs || Instant::now() > until {
                return Ok(runs);
            }
            // QEMU tells nobody that a register has changed.
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    /// The board becomes a member of this line, for as long as it has power.
    ///
    /// # Errors
    /// Where there is no power.
    pub fn join(&mut self, hub: &Hub) -> io::Result<()> {
        let machine = self.machine()?;
        let line = machine.line();
        hub.join(line.try_clone()?, line.try_clone()?, machine.speed());
        Ok(())
    }

    /// What lies around the board, to be changed with [`Bench::surround`].
    #[must_use]
    pub const fn outside(&self) -> &Outside {
        &self.outside
    }

    /// Sends bytes in one go.
    ///
    /// # Errors
    /// Where there is no power.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.machine()?.line().write_all(bytes)
    }

    /// Hears what comes until there was silence for so long.
    ///
    /// # Errors
    /// Where there is no power.
    pub fn hear(&mut self, silence: Duration, said: &mut Vec<u8>) -> io::Result<()> {
        let mut line = self.machine()?.line();
        line.set_read_timeout(Some(silence))?;
        let mut buffer = [0; 512];
        loop {
            match line.read(&mut buffer) {
                Ok(0) => return Err(io::Error::other("QEMU has ended")),
                Ok(count) => said.extend_from_slice(&buffer[..count]),
                Err(error) if is_silence(&error) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }

    /// Hears what comes until it is so many bytes, with patience.
    fn hear_so_many(&mut self, worth: usize, said: &mut Vec<u8>) -> io::Result<()> {
        let until = Instant::now() + PATIENCE * self.slower;
        while said.len() < worth && Instant::now() < until {
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
            self.hear(SILENCE * self.slower, &mut said)?;
            return Ok(said);
        }
        self.hear_so_many(worth, &mut said)?;
        let again = if self.protocol == Protocol::Rtu {
            SENT - 1
        } else {
            0
        };
        for _ in 0..again {
            if !said.is_empty() {
                break;
            }
            self.repeated += 1;
            self.send(request)?;
            self.hear_so_many(worth, &mut said)?;
        }
        self.hear(PAUSE * self.slower, &mut said)?;
        Ok(said)
    }

    fn outputs(&mut self, expected: u32) -> io::Result<u32> {
        let until = Instant::now() + PATIENCE * self.slower;
        loop {
            let outputs = self.machine()?.outputs()?;
            if outputs == expected || Instant::now() > until {
                return Ok(outputs);
            }
            // QEMU tells nobody that a pin has changed.
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    /// The firmware looks at its inputs when a frame begins.
    fn surround(&mut self, outside: &Outside) -> io::Result<()> {
        self.outside = *outside;
        self.machine()?.surround(outside)
    }

    fn power_cycle(&mut self) -> io::Result<()> {
        self.power_off();
        self.power_on()
    }

    fn wait(&mut self, millis: u64) -> io::Result<Vec<u8>> {
        let mut said = Vec::new();
        let until = Instant::now() + Duration::from_millis(millis);
        while Instant::now() < until {
            self.hear(
                until.duration_since(Instant::now()).max(LOOK_AGAIN),
                &mut said,
            )?;
        }
        Ok(said)
    }
}
