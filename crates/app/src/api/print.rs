//! Points as JSON. They are asked for often and many at once, and what they would be converted to
//! first takes more time than printing it: so here they are printed as they lie.

use super::convert;
use railbus_api::types::SCHEMA;
use railbus_api::view::{NameView, PointView};
use railbus_site::config::{Confirm, ModuleConfig, PointConfig};
use railbus_site::{Config, PointNow, Service, paths};
use std::fmt::Write as _;
use std::time::SystemTime;

/// The selected points, as JSON: the text of a [`railbus_api::types::Points`].
pub fn points(service: &Service, selectors: &[String]) -> Vec<u8> {
    let mut text = format!(r#"{{"schema":{SCHEMA},"points":["#).into_bytes();
    let mut is_first = true;
    for module in service.config().modules.keys() {
        let (config, points) = service.points_now(module);
        let Some(described) = config.modules.get(module) else {
            continue;
        };
        let mut printer = Printer::new(&config, (module, described));
        for now in &points {
            if !printer.turn_to(now, selectors) {
                continue;
            }
            if !std::mem::take(&mut is_first) {
                text.push(b',');
            }
            // Only a writer can fail, and this one does not.
            let _ = serde_json::to_writer(&mut text, &printer.view(now));
        }
    }
    text.extend(b"]}");
    text
}

/// What is printed of the points of one module.
struct Printer<'a> {
    config: &'a Config,
    module: &'a str,
    described: &'a ModuleConfig,
    /// The path of the point whose turn it is.
    path: String,
    /// Its time in words. What one reply has brought has one time.
    time: (Option<SystemTime>, Option<String>),
    /// What a point has of which the configuration says nothing.
    plain: PointConfig,
}

