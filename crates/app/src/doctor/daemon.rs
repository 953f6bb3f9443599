//! The daemon's own certificate, and its integrations.

use super::finding::{Finding, Section};
use jiff::Timestamp;
use railbus_api::outlets::OutletInfo;
use railbus_words::time;

/// How many days before its expiry a certificate is reported.
const EXPIRY_DAYS: i64 = 30;

/// The findings about the daemon's own certificate: none while it is valid for long enough.
pub(super) fn certificate(path: &str, end: Timestamp, now: Timestamp) -> Option<Finding> {
    let days = end.duration_since(now).as_secs().div_euclid(86_400);
    let detail = format!("{path} ({})", time::rfc3339(end));
    match days {
        ..0 => Some(Finding::error(Section::Daemon, "D506", detail)),
        0..=EXPIRY_DAYS => Some(Finding::warning(Section::Daemon, "D505", detail)),
        _ => None,
    }
}

/// An integration that failed so many times in a row is reported.
const FAILURES_MIN: u32 = 3;

/// The findings about integrations: those that keep failing, each with its last error.
pub fn outlets(outlets: &[OutletInfo]) -> Vec<Finding> {
    let failing = outlets
        .iter()
        .filter(|outlet| outlet.enabled && outlet.failures >= FAILURES_MIN);
    let told = failing.map(|outlet| {
        let error = outlet.last_error.as_ref().map(|error| {
            let (code, reason) = (&error.problem.code, error.problem.text("reason"));
            match reason.is_empty() {
                true => format!(": {code}"),
                false => format!(": {code}, {reason}"),
            }
        });
        let (kind, name) = (&outlet.kind, &outlet.outlet);
        let detail = format!("{kind} {name}{}", error.unwrap_or_default());
        Finding::warning(Section::Daemon, "D509", detail)
    });
    told.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integration_that_keeps_failing_is_told_with_its_last_error() {
        let found = |failures: u32, enabled: bool| {
            let outlet = serde_json::json!({
                "kind": "webhook", "outlet": "alerts", "enabled": enabled, "state": "waiting",
                "since": "2026-03-01T12:00:00Z", "failures": failures, "settings": {},
                "secret": false, "sent": 0, "failed": 0, "dropped": 0, "queue": 1,
                "last_error": {
                    "at": "2026-03-01T12:00:00Z", "tries": 3,
                    "problem": {
                        "code": "E0857", "title": "x", "status": 502, "reason": "refused",
                    },
                },
            });
            outlets(&[serde_json::from_value(outlet).unwrap()])
        };
        let told = found(3, true).pop().unwrap();
        assert_eq!(told.code, Some("D509"));
        assert_eq!(told.detail, "webhook alerts: E0857, refused");
        assert!(found(2, true).is_empty() && found(3, false).is_empty());
    }

    #[test]
    fn a_certificate_is_told_of_before_it_ends() {
        let end: Timestamp = "2026-03-01T12:00:00Z".parse().unwrap();
        let code = |now: &str| {
            let found = certificate("tls.pem", end, now.parse().unwrap());
            found.and_then(|found| found.code)
        };
        assert_eq!(code("2026-01-29T12:00:00Z"), None);
        assert_eq!(code("2026-01-30T12:00:00Z"), Some("D505"));
        assert_eq!(code("2026-03-01T11:59:59Z"), Some("D505"));
        assert_eq!(code("2026-03-01T12:00:01Z"), Some("D506"));
    }
}
