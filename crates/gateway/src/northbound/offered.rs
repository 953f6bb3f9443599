//! What outlets offer other programs, by the configuration alone, without a daemon: for the
//! configurations of these programs.

use super::kind::ENABLED;
use railbus_device::{Point, PointKind};
use railbus_site::Config;
use railbus_site::config::{ModuleConfig, OutletTable};
use serde_json::{Map, Value};
use std::net::SocketAddr;
use std::path::Path;

/// An outlet that other programs have points from.
#[derive(Clone, Debug)]
pub struct Offer {
    /// The name of the outlet.
    pub outlet: String,
    /// What it offers.
    pub way: OfferWay,
}

/// How it offers them.
#[derive(Clone, Debug)]
pub enum OfferWay {
    /// At a broker.
    Mqtt(MqttOffer),
    /// As a Modbus TCP server without TLS.
    ModbusTcp(ModbusOffer),
}

/// Topics at a broker.
#[derive(Clone, Debug)]
pub struct MqttOffer {
    /// The broker.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Whether it is reached with TLS.
    pub is_tls: bool,
    /// `online` or `offline` for all.
    pub bridge: String,
    /// The topic of the periodic health message, which is not retained.
    pub health: String,
    /// The period of that message, in seconds.
    pub health_every_s: u64,
    /// The published modules.
    pub modules: Vec<MqttOfferModule>,
    /// The same for Home Assistant's own configuration.
    pub entities: Vec<HomeEntity>,
    /// Whether Home Assistant discovery is on.
    pub is_discovered: bool,
}

/// A module at a broker.
#[derive(Clone, Debug)]
pub struct MqttOfferModule {
    /// Its name.
    pub module: String,
    /// The topic that says `online` or `offline`.
    pub availability: String,
    /// The topics of all its values, `+` in place of the label.
    pub states: String,
    /// Its points, without hidden ones.
    pub points: Vec<MqttOfferPoint>,
}

/// A point at a broker.
#[derive(Clone, Debug)]
pub struct MqttOfferPoint {
    /// Its label.
    pub label: String,
    /// Which one.
    pub point: Point,
    /// The topic of its value.
    pub state: String,
    /// The topic that switches it, if the outlet may and no confirmation is required.
    pub set: Option<String>,
}

/// An entity of Home Assistant.
#[derive(Clone, Debug, PartialEq)]
pub struct HomeEntity {
    /// `switch`, `binary_sensor`, …
    pub kind: &'static str,
    /// As its configuration has it.
    pub config: Map<String, Value>,
}

/// Units of a Modbus TCP server.
#[derive(Clone, Debug)]
pub struct ModbusOffer {
    /// Where it listens.
    pub listen: SocketAddr,
    /// How long a command may wait until it is sent, in ms.
    pub within_ms: u64,
    /// The points, without hidden ones.
    pub points: Vec<ModbusOfferPoint>,
}

/// A point of a Modbus TCP server.
#[derive(Clone, Debug, PartialEq)]
pub struct ModbusOfferPoint {
    /// Its module.
    pub module: String,
    /// Its label.
    pub label: String,
    /// Which one.
    pub point: Point,
    /// The unit that its module is.
    pub unit: u8,
    /// Where it is read.
    pub place: ModbusPlace,
    /// The number of its bit or first register, from 0.
    pub address: u16,
    /// Whether the outlet may switch it and no confirmation is required.
    pub may_switch: bool,
}

/// Where a point is read over Modbus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusPlace {
    /// A coil.
    Coil,
    /// A discrete input.
    DiscreteInput,
    /// A holding register, as the module has it: hundredths of what is at the terminal.
    HoldingHundredths,
    /// An input register, as the module has it.
    InputHundredths,
    /// Two input registers: a 32-bit floating-point number, high word first.
    InputFloat,
    /// Two input registers: an unsigned 32-bit number, high word first.
    InputNumber,
}

/// What the enabled outlets of a configuration offer; `file` is where it stands.
#[must_use]
pub fn offers(file: &Path, config: &Config) -> Vec<Offer> {
    let site = site_name(file);
    let offer = |(name, outlet): (&String, &OutletTable)| {
        let kind = super::of_name(&outlet.kind)?;
        let is_enabled = outlet.settings.get(ENABLED) != Some(&false.into());
        let offered = is_enabled.then(|| (kind.offer)(name, &outlet.settings, &site, config));
        Some(Offer {
            outlet: name.clone(),
            way: offered.flatten()?,
        })
    };
    config.outlets.iter().filter_map(offer).collect()
}

/// What the site of this configuration file is called.
#[must_use]
pub fn site_name(file: &Path) -> String {
    crate::site::name_of(false, file)
}

/// The class of what has this unit, and the unit as Home Assistant writes it. It refuses a class
/// with a unit that is none of its own.
#[must_use]
pub fn home_class(unit: &str) -> (Option<&'static str>, &str) {
    match unit {
        "V" | "mV" => (Some("voltage"), unit),
        "A" | "mA" => (Some("current"), unit),
        "℃" => (Some("temperature"), "°C"),
        "℉" => (Some("temperature"), "°F"),
        "°C" | "°F" | "K" => (Some("temperature"), unit),
        "Pa" | "hPa" | "kPa" | "mbar" | "bar" | "psi" => (Some("pressure"), unit),
        "Hz" | "kHz" => (Some("frequency"), unit),
        "W" | "kW" => (Some("power"), unit),
        "lx" => (Some("illuminance"), unit),
        _ => (None, unit),
    }
}

/// The points of a module that are not hidden, with their labels.
pub fn shown(module: &ModuleConfig) -> impl Iterator<Item = (String, Point)> {
    let is_shown = |point: &Point| !module.points.get(point).is_some_and(|about| about.hidden);
    let labelled = |point| {
        let (letters, number) = module.setup.label(point);
        (format!("{letters}{number}"), point)
    };
    module.setup.points().filter(is_shown).map(labelled)
}

/// Whether another program may have a point as an output: one that is locked can't be switched,
/// and one that requires confirmation must not be switched without a person's consent.
#[must_use]
pub fn can_be_wired(module: &ModuleConfig, point: Point) -> bool {
    let own = module.points.get(&point);
    let is_guarded = own.is_some_and(|own| own.locked || own.safety.confirm.is_some());
    point.kind == PointKind::Output && !is_guarded
}