impl<'a> Printer<'a> {
    fn new(config: &'a Config, (module, described): (&'a str, &'a ModuleConfig)) -> Printer<'a> {
        Printer {
            config,
            module,
            described,
            path: format!("{module}."),
            time: (None, None),
            plain: PointConfig::default(),
        }
    }

    fn label(&self) -> &str {
        self.path.get(self.module.len() + 1..).unwrap_or_default()
    }

    /// False if it is not selected.
    fn turn_to(&mut self, now: &PointNow, selectors: &[String]) -> bool {
        let (letters, number) = self.described.setup.label(now.point);
        self.path.truncate(self.module.len() + 1);
        // A string takes everything.
        let _ = write!(self.path, "{letters}{number}");
        if self.time.0 != now.time {
            self.time = (now.time, now.time.and_then(convert::wall));
        }
        paths::selects(selectors, self.module, self.label())
    }

    fn view(&self, now: &PointNow) -> PointView<'_> {
        let Printer { described, .. } = self;
        let config = described.points.get(&now.point).unwrap_or(&self.plain);
        let safety = &config.safety;
        let range = described.range_shown(now.point);
        let (quality, reason) = convert::quality(now.quality);
        let interlock = safety.interlock.iter();
        PointView {
            path: &self.path,
            module: self.module,
            label: self.label(),
            kind: convert::kind(now.point.kind),
            index: now.point.index,
            name: NameView {
                en: config.name_en.as_deref(),
                zh: config.name_zh.as_deref(),
            },
            value: now.value.map(convert::value),
            raw: convert::raw(now.value),
            unit: range.map(|range| range.unit.as_str()),
            decimals: range.map(|range| range.decimals),
            quality,
            reason,
            age_ms: now.age.map(convert::millis),
            max_age_ms: described.max_age().map(convert::millis),
            time: self.time.1.as_deref(),
            hidden: config.hidden,
            locked: config.locked,
            confirm: safety.confirm.is_some(),
            hold: safety.confirm == Some(Confirm::Hold),
            interlock: interlock.map(|other| self.config.path(other)).collect(),
            max_on_ms: safety.max_on.map(convert::millis),
            min_off_ms: safety.min_off.map(convert::millis),
            on_until: now.left.max_on.and_then(convert::from_now),
            pulse_until: now.left.pulse.and_then(convert::from_now),
            lease: convert::lease(now.left),
            pulse_ms: now.pulse.map(convert::millis),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::types::PointInfo;
    use railbus_site::{BadReason, Left, PointQuality, PointStatus, PointValue};
    use railbus_wire::Micros;
    use std::time::{Duration, UNIX_EPOCH};

    const TEXT: &str = r#"
[line.main]
port = "/dev/ttyS99"
[module.pump]
line = "main"
model = "eda9060a"
address = 1
[module.oven]
line = "main"
model = "erc8"
address = 3
[module.oven.point]
k1.name = { en = "Heat \"A\"", zh = "加热" }
k1.confirm = "hold"
k1.interlock = ["oven.k2", "pump.do0"]
k1.max_on = "10m"
k1.min_off = "30s"
k2.name = { zh = "风扇" }
k2.locked = true
k3.hidden = true
k3.confirm = true
"#;

    fn states() -> Vec<PointNow> {
        let reasons = [
            BadReason::NeverRead,
            BadReason::Offline,
            BadReason::OtherModel,
            BadReason::LineAbsent,
            BadReason::LineBusy,
            BadReason::Exclusive,
            BadReason::LineClosed,
        ];
        let qualities = [PointQuality::Good, PointQuality::Stale].into_iter();
        let qualities = qualities.chain(reasons.map(PointQuality::Bad));
        let values = [
            None,
            Some((PointValue::Bool(true), 1_499, 0)),
            Some((PointValue::Bool(false), 0, 1_700_000_000_999_999)),
            Some((PointValue::Analog(-12.5, 4_095), 86_400_000_000, 1_234)),
            Some((PointValue::Analog(f64::NAN, 0), 1, 1_235)),
            Some((PointValue::Number(16_777_215), 12, 2_000)),
        ];
        let left = |pulse, lease, max_on| {
            let left = [pulse, lease, max_on].map(|secs: u64| (secs > 0).then_some(secs));
            let [pulse, lease, max_on] = left.map(|secs| secs.map(Duration::from_secs));
            Left {
                pulse,
                lease,
                max_on,
            }
        };
        let lefts = [left(0, 0, 0), left(3, 0, 7_200), left(0, 60, 0)];
        let point = railbus_device::Point {
            kind: railbus_device::PointKind::Output,
            index: 0,
        };
        let mut states = Vec::new();
        for quality in qualities {
            for (value, left) in values
                .iter()
                .flat_map(|v| lefts.iter().map(move |l| (v, l)))
            {
                states.push(PointNow {
                    point,
                    value: value.map(|(value, ..)| value),
                    quality,
                    age: value.map(|(_, age, _)| Micros(age)),
                    time: value.map(|(.., at)| UNIX_EPOCH + Duration::from_micros(at)),
                    left: *left,
                    pulse: left.lease.map(|_| Micros::from_millis(500)),
                    is_pulse_known: true,
                });
            }
        }
        states
    }

    /// Takes the moments that are computed from the present one, which passes.
    fn take_moments(point: &mut PointInfo) -> Vec<Option<String>> {
        let lease = point.lease.as_mut().map(|lease| &mut lease.until);
        let until = lease.map(std::mem::take);
        vec![until, point.on_until.take(), point.pulse_until.take()]
    }

    #[test]
    fn a_point_is_printed_as_the_type_says() {
        let config = Config::parse(TEXT).unwrap();
        let mut printed = 0;
        for (module, described) in &config.modules {
            let mut printer = Printer::new(&config, (module, described));
            for point in described.setup.points() {
                for state in states() {
                    let now = PointNow { point, ..state };
                    assert!(printer.turn_to(&now, &[]));
                    let text = serde_json::to_string(&printer.view(&now)).unwrap();
                    let status = PointStatus::of(&config, (module, described), now);
                    let mut wanted = convert::point(status);
                    let mut read: PointInfo = serde_json::from_str(&text).unwrap();
                    let told = (read.lease.clone(), read.on_until.clone());
                    let pulse = read.pulse_until.clone();
                    for (a, b) in take_moments(&mut read)
                        .iter()
                        .zip(take_moments(&mut wanted))
                    {
                        let [a, b] = [a.clone(), b].map(|at| at.map(moment));
                        assert_eq!(a.is_some(), b.is_some(), "{text}");
                        let apart = a.zip(b).map_or(0, |(a, b)| (b - a).abs());
                        assert!(apart < 60_000, "{text}");
                    }
                    (wanted.lease, wanted.on_until) = told;
                    wanted.pulse_until = pulse;
                    assert_eq!(text, serde_json::to_string(&wanted).unwrap());
                    printed += 1;
                }
            }
        }
        assert!(printed > 1_000, "{printed}");
    }

    fn moment(text: String) -> i64 {
        text.parse::<jiff::Timestamp>().unwrap().as_millisecond()
    }

    #[tokio::test]
    async fn all_that_are_selected_are_printed() {
        let config = Config::parse(TEXT).unwrap();
        let service = Service::start(config).unwrap();
        for selectors in [&[][..], &["oven"], &["*.k1", "pump.di?"], &["nothing*"]] {
            let selectors: Vec<String> = selectors.iter().map(|&one| one.to_owned()).collect();
            let points = crate::api::ask::points(&service, &selectors);
            let wanted = railbus_api::types::Points {
                schema: SCHEMA,
                points,
            };
            let text = String::from_utf8(super::points(&service, &selectors)).unwrap();
            assert_eq!(text, serde_json::to_string(&wanted).unwrap());
        }
    }
}
