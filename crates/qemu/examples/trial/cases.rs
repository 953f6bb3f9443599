//! The datasheets' cases, the very list that the simulator passes.

use crate::World;
use railbus_conformance::{Case, Subject, all, run};
use railbus_qemu::Board;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Boards side by side. Most of the time each waits for silence.
const BOARDS: usize = 6;

/// Passes all, and most of them at once.
pub(crate) fn every_case_holds(world: &World) -> Result<String, String> {
    let cases = all()?;
    let runs: Vec<(&Case, &Subject)> = cases
        .iter()
        .flat_map(|case| case.modules.iter().map(move |subject| (case, subject)))
        .collect();
    let (next, failures) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..BOARDS {
            scope.spawn(|| {
                while let Some((case, subject)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(why) = pass(&world.images, case, subject) {
                        failures.lock().expect("no thread panics").push(why);
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().expect("no thread panics");
    let done = format!("{} runs of {} cases", runs.len(), cases.len());
    if failures.is_empty() {
        Ok(done)
    } else {
        Err(format!("{done}\n{}", failures.join("\n")))
    }
}

/// Puts a module on a bench and runs a case with it.
fn pass(images: &Path, case: &Case, subject: &Subject) -> Result<(), String> {
    let board = Board::new(images, &subject.setup, subject.options);
    let board = board.map_err(|error| format!("{}:{}: {error}", case.file, case.line));
    run(case, &subject.setup, &mut board?).map_err(|failure| failure.to_string())
}
