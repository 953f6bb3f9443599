//! The rules of a site, in the types of the API.

use super::control::names;
use super::convert::millis;
use super::past::moment;
use jiff::{SignedDuration, Timestamp};
use railbus_api::rules::{ActionText, RuleInfo, RuleState, TriedInfo, WhenText};
use railbus_api::types::SCHEMA;
use railbus_device::PointKind;
use railbus_site::config::{Action, When};
use railbus_site::rules::{Phase, Tried};
use railbus_site::{Config, RuleStatus};

/// When a rule would have triggered.
pub fn tried(tried: Tried) -> TriedInfo {
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

/// A rule, with its state.
pub fn rule(config: &Config, status: RuleStatus) -> RuleInfo {
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
