//! `cargo xtask test`: everything that shows whether this checkout is good, in one command.

use std::path::Path;

use crate::programs::{self, BENCH, FUZZ, JUDGE, Program, SOAK};
use crate::run::{self, Error, Result, cargo};
use crate::steps::Summary;
use crate::{firmware, peers, tidy, web};

/// One step of the run.
struct Step {
    name: &'static str,
    /// It says nothing useful on a machine without the third-party peers.
    needs_peers: bool,
    /// Why the step does not apply to this checkout or machine; none if it does.
    skip: fn(&Path) -> Option<String>,
    run: fn(&Path) -> Result<()>,
}

const FMT: Step = Step {
    name: "fmt",
    needs_peers: false,
    skip: always,
    run: fmt,
};

const TIDY: Step = Step {
    name: "tidy",
    needs_peers: false,
    skip: always,
    run: |root| tidy::run(root, &[]),
};

const CLIPPY: Step = Step {
    name: "clippy",
    needs_peers: false,
    skip: always,
    run: clippy,
};

/// The steps for every save: no port, no process, no page.
const QUICK: &[Step] = &[
    FMT,
    TIDY,
    CLIPPY,
    Step {
        name: "unit tests",
        needs_peers: false,
        skip: always,
        run: |root| nextest(root, &["--lib", "--bins"]),
    },
];

/// Cheap and informative first, long ones last.
const STEPS: &[Step] = &[
    FMT,
    TIDY,
    // Before anything else is built, so that the program has the pages inside.
    Step {
        name: "web",
        needs_peers: false,
        skip: always,
        run: web::pages,
    },
    CLIPPY,
    Step {
        name: "deny",
        needs_peers: false,
        skip: no_deny,
        run: deny,
    },
    Step {
        name: "tests",
        needs_peers: false,
        skip: always,
        run: |root| nextest(root, &["--lib", "--bins", "--tests", "--examples"]),
    },
    Step {
        name: "doc tests",
        needs_peers: false,
        skip: always,
        run: |root| run::run(&mut cargo(root, &["test", "--doc", "--workspace"])),
    },
    Step {
        name: "web types",
        needs_peers: false,
        skip: always,
        run: web::check,
    },
    Step {
        name: "browser",
        needs_peers: true,
        skip: always,
        run: web::test,
    },
    Step {
        name: "interop",
        needs_peers: true,
        skip: no_interop,
        run: interop,
    },
    Step {
        name: "api",
        needs_peers: true,
        skip: |root| missing(root, API),
        run: |root| run::run(python(root).arg(API)),
    },
    Step {
        name: "homeassistant",
        needs_peers: true,
        skip: no_home_assistant,
        run: |root| run::run(python(root).arg(HOME_ASSISTANT)),
    },
    Step {
        name: "judge",
        needs_peers: true,
        skip: |root| missing(root, JUDGE),
        run: |root| programs::judge(root, &[]),
    },
    Step {
        name: "soak",
        needs_peers: false,
        skip: |root| SOAK.missing(root),
        run: |root| start(&SOAK, root, &[]),
    },
    Step {
        name: "fuzz",
        needs_peers: false,
        skip: |root| FUZZ.missing(root),
        run: |root| start(&FUZZ, root, &[]),
    },
    Step {
        name: "firmware-check",
        needs_peers: true,
        skip: always,
        run: |root| firmware::check(root, &[]),
    },
    Step {
        name: "firmware",
        needs_peers: true,
        skip: always,
        run: firmware::step,
    },
    Step {
        name: "bench",
        needs_peers: true,
        skip: |root| BENCH.missing(root),
        run: |root| start(&BENCH, root, &["--check"]),
    },
];

/// Whether the third-party peers are installed.
#[derive(Clone, Copy, PartialEq)]
enum Peers {
    There,
    Missing,
    /// The user said `--without-peers`.
    Unwanted,
}

/// How much of it to run.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wanted {
    All,
    WithoutPeers,
    Quick,
}

/// Runs every selected step, prints a table, and fails if any step failed.
pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    let mut summary = Summary::default();
    let wanted = wanted(args)?;
    let (steps, peers) = match wanted {
        Wanted::Quick => (QUICK, Peers::Unwanted),
        _ => (
            STEPS,
            install_peers(root, wanted == Wanted::All, &mut summary),
        ),
    };
    for step in steps {
        match (step.skip)(root) {
            Some(why) => summary.skip(step.name, why),
            None if !step.needs_peers => summary.run(step.name, || (step.run)(root)),
            None => run_with_peers(step, root, peers, &mut summary),
        }
    }
    print!("\n{}", summary.table());
    if summary.passed() {
        Ok(())
    } else {
        Err(Error::OnScreen)
    }
}

fn wanted(args: &[String]) -> Result<Wanted> {
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        [] => Ok(Wanted::All),
        ["--without-peers"] => Ok(Wanted::WithoutPeers),
        ["--quick"] => Ok(Wanted::Quick),
        _ => Err(Error::new(
            format!("`{}` is not understood", args.join(" ")),
            "the only arguments are `--quick` and `--without-peers`, one of them",
        )),
    }
}

fn install_peers(root: &Path, wanted: bool, summary: &mut Summary) -> Peers {
    if !wanted {
        summary.skip("peers", String::from("--without-peers"));
        return Peers::Unwanted;
    }
    let mut state = Peers::Missing;
    summary.run("peers", || {
        peers::install(root).inspect(|()| state = Peers::There)
    });
    state
}

fn run_with_peers(step: &Step, root: &Path, peers: Peers, summary: &mut Summary) {
    match peers {
        Peers::There => summary.run(step.name, || (step.run)(root)),
        Peers::Unwanted => summary.skip(step.name, String::from("--without-peers")),
        Peers::Missing => summary.run(step.name, || {
            Err(Error::new(
                "missing peers",
                "the step `peers` above says how to get them",
            ))
        }),
    }
}

