//! From the site's types to those of the API.

use jiff::{SignedDuration, Timestamp};
use railbus_api::types::{
    CommandInfo, Confirmed, FrameEvent, Kind, LeaseInfo, LineInfo, Lost, ModuleInfo, ModuleState,
    Outcome, PointInfo, PortState, Quality, Reason, Timekeeper, Value,
};
use railbus_bus::Evidence;
use railbus_device::PointKind;
use railbus_host::{LineState, PortError, Presence, Probed, TapFrame};
use railbus_site::config::{Confirm, Name};
use railbus_site::{By, Left, LineStatus, ModuleStatus, PointStatus, Service};
use railbus_wire::{Instant, Micros};
use railbus_words::time::rfc3339;
use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

/// Milliseconds, rounded.
pub const fn millis(time: Micros) -> u64 {
    (time.0 + 500) / 1_000
}

/// Milliseconds with one decimal.
pub fn millis_tenths(time: Micros) -> f64 {
    ((time.0 + 50) / 100) as f64 / 10.0
}

/// A line.
pub fn line(status: LineStatus) -> LineInfo {
    let (state, why) = match &status.state {
        LineState::Opening => (PortState::Opening, None),
        LineState::Up => (PortState::Up, None),
        LineState::Absent(why)
            if matches!(**why, PortError::Busy { .. } | PortError::Exclusive) =>
        {
            (PortState::Busy, Some(why))
        }
        LineState::Absent(why) => (PortState::Absent, Some(why)),
        LineState::Closed => (PortState::Closed, None),
    };
    let holder = match why.map(|why| &**why) {
        Some(PortError::Busy { holder }) => holder.as_ref(),
        _ => None,
    };
    LineInfo {
        line: status.name,
        name: by_language(status.called),
        port: status.port,
        state,
        reason: why.map(|why| why.name().to_owned()),
        holder: holder.map(|holder| format!("{} ({})", holder.name, holder.pid)),
        baud: status.serial.baud.rate(),
        format: status.serial.character.to_string(),
        babble: status.babble,
        modules: status.modules,
    }
}

/// A module with the states of its channels.
pub fn module(service: &Service, status: ModuleStatus) -> ModuleInfo {
    let points = service.points(&status.name);
    let bits = |kind| {
        let of_kind = points.iter().filter(|status| status.point.kind == kind);
        of_kind
            .map(|status| match (status.quality, status.value) {
                // Its state a while ago says nothing about its present one.
                (railbus_site::PointQuality::Good, Some(railbus_site::PointValue::Bool(true))) => {
                    '1'
                }
                (railbus_site::PointQuality::Good, Some(railbus_site::PointValue::Bool(false))) => {
                    '0'
                }
                _ => '?',
            })
            .collect()
    };
    let is_online = status.presence == Presence::Online;
    // By age, not by time: the clock on the wall may have been set between two readings.
    let read = points.iter().filter(|_| !is_online);
    let newest = read.min_by_key(|point| point.age.unwrap_or(Micros(u64::MAX)));
    let last_good = newest.and_then(|point| point.time).and_then(wall);
    ModuleInfo {
        outputs: bits(PointKind::Output),
        inputs: bits(PointKind::Input),
        module: status.name,
        name: by_language(status.called),
        area: status.area,
        line: status.line,
        address: status.setup.address.0,
        protocol: status.setup.protocol.name().to_owned(),
        model: status.setup.family.name().to_owned(),
        title: status.setup.family.to_string(),
        baud: Some(status.setup.serial.baud.rate()),
        format: Some(status.setup.serial.character.to_string()),
        checksum: Some(status.setup.checksum),
        state: match status.presence {
            Presence::Online => ModuleState::Online,
            Presence::Silent => ModuleState::Offline,
            Presence::Unheard => ModuleState::Unheard,
            Presence::OtherModel => ModuleState::OtherModel,
        },
        answers_as: status.stranger,
        last_good,
        rtt_ms: status.rtt.filter(|_| is_online).map(millis_tenths),
        errors_1h: status.errors,
        late_1h: status.late,
        lost: (!is_online && status.lost.attempts > 0).then(|| lost(status.lost)),
    }
}

/// A point.
pub fn point(status: PointStatus) -> PointInfo {
    let config = status.config;
    let safety = config.safety;
    let (quality, reason) = quality(status.quality);
    PointInfo {
        path: format!("{}.{}", status.module, status.label),
        module: status.module,
        label: status.label,
        kind: kind(status.point.kind),
        index: status.point.index,
        name: by_language(Name {
            en: config.name_en,
            zh: config.name_zh,
        }),
        value: status.value.map(value),
        raw: raw(status.value),
        unit: status.range.as_ref().map(|range| range.unit.clone()),
        decimals: status.range.as_ref().map(|range| range.decimals),
        quality,
        reason,
        age_ms: status.age.map(millis),
        max_age_ms: status.max_age.map(millis),
        time: status.time.and_then(wall),
        hidden: config.hidden,
        locked: config.locked,
        confirm: safety.confirm.is_some(),
        hold: safety.confirm == Some(Confirm::Hold),
        interlock: status.interlock,
        max_on_ms: safety.max_on.map(millis),
        min_off_ms: safety.min_off.map(millis),
        on_until: status.left.max_on.and_then(from_now),
        pulse_until: status.left.pulse.and_then(from_now),
        lease: lease(status.left),
        pulse_ms: status.pulse.map(millis),
    }
}

