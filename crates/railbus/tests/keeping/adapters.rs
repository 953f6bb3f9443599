//! Adapters are pulled out and plugged in again, under a stable name.

use crate::adapter::{Adapter, terminal};
use crate::daemon::{Daemon, Folder};
use serde_json::json;
use std::fmt::Write;
use std::path::Path;
use std::time::{Duration, Instant};

const LINES: [&str; 4] = ["north", "east", "south", "west"];
const ROUNDS: usize = 20;
/// Nothing takes this long unless it hangs.
const HANGS: Duration = Duration::from_secs(20);

fn site(folder: &Path) -> String {
    let mut text = String::new();
    for line in LINES {
        let port = folder.join(line);
        write!(
            text,
            "[line.{line}]\nport = \"{}\"\n\
             [module.{line}]\nline = \"{line}\"\nmodel = \"erc8\"\naddress = 3\n",
            port.display()
        )
        .expect("text");
    }
    text
}

fn plug_all(folder: &Path) -> Vec<Adapter> {
    LINES
        .iter()
        .map(|line| Adapter::plug(folder.join(line)))
        .collect()
}

fn until_all(daemon: &Daemon, quality: &str) -> Duration {
    let start = Instant::now();
    daemon.until(quality, |daemon| {
        LINES
            .iter()
            .all(|line| daemon.quality(&format!("{line}.k1")) == quality)
    });
    start.elapsed()
}

/// What the daemon has used of a processor, in ticks of the clock.
fn ticks(daemon: &Daemon) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", daemon.child.id()));
    let stat = stat.expect("it runs");
    let after_name = stat.rsplit(')').next().expect("fields");
    let fields: Vec<&str> = after_name.split_whitespace().collect();
    [fields[11], fields[12]]
        .iter()
        .map(|field| field.parse::<u64>().expect("a number"))
        .sum()
}

#[test]
fn adapters_come_and_go_and_come_back_under_other_numbers() {
    let folder = Folder::new("adapters");
    let by_id = folder.0.join("by-id");
    std::fs::create_dir(&by_id).expect("a folder");
    let file = folder.file("railbus.toml", &site(&by_id));
    // It starts without any of them.
    let daemon = Daemon::start_in(folder, &["--config", file.to_str().expect("text")]);
    for line in LINES {
        assert_eq!(daemon.quality(&format!("{line}.k1")), "bad");
    }
    let lines = daemon.get("/lines")["lines"].clone();
    assert_eq!(lines[0]["reason"], "missing");

    let mut moved = 0;
    let mut decoys = Vec::new();
    let (mut lost, mut found) = (Duration::ZERO, Duration::ZERO);
    let mut before = Vec::new();
    for _ in 0..ROUNDS {
        let adapters = plug_all(&by_id);
        let devices: Vec<_> = adapters
            .iter()
            .map(|adapter| adapter.device.clone())
            .collect();
        moved += usize::from(!before.is_empty() && devices != before);
        before = devices;
        found = found.max(until_all(&daemon, "good"));
        drop(adapters);
        // Others take their numbers.
        decoys = LINES.iter().map(|_| terminal()).collect();
        lost = lost.max(until_all(&daemon, "bad"));
    }
    drop(decoys);
    // On a good day it is a tenth of a second and half a second.
    assert!(lost < HANGS && found < HANGS, "{lost:?}, {found:?}");
    assert!(moved > 0, "they had other numbers");

    // Without them it waits, and does not search without end.
    let (start, before) = (Instant::now(), ticks(&daemon));
    std::thread::sleep(Duration::from_secs(2));
    let used = Duration::from_millis((ticks(&daemon) - before) * 10);
    assert!(used < start.elapsed() / 4, "{used:?}");

    let _adapters = plug_all(&by_id);
    until_all(&daemon, "good");
    let answer = daemon.send("PUT", "/points/west/k2", &json!({"value": true}));
    assert_eq!(answer.status, 200, "{}", answer.body);
    assert_eq!(answer.json()["confirmed"], "readback");
}
