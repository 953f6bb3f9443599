//! Home Assistant without discovery: a package for its configuration.
//!
//! Over MQTT its entities are those of discovery. Over Modbus it has the same points at their
//! addresses; the state of a switch is read back.

use super::File;
use super::asked::Asked;
use super::quote::comment;
use super::texts::ExportText;
use super::yaml::yaml;
use railbus_app::failure::Failure;
use railbus_device::PointKind;
use railbus_gateway::offered::{
    ModbusOffer, ModbusOfferPoint, ModbusPlace, MqttOffer, OfferWay, home_class, shown,
};
use railbus_site::config::ModuleConfig;
use railbus_words::Code;
use serde_json::{Map, Value, json};

/// How often a value is read over Modbus, in seconds: Home Assistant warns of less.
const SCAN_S: u64 = 5;
/// How much longer than a command may wait its answer is waited for, in seconds.
const LONGER_S: u64 = 3;

/// The package.
pub(super) fn file(asked: &Asked<'_>) -> Result<File, Failure> {
    let offer = asked.offer(|way| match way {
        OfferWay::Mqtt(_) => Some(0),
        OfferWay::ModbusTcp(_) => Some(1),
    })?;
    let Some(offer) = offer else {
        return Err(Failure::of(asked.lang, Code::ExportNoOutlet));
    };
    let lang = asked.lang;
    let mut notes = Vec::new();
    let (head, package) = match &offer.way {
        OfferWay::Mqtt(mqtt) => {
            if mqtt.is_discovered {
                let values: &[(&str, &dyn std::fmt::Display)] = &[("outlet", &offer.outlet)];
                notes.push(lang.fill(ExportText::HaDiscovered, values));
            }
            (ExportText::HaMqtt, over_mqtt(mqtt))
        }
        OfferWay::ModbusTcp(modbus) => {
            notes.extend(missing(asked, &offer.outlet, modbus));
            (
                ExportText::HaModbus,
                over_modbus(asked, &offer.outlet, modbus),
            )
        }
    };
    let values: &[(&str, &dyn std::fmt::Display)] =
        &[("site", &asked.site), ("outlet", &offer.outlet)];
    Ok(File {
        text: comment(&lang.fill(head, values)) + "\n" + &yaml(&package),
        notes,
    })
}

fn over_mqtt(offer: &MqttOffer) -> Value {
    let mut kinds: Map<String, Value> = Map::new();
    for entity in &offer.entities {
        let its = kinds.entry(entity.kind).or_insert_with(|| json!([]));
        if let Some(its) = its.as_array_mut() {
            its.push(Value::Object(entity.config.clone()));
        }
    }
    json!({ "mqtt": kinds })
}

/// What Home Assistant does not get or reach over Modbus.
fn missing(asked: &Asked<'_>, outlet: &str, offer: &ModbusOffer) -> Vec<String> {
    let has = |name: &str| offer.points.iter().any(|point| point.module == name);
    let modules = asked.config.modules.iter();
    let left_out: Vec<&str> = modules
        .filter(|(name, module)| !has(name) && shown(module).next().is_some())
        .map(|(name, _)| &**name)
        .collect();
    let mut notes = Vec::new();
    if !left_out.is_empty() {
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("outlet", &outlet), ("modules", &left_out.join(", "))];
        notes.push(asked.lang.fill(ExportText::HaLeftOut, values));
    }
    let listen = offer.listen.ip();
    if listen.is_loopback() && asked.reached(&listen.to_string()) != listen.to_string() {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("outlet", &outlet), ("listen", &listen)];
        notes.push(asked.lang.fill(ExportText::HaOnlyHere, values));
    }
    notes
}

fn over_modbus(asked: &Asked<'_>, outlet: &str, offer: &ModbusOffer) -> Value {
    let (mut switches, mut states, mut sensors) = (Vec::new(), Vec::new(), Vec::new());
    for point in &offer.points {
        let Some(module) = asked.config.modules.get(&point.module) else {
            continue;
        };
        let mut entity = entity(asked, outlet, (point, module));
        match point.place {
            ModbusPlace::Coil if point.may_switch => {
                entity.extend(object(json!({
                    "write_type": "coil", "command_on": 1, "command_off": 0,
                    "verify": { "input_type": "coil" },
                })));
                switches.push(Value::Object(entity));
            }
            ModbusPlace::Coil => {
                entity.insert("input_type".to_owned(), "coil".into());
                states.push(Value::Object(entity));
            }
            ModbusPlace::DiscreteInput => {
                entity.insert("input_type".to_owned(), "discrete_input".into());
                states.push(Value::Object(entity));
            }
            place => {
                entity.extend(number(place, (point, module)));
                sensors.push(Value::Object(entity));
            }
        }
    }
    let mut hub = object(json!({
        "name": format!("railbus_{}_{outlet}", asked.site),
        "type": "tcp",
        "host": asked.reached(&offer.listen.ip().to_string()),
        "port": offer.listen.port(),
        "timeout": offer.within_ms.div_ceil(1_000) + LONGER_S,
    }));
    for (kind, entities) in [
        ("switches", switches),
        ("binary_sensors", states),
        ("sensors", sensors),
    ] {
        if !entities.is_empty() {
            hub.insert(kind.to_owned(), entities.into());
        }
    }
    json!({ "modbus": [hub] })
}

/// What every entity has.
fn entity(
    asked: &Asked<'_>,
    outlet: &str,
    (point, module): (&ModbusOfferPoint, &ModuleConfig),
) -> Map<String, Value> {
    let called = asked
        .point_name(module, point.point)
        .unwrap_or(&point.label);
    let of = asked.module_name(&point.module, module);
    object(json!({
        "name": format!("{of} {called}"),
        "unique_id": format!("railbus_{}_{outlet}_{}_{}", asked.site, point.module, point.label),
        "slave": point.unit,
        "address": point.address,
        "scan_interval": SCAN_S,
    }))
}

/// How a number is read: what stands for it, and what that means.
fn number(
    place: ModbusPlace,
    (point, module): (&ModbusOfferPoint, &ModuleConfig),
) -> Map<String, Value> {
    let (input, data) = match place {
        ModbusPlace::HoldingHundredths => ("holding", "uint16"),
        ModbusPlace::InputHundredths => ("input", "uint16"),
        ModbusPlace::InputFloat => ("input", "float32"),
        _ => ("input", "uint32"),
    };
    let mut keys = object(json!({ "input_type": input, "data_type": data }));
    if point.point.kind != PointKind::Analog {
        return keys;
    }
    let range = module.range_of(point.point);
    if data == "uint16" {
        // What 0 and 100.00 at the terminal mean.
        let (low, high) = (range.value(0), range.value(10_000));
        keys.insert("scale".to_owned(), rounded((high - low) / 10_000.0).into());
        keys.insert("offset".to_owned(), rounded(low).into());
    }
    keys.insert("precision".to_owned(), range.decimals.into());
    keys.insert("state_class".to_owned(), "measurement".into());
    let (class, unit) = home_class(&range.unit);
    if let Some(class) = class {
        keys.insert("device_class".to_owned(), class.into());
    }
    if !unit.is_empty() {
        keys.insert("unit_of_measurement".to_owned(), unit.into());
    }
    keys
}

/// Without what a division leaves in the last of its digits.
fn rounded(number: f64) -> f64 {
    format!("{number:.11e}").parse().unwrap_or(number)
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(object) => object,
        _ => Map::new(),
    }
}
