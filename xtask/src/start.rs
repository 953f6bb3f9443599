//! `start`: how long commands take from start to end, compared with mbpoll in the same run. It
//! prints medians and ratios and judges nothing: times on a loaded machine are arbitrary.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::run::{self, Error, Result};

/// Rounds in which each command runs once, so that load affects all of them alike.
const ROUNDS: usize = 25;
/// Rounds of the first read after a rest.
const RESTED_ROUNDS: usize = 7;
/// After this long without a frame no reply to any request can come.
const REST: Duration = Duration::from_secs(9);
/// What a read of eight coils takes on the wire at 9600 8N1: 8 characters, the 3.5 characters of
/// silence by which the module recognises the end, the 5 ms that the demo's modules take to answer,
/// and 6 characters.
const WIRE: Duration = Duration::from_micros(23_229);

/// A simulated line and its path.
struct Line {
    child: Child,
    pty: PathBuf,
}

impl Drop for Line {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.pty);
    }
}

pub(crate) fn run(root: &Path, args: &[String]) -> Result<()> {
    match args {
        [as_built] if as_built == "--as-built" => {}
        args => {
            crate::no_arguments(args)?;
            run::run(&mut run::cargo(
                root,
                &["build", "--release", "-p", "railbus"],
            ))?;
        }
    }
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from);
    let railbus = target.join("release/railbus");
    let line = serve(&railbus)?;
    let pty = line.pty.display().to_string();
    let port = format!("pty:{pty}");
    let own = railbus.display().to_string();
    let get = ["-l", &port, "-m", "erc8", "-a", "3", "get", "erc8.k1"];
    let poll = "-m rtu -a 3 -0 -1 -q -b 9600 -P none -t 0 -r 60 -c 8";
    let poll: Vec<&str> = poll.split(' ').chain([pty.as_str()]).collect();
    let jobs: [(&str, &str, &[&str]); 4] = [
        ("railbus --help", &own, &["--help"]),
        ("mbpoll -h", "mbpoll", &["-h"]),
        ("railbus get, one point", &own, &get),
        ("mbpoll, eight coils", "mbpoll", &poll),
    ];
    let mut times = jobs.map(|_| Vec::with_capacity(ROUNDS));
    for _ in 0..ROUNDS {
        for ((_, program, args), times) in jobs.iter().zip(&mut times) {
            times.push(time(program, args)?);
        }
    }
    let mut rested = Vec::with_capacity(RESTED_ROUNDS);
    for _ in 0..RESTED_ROUNDS {
        std::thread::sleep(REST);
        rested.push(time(&own, &get)?);
    }
    let rested = median(rested);
    let [help, mbpoll_help, get, poll] = times.map(median);
    println!(
        "medians of {ROUNDS} interleaved rounds; on the wire {}",
        millis(WIRE)
    );
    for ((name, ..), took) in jobs.iter().zip([help, mbpoll_help, get, poll]) {
        println!("  {name:<24} {}", millis(took));
    }
    println!(
        "  railbus get, after {} s    {}",
        REST.as_secs(),
        millis(rested)
    );
    println!("over the wire's own time");
    let reads = [
        ("railbus get", get),
        ("railbus get, line at rest", rested),
        ("mbpoll", poll),
    ];
    for (name, took) in reads {
        println!("  {name:<24} {}", millis(took.saturating_sub(WIRE)));
    }
    println!(
        "ratios to mbpoll: help {:.2}, read {:.2}, read at rest {:.2}",
        ratio(help, mbpoll_help),
        ratio(get, poll),
        ratio(rested, poll)
    );
    Ok(())
}

/// The demo line on a pseudo-terminal, once it is ready.
fn serve(railbus: &Path) -> Result<Line> {
    let pty = std::env::temp_dir().join(format!("railbus-start-{}", std::process::id()));
    let mut command = Command::new(railbus);
    command
        .args(["sim", "--demo", "--tcp", "127.0.0.1:0", "--pty"])
        .arg(&pty);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    let child = command
        .spawn()
        .map_err(|error| Error::new(error.to_string(), "build it"))?;
    let line = Line { child, pty };
    let begun = Instant::now();
    while !line.pty.exists() {
        if begun.elapsed() > Duration::from_secs(10) {
            return Err(Error::new(
                "the simulated line does not come up",
                "start it by hand",
            ));
        }
        std::thread::yield_now();
    }
    Ok(line)
}

/// Runs a program, which must succeed, and returns the time it took.
fn time(program: &str, args: &[&str]) -> Result<Duration> {
    let mut command = Command::new(program);
    command
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let begun = Instant::now();
    let status = command.status().map_err(|error| {
        Error::new(
            format!("`{program}` could not be started: {error}"),
            "install mbpoll",
        )
    })?;
    let took = begun.elapsed();
    // mbpoll exits with 1 if it only printed its help.
    let helped = args == ["-h"];
    if status.success() || helped {
        return Ok(took);
    }
    let line = format!("{program} {}", args.join(" "));
    Err(Error::new(
        format!("`{line}` ended with {status}"),
        "run it by hand",
    ))
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times.get(times.len() / 2).copied().unwrap_or_default()
}

fn millis(time: Duration) -> String {
    format!("{:.1} ms", time.as_secs_f64() * 1_000.0)
}

fn ratio(a: Duration, b: Duration) -> f64 {
    a.as_secs_f64() / b.as_secs_f64().max(1e-9)
}
