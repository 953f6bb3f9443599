//! `cargo xtask test`: everything that shows whether this checkout is good, in one command.

use std::path::Path;

use crate::programs::{self, BENCH, FUZZ, JUDGE, Program, SOAK};
use crate::run::{self, Error, Result, cargo};
use crate::steps::{Background, Summary};
use crate::{firmware, peers, tidy, web};

/// One step of the run.
struct Step {
    name: &'static str,
    /// It says nothing useful on a machine without the third-party peers.
    needs_peers: bool,
    place: Place,
    /// Why the step does not apply to this checkout or machine; none if it does.
    skip: fn(&Path) -> Option<String>,
    run: fn(&Path) -> Result<()>,
}

/// What else runs while a step does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// The steps in the background.
    Foreground,
    /// The steps in the foreground that follow it: no clock judges it, and most of those wait more
    /// than they compute.
    Background,
    /// Nothing: a clock judges it that would see what runs beside.
    Alone,
}

/// A step in the foreground that needs nothing.
const fn step(name: &'static str, run: fn(&Path) -> Result<()>) -> Step {
    Step {
        name,
        needs_peers: false,
        place: Place::Foreground,
        skip: always,
        run,
    }
}

/// A step in the foreground that needs the peers.
const fn with_peers(name: &'static str, run: fn(&Path) -> Result<()>) -> Step {
    Step {
        needs_peers: true,
        ..step(name, run)
    }
}

impl Step {
    const fn in_background(self) -> Self {
        Self {
            place: Place::Background,
            ..self
        }
    }

    const fn alone(self) -> Self {
        Self {
            place: Place::Alone,
            ..self
        }
    }

    const fn unless(self, skip: fn(&Path) -> Option<String>) -> Self {
        Self { skip, ..self }
    }
}

const FMT: Step = step("fmt", fmt);
const TIDY: Step = step("tidy", |root| tidy::run(root, &[]));
const CLIPPY: Step = step("clippy", clippy);

/// The steps for every save: no port, no process, no page.
const QUICK: &[Step] = &[
    FMT,
    TIDY,
    CLIPPY,
    step("unit tests", |root| nextest(root, &["--lib", "--bins"])),
];

/// Cheap and informative first, long ones last.
const STEPS: &[Step] = &[
    FMT,
    TIDY,
    // Before anything else is built, so that the program has the pages inside.
    step("web", web::pages),
    step("deny", deny).unless(no_deny),
    // Before the tests are built: they take over what it has built for the compiler itself.
    CLIPPY,
    step("build", |root| {
        nextest(root, &[ALL, &["--no-run"]].concat())
    }),
    step("doc tests", |root| {
        run::run(&mut cargo(root, &["test", "--doc", "--workspace"]))
    })
    .in_background(),
    step("web types", web::check).in_background(),
    step("soak", |root| start(&SOAK, root, &[]))
        .unless(|root| SOAK.missing(root))
        .in_background(),
    step("fuzz", |root| start(&FUZZ, root, &[]))
        .unless(|root| FUZZ.missing(root))
        .in_background(),
    with_peers("firmware-check", |root| firmware::check(root, &[])).in_background(),
    with_peers("images", firmware::images).in_background(),
    with_peers("bench build", |root| BENCH.build(root))
        .unless(|root| BENCH.missing(root))
        .in_background(),
    with_peers("api", |root| run::run(python(root).arg(API)))
        .unless(|root| missing(root, API))
        .in_background(),
    step("tests", |root| nextest(root, ALL)),
    with_peers("browser", web::test),
    // They judge by time, too: nothing else may use the machine.
    with_peers("interop", interop).unless(no_interop).alone(),
    with_peers("homeassistant", |root| {
        run::run(python(root).arg(HOME_ASSISTANT))
    })
    .unless(no_home_assistant)
    .alone(),
    with_peers("judge", |root| programs::judge(root, &[]))
        .unless(|root| missing(root, JUDGE))
        .alone(),
    with_peers("firmware", firmware::trials).alone(),
    with_peers("bench", |root| start(&BENCH, root, &["--check"]))
        .unless(|root| BENCH.missing(root))
        .alone(),
];

/// Whether the third-party peers are installed.
#[derive(Clone, Copy, PartialEq)]
enum Peers {
    There,
    Missing,
    /// The user said `--without-peers`.
    Unwanted,
}

/// The steps that install them: what Debian has, which other steps need, too, and the rest.
const DEBIAN: &str = "peers";
const PACKAGES: Step = step("packages", peers::packages).in_background();
/// Home Assistant takes minutes to install, and only its own step needs it, which tries again.
const HOME: Step = step("homeassistant install", |root| {
    if let Err(error) = run::run(python(root).args([HOME_ASSISTANT, "--install"])) {
        run::say(&format!("note: {error}; its step tries again"));
    }
    Ok(())
})
.unless(no_home_assistant)
.in_background();

const WITHOUT_PEERS: &str = "--without-peers";

/// How much of it to run.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wanted {
    All,
    WithoutPeers,
    Quick,
}

