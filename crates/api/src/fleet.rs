//! The types of the centre's API: the sites of a fleet, and what is known of their points.

use super::problem::Problem;
use super::types::{PointValue, Quality};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// The header of what a site answers through its centre, `/s/SITE/api/v1/…`: how long that was on
/// its way, in milliseconds. Ages in the answer are older by so much.
pub const TRANSIT_HEADER: &str = "railbus-transit-ms";

/// The fact of a problem that is one of a site of a fleet, by its name: what usually helps there
/// does not help here.
pub const AT_SITE: &str = "at_site";

/// `GET /fleet/v1/sites`: the sites that ever reported; all, or those that were asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetSites {
    /// The version of the API.
    pub schema: u8,
    /// The centre's own connection.
    pub connection: HubConnection,
    /// How many sites are as was asked for, also if fewer are listed.
    #[serde(default)]
    #[schema(required)]
    pub total: usize,
    /// How many there are at all.
    #[serde(default)]
    #[schema(required)]
    pub counts: FleetCounts,
    /// The groups that sites are in, by name, 1000 at most.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<FleetGroup>,
    /// The sites, by name.
    pub sites: Vec<FleetSite>,
}

/// A group of sites.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetGroup {
    /// Its name.
    pub group: String,
    /// How many sites are in it.
    pub sites: usize,
}

/// `PUT /fleet/v1/sites/{site}/groups`: the groups that a site is in from now on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SetSiteGroups {
    /// At most 16, each of 1 to 64 of a-z, 0-9, - and _; none takes it out of all.
    pub groups: Vec<String>,
}

/// The answer to `PUT /fleet/v1/sites/{site}/groups`: the site. One that never reported is unknown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetSiteTold {
    /// The version of the API.
    pub schema: u8,
    /// The site.
    pub site: FleetSite,
}

/// How many sites there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetCounts {
    /// All of them.
    pub all: usize,
    /// Those that are there.
    pub online: usize,
    /// Those that are not.
    pub offline: usize,
    /// Those of which the centre can't say.
    pub unknown: usize,
    /// Those that need attention.
    pub attention: usize,
}

/// `GET /fleet/v1/accounts`, for the owner of the centre: which accounts it has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetAccounts {
    /// The version of the API.
    pub schema: u8,
    /// The folder of the fleet whose accounts it has locked; none if it does not listen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<String>,
}

/// The centre's connection to its servers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HubConnection {
    /// It hears what sites say.
    pub connected: bool,
    /// Why it does not; or what its servers refuse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<Problem>,
    /// How many messages were not understood since it started.
    pub unreadable: u64,
}

/// Whether a site is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FleetPresence {
    /// Its heartbeats come.
    Online,
    /// They don't.
    Offline,
    /// The centre has no connection, or not for long enough to say.
    Unknown,
}

/// Why a site needs attention.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FleetAttention {
    /// It is offline.
    Offline,
    /// It is online, and its values have not been current for more than 20 seconds.
    NotCurrent,
    /// Another machine with its key asked to be this site within the last ten minutes.
    Duplicate,
    /// Its clock and the centre's differ by more than 30 seconds.
    Clock,
    /// Its key is valid for less than 21 days, and should have been renewed.
    Key,
    /// It refused the configuration that it was given last, or took it back, or its file was
    /// changed since.
    Config,
}

/// A site of the fleet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetSite {
    /// Its name.
    pub site: String,
    /// Whether it is there.
    pub presence: FleetPresence,
    /// How long ago its last heartbeat came, in milliseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heard_ms: Option<u64>,
    /// Its points are as they are shown: it is there, and all has arrived that its last heartbeat
    /// vouches for.
    pub current: bool,
    /// How long ago that was so, in milliseconds; none if it never was since the centre started.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_ms: Option<u64>,
    /// How many of its changes its servers still had to get at its last heartbeat; none unless it
    /// is there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub behind: Option<u64>,
    /// How many points it has.
    pub points: usize,
    /// By how much its clock is ahead of the centre's, in milliseconds, give or take what a message
    /// takes; none unless it is there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock_ahead_ms: Option<i64>,
    /// Its version of railbus.
    pub version: String,
    /// Until when its key is valid, as RFC 3339 in UTC; none where it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_until: Option<String>,
    /// How long ago another machine with its key asked to be this site, in milliseconds, and was
    /// refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duplicate_ms: Option<u64>,
    /// The groups that it is in, by name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<String>,
    /// How far its configuration is; none where it takes none from the centre, and where it was not
    /// heard since the centre was connected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub config: Option<FleetSiteConfig>,
    /// Why it needs attention.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub attention: Vec<FleetAttention>,
}

/// How far the configuration of a site is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetSiteConfig {
    /// How far.
    pub phase: FleetConfigPhase,
    /// Of which version this is said; none if the site knows of none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<u64>,
}

