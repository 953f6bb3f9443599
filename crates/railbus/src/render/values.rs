//! Values of points in words.

use crate::texts::Text;
use railbus_api::types::{Confirmed, ModuleState, PointInfo, Quality, Reason, Value};
use railbus_words::Lang;
use std::collections::BTreeMap;

/// `on`, `off`; `8.71 V`; `–` where nothing is known.
pub(crate) fn point(lang: Lang, point: &PointInfo) -> String {
    match point.value {
        None => "–".to_owned(),
        Some(value) => {
            let text = bare(lang, point, value);
            match &point.unit {
                Some(unit) => format!("{text} {unit}"),
                None => text,
            }
        }
    }
}

/// A value of a point without its unit, in words.
pub(crate) fn bare(lang: Lang, point: &PointInfo, value: Value) -> String {
    match value {
        Value::Bool(on) => state(lang, on).to_owned(),
        Value::Number(number) => number.to_string(),
        Value::Analog(value) => {
            let decimals = usize::from(point.decimals.unwrap_or(2));
            format!("{value:.decimals$}")
        }
    }
}

/// The state of an output or an input in a word.
pub(crate) fn state(lang: Lang, on: bool) -> &'static str {
    lang.get(if on { Text::On } else { Text::Off })
}

/// How good the value of a point is, in a word, and why.
pub(crate) fn quality(lang: Lang, point: &PointInfo) -> &'static str {
    lang.get(match (point.quality, point.reason) {
        (Quality::Good, _) => Text::Good,
        (Quality::Stale, _) => Text::Stale,
        (Quality::Bad, Some(Reason::NeverRead)) => Text::NeverRead,
        (Quality::Bad, Some(Reason::Offline)) => Text::OfflineValue,
        (Quality::Bad, Some(Reason::OtherModel)) => Text::OtherModel,
        (Quality::Bad, Some(Reason::LineAbsent)) => Text::LineAbsent,
        (Quality::Bad, Some(Reason::LineBusy)) => Text::LineBusy,
        (Quality::Bad, Some(Reason::Lent)) => Text::LineLent,
        (Quality::Bad, Some(Reason::LineClosed)) => Text::LineShut,
        (Quality::Bad, Some(Reason::Other) | None) => Text::Bad,
    })
}

/// What something is called: in the language asked for, else in the one it has a name in; nothing
/// where it has none.
pub(crate) fn called(lang: Lang, names: &BTreeMap<String, String>) -> String {
    let name = names.get(lang.name()).or_else(|| names.values().next());
    name.cloned().unwrap_or_default()
}

/// How certain a write is, in words.
pub(crate) fn confirmed(lang: Lang, confirmed: Confirmed) -> &'static str {
    lang.get(match confirmed {
        Confirmed::Readback => Text::ReadBack,
        Confirmed::Reply => Text::Acknowledged,
        Confirmed::Sent => Text::SentOnly,
    })
}

/// Whether a module is heard, in a word.
pub(crate) fn presence(lang: Lang, state: ModuleState) -> &'static str {
    lang.get(match state {
        ModuleState::Online => Text::Online,
        ModuleState::Offline => Text::Offline,
        ModuleState::Unheard => Text::Unheard,
        ModuleState::OtherModel => Text::OtherModel,
    })
}
