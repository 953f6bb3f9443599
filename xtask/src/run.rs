//! Starts other programs, and reports clearly when that fails.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

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

/// Runs a program to its end, with its output going where ours goes. It gets no standard input, so
/// that nothing can wait for an answer on a machine without a keyboard.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    run_attended(command.stdin(Stdio::null()))
}

/// Like [`run`], for an interactive program.
pub(crate) fn run_attended(command: &mut Command) -> Result<()> {
    let line = spell(command);
    println!("$ {line}");
    let status = command
        .status()
        .map_err(|error| cannot_start(&line, &error))?;
    if status.success() {
        return Ok(());
    }
    Err(Error::new(
        format!("`{line}` failed ({status})"),
        "its own output above says why",
    ))
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
