//! What is known of a point, and how good that is.

use railbus_device::{Bank, Observation, Point, PointKind};
use railbus_host::Presence;
use railbus_site::{BadReason, Config, PointQuality, PointValue, Site};
use railbus_wire::{Instant, Micros};
use std::time::SystemTime;

const CONFIG: &str = r#"
[line.main]
port = "/dev/ttyUSB0"
[module.oven]
line = "main"
model = "erc8"
address = 3
max_age = "2s"
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
"#;

const WALL: SystemTime = SystemTime::UNIX_EPOCH;

const K1: Point = Point {
    kind: PointKind::Output,
    index: 0,
};

fn site() -> Site {
    Site::new(Config::parse(CONFIG).expect("it is good"))
}

fn outputs(on: u32) -> Observation {
    Observation::Channels {
        outputs: Bank::new(0xFF, on),
        inputs: Bank::default(),
    }
}

#[test]
fn a_value_is_good_then_stale_then_bad() {
    let at = |millis| Instant(0) + Micros::from_millis(millis);
    let mut site = site();
    let quality = |site: &Site, millis| site.point("oven", K1, at(millis)).1;
    assert_eq!(quality(&site, 0), PointQuality::Bad(BadReason::NeverRead));
    site.heard("oven", Presence::Online);
    assert_eq!(
        quality(&site, 0),
        PointQuality::Bad(BadReason::NeverRead),
        "heard, but never read"
    );
    site.saw("oven", &outputs(1), at(100), WALL);
    assert_eq!(quality(&site, 2_100), PointQuality::Good);
    assert_eq!(quality(&site, 2_101), PointQuality::Stale);
    site.heard("oven", Presence::Silent);
    assert_eq!(quality(&site, 200), PointQuality::Bad(BadReason::Offline));
    let (known, _) = site.point("oven", K1, at(200));
    assert_eq!(known.map(|known| known.value), Some(PointValue::Bool(true)));
    site.heard("oven", Presence::Online);
    // It may have been without power.
    assert_eq!(quality(&site, 200), PointQuality::Stale);
    site.saw("oven", &outputs(1), at(150), WALL);
    assert_eq!(quality(&site, 200), PointQuality::Good);
    assert_eq!(
        site.point("nobody", K1, at(0)).1,
        PointQuality::Bad(BadReason::NeverRead)
    );
}

#[test]
fn only_what_is_new_is_told() {
    let mut site = site();
    let told = site.saw("oven", &outputs(0), Instant(0), WALL);
    assert_eq!(told.len(), 8, "all of them for the first time");
    assert!(told.iter().all(|change| change.before.is_none()));
    assert!(site.saw("oven", &outputs(0), Instant(1), WALL).is_empty());
    let told = site.saw("oven", &outputs(1), Instant(2), WALL);
    assert_eq!(told.len(), 1);
    assert_eq!(told[0].point, K1);
    assert_eq!(told[0].before, Some(PointValue::Bool(false)));
    assert_eq!(told[0].value, PointValue::Bool(true));
    assert!(site.saw("nobody", &outputs(1), Instant(3), WALL).is_empty());
}

#[test]
fn analog_registers_are_hundredths() {
    let mut site = site();
    site.saw("tank", &Observation::Analogs([871, 0]), Instant(0), WALL);
    let point = Point {
        kind: PointKind::Analog,
        index: 0,
    };
    let (known, _) = site.point("tank", point, Instant(0));
    assert_eq!(
        known.map(|known| known.value),
        Some(PointValue::Analog(8.71, 871))
    );
}

#[test]
fn each_analog_input_can_measure_something_of_its_own() {
    let text = r#"
[line.main]
port = "/dev/ttyUSB0"
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
range = "0-20mA"
point.ai2 = { range = { signal = "4-20mA", low = 0, high = 16, unit = "bar" } }
"#;
    let mut site = Site::new(Config::parse(text).unwrap());
    site.saw(
        "tank",
        &Observation::Analogs([1_200, 1_200]),
        Instant(0),
        WALL,
    );
    let value = |index| {
        let kind = PointKind::Analog;
        let (known, _) = site.point("tank", Point { kind, index }, Instant(0));
        known.map(|known| known.value)
    };
    assert_eq!(value(0), Some(PointValue::Analog(12.0, 1_200)));
    assert_eq!(value(1), Some(PointValue::Analog(8.0, 1_200)));
}

#[test]
fn another_configuration_keeps_what_is_known_of_kept_modules() {
    let mut site = site();
    site.saw("oven", &outputs(1), Instant(0), WALL);
    site.saw("tank", &Observation::Analogs([871, 0]), Instant(0), WALL);
    let config = site.config().clone();
    site.reconfigure(config, |module| module == "oven");
    assert!(site.point("oven", K1, Instant(0)).0.is_some());
    let analog = Point {
        kind: PointKind::Analog,
        index: 0,
    };
    assert!(site.point("tank", analog, Instant(0)).0.is_none());
}
