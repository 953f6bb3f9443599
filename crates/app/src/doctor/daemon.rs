//! The daemon's own certificate.

use super::finding::{Finding, Section};
use jiff::Timestamp;
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

#[cfg(test)]
mod tests {
    use super::*;

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
