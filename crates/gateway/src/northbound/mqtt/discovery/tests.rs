//! The messages that Home Assistant gets.

use super::super::settings;
use super::super::told::Told;
use super::*;
use railbus_site::{Batch, Config, News, PointReading, Service};
use railbus_wire::Micros;
use std::sync::Arc;
use std::time::SystemTime;

const SITE: &str = r#"
[line.main]
port = "/dev/ttyS99"
[module.oven]
line = "main"
model = "erc8"
address = 3
area = "Kitchen"
name = { en = "Oven", zh = "烤箱" }
[module.oven.point]
k2 = { name = { en = "Fan", zh = "风扇" }, confirm = true }
k3 = { locked = true }
k4 = { hidden = true }
k5 = { name = "灯" }
[module.pump]
line = "main"
model = "eda9060a"
address = 4
[module.pump.point]
do1 = { confirm = "hold" }
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
[module.tank.point]
ai1 = { range = { signal = "4-20mA", low = -20, high = 80, unit = "℃", decimals = 1 } }
"#;

/// How a site with this configuration is at its beginning.
async fn picture(text: &str) -> Picture {
    let service = Service::start(Config::parse(text).unwrap()).unwrap();
    let picture = match service.follow().next().await.unwrap() {
        News::Picture(picture) => picture,
        News::Batch(_) => panic!("a picture comes first"),
    };
    Picture {
        seq: picture.seq,
        changes: picture.changes,
        at: picture.at,
        config: Arc::clone(&picture.config),
        points: picture.points.clone(),
        modules: picture.modules.clone(),
        lines: picture.lines.clone(),
    }
}

/// The same, and these outputs of the pump give pulses, as it said.
fn known(mut picture: Picture, pulses: &[&str]) -> Picture {
    for point in picture.points.iter_mut().filter(|p| p.module == "pump") {
        point.is_pulse_known = true;
        let gives = pulses.contains(&&*point.label);
        point.pulse = gives.then_some(Micros(500_000));
    }
    picture
}

fn told(site: &str, settings: Value, old: &[String]) -> Told {
    let keys = settings.as_object().cloned().unwrap();
    let topics = settings::topics(&keys, site);
    Told::new(site, topics, old.iter().cloned().collect())
}

fn device() -> Value {
    json!({ "discovery": "device", "write": ["oven", "pump"] })
}

fn component() -> Value {
    json!({ "discovery": "component", "write": ["oven", "pump"] })
}

/// What is at a topic.
fn at(told: &Told, topic: &str) -> Value {
    let newest = told
        .newest(topic)
        .unwrap_or_else(|| panic!("nothing at {topic}"));
    assert!(newest.is_sure);
    serde_json::from_slice(&newest.payload).unwrap()
}

/// The entities of a module in the form `device`, as `switch/k1`, with those to be removed.
fn entities(told: &Told, module: &str) -> (Vec<String>, Vec<String>) {
    let topic = format!("homeassistant/device/railbus_plant_{module}/config");
    let payload = at(told, &topic);
    let all = payload["cmps"].as_object().unwrap();
    let named = all.iter().map(|(key, config)| {
        let kind = config["p"].as_str().unwrap();
        (format!("{kind}/{key}"), config["unique_id"].is_string())
    });
    let (are, gone): (Vec<_>, Vec<_>) = named.partition(|(_, is_one)| *is_one);
    let names = |all: Vec<(String, bool)>| all.into_iter().map(|(name, _)| name).collect();
    (names(are), names(gone))
}

fn entity(told: &Told, module: &str, key: &str) -> Value {
    let topic = format!("homeassistant/device/railbus_plant_{module}/config");
    at(told, &topic)["cmps"][key].clone()
}

