//! The firmware in QEMU, held to what the simulator is held to. `cargo xtask firmware test` builds
//! the images and runs this.
//!
//! ```text
//! trial IMAGES RAILBUS [WORD...]
//! ```
//!
//! Words choose the trials that have one of them in their names.
#![allow(clippy::print_stdout, reason = "it is a program")]

mod burst;
mod cases;
mod five;
mod http;
mod same;
mod site;
mod truth;

#[path = "../../../sim/examples/soak/dice.rs"]
mod dice;
#[path = "../../../sim/examples/soak/oracle.rs"]
#[allow(dead_code, reason = "the soak adds up many runs")]
mod oracle;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Something that the firmware must do; what was seen, or why it failed.
type Trial = fn(&World) -> Result<String, String>;

/// One after another; those of a row side by side, as they mostly wait.
const TRIALS: &[&[(&str, Trial)]] = &[
    &[
        ("cases", cases::every_case_holds),
        ("same", same::the_same_bytes_get_the_same_replies),
    ],
    &[("burst", burst::no_frame_of_a_burst_is_lost)],
    &[
        ("five", five::railbus_runs_five_boards),
        ("truth", truth::what_is_told_is_so),
    ],
];

/// What a trial needs to know.
struct World {
    /// Where `cargo xtask firmware build` put the images.
    images: PathBuf,
    /// The program of the host.
    railbus: PathBuf,
}

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let (Some(images), Some(railbus)) = (args.next(), args.next()) else {
        println!("say where images and railbus are; `cargo xtask firmware test` does");
        return ExitCode::FAILURE;
    };
    let world = World {
        images: images.into(),
        railbus: railbus.into(),
    };
    let words: Vec<String> = args.collect();
    let wanted = |name: &str| words.is_empty() || words.iter().any(|word| name.contains(word));
    let mut passed = true;
    for row in TRIALS {
        std::thread::scope(|scope| {
            let wanted = row.iter().filter(|(name, _)| wanted(name));
            let running: Vec<_> = wanted
                .map(|(name, trial)| scope.spawn(|| run(name, *trial, &world)))
                .collect();
            for trial in running {
                passed &= trial.join().is_ok_and(|passed| passed);
            }
        });
    }
    if passed {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Whether a trial passes; prints that, and what was seen.
fn run(name: &str, trial: Trial, world: &World) -> bool {
    let began = Instant::now();
    let result = trial(world);
    let took = began.elapsed().as_secs();
    match &result {
        Ok(seen) => println!("passed {name} in {took} s: {seen}"),
        Err(why) => println!("FAILED {name} in {took} s: {why}"),
    }
    result.is_ok()
}
