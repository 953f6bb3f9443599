//! The datasheets' cases, the very list that the simulator passes.

use crate::World;
use railbus_cases::{Case, Subject, all, run};
use railbus_qemu::Board;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Boards side by side. Most of the time each waits for silence.
const BOARDS: usize = 6;

/// What is not passed side by side has so many tries alone: a busy machine may hold up QEMU in
/// the middle of a frame that gets no reply. A firmware that is wrong is wrong each time.
const TRIES: u32 = 4;

/// Passes all, and most of them at once.
pub(crate) fn every_case_holds(world: &World) -> Result<String, String> {
    let cases = all()?;
    let runs: Vec<(&Case, &Subject)> = cases
        .iter()
        .flat_map(|case| case.modules.iter().map(move |subject| (case, subject)))
        .collect();
    let (next, repeated) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let again = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..BOARDS {
            scope.spawn(|| {
                while let Some((case, subject)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    match once(&world.images, case, subject, 1) {
                        Ok(times) => _ = repeated.fetch_add(times, Ordering::Relaxed),
                        Err(_) => again
                            .lock()
                            .expect("no thread panics")
                            .push((*case, *subject)),
                    }
                }
            });
        }
    });
    let again = again.into_inner().expect("no thread panics");
    let failures: Vec<String> = again
        .iter()
        .filter_map(|(case, subject)| tries(&world.images, case, subject))
        .collect();
    let done = format!(
        "{} runs of {} cases, {} requests sent again, {} cases tried again",
        runs.len(),
        cases.len(),
        repeated.into_inner(),
        again.len(),
    );
    if failures.is_empty() {
        Ok(done)
    } else {
        Err(format!("{done}\n{}", failures.join("\n")))
    }
}

/// Why a case was not passed, where no try was good.
fn tries(images: &Path, case: &Case, subject: &Subject) -> Option<String> {
    let mut why = String::new();
    for slower in 1..=TRIES {
        match once(images, case, subject, slower) {
            Ok(_) => return None,
            Err(error) => why = error,
        }
    }
    Some(why)
}

/// How many requests had to be sent again, or why the case was not passed.
fn once(images: &Path, case: &Case, subject: &Subject, slower: u32) -> Result<usize, String> {
    let board = Board::new(images, &subject.setup, subject.options);
    let board = board.map_err(|error| format!("{}:{}: {error}", case.file, case.line));
    let mut board = board?.slower(slower);
    run(case, &subject.setup, &mut board).map_err(|failure| failure.to_string())?;
    Ok(board.repeated() as usize)
}
