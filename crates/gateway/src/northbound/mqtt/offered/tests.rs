//! What is offered, and where.

use crate::northbound::offered::{MqttOffer, OfferWay, offers};
use railbus_site::Config;
use serde_json::{Map, Value, json};
use std::path::Path;

const SITE: &str = r#"
[line.main]
port = "/dev/ttyS99"
[module.oven]
line = "main"
model = "erc8"
address = 3
area = "厨房: \"1\""
name = { en = "Oven", zh = "烤箱" }
[module.oven.point]
k2 = { name = { en = "Fan: left", zh = "风扇" }, confirm = true }
k3 = { locked = true }
k4 = { hidden = true }
[module.pump]
line = "main"
model = "eda9060a"
address = 4
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
[module.tank.point]
ai1 = { range = { signal = "4-20mA", low = -20, high = 80, unit = "℃", decimals = 1 } }
"#;

fn mqtt(settings: &str) -> MqttOffer {
    let text = format!(
        "{SITE}[outlet.home]
type = \"mqtt\"
{settings}"
    );
    let config = Config::parse(&text).unwrap();
    let [offer] = &offers(Path::new("/etc/plant/railbus.toml"), &config)[..] else {
        panic!("one");
    };
    match &offer.way {
        OfferWay::Mqtt(offer) => offer.clone(),
        OfferWay::ModbusTcp(_) => panic!("MQTT"),
    }
}

fn entity<'o>(offer: &'o MqttOffer, unique: &str) -> (&'static str, &'o Map<String, Value>) {
    let all = offer.entities.iter();
    let mut found = all.filter(|entity| entity.config["unique_id"] == unique);
    let entity = found.next().unwrap_or_else(|| panic!("no {unique}"));
    assert_eq!(found.next(), None, "{unique} is there once");
    (entity.kind, &entity.config)
}

#[test]
fn an_entity_has_what_a_configuration_of_home_assistant_takes() {
    let offer = mqtt("write = [\"oven\", \"pump.do0\"]");
    let (kind, k1) = entity(&offer, "railbus_plant_oven_k1");
    assert_eq!(
        (kind, json!(k1)),
        (
            "switch",
            json!({
                "unique_id": "railbus_plant_oven_k1",
                "name": "k1",
                "state_topic": "railbus/plant/oven/k1/state",
                "json_attributes_topic": "railbus/plant/oven/k1/attr",
                "command_topic": "railbus/plant/oven/k1/set",
                "payload_on": "ON",
                "payload_off": "OFF",
                "optimistic": false,
                "retain": false,
                "qos": 1,
                "availability_mode": "all",
                "availability": [
                    { "topic": "railbus/plant/bridge/state" },
                    { "topic": "railbus/plant/oven/availability" },
                ],
                "device": {
                    "identifiers": ["railbus_plant_oven"],
                    "name": "Oven",
                    "model": "ERC-8",
                    "suggested_area": "厨房: \"1\"",
                },
            })
        )
    );
    let kinds = |unique: &str| entity(&offer, unique).0;
    assert_eq!(kinds("railbus_plant_oven_k2_on"), "button");
    assert_eq!(kinds("railbus_plant_oven_k3_state"), "binary_sensor");
    assert_eq!(kinds("railbus_plant_pump_do0"), "switch");
    assert_eq!(kinds("railbus_plant_pump_do1_state"), "binary_sensor");
    let (kind, ai1) = entity(&offer, "railbus_plant_tank_ai1");
    assert_eq!(
        (kind, &ai1["unit_of_measurement"]),
        ("sensor", &json!("°C"))
    );
    let (_, connection) = entity(&offer, "railbus_plant_oven_connection");
    let bridge = json!([{ "topic": "railbus/plant/bridge/state" }]);
    assert_eq!(connection["availability"], bridge, "its own goes before");
    let mut uniques = offer
        .entities
        .iter()
        .map(|one| one.config["unique_id"].to_string());
    assert!(uniques.all(|unique| !unique.contains("oven_k4")), "hidden");
}

#[test]
fn topics_are_those_of_the_outlet() {
    let offer = mqtt("write = [\"*\"]\nbase = \"north\"\nsite = \"west\"\nmodules = [\"oven\"]");
    assert_eq!(offer.bridge, "north/west/bridge/state");
    let [oven] = &offer.modules[..] else {
        panic!("only the oven");
    };
    assert_eq!(oven.availability, "north/west/oven/availability");
    let labels: Vec<&str> = oven.points.iter().map(|point| &*point.label).collect();
    assert_eq!(labels, ["k1", "k2", "k3", "k5", "k6", "k7", "k8"]);
    let set = |label: &str| {
        let mut points = oven.points.iter();
        points
            .find(|point| point.label == label)
            .unwrap()
            .set
            .clone()
    };
    assert_eq!(set("k1"), Some("north/west/oven/k1/set".to_owned()));
    assert_eq!((set("k2"), set("k3")), (None, None), "confirm, and locked");
    assert!(!offer.is_discovered && mqtt("discovery = \"device\"").is_discovered);
    let only_read = mqtt("");
    let mut points = only_read.modules.iter().flat_map(|module| &module.points);
    assert!(points.all(|point| point.set.is_none()), "nothing in write");
    assert_eq!((&*only_read.host, only_read.port), ("127.0.0.1", 1883));
}