/// Runs every selected step, prints a table, and fails if any step failed.
pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    let wanted = wanted(args)?;
    let mut plan = Plan {
        root,
        peers: match wanted {
            Wanted::All => None,
            Wanted::WithoutPeers | Wanted::Quick => Some(Peers::Unwanted),
        },
        background: Background::start(),
        summary: Summary::default(),
    };
    let steps = match wanted {
        Wanted::Quick => QUICK,
        Wanted::WithoutPeers => {
            plan.summary.skip(DEBIAN, String::from(WITHOUT_PEERS));
            STEPS
        }
        Wanted::All => {
            plan.summary.run(DEBIAN, || peers::debian(root));
            plan.background.run(PACKAGES.name, root, PACKAGES.run);
            plan.step(&HOME);
            STEPS
        }
    };
    steps.iter().for_each(|step| plan.step(step));
    plan.background.wait(&mut plan.summary);
    print!("\n{}", plan.summary.table());
    if plan.summary.passed() {
        Ok(())
    } else {
        Err(Error::OnScreen)
    }
}

/// A run that goes on.
struct Plan<'a> {
    root: &'a Path,
    /// Not known while they are being installed.
    peers: Option<Peers>,
    background: Background,
    summary: Summary,
}

impl Plan<'_> {
    fn step(&mut self, step: &Step) {
        if let Some(why) = (step.skip)(self.root) {
            return self.summary.skip(step.name, why);
        }
        if step.needs_peers {
            match self.peers() {
                Peers::There => {}
                Peers::Unwanted => {
                    return self.summary.skip(step.name, String::from(WITHOUT_PEERS));
                }
                Peers::Missing => {
                    let missing = "the step that installs them says above what to do";
                    let missing = || Err(Error::new("missing peers", missing));
                    return self.summary.run(step.name, missing);
                }
            }
        }
        if step.place == Place::Background {
            return self.background.run(step.name, self.root, step.run);
        }
        if step.place == Place::Alone {
            self.background.wait(&mut self.summary);
        }
        self.summary.run(step.name, || (step.run)(self.root));
    }

    /// Whether they are there; waits until they are installed.
    fn peers(&mut self) -> Peers {
        *self.peers.get_or_insert_with(|| {
            self.background.wait_for(PACKAGES.name, &mut self.summary);
            let there = [DEBIAN, PACKAGES.name]
                .iter()
                .all(|name| self.summary.has_passed(name));
            if there { Peers::There } else { Peers::Missing }
        })
    }
}

fn wanted(args: &[String]) -> Result<Wanted> {
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        [] => Ok(Wanted::All),
        [WITHOUT_PEERS] => Ok(Wanted::WithoutPeers),
        ["--quick"] => Ok(Wanted::Quick),
        _ => Err(Error::new(
            format!("`{}` is not understood", args.join(" ")),
            "the only arguments are `--quick` and `--without-peers`, one of them",
        )),
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

/// All tests.
const ALL: &[&str] = &["--lib", "--bins", "--tests", "--examples"];

/// Nextest runs tests in separate processes and faster; without it plain cargo does. With
/// `--no-run` they are only built.
fn nextest(root: &Path, targets: &[&str]) -> Result<()> {
    let is_run = !targets.contains(&"--no-run");
    let to_the_end: &[&str] = if is_run { &["--no-fail-fast"] } else { &[] };
    if !run::works(&mut cargo(root, &["nextest", "--version"])) {
        let mut test = cargo(root, &["test", "--workspace"]);
        return run::run(test.args(targets).args(to_the_end));
    }
    let mut nextest = cargo(root, &["nextest", "run", "--workspace"]);
    if is_run {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        nextest.arg(format!("--test-threads={}", cores * TESTS_PER_CORE));
    }
    run::run(nextest.args(targets).args(to_the_end))
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
    let can = peers::can_bootstrap(root);
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

    const PROBE: Step = with_peers("probe", |_| panic!("must not run"));

    fn plan(peers: Option<Peers>) -> Plan<'static> {
        Plan {
            root: Path::new("."),
            peers,
            background: Background::start(),
            summary: Summary::default(),
        }
    }

    #[test]
    fn a_step_without_its_peers_fails_and_does_not_run() {
        let mut plan = plan(Some(Peers::Missing));
        plan.step(&PROBE);
        assert!(!plan.summary.passed());
    }

    #[test]
    fn a_step_waits_for_its_peers_and_fails_without_them() {
        for packages in [PACKAGES.name, "another step"] {
            let mut plan = plan(None);
            plan.summary.run(DEBIAN, || Ok(()));
            plan.background.run(packages, Path::new("."), |_| Ok(()));
            plan.step(&with_peers("probe", |_| Ok(())));
            let installed = packages == PACKAGES.name;
            assert_eq!(plan.summary.has_passed("probe"), installed);
            assert!(plan.summary.has_passed(packages));
        }
    }

    #[test]
    fn nothing_runs_beside_a_step_alone() {
        let mut plan = plan(Some(Peers::Unwanted));
        let slow = |_: &Path| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            Ok(())
        };
        plan.step(&step("slow", slow).in_background());
        plan.step(&step("alone", |_| Ok(())).alone());
        let table = plan.summary.table();
        assert!(table.starts_with("slow"), "{table}");
        assert!(plan.summary.has_passed("alone"));
    }

    #[test]
    fn a_step_is_left_out_only_on_demand() {
        let mut plan = plan(Some(Peers::Unwanted));
        plan.step(&PROBE);
        assert!(plan.summary.passed());
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
