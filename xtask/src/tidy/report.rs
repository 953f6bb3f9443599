//! What the checks found, in a form that an editor can jump to.

use std::fmt;

/// One place that breaks an invariant.
#[derive(Debug)]
pub(crate) struct Finding {
    pub(crate) path: String,
    /// From 1; 1 as well where the whole file is meant.
    pub(crate) line: usize,
    rule: &'static str,
    what: String,
    next: String,
}

/// Findings of all checks so far, and notes about what could not be checked.
#[derive(Debug, Default)]
pub(crate) struct Report {
    rule: &'static str,
    findings: Vec<Finding>,
    notes: Vec<String>,
}

impl Report {
    /// What comes from now on is about this rule.
    pub(crate) fn begin(&mut self, rule: &'static str) {
        self.rule = rule;
    }

    /// `what` is wrong at that line; `next` is what mends it.
    pub(crate) fn add(
        &mut self,
        path: &str,
        line: usize,
        what: impl Into<String>,
        next: impl Into<String>,
    ) {
        let (path, rule) = (path.to_owned(), self.rule);
        self.findings.push(Finding {
            path,
            line,
            rule,
            what: what.into(),
            next: next.into(),
        });
    }

    /// A check did not look at something. Never leave that unsaid.
    pub(crate) fn note(&mut self, text: &str) {
        self.notes.push(format!("note: {}: {text}", self.rule));
    }

    /// In the order they were found.
    pub(crate) fn findings(&self) -> &[Finding] {
        &self.findings
    }
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Finding {
            path,
            line,
            rule,
            what,
            next,
        } in &self.findings
        {
            writeln!(out, "{path}:{line}: {rule}: {what} — {next}")?;
        }
        self.notes
            .iter()
            .try_for_each(|note| writeln!(out, "{note}"))
    }
}
