//! Shows findings to people and programs.

use super::texts::DoctorText;
use crate::commands::Context;
use railbus_app::doctor::{CheckState, Finding, Section};
use railbus_app::failure::Failure;
use railbus_app::render::colour::Paint;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, records};
use railbus_app::texts::AppText;
use railbus_words::Lang;
use railbus_words::width;
use serde_json::json;

pub(super) fn result(context: &Context, found: &[Finding]) -> Result<(), Failure> {
    let lang = context.lang;
    let count = |state: CheckState| found.iter().filter(|f| f.state == state).count();
    let (errors, warnings) = (count(CheckState::Error), count(CheckState::Warning));
    let rows = || {
        found
            .iter()
            .map(|finding| finding.json(lang))
            .collect::<Vec<_>>()
    };
    let text = match context.format {
        Format::Table => {
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("errors", &errors), ("warnings", &warnings)];
            let end = lang.fill(DoctorText::Summary, values);
            format!("{}{end}\n", page(lang, found, context.paint()))
        }
        Format::Json => records::line(json!({
            "findings": rows(), "errors": errors, "warnings": warnings,
        })),
        format => {
            let records = Records {
                key: "findings",
                rows: rows(),
                columns: &["section", "state", "code", "message"],
                value: "code",
                table: Table::bare(),
            };
            records.render(format)
        }
    };
    out::result(lang, &text)
}

/// Section by section; marks have words beside them for readers without colours.
fn page(lang: Lang, found: &[Finding], paint: Paint) -> String {
    let heads = [
        Section::System,
        Section::Port,
        Section::Line,
        Section::Modules,
        Section::Config,
        Section::Daemon,
        Section::Fleet,
    ]
    .map(|section| heading(lang, section));
    let margin = heads
        .iter()
        .map(|head| width::of(head))
        .max()
        .unwrap_or_default()
        + 2;
    let mut text = String::new();
    let mut last = None;
    for finding in found {
        let head = match last {
            Some(section) if section == finding.section => "",
            _ => heading(lang, finding.section),
        };
        last = Some(finding.section);
        let mark = match finding.state {
            CheckState::Ok => paint.good("✓"),
            CheckState::Warning => paint.doubtful("!"),
            CheckState::Error => paint.bad("✗"),
        };
        let code = finding
            .code
            .map(|code| format!("{code} "))
            .unwrap_or_default();
        text += &format!(
            "{}{mark} {code}{}\n",
            width::pad(head, margin),
            finding.message(lang)
        );
        let (likely, fix) = (lang.get(AppText::Likely), lang.get(DoctorText::FixLabel));
        let wide = width::of(likely).max(width::of(fix)) + 1;
        let steps = finding.steps(lang);
        let first = std::iter::once(fix).chain(std::iter::repeat(""));
        let likely = finding.likely(lang).map(|why| (likely, why));
        let steps = first.zip(steps.iter().map(String::as_str));
        for (label, line) in likely.into_iter().chain(steps) {
            let label = width::pad(label, wide);
            text += &format!("{}{label}{line}\n", " ".repeat(margin + 7));
        }
    }
    text
}

fn heading(lang: Lang, section: Section) -> &'static str {
    lang.get(match section {
        Section::System => DoctorText::System,
        Section::Port => DoctorText::Port,
        Section::Line => DoctorText::Line,
        Section::Modules => DoctorText::Modules,
        Section::Config => DoctorText::Config,
        Section::Daemon => DoctorText::Daemon,
        Section::Fleet => DoctorText::Fleet,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_are_headed_once_and_steps_stand_below() {
        let denied = Finding::error(Section::Port, "D102", "/dev/x".to_owned());
        let found = [
            Finding::good(Section::System, "fine".to_owned()),
            denied
                .with_fix("sudo one".to_owned())
                .with_fix("sudo two".to_owned()),
            Finding::warning(Section::Port, "D103", "/dev/y".to_owned()),
        ];
        assert_eq!(
            page(Lang::En, &found, Paint::Plain),
            "system   ✓ fine\n\
             port     ✗ D102 permission denied: can't open the port: /dev/x\n                \
             likely: you are not in the device's group\n                \
             fix:    sudo one\n                        sudo two\n         \
             ! D103 port not found: /dev/y\n                \
             likely: adapter not plugged in · another number after plugging it in \
             again\n                \
             fix:    railbus ls ports\n"
        );
        let zh = page(Lang::Zh, &found, Paint::Plain);
        assert!(
            zh.starts_with("系统      ✓ fine\n端口      ✗ D102 无权打开端口：/dev/x\n"),
            "{zh}"
        );
    }
}
