//! Rules, as the API tells them.

use super::control::names;
use super::convert::millis;
use super::past::moment;
use super::types::SCHEMA;
use jiff::{SignedDuration, Timestamp};
use railbus_device::PointKind;
use railbus_site::config::{Action, When};
use railbus_site::rules::{Phase, Tried};
use railbus_site::{Config, RuleStatus};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// `GET /api/v1/rules`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Rules {
    pub(crate) schema: u8,
    /// The time zone of all times of day: that of the machine.
    pub(crate) time_zone: String,
    pub(crate) rules: Vec<RuleInfo>,
}

/// A rule, and how it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct RuleInfo {
    /// Its name in the configuration.
    pub(crate) rule: String,
    /// What people call it, by language.
    pub(crate) name: BTreeMap<String, String>,
    pub(crate) when: WhenText,
    /// For how long its condition must hold.
    pub(crate) for_ms: u64,
    pub(crate) then: Vec<ActionText>,
    /// Whether it acts.
    pub(crate) armed: bool,
    /// Whether it was tried against the history as it is now.
    pub(crate) tried: bool,
    /// Where it is.
    pub(crate) state: RuleState,
    /// When it acts if nothing changes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) due: Option<String>,
    /// When it last acted since the daemon began.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) last: Option<String>,
    /// How often it did.
    pub(crate) count: u64,
}

/// Where a rule is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RuleState {
    /// It does not act.
    Disarmed,
    /// What it waits for is not known.
    Unknown,
    /// It waits.
    Waiting,
    /// Its condition holds, and not yet for long enough.
    Holding,
    /// It has acted, and its condition has not ceased since.
    Acted,
    /// It acted too often, and does so no more until it is armed anew.
    Stopped,
}

/// A rule as somebody writes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = RuleText)]
pub(crate) struct RuleText {
    /// What people call it: one text, or one for each language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub(crate) name: Option<Value>,
    pub(crate) when: WhenText,
    /// For how long its condition must hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) for_ms: Option<u64>,
    /// What it does, one to eight things.
    pub(crate) then: Vec<ActionText>,
}

/// What a rule waits for: a `point` that `is`, or is `above` or `below` a value; a `time` of day;
/// or a module or a line that is offline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct WhenText {
    /// The path of a point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) point: Option<String>,
    /// On or off, high or low.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) is: Option<bool>,
    /// In the unit of the point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) above: Option<f64>,
    /// In the unit of the point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) below: Option<f64>,
    /// How far a value must come back before it counts as back.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) hysteresis: Option<f64>,
    /// The unit of the point: where it is said it is checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) unit: Option<String>,
    /// `06:30`, in the time zone of the machine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) time: Option<String>,
    /// `mon` to `sun`; all where nothing is said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) days: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) module_offline: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) line_offline: Option<String>,
}

/// What a rule does: `set` an output `to` a state, give a `pulse`, or `notify`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ActionText {
    /// The path of an output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) set: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) to: Option<bool>,
    /// The path of an output.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) pulse: Option<String>,
    /// How long the pulse is; needed where the module has no width of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) width_ms: Option<u64>,
    /// A text that is told as an event.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) notify: Option<String>,
}

/// Which part of the past a rule is tried against.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct TryRequest {
    /// The last so many hours, 1 to 168; 24 where nothing is said.
    pub(crate) hours: Option<u64>,
    /// Since when, as RFC 3339; at most 168 hours before `until`.
    #[schema(value_type = Option<String>)]
    pub(crate) since: Option<Timestamp>,
    /// Until when, as RFC 3339; now where nothing is said.
    #[schema(value_type = Option<String>)]
    pub(crate) until: Option<Timestamp>,
    /// The rule, where none of the configuration is meant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rule: Option<RuleText>,
    /// Under which name it is to stand in the configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) id: Option<String>,
}

