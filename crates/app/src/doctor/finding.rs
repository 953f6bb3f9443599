//! A finding: a code of the table, the facts of this case, and the commands that fix it.

use super::texts::FindingText;
use crate::config_check::Shown;
use crate::render::wire_words;
use crate::texts::AppText;
use railbus_api::types::Lost;
use railbus_words::Lang;
use railbus_words::findings;
use serde_json::{Value, json};

/// The section of a finding, in display order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Section {
    /// The machine itself.
    System,
    /// A port.
    Port,
    /// A line.
    Line,
    /// The modules of a line.
    Modules,
    /// The configuration.
    Config,
    /// The daemon.
    Daemon,
    /// The sites of a fleet.
    Fleet,
}

impl Section {
    /// The name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Section::System => "system",
            Section::Port => "port",
            Section::Line => "line",
            Section::Modules => "modules",
            Section::Config => "config",
            Section::Daemon => "daemon",
            Section::Fleet => "fleet",
        }
    }
}

/// The severity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckState {
    /// All is well.
    Ok,
    /// It works, and may not for long.
    Warning,
    /// It does not work.
    Error,
}

impl CheckState {
    /// The name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            CheckState::Ok => "ok",
            CheckState::Warning => "warning",
            CheckState::Error => "error",
        }
    }
}

/// A finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Its section.
    pub section: Section,
    /// Its severity.
    pub state: CheckState,
    /// Its code; `None` if all is well.
    pub code: Option<&'static str>,
    /// The facts of this case; the whole text if all is well.
    pub detail: String,
    /// Shell commands that fix it.
    pub fix: Vec<String>,
    /// Manual steps, if there is more to say than the table does.
    pub advice: Option<String>,
}

impl Finding {
    /// All is well, with this text.
    pub fn good(section: Section, text: String) -> Finding {
        Finding {
            section,
            state: CheckState::Ok,
            code: None,
            detail: text,
            fix: Vec::new(),
            advice: None,
        }
    }

    /// A warning of this code.
    pub fn warning(section: Section, code: &'static str, detail: String) -> Finding {
        Finding {
            state: CheckState::Warning,
            code: Some(code),
            ..Finding::good(section, detail)
        }
    }

    /// An error of this code.
    pub fn error(section: Section, code: &'static str, detail: String) -> Finding {
        Finding {
            state: CheckState::Error,
            ..Finding::warning(section, code, detail)
        }
    }

    /// A module without valid replies, and what was received instead. If most of that was garbled,
    /// it is not reported as silent.
    pub fn unanswered(lang: Lang, at: &str, lost: Option<&Lost>) -> Finding {
        let met = lost.filter(|lost| lost.garbled > 0);
        let code = match met {
            Some(lost) if u16::from(lost.garbled) * 2 >= u16::from(lost.attempts) => "D302",
            _ => "D301",
        };
        let detail = match met {
            Some(lost) => {
                let lost = wire_words::lost(lang, lost);
                lang.fill(FindingText::Met, &[("at", &at), ("lost", &lost)])
            }
            None => at.to_owned(),
        };
        Finding::error(Section::Modules, code, detail)
    }

    /// An unwise setting of the configuration.
    pub fn of_lint(shown: &Shown) -> Finding {
        let detail = format!("{} ({})", shown.message, shown.path);
        Finding {
            advice: Some(shown.next.clone()),
            ..Finding::warning(Section::Config, shown.code, detail)
        }
    }

    /// Adds a command that fixes it.
    pub fn with_fix(mut self, command: String) -> Finding {
        self.fix.push(command);
        self
    }

    /// Adds manual steps.
    pub fn with_advice(mut self, advice: String) -> Finding {
        self.advice = Some(advice);
        self
    }

    /// Whether it has this code.
    pub fn is(&self, code: &str) -> bool {
        self.code.is_some_and(|own| own.eq_ignore_ascii_case(code))
    }

    /// The problem, in words.
    pub fn message(&self, lang: Lang) -> String {
        let lint = self.code.is_some_and(|code| code.starts_with('L'));
        let page = self.code.and_then(findings::find).filter(|_| !lint);
        match page.map(|finding| finding.page.title(lang)) {
            Some(title) if self.detail.is_empty() => title.to_owned(),
            Some(title) => lang.fill(AppText::Named, &[("title", &title), ("name", &self.detail)]),
            None => self.detail.clone(),
        }
    }

    /// Its usual causes.
    pub fn likely(&self, lang: Lang) -> Option<&'static str> {
        let page = self.code.and_then(findings::find)?;
        Some(page.page.likely(lang))
    }

    /// What to do: the commands, or else the text of the table or of this case.
    pub fn steps(&self, lang: Lang) -> Vec<String> {
        let page = self.code.and_then(findings::find);
        match (&self.advice, page) {
            _ if !self.fix.is_empty() => self
                .fix
                .iter()
                .cloned()
                .chain(self.advice.clone())
                .collect(),
            (Some(advice), _) => vec![advice.clone()],
            (None, Some(finding)) => vec![finding.page.next(lang).to_owned()],
            (None, None) => Vec::new(),
        }
    }

    /// The same for programs.
    pub fn json(&self, lang: Lang) -> Value {
        json!({
            "section": self.section.name(), "state": self.state.name(), "code": self.code,
            "message": self.message(lang),
            "likely": self.likely(lang),
            "hint": self.steps(lang), "fix": self.fix,
        })
    }
}
