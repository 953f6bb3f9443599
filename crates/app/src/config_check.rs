//! Valid but unwise settings of a configuration, for people and programs.

mod texts;

use crate::machine::{Machine, ports};
use railbus_site::Config;
use railbus_site::config::{Unwise, Warning, lint, load_percent, place_of};
use railbus_words::Lang;
use railbus_words::findings;
use serde_json::{Value, json};
use std::fmt::Display;
pub use texts::UnwiseText;

/// What is unwise on this machine.
pub fn lints(machine: &Machine, config: &Config) -> Vec<Warning> {
    let adapters = ports::adapters(machine);
    lint(config, |port| {
        let adapter = adapters.iter().find(|adapter| adapter.device == port)?;
        adapter.stable.clone().or_else(|| adapter.socket.clone())
    })
}

/// The same in the types of the API.
pub fn warnings(lang: Lang, file: &str, text: &str, config: &Config) -> Vec<Value> {
    let warnings = lints(&Machine::this(), config);
    let told = |warning| Shown::of(lang, text, warning).json(file);
    warnings.iter().map(told).collect()
}

/// The minimum share of each line's time that its polls take.
pub fn loads(lang: Lang, config: &Config) -> String {
    let of_line = |name: &String| {
        let modules = config.modules_of(name).map(|(_, module)| module);
        format!("{name} {} %", load_percent(modules))
    };
    let loads: Vec<String> = config.lines.keys().map(of_line).collect();
    loads.join(lang.get(crate::texts::AppText::Comma))
}

/// A warning in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Its code, such as `L012`.
    pub code: &'static str,
    /// The setting concerned.
    pub path: String,
    place: Option<(usize, usize)>,
    /// The problem.
    pub message: String,
    /// What to do.
    pub next: String,
}

impl Shown {
    /// The warning in this language, with its position in the text.
    pub fn of(lang: Lang, text: &str, warning: &Warning) -> Shown {
        let code = warning.kind.code();
        let page = findings::find(code).map(|finding| finding.page);
        let title = page.map_or("", |page| page.title(lang));
        let detail = detail(lang, &warning.kind);
        let message = match detail.is_empty() {
            true => title.to_owned(),
            false => lang.fill(
                crate::texts::AppText::Named,
                &[("title", &title), ("name", &detail)],
            ),
        };
        Shown {
            code,
            path: warning.path.clone(),
            place: place_of(text, &warning.path),
            message,
            next: page.map_or("", |page| page.next(lang)).to_owned(),
        }
    }

    /// The same for programs.
    pub fn json(&self, file: &str) -> Value {
        json!({
            "code": self.code, "path": self.path, "file": file, "message": self.message,
            "line": self.place.map(|(line, _)| line),
            "column": self.place.map(|(_, column)| column), "hint": [self.next],
        })
    }

    /// The file, with line and column if known.
    pub fn at(&self, file: &str) -> String {
        match self.place {
            Some((line, column)) => format!("{file}:{line}:{column}"),
            None => file.to_owned(),
        }
    }
}

/// The numbers in a warning.
fn detail(lang: Lang, kind: &Unwise) -> String {
    let ms = |micros: railbus_wire::Micros| micros.0.div_ceil(1_000);
    let fill = |text: UnwiseText, values: &[(&str, &dyn Display)]| lang.fill(text, values);
    match kind {
        Unwise::FirstByte(address, protocol) => {
            let protocol = protocol.name();
            fill(
                UnwiseText::Beside,
                &[("address", address), ("protocol", &protocol)],
            )
        }
        Unwise::ReservedAddress(address) => address.to_string(),
        Unwise::Overloaded { percent, round } => fill(
            UnwiseText::Load,
            &[("percent", percent), ("round", &ms(*round))],
        ),
        Unwise::GoesStale { round, max_age } => {
            let values: &[(&str, &dyn Display)] = &[("round", &ms(*round)), ("age", &ms(*max_age))];
            fill(UnwiseText::Stale, values)
        }
        Unwise::TwoSpeeds(count) | Unwise::TwoFormats(count) => {
            fill(UnwiseText::Others, &[("count", count)])
        }
        Unwise::UnstablePort(stable) => stable.clone().unwrap_or_default(),
        _ => String::new(),
    }
}
