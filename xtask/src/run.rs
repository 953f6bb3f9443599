//! Starts other programs, and reports clearly when that fails.

use std::cell::Cell;
use std::fmt;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Output, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Why a command failed.
#[derive(Debug)]
pub(crate) enum Error {
    /// What happened, and what the reader can do next.
    Told { what: String, next: String },
    /// The output that is already on the screen is sufficient and ends with a line of its own.
    OnScreen,
}

/// A result with an error that the user can act on.
pub(crate) type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// `what` went wrong; `next` is the step that fixes it or finds out more.
    pub(crate) fn new(what: impl Into<String>, next: impl Into<String>) -> Self {
        Self::Told {
            what: what.into(),
            next: next.into(),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Told { what, next } => write!(out, "{what} — {next}"),
            Self::OnScreen => out.write_str("see above"),
        }
    }
}

/// The root of the repository, whatever folder the command was started in.
pub(crate) fn repository() -> PathBuf {
    // Cargo sets the variable at run time; the compiled-in path is for a bare `target/.../xtask`.
    let own = std::env::var_os("CARGO_MANIFEST_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    own.parent().map_or_else(|| own.clone(), Path::to_path_buf)
}

/// A program started in the root of the repository.
pub(crate) fn program(root: &Path, name: &str) -> Command {
    let mut command = Command::new(name);
    command.current_dir(root);
    // `cargo run` describes xtask in these; a nested cargo or build script is about another crate.
    for (key, _) in std::env::vars_os() {
        let text = key.to_string_lossy();
        if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") {
            command.env_remove(&key);
        }
    }
    command
}

/// Cargo of the toolchain that runs xtask, with these arguments.
pub(crate) fn cargo(root: &Path, args: &[&str]) -> Command {
    let name = std::env::var("CARGO").unwrap_or_else(|_| String::from("cargo"));
    let mut command = program(root, &name);
    command.args(args);
    command
}

thread_local! {
    /// The step that this thread runs in the background.
    static LEAD: Cell<Option<&'static str>> = const { Cell::new(None) };
}

/// Whatever this thread prints from now on is led by this name: others print at the same time.
pub(crate) fn lead_with(name: &'static str) {
    LEAD.set(Some(name));
}

/// Prints lines.
pub(crate) fn say(text: &str) {
    print(LEAD.get(), text);
}

fn print(lead: Option<&str>, text: &str) {
    for line in text.lines() {
        match lead {
            Some(name) => println!("[{name}] {line}"),
            None => println!("{line}"),
        }
    }
}

/// Runs a program to its end and prints what it says. It gets no standard input, so that nothing
/// can wait for an answer on a machine without a keyboard. A failure repeats the lines that tell of
/// it: the output of a whole run is longer than what is kept of it in some places.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    run_drained(command, DRAINED_WITHIN)
}

/// The same; what it said last may take so long to come through the pipe once it has ended.
fn run_drained(command: &mut Command, within: Duration) -> Result<()> {
    let line = spell(command);
    say(&format!("$ {line}"));
    let lead = LEAD.get();
    let not_started = |error: std::io::Error| cannot_start(&line, &error);
    let (output, input) = std::io::pipe().map_err(not_started)?;
    let both = input.try_clone().map_err(not_started)?;
    let started = command
        .stdin(Stdio::null())
        .stdout(input)
        .stderr(both)
        .spawn();
    // The command has ends of the pipe, too: while it has, the output does not end.
    command.stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = started.map_err(not_started)?;
    let (found, failures) = mpsc::channel();
    // The sender is dropped at the end of the output.
    thread::spawn(move || {
        print_and_find(lead, BufReader::new(output), |failure| found.send(failure));
    });
    let status = child.wait().map_err(not_started)?;
    let mut told = Vec::new();
    let drained = Instant::now() + within;
    // A process that it left behind keeps the pipe open, and has nothing to say any more.
    while let Ok(failure) = failures.recv_timeout(drained.saturating_duration_since(Instant::now()))
    {
        told.push(failure);
    }
    end(&line, status, &told)
}

/// Like [`run`], for an interactive program, whose output goes where ours goes.
pub(crate) fn run_attended(command: &mut Command) -> Result<()> {
    let line = spell(command);
    println!("$ {line}");
    let status = command
        .status()
        .map_err(|error| cannot_start(&line, &error))?;
    end(&line, status, &[])
}

