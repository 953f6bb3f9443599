//! Five boards of five families on one line, and `railbus` on it.

use crate::World;
use railbus_device::Options;
use railbus_qemu::{Board, Folder, Hub, Pty};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// So long the daemon may take to know everything.
const PATIENCE: Duration = Duration::from_secs(60);

/// The demo's five modules as boards, and its configuration.
pub(crate) struct Site<'a> {
    world: &'a World,
    pub(crate) folder: Folder,
    pub(crate) hub: Hub,
    pub(crate) boards: Vec<(&'static str, Board)>,
    /// Its link lies in the folder.
    _pty: Pty,
}

impl<'a> Site<'a> {
    pub(crate) fn new(world: &'a World) -> Result<Site<'a>, String> {
        let folder = Folder::new().map_err(said)?;
        let hub = Hub::new();
        let mut boards = Vec::new();
        let options = Options {
            extensions: true,
            ..Options::default()
        };
        for (name, setup) in railbus_sim::demo::modules() {
            let mut board = Board::new(&world.images, &setup, options).map_err(said)?;
            board.join(&hub).map_err(said)?;
            boards.push((name, board));
        }
        let pty = Pty::open(&folder.path().join("line")).map_err(said)?;
        pty.join(&hub).map_err(said)?;
        let site = Site {
            world,
            folder,
            hub,
            boards,
            _pty: pty,
        };
        let demo = include_str!("../../../plant/src/demo.toml");
        let text = demo.replace("PORT", &site.port());
        std::fs::write(site.config(), text).map_err(said)?;
        Ok(site)
    }

    pub(crate) fn port(&self) -> String {
        format!("pty:{}", self.folder.path().join("line").display())
    }

    pub(crate) fn config(&self) -> PathBuf {
        self.folder.path().join("railbus.toml")
    }

    /// Where the daemon is asked.
    pub(crate) fn socket(&self) -> PathBuf {
        self.folder.path().join("socket")
    }

    /// How many points the daemon has, all of them good.
    pub(crate) fn all_good(&self) -> Result<usize, String> {
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

    fn points(&self) -> Result<Vec<Value>, String> {
        let text = self.railbus(&["ls", "points", "-o", "json"])?;
        let told: Value = serde_json::from_str(&text).map_err(said)?;
        let list = told["points"].as_array().or(told.as_array()).cloned();
        list.ok_or_else(|| format!("no points in {text}"))
    }

    pub(crate) fn daemon(&self) -> Result<Daemon, String> {
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

    pub(crate) fn board(&mut self, name: &str) -> Result<&mut Board, String> {
        let found = self.boards.iter_mut().find(|(known, _)| *known == name);
        found
            .map(|(_, board)| board)
            .ok_or_else(|| format!("no board {name}"))
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(&self.world.railbus);
        // A socket that is named has to answer.
        if args.contains(&"serve") || self.socket().exists() {
            command.arg("--socket").arg(self.socket());
        }
        command
            .args(args)
            .current_dir(self.folder.path())
            .env("HOME", self.folder.path())
            .env("RAILBUS_LANG", "en")
            .env_remove("RAILBUS_CONFIG")
            .env_remove("XDG_RUNTIME_DIR")
            .stdin(Stdio::null());
        command
    }

    /// What a command prints that ends well.
    pub(crate) fn railbus(&self, args: &[&str]) -> Result<String, String> {
        let output = self.command(args).output().map_err(said)?;
        if output.status.success() {
            return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
        }
        let told = String::from_utf8_lossy(&output.stderr);
        Err(format!("`railbus {}`: {told}", args.join(" ")))
    }
}

/// Ends with this.
pub(crate) struct Daemon(Child);

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub(crate) fn said(error: impl std::fmt::Display) -> String {
    error.to_string()
}