/// How far a configuration is at a site, as it said itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FleetConfigPhase {
    /// The centre has wanted none so far.
    Unmanaged,
    /// It is kept.
    Current,
    /// It waits: another one is tried, or the disk refuses.
    Pending,
    /// It is tried.
    Trying,
    /// It was never applied.
    Refused,
    /// It was tried, and the configuration before came back.
    RolledBack,
    /// The configuration was changed at the site since it was kept.
    LocalChange,
    /// The configuration was changed at the site while it was tried: it is neither kept nor back.
    Interrupted,
    /// Something that this program does not know.
    #[serde(other)]
    Other,
}

/// `GET /fleet/v1/sites/{site}/config`: the configuration that a site is to have, and how far it
/// is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetConfig {
    /// The version of the API.
    pub schema: u8,
    /// The site.
    pub site: String,
    /// Whether it is there. One that is not takes part when it comes.
    pub presence: FleetPresence,
    /// The newest configuration that the centre wanted; none if it wanted none so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wanted: Option<FleetConfigWanted>,
    /// What the site says; none where it takes no configuration from the centre, and where it was
    /// not heard since the centre was connected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<FleetConfigState>,
}

/// A configuration that the centre wants at a site.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetConfigWanted {
    /// Its version: a later one is higher.
    pub version: u64,
    /// Who wanted it.
    pub user: String,
    /// When, by the centre's clock, as RFC 3339 in UTC.
    pub at: String,
    /// What the file is to say, without what only the site itself says.
    pub text: String,
}

/// How far the configuration of a site was at its last heartbeat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetConfigState {
    /// How far.
    pub phase: FleetConfigPhase,
    /// Of which version this is said; none if the site knows of none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<u64>,
    /// The version that was kept last; none if none was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<u64>,
    /// The SHA-256 of what the file says without what only the site itself says, in hexadecimal.
    pub hash: String,
    /// That is not what was kept last.
    pub changed_at_site: bool,
    /// Why it waits, in English.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Why it was not kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<Problem>,
    /// How long ago the heartbeat came, in milliseconds.
    pub heard_ms: u64,
}

/// `PUT /fleet/v1/sites/{site}/config`: the configuration that a site is to have from now on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SetSiteConfig {
    /// What the file is to say, at most 512 KiB, without what only the site itself says: its
    /// integrations, and the tables `history`, `audit`, `ports` and `webhooks`.
    pub text: String,
    /// The version that its author has seen as the newest one, 0 for none: if there is another one,
    /// it is refused. Without it, it follows whatever is the newest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<u64>,
    /// The `hash` of what the site has, which may be replaced although the centre did not make it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replaces: Option<String>,
}

/// `GET /fleet/v1/sites/{site}/config/text`: the configuration that a site has now, as it said when
/// it was asked for this.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetConfigText {
    /// The version of the API.
    pub schema: u8,
    /// The site.
    pub site: String,
    /// What the file says, without what only the site itself says.
    pub text: String,
    /// Its SHA-256, in hexadecimal.
    pub hash: String,
}

/// `DELETE /fleet/v1/sites/{site}`: the site was removed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetRemoval {
    /// The version of the API.
    pub schema: u8,
    /// Its name.
    pub removed: String,
    /// The servers have deleted its values, changes and groups. Otherwise values and groups may
    /// stay there until it comes back, and changes for a day.
    pub purged: bool,
}

/// `GET /fleet/v1/sites/{site}`: a site with its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetSitePoints {
    /// The version of the API.
    pub schema: u8,
    /// The site.
    pub site: FleetSite,
    /// Its points, by path.
    pub points: Vec<FleetPoint>,
}

/// A point of a site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetPoint {
    /// Module and label: `oven.k1`.
    pub path: String,
    /// Its last value; none if it is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<PointValue>)]
    pub value: Option<Value>,
    /// The quality of the value. It is not good unless the site is current.
    pub quality: Quality,
    /// Why it is not good: a word of the site's API, or `site_offline`, `site_unknown` or
    /// `incomplete`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Since when it is so, by the site's clock, as RFC 3339 in UTC.
    pub since: String,
    /// When the value was read, by the site's clock, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
}

/// `GET /fleet/v1/commands`: the newest commands to sites, the newest last.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetCommands {
    /// The version of the API.
    pub schema: u8,
    /// How many commands have no end yet.
    pub open: usize,
    /// The commands to one site.
    pub commands: Vec<FleetCommand>,
    /// Commands to many sites, the newest last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bulk: Vec<FleetBulk>,
}

/// A command to a site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetCommand {
    /// The site.
    pub site: String,
    /// By which it is carried out once: its `Idempotency-Key`.
    pub id: String,
    /// Who gave it.
    pub user: String,
    /// When, by the centre's clock, as RFC 3339 in UTC.
    pub at: String,
    /// The request to the site's API: method, path and the beginning of the body.
    pub method: String,
    /// The path.
    pub path: String,
    /// The beginning of the body.
    pub body: String,
    /// Its result.
    #[serde(flatten)]
    pub end: FleetCommandEnd,
}

