//! What clients read: the site as the stream reported it last.
//!
//! Values, their quality and what subscribers get all come from here, so that a read never says
//! something else than a subscription does.

use crate::status;
use opcua::types::{DataValue, DateTime, NodeId, StatusCode, Variant};
use railbus_device::{Point, PointKind};
use railbus_host::{LineState, Presence};
use railbus_site::{Config, LineStatus, ModuleStatus, News, PointQuality, PointStatus, PointValue};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::SystemTime;

/// The last part of the names of nodes that are not points.
pub(crate) const STATE: &str = "State";
pub(crate) const ROUND_TRIP: &str = "RoundTrip";
/// The first part of the names of the nodes of lines.
pub(crate) const LINE: &str = "line";

/// The site as it was reported last.
#[derive(Debug, Default)]
pub(crate) struct KnownSite {
    /// The modules that are shown; empty for all.
    chosen: Vec<String>,
    config: Arc<Config>,
    lines: BTreeMap<String, LineStatus>,
    modules: BTreeMap<String, ModuleStatus>,
    points: BTreeMap<String, PointStatus>,
}

/// What came with some news.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Told {
    /// The nodes are other ones, or described otherwise.
    pub(crate) is_other: bool,
    /// The nodes whose values may be other ones.
    pub(crate) changed: Vec<String>,
}