#[tokio::test]
async fn a_module_is_a_device() {
    let mut told = told("plant", device(), &[]);
    told.picture(&picture(SITE).await);
    let mut oven = at(&told, "homeassistant/device/railbus_plant_oven/config");
    oven["cmps"].take();
    assert_eq!(
        oven,
        json!({
            "dev": {
                "ids": ["railbus_plant_oven"], "name": "Oven", "mdl": "ERC-8", "sa": "Kitchen",
            },
            "o": {
                "name": "railbus",
                "sw": env!("CARGO_PKG_VERSION"),
                "url": env!("CARGO_PKG_REPOSITORY"),
            },
            "avty": [
                { "t": "railbus/plant/bridge/state" },
                { "t": "railbus/plant/oven/availability" },
            ],
            "avty_mode": "all",
            "cmps": null,
        })
    );
    let pump = at(&told, "homeassistant/device/railbus_plant_pump/config");
    assert_eq!(pump["dev"]["name"], "pump");
    assert_eq!(pump["dev"]["sa"], Value::Null);
}

/// An output that must be confirmed is no switch: whoever turns off everything in a room would
/// switch it.
#[tokio::test]
async fn every_point_is_what_may_be_done_with_it() {
    let mut told = told("plant", device(), &[]);
    told.picture(&known(picture(SITE).await, &["do0", "do1"]));
    let oven = [
        "binary_sensor/connection",
        "switch/k1",
        "button/k2_off",
        "button/k2_on",
        "binary_sensor/k2_state",
        "binary_sensor/k3_state",
        "switch/k5",
        "switch/k6",
        "switch/k7",
        "switch/k8",
    ];
    let (are, gone) = entities(&told, "oven");
    assert_eq!((are, gone.len()), (oven.map(str::to_owned).to_vec(), 0));
    let (are, _) = entities(&told, "pump");
    for pulsed in ["do0", "do1"] {
        assert!(are.contains(&format!("button/{pulsed}_pulse")), "{are:?}");
        assert!(are.contains(&format!("binary_sensor/{pulsed}_state")));
        assert!(!are.iter().any(|name| name.ends_with(&format!("/{pulsed}"))));
    }
    assert!(are.contains(&"switch/do2".to_owned()), "{are:?}");
    assert!(are.contains(&"binary_sensor/di0".to_owned()), "{are:?}");
    assert_eq!(
        entity(&told, "oven", "k1"),
        json!({
            "p": "switch",
            "name": "k1",
            "unique_id": "railbus_plant_oven_k1",
            "default_entity_id": "switch.railbus_plant_oven_k1",
            "state_topic": "railbus/plant/oven/k1/state",
            "json_attributes_topic": "railbus/plant/oven/k1/attr",
            "command_topic": "railbus/plant/oven/k1/set",
            "payload_on": "ON",
            "payload_off": "OFF",
            "optimistic": false,
            "retain": false,
            "qos": 1,
        })
    );
    assert_eq!(
        entity(&told, "oven", "k2_on"),
        json!({
            "p": "button",
            "name": "Fan ON",
            "unique_id": "railbus_plant_oven_k2_on",
            "default_entity_id": "button.railbus_plant_oven_k2_on",
            "command_topic": "railbus/plant/oven/k2/set",
            "payload_press": "{\"confirm\":true,\"value\":\"ON\"}",
            "retain": false,
            "qos": 1,
        })
    );
    let pressed = |key: &str| {
        let config = entity(&told, "pump", key);
        config["payload_press"].as_str().unwrap().to_owned()
    };
    assert_eq!(pressed("do0_pulse"), "PULSE");
    assert_eq!(
        pressed("do1_pulse"),
        "{\"confirm\":true,\"value\":\"PULSE\"}"
    );
    let off = entity(&told, "oven", "k2_off");
    assert_eq!(off["payload_press"], "{\"confirm\":true,\"value\":\"OFF\"}");
    assert_eq!(
        entity(&told, "pump", "di0"),
        json!({
            "p": "binary_sensor",
            "name": "di0",
            "unique_id": "railbus_plant_pump_di0",
            "default_entity_id": "binary_sensor.railbus_plant_pump_di0",
            "state_topic": "railbus/plant/pump/di0/state",
            "json_attributes_topic": "railbus/plant/pump/di0/attr",
            "payload_on": "ON",
            "payload_off": "OFF",
            "qos": 1,
        })
    );
    // Known as long as the gateway is there: that it does not answer is what it says.
    assert_eq!(
        entity(&told, "oven", "connection"),
        json!({
            "p": "binary_sensor",
            "unique_id": "railbus_plant_oven_connection",
            "default_entity_id": "binary_sensor.railbus_plant_oven_connection",
            "state_topic": "railbus/plant/oven/availability",
            "payload_on": "online",
            "payload_off": "offline",
            "device_class": "connectivity",
            "entity_category": "diagnostic",
            "avty": [{ "t": "railbus/plant/bridge/state" }],
            "qos": 1,
        })
    );
}

