//! The project's own commands, so that nobody has to remember a shell line: `cargo xtask demo`,
//! `cargo xtask test`, `cargo xtask tidy` and the rest.
//!
//! Where to look: [`COMMANDS`] is the list of commands, `test.rs` the list of steps of a whole test
//! run, `tidy/mod.rs` the list of checks, `programs.rs` the list of programs in other folders,
//! `peers.rs` the list of third-party programs that the tests talk to.

// A command line tool prints to standard output and standard error.
#![allow(clippy::print_stdout, clippy::print_stderr)]

mod firmware;
mod peers;
mod programs;
mod run;
mod start;
mod steps;
mod test;
mod tidy;
mod web;

use std::path::Path;
use std::process::ExitCode;

use run::{Error, Result};

/// One command of `cargo xtask`.
struct Command {
    name: &'static str,
    /// One line for `--help`.
    help: &'static str,
    /// Takes the root of the repository and the arguments after the command's name.
    run: fn(&Path, &[String]) -> Result<()>,
}

const COMMANDS: &[Command] = &[
    Command {
        name: "demo",
        help: "build the product and show it at work; --qemu: the modules run our firmware; \
               --fleet: three sites and their centre",
        run: programs::demo,
    },
    Command {
        name: "test",
        help: "every test there is, from formatting to foreign peers [--quick|--without-peers]",
        run: test::run,
    },
    Command {
        name: "ci",
        help: "what .ci/run does: the same as test",
        run: test::run,
    },
    Command {
        name: "screenshots",
        help: "the README's pictures, taken of the demo in a browser",
        run: web::screenshots,
    },
    Command {
        name: "tidy",
        help: "check the project's invariants",
        run: tidy::run,
    },
    Command {
        name: "web",
        help: "build and check the web pages that the program has inside",
        run: web::run,
    },
    Command {
        name: "soak",
        help: "simulated lines with faults; --daemon [--seconds N] [--seed S]: the whole program",
        run: programs::soak,
    },
    Command {
        name: "fuzz",
        help: "random input to the decoders [--inputs N --seed S]",
        run: |root, args| programs::FUZZ.run(root, args),
    },
    Command {
        name: "bench",
        help: "measure; with --check compare instruction counts with the committed ones",
        run: |root, args| programs::BENCH.run(root, args),
    },
    Command {
        name: "start",
        help: "how long commands take from their start, beside mbpoll [--as-built]",
        run: start::run,
    },
    Command {
        name: "firmware",
        help: "images for a board [build [--family F] | test [WORD...] | size [--update]]",
        run: firmware::run,
    },
    Command {
        name: "firmware-check",
        help: "build the no_std crates for a microcontroller",
        run: firmware::check,
    },
];

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let Some((name, rest)) = args.split_first() else {
        eprint!("{}", usage());
        return ExitCode::from(2);
    };
    if matches!(name.as_str(), "help" | "--help" | "-h") {
        print!("{}", usage());
        return ExitCode::SUCCESS;
    }
    let Some(command) = COMMANDS.iter().find(|command| command.name == name) else {
        eprint!("xtask: there is no command `{name}`\n\n{}", usage());
        return ExitCode::from(2);
    };
    match (command.run)(&run::repository(), rest) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if !matches!(error, Error::OnScreen) {
                eprintln!("xtask {name}: {error}");
            }
            ExitCode::FAILURE
        }
    }
}

fn usage() -> String {
    let mut text = String::from("usage: cargo xtask <command>\n\n");
    for command in COMMANDS {
        text.push_str(&format!("  {:<15} {}\n", command.name, command.help));
    }
    text
}

/// Refuses arguments of commands that take none: a mistyped flag must not be ignored.
fn no_arguments(args: &[String]) -> Result<()> {
    match args.first() {
        None => Ok(()),
        Some(arg) => Err(Error::new(
            format!("`{arg}` is not understood, this command takes no arguments"),
            "run it without",
        )),
    }
}
