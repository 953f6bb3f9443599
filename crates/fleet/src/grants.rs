//! Who may publish and hear what. The tables of docs/decisions/0051 as data.
//!
//! Sites and the centre have accounts of their own at the servers, and see of each other's subjects
//! only what is shared here. With one account for both, a site could have the reply to a request
//! stored: a request names its reply subject, no server checks that, and the reply would have come
//! into the stream of that subject.

use serde_json::{Value, json};

/// The most that a message has, in bytes.
pub(crate) const PAYLOAD_MAX: u64 = 1 << 20;
/// The most subscriptions of a site.
const SITE_SUBSCRIPTIONS_MAX: u64 = 64;
/// The same with the key of an invitation, and its longest message in bytes.
const INVITED_SUBSCRIPTIONS_MAX: u64 = 4;
const INVITED_PAYLOAD_MAX: u64 = 4 << 10;
/// How the inboxes of invitations begin.
pub const JOIN_INBOX: &str = "_JOIN";
/// How long a site has to answer a request, in nanoseconds.
const ANSWER_WITHIN_NS: u64 = 60_000_000_000;
/// The site's name in the template of its rights. The server puts it in from the signed claims of
/// the client.
const SITE: &str = "{{name()}}";

/// What one account shares with another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shared {
    /// What it is called.
    pub(crate) name: &'static str,
    pub(crate) subject: &'static str,
    pub(crate) way: Way,
}

/// In which direction messages of a shared subject go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    /// To the account that shares it. The answer finds its way back.
    Service,
    /// From the account that shares it.
    Stream,
}

impl Way {
    /// As claims have it.
    pub(crate) const fn word(self) -> &'static str {
        match self {
            Way::Service => "service",
            Way::Stream => "stream",
        }
    }
}

/// What the centre shares with sites.
pub(crate) const OF_HUB: &[Shared] = &[
    Shared {
        name: "what sites say",
        subject: "rb.up.*.*",
        way: Way::Service,
    },
    Shared {
        name: "requests for keys by invitations",
        subject: "rb.join.*",
        way: Way::Service,
    },
    Shared {
        name: "a site's documents as they are",
        subject: "$JS.API.DIRECT.GET.DESIRED.rb.desired.*.*",
        way: Way::Service,
    },
    Shared {
        name: "a site's documents as they come",
        subject: "rb.desired.*.*",
        way: Way::Stream,
    },
];

/// What sites share with the centre.
pub(crate) const OF_SITES: &[Shared] = &[Shared {
    name: "what sites are asked",
    subject: "rb.down.*.*.*",
    way: Way::Service,
}];

/// What a site may do, as the template of the key that signs its claims.
pub(crate) fn site() -> Value {
    json!({
        "pub": { "allow": [
            format!("rb.up.{SITE}.*"),
            format!("$JS.API.DIRECT.GET.DESIRED.rb.desired.{SITE}.*"),
        ] },
        "sub": { "allow": [
            format!("rb.down.{SITE}.*.*"),
            format!("rb.desired.{SITE}.*"),
            format!("_INBOX.{SITE}.>"),
        ] },
        "resp": { "max": 1, "ttl": ANSWER_WITHIN_NS },
        "subs": SITE_SUBSCRIPTIONS_MAX,
        "data": -1,
        "payload": PAYLOAD_MAX,
    })
}

/// What the key of an invitation permits: to request the key of this site. Answers come to an inbox
/// that no site has.
pub(crate) fn invited() -> Value {
    json!({
        "pub": { "allow": [format!("rb.join.{SITE}")] },
        "sub": { "allow": [format!("{JOIN_INBOX}.{SITE}.>")] },
        "subs": INVITED_SUBSCRIPTIONS_MAX,
        "data": -1,
        "payload": INVITED_PAYLOAD_MAX,
    })
}

/// What the centre may do. Streams are made and read by it alone. What people did can't be taken
/// from the audit stream with its key, neither deleted nor by another limit: only the offline key
/// of the centre's account can change that stream.
pub(crate) fn hub() -> Value {
    json!({
        "pub": {
            "allow": [
                "rb.down.>", "rb.desired.>", "rb.cmd.>", "rb.fleet.>", "rb.audit",
                "$JS.API.>", "$JS.ACK.>", "$JS.FC.>",
            ],
            "deny": [
                "$JS.API.STREAM.DELETE.AUDIT", "$JS.API.STREAM.PURGE.AUDIT",
                "$JS.API.STREAM.MSG.DELETE.AUDIT", "$JS.API.STREAM.UPDATE.AUDIT",
                "$JS.API.STREAM.RESTORE.AUDIT", "$JS.API.STREAM.PEER.REMOVE.AUDIT",
            ],
        },
        "sub": { "allow": ["rb.>", "_INBOX.>"] },
        // It hears requests for sessions twice: as one of all centres, and with all that sites say.
        // The server takes the second delivery for an answer.
        "resp": { "max": 2, "ttl": ANSWER_WITHIN_NS },
        "subs": -1,
        "data": -1,
        "payload": PAYLOAD_MAX,
    })
}

/// What the system user of the centre may do: see how the servers are, hear of connections, and
/// hand over new claims of the sites' account.
pub(crate) fn system() -> Value {
    json!({
        "pub": { "allow": [
            "$SYS.REQ.CLAIMS.UPDATE", "$SYS.REQ.SERVER.PING.>", "$SYS.REQ.ACCOUNT.>",
        ] },
        "sub": { "allow": ["$SYS.ACCOUNT.*.CONNECT", "$SYS.ACCOUNT.*.DISCONNECT", "_INBOX.>"] },
        "resp": {},
        "subs": -1,
        "data": -1,
        "payload": PAYLOAD_MAX,
    })
}