/// Every payload of a button or switch is one that this outlet carries out.
#[tokio::test]
async fn every_payload_is_a_command() {
    use super::super::orders::{self, Target};
    let mut told = told("plant", component(), &[]);
    told.picture(&known(picture(SITE).await, &["do0", "do1"]));
    let mut commands = 0;
    for topic in told.described() {
        let config = at(&told, &topic);
        for key in ["payload_on", "payload_off", "payload_press"] {
            let payload = config[key].as_str();
            let Some(payload) = payload.filter(|_| config["command_topic"].is_string()) else {
                continue;
            };
            let target = Target::Output("oven".to_owned(), "k1".to_owned());
            let order = orders::parse(target, payload.as_bytes()).unwrap();
            let confirms = config["name"].as_str().unwrap().starts_with("Fan");
            let confirms = confirms || topic.ends_with("/do1_pulse/config");
            assert_eq!(order.confirm, confirms, "{topic}");
            commands += 1;
        }
    }
    assert_eq!(
        commands,
        5 * 2 + 2 + 2 * 2 + 2,
        "oven, its fan, pump, its pulses"
    );
}

#[tokio::test]
async fn numbers_have_units_and_decimals() {
    let mut told = told("plant", device(), &[]);
    told.picture(&picture(SITE).await);
    let tank = entity(&told, "tank", "ai1");
    for (key, value) in [
        ("p", json!("sensor")),
        ("device_class", json!("temperature")),
        ("unit_of_measurement", json!("°C")),
        ("state_class", json!("measurement")),
        ("suggested_display_precision", json!(1)),
    ] {
        assert_eq!(tank[key], value, "{key}");
    }
    let plain = entity(&told, "tank", "ai2");
    let of = |key: &str| plain[key].as_str().unwrap();
    assert_eq!(
        (of("device_class"), of("unit_of_measurement")),
        ("voltage", "V")
    );
    for (unit, told) in [
        ("mA", (Some("current"), "mA")),
        ("kPa", (Some("pressure"), "kPa")),
        ("MPa", (None, "MPa")),
        ("%", (None, "%")),
        ("", (None, "")),
    ] {
        assert_eq!(home_class(unit), told, "{unit}");
    }
    // Without any of the others, this tells Home Assistant that it is a number.
    let text = "[line.main]\nport = \"/dev/ttyS99\"\n[module.gate]\nline = \"main\"\n\
        model = \"r55\"\naddress = 1\nvariables = 1\n";
    told.picture(&picture(text).await);
    let (are, _) = entities(&told, "gate");
    let variable = are.iter().find(|name| name.starts_with("sensor/")).unwrap();
    let variable = entity(&told, "gate", variable.trim_start_matches("sensor/"));
    assert_eq!(variable["suggested_display_precision"], 0);
    assert_eq!(variable["state_class"], Value::Null, "it may go down");
}

#[tokio::test]
async fn who_may_not_switch_is_offered_nothing() {
    let picture = known(picture(SITE).await, &["do0"]);
    let commanded = |write: Value| {
        let settings = json!({ "discovery": "component", "write": write });
        let mut told = told("plant", settings, &[]);
        told.picture(&picture);
        let all = told.described();
        assert!(all.len() > 20);
        let with = all.iter().map(|topic| at(&told, topic));
        let with = with.filter_map(|config| config["command_topic"].as_str().map(str::to_owned));
        with.collect::<BTreeSet<String>>()
    };
    assert_eq!(commanded(json!([])).len(), 0);
    let one = BTreeSet::from(["railbus/plant/oven/k1/set".to_owned()]);
    assert_eq!(commanded(json!(["oven.k1", "oven.k3"])), one);
    let (oven, pump) = (6, 4);
    assert_eq!(
        commanded(json!(["*"])).len(),
        oven + pump + 2,
        "and of the tank"
    );
}

