//! The soak: many lines for many virtual hours under many faults, judged by what the modules
//! really did. A run is its seed.
//!
//! ```text
//! soak                              one seed of every cell
//! soak --seeds 18 --minutes 10      so many, for so long each
//! soak --check docs/soak.md         what CI runs: the floors, the mutation, the table
//! soak --write docs/soak.md         writes the table anew
//! soak --replay CAMPAIGN LINE SEED  one run, with its trace up to the first wrong thing
//! ```

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a command-line program"
)]

mod cells;
mod dice;
mod oracle;
mod plants;
mod run;
mod table;

use cells::{Cell, Size, run_all};
use run::Report;
use std::process::{Command, ExitCode};

/// What CI runs: 18 seeds of 60 cells for ten virtual minutes each.
const CHECK: Size = Size {
    from: 0,
    seeds: 18,
    minutes: 10,
};
/// The floors of that run: fewer is a failure.
const EXCHANGES_MIN: u64 = 10_000_000;
const FAULTS_MIN: u64 = 1_000_000;
const LINE_HOURS_MIN: f64 = 150.0;
/// Without ghosts the judge must find more misattributed values than this.
const WITHOUT_GHOSTS_MIN: u64 = 1_000;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let done = match words[..] {
        ["--check", path] => check(path),
        ["--write", path] => write(path),
        ["--replay", campaign, line, seed] => replay(campaign, line, seed),
        _ => soak(&words),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("soak: {why}");
            ExitCode::FAILURE
        }
    }
}

fn soak(words: &[&str]) -> Result<(), String> {
    let number = |flag: &str, standard: u64| {
        let at = words.iter().position(|word| *word == flag);
        let word = at.and_then(|at| words.get(at + 1));
        word.map_or(Ok(standard), |word| {
            word.parse().map_err(|_| format!("{flag} takes a number"))
        })
    };
    let size = Size {
        from: number("--from", 0)?,
        seeds: number("--seeds", 1)?,
        minutes: number("--minutes", 10)?,
    };
    let cells = run_all(&size, true);
    let sum = say_sum(&cells);
    print!("{}", table::render(&cells));
    is_true(&cells, &sum)
}

/// The floors, the truth, the mutation and the table.
fn check(path: &str) -> Result<(), String> {
    let cells = run_all(&CHECK, true);
    let sum = say_sum(&cells);
    is_true(&cells, &sum)?;
    let line_hours = sum.time as f64 / 3.6e9;
    if sum.exchanges < EXCHANGES_MIN || sum.faults < FAULTS_MIN || line_hours < LINE_HOURS_MIN {
        return Err(format!(
            "ran too little: at least {EXCHANGES_MIN} exchanges, {FAULTS_MIN} faults and \
             {LINE_HOURS_MIN} line-hours are wanted"
        ));
    }
    let without = run_all(&Size { seeds: 8, ..CHECK }, false);
    let found: u64 = without
        .iter()
        .map(|cell| cell.report.verdicts.misattributed)
        .sum();
    println!("without ghosts: {found} misattributed values found");
    if found <= WITHOUT_GHOSTS_MIN {
        return Err(format!(
            "without ghosts the judge found {found} misattributed values; more than \
             {WITHOUT_GHOSTS_MIN} are wanted, so it may have gone blind"
        ));
    }
    let kept = std::fs::read_to_string(path).map_err(|why| format!("{path}: {why}"))?;
    if kept != table::page(&cells, &sum) {
        return Err(format!(
            "{path} is not what this run gives; look at the difference after\n  \
             cargo run --profile soak -p railbus-sim --example soak -- --write {path}"
        ));
    }
    Ok(())
}

fn write(path: &str) -> Result<(), String> {
    let cells = run_all(&CHECK, true);
    let sum = say_sum(&cells);
    std::fs::write(path, table::page(&cells, &sum)).map_err(|why| format!("{path}: {why}"))
}

fn replay(campaign: &str, line: &str, seed: &str) -> Result<(), String> {
    let number = |word: &str| word.parse().map_err(|_| format!("{word} is no number"));
    let (campaign, line, seed) = (number(campaign)?, number(line)?, number(seed)?);
    let cell = Cell::new(campaign as usize, line as usize).ok_or("there is no such cell")?;
    let report = cell.run(seed, CHECK.minutes, true, 300);
    match report.first_wrong {
        Some(wrong) => Err(format!("{wrong}\n{}", report.trace)),
        None => Ok(()),
    }
}

fn say_sum(cells: &[Cell]) -> Report {
    let mut sum = Report::default();
    for cell in cells {
        sum.add(&cell.report);
    }
    let v = &sum.verdicts;
    println!(
        "{} exchanges, {} faults, {:.1} line-hours; {} readings, {} commands, {} late replies",
        sum.exchanges,
        sum.faults,
        sum.time as f64 / 3.6e9,
        v.readings,
        v.commands,
        sum.late
    );
    println!(
        "{} misattributed values, {} false confirmations, {} false denials, {} doubled actions",
        v.misattributed, v.falsely_confirmed, v.falsely_denied, v.doubled
    );
    sum
}

/// Nothing untrue was reported; otherwise prints seed, commit, and how to reproduce it.
fn is_true(cells: &[Cell], sum: &Report) -> Result<(), String> {
    let v = &sum.verdicts;
    if v.misattributed + v.falsely_confirmed + v.falsely_denied + v.doubled == 0 {
        return Ok(());
    }
    let wrong = cells
        .iter()
        .find_map(|cell| Some((cell, cell.report.first_wrong.as_ref()?)));
    let Some((cell, wrong)) = wrong else {
        return Err("something untrue was told".to_owned());
    };
    let seed = cell.report.wrong_seed;
    let again = cell.run(seed, CHECK.minutes, true, 80);
    Err(format!(
        "{wrong}\n  seed {seed}, commit {}, line \"{}\", faults \"{}\"\n  again: cargo run \
         --profile soak -p railbus-sim --example soak -- --replay {} {} {seed}\n{}",
        commit(),
        cell.line_name(),
        cell.campaign_name(),
        cell.campaign,
        cell.line,
        again.trace
    ))
}

fn commit() -> String {
    let git = Command::new("git")
        .args(["rev-parse", "--short", "HEAD"])
        .output();
    let text = git.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    text.unwrap_or_else(|_| "unknown".to_owned())
}