/// When a rule would have acted, had it been armed and nothing else come of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct TriedInfo {
    pub(crate) schema: u8,
    pub(crate) since: String,
    pub(crate) until: String,
    /// When it would have acted: the first 500 times.
    pub(crate) acts: Vec<String>,
    /// How often.
    pub(crate) count: usize,
    /// When it would have been stopped for acting too often.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stopped: Option<String>,
    /// For how long nothing was known that it could go by.
    pub(crate) unknown_ms: u64,
    /// There was more than is looked at at once: it ends before what was asked for.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) cut: bool,
}

impl TriedInfo {
    pub(crate) fn new(tried: Tried) -> TriedInfo {
        TriedInfo {
            schema: SCHEMA,
            since: moment(tried.since),
            until: moment(tried.until),
            acts: tried.acts.into_iter().map(moment).collect(),
            count: tried.count,
            stopped: tried.stopped.map(moment),
            unknown_ms: u64::try_from(tried.unknown_ms).unwrap_or_default(),
            cut: tried.is_cut,
        }
    }
}

impl RuleInfo {
    pub(crate) fn new(config: &Config, status: RuleStatus) -> RuleInfo {
        let due = match status.left {
            Some(left) => {
                let left = SignedDuration::try_from(left).unwrap_or(SignedDuration::MAX);
                let due = Timestamp::now().checked_add(left);
                due.ok().map(Timestamp::as_millisecond)
            }
            None => status.next,
        };
        let rule = &status.rule;
        RuleInfo {
            state: state(&status),
            name: names(&rule.name),
            when: when(config, &rule.when),
            for_ms: millis(rule.hold),
            then: rule.then.iter().map(|done| action(config, done)).collect(),
            armed: rule.armed,
            tried: status.is_tried,
            due: due.map(moment),
            last: status.last.map(moment),
            count: status.count,
            rule: status.id,
        }
    }
}

const fn state(status: &RuleStatus) -> RuleState {
    match status.phase {
        None => RuleState::Disarmed,
        Some(Phase::Stopped) => RuleState::Stopped,
        Some(Phase::Acted) => RuleState::Acted,
        Some(Phase::Holding(_)) => RuleState::Holding,
        Some(Phase::Resting) if status.is_known => RuleState::Waiting,
        Some(Phase::Resting) => RuleState::Unknown,
    }
}

fn when(config: &Config, when: &When) -> WhenText {
    let mut text = WhenText {
        point: when.place().map(|place| config.path(place)),
        ..WhenText::default()
    };
    match when {
        When::Switch(_, is) => text.is = Some(*is),
        When::Analog(place, limit) => {
            let module = config.modules.get(&place.module);
            let unit = module.map(|module| module.range_of(place.point).unit.clone());
            text.unit = unit.filter(|_| place.point.kind == PointKind::Analog);
            let side = match limit.above {
                true => &mut text.above,
                false => &mut text.below,
            };
            *side = Some(limit.value);
            text.hysteresis = Some(limit.hysteresis).filter(|back| *back != 0.0);
        }
        When::Clock(clock) => {
            text.time = Some(format!("{:02}:{:02}", clock.hour, clock.minute));
            let days = clock.days().into_iter().map(str::to_owned);
            text.days = Some(days.collect()).filter(|days: &Vec<_>| !days.is_empty());
        }
        When::ModuleOffline(module) => text.module_offline = Some(module.clone()),
        When::LineOffline(line) => text.line_offline = Some(line.clone()),
    }
    text
}

fn action(config: &Config, action: &Action) -> ActionText {
    let mut text = ActionText::default();
    match action {
        Action::Set(place, to) => {
            (text.set, text.to) = (Some(config.path(place)), Some(*to));
        }
        Action::Pulse(place, width) => {
            (text.pulse, text.width_ms) = (Some(config.path(place)), width.map(millis));
        }
        Action::Notify(words) => text.notify = Some(words.clone()),
    }
    text
}
