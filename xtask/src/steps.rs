//! A list of steps, run to its end whatever fails, and a table of the results.

use std::time::{Duration, Instant};

use crate::run::Result;

/// The result of a step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum End {
    Passed,
    Failed,
    /// Not run, and why. Never silent: the table names it.
    Skipped(String),
}

/// The results of all steps, in order.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    rows: Vec<(&'static str, End, Duration)>,
}

impl Summary {
    /// Runs one step under a header and records its result and duration.
    pub(crate) fn run(&mut self, name: &'static str, step: impl FnOnce() -> Result<()>) {
        println!("\n=== {name} ===");
        let start = Instant::now();
        let end = match step() {
            Ok(()) => End::Passed,
            Err(error) => {
                println!("{name}: {error}");
                End::Failed
            }
        };
        let took = start.elapsed();
        println!("--- {name}: {}, {}", end.word(), seconds(took));
        self.rows.push((name, end, took));
    }

    /// Records a step that is not run.
    pub(crate) fn skip(&mut self, name: &'static str, why: String) {
        println!("\n=== {name} ===\nskipped: {why}");
        self.rows.push((name, End::Skipped(why), Duration::ZERO));
    }

    /// Whether no step failed.
    pub(crate) fn passed(&self) -> bool {
        self.count(&End::Failed) == 0
    }

    /// The table for the end of the run. Its last line is the count, in one fixed form.
    pub(crate) fn table(&self) -> String {
        let mut text = String::new();
        for (name, end, took) in &self.rows {
            let detail = match end {
                End::Skipped(why) => why.clone(),
                _ => seconds(*took),
            };
            text.push_str(&format!("{name:<16} {:<8} {detail}\n", end.word()));
        }
        let (passed, failed) = (self.count(&End::Passed), self.count(&End::Failed));
        text.push_str(&format!("steps: {passed} passed, {failed} failed\n"));
        text
    }

    fn count(&self, end: &End) -> usize {
        self.rows.iter().filter(|row| row.1 == *end).count()
    }
}

impl End {
    fn word(&self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "FAILED",
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
    use crate::run::Error;

    #[test]
    fn a_failure_does_not_stop_the_run_and_is_counted() {
        let mut summary = Summary::default();
        summary.run("first", || Err(Error::new("broken", "mend it")));
        summary.run("second", || Ok(()));
        summary.skip("third", String::from("not here yet"));
        assert!(!summary.passed());
        let table = summary.table();
        let lines: Vec<&str> = table.lines().collect();
        assert!(lines[0].starts_with("first            FAILED"), "{table}");
        assert_eq!(lines[2], "third            skipped  not here yet");
        assert_eq!(lines[3], "steps: 1 passed, 1 failed");
    }
}
