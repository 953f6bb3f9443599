//! The demo with boards in QEMU instead of simulated modules.

use crate::signals;
use railbus_conformance::{Bench, Outside};
use railbus_device::Options;
use railbus_qemu::{Board, Folder, Hub, Pty};
use railbus_sim::demo;
use railbus_wire::Instant;
use rustix::process::{Pid, Signal, kill_process};
use std::path::Path;
use std::process::{Child, Command};
use std::sync::mpsc;
use std::time::{self, Duration};

/// How often the inputs are updated.
const STEP: Duration = Duration::from_millis(250);

/// Runs until `railbus serve` ends, because of Ctrl-C or a signal to us.
pub(crate) fn run(images: &str, railbus: &str, args: &[String]) -> Result<(), String> {
    let (asked, asked_to_end) = mpsc::sync_channel(1);
    signals::tell(asked, ()).map_err(said)?;
    let folder = Folder::new().map_err(said)?;
    let hub = Hub::new();
    let mut boards = Vec::new();
    for (name, setup) in demo::modules() {
        let mut board = Board::new(Path::new(images), &setup, Options::default()).map_err(said)?;
        board.join(&hub).map_err(said)?;
        println!(
            "{name:<8}{} in QEMU, address {}",
            setup.family, setup.address.0
        );
        boards.push((name, board));
    }
    let link = folder.path().join("line");
    let pty = Pty::open(&link).map_err(said)?;
    pty.join(&hub).map_err(said)?;
    let config = folder.path().join("railbus.toml");
    let text = include_str!("../../plant/src/demo.toml");
    let port = format!("pty:{}", link.display());
    std::fs::write(&config, text.replace("PORT", &port)).map_err(said)?;
    println!("line    {}", link.display());
    let mut serve = Command::new(railbus)
        .arg("serve")
        .arg("--config")
        .arg(&config)
        .args(args)
        .spawn()
        .map_err(|error| format!("{railbus}: {error}"))?;
    let began = time::Instant::now();
    loop {
        if let Some(status) = serve.try_wait().map_err(said)? {
            return if status.success() {
                Ok(())
            } else {
                Err(format!("serve: {status}"))
            };
        }
        let now = Instant(began.elapsed().as_micros() as u64);
        for (name, board) in &mut boards {
            let outside = moved(name, board.outside(), now);
            if outside != *board.outside() {
                board.surround(&outside).map_err(said)?;
            }
        }
        if asked_to_end.recv_timeout(STEP).is_ok() {
            stop(&serve);
        }
    }
}

/// Asks it to end; it may have been asked already, since Ctrl-C goes to all programs of a terminal.
fn stop(serve: &Child) {
    // It may have ended by itself.
    let _ = kill_process(Pid::from_child(serve), Signal::TERM);
}

/// The surroundings of a module of the demo at a time.
fn moved(name: &str, outside: &Outside, now: Instant) -> Outside {
    let mut outside = *outside;
    match name {
        "pump" => outside.levels = demo::pump_inputs(now),
        "gate" => outside.levels = demo::gate_inputs(now),
        "tank" => outside.analogs = demo::tank_analogs(now),
        _ => {}
    }
    outside
}

fn said(error: impl std::fmt::Display) -> String {
    error.to_string()
}