fn always(_: &Path) -> Option<String> {
    None
}

fn start(program: &Program, root: &Path, args: &[&str]) -> Result<()> {
    let args: Vec<String> = args.iter().map(|&arg| arg.to_owned()).collect();
    program.run(root, &args)
}

/// Packages that are workspaces of their own, which `--all` and `--workspace` do not include. Of
/// `firmware` only what the boards share; the boards need a toolchain that has no clippy.
const APART: &[&str] = &[
    "bench/Cargo.toml",
    "bench/peers/tokio-modbus-server/Cargo.toml",
    "firmware/Cargo.toml",
    "fuzz/Cargo.toml",
    "interop/rig/Cargo.toml",
];

fn fmt(root: &Path) -> Result<()> {
    let main = run::run(&mut cargo(root, &["fmt", "--all", "--check"]));
    apart(root).fold(main, |before, path| {
        let args = ["fmt", "--all", "--manifest-path", path, "--", "--check"];
        before.and(run::run(&mut cargo(root, &args)))
    })
}

fn clippy(root: &Path) -> Result<()> {
    let denied = ["--", "-D", "warnings"];
    let mut main = cargo(root, &["clippy", "--workspace", "--all-targets"]);
    apart(root).fold(run::run(main.args(denied)), |before, path| {
        let mut other = cargo(root, &["clippy", "--manifest-path", path, "--all-targets"]);
        before.and(run::run(other.args(denied)))
    })
}

fn apart(root: &Path) -> impl Iterator<Item = &'static str> {
    APART
        .iter()
        .copied()
        .filter(|path| root.join(path).is_file())
}

/// How many tests run at once on each core: they spend nine tenths of their time waiting for lines
/// at 9600 baud and for modules that don't answer.
const TESTS_PER_CORE: usize = 8;

/// Nextest runs tests in separate processes and faster; without it plain cargo does.
fn nextest(root: &Path, targets: &[&str]) -> Result<()> {
    let all = ["--workspace", "--no-fail-fast"];
    if !run::works(&mut cargo(root, &["nextest", "--version"])) {
        return run::run(cargo(root, &["test"]).args(targets).args(all));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let at_once = format!("--test-threads={}", cores * TESTS_PER_CORE);
    let mut nextest = cargo(root, &["nextest", "run", &at_once]);
    run::run(nextest.args(targets).args(all))
}

fn no_deny(root: &Path) -> Option<String> {
    let installed = run::works(&mut cargo(root, &["deny", "--version"]));
    (!installed).then(|| String::from("cargo-deny is not installed"))
}

/// Everything but the advisories: those need a database from outside the registry.
fn deny(root: &Path) -> Result<()> {
    run::run(&mut cargo(
        root,
        &["deny", "check", "bans", "licenses", "sources"],
    ))
}

/// Scripts that start the third-party peers; the first that exists is run.
const INTEROP_PYTHON: &str = "interop/run.py";
const INTEROP_SHELL: &str = "interop/run.sh";

/// The daemon's HTTP, tested by third-party programs.
const API: &str = "interop/api.py";

/// A real Home Assistant, which finds and switches what the daemon offers it.
const HOME_ASSISTANT: &str = "interop/homeassistant/run.py";

/// It runs in a Debian of its own.
fn no_home_assistant(root: &Path) -> Option<String> {
    let no_root = || String::from("it needs root, for a Debian of its own");
    let can = peers::can_debootstrap(root);
    missing(root, HOME_ASSISTANT).or_else(|| (!can).then(no_root))
}

fn missing(root: &Path, script: &str) -> Option<String> {
    (!root.join(script).is_file()).then(|| format!("there is no {script} yet"))
}

/// The Python of the peers.
fn python(root: &Path) -> std::process::Command {
    run::program(root, &peers::python(root).to_string_lossy())
}

fn no_interop(root: &Path) -> Option<String> {
    let there = [INTEROP_PYTHON, INTEROP_SHELL]
        .iter()
        .any(|entry| root.join(entry).is_file());
    (!there).then(|| format!("there is no {INTEROP_PYTHON} yet"))
}

fn interop(root: &Path) -> Result<()> {
    if root.join(INTEROP_PYTHON).is_file() {
        return run::run(python(root).arg(INTEROP_PYTHON));
    }
    run::run(run::program(root, "bash").arg(INTEROP_SHELL))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROBE: Step = Step {
        name: "probe",
        needs_peers: true,
        skip: always,
        run: |_| panic!("must not run"),
    };

    #[test]
    fn a_step_without_its_peers_fails_and_does_not_run() {
        let mut summary = Summary::default();
        run_with_peers(&PROBE, Path::new("."), Peers::Missing, &mut summary);
        assert!(!summary.passed());
    }

    #[test]
    fn a_step_is_left_out_only_on_demand() {
        let mut summary = Summary::default();
        run_with_peers(&PROBE, Path::new("."), Peers::Unwanted, &mut summary);
        assert!(summary.passed());
        assert!(
            wanted(&[String::from("--without-peer")]).is_err(),
            "mistyped"
        );
    }

    /// Steps for every save need neither peers nor a browser nor a port.
    #[test]
    fn a_quick_run_needs_nothing_but_cargo() {
        assert_eq!(wanted(&[String::from("--quick")]).ok(), Some(Wanted::Quick));
        assert!(QUICK.iter().all(|step| !step.needs_peers));
        let names: Vec<_> = QUICK.iter().map(|step| step.name).collect();
        assert_eq!(names, ["fmt", "tidy", "clippy", "unit tests"]);
    }
}
