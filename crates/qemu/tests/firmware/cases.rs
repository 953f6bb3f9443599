//! The datasheets' cases, the very list that the simulator passes.

use crate::images;
use railbus_cases::{Case, all, run};
use railbus_device::{Options, Setup};
use railbus_qemu::Board;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Boards side by side. Most of the time each waits for silence.
const BOARDS: usize = 6;

/// A busy machine may hold up QEMU in the middle of a frame, which ends the frame: the module is
/// right not to answer. A firmware that is wrong is wrong each time.
const TRIES: u32 = 3;

#[test]
#[ignore = "needs QEMU and the images: cargo xtask firmware test"]
fn every_case_holds_of_the_firmware() {
    let cases = all().expect("lists that can be read");
    let runs: Vec<(&Case, &Setup)> = cases
        .iter()
        .flat_map(|case| case.modules.iter().map(move |setup| (case, setup)))
        .collect();
    let (next, again) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let failures = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..BOARDS {
            scope.spawn(|| {
                while let Some((case, setup)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let tries: Vec<String> = tries(case, setup);
                    again.fetch_add(usize::from(!tries.is_empty()), Ordering::Relaxed);
                    if tries.len() == TRIES as usize {
                        failures.lock().expect("no thread panics").extend(tries);
                    }
                }
            });
        }
    });
    let (failures, again) = (
        failures.into_inner().expect("no thread panics"),
        again.into_inner(),
    );
    println!(
        "{} runs of {} cases, {again} of them more than once",
        runs.len(),
        cases.len()
    );
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
    assert!(again <= runs.len() / 4, "{again} runs did not pass at once");
}

/// Why a case was not passed, for each try that failed.
fn tries(case: &Case, setup: &Setup) -> Vec<String> {
    let mut failed = Vec::new();
    for slower in 1..=TRIES {
        let board = Board::new(&images(), setup, Options::default());
        let result = match board.map(|board| board.slower(slower)) {
            Ok(mut board) => run(case, setup, &mut board).map_err(|failure| failure.to_string()),
            Err(error) => Err(format!("{}:{}: {error}", case.file, case.line)),
        };
        match result {
            Ok(()) => break,
            Err(why) => failed.push(why),
        }
    }
    failed
}
