//! Why a request failed, as data: the code selects the text, the rest fills its placeholders. Over
//! HTTP it is an `application/problem+json` [RFC 9457].

use railbus_words::Code;
use railbus_words::Lang;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Why a request failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// The stable code, such as `E0301`. Its first two digits are the exit code.
    pub code: String,
    /// One English sentence, for clients that do not know the code.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// The subject and the circumstances: `module`, `line`, `point`, `address`, `protocol`,
    /// `model`, `attempts`, `rx_bytes`, `reason`, ...; which ones depends on the code.
    #[serde(flatten)]
    pub with: BTreeMap<String, serde_json::Value>,
    /// Commands that may help.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hint: Vec<String>,
    /// The command may still have taken effect: check before repeating it. Left out if it can't
    /// have.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub may_have_acted: bool,
}

impl Problem {
    /// A problem of this kind.
    pub fn new(kind: ProblemType) -> Problem {
        Problem {
            code: kind.code.to_owned(),
            title: kind.title().to_owned(),
            status: kind.status,
            with: BTreeMap::new(),
            hint: Vec::new(),
            may_have_acted: false,
        }
    }

    /// Adds a field.
    pub fn with(mut self, key: &str, value: impl Into<serde_json::Value>) -> Problem {
        self.with.insert(key.to_owned(), value.into());
        self
    }

    /// Marks that the command may still have taken effect.
    pub const fn perhaps_acted(mut self, perhaps: bool) -> Problem {
        self.may_have_acted |= perhaps;
        self
    }

    /// Adds a command that may help.
    pub fn with_hint(mut self, command: impl Into<String>) -> Problem {
        self.hint.push(command.into());
        self
    }

    /// The value of a field, as text; empty if there is none.
    pub fn text(&self, key: &str) -> String {
        match self.with.get(key) {
            Some(serde_json::Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
            None => String::new(),
        }
    }
}

/// A kind of problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProblemType {
    /// The stable code.
    pub code: &'static str,
    /// The HTTP status.
    pub status: u16,
}

impl ProblemType {
    /// One English sentence, as in the table of codes.
    fn title(self) -> &'static str {
        Code::from_name(self.code).map_or("", |code| code.page().title(Lang::En))
    }
}

/// Every kind, and the fields that come with it.
pub mod codes {
    use super::ProblemType;

