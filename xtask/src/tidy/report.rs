//! The findings of the checks, in a form that an editor can jump to.

use std::fmt;

/// One place that breaks an invariant.
#[derive(Debug)]
pub(crate) struct Finding {
    pub(crate) path: String,
    /// From 1; also 1 if the whole file is meant.
    pub(crate) line: usize,
    rule: &'static str,
    what: String,
    next: String,
}

/// The findings of all checks so far, and notes about what could not be checked.
#[derive(Debug, Default)]
pub(crate) struct Report {
    rule: &'static str,
    findings: Vec<Finding>,
    notes: Vec<String>,
}

impl Report {
    /// Findings from now on belong to this rule.
    pub(crate) fn begin(&mut self, rule: &'static str) {
        self.rule = rule;
    }

    /// `what` is wrong at that line; `next` is what fixes it.
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

    /// Something was not checked. That must always be reported.
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