/// The result of a command; nothing of it as long as there is none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetCommandEnd {
    /// `answered`: the site reported the result. `never`: it was not carried out. `unknown`:
    /// whether it was carried out is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub how: Option<String>,
    /// The code of the problem, if there was one; of several outputs that of the first. `HTTP` and
    /// the status if the answer was none of railbus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// How the output is known to be so, as the site said it: `readback`, `reply` or `sent`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed: Option<String>,
    /// What the code means, in the language that `Accept-Language` asks for; none without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Why it was not carried out, or that is not known, in English.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// When that was known, by the centre's clock, as RFC 3339 in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_at: Option<String>,
}

/// `POST /fleet/v1/commands/preview`: which sites a command would go to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PreviewBulk {
    /// The sites, as `GET /fleet/v1/sites` finds them: `search`, `state`, `group`, none of them
    /// empty. Without any it is all sites.
    pub select: BTreeMap<String, String>,
    /// The request to the API of each site: `PUT` or `POST`.
    pub method: String,
    /// Its path, such as `/api/v1/points/oven/k1`.
    pub path: String,
    /// Its body.
    #[serde(default)]
    #[schema(value_type = Object)]
    pub body: Value,
}

/// The answer to `POST /fleet/v1/commands/preview`. Nothing is sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetBulkPreview {
    /// The version of the API.
    pub schema: u8,
    /// How many of the sites would be sent it, as it seems now.
    pub sendable: usize,
    /// The sites, by name.
    pub sites: Vec<FleetBulkTarget>,
}

/// A site that a command would go to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetBulkTarget {
    /// The site.
    pub site: String,
    /// Whether it is there.
    pub presence: FleetPresence,
    /// The output, as the centre knows it, if the command is for one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<FleetPoint>,
    /// The code of the problem that is to be expected: E0168 if it would not be sent, E0802 if the
    /// site has no such point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
}

/// `POST /fleet/v1/commands`: the same command to many sites.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct GiveBulk {
    /// The sites, each once, at most 10000.
    pub sites: Vec<String>,
    /// The request to the API of each site: `PUT` or `POST`.
    pub method: String,
    /// Its path, such as `/api/v1/points/oven/k1`.
    pub path: String,
    /// Its body.
    #[serde(default)]
    #[schema(value_type = Object)]
    pub body: Value,
}

/// A command to many sites.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetBulk {
    /// Its id, and that of the command to each site: its `Idempotency-Key`.
    pub id: String,
    /// Who gave it.
    pub user: String,
    /// When, by the centre's clock, as RFC 3339 in UTC.
    pub at: String,
    /// The request to the API of each site: method, path and the beginning of the body.
    pub method: String,
    /// The path.
    pub path: String,
    /// The beginning of the body.
    pub body: String,
    /// How many sites are how.
    pub counts: FleetBulkCounts,
    /// Who stopped it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped_by: Option<String>,
    /// When all was sent that will be; none before. Results of single sites may still come.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_at: Option<String>,
}

/// How many sites of a command are how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FleetBulkCounts {
    /// All of them.
    pub all: usize,
    /// There is no record that it was sent.
    pub waiting: usize,
    /// Sent, or about to be, without a result.
    pub sent: usize,
    /// The site reported that it was done.
    pub done: usize,
    /// The site sent it to the module, which does not confirm it.
    pub unconfirmed: usize,
    /// The site reported a problem.
    pub failed: usize,
    /// It was not carried out.
    pub never: usize,
    /// Whether it was carried out is not known.
    pub unknown: usize,
}

/// What became of a site of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FleetBulkState {
    /// There is no record that it was sent.
    Waiting,
    /// Sent, or about to be, without a result.
    Sent,
    /// The site reported that it was done.
    Done,
    /// The site sent it to the module, which does not confirm it.
    Unconfirmed,
    /// The site reported a problem.
    Failed,
    /// It was not carried out.
    Never,
    /// Whether it was carried out is not known.
    Unknown,
}

/// A site of a command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetBulkSite {
    /// The site.
    pub site: String,
    /// What became of it.
    pub state: FleetBulkState,
    /// The result.
    #[serde(flatten)]
    pub end: FleetCommandEnd,
}

/// `POST /fleet/v1/commands` and `GET /fleet/v1/commands/{id}`: a command to many sites, and its
/// sites.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FleetBulkSites {
    /// The version of the API.
    pub schema: u8,
    /// This process of the centre hears of all records. Otherwise more may have been sent, and
    /// more be known, than it tells.
    pub connected: bool,
    /// The command.
    #[serde(flatten)]
    pub bulk: FleetBulk,
    /// How many sites are as was asked for, also if fewer are listed.
    pub total: usize,
    /// The sites, by name.
    pub sites: Vec<FleetBulkSite>,
}
