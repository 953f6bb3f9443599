//! The release build of the program: building, starting and stopping it.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A process that ends with the measurement.
pub struct Running(Child);

impl Running {
    /// Its process id.
    pub fn id(&self) -> u32 {
        self.0.id()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts railbus, and returns its output up to the words `until`.
pub fn start(words: &[&str], until: &str) -> Result<(Running, String), String> {
    start_program(&program(), words, until)
}

/// Starts any program, and returns its output up to the words `until`.
pub fn start_program(
    program: &Path,
    words: &[&str],
    until: &str,
) -> Result<(Running, String), String> {
    let mut child = Command::new(program)
        .args(words)
        .env("RAILBUS_LANG", "en")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|why| format!("{}: {why}", program.display()))?;
    let stdout = child.stdout.take().ok_or("it has no output")?;
    let running = Running(child);
    let mut stdout = BufReader::new(stdout);
    let mut told = String::new();
    while !told.contains(until) {
        let read = stdout.read_line(&mut told).map_err(|why| why.to_string())?;
        if read == 0 {
            let name = program.file_name().unwrap_or_default().display();
            return Err(format!("{name} {} ended: {told}", words.join(" ")));
        }
    }
    Ok((running, told))
}

/// The folder of the main workspace.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Names another build of the program, which is then measured as it is.
const PROGRAM: &str = "RAILBUS_PROGRAM";

/// Builds the program as released.
pub fn build() -> Result<(), String> {
    match std::env::var_os(PROGRAM) {
        Some(_) => Ok(()),
        None => build_package(ROOT, "railbus"),
    }
}

/// Builds a package of the workspace in this folder as released.
pub fn build_package(workspace: &str, package: &str) -> Result<(), String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["build", "--quiet", "--release", "--package", package]);
    command.current_dir(workspace);
    let status = command.status().map_err(|why| format!("cargo: {why}"))?;
    status
        .success()
        .then_some(())
        .ok_or_else(|| format!("{package} can't be built"))
}

/// Its path.
fn program() -> PathBuf {
    match std::env::var_os(PROGRAM) {
        Some(program) => program.into(),
        None => built(ROOT, "railbus"),
    }
}

/// The path of a program that was built in this workspace.
pub fn built(workspace: &str, name: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    Path::new(workspace).join(target).join("release").join(name)
}

/// A temporary folder that is deleted after the measurement.
pub struct Folder(PathBuf);

impl Folder {
    /// Creates one below this folder.
    pub fn new(below: &Path, name: &str) -> Result<Folder, String> {
        let path = below.join(format!("railbus-bench-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).map_err(|why| format!("{}: {why}", path.display()))?;
        Ok(Folder(path))
    }

    /// The path of a file in it.
    pub fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The address in the output of a daemon.
pub fn address_in(told: &str) -> Result<&str, String> {
    let address = told
        .lines()
        .find_map(|line| line.trim().strip_prefix("web     http://"));
    Ok(address.ok_or("it listens nowhere")?.trim_end_matches('/'))
}
