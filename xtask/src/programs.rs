//! Programs in other folders of the repository that a command only starts.

use std::path::Path;

use crate::run::{self, Error, Result};

/// A program built by cargo from this repository.
pub(crate) struct Program {
    /// Files of which one, if present, shows that the program exists in this checkout.
    sources: &'static [&'static str],
    /// Arguments of cargo up to and including the separator `--`.
    cargo: &'static [&'static str],
    /// Arguments of the program if the caller gives none.
    defaults: &'static [&'static str],
}

/// The line in virtual time with seeded faults; without arguments what CI checks: the minimums, the
/// mutation and the table.
pub(crate) const SOAK: Program = Program {
    sources: &["crates/sim/examples/soak/main.rs"],
    cargo: &[
        "run",
        "--profile",
        "soak",
        "-p",
        "railbus-sim",
        "--example",
        "soak",
        "--",
    ],
    defaults: &["--check", "docs/soak.md"],
};

/// The real program between clients and modules that record what they did; a script.
pub(crate) const JUDGE: &str = "interop/judge/run.py";

/// Random bytes for decoders and engines. Two million inputs is the promised minimum.
pub(crate) const FUZZ: Program = Program {
    sources: &["fuzz/Cargo.toml"],
    cargo: &[
        "run",
        "--release",
        "--manifest-path",
        "fuzz/Cargo.toml",
        "--",
    ],
    defaults: &["--inputs", "2000000"],
};

/// Measurements; with `--check` the instruction counts are compared with the committed ones.
pub(crate) const BENCH: Program = Program {
    sources: &["bench/Cargo.toml"],
    cargo: &[
        "run",
        "--release",
        "--manifest-path",
        "bench/Cargo.toml",
        "--",
    ],
    defaults: &[],
};

/// The demo: a simulated site, served like a real one.
const DEMO: Program = Program {
    sources: &["crates/railbus/Cargo.toml"],
    cargo: &["run", "--profile", "demo", "-p", "railbus", "--"],
    defaults: &["serve", "--demo"],
};

/// Builds railbus itself for the tests. One of its tests is built with it, so that cargo chooses
/// the features that it chose for all tests: without, it builds half of everything a second time.
/// `interop/` has the same words.
pub(crate) fn railbus(root: &Path) -> Result<()> {
    let args = ["build", "--workspace", "--bin=railbus", "--test=packaging"];
    run::run(&mut run::cargo(root, &args))
}

impl Program {
    /// Builds it and does not run it.
    pub(crate) fn build(&self, root: &Path) -> Result<()> {
        let words = self.cargo.iter().filter(|&&word| word != "--");
        let words = words.map(|&word| if word == "run" { "build" } else { word });
        run::run(run::cargo(root, &[]).args(words))
    }

    /// Why the program can't run; none if it can.
    pub(crate) fn missing(&self, root: &Path) -> Option<String> {
        let there = |source: &&str| root.join(source).is_file();
        (!self.sources.iter().any(there)).then(|| format!("there is no {} yet", self.sources[0]))
    }

    /// Builds and runs it. `args` replace the default arguments.
    pub(crate) fn run(&self, root: &Path, args: &[String]) -> Result<()> {
        run::run(&mut self.command(root, args)?)
    }

    fn command(&self, root: &Path, args: &[String]) -> Result<std::process::Command> {
        if let Some(why) = self.missing(root) {
            return Err(Error::new(
                why,
                "this command works once that file is there",
            ));
        }
        let mut command = run::cargo(root, self.cargo);
        if args.is_empty() {
            command.args(self.defaults);
        }
        command.args(args);
        Ok(command)
    }
}

/// Soaks a simulated line, or with `--daemon` as first argument the whole program.
pub(crate) fn soak(root: &Path, args: &[String]) -> Result<()> {
    match args.split_first() {
        Some((first, rest)) if first == "--daemon" => judge(root, rest),
        _ => SOAK.run(root, args),
    }
}

/// The judge around the daemon. It needs only Python itself.
pub(crate) fn judge(root: &Path, args: &[String]) -> Result<()> {
    run::run(run::program(root, "python3").arg(JUDGE).args(args))
}

/// Runs the demo until it is stopped: a site, or with `--fleet` as first argument several of them
/// behind a centre.
pub(crate) fn demo(root: &Path, args: &[String]) -> Result<()> {
    if let Some((first, rest)) = args.split_first()
        && first == "--qemu"
    {
        return crate::firmware::demo(root, rest);
    }
    crate::web::build_or_tell(root);
    if let Some((first, rest)) = args.split_first()
        && first == "--fleet"
    {
        let server = crate::peers::nats_server(root)?.display().to_string();
        let mut words = ["fleet", "demo", "--nats-server", &server]
            .map(str::to_owned)
            .to_vec();
        words.extend_from_slice(rest);
        return run::run_attended(&mut DEMO.command(root, &words)?);
    }
    run::run_attended(&mut DEMO.command(root, args)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(args: &[&str]) -> Vec<String> {
        let args: Vec<String> = args.iter().map(|&arg| arg.to_owned()).collect();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/programs");
        let command = FUZZ.command(&root, &args).unwrap();
        command
            .get_args()
            .map(|word| word.to_string_lossy().into_owned())
            .collect()
    }

    #[test]
    fn arguments_replace_the_defaults() {
        assert_eq!(words(&[])[4..], ["--", "--inputs", "2000000"]);
        assert_eq!(words(&["--inputs", "5"])[4..], ["--", "--inputs", "5"]);
    }

    #[test]
    fn a_program_that_does_not_exist_yet_is_named() {
        let error = BENCH
            .run(Path::new("no-such-folder"), &[])
            .unwrap_err()
            .to_string();
        assert!(
            error.starts_with("there is no bench/Cargo.toml yet"),
            "{error}"
        );
    }
}
