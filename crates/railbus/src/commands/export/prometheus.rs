//! Prometheus: where it gets railbus' metrics, and its alerts.

use super::File;
use super::asked::{Asked, CERTIFICATE};
use super::quote::{comment, quoted};
use super::texts::ExportText;
use super::yaml::yaml;
use serde_json::{Value, json};

/// The files beside its configuration.
const RULES: &str = "railbus.rules.yml";
const TOKEN: &str = "railbus.token";

/// Its configuration.
pub(super) fn file(asked: &Asked<'_>) -> File {
    let mut job = json!({
        "job_name": "railbus",
        "scheme": if asked.url.is_tls { "https" } else { "http" },
        "metrics_path": "/metrics",
        // With the values of the points.
        "params": { "points": ["1"] },
        "authorization": { "credentials_file": TOKEN },
        "static_configs": [{
            "targets": [asked.url.target],
            "labels": { "site": asked.site },
        }],
    });
    if asked.url.is_tls {
        job["tls_config"] = json!({ "ca_file": CERTIFICATE });
    }
    let config = json!({
        "global": { "scrape_interval": "15s", "evaluation_interval": "15s" },
        "rule_files": [RULES],
        "scrape_configs": [job],
    });
    let notes: Vec<String> = std::iter::once(asked.token("prometheus", "viewer", TOKEN))
        .chain(asked.certificate(CERTIFICATE))
        .collect();
    let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &asked.site), ("rules", &RULES)];
    let mut text = comment(&asked.lang.fill(ExportText::Prometheus, values));
    notes.iter().for_each(|note| text += &comment(note));
    text += "\n";
    text += &yaml(&config);
    File { text, notes }
}

/// Its alerts, in a file of their own.
pub(super) fn rules(asked: &Asked<'_>) -> File {
    let of = asked.of_site();
    let alert = |name: &str, since: &str, severity: &str, expr: String, told: ExportText| {
        json!({
            "alert": name,
            "expr": expr,
            "for": since,
            "labels": { "severity": severity },
            "annotations": { "summary": asked.lang.get(told) },
        })
    };
    let failed = format!("rate(railbus_requests_total{{{of},result!=\"ok\"}}[10m])");
    let all = format!("rate(railbus_requests_total{{{of}}}[10m])");
    let by = "sum by (site, instance, line, module)";
    let is_absent = format!("on (site, instance, line) railbus_line_up{{{of}}} == 0");
    let polled = asked.of_polled();
    let mut rules = vec![
        alert(
            "RailbusDown",
            "1m",
            "critical",
            format!("up{{job=\"railbus\",{of}}} == 0"),
            ExportText::AlertDown,
        ),
        alert(
            "RailbusAuditFails",
            "1m",
            "critical",
            format!("railbus_audit_up{{{of}}} == 0"),
            ExportText::AlertAudit,
        ),
        alert(
            "RailbusLineAbsent",
            "1m",
            "critical",
            format!("railbus_line_up{{{of}}} == 0"),
            ExportText::AlertLine,
        ),
        // Not all modules of a line whose port is missing.
        alert(
            "RailbusModuleOffline",
            "1m",
            "warning",
            format!("railbus_module_up{{{polled}}} == 0 unless {is_absent}"),
            ExportText::AlertModule,
        ),
        alert(
            "RailbusExchangesFail",
            "10m",
            "warning",
            format!(
                "{by} ({failed}) / {by} ({all}) > 0.05 and on (site, instance, line, module) \
                 railbus_module_up{{{of}}} == 1"
            ),
            ExportText::AlertExchanges,
        ),
        alert(
            "RailbusLineBusy",
            "15m",
            "warning",
            format!("railbus_line_busy_ratio{{{of}}} > 0.9"),
            ExportText::AlertBusy,
        ),
        alert(
            "RailbusOutletDown",
            "5m",
            "warning",
            format!("railbus_outlet_up{{{of}}} == 0"),
            ExportText::AlertOutlet,
        ),
    ];
    // Only good values are told: as many as the module has points.
    let modules = asked.config.modules.iter();
    let modules = modules.filter(|(_, module)| module.plan.enabled);
    let modules = modules.map(|(name, module)| {
        let (its, points) = (
            format!("{of},module={}", quoted(name)),
            module.setup.points().count(),
        );
        let good =
            format!("count by (site, instance, module) (railbus_point_value{{{its}}}) >= {points}");
        format!("(railbus_module_up{{{its}}} == 1 unless on (site, instance, module) {good})")
    });
    let modules: Vec<String> = modules.collect();
    if !modules.is_empty() {
        let expr = modules.join(" or ");
        rules.push(alert(
            "RailbusValuesNotGood",
            "2m",
            "warning",
            expr,
            ExportText::AlertValues,
        ));
    }
    let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &asked.site), ("rules", &RULES)];
    let head = comment(&asked.lang.fill(ExportText::PrometheusRules, values));
    let groups: Value = json!({ "groups": [{ "name": "railbus", "rules": rules }] });
    File {
        text: head + "\n" + &yaml(&groups),
        notes: Vec::new(),
    }
}
