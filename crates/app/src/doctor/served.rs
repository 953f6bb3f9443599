//! The lines and modules of a daemon, as it reports them: no other program may open them.

use super::finding::{Finding, Section};
use super::texts::FindingText;
use crate::texts::AppText;
use railbus_api::types::{LineInfo, ModuleInfo, ModuleState, PointInfo, PortState};
use railbus_words::Lang;
use railbus_words::time;

/// The findings about these lines and modules.
pub fn told(
    lang: Lang,
    lines: Vec<LineInfo>,
    modules: impl Iterator<Item = ModuleInfo>,
    points: &[PointInfo],
) -> Vec<Finding> {
    let mut found: Vec<Finding> = lines
        .iter()
        .flat_map(|line| line_at_daemon(lang, line))
        .collect();
    // On a line that is not open no module can be read.
    let is_open = |module: &ModuleInfo| {
        let line = lines.iter().find(|line| line.line == module.line);
        line.is_some_and(|line| line.state == PortState::Up)
    };
    found.extend(modules_at_daemon(lang, modules.filter(is_open), points));
    found
}

fn line_at_daemon(lang: Lang, line: &LineInfo) -> Vec<Finding> {
    let mut found = Vec::new();
    let detail = match &line.holder {
        Some(holder) => format!("{}, {holder}", line.port),
        None => line.port.clone(),
    };
    let good =
        |text: FindingText| Finding::good(Section::Port, lang.fill(text, &[("line", &line.line)]));
    found.push(match (line.state, line.reason.as_deref()) {
        (PortState::Up, _) => good(FindingText::LineUp),
        // Not open yet, and no problem so far.
        (PortState::Opening, _) => good(FindingText::LineOpening),
        (PortState::Busy, _) => Finding::error(Section::Port, "D104", detail),
        (_, Some("permission")) => Finding::error(Section::Port, "D102", detail),
        (_, Some("missing")) => Finding::error(Section::Port, "D103", detail),
        (_, Some("not_a_tty")) => Finding::error(Section::Port, "D111", detail),
        (_, Some("refused" | "unreachable")) => Finding::error(Section::Port, "D112", detail),
        _ => Finding::error(Section::Port, "D113", detail),
    });
    if line.babble {
        found.push(Finding::error(Section::Line, "D204", line.line.clone()));
    }
    found
}

/// A busy machine causes this many late replies per hour on a good line.
const LATE_MAX: u32 = 5;

