//! The serial ports of this machine.

use crate::i18n::Lang;
use crate::render::records::Records;
use crate::render::table::Table;
use crate::texts::Text;
use serde_json::json;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Only these are adapters; a PC's own ttyS0 to ttyS31 mostly lead nowhere.
const KINDS: [&str; 5] = ["ttyUSB", "ttyACM", "ttyAMA", "ttySC", "ttyAP"];

pub(super) fn records(lang: Lang) -> Records {
    let stable = stable_names();
    let mut table = Table::new(lang.get(Text::LsPortsHead).split('|'));
    let mut rows = Vec::new();
    for name in names() {
        let device = Path::new("/dev").join(&name);
        let stable = stable.get(&device).map(|path| path.display().to_string());
        let driver = driver(&name);
        let latency = latency(&name);
        let dash = || "–".to_owned();
        table.add([
            device.display().to_string(),
            driver.clone().unwrap_or_else(dash),
            latency.map_or_else(dash, |millis| format!("{millis} ms")),
            stable.clone().unwrap_or_else(dash),
        ]);
        rows.push(json!({
            "port": device, "driver": driver, "latency_timer_ms": latency, "stable": stable,
        }));
    }
    Records {
        key: "ports",
        rows,
        columns: &["port", "driver", "latency_timer_ms", "stable"],
        value: "port",
        table,
    }
}

fn names() -> Vec<String> {
    let entries = fs::read_dir("/sys/class/tty")
        .into_iter()
        .flatten()
        .flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| KINDS.iter().any(|kind| name.starts_with(kind)))
        .collect();
    names.sort();
    names
}

/// The names that stay the same wherever an adapter is plugged in.
fn stable_names() -> BTreeMap<PathBuf, PathBuf> {
    let entries = fs::read_dir("/dev/serial/by-id")
        .into_iter()
        .flatten()
        .flatten();
    let pair = |path: PathBuf| Some((fs::canonicalize(&path).ok()?, path));
    entries.filter_map(|entry| pair(entry.path())).collect()
}

fn driver(name: &str) -> Option<String> {
    let link = Path::new("/sys/class/tty").join(name).join("device/driver");
    let target = fs::read_link(link).ok()?;
    Some(target.file_name()?.to_str()?.to_owned())
}

/// How long an FTDI adapter keeps what it hears.
fn latency(name: &str) -> Option<u32> {
    let path = Path::new("/sys/class/tty")
        .join(name)
        .join("device/latency_timer");
    fs::read_to_string(path).ok()?.trim().parse().ok()
}
