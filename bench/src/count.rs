//! Counting with valgrind: instructions by callgrind, allocations by memcheck.

use std::process::{Child, Command, Stdio};

/// What is counted.
#[derive(Clone, Copy)]
pub enum What {
    /// The user instructions executed.
    Instructions,
    /// The number of allocations.
    Allocations,
}

impl What {
    const fn arguments(self) -> &'static [&'static str] {
        match self {
            What::Instructions => &["--tool=callgrind", "--callgrind-out-file=/dev/null"],
            What::Allocations => &["--tool=memcheck", "--undef-value-errors=no"],
        }
    }

    /// Finds the number in `==pid== Collected : 1234` or in
    /// `==pid==   total heap usage: 1,234 allocs, 1,230 frees, 5,678 bytes allocated`.
    fn find(self, text: &str) -> Option<u64> {
        let (label, after) = match self {
            What::Instructions => ("Collected", " : "),
            What::Allocations => ("total heap usage", ": "),
        };
        let line = text.lines().find(|line| line.contains(label))?;
        let number = line.split_once(after)?.1.split(' ').next()?;
        number.replace(',', "").parse().ok()
    }
}

/// Starts a program under valgrind.
pub fn start(what: What, program: &Command) -> Result<Child, String> {
    Command::new("valgrind")
        .args(what.arguments())
        .arg(program.get_program())
        .args(program.get_args())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|why| format!("valgrind cannot be started ({why}); install it and try again"))
}

/// The count of a program that was started so.
pub fn end(what: What, program: Child) -> Result<u64, String> {
    let output = program.wait_with_output().map_err(|why| why.to_string())?;
    let text = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        return Err(format!("valgrind failed:\n{text}"));
    }
    what.find(&text)
        .ok_or_else(|| format!("valgrind printed no count:\n{text}"))
}

/// The instructions of one iteration of a job of this program: exact, as the rest of the program
/// cancels out.
pub fn per_iteration(name: &str) -> Result<u64, String> {
    const FEW: u64 = 1_000;
    const MANY: u64 = 2_000;
    let itself = std::env::current_exe().map_err(|why| why.to_string())?;
    let total = |iterations: u64| {
        let mut job = Command::new(&itself);
        job.args(["--one", name, "--iterations", &iterations.to_string()]);
        end(What::Instructions, start(What::Instructions, &job)?)
    };
    let extra = total(MANY)?.saturating_sub(total(FEW)?);
    let iterations = MANY - FEW;
    Ok((extra + iterations / 2) / iterations)
}