/// Which modules answer, which do not, and since when.
fn modules_at_daemon(
    lang: Lang,
    modules: impl Iterator<Item = ModuleInfo>,
    points: &[PointInfo],
) -> Vec<Finding> {
    let mut found = Vec::new();
    let (mut answered, mut unasked) = (Vec::new(), Vec::new());
    for module in modules {
        if module.late_1h > LATE_MAX {
            let detail = format!("{} ({} / h)", module.module, module.late_1h);
            found.push(Finding::warning(Section::Modules, "D304", detail));
        }
        if module.state == ModuleState::Online {
            answered.push(module.module);
            continue;
        }
        if module.state == ModuleState::Unheard && module.lost.is_none() {
            unasked.push(module.module);
            continue;
        }
        let address = railbus_wire::Address(module.address);
        let at = format!("{} ({address}, {})", module.module, module.protocol);
        if let Some(says) = &module.answers_as {
            let values: &[(&str, &dyn std::fmt::Display)] =
                &[("found", says), ("model", &module.title)];
            let says = lang.fill(AppText::AnswersAs, values);
            let detail = lang.fill(AppText::Named, &[("title", &at), ("name", &says)]);
            found.push(Finding::error(Section::Modules, "D307", detail));
            continue;
        }
        let of_module = points.iter().filter(|point| point.module == module.module);
        let last = of_module.filter_map(|point| point.time.as_deref()).max();
        let detail = match last {
            Some(last) => {
                let clock = time::clock_of(Some(last));
                let values: &[(&str, &dyn std::fmt::Display)] = &[("at", &at), ("time", &clock)];
                lang.fill(FindingText::LastGood, values)
            }
            None => at,
        };
        found.push(Finding::unanswered(lang, &detail, module.lost.as_ref()));
    }
    if !unasked.is_empty() {
        let text = lang.fill(FindingText::NotAsked, &[("modules", &unasked.join(" "))]);
        found.push(Finding::good(Section::Modules, text));
    }
    if !answered.is_empty() {
        let (count, modules) = (answered.len(), answered.join(" "));
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("count", &count),
            ("line", &"railbus serve"),
            ("modules", &modules),
        ];
        found.push(Finding::good(
            Section::Modules,
            lang.fill(FindingText::Answers, values),
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::types::Lost;
    use serde_json::json;

    #[test]
    fn a_line_that_is_being_opened_is_not_called_open() {
        let said = |lang, state: &str| {
            let line: LineInfo = serde_json::from_value(json!({
                "line": "main", "port": "/dev/ttyUSB0", "state": state, "baud": 9600,
                "format": "8N1", "babble": false, "modules": ["oven"],
            }))
            .unwrap();
            let module: ModuleInfo = serde_json::from_value(json!({
                "module": "oven", "line": "main", "address": 3, "protocol": "rtu", "model": "erc8",
                "title": "ERC-8", "state": "unheard", "errors_1h": 0, "late_1h": 0, "outputs": "",
                "inputs": "",
            }))
            .unwrap();
            let found = told(lang, vec![line], [module].into_iter(), &[]);
            found
                .iter()
                .map(|finding| finding.detail.clone())
                .collect::<Vec<_>>()
        };
        assert_eq!(
            said(Lang::En, "up"),
            ["main is open (daemon)", "not asked yet: oven"]
        );
        // Nothing is reported about its modules, either.
        assert_eq!(
            said(Lang::En, "opening"),
            ["main is still being opened (daemon): nothing is known of it yet"]
        );
        assert!(!said(Lang::Zh, "opening").concat().contains("已打开"));
    }

    #[test]
    fn a_silent_module_is_told_with_the_time_of_its_last_value() {
        let module = |name: &str, state: &str, late: u32| -> ModuleInfo {
            serde_json::from_value(json!({
                "module": name, "line": "main", "address": 5, "protocol": "rtu", "model": "erc8",
                "title": "ERC-8", "state": state, "errors_1h": 0, "late_1h": late, "outputs": "",
                "inputs": "",
            }))
            .unwrap()
        };
        let point = |module: &str, time: &str| -> PointInfo {
            serde_json::from_value(json!({
                "path": "p", "module": module, "label": "k1", "kind": "output", "index": 0,
                "value": true, "quality": "bad", "reason": "offline", "time": time,
            }))
            .unwrap()
        };
        let points = [
            point("tank", "2026-11-21T12:41:07.000Z"),
            point("tank", "2026-11-21T12:40:00.000Z"),
        ];
        let modules = [
            module("oven", "online", 1),
            module("slow", "online", 6),
            module("tank", "offline", 0),
            module("shed", "unheard", 0),
            ModuleInfo {
                lost: Some(Lost {
                    attempts: 7,
                    garbled: 6,
                    rx_bytes: 36,
                    why: Some("wrong checksum".to_owned()),
                }),
                ..module("kiln", "unheard", 0)
            },
        ];
        let found = modules_at_daemon(Lang::En, modules.into_iter(), &points);
        let told: Vec<(Option<&str>, &str)> =
            found.iter().map(|f| (f.code, f.detail.as_str())).collect();
        let last = time::clock_of(Some("2026-11-21T12:41:07.000Z"));
        assert_eq!(told[0], (Some("D304"), "slow (6 / h)"));
        let tank = format!("tank (5 (05h), rtu), last good {last}");
        assert_eq!(told[1], (Some("D301"), tank.as_str()));
        let kiln =
            "kiln (5 (05h), rtu); requests: 7, garbled replies: 6, bytes: 36 (wrong checksum)";
        assert_eq!(told[2], (Some("D302"), kiln));
        assert_eq!(told[3], (None, "not asked yet: shed"));
        assert_eq!(told[4], (None, "online on railbus serve: oven slow (2)"));
    }
}
