//! The conditions that `wait` waits for.

use railbus_api::types::{Kind, PointInfo, Quality, Value};

/// A value that a point is to have.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Want {
    /// As the user wrote it: `pump.di0=on`.
    pub(super) word: String,
    /// The point.
    pub(super) path: String,
    /// As a state; `1` may be a state or a number.
    state: Option<bool>,
    /// As a range of numbers, both ends included.
    range: Option<(f64, f64)>,
}

impl Want {
    /// Parses a condition; none if it is invalid.
    pub(super) fn read(word: &str) -> Option<Want> {
        let (path, value) = word.split_once('=')?;
        let (module, label) = path.split_once('.')?;
        if module.is_empty() || label.is_empty() || path.contains(['*', '?', '[', ',', '/']) {
            return None;
        }
        let state = match value.to_ascii_lowercase().as_str() {
            "on" | "1" | "true" | "接通" | "吸合" => Some(true),
            "off" | "0" | "false" | "断开" => Some(false),
            _ => None,
        };
        let (low, high) = value.split_once("..").unwrap_or((value, value));
        let number = |text: &str| text.parse().ok().filter(|number: &f64| number.is_finite());
        let range = number(low).zip(number(high));
        let range = range.filter(|(low, high)| low <= high);
        (state.is_some() || range.is_some()).then(|| Want {
            word: word.to_owned(),
            path: path.to_owned(),
            state,
            range,
        })
    }

    /// Whether a point of this kind can have such a value.
    pub(super) const fn can_be(&self, point: &PointInfo) -> bool {
        match point.kind {
            Kind::Output | Kind::Input => self.state.is_some(),
            Kind::Analog | Kind::Variable => self.range.is_some(),
        }
    }

    /// Whether the point has it, with good quality. A number is compared as it is displayed.
    pub(super) fn is_met_by(&self, point: Option<&PointInfo>) -> bool {
        let Some(point) = point.filter(|point| point.quality == Quality::Good) else {
            return false;
        };
        let within = |value: f64, slack: f64| {
            let range = self.range;
            range.is_some_and(|(low, high)| (low - slack..=high + slack).contains(&value))
        };
        match point.value {
            Some(Value::Bool(on)) => self.state == Some(on),
            Some(Value::Number(number)) => within(f64::from(number), 0.0),
            Some(Value::Analog(value)) => {
                let decimals = point.decimals.unwrap_or(2);
                within(value, 0.5 * 10_f64.powi(-i32::from(decimals)))
            }
            None => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(kind: &str, value: serde_json::Value, quality: &str) -> PointInfo {
        serde_json::from_value(serde_json::json!({
            "path": "a.b", "module": "a", "label": "b", "kind": kind, "index": 0,
            "value": value, "decimals": 2, "quality": quality,
        }))
        .expect("a point")
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for word in [
            "a.b",
            "a=on",
            "a.b=",
            "a.b=maybe",
            ".b=on",
            "a.=on",
            "*.b=on",
            "a.b=2..1",
            "a.b=nan",
            "a.b=1..",
            "a.b,c=on",
        ] {
            assert_eq!(Want::read(word), None, "{word}");
        }
    }

    #[test]
    fn a_value_counts_only_in_good_quality() {
        let want = Want::read("a.b=ON").expect("a state");
        assert!(want.is_met_by(Some(&point("input", true.into(), "good"))));
        for (value, quality) in [(true, "stale"), (true, "bad"), (false, "good")] {
            let point = point("input", value.into(), quality);
            assert!(!want.is_met_by(Some(&point)), "{value} {quality}");
        }
        assert!(!want.is_met_by(None));
        assert!(!want.can_be(&point("analog", 1.0.into(), "good")));
    }

    #[test]
    fn numbers_are_compared_as_they_are_shown() {
        let met = |word: &str, value: f64| {
            let want = Want::read(word).expect("a number");
            want.is_met_by(Some(&point("analog", value.into(), "good")))
        };
        assert!(met("a.b=8.71", 8.712) && !met("a.b=8.71", 8.72));
        assert!(met("a.b=8..9", 8.5) && met("a.b=-1..1", -1.0) && !met("a.b=8..9", 9.01));
    }
}