fn end(line: &str, status: ExitStatus, failures: &[String]) -> Result<()> {
    if status.success() {
        return Ok(());
    }
    let mut what = format!("`{line}` failed ({status})");
    for failure in failures {
        what.push_str("\n    ");
        what.push_str(failure);
    }
    Err(Error::new(what, "its own output above says why"))
}

/// How long what a program said last may take to come through the pipe once it has ended.
const DRAINED_WITHIN: Duration = Duration::from_secs(10);

/// So many failures are repeated, of which each line has at most so many characters.
const REPEATED_MAX: usize = 12;
const REPEATED_CHARACTERS: usize = 300;

/// Prints all lines, and hands over those that tell of a failure: of a suite, a browser's test, a
/// test, a compiler.
fn print_and_find<E>(
    lead: Option<&str>,
    mut output: impl BufRead,
    mut found: impl FnMut(String) -> std::result::Result<(), E>,
) {
    let (mut count, mut bytes) = (0, Vec::new());
    while output
        .read_until(b'\n', &mut bytes)
        .is_ok_and(|read| read > 0)
    {
        let line = String::from_utf8_lossy(&bytes);
        print(lead, &line);
        let line = line.trim();
        let tells = ["FAILED ", "not ok ", "FAIL [", "error: ", "error["];
        if count < REPEATED_MAX && tells.iter().any(|word| line.starts_with(word)) {
            count += 1;
            // Fails once nobody waits for the rest.
            let _ = found(line.chars().take(REPEATED_CHARACTERS).collect());
        }
        bytes.clear();
    }
}

/// Returns what a program prints on standard output; it must succeed.
pub(crate) fn read(command: &mut Command) -> Result<String> {
    let line = spell(command);
    let output = finish(command)?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    Err(Error::new(
        format!("`{line}` failed ({})", output.status),
        format!("it said: {said}"),
    ))
}

/// Returns the output of a program, successful or not; an error only if it could not be started.
pub(crate) fn finish(command: &mut Command) -> Result<Output> {
    let line = spell(command);
    command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| cannot_start(&line, &error))
}

/// Whether a program exists here and succeeds. Its output is dropped.
pub(crate) fn works(command: &mut Command) -> bool {
    finish(command).is_ok_and(|output| output.status.success())
}

fn cannot_start(line: &str, error: &std::io::Error) -> Error {
    Error::new(
        format!("`{line}` could not be started: {error}"),
        "install the program or put it on the PATH",
    )
}

/// The command as typed in a shell; the program without its folder.
fn spell(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let name = program.file_name().unwrap_or(program.as_os_str());
    std::iter::once(name)
        .chain(command.get_args())
        .map(|word| word.to_string_lossy())
        .collect::<Vec<_>>()
        .join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_names_the_command_and_the_status() {
        let error = run(&mut program(Path::new("."), "false"))
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "`false` failed (exit status: 1) — its own output above says why"
        );
    }

    #[test]
    fn a_failure_repeats_the_lines_that_tell_of_it() {
        let said = "echo fine; echo 'not ok 3 - setup' >&2; echo '  FAIL [ 1 s] a::b'; exit 3";
        let error = run(program(Path::new("."), "sh").args(["-c", said])).unwrap_err();
        let error = error.to_string();
        let lines: Vec<&str> = error.lines().skip(1).collect();
        let wanted = [
            "    not ok 3 - setup",
            "    FAIL [ 1 s] a::b — its own output above says why",
        ];
        assert_eq!(lines, wanted, "{error}");
    }

    #[test]
    fn what_is_left_behind_hides_no_failure_and_holds_nothing_up() {
        let said = "echo FAILED early; sleep 60 & exit 1";
        let begun = Instant::now();
        let drained = Duration::from_millis(300);
        let command = &mut program(Path::new("."), "sh");
        let error = run_drained(command.args(["-c", said]), drained).unwrap_err();
        // The first line has the command.
        let error = error.to_string();
        let repeated: Vec<&str> = error.lines().skip(1).collect();
        assert_eq!(
            repeated,
            ["    FAILED early — its own output above says why"]
        );
        assert!(begun.elapsed() < Duration::from_secs(50));
    }

    #[test]
    fn a_missing_program_is_named() {
        let error = read(&mut program(Path::new("."), "no-such-program-here")).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("`no-such-program-here` could not be started")
        );
    }

    #[test]
    fn a_program_has_no_standard_input_to_wait_for() {
        assert!(run(&mut program(Path::new("."), "cat")).is_ok());
    }
}