/// What a node stands for, as far as it has a value that changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Named<'n> {
    /// A point by its path, or something of the fixed nodes.
    Point(&'n str),
    ModuleState(&'n str),
    RoundTrip(&'n str),
    LineState(&'n str),
}

fn named(name: &str) -> Option<Named<'_>> {
    let parts: Vec<&str> = name.split('/').collect();
    match parts.as_slice() {
        [path] => Some(Named::Point(path)),
        [LINE, line, STATE] => Some(Named::LineState(line)),
        [module, STATE] => Some(Named::ModuleState(module)),
        [module, ROUND_TRIP] => Some(Named::RoundTrip(module)),
        _ => None,
    }
}

/// The path of a point, which is the name of its node.
pub(crate) fn path(status: &PointStatus) -> String {
    format!("{}.{}", status.module, status.label)
}

impl KnownSite {
    /// Nothing is known yet. `chosen`: the modules that are shown; empty for all.
    pub(crate) fn new(chosen: Vec<String>) -> KnownSite {
        KnownSite {
            chosen,
            ..KnownSite::default()
        }
    }

    /// The configuration whose names it has.
    pub(crate) const fn config(&self) -> &Arc<Config> {
        &self.config
    }

    /// Its lines, by name.
    pub(crate) fn lines(&self) -> impl Iterator<Item = &LineStatus> {
        self.lines.values()
    }

    /// The modules of a line, by name.
    pub(crate) fn modules<'s>(&'s self, line: &'s str) -> impl Iterator<Item = &'s ModuleStatus> {
        self.modules
            .values()
            .filter(move |module| module.line == line)
    }

    /// The points of a module.
    pub(crate) fn points<'s>(&'s self, module: &'s str) -> impl Iterator<Item = &'s PointStatus> {
        self.points
            .values()
            .filter(move |point| point.module == module)
    }

    /// The point of this path.
    pub(crate) fn point(&self, path: &str) -> Option<&PointStatus> {
        self.points.get(path)
    }

    fn shows(&self, module: &str) -> bool {
        self.chosen.is_empty() || self.chosen.iter().any(|chosen| chosen == module)
    }

    /// Takes over what happened at the site.
    pub(crate) fn take(&mut self, news: &News) -> Told {
        match news {
            News::Picture(picture) => {
                let chosen = std::mem::take(&mut self.chosen);
                let new = KnownSite {
                    config: Arc::clone(&picture.config),
                    ..KnownSite::new(chosen)
                };
                let before = std::mem::replace(self, new);
                for module in &picture.modules {
                    if self.shows(&module.name) {
                        self.modules.insert(module.name.clone(), module.clone());
                    }
                }
                for line in &picture.lines {
                    self.lines.insert(line.name.clone(), line.clone());
                }
                for point in &picture.points {
                    if self.modules.contains_key(&point.module) {
                        self.points.insert(path(point), point.clone());
                    }
                }
                let names = |known: &KnownSite| -> BTreeSet<String> {
                    let lines = known
                        .lines
                        .keys()
                        .map(|line| format!("{LINE}/{line}/{STATE}"));
                    let modules = known.modules.keys();
                    let modules = modules
                        .flat_map(|name| [STATE, ROUND_TRIP].map(|part| format!("{name}/{part}")));
                    lines
                        .chain(modules)
                        .chain(known.points.keys().cloned())
                        .collect()
                };
                // Also those that are no more.
                let (old, new) = (names(&before), names(self));
                Told {
                    is_other: !Arc::ptr_eq(&before.config, &picture.config),
                    changed: old.union(&new).cloned().collect(),
                }
            }
            News::Batch(batch) => {
                let mut changed = Vec::new();
                for reading in &batch.points {
                    let path = path(&reading.status);
                    if let Some(known) = self.points.get_mut(&path) {
                        *known = reading.status.clone();
                        changed.push(path);
                    }
                }
                for module in batch.modules.iter().chain(&batch.figures) {
                    if let Some(known) = self.modules.get_mut(&module.name) {
                        *known = module.clone();
                        let parts = [STATE, ROUND_TRIP];
                        changed.extend(parts.map(|part| format!("{}/{part}", module.name)));
                    }
                }
                for line in &batch.lines {
                    if let Some(known) = self.lines.get_mut(&line.name) {
                        *known = line.clone();
                        changed.push(format!("{LINE}/{}/{STATE}", line.name));
                    }
                }
                Told {
                    is_other: false,
                    changed,
                }
            }
        }
    }

    /// The value of the node of this name, as it is now; none where it has none that changes. The
    /// time of a reading that says the same again may be a newer one (`fresh`).
    pub(crate) fn value(
        &self,
        name: &str,
        fresh: impl FnOnce(&PointStatus) -> Option<SystemTime>,
    ) -> Option<DataValue> {
        let now = DateTime::now();
        let plain = |value: Variant| DataValue {
            value: Some(value),
            status: Some(StatusCode::Good),
            server_timestamp: Some(now),
            ..DataValue::default()
        };
        match named(name)? {
            Named::Point(path) => {
                let point = self.points.get(path)?;
                let mut value = point_value(point, now);
                if value.source_timestamp.is_some()
                    && let Some(newer) = fresh(point)
                {
                    value.source_timestamp = Some(time(newer));
                }
                Some(value)
            }
            Named::ModuleState(module) => {
                let module = self.modules.get(module)?;
                Some(plain(presence(module.presence).into()))
            }
            Named::RoundTrip(module) => {
                let module = self.modules.get(module)?;
                // Of a module that does not answer there is none now.
                let is_online = module.presence == Presence::Online;
                Some(match module.rtt.filter(|_| is_online) {
                    #[expect(clippy::cast_precision_loss, reason = "a round trip is short")]
                    Some(rtt) => plain((rtt.0 as f64 / 1_000.0).into()),
                    None => DataValue {
                        value: None,
                        status: Some(match module.presence {
                            Presence::Silent => StatusCode::BadNoCommunication,
                            _ => StatusCode::BadWaitingForInitialData,
                        }),
                        server_timestamp: Some(now),
                        ..DataValue::default()
                    },
                })
            }
            Named::LineState(line) => {
                let line = self.lines.get(line)?;
                Some(plain(line_state(&line.state).into()))
            }
        }
    }
}

/// A point as a value with its status. The time is that of the reading, where there is one to go
/// by.
fn point_value(point: &PointStatus, now: DateTime) -> DataValue {
    let value = match point.quality {
        PointQuality::Good | PointQuality::Stale => point.value.map(|value| variant(value, point)),
        PointQuality::Bad(_) => None,
    };
    let source = point.time.filter(|_| value.is_some()).map(time);
    DataValue {
        value,
        status: Some(status::of_quality(point.quality)),
        source_timestamp: source,
        server_timestamp: Some(now),
        ..DataValue::default()
    }
}

fn variant(value: PointValue, point: &PointStatus) -> Variant {
    match value {
        PointValue::Bool(on) => Variant::Boolean(on),
        PointValue::Number(number) => Variant::UInt32(number),
        // No more digits than the module has.
        PointValue::Analog(value, _) => {
            let decimals = point
                .range
                .as_ref()
                .map(|range| usize::from(range.decimals));
            let rounded = decimals.map(|decimals| format!("{value:.decimals$}"));
            let rounded = rounded.and_then(|text| text.parse().ok());
            Variant::Double(rounded.unwrap_or(value))
        }
    }
}

/// A value that was kept, of a point of this kind.
pub(crate) fn kept_variant(kind: PointKind, value: f64) -> Variant {
    match kind {
        PointKind::Output | PointKind::Input => Variant::Boolean(value != 0.0),
        PointKind::Analog => Variant::Double(value),
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a variable has 24 bits"
        )]
        PointKind::Variable => Variant::UInt32(value as u32),
    }
}

