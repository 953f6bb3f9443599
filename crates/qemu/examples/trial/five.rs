//! Five boards of five families on one line, and `railbus` as its master.

use crate::World;
use railbus_cases::Bench;
use railbus_device::Options;
use railbus_qemu::{Board, Folder, Hub, Pty};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// So long the daemon may take to know everything.
const PATIENCE: Duration = Duration::from_secs(60);

/// So often a command is given that ends with this.
const TRIES: usize = 5;
const NO_REPLY: &str = "error[E0301]";

/// The time that the oven's watchdog waits for its host: 64h in tenths of a second.
const WATCHDOG: Duration = Duration::from_secs(10);

/// One output of each module, and what its board then shows.
const SWITCHED: [(&str, &str, u32); 5] = [
    ("pump", "do1", 0b10),
    ("gate", "do7", 0x80),
    ("oven", "k3", 0b100),
    ("yard", "k8", 0x80),
    ("tank", "k2", 0b10),
];

/// They are scanned, one gets another address, `railbus serve` polls and switches them, and dies.
pub(crate) fn railbus_runs_five_boards(world: &World) -> Result<String, String> {
    let mut site = Site::new(world)?;
    let scanned = site.scan()?;
    site.change_address()?;
    site.watch()?;
    let daemon = site.daemon()?;
    let points = site.all_good()?;
    site.switch()?;
    site.host_dies(daemon)?;
    Ok(format!(
        "{scanned} found, one moved, {points} points polled, five outputs seen to move; \
         the host died and the oven went to its safe states"
    ))
}

struct Site<'a> {
    world: &'a World,
    folder: Folder,
    hub: Hub,
    boards: Vec<(&'static str, Board)>,
    /// Its link lies in the folder.
    _pty: Pty,
}

