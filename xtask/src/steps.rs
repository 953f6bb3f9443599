//! A list of steps, run to its end whatever fails, some in the background, and a table of the
//! results.

use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;
use std::time::{Duration, Instant};

use crate::run::{self, Error, Result};

/// The result of a step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum End {
    Passed,
    /// What its last line said.
    Failed(String),
    /// Not run, and why. Never silent: the table names it.
    Skipped(String),
}

/// The result of a step: its name, how it ended, and how long it took.
type Row = (&'static str, End, Duration);

/// The results of all steps, in the order in which they ended.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    rows: Vec<Row>,
}

/// Runs a step under a header.
fn timed(name: &'static str, step: impl FnOnce() -> Result<()>) -> Row {
    run::say(&format!("\n=== {name} ==="));
    let start = Instant::now();
    let end = match step() {
        Ok(()) => End::Passed,
        Err(error) => {
            run::say(&format!("{name}: {error}"));
            End::Failed(error.to_string())
        }
    };
    let took = start.elapsed();
    run::say(&format!("--- {name}: {}, {}", end.word(), seconds(took)));
    (name, end, took)
}

/// Runs steps one after the other, beside those in the foreground. Each line of theirs is led by
/// their name.
pub(crate) struct Background {
    jobs: Sender<Job>,
    rows: Receiver<Row>,
    running: usize,
}

struct Job {
    name: &'static str,
    root: PathBuf,
    step: fn(&Path) -> Result<()>,
}

impl Background {
    pub(crate) fn start() -> Self {
        let (jobs, waiting) = mpsc::channel::<Job>();
        let (ended, rows) = mpsc::channel();
        thread::spawn(move || {
            for Job { name, root, step } in waiting {
                run::lead_with(name);
                // One that panics has failed, and the next ones are run all the same.
                let run = || step(&root);
                let row = timed(name, || {
                    panic::catch_unwind(AssertUnwindSafe(run))
                        .unwrap_or_else(|_| Err(Error::new("it panicked", "what it said is above")))
                });
                // Fails when the run is over.
                let _ = ended.send(row);
            }
        });
        Self {
            jobs,
            rows,
            running: 0,
        }
    }

    /// Runs a step when those before it in the background have ended.
    pub(crate) fn run(&mut self, name: &'static str, root: &Path, step: fn(&Path) -> Result<()>) {
        let root = root.to_path_buf();
        // It can't fail: the thread ends with this.
        let sent = self.jobs.send(Job { name, root, step });
        self.running += usize::from(sent.is_ok());
    }

    /// Waits until nothing runs in the background any more.
    pub(crate) fn wait(&mut self, summary: &mut Summary) {
        self.wait_until(summary, |_| false);
    }

    /// Waits until the step of this name has ended, if it was sent there.
    pub(crate) fn wait_for(&mut self, name: &str, summary: &mut Summary) {
        self.wait_until(summary, |summary| summary.has_ended(name));
    }

    fn wait_until(&mut self, summary: &mut Summary, is_over: impl Fn(&Summary) -> bool) {
        while self.running > 0 && !is_over(summary) {
            let Ok(row) = self.rows.recv() else {
                let why = String::from("its thread has ended");
                let row = ("background", End::Failed(why), Duration::ZERO);
                summary.rows.push(row);
                self.running = 0;
                break;
            };
            summary.rows.push(row);
            self.running -= 1;
        }
    }
}

impl Summary {
    /// Runs one step under a header and records its result and duration.
    pub(crate) fn run(&mut self, name: &'static str, step: impl FnOnce() -> Result<()>) {
        self.rows.push(timed(name, step));
    }

    /// Whether a step has ended, or was left out.
    fn has_ended(&self, name: &str) -> bool {
        self.rows.iter().any(|row| row.0 == name)
    }

    /// Whether a step was run and has passed.
    pub(crate) fn has_passed(&self, name: &str) -> bool {
        let mut rows = self.rows.iter();
        rows.any(|row| row.0 == name && row.1 == End::Passed)
    }

    /// Records a step that is not run.
    pub(crate) fn skip(&mut self, name: &'static str, why: String) {
        println!("\n=== {name} ===\nskipped: {why}");
        self.rows.push((name, End::Skipped(why), Duration::ZERO));
    }

    /// Whether no step failed.
    pub(crate) fn passed(&self) -> bool {
        self.failures().next().is_none()
    }

    /// The table for the end of the run, after what failed. Its last line is the count, in one
    /// fixed form.
    pub(crate) fn table(&self) -> String {
        let mut text = String::new();
        for (name, why) in self.failures() {
            text.push_str(&format!("{name}: {why}\n\n"));
        }
        for (name, end, took) in &self.rows {
            let detail = match end {
                End::Skipped(why) => why.clone(),
                _ => seconds(*took),
            };
            text.push_str(&format!("{name:<16} {:<8} {detail}\n", end.word()));
        }
        let passed = self.rows.iter().filter(|row| row.1 == End::Passed).count();
        let failed = self.failures().count();
        text.push_str(&format!("steps: {passed} passed, {failed} failed\n"));
        text
    }

    /// The steps that failed, each with why.
    fn failures(&self) -> impl Iterator<Item = (&'static str, &str)> {
        self.rows.iter().filter_map(|(name, end, _)| match end {
            End::Failed(why) => Some((*name, why.as_str())),
            _ => None,
        })
    }
}

impl End {
    fn word(&self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed(_) => "FAILED",
            Self::Skipped(_) => "skipped",
        }
    }
}

fn seconds(time: Duration) -> String {
    format!("{:.1} s", time.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_in_the_background_that_fails_or_panics_fails_the_run() {
        for step in [
            |_: &Path| panic!("on purpose"),
            |_: &Path| Err(Error::OnScreen),
        ] {
            let (mut background, mut summary) = (Background::start(), Summary::default());
            background.run("first", Path::new("."), step);
            background.wait(&mut summary);
            background.run("second", Path::new("."), |_| Ok(()));
            background.wait_for("second", &mut summary);
            assert!(!summary.passed(), "{}", summary.table());
            assert!(!summary.has_passed("first") && summary.has_passed("second"));
        }
    }

    #[test]
    fn a_failure_does_not_stop_the_run_and_is_counted() {
        let mut summary = Summary::default();
        summary.run("first", || Err(Error::new("broken", "mend it")));
        summary.run("second", || Ok(()));
        summary.skip("third", String::from("not here yet"));
        assert!(!summary.passed());
        let table = summary.table();
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "first: broken — mend it");
        assert!(lines[2].starts_with("first            FAILED"), "{table}");
        assert_eq!(lines[4], "third            skipped  not here yet");
        assert_eq!(lines[5], "steps: 1 passed, 1 failed");
    }
}
