//! The words that some texts of the API are. A client reads them as text, so that it understands a
//! daemon that has one more; the API's document lists them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A language of texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Language {
    /// English.
    En,
    /// Simplified Chinese.
    Zh,
}

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = EventKind)]
pub enum EventKindWord {
    /// An output was written.
    Write,
    /// A module is heard, or no longer.
    Module,
    /// A port was opened, or lost.
    Line,
    /// The configuration was changed.
    Config,
    /// Somebody logged in or out, or tried to; users were changed.
    Login,
    /// An alarm.
    Alarm,
    /// A rule acted, or failed to.
    Rule,
    /// The program itself.
    System,
}

/// How much an event matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = Severity)]
pub enum SeverityWord {
    /// Good to know.
    Info,
    /// To be looked at.
    Warning,
    /// Something does not work.
    Error,
}

/// When a change of a setting takes effect, or what prevents it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SettingAccess {
    /// At once.
    Written,
    /// At the next power-up.
    AtPowerUp,
    /// Only the vendor's software changes it.
    MakersSoftware,
    /// Its INIT* pin decides.
    InitPin,
    /// Only in ASCII protocol.
    InAscii,
    /// Never.
    Fixed,
}

/// Where the value of a setting is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SettingSource {
    /// The module was asked.
    Module,
    /// It follows from where the module answers.
    Place,
    /// It is not known.
    Unknown,
}

/// What a change of settings is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SettingsStage {
    /// Reading the module.
    Reading,
    /// Checking that the new address is free.
    Vacancy,
    /// Writing.
    Writing,
    /// Looking for the module.
    Looking,
    /// Waiting until the module was switched off and on.
    PowerCycle,
    /// Calibrating.
    Calibrating,
}

/// How two modules on one address are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Parting {
    /// One of them is unplugged.
    Plug,
    /// The INIT* pin of one of them is grounded.
    Pin,
    /// One of the boards is taken off.
    Boards,
}

/// What times the pulses of a model's outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PulseTimer {
    /// The daemon.
    Host,
    /// The module, which stores which outputs give pulses, and one width for all of them.
    Stored,
    /// The module: each command says how long.
    Command,
}

/// A step of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationStep {
    /// All inputs are disconnected.
    Zero,
    /// The voltage lies at all of them.
    Span,
}

/// The state of a change in the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChangeState {
    /// It was about to be written: the end is not known.
    Intent,
    /// The module has the new values.
    Done,
    /// The configuration followed it.
    Filed,
    /// It takes effect at the next power-up.
    Pending,
    /// The module has the old values.
    Unchanged,
    /// The module has neither the old nor all of the new values.
    Elsewhere,
    /// The module was not found.
    Lost,
    /// The module is there, and does not tell.
    Untold,
}

/// What the answers of a module found by a scan amount to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScanVerdict {
    /// A model that is known.
    Ok,
    /// One of several models.
    CouldBe,
    /// It refuses.
    Refused,
    /// No model that is known.
    Odd,
    /// Its replies are corrupt.
    Garbled,
}

/// What a raw frame may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SendRisk {
    /// It reads.
    Read,
    /// It may switch outputs.
    Output,
    /// It may change settings.
    Settings,
    /// It may do anything, with all modules at once.
    Broadcast,
}

/// What has to be confirmed for a raw frame to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SendNeed {
    /// That it may switch outputs.
    Output,
    /// That it may change settings.
    Settings,
    /// That all modules may obey it.
    Broadcast,
    /// That it is not bound by the safety rules of the configuration.
    Override,
}

/// How a webhook does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WebhookState {
    /// It is disabled.
    Off,
    /// There was no event yet.
    Idle,
    /// The last event was delivered.
    Ok,
    /// Deliveries fail.
    Failing,
}
