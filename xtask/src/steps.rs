//! A list of steps, run to its end whatever fails, and a table of the results.

use std::time::{Duration, Instant};

use crate::run::Result;

/// The result of a step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum End {
    Passed,
    /// What its last line said.
    Failed(String),
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
                End::Failed(error.to_string())
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
        assert_eq!(lines[0], "first: broken — mend it");
        assert!(lines[2].starts_with("first            FAILED"), "{table}");
        assert_eq!(lines[4], "third            skipped  not here yet");
        assert_eq!(lines[5], "steps: 1 passed, 1 failed");
    }
}