#[tokio::test]
async fn both_forms_have_the_same_entities() {
    let picture = known(picture(SITE).await, &["do0"]);
    let (mut one, mut other) = (
        told("plant", device(), &[]),
        told("plant", component(), &[]),
    );
    one.picture(&picture);
    other.picture(&picture);
    let mut all = BTreeSet::new();
    for module in ["oven", "pump", "tank"] {
        let whole = at(
            &one,
            &format!("homeassistant/device/railbus_plant_{module}/config"),
        );
        for (key, config) in whole["cmps"].as_object().unwrap() {
            let mut config = config.as_object().cloned().unwrap();
            let kind = config.remove("p").unwrap();
            let kind = kind.as_str().unwrap();
            let topic = format!("homeassistant/{kind}/railbus_plant_{module}/{key}/config");
            for shared in ["dev", "o", "avty", "avty_mode"] {
                config
                    .entry(shared)
                    .or_insert_with(|| whole[shared].clone());
            }
            assert_eq!(at(&other, &topic), Value::Object(config), "{topic}");
            all.insert(topic);
        }
    }
    assert_eq!(other.described(), all.into_iter().collect::<Vec<_>>());
}

/// Home Assistant takes letters, digits, `_` and `-` only, and one id for one thing.
#[test]
fn no_two_modules_have_the_same_id() {
    let sites = [
        (None, "plant"),
        (None, "Plant"),
        (None, "plant_2"),
        (None, "plant-2"),
        (None, "plant_oven"),
        (None, "1号车间"),
        (None, "2号车间"),
        (None, "一号"),
        (None, "二号"),
        (Some("north"), "plant"),
        (Some("north/plant"), "plant"),
        (Some("north"), "plant/plant"),
        (None, "----deadbeef"),
        (None, "plant-deadbeef"),
    ];
    let mut seen = BTreeSet::new();
    let of = |site| Discovery::new(Form::Device, "ha", site, false, Rights::all());
    for site in sites {
        for module in ["oven", "plant_oven", "2_oven", "oven_k1"] {
            let id = of(site).module(module);
            let fits = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
            assert!(id.chars().all(fits), "{id}");
            assert!(seen.insert(id), "{site:?} {module}");
        }
    }
    assert_eq!(of((None, "plant")).module("oven"), "railbus_plant_oven");
    // It stays what it is: people's names and areas hang on it.
    assert_eq!(
        of((None, "1号车间")).module("oven"),
        "railbus_1----b061743c_oven"
    );
    // What looks like one with a hash gets one of its own.
    let hashed = of((None, "1号车间")).site;
    assert_ne!(of((None, &*hashed)).site, hashed);
}

#[tokio::test]
async fn names_are_told_in_the_language_that_was_chosen() {
    let picture = picture(SITE).await;
    let name = |settings: Value, key: &str| {
        let mut told = told("plant", settings, &[]);
        told.picture(&picture);
        let oven = at(&told, "homeassistant/device/railbus_plant_oven/config");
        let name = |value: &Value| value["name"].as_str().map(str::to_owned);
        (
            name(&oven["dev"]).unwrap(),
            name(&oven["cmps"][key]).unwrap(),
        )
    };
    let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
    let zh = json!({ "discovery": "device", "discovery_names": "zh", "write": ["oven"] });
    assert_eq!(name(device(), "k2_on"), pair("Oven", "Fan ON"));
    assert_eq!(name(zh, "k2_on"), pair("烤箱", "风扇 ON"));
    assert_eq!(name(device(), "k5"), pair("Oven", "灯"));
}

