//! The types of the API for the datasheets of models.

use super::words::{PulseTimer, SettingAccess};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// `GET /api/v1/models`: every model that railbus knows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Models {
    /// The version of the API.
    pub schema: u8,
    /// All of them, in the order of `railbus ls models`.
    pub models: Vec<ModelInfo>,
}

/// The datasheet of a model. Its texts are in the language of the request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ModelInfo {
    /// Its name in the configuration: `erc8`.
    pub model: String,
    /// What the manufacturer calls it.
    pub title: String,
    /// Outputs; the maximum if `channels_vary`.
    pub outputs: u8,
    /// Digital inputs; the maximum if `channels_vary`.
    pub inputs: u8,
    /// Analog inputs.
    pub analogs: u8,
    /// The number of channels differs from module to module, and is configured.
    pub channels_vary: bool,
    /// The lowest address.
    pub address_min: u8,
    /// The highest address.
    pub address_max: u8,
    /// Its protocols, the factory setting first.
    pub protocols: Vec<String>,
    /// Its baud rates.
    pub bauds: Vec<u32>,
    /// Its character formats: `8N1`.
    pub formats: Vec<String>,
    /// The silence that it needs before a request, if that is more than the protocol's, in ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_ms: Option<u64>,
    /// The settings of a new module.
    pub factory: FactoryInfo,
    /// What times the pulses of its outputs.
    #[schema(value_type = PulseTimer)]
    pub pulses: String,
    /// Its analog inputs can be calibrated.
    pub calibrated: bool,
    /// What it stores.
    pub settings: Vec<ModelSetting>,
    /// The holding registers that it has over Modbus, from 0.
    pub registers: Vec<ModelRegister>,
    /// Its terminals; empty if the datasheet does not number them.
    pub terminals: Vec<TerminalInfo>,
    /// Ratings, and what surprises.
    pub notes: Vec<String>,
}

/// The settings of a new module.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FactoryInfo {
    /// The address.
    pub address: u8,
    /// The speed.
    pub baud: u32,
    /// The character format: `8N1`.
    pub format: String,
}

/// A setting that modules of a model store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ModelSetting {
    /// Its name: `address`, `do3.mode`.
    pub setting: String,
    /// Its possible values, for people: `1-32`.
    pub range: String,
    /// When a change takes effect, or what prevents it, in the protocol of the factory.
    #[schema(value_type = SettingAccess)]
    pub access: String,
}

/// A holding register.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ModelRegister {
    /// Its number, from 0.
    pub at: u16,
    /// What it holds.
    pub name: String,
    /// The fact of the datasheet that says so.
    pub fact: String,
}

/// Terminals, and what is there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct TerminalInfo {
    /// Their numbers on the housing: `11 12 13`.
    pub numbers: String,
    /// What is there.
    pub what: String,
}