impl<'a> Site<'a> {
    fn new(world: &'a World) -> Result<Site<'a>, String> {
        let folder = Folder::new().map_err(said)?;
        let hub = Hub::new();
        let mut boards = Vec::new();
        let options = Options {
            beyond: true,
            ..Options::default()
        };
        for (name, setup) in railbus_sim::demo::modules() {
            let mut board = Board::new(&world.images, &setup, options).map_err(said)?;
            board.join(&hub).map_err(said)?;
            boards.push((name, board.slower(10)));
        }
        let pty = Pty::open(&folder.path().join("line")).map_err(said)?;
        pty.join(&hub).map_err(said)?;
        Ok(Site {
            world,
            folder,
            hub,
            boards,
            _pty: pty,
        })
    }

    fn port(&self) -> String {
        format!("pty:{}", self.folder.path().join("line").display())
    }

    /// How many modules a scan finds, which must be those that are there.
    fn scan(&mut self) -> Result<usize, String> {
        let port = self.port();
        let args = [
            "scan",
            "-l",
            &port,
            "--addr",
            "1-6",
            "--timeout",
            "700ms",
            "-o",
            "json",
        ];
        let found: Value = serde_json::from_str(&self.railbus(&args)?).map_err(said)?;
        let found = found["found"].as_array().cloned().unwrap_or_default();
        let models: Vec<String> = found
            .iter()
            .map(|module| format!("{} {}", module["addr"], module["model"]).replace('"', ""))
            .collect();
        let expected = [
            "1 EDA9060A",
            "2 EDA9050",
            "3 ERC-8",
            "4 0x55 board",
            "5 EMD-2A2Q",
        ];
        if models == expected {
            Ok(models.len())
        } else {
            Err(format!("found {models:?}"))
        }
    }

    /// The oven goes to another address, and stays there over a loss of power.
    fn change_address(&mut self) -> Result<(), String> {
        let demo = include_str!("../../../railbus/src/serve/demo.toml");
        let text = demo.replace("PORT", &self.port());
        std::fs::write(self.folder.path().join("railbus.toml"), text).map_err(said)?;
        self.railbus(&["config", "set", "oven", "address=9", "--yes"])?;
        let hub = self.hub.clone();
        let oven = self.board("oven")?;
        oven.power_cycle().map_err(said)?;
        oven.join(&hub).map_err(said)?;
        let text = std::fs::read_to_string(self.folder.path().join("railbus.toml"));
        let told = text.map_err(said)?.contains("address = 9");
        if told {
            Ok(())
        } else {
            Err(String::from("railbus.toml does not say address = 9"))
        }
    }

    /// How many points the daemon has, all of them good.
    fn all_good(&self) -> Result<usize, String> {
        let until = Instant::now() + PATIENCE;
        loop {
            let points = self.points()?;
            let bad: Vec<&Value> = points
                .iter()
                .filter(|point| point["quality"] != "good")
                .collect();
            if bad.is_empty() && !points.is_empty() {
                return Ok(points.len());
            }
            if Instant::now() > until {
                return Err(format!(
                    "of {} points these are not good: {bad:?}",
                    points.len()
                ));
            }
        }
    }

    /// Each module's output is switched, and its board shows it.
    fn switch(&mut self) -> Result<(), String> {
        for (module, point, outputs) in SWITCHED {
            self.railbus(&["set", &format!("{module}.{point}"), "on"])?;
            self.shows(module, outputs)?;
        }
        Ok(())
    }

    /// The oven gets a host watchdog [BEYOND §3.1], which waits for the daemon from now on.
    fn watch(&self) -> Result<(), String> {
        for write in ["09 06 BE04 0081", "09 06 BE01 0064"] {
            let words: Vec<&str> = write.split(' ').collect();
            self.railbus(&[&["raw", "-l", "main", "--yes", "--crc"], &words[..]].concat())?;
        }
        Ok(())
    }

    /// As long as the daemon polls it, the oven stays as it is; when the daemon is killed, its
    /// outputs go to their safe states [BEYOND §1.1, §1.2].
    fn host_dies(&mut self, daemon: Daemon) -> Result<(), String> {
        let until = Instant::now() + WATCHDOG + WATCHDOG / 5;
        while Instant::now() < until {
            self.shows("oven", 0b100)?;
        }
        drop(daemon);
        self.shows("oven", 0x81)
    }

    fn shows(&mut self, module: &str, outputs: u32) -> Result<(), String> {
        let shown = self.board(module)?.outputs(outputs).map_err(said)?;
        if shown == outputs {
            return Ok(());
        }
        Err(format!("{module} shows {shown:X}, not {outputs:X}"))
    }

    fn points(&self) -> Result<Vec<Value>, String> {
        let text = self.railbus(&["ls", "points", "-o", "json"])?;
        let told: Value = serde_json::from_str(&text).map_err(said)?;
        let list = told["points"].as_array().or(told.as_array()).cloned();
        list.ok_or_else(|| format!("no points in {text}"))
    }

    fn daemon(&self) -> Result<Daemon, String> {
        let mut command = self.command(&["serve", "--listen", "127.0.0.1:0"]);
        let mut child = command.stdout(Stdio::piped()).spawn().map_err(said)?;
        let stdout = child.stdout.take();
        let daemon = Daemon(child);
        let lines = stdout
            .map(BufReader::new)
            .ok_or("it has no output")?
            .lines();
        let ready = lines
            .map_while(Result::ok)
            .any(|line| line.contains("Ctrl-C"));
        if ready {
            Ok(daemon)
        } else {
            Err(String::from("railbus serve does not start"))
        }
    }

    fn board(&mut self, name: &str) -> Result<&mut Board, String> {
        let found = self.boards.iter_mut().find(|(known, _)| *known == name);
        found
            .map(|(_, board)| board)
            .ok_or_else(|| format!("no board {name}"))
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(&self.world.railbus);
        command
            .args(args)
            .arg("--socket")
            .arg(self.folder.path().join("socket"))
            .current_dir(self.folder.path())
            .env("HOME", self.folder.path())
            .env("RAILBUS_LANG", "en")
            .env_remove("RAILBUS_CONFIG")
            .env_remove("XDG_RUNTIME_DIR")
            .stdin(Stdio::null());
        command
    }

    /// What a command prints that ends well. As with cases: QEMU that is held up in the middle of
    /// a frame gets no reply from a module that is right.
    fn railbus(&self, args: &[&str]) -> Result<String, String> {
        let mut told = String::new();
        for _ in 0..TRIES {
            let output = self.command(args).output().map_err(said)?;
            if output.status.success() {
                return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
            }
            told = String::from_utf8_lossy(&output.stderr).into_owned();
            if !told.contains(NO_REPLY) {
                break;
            }
        }
        Err(format!("`railbus {}`: {told}", args.join(" ")))
    }
}

/// Ends with this.
struct Daemon(Child);

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn said(error: impl std::fmt::Display) -> String {
    error.to_string()
}