#[tokio::test]
async fn its_topics_begin_as_they_are_set() {
    let settings = json!({ "discovery": "device", "discovery_prefix": "ha/test" });
    let mut told = told("1号车间", settings, &[]);
    told.picture(&picture(SITE).await);
    let all = told.described();
    assert_eq!(all.len(), 3);
    assert!(
        all.iter()
            .all(|topic| topic.starts_with("ha/test/device/railbus_1----"))
    );
    for (base, is_other) in [("railbus", false), ("north", true)] {
        let settings = json!({ "discovery": "device", "base": base });
        let mut told = self::told("plant", settings, &[]);
        told.picture(&picture(SITE).await);
        let plain = "homeassistant/device/railbus_plant_oven/config".to_owned();
        assert_eq!(!told.described().contains(&plain), is_other, "{base}");
    }
    let keys = json!({ "write": ["oven"] }).as_object().cloned().unwrap();
    let mut none = Told::new("plant", settings::topics(&keys, "plant"), BTreeSet::new());
    none.picture(&picture(SITE).await);
    assert!(
        none.described().is_empty(),
        "it is off unless it is switched on"
    );
    assert!(
        none.kept()
            .iter()
            .all(|topic| topic.starts_with("railbus/plant/"))
    );
}

/// Home Assistant keeps an entity that is only left out.
#[tokio::test]
async fn an_entity_that_is_no_more_is_removed_by_name() {
    let mut before = told("plant", device(), &[]);
    before.picture(&picture(SITE).await);
    let kept = before.kept();
    let locked = SITE.replace("k5 = {", "k1 = { locked = true }\nk5 = { hidden = true,");
    for is_new_run in [false, true] {
        let old: &[String] = if is_new_run { &kept } else { &[] };
        let mut now = told("plant", device(), old);
        if !is_new_run {
            now.picture(&picture(SITE).await);
        }
        let changed = now.picture(&picture(&locked).await);
        assert!(changed.contains(&"homeassistant/device/railbus_plant_oven/config".to_owned()));
        let (are, gone) = entities(&now, "oven");
        assert_eq!(gone, ["switch/k1", "switch/k5"]);
        assert!(are.contains(&"binary_sensor/k1_state".to_owned()));
        assert!(now.left().is_empty(), "{:?}", now.left());
        // It stays so: who was away then is told later.
        let mut later = told("plant", device(), &now.kept());
        later.picture(&picture(&locked).await);
        assert_eq!(entities(&later, "oven").1, gone);
        // And back again.
        later.picture(&picture(SITE).await);
        assert_eq!(entities(&later, "oven").1, ["binary_sensor/k1_state"]);
    }
}

#[tokio::test]
async fn what_is_told_no_more_is_cleared() {
    let text = SITE.replace("[module.pump", "[module.well");
    let (first, second) = (picture(SITE).await, picture(&text).await);
    for settings in [device(), component()] {
        let mut told = told("plant", settings.clone(), &[]);
        told.picture(&first);
        let of = |module: &str, all: Vec<String>| {
            let id = format!("/railbus_plant_{module}/");
            let its = all.into_iter().filter(|topic| topic.contains(&id));
            its.collect::<BTreeSet<String>>()
        };
        let pump = of("pump", told.described());
        assert!(!pump.is_empty());
        let kept = told.kept();
        assert!(
            pump.iter().all(|topic| kept.contains(topic)),
            "before it is published"
        );
        let changed = told.picture(&second);
        assert!(
            pump.iter()
                .all(|topic| changed.contains(topic) && told.is_old(topic))
        );
        assert!(!of("well", told.described()).is_empty());
        for topic in pump {
            told.cleared(&topic);
        }
        let kept = told.kept();
        assert!(
            !kept.iter().any(|line| line.contains("railbus_plant_pump")),
            "{kept:?}"
        );
        // Switched off, all of them go.
        let mut off = self::told("plant", json!({}), &kept);
        off.picture(&second);
        let left = off.left().into_iter();
        let left: BTreeSet<String> = left.filter(|topic| topic.ends_with("/config")).collect();
        assert_eq!(left, told.described().into_iter().collect());
        assert!(!off.kept().iter().any(|line| line.contains(MARK)));
    }
}