/// A time by the clock on the wall, in whole milliseconds, as the API, the history and all other
/// outlets have it: the times of one reading can be compared.
pub(crate) fn time(at: SystemTime) -> DateTime {
    let since = at
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    // The ticks of OPC UA are of 100 ns, and begin in 1601.
    let ticks = i64::try_from(since.as_millis())
        .ok()
        .and_then(|ms| ms.checked_mul(TICKS_PER_MS)?.checked_add(TICKS_TO_1970));
    DateTime::from(ticks.unwrap_or(i64::MAX))
}

/// In a millisecond.
const TICKS_PER_MS: i64 = 10_000;

/// From 1601 to 1970.
const TICKS_TO_1970: i64 = 116_444_736_000_000_000;

/// The node of this name.
pub(crate) fn node_id(namespace: u16, name: &str) -> NodeId {
    NodeId::new(namespace, name)
}

/// The words of the HTTP API.
const fn presence(presence: Presence) -> &'static str {
    match presence {
        Presence::Unheard => "unheard",
        Presence::Online => "online",
        Presence::Silent => "offline",
        Presence::OtherModel => "other_model",
    }
}

const fn line_state(state: &LineState) -> &'static str {
    match state {
        LineState::Opening => "opening",
        LineState::Up => "up",
        LineState::Absent(_) => "absent",
        LineState::Closed => "closed",
    }
}

