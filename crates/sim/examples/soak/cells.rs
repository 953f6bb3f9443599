//! The cells of the table: every kind of line under every kind of fault.

use crate::plants::{CAMPAIGNS, LINES, plant};
use crate::run::{Report, Script, run};
use railbus_wire::Micros;

/// How much is run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Size {
    /// The first seed.
    pub(crate) from: u64,
    /// How many seeds of each cell.
    pub(crate) seeds: u64,
    /// Virtual minutes of each.
    pub(crate) minutes: u64,
}

/// A kind of line under a kind of fault.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    pub(crate) campaign: usize,
    pub(crate) line: usize,
    pub(crate) report: Report,
}

impl Cell {
    /// The cell of these numbers, if there is one.
    pub(crate) fn new(campaign: usize, line: usize) -> Option<Cell> {
        let exists = campaign < CAMPAIGNS.len() && line < LINES.len();
        exists.then(|| Cell {
            campaign,
            line,
            report: Report::default(),
        })
    }

    pub(crate) fn campaign_name(&self) -> &'static str {
        CAMPAIGNS[self.campaign].0
    }

    pub(crate) fn line_name(&self) -> &'static str {
        LINES[self.line].0
    }

    /// Runs one seed; with a trace of so many entries it ends at the first wrong thing.
    pub(crate) fn run(&self, seed: u64, minutes: u64, ghosts: bool, trace: usize) -> Report {
        let busy = !seed.is_multiple_of(4);
        let script = Script {
            time: Micros::from_secs(60 * minutes),
            command_every: Micros::from_millis(if busy { 300 } else { 1500 }),
            change_every: Micros::from_millis(400),
            poll_every: Micros::from_millis(if busy { 0 } else { 500 }),
            ghosts,
            stop_at_wrong: trace > 0,
        };
        let mut plant = plant(self.line, self.campaign, seed);
        plant.line.trace = trace;
        run(&plant, seed, &script)
    }
}

/// Runs all cells, on as many threads as there are processors.
pub(crate) fn run_all(size: &Size, ghosts: bool) -> Vec<Cell> {
    let mut cells: Vec<Cell> = (0..CAMPAIGNS.len())
        .flat_map(|campaign| (0..LINES.len()).filter_map(move |line| Cell::new(campaign, line)))
        .collect();
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let share = cells.len().div_ceil(workers);
    std::thread::scope(|scope| {
        for part in cells.chunks_mut(share) {
            scope.spawn(move || {
                for cell in part {
                    for seed in size.from..size.from + size.seeds {
                        let report = cell.run(seed, size.minutes, ghosts, 0);
                        if report.first_wrong.is_some() && cell.report.first_wrong.is_none() {
                            cell.report.first_wrong.clone_from(&report.first_wrong);
                            cell.report.wrong_seed = seed;
                        }
                        cell.report.add(&report);
                    }
                }
            });
        }
    });
    cells
}