/// The kind of a point.
pub(super) const fn kind(kind: PointKind) -> Kind {
    match kind {
        PointKind::Output => Kind::Output,
        PointKind::Input => Kind::Input,
        PointKind::Analog => Kind::Analog,
        PointKind::Variable => Kind::Variable,
    }
}

/// The register of an analog value.
pub(super) const fn raw(value: Option<railbus_site::PointValue>) -> Option<u16> {
    match value {
        Some(railbus_site::PointValue::Analog(_, register)) => Some(register),
        _ => None,
    }
}

/// The quality of a value, and why it is bad.
pub const fn quality(quality: railbus_site::PointQuality) -> (Quality, Option<Reason>) {
    match quality {
        railbus_site::PointQuality::Good => (Quality::Good, None),
        railbus_site::PointQuality::Stale => (Quality::Stale, None),
        railbus_site::PointQuality::Bad(why) => (Quality::Bad, Some(reason(why))),
    }
}

/// The lease of an output, where there is one.
pub(super) fn lease(left: Left) -> Option<LeaseInfo> {
    let until = left.lease.and_then(from_now)?;
    Some(LeaseInfo { until })
}

/// The display name, by the languages in which there is one.
fn by_language(Name { en, zh }: Name) -> BTreeMap<String, String> {
    let names = [("en", en), ("zh", zh)].into_iter();
    let named = names.filter_map(|(lang, name)| Some((lang.to_owned(), name?)));
    named.collect()
}

/// A time by the clock on the wall.
pub(super) fn wall(time: SystemTime) -> Option<String> {
    Timestamp::try_from(time).ok().map(rfc3339)
}

/// The time this long from now.
pub fn from_now(left: Duration) -> Option<String> {
    let left = SignedDuration::try_from(left).ok()?;
    Timestamp::now().checked_add(left).ok().map(rfc3339)
}

/// Why a value is bad.
const fn reason(why: railbus_site::BadReason) -> Reason {
    use railbus_site::BadReason as R;
    match why {
        R::NeverRead => Reason::NeverRead,
        R::Offline => Reason::Offline,
        R::OtherModel => Reason::OtherModel,
        R::LineAbsent => Reason::LineAbsent,
        R::LineBusy => Reason::LineBusy,
        R::Exclusive => Reason::Exclusive,
        R::LineClosed => Reason::LineClosed,
    }
}

/// A recent command.
pub fn command(command: railbus_site::Command) -> CommandInfo {
    CommandInfo {
        id: command.id,
        module: command.module,
        what: command.what,
        who: command.origin.who,
        via: command.origin.via,
        at: wall(command.at).unwrap_or_default(),
        end: command.end.map(|end| end.name().to_owned()),
    }
}

/// A value.
pub const fn value(value: railbus_site::PointValue) -> Value {
    match value {
        railbus_site::PointValue::Bool(on) => Value::Bool(on),
        railbus_site::PointValue::Analog(value, _) => Value::Analog(value),
        railbus_site::PointValue::Number(number) => Value::Number(number),
    }
}

/// How far a result is confirmed.
pub const fn confirmed(confirmed: railbus_host::Confirmation) -> Confirmed {
    match confirmed {
        railbus_host::Confirmation::Readback => Confirmed::Readback,
        railbus_host::Confirmation::Reply => Confirmed::Reply,
        railbus_host::Confirmation::Sent => Confirmed::Sent,
    }
}

/// The result of a probe.
pub const fn outcome(probed: Probed) -> Outcome {
    match probed {
        Probed::Answered => Outcome::Answered,
        Probed::Garbled => Outcome::Garbled,
        Probed::Silent => Outcome::Silent,
        Probed::Unsafe => Outcome::Unsafe,
    }
}

/// What times a pulse, as requested.
pub const fn by(by: Timekeeper) -> By {
    match by {
        Timekeeper::Auto => By::Auto,
        Timekeeper::Device => By::Device,
        Timekeeper::Host => By::Host,
    }
}

/// What times a pulse, in fact.
pub const fn timekeeper(by: By) -> Timekeeper {
    match by {
        By::Auto => Timekeeper::Auto,
        By::Device => Timekeeper::Device,
        By::Host => Timekeeper::Host,
    }
}

/// The start of a line's clock, in microseconds since 1970, if its present time is this.
pub fn start_of(now: Instant) -> u64 {
    let epoch = Timestamp::now().as_microsecond();
    u64::try_from(epoch)
        .unwrap_or_default()
        .saturating_sub(now.0)
}

/// The traffic on a line whose clock started then.
pub fn passed(start: u64, passed: Result<TapFrame, u64>) -> FrameEvent {
    let TapFrame { at, sent, bytes } = match passed {
        Ok(passed) => passed,
        Err(dropped) => return FrameEvent::Gap { dropped },
    };
    let Instant(micros) = at;
    let at_us = start.saturating_add(micros);
    let bytes = railbus_words::hex::spaced(&bytes);
    match sent {
        None => FrameEvent::Heard { at_us, bytes },
        Some(settings) => FrameEvent::Sent {
            at_us,
            baud: settings.baud.rate(),
            format: settings.character.to_string(),
            bytes,
        },
    }
}

/// What was received instead of a valid reply.
pub fn lost(met: Evidence) -> Lost {
    Lost {
        attempts: met.attempts,
        garbled: met.garbled,
        rx_bytes: met.bytes,
        why: met.why.map(|why| why.to_string()),
    }
}
