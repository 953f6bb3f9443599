//! The line master on a line whose characters take their time: how close it comes to the limit of
//! the line, and whether it keeps the silence.

use crate::master::{Master, PEERS};
use crate::responder::{Heard, Pty, Wire};
use crate::scene::{NAMES, Scene};
use crate::table::{Table, median};
use std::process::Stdio;

/// The speeds measured.
const BAUDS: [u32; 3] = [9_600, 38_400, 115_200];
/// How long each run takes, about, and how many runs of each there are.
const SECONDS: f64 = 1.0;
const ROUNDS: usize = 3;
/// Requests at the start that are not counted: after opening the port the line master gives the
/// first 20 replies time to come twice.
pub const WARM_UP: usize = 25;

/// How many requests are sent to the module that insists on the silence.
pub const STRICT: usize = 40;

/// One run.
struct Run {
    /// The fraction of the limit reached, at most 1 if the silence is kept.
    reached: f64,
    /// The limit in exchanges per second.
    limit: f64,
    too_early: usize,
    requests: usize,
}

/// Measures everything: the table of the wires, and that of the module that insists.
pub fn tables() -> Result<[Table; 2], String> {
    Ok([wires()?, strict()?])
}

fn wires() -> Result<Table, String> {
    let mut table = Table::new(&[
        "line",
        "baud",
        "limit/s",
        "floor",
        "railbus",
        "railbus to floor",
        "too early",
        "libmodbus",
        "tokio-modbus",
        "pymodbus async",
    ]);
    for scene in NAMES {
        for baud in BAUDS {
            let mut masters = vec![Master::Floor, Master::Ours];
            if scene == "rtu" {
                masters.extend(PEERS);
            }
            let mut runs: Vec<Vec<Run>> = masters.iter().map(|_| Vec::new()).collect();
            for _ in 0..ROUNDS {
                for (master, runs) in masters.iter().zip(&mut runs) {
                    runs.extend(run(*master, scene, baud)?);
                }
            }
            let reached = |of: usize| {
                let runs = runs.get(of).filter(|runs| !runs.is_empty())?;
                let mut reached: Vec<f64> = runs.iter().map(|run| run.reached).collect();
                Some(median(&mut reached))
            };
            let early = |of: usize| {
                let count = |field: fn(&Run) -> usize| runs[of].iter().map(field).sum::<usize>();
                (count(|run| run.too_early), count(|run| run.requests))
            };
            let (floor, ours) = (reached(0).unwrap_or(0.0), reached(1).unwrap_or(0.0));
            let limit = runs[1].first().map_or(0.0, |run| run.limit);
            let (too_early, requests) = early(1);
            let mut cells = vec![
                scene.to_owned(),
                baud.to_string(),
                format!("{limit:.1}"),
                percent(floor),
                percent(ours),
                percent(ours / floor),
                format!("{too_early} of {requests}"),
            ];
            for (of, _) in (2..).zip(PEERS) {
                cells.push(reached(of).map_or(String::new(), |reached| {
                    let (too_early, requests) = early(of);
                    let share = too_early as f64 / requests as f64;
                    format!("{}, {:.0} % early", percent(reached), share * 100.0)
                }));
            }
            let cells: Vec<&str> = cells.iter().map(String::as_str).collect();
            table.row(&cells);
        }
    }
    Ok(table)
}

fn percent(part: f64) -> String {
    format!("{:.1} %", part * 100.0)
}

/// One run of a master on a line; nothing where the master is not installed.
fn run(master: Master, name: &str, baud: u32) -> Result<Option<Run>, String> {
    let scene = Scene::new(name, baud)?;
    let wire = Wire {
        baud,
        strict: false,
        spins: true,
    };
    let round: f64 = scene
        .reads
        .iter()
        .map(|step| {
            let characters = (step.request.len() + step.reply.len()) as u32;
            let micros = scene.turnaround.0 + step.gap.0;
            (wire.character() * characters).as_secs_f64() + micros as f64 / 1e6
        })
        .sum();
    let limit = scene.reads.len() as f64 / round;
    let count = (SECONDS * limit) as usize + WARM_UP;
    let Some(record) = record(master, (name, baud), count, wire)? else {
        return Ok(None);
    };
    let record = record.get(WARM_UP..).unwrap_or_default();
    let (Some(first), Some(last)) = (record.first(), record.last()) else {
        return Err(format!("{} asks nothing", master.name()));
    };
    // The minimum: the wire's own time, and the silence that each request needs.
    let needed: f64 = record
        .windows(2)
        .map(|pair| ((pair[0].ended - pair[0].began) + pair[1].gap).as_secs_f64())
        .sum();
    Ok(Some(Run {
        reached: needed / (last.began - first.began).as_secs_f64(),
        limit,
        too_early: record.iter().filter(|heard| heard.too_early).count(),
        requests: record.len(),
    }))
}

fn strict() -> Result<Table, String> {
    let mut table = Table::new(&["master", "answers", "requests"]);
    for master in [Master::Floor, Master::Ours].into_iter().chain(PEERS) {
        match answers(master)? {
            Some(answers) => table.row(&[master.name(), &answers.to_string(), &STRICT.to_string()]),
            None => table.row(&[master.name(), "not installed", ""]),
        }
    }
    Ok(table)
}

/// How many of 40 requests are answered by a module that insists on 3.5 silent characters, at 9600.
pub fn answers(master: Master) -> Result<Option<usize>, String> {
    let wire = Wire {
        baud: 9_600,
        strict: true,
        spins: true,
    };
    let record = record(master, ("rtu", wire.baud), STRICT, wire)?;
    Ok(record.map(|record| {
        let asked = record.iter().take(STRICT);
        asked.filter(|heard| heard.answered).count()
    }))
}

/// How many of our requests came too early, and of how many.
pub fn too_early(scene: &str, baud: u32) -> Result<(usize, usize), String> {
    let run = run(Master::Ours, scene, baud)?.ok_or("the line master is not there")?;
    Ok((run.too_early, run.requests))
}

fn record(
    master: Master,
    scene: (&str, u32),
    count: usize,
    wire: Wire,
) -> Result<Option<Vec<Heard>>, String> {
    let (what, pty) = (Scene::new(scene.0, scene.1)?, Pty::new()?);
    let Some(mut start) = master.start(scene, &pty.path, count) else {
        return Ok(None);
    };
    let program = start.stdout(Stdio::null()).spawn();
    let mut program = program.map_err(|why| why.to_string())?;
    let record = pty.serve(&what, Some(wire));
    if record.is_err() {
        let _ = program.kill();
    }
    program.wait().map_err(|why| why.to_string())?;
    record.map(Some)
}