/// A change of what the pump says of its outputs.
fn change(of: &Picture, label: &str, pulse: Option<Micros>) -> Batch {
    let mut status = of.points.iter().find(|p| p.label == label).unwrap().clone();
    (status.is_pulse_known, status.pulse) = (true, pulse);
    let at = SystemTime::UNIX_EPOCH;
    Batch {
        seq: of.seq + 1,
        changes: of.changes + 1,
        at,
        config: Arc::clone(&of.config),
        points: [PointReading { at, status }].into(),
        modules: Box::default(),
        figures: Box::default(),
        lines: Box::default(),
    }
}

#[tokio::test]
async fn while_it_is_not_known_what_an_output_does_it_stays_what_it_was() {
    let unknown = picture(SITE).await;
    let is = |told: &Told, form: &Value| -> Vec<String> {
        let all: Vec<String> = match form["discovery"] == "device" {
            true => entities(told, "pump").0,
            false => told
                .described()
                .iter()
                .filter_map(|topic| {
                    let rest = topic
                        .strip_prefix("homeassistant/")?
                        .strip_suffix("/config")?;
                    let (kind, key) = rest.split_once("/railbus_plant_pump/")?;
                    Some(format!("{kind}/{key}"))
                })
                .collect(),
        };
        all.into_iter()
            .filter(|name| name.contains("/do0"))
            .collect()
    };
    let pulsed = ["button/do0_pulse", "binary_sensor/do0_state"];
    for form in [device(), component()] {
        let mut told = told("plant", form.clone(), &[]);
        told.picture(&unknown);
        assert_eq!(is(&told, &form), ["binary_sensor/do0_state"], "at first");
        told.is_to_be_kept();
        let changed = told.batch(&change(&unknown, "do0", None));
        assert_eq!(is(&told, &form), ["switch/do0"]);
        assert!(changed.iter().any(|topic| topic.ends_with("/config")));
        assert!(told.is_to_be_kept(), "before it is published");
        let changed = told.batch(&change(&unknown, "do0", None));
        assert_eq!((changed.len(), told.is_to_be_kept()), (0, false));
        // Another reload or run, before the module was asked again.
        let mut later = self::told("plant", form.clone(), &told.kept());
        later.picture(&unknown);
        assert_eq!(is(&later, &form), ["switch/do0"]);
        told.picture(&unknown);
        assert_eq!(is(&told, &form), ["switch/do0"]);
        let changed = told.batch(&change(&unknown, "do0", Some(Micros(500_000))));
        let mut now = is(&told, &form);
        now.sort();
        assert_eq!(now, ["binary_sensor/do0_state", "button/do0_pulse"]);
        let switch = "homeassistant/switch/railbus_plant_pump/do0/config".to_owned();
        match form["discovery"] == "device" {
            true => assert_eq!(entities(&told, "pump").1, ["switch/do0"]),
            false => assert!(changed.contains(&switch) && told.is_old(&switch)),
        }
        told.picture(&unknown);
        assert!(
            is(&told, &form)
                .iter()
                .all(|name| pulsed.contains(&&**name))
        );
        // And back: the button was one once, and the switch is one now.
        told.batch(&change(&unknown, "do0", None));
        // The other one is to be confirmed.
        told.batch(&change(&unknown, "do1", None));
        let kept: Vec<String> = told
            .kept()
            .into_iter()
            .filter(|topic| !told.is_old(topic))
            .collect();
        let mut later = self::told("plant", form.clone(), &kept);
        later.picture(&unknown);
        assert_eq!(is(&later, &form), ["switch/do0"]);
        let of_form = |told: &Told| match form["discovery"] == "device" {
            true => entities(told, "pump").0.join(" "),
            false => told.described().join(" "),
        };
        let buttons = of_form(&later);
        assert!(
            buttons.contains("do1_on") && buttons.contains("do1_off"),
            "{buttons}"
        );
    }
}
