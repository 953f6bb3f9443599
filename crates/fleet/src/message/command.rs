//! Commands to sites, and their records.

use super::{ApiAnswer, FleetRefusal};

/// A command to a site: a request to its API that it carries out at most once.
#[derive(Clone, PartialEq, prost::Message)]
pub struct CommandRequest {
    /// By which the site knows it again.
    #[prost(string, tag = "1")]
    pub id: String,
    /// The method of HTTP.
    #[prost(string, tag = "2")]
    pub method: String,
    /// The path.
    #[prost(string, tag = "3")]
    pub path: String,
    /// The body.
    #[prost(bytes = "vec", tag = "4")]
    pub body: Vec<u8>,
    /// The name of the caller at the centre.
    #[prost(string, tag = "5")]
    pub user: String,
    /// As in [`super::ApiRequest`].
    #[prost(string, tag = "6")]
    pub language: String,
    /// The run of the site whose time counts.
    #[prost(bytes = "vec", tag = "7")]
    pub boot: Vec<u8>,
    /// By when its frames must be sent, by the site's own time, in milliseconds.
    #[prost(uint64, tag = "8")]
    pub valid_until_ms: u64,
    /// It is not begun: only its result is wanted.
    #[prost(bool, tag = "9")]
    pub tell: bool,
}

/// The answer to [`CommandRequest`].
#[derive(Clone, PartialEq, prost::Message)]
pub struct CommandAnswer {
    /// Its result.
    #[prost(oneof = "CommandOutcome", tags = "1, 2, 3, 4, 5")]
    pub answer: Option<CommandOutcome>,
}

/// The result of a command, as its site reports it.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum CommandOutcome {
    /// The site knows no commands: the form of every answer that is a refusal.
    #[prost(message, tag = "1")]
    NotUnderstood(FleetRefusal),
    /// What its API answered.
    #[prost(message, tag = "2")]
    Ended(ApiAnswer),
    /// It was not begun, and never will be.
    #[prost(message, tag = "3")]
    Never(FleetRefusal),
    /// Not known yet.
    #[prost(message, tag = "4")]
    Later(FleetRefusal),
    /// The site can't tell.
    #[prost(message, tag = "5")]
    Lost(FleetRefusal),
}

/// A document of the centre about a command.
#[derive(Clone, PartialEq, prost::Message)]
pub struct CommandRecord {
    /// An intent, or its result.
    #[prost(oneof = "CommandKind", tags = "1, 2")]
    pub record: Option<CommandKind>,
}

/// An intent, or its result.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum CommandKind {
    /// The command.
    #[prost(message, tag = "1")]
    Intent(CommandIntent),
    /// Its result.
    #[prost(message, tag = "2")]
    End(CommandEnd),
}

/// The command.
#[derive(Clone, PartialEq, prost::Message)]
pub struct CommandIntent {
    /// As in [`CommandRequest`].
    #[prost(string, tag = "1")]
    pub method: String,
    /// As in [`CommandRequest`].
    #[prost(string, tag = "2")]
    pub path: String,
    /// As in [`CommandRequest`].
    #[prost(bytes = "vec", tag = "3")]
    pub body: Vec<u8>,
    /// As in [`CommandRequest`].
    #[prost(string, tag = "4")]
    pub user: String,
    /// As in [`CommandRequest`].
    #[prost(string, tag = "5")]
    pub language: String,
    /// As in [`CommandRequest`].
    #[prost(bytes = "vec", tag = "6")]
    pub boot: Vec<u8>,
    /// As in [`CommandRequest`].
    #[prost(uint64, tag = "7")]
    pub valid_until_ms: u64,
    /// When it was wanted, in milliseconds since 1970.
    #[prost(int64, tag = "8")]
    pub at_ms: i64,
    /// Distinguishes it from another one of the same id.
    #[prost(bytes = "vec", tag = "9")]
    pub token: Vec<u8>,
    /// It is one of a [`BulkOrder`] of the same id.
    #[prost(bool, tag = "10")]
    pub is_bulk: bool,
}

/// The result of a command.
#[derive(Clone, PartialEq, prost::Message)]
pub struct CommandEnd {
    /// The command.
    #[prost(message, optional, tag = "1")]
    pub intent: Option<CommandIntent>,
    /// Its result.
    #[prost(oneof = "CommandResult", tags = "2, 3, 4")]
    pub end: Option<CommandResult>,
    /// When that was known, in milliseconds since 1970.
    #[prost(int64, tag = "5")]
    pub at_ms: i64,
}

/// The result of a command.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum CommandResult {
    /// What the API of the site answered.
    #[prost(message, tag = "2")]
    Ended(ApiAnswer),
    /// It was not carried out.
    #[prost(message, tag = "3")]
    Never(FleetRefusal),
    /// Whether it was carried out is not known, and never will be.
    #[prost(message, tag = "4")]
    Unknown(FleetRefusal),
}

/// A document of the centre about one command to many sites.
#[derive(Clone, PartialEq, prost::Message)]
pub struct BulkRecord {
    /// The order, a wish to stop it, or its end. The tags are not those of [`CommandRecord`].
    #[prost(oneof = "BulkKind", tags = "11, 12, 13")]
    pub record: Option<BulkKind>,
}

/// What was recorded of a command to many sites.
#[derive(Clone, PartialEq, prost::Oneof)]
pub enum BulkKind {
    /// The order.
    #[prost(message, tag = "11")]
    Order(BulkOrder),
    /// No more of its commands are to be sent: who wants that.
    #[prost(string, tag = "12")]
    Stop(String),
    /// All was sent that will be.
    #[prost(message, tag = "13")]
    End(BulkEnd),
}

/// The same command to many sites.
#[derive(Clone, PartialEq, prost::Message)]
pub struct BulkOrder {
    /// As in [`CommandRequest`].
    #[prost(string, tag = "1")]
    pub method: String,
    /// As in [`CommandRequest`].
    #[prost(string, tag = "2")]
    pub path: String,
    /// As in [`CommandRequest`].
    #[prost(bytes = "vec", tag = "3")]
    pub body: Vec<u8>,
    /// As in [`CommandRequest`].
    #[prost(string, tag = "4")]
    pub user: String,
    /// As in [`CommandRequest`].
    #[prost(string, tag = "5")]
    pub language: String,
    /// The sites, each once.
    #[prost(string, repeated, tag = "6")]
    pub sites: Vec<String>,
    /// When it was wanted, in milliseconds since 1970.
    #[prost(int64, tag = "7")]
    pub at_ms: i64,
    /// Distinguishes it from another one of the same id.
    #[prost(bytes = "vec", tag = "8")]
    pub token: Vec<u8>,
}

/// To which sites a command to many was not sent. Of the others it is recorded one by one.
#[derive(Clone, PartialEq, prost::Message)]
pub struct BulkEnd {
    /// Those sites, by the reason.
    #[prost(message, repeated, tag = "1")]
    pub unsent: Vec<BulkUnsent>,
    /// Who stopped it.
    #[prost(string, tag = "2")]
    pub stopped_by: String,
    /// When that was known, in milliseconds since 1970.
    #[prost(int64, tag = "3")]
    pub at_ms: i64,
}

/// Sites to which a command was not sent.
#[derive(Clone, PartialEq, prost::Message)]
pub struct BulkUnsent {
    /// Why.
    #[prost(message, optional, tag = "1")]
    pub why: Option<FleetRefusal>,
    /// The sites.
    #[prost(string, repeated, tag = "2")]
    pub sites: Vec<String>,
}
