//! The clock and the locale of the machine.

use super::finding::{Finding, Section};
use super::texts::FindingText;
use jiff::Timestamp;
use railbus_words::Lang;

/// 2026-01-01: this program is not older.
const BUILT: i64 = 1_767_225_600;

/// Checks the clock, and the locale set by the variables.
pub fn check(
    lang: Lang,
    variable: impl Fn(&str) -> Option<String>,
    now: Timestamp,
) -> Vec<Finding> {
    let mut found = Vec::new();
    let date = now.strftime("%Y-%m-%d").to_string();
    if now.as_second() < BUILT {
        found.push(Finding::error(Section::System, "D101", date.clone()));
    }
    let variables = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter();
    let locale = variables
        .filter_map(variable)
        .find(|value| !value.is_empty());
    let locale = locale.unwrap_or_else(|| "C".to_owned());
    let lower = locale.to_lowercase();
    if !lower.contains("utf-8") && !lower.contains("utf8") {
        found.push(Finding::warning(Section::System, "D110", locale.clone()));
    }
    if found.is_empty() {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("date", &date), ("locale", &locale)];
        found.push(Finding::good(
            Section::System,
            lang.fill(FindingText::SystemGood, values),
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(second: i64, variables: &[(&str, &str)]) -> Vec<Option<&'static str>> {
        let variable = |name: &str| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        let now = Timestamp::from_second(second).unwrap();
        let found = check(Lang::En, variable, now);
        found.into_iter().map(|finding| finding.code).collect()
    }

    #[test]
    fn clock_and_locale() {
        let now = BUILT + 1;
        assert_eq!(codes(now, &[("LANG", "zh_CN.UTF-8")]), [None]);
        assert_eq!(codes(now, &[("LC_ALL", "C.utf8"), ("LANG", "C")]), [None]);
        assert_eq!(codes(now, &[]), [Some("D110")]);
        assert_eq!(codes(now, &[("LANG", "zh_CN.GB18030")]), [Some("D110")]);
        assert_eq!(codes(0, &[("LANG", "C.UTF-8")]), [Some("D101")]);
    }
}
