//! Problems of the machine, ports, lines, modules and configuration, and how to fix them.

mod daemon;
mod finding;
mod hearing;
pub mod line;
pub mod port;
mod served;
pub mod system;
mod texts;

use crate::config_check::{self, Shown};
use crate::config_file;
use crate::machine::Machine;
use crate::machine::users::User;
pub use daemon::outlets;
pub use finding::{CheckState, Finding, Section};
use jiff::Timestamp;
use railbus_api::outlets::OutletInfo;
use railbus_api::types::{LineInfo, ModuleInfo, PointInfo};
use railbus_site::config::Unwise;
use railbus_words::Lang;
pub use served::told;
pub use texts::FindingText;

/// The findings of a daemon about its machine and its site.
pub fn of_daemon(
    lang: Lang,
    lines: Vec<LineInfo>,
    modules: Vec<ModuleInfo>,
    points: &[PointInfo],
    certificate: Option<(String, Option<Timestamp>)>,
    integrations: &[OutletInfo],
    config: &config_file::FoundConfig,
) -> Vec<serde_json::Value> {
    let machine = Machine::this();
    let user = User::this(&machine);
    let variable = |name: &str| std::env::var(name).ok();
    let now = Timestamp::now();
    let mut found = system::check(lang, variable, now);
    found.extend(port::adapters(&machine, &user));
    if let Some((path, Some(end))) = certificate {
        found.extend(daemon::certificate(&path, end, now));
    }
    found.extend(outlets(integrations));
    found.extend(told(lang, lines, modules.into_iter(), points));
    found.extend(of_config(lang, &machine, config));
    found.sort_by_key(|finding| finding.section);
    found.iter().map(|finding| finding.json(lang)).collect()
}

/// The findings about a configuration without errors.
pub fn of_config(lang: Lang, machine: &Machine, found: &config_file::FoundConfig) -> Vec<Finding> {
    let text = config_file::text_of(&found.path).unwrap_or_default();
    let warnings = config_check::lints(machine, &found.config);
    let mut findings: Vec<Finding> = warnings
        .iter()
        .map(|warning| match &warning.kind {
            Unwise::UnstablePort(stable) => port::unstable(&warning.path, stable.as_deref()),
            _ => Finding::of_lint(&Shown::of(lang, &text, warning)),
        })
        .collect();
    if !findings
        .iter()
        .any(|finding| finding.section == Section::Config)
    {
        let (file, loads) = (
            found.path.display(),
            config_check::loads(lang, &found.config),
        );
        let values: &[(&str, &dyn std::fmt::Display)] = &[("file", &file), ("loads", &loads)];
        let text = lang.fill(FindingText::ConfigGood, values);
        findings.push(Finding::good(Section::Config, text));
    }
    findings
}