    macro_rules! kinds {
        ($($(#[$doc:meta])* $name:ident = $code:literal, $status:literal;)*) => {
            $($(#[$doc])* pub const $name: ProblemType = ProblemType {
                code: $code,
                status: $status,
            };)*
            /// All of them.
            pub const ALL: &[ProblemType] = &[$($name),*];
        };
    }

    kinds! {
        /// Also `reason`.
        INTERNAL = "E0101", 500;
        /// Also `module`, `line`.
        OVERLOADED = "E0105", 503;
        /// Also `module`, `line`; `lost`, as of a module: the results of the last requests to it,
        /// if those were garbled.
        EXPIRED = "E0106", 503;
        /// Also `module`, `point`.
        LOCKED = "E0107", 423;
        /// Also `module`, `point`, `value`: its state.
        NOT_AS_ASKED = "E0108", 409;
        /// Also `reason`, `socket`.
        DAEMON = "E0109", 502;
        /// Also `path`, `reason`.
        TLS = "E0190", 500;
        /// Also `path`.
        NO_SUCH_PAGE = "E0110", 404;
        /// Also `reason`.
        NOT_KEPT = "E0150", 503;
        /// Also `reason`.
        NOT_TAKEN_OVER = "E0152", 503;
        /// Also `path`, `retry_after_ms`.
        OUTPUT_DUE = "E0153", 409;
        /// Also `name`.
        NO_SUCH_COMMAND = "E0151", 404;
        /// There is no history and no audit log here.
        NO_HISTORY = "E0170", 503;
        /// Also `reason`.
        HISTORY_FAILS = "E0171", 503;
        /// Also `module`.
        NOT_AUDITED = "E0172", 503;
        /// Also `name`.
        NO_SUCH_EVENT = "E0173", 404;
        /// May be accepted with a shorter time.
        TOO_MUCH_ASKED = "E0174", 422;
        /// Only from the command line: a daemon checks what it writes itself.
        AUDIT_HELD = "E0175", 409;
        /// Also `count`, `days`.
        OUTBOX_DROPPED = "E0176", 507;
        /// Also `path`, `reason`.
        OUTBOX_FAILS = "E0177", 507;
        /// Also `line`, `op`: the running one.
        SCAN_RUNS = "E0210", 409;
        /// Also `reason`.
        SIM_ORDER = "E0290", 422;
        /// Also `module`, `line`, `address`, `protocol`, `model`, `attempts`, `rx_bytes`, `baud`,
        /// `format`; `channel_doubtful` if the board answers, but may not have this channel.
        NO_REPLY = "E0301", 504;
        /// Also `module`, `line`, ...
        UNKNOWN = "E0302", 504;
        /// A command with this key was begun, and its result is not known.
        KEY_BEGUN = "E0303", 504;
        /// Also `module`, `line`, ..., `refusal`.
        REFUSED = "E0401", 502;
        /// Also `module`, `line`, ...; `answers_as`: the model that is there instead.
        OTHER_MODEL = "E0402", 409;
        /// Also `module`, `point`. To be repeated with `"confirm": true`.
        CONFIRM = "E0450", 409;
        /// Also `module`, `point`, `by`: the path of the other output.
        INTERLOCK = "E0451", 409;
        /// Also `module`, `point`, `retry_after_ms`.
        MIN_OFF = "E0452", 409;
        /// Also `module`, `point`.
        UNWATCHED = "E0453", 409;
        /// Also `module`, `point`.
        NO_LEASE = "E0454", 409;
        /// Also `module`.
        NOT_TRIED = "E0455", 409;
        /// Also `module`.
        UNDONE = "E0456", 409;
        /// Also `scene`.
        PLAYING = "E0457", 409;
        /// Also `line`, `risk`, `needs`: the words that `confirm` must contain, `may`: what it may
        /// do.
        SEND_CONFIRM = "E0458", 409;
        /// Also `module`, `line`, ..., `attempts`, `rx_bytes`, `why`.
        GARBLED = "E0501", 502;
        /// Also `line`.
        SCAN_NOISE = "E0570", 503;
        /// Also `module`, `line`, ..., `point`, `value`: the commanded one.
        NOT_VERIFIED = "E0601", 409;
        /// Also `module`.
        NOT_UNDONE = "E0650", 409;
        /// Also `line`, `port`, `reason`, `holder`, `group`.
        LINE_CLOSED = "E0710", 503;
        /// Also `name`, `known`.
        NO_SUCH_MODULE = "E0801", 404;
        /// Also `module`, `name`, `known`.
        NO_SUCH_POINT = "E0802", 404;
        /// Also `name`, `known`.
        NO_SUCH_LINE = "E0803", 404;
        /// Also `module`, `point`, `model`, `width_ms` and `pulse_mode`: the module's own, if
        /// known.
        PULSE_WIDTH = "E0804", 422;
        /// Also `module`, `model`.
        UNSUPPORTED = "E0805", 422;
        /// Also `reason`.
        BAD_REQUEST = "E0806", 422;
        /// Also `module`, `point`.
        NOT_AN_OUTPUT = "E0807", 422;
        /// Also `reason`.
        BAD_FRAME = "E0808", 422;
        /// No configuration, no flags. Also `looked`: the places.
        NO_CONFIG = "E0809", 422;
        /// Also `file`, `problems`: each with `line`, `column`, `path`, `code`, `reason`.
        BAD_CONFIG = "E0810", 422;
        /// Also `file`, `reason`.
        CONFIG_FILE = "E0824", 422;
        /// Also `file`, `etag`: that of the current text.
        CONFIG_CHANGED = "E0827", 412;
        /// Also `name`.
        NOT_EDITABLE = "E0828", 422;
        /// Also `kind`, `name`.
        ALREADY_THERE = "E0829", 409;
        /// Also `file`, `reason`.
        CONFIG_NOT_WRITTEN = "E0830", 500;
        /// There is no such version.
        NO_GENERATION = "E0831", 404;
        /// A whole text was sent without the ETag of the text it replaces.
        NO_IF_MATCH = "E0832", 428;
        /// Also `name`.
        NO_SUCH_RULE = "E0853", 404;
        /// Also `name`.
        RULE_NOT_TRIED = "E0854", 409;
        /// Also `reason`.
        HOOK_UNREACHED = "E0857", 502;
        /// Also `reason`.
        HOOK_TLS = "E0858", 502;
        /// Also `reason`.
        HOOK_SLOW = "E0859", 504;
        /// Also `name`, `known`.
        NO_SUCH_GROUP = "E0860", 404;
        /// Also `name`, `known`.
        NO_SUCH_SCENE = "E0861", 404;
        /// Also `name`.
        NOT_SIMULATED = "E0862", 404;
        /// Also `name`.
        NO_SIM_MODULE = "E0863", 404;
        /// Also `name`.
        NO_SUCH_OUTLET = "E0864", 404;
        /// Also `name`, `reason`.
        OUTLET_ENDED = "E0875", 500;
        /// Also `name`.
        OUTLET_STUCK = "E0880", 504;
        /// Also `reason`: the modules.
        NOT_A_UNIT = "E0886", 409;
        /// Also `reason`: the modules and their unit.
        UNIT_TAKEN = "E0887", 409;
        /// Also `listen`, `reason`.
        OUTLET_LISTEN = "E0895", 502;
        /// Also `path`, `reason`.
        BROKER_FILE = "E0856", 500;
        /// Also `broker`: host and port, `topic`, `reason`.
        BROKER_TOPIC = "E0932", 403;
        /// Also `reason`: the thumbprint and the name of the certificate.
        CLIENT_UNTRUSTED = "E0933", 403;
        /// Also `broker`, `reason`.
        BROKER_UNREACHED = "E0896", 502;
        /// Also `broker`, `reason`.
        BROKER_TLS = "E0897", 502;
        /// Also `broker`, `reason`.
        BROKER_LOGIN = "E0898", 502;
        /// Also `broker`, `reason`.
        BROKER_REFUSED = "E0899", 502;
        /// Also `path`, `reason`.
        FLEET_FILE = "E0160", 500;
        /// Also `reason`.
        FLEET_UNREACHED = "E0161", 502;
        /// Also `reason`.
        FLEET_TLS = "E0162", 502;
        /// Also `reason`.
        FLEET_LOGIN = "E0934", 502;
        /// The centre does not answer.
        FLEET_AWAY = "E0163", 503;
        /// Also `reason`.
        FLEET_TAKEN = "E0935", 409;
        /// Also `reason`: the day.
        FLEET_KEY_ENDS = "E0936", 401;
        /// Also `reason`.
        NOT_INVITED = "E0938", 403;
        /// Also `reason`.
        NO_KEY = "E0939", 503;
        /// Also `name`: the site of the invitation.
        OTHER_FLEET = "E0940", 409;
        /// Also `outlet`.
        READS_ONLY = "E0941", 403;
        /// Also `name`: the site.
        NOT_MANAGED = "E0942", 409;
        /// Also `name`: the site.
        SITE_CONFIG_CHANGED = "E0943", 409;
        /// Also `reason`.
        CONFIG_TAKEN_BACK = "E0944", 409;
        /// Also `reason`.
        CONFIG_UNTRUSTED = "E0945", 403;
        /// Also `path`, at the centre.
        NO_CONFIG_KEY = "E0946", 503;
        /// Also `reason`: the tables.
        SITE_OWN = "E0947", 403;
        /// Also `reason`.
        FLEET_NOT_STORED = "E0164", 503;
        /// Also `reason`.
        FLEET_ENDED = "E0165", 502;
        /// The centre asks for entries of another outbox.
        FLEET_EPOCH = "E0166", 409;
        /// Also `reason`.
        FLEET_STREAMS = "E0167", 503;
        /// Also `name`: the site, `reason`.
        SITE_AWAY = "E0168", 503;
        /// Also `name`: the site, `id`: the command, `reason`.
        COMMAND_OPEN = "E0169", 504;
        /// Also `reason`: what it is.
        NOT_REMOTE = "E0937", 403;
        /// Also `name`.
        NO_SUCH_SITE = "E0836", 404;
        /// Also `name`: the site.
        SITE_THERE = "E0179", 409;
        /// Also `name`: the site.
        SITE_CHANGING = "E0184", 409;
        /// Also `id`.
        NO_SUCH_BULK = "E0837", 404;
        /// Also `reason`: its host ID.
        HOST_AWAY = "E0833", 503;
        /// Also `name`.
        NO_SUCH_HOOK = "E0877", 404;
        /// Also `reason`: the status received.
        HOOK_REFUSED = "E0878", 502;
        /// Also `path`, `reason`.
        HOOK_SECRET = "E0879", 500;
        /// Also `reason`.
        FORBIDDEN = "E0901", 403;
        /// Only from the command line. Also `socket`, `served`, `config`: the two files.
        OTHER_SITE = "E0884", 409;
        /// Also `module`, `etag`: that of the current values.
        SETTINGS_CHANGED = "E0881", 412;
        /// Settings were sent without the ETag of the values they change.
        NO_SETTINGS_MATCH = "E0882", 428;
        /// Also `line`, `op`: the operation in progress.
        LINE_AT_WORK = "E0883", 409;
        /// Not authenticated.
        UNAUTHENTICATED = "E0902", 401;
        /// Name or password is wrong.
        WRONG_LOGIN = "E0904", 401;
        /// Also `role`, `need`.
        ROLE = "E0905", 403;
        /// Also `module`, `point`.
        POINT_RIGHT = "E0906", 403;
        /// Also `retry_after_ms`.
        TRIES = "E0907", 429;
        /// The request lacks the CSRF token of its session.
        CSRF = "E0908", 403;
        /// The set-up link is invalid or expired.
        SETUP = "E0909", 403;
        /// Also `name`.
        NO_SUCH_USER = "E0910", 404;
        /// Also `name`.
        NAME_TAKEN = "E0911", 409;
        /// At least one unlocked administrator must remain.
        LAST_ADMIN = "E0912", 409;
        /// Also `why_weak`: `short`, `long` or `simple`; `letters_min`, `bytes_max`.
        WEAK_PASSWORD = "E0913", 422;
        /// Also `name`.
        NO_SUCH_TOKEN = "E0914", 404;
        /// Also `most`.
        TOO_MANY = "E0915", 409;
        /// Also `path`, `reason`.
        ACCOUNTS_FILE = "E0916", 500;
        /// Also `path`.
        ACCOUNTS_HELD = "E0917", 409;
        /// Also `name`.
        NO_SUCH_SESSION = "E0918", 404;
        /// There is an account already.
        HAS_USER = "E0919", 409;
        /// Also `name`.
        BAD_NAME = "E0920", 422;
        /// Also `most`.
        BAD_POINTS = "E0921", 422;
        /// Also `points`: those that the caller is limited to.
        LIMITED = "E0922", 403;
        /// Also `reason`: the tables.
        OWNER_ONLY = "E0923", 403;
        /// Also `line`, `port`.
        PORT_NOT_ALLOWED = "E0924", 403;
        /// Also `name`: host and port.
        HOOK_TARGET = "E0925", 403;
        /// Also `path`, `reason`.
        OUTLET_TLS = "E0926", 500;
        /// Also `client`, `reason`.
        CLIENT_NO_CERT = "E0927", 403;
        /// Also `client`, `reason`.
        CLIENT_CERT = "E0928", 403;
        /// Also `client`, `reason`.
        CLIENT_NOT_TLS = "E0929", 403;
        /// Also `client`, `reason`.
        CLIENT_HANDSHAKE = "E0930", 403;
        /// Also `client`, `reason`.
        CLIENT_ROLE = "E0931", 403;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_exit_codes_and_never_used_twice() {
        let mut seen = std::collections::BTreeSet::new();
        for kind in codes::ALL {
            assert!(seen.insert(kind.code), "{}", kind.code);
            assert_ne!(kind.title(), "", "{}", kind.code);
            let exit: u8 = kind.code[1..3].parse().expect("two digits");
            assert!((1..=11).contains(&exit), "{}", kind.code);
        }
    }

    #[test]
    fn it_comes_back_as_it_went() {
        let problem = Problem::new(codes::NO_REPLY)
            .with("module", "pump")
            .with("attempts", 3)
            .with_hint("railbus scan");
        let text = serde_json::to_string(&problem).unwrap();
        assert!(text.contains(r#""module":"pump""#), "{text}");
        assert_eq!(serde_json::from_str::<Problem>(&text).unwrap(), problem);
        assert_eq!(problem.text("attempts"), "3");
    }
}
