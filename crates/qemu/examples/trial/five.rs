//! Five boards of five families on one line, and `railbus` as its master.

use crate::World;
use crate::site::{Daemon, Site, said};
use railbus_cases::Bench;
use serde_json::Value;
use std::time::{Duration, Instant};

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

impl Site<'_> {
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
        self.railbus(&["config", "set", "oven", "address=9", "--yes"])?;
        let hub = self.hub.clone();
        let oven = self.board("oven")?;
        oven.power_cycle().map_err(said)?;
        oven.join(&hub).map_err(said)?;
        let text = std::fs::read_to_string(self.config());
        let told = text.map_err(said)?.contains("address = 9");
        if told {
            Ok(())
        } else {
            Err(String::from("railbus.toml does not say address = 9"))
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
}