/// Whether a point can be switched at all.
pub(crate) fn is_output(point: Point) -> bool {
    point.kind == PointKind::Output
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_site::{BadReason, Service};
    use railbus_wire::Micros;

    const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.line]\nline = \"main\"\n\
        model = \"erc8\"\naddress = 3\n[module.tank]\nline = \"main\"\nmodel = \"emd2a2q\"\n\
        address = 5\n";

    fn told(chosen: &[&str]) -> (KnownSite, News) {
        let service = Service::start(Config::parse(SITE).unwrap()).unwrap();
        let news = service.follow().next_now().unwrap();
        let mut known = KnownSite::new(chosen.iter().map(|&name| name.to_owned()).collect());
        let first = known.take(&news);
        assert!(first.is_other);
        (known, news)
    }

    fn status(known: &KnownSite, name: &str) -> Option<StatusCode> {
        known.value(name, |_| None).and_then(|value| value.status)
    }

    #[tokio::test]
    async fn a_module_may_be_called_like_the_folder_of_lines() {
        let (known, _) = told(&[]);
        for name in ["line/State", "line/main/State", "line.k1", "tank.ai1"] {
            assert!(status(&known, name).is_some(), "{name}");
        }
        for name in [
            "line/other/State",
            "main/State",
            "line/Model",
            "line.k9",
            "railbus",
            "",
        ] {
            assert_eq!(status(&known, name), None, "{name}");
        }
    }

    #[tokio::test]
    async fn what_is_not_good_has_its_status_and_what_is_bad_no_value() {
        let (mut known, _) = told(&[]);
        let point = known.points.get_mut("line.k1").unwrap();
        let at = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1_700_000_000);
        point.value = Some(PointValue::Bool(true));
        point.time = Some(at);
        let mut said = |quality| {
            known.points.get_mut("line.k1").unwrap().quality = quality;
            let value = known.value("line.k1", |_| None).unwrap();
            (value.value, value.status.unwrap(), value.source_timestamp)
        };
        let (on, then) = (Some(Variant::Boolean(true)), Some(time(at)));
        assert_eq!(
            said(PointQuality::Good),
            (on.clone(), StatusCode::Good, then)
        );
        let stale = StatusCode::UncertainLastUsableValue;
        assert_eq!(said(PointQuality::Stale), (on, stale, then));
        let bad = said(PointQuality::Bad(BadReason::Offline));
        assert_eq!(bad, (None, StatusCode::BadNoCommunication, None));
    }

    #[tokio::test]
    async fn a_module_that_does_not_answer_has_no_round_trip() {
        let (mut known, _) = told(&[]);
        let module = known.modules.get_mut("tank").unwrap();
        (module.presence, module.rtt) = (Presence::Online, Some(Micros(42_500)));
        let trip = |known: &KnownSite| known.value("tank/RoundTrip", |_| None).unwrap();
        assert_eq!(trip(&known).value, Some(Variant::Double(42.5)));
        known.modules.get_mut("tank").unwrap().presence = Presence::Silent;
        let silent = trip(&known);
        let said = (silent.value, silent.status);
        assert_eq!(said, (None, Some(StatusCode::BadNoCommunication)));
    }

    #[tokio::test]
    async fn a_reading_that_says_the_same_gives_its_newer_time() {
        let (mut known, _) = told(&[]);
        let of = |seconds| SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(seconds);
        let point = known.points.get_mut("line.k1").unwrap();
        point.value = Some(PointValue::Bool(true));
        (point.time, point.quality) = (Some(of(10)), PointQuality::Good);
        let value = known.value("line.k1", |_| Some(of(20))).unwrap();
        assert_eq!(value.source_timestamp, Some(time(of(20))));
        let value = known.value("line.k1", |_| None).unwrap();
        assert_eq!(value.source_timestamp, Some(time(of(10))));
    }

    #[tokio::test]
    async fn only_chosen_modules_are_shown_and_what_is_gone_is_told() {
        let (mut known, news) = told(&["tank"]);
        assert_eq!(status(&known, "line.k1"), None);
        assert!(status(&known, "tank.ai1").is_some());
        // As if it had been another configuration before.
        let point = known.points.get("tank.ai1").unwrap().clone();
        known.points.insert("tank.ai9".to_owned(), point);
        known.config = Arc::default();
        let told = known.take(&news);
        assert!(told.is_other);
        assert!(told.changed.contains(&"tank.ai9".to_owned()), "{told:?}");
        assert_eq!(status(&known, "tank.ai9"), None);
        assert!(!known.take(&news).is_other, "the same configuration");
    }

    #[test]
    fn times_are_those_of_the_wall() {
        // [OPC UA part 6, 5.2.2.5]: in units of 100 ns since 1601.
        let at = SystemTime::UNIX_EPOCH + std::time::Duration::from_millis(1_700_000_000_123);
        let ticks = time(at).ticks();
        assert_eq!(ticks, 133_444_736_001_230_000);
        let later = at + std::time::Duration::from_micros(999);
        assert_eq!(time(later).ticks(), ticks, "no part of a millisecond");
        assert_eq!(time(SystemTime::UNIX_EPOCH).ticks(), TICKS_TO_1970);
    }
}
