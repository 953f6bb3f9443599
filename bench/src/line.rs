//! The whole line master on a line that takes no time: its overhead over the floor.

use crate::count::{self, What};
use crate::master::{Master, PEERS};
use crate::responder::Pty;
use crate::scene::Scene;
use crate::table::{Table, median};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// The most user instructions that one exchange of the whole line master may cost.
pub const INSTRUCTIONS_MAX: u64 = 3_350;
/// The most microseconds that it may add to the floor, at the median.
pub const ADDED_MAX: f64 = 3.0;

/// Exchanges timed in one round, and warm-up exchanges before them.
const EXCHANGES: usize = 3_000;
const WARM_UP: usize = 200;
const ROUNDS: usize = 15;

/// All masters, in the order of the table.
const MASTERS: [Master; 6] = [
    Master::Floor,
    Master::Ours,
    Master::Commands,
    PEERS[0],
    PEERS[1],
    PEERS[2],
];

/// Measures all masters and gives the table.
pub fn table() -> Result<Table, String> {
    let mut table = Table::new(&[
        "master",
        "user instructions",
        "allocations",
        "median of an exchange, µs",
        "added to the floor, µs",
    ]);
    let times = times()?;
    let floor = times[0].unwrap_or_default();
    for (master, time) in MASTERS.into_iter().zip(times) {
        let Some(time) = time else {
            table.row(&[master.name(), "not installed", "", "", ""]);
            continue;
        };
        let counted = |what| match master {
            // Its interpreter would take minutes under valgrind.
            Master::Pymodbus => Ok("not counted".to_owned()),
            _ => per_exchange(master, what).map(|count| match what {
                What::Instructions => format!("{count:.0}"),
                What::Allocations => format!("{count:.2}"),
            }),
        };
        table.row(&[
            master.name(),
            &counted(What::Instructions)?,
            &counted(What::Allocations)?,
            &format!("{time:.1}"),
            &format!("{:.1}", time - floor),
        ]);
    }
    Ok(table)
}

/// The user instructions of one exchange of our own masters, polling and commanding: what does not
/// depend on the machine's load.
pub fn counts() -> Result<Table, String> {
    let mut table = Table::new(&["master", "user instructions"]);
    for master in [Master::Ours, Master::Commands] {
        let count = per_exchange(master, What::Instructions)?;
        table.row(&[master.name(), &format!("{count:.0}")]);
    }
    Ok(table)
}

/// The user instructions or allocations of one exchange: the difference of two runs.
pub fn per_exchange(master: Master, what: What) -> Result<f64, String> {
    let (few, many) = (1_000, 3_000);
    let total = |count: usize| {
        let (scene, pty) = (Scene::new("rtu", 0)?, Pty::new()?);
        let start = master
            .start(("rtu", 0), &pty.path, count)
            .ok_or("it is not installed")?;
        let program = count::start(what, &start)?;
        let asked = pty.serve(&scene, None)?.len();
        Ok::<_, String>((count::end(what, program)?, asked))
    };
    let ((fewer, asked_few), (more, asked_many)) = (total(few)?, total(many)?);
    Ok(more.saturating_sub(fewer) as f64 / (asked_many - asked_few) as f64)
}

/// The median time from one request to the next in the quietest round, in microseconds. Both ends
/// share one core, so this is work and not the wake-up of another core.
fn times() -> Result<Vec<Option<f64>>, String> {
    let everywhere = sched_getaffinity(None).map_err(|why| why.to_string())?;
    let mut one = CpuSet::new();
    one.set(
        (0..CpuSet::MAX_CPU)
            .find(|cpu| everywhere.is_set(*cpu))
            .unwrap_or(0),
    );
    sched_setaffinity(None, &one).map_err(|why| why.to_string())?;
    let mut rounds = vec![Vec::new(); MASTERS.len()];
    for _ in 0..ROUNDS {
        for (master, rounds) in MASTERS.into_iter().zip(&mut rounds) {
            rounds.extend(time(master)?);
        }
    }
    sched_setaffinity(None, &everywhere).map_err(|why| why.to_string())?;
    Ok(rounds
        .into_iter()
        .map(|times| times.into_iter().min_by(f64::total_cmp))
        .collect())
}

fn time(master: Master) -> Result<Option<f64>, String> {
    let (scene, pty) = (Scene::new("rtu", 0)?, Pty::new()?);
    let Some(mut start) = master.start(("rtu", 0), &pty.path, EXCHANGES) else {
        return Ok(None);
    };
    let mut program = start.spawn().map_err(|why| why.to_string())?;
    let record = pty.serve(&scene, None)?;
    program.wait().map_err(|why| why.to_string())?;
    let mut periods: Vec<f64> = record
        .windows(2)
        .skip(WARM_UP)
        .map(|pair| (pair[1].began - pair[0].began).as_nanos() as f64 / 1000.0)
        .collect();
    Ok((!periods.is_empty()).then(|| median(&mut periods)))
}
