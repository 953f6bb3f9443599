//! Five boards of five families on one line, and `railbus` as its master.

use crate::World;
use crate::site::{Daemon, Site, said};
use railbus_conformance::Bench;
use railbus_qemu::Hub;
use railbus_wire::crc16;
use serde_json::Value;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The time that the oven's watchdog waits for its host: 64h in tenths of a second.
const WATCHDOG: Duration = Duration::from_secs(10);

/// How a reply with its outputs begins; a byte with them and two of CRC follow.
const REPLY: [u8; 3] = [9, 1, 1];

/// So much is kept of what was heard last.
const HEARD: usize = 64;

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
    let died = site.host_dies(daemon)?;
    Ok(format!(
        "{scanned} found, one moved, {points} points polled, five outputs seen to move; {died} and \
         the oven went to its safe states"
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

    /// The oven is moved to another address, and stays there over a loss of power.
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

    /// The oven gets a host watchdog [BEYOND §3.1], which the daemon feeds from now on.
    fn watch(&self) -> Result<(), String> {
        self.order("09 06 BE04 0081")?;
        self.order("09 06 BE01 0064")
    }

    fn order(&self, frame: &str) -> Result<(), String> {
        let words: Vec<&str> = frame.split(' ').collect();
        self.railbus(&[&["raw", "-l", "main", "--yes", "--crc"], &words[..]].concat())?;
        Ok(())
    }

    /// As long as the daemon polls it, the oven stays as it is; when the daemon is killed, its
    /// outputs go to their safe states [BEYOND §1.1, §1.2]. A machine that keeps the polls from it
    /// for as long is as good as a daemon that is killed. What happened, in words.
    fn host_dies(&mut self, daemon: Daemon) -> Result<&'static str, String> {
        let polled = Polled::on(&self.hub);
        let stays = self.stays(&polled)?;
        drop(daemon);
        self.shows("oven", 0x81)?;
        Ok(if stays {
            "the host died"
        } else {
            "the machine kept the host from polling it"
        })
    }

    /// Whether the oven stays as it is for longer than its watchdog waits. If it does not, the
    /// machine has kept the polls from it for nearly as long: anything else is an error.
    fn stays(&mut self, polled: &Polled) -> Result<bool, String> {
        polled.begin();
        let until = Instant::now() + WATCHDOG + WATCHDOG / 5;
        while Instant::now() < until {
            if let Err(why) = self.shows("oven", 0b100) {
                return match polled.longest_pause() {
                    pause if pause > WATCHDOG * 9 / 10 => Ok(false),
                    pause => Err(format!("{why}, and was polled {pause:?} apart at most")),
                };
            }
        }
        Ok(true)
    }

    fn shows(&mut self, module: &str, outputs: u32) -> Result<(), String> {
        let shown = self.board(module)?.outputs(outputs).map_err(said)?;
        if shown == outputs {
            return Ok(());
        }
        Err(format!("{module} shows {shown:X}, not {outputs:X}"))
    }
}

/// When the oven was polled, as its replies tell: then its watchdog waits anew [BEYOND §1.1].
struct Polled(Arc<Mutex<Pauses>>);

struct Pauses {
    last: Instant,
    longest: Duration,
}

impl Polled {
    fn on(hub: &Hub) -> Polled {
        let pauses = Arc::new(Mutex::new(Pauses {
            last: Instant::now(),
            longest: Duration::ZERO,
        }));
        let mut heard = Vec::new();
        let told = Arc::clone(&pauses);
        hub.disturb(move |bytes| {
            heard.extend_from_slice(bytes);
            let reply = heard.windows(REPLY.len() + 3).rposition(is_reply);
            if let Some(at) = reply {
                heard.drain(..=at);
                lock(&told).polled();
            }
            heard.drain(..heard.len().saturating_sub(HEARD));
        });
        Polled(pauses)
    }

    fn begin(&self) {
        let mut pauses = lock(&self.0);
        (pauses.last, pauses.longest) = (Instant::now(), Duration::ZERO);
    }

    fn longest_pause(&self) -> Duration {
        let mut pauses = lock(&self.0);
        // The one that is not over yet counts, too.
        pauses.polled();
        pauses.longest
    }
}

impl Pauses {
    fn polled(&mut self) {
        let now = Instant::now();
        self.longest = self.longest.max(now - self.last);
        self.last = now;
    }
}

/// The states of the oven's eight outputs, from its new address.
fn is_reply(frame: &[u8]) -> bool {
    let crc = crc16(&frame[..4]).to_le_bytes();
    frame.starts_with(&REPLY) && frame[4..] == crc
}

fn lock(pauses: &Mutex<Pauses>) -> MutexGuard<'_, Pauses> {
    pauses.lock().unwrap_or_else(PoisonError::into_inner)
}
