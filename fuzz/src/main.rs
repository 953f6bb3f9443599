//! Feeds every target from a seed.
//!
//! ```text
//! railbus-fuzz --inputs N --seed S [--target NAME]
//! railbus-fuzz --target NAME --input HEX      one input, to reproduce a failure
//! ```
//! The corpus are the frames of `vectors/*.json`. A failure prints the line that reproduces it
//! and ends the program with 1.

use railbus_fuzz::generate::Random;
use railbus_fuzz::targets::{TARGETS, Target};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::ExitCode;

/// The arguments of the command line.
struct Options {
    inputs: u64,
    seed: u64,
    target: Option<String>,
    input: Option<Vec<u8>>,
}

fn main() -> ExitCode {
    match options().and_then(|options| run(&options)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("railbus-fuzz: {why}");
            ExitCode::FAILURE
        }
    }
}

fn options() -> Result<Options, String> {
    let mut options = Options {
        inputs: 200_000,
        seed: 1,
        target: None,
        input: None,
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let value = args
            .next()
            .ok_or_else(|| format!("`{arg}` needs a value"))?;
        let number = || value.parse().map_err(|_| format!("`{value}` is no number"));
        match arg.as_str() {
            "--inputs" => options.inputs = number()?,
            "--seed" => options.seed = number()?,
            "--target" => options.target = Some(value),
            "--input" => options.input = Some(unhex(&value)?),
            _ => return Err(format!("`{arg}` is not known")),
        }
    }
    Ok(options)
}

fn run(options: &Options) -> Result<(), String> {
    let wanted = |name: &str| options.target.as_deref().is_none_or(|only| only == name);
    let targets: Vec<Target> = TARGETS
        .iter()
        .filter(|(name, _)| wanted(name))
        .copied()
        .collect();
    if targets.is_empty() {
        let names: Vec<&str> = TARGETS.iter().map(|(name, _)| *name).collect();
        return Err(format!("no such target; there are {}", names.join(" ")));
    }
    if let Some(input) = &options.input {
        return targets.iter().try_for_each(|target| feed(target, input));
    }
    let corpus = corpus()?;
    println!("corpus: {} frames, seed: {}", corpus.len(), options.seed);
    let mut random = Random::new(options.seed);
    let mut fed = vec![0u64; targets.len()];
    for _ in 0..options.inputs {
        let chosen = random.below(targets.len());
        let input = random.input(&corpus);
        feed(&targets[chosen], &input).map_err(|why| format!("seed {}: {why}", options.seed))?;
        fed[chosen] += 1;
    }
    for ((name, _), count) in targets.iter().zip(&fed) {
        println!("{name:<16} {count:>9}");
    }
    println!("inputs: {}", fed.iter().sum::<u64>());
    Ok(())
}

/// Runs one input; a panic, whose message is on standard error by then, is a failure.
fn feed((name, target): &Target, input: &[u8]) -> Result<(), String> {
    catch_unwind(AssertUnwindSafe(|| target(input))).map_err(|_| {
        let hex: String = input.iter().map(|byte| format!("{byte:02X}")).collect();
        format!("reproduce with --target {name} --input {hex}")
    })
}

/// All frames of all vectors, valid and invalid ones.
fn corpus() -> Result<Vec<Vec<u8>>, String> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../vectors"));
    let mut frames = Vec::new();
    for file in ["rtu", "ascii", "lc02", "r55", "lcus"] {
        let path = folder.join(format!("{file}.json"));
        let text = std::fs::read_to_string(&path)
            .map_err(|why| format!("{} cannot be read: {why}", path.display()))?;
        let vectors: Vec<serde_json::Value> =
            serde_json::from_str(&text).map_err(|why| format!("{}: {why}", path.display()))?;
        for vector in &vectors {
            for key in ["hex", "corrected"] {
                if let Some(hex) = vector[key].as_str() {
                    frames.push(unhex(hex)?);
                }
            }
        }
    }
    Ok(frames)
}

/// The bytes of hexadecimal digits, with or without blanks.
fn unhex(text: &str) -> Result<Vec<u8>, String> {
    let digits: Option<Vec<u8>> = text
        .chars()
        .filter(|c| !c.is_whitespace())
        .map(|c| c.to_digit(16).and_then(|digit| u8::try_from(digit).ok()))
        .collect();
    match digits {
        Some(digits) if digits.len().is_multiple_of(2) => Ok(digits
            .chunks(2)
            .map(|pair| pair[0] << 4 | pair[1])
            .collect()),
        _ => Err(format!("`{text}` is not hexadecimal")),
    }
}
