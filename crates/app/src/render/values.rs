//! Values of points in words.

use crate::texts::AppText;
use railbus_api::types::{Confirmed, ModuleState, PointInfo, Quality, Reason, Value};
use railbus_words::Lang;
use std::collections::BTreeMap;

/// `on`, `off`; `8.71 V`; `–` if unknown.
pub fn point(lang: Lang, point: &PointInfo) -> String {
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
pub fn bare(lang: Lang, point: &PointInfo, value: Value) -> String {
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
pub fn state(lang: Lang, on: bool) -> &'static str {
    lang.get(if on { AppText::On } else { AppText::Off })
}

/// The quality of a point's value, in a word, and its reason.
pub fn quality(lang: Lang, point: &PointInfo) -> &'static str {
    quality_for(lang, point.quality, point.reason)
}

/// The same for a quality and its reason.
pub fn quality_for(lang: Lang, quality: Quality, reason: Option<Reason>) -> &'static str {
    lang.get(match (quality, reason) {
        (Quality::Good, _) => AppText::Good,
        (Quality::Stale, _) => AppText::Stale,
        (Quality::Bad, Some(Reason::NeverRead)) => AppText::NeverRead,
        (Quality::Bad, Some(Reason::Offline)) => AppText::OfflineValue,
        (Quality::Bad, Some(Reason::OtherModel)) => AppText::OtherModel,
        (Quality::Bad, Some(Reason::LineAbsent)) => AppText::LineAbsent,
        (Quality::Bad, Some(Reason::LineBusy)) => AppText::LineBusy,
        (Quality::Bad, Some(Reason::Exclusive)) => AppText::LineLent,
        (Quality::Bad, Some(Reason::LineClosed)) => AppText::LineShut,
        (Quality::Bad, Some(Reason::Other) | None) => AppText::Bad,
    })
}

/// The display name: in the requested language, otherwise in the other one; empty if there is none.
pub fn called(lang: Lang, names: &BTreeMap<String, String>) -> String {
    let name = names.get(lang.name()).or_else(|| names.values().next());
    name.cloned().unwrap_or_default()
}

/// How far a write is confirmed, in words.
pub fn confirmed(lang: Lang, confirmed: Confirmed) -> &'static str {
    lang.get(match confirmed {
        Confirmed::Readback => AppText::ReadBack,
        Confirmed::Reply => AppText::Acknowledged,
        Confirmed::Sent => AppText::SentOnly,
    })
}

/// The state of a module, in a word.
pub fn presence(lang: Lang, state: ModuleState) -> &'static str {
    lang.get(match state {
        ModuleState::Online => AppText::Online,
        ModuleState::Offline => AppText::Offline,
        ModuleState::Unheard => AppText::Unheard,
        ModuleState::OtherModel => AppText::OtherModel,
    })
}
