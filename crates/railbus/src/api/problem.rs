//! Why something was not done, as data: the code says what to tell, the rest fills the gaps.
//! Over HTTP it is an `application/problem+json` [RFC 9457].

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Why something was not done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Problem {
    /// The stable code, as `E0301`. Its first two digits are the exit code.
    pub(crate) code: String,
    /// In one English sentence, for those who know no better.
    pub(crate) title: String,
    /// The HTTP status.
    pub(crate) status: u16,
    /// What it was about and what was met: `module`, `line`, `point`, `address`, `protocol`,
    /// `model`, `attempts`, `rx_bytes`, `reason`, ... Keys of the codes are listed at
    /// [`codes`].
    #[serde(flatten)]
    pub(crate) with: BTreeMap<String, serde_json::Value>,
    /// Commands that may help.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) hint: Vec<String>,
    /// The command may still have taken effect: look before repeating. Left out where it can't
    /// have.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) may_have_acted: bool,
}

impl Problem {
    /// A problem of this kind.
    pub(crate) fn new(kind: Kind) -> Problem {
        Problem {
            code: kind.code.to_owned(),
            title: kind.title.to_owned(),
            status: kind.status,
            with: BTreeMap::new(),
            hint: Vec::new(),
            may_have_acted: false,
        }
    }

    /// Adds what it was about.
    pub(crate) fn with(mut self, key: &str, value: impl Into<serde_json::Value>) -> Problem {
        self.with.insert(key.to_owned(), value.into());
        self
    }

    /// Says that the command may still have taken effect.
    pub(crate) const fn perhaps_acted(mut self, perhaps: bool) -> Problem {
        self.may_have_acted |= perhaps;
        self
    }

    /// Adds a command that may help.
    pub(crate) fn with_hint(mut self, command: impl Into<String>) -> Problem {
        self.hint.push(command.into());
        self
    }

    /// What it says under a key, as text; empty where it says nothing.
    pub(crate) fn text(&self, key: &str) -> String {
        match self.with.get(key) {
            Some(serde_json::Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
            None => String::new(),
        }
    }
}

/// A kind of problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kind {
    /// The stable code.
    pub(crate) code: &'static str,
    /// The HTTP status.
    pub(crate) status: u16,
    /// In one English sentence.
    pub(crate) title: &'static str,
}

/// Every kind there is, and the keys that come with it.
pub(crate) mod codes {
    use super::Kind;

    macro_rules! kinds {
        ($($(#[$doc:meta])* $name:ident = $code:literal, $status:literal, $title:literal;)*) => {
            $($(#[$doc])* pub(crate) const $name: Kind = Kind {
                code: $code, status: $status, title: $title,
            };)*
            /// All of them.
            #[cfg(test)]
            pub(crate) const ALL: &[Kind] = &[$($name),*];
        };
    }

    kinds! {
        /// Also `reason`.
        INTERNAL = "E0101", 500, "the system refuses something that always works";
        /// Also `module`, `line`.
        OVERLOADED = "E0105", 503, "too much is waiting already; nothing was sent";
        /// Also `module`, `line`.
        EXPIRED = "E0106", 503, "its time ran out while it waited; nothing was sent";
        /// Also `module`, `point`.
        LOCKED = "E0107", 423, "the point is locked by the configuration";
        /// Also `module`, `point`, `value`: what it is.
        NOT_AS_ASKED = "E0108", 409, "the output is not in the state asked for; nothing was sent";
        /// Also `reason`, `socket`.
        DAEMON = "E0109", 502, "the daemon's answer can't be understood";
        /// Also `path`, `reason`.
        TLS = "E0190", 500, "certificate or key can't be used";
        /// Also `path`.
        NO_SUCH_PAGE = "E0110", 404, "there is nothing at this address";
        /// Also `reason`.
        NOT_KEPT = "E0150", 503, "what must be remembered can't be written down; nothing was sent";
        /// Also `reason`.
        NOT_TAKEN_OVER = "E0152", 503, "it was done, but the pulse or lease before it ends still";
        /// Also `path`, `retry_after_ms`.
        OUTPUT_DUE = "E0153", 409, "an output must be switched off soon; not lent";
        /// Also `name`.
        NO_SUCH_COMMAND = "E0151", 404, "no command of that number is remembered";
        /// There is no history and no audit log here.
        NO_HISTORY = "E0170", 503, "nothing is kept here";
        /// Also `reason`.
        HISTORY_FAILS = "E0171", 503, "what is kept can't be read";
        /// Also `module`.
        NOT_AUDITED = "E0172", 503, "it can't be written into the audit log; nothing was sent";
        /// Also `name`.
        NO_SUCH_EVENT = "E0173", 404, "there is no such event";
        /// A shorter time may go.
        TOO_MUCH_ASKED = "E0174", 422, "that is too much for one answer";
        /// Told by the command line alone: a daemon checks what it writes itself.
        AUDIT_HELD = "E0175", 409, "another program writes the audit log";
        /// Also `line`, `op`: the one that runs.
        SCAN_RUNS = "E0210", 409, "a scan of this line runs already";
        /// Also `reason`.
        SIM_ORDER = "E0290", 422, "the simulator does not understand this";
        /// Also `module`, `line`, `address`, `protocol`, `model`, `attempts`, `rx_bytes`, `baud`,
        /// `format`.
        NO_REPLY = "E0301", 504, "the module did not answer";
        /// Also `module`, `line`, ...
        UNKNOWN = "E0302", 504, "the line was lost during the command; nobody knows how it ended";
        KEY_BEGUN = "E0303", 504, "begun under this key; nobody knows how it ended";
        /// Also `module`, `line`, ..., `refusal`.
        REFUSED = "E0401", 502, "the module answered no";
        /// Also `module`, `point`. To be repeated with `"confirm": true`.
        CONFIRM = "E0450", 409, "the output wants to be told that this is meant";
        /// Also `module`, `point`, `by`: the path of the other output.
        INTERLOCK = "E0451", 409, "an output that excludes this one is on, or may be";
        /// Also `module`, `point`, `retry_after_ms`.
        MIN_OFF = "E0452", 409, "the output must stay off for a while yet";
        /// Also `module`, `point`.
        UNWATCHED = "E0453", 409, "nobody would switch the output off when its time is over";
        /// Also `module`, `point`.
        NO_LEASE = "E0454", 409, "nobody holds the output";
        /// Also `module`.
        NOT_TRIED = "E0455", 409, "not done, because another part was not";
        /// Also `module`.
        UNDONE = "E0456", 409, "done and taken back, because another part failed";
        /// Also `scene`.
        PLAYING = "E0457", 409, "the scene is being played already";
        /// Also `line`, `risk`, `needs`: the words that `confirm` must hold, `may`: what it may do.
        SEND_CONFIRM = "E0458", 409, "the frame may change something: say that this is meant";
        /// Also `module`, `line`, ..., `attempts`, `rx_bytes`, `why`.
        GARBLED = "E0501", 502, "something came back that is no reply";
        /// Also `line`.
        SCAN_NOISE = "E0570", 503, "the line is never silent";
        /// Also `module`, `line`, ..., `point`, `value`: what was wanted.
        NOT_VERIFIED = "E0601", 409, "acknowledged, but read back otherwise";
        /// Also `module`.
        NOT_UNDONE = "E0650", 409, "done, and could not be taken back though another part failed";
        /// Also `line`, `port`, `reason`, `holder`, `group`.
        LINE_CLOSED = "E0710", 503, "the line is not open";
        /// Also `name`, `known`.
        NO_SUCH_MODULE = "E0801", 404, "there is no such module";
        /// Also `module`, `name`, `known`.
        NO_SUCH_POINT = "E0802", 404, "the module has no such point";
        /// Also `name`, `known`.
        NO_SUCH_LINE = "E0803", 404, "there is no such line";
        /// Also `module`, `point`, `model`, `width_ms` and `pulse_mode`: the module's own, where
        /// known.
        PULSE_WIDTH = "E0804", 422, "the module can't give a pulse of this length";
        /// Also `module`, `model`.
        UNSUPPORTED = "E0805", 422, "the model has no command for that";
        /// Also `reason`.
        BAD_REQUEST = "E0806", 422, "invalid value in the request";
        /// Also `module`, `point`.
        NOT_AN_OUTPUT = "E0807", 422, "the point is no output";
        /// Also `reason`.
        BAD_FRAME = "E0808", 422, "the bytes are no request of that protocol";
        /// No configuration, no flags. Also `looked`: the places.
        NO_CONFIG = "E0809", 422, "there is no configuration";
        /// Also `file`, `problems`: each with `line`, `column`, `path`, `code`, `reason`.
        BAD_CONFIG = "E0810", 422, "the configuration has problems";
        /// Also `file`, `reason`.
        CONFIG_FILE = "E0824", 422, "the configuration can't be read";
        /// Also `file`, `etag`: that of the text there is now.
        CONFIG_CHANGED = "E0827", 412, "the configuration was changed meanwhile";
        /// Also `name`.
        NOT_EDITABLE = "E0828", 422, "this part of the configuration can only be changed by hand";
        /// Also `kind`, `name`.
        ALREADY_THERE = "E0829", 409, "there is one of that name already";
        /// Also `file`, `reason`.
        CONFIG_NOT_WRITTEN = "E0830", 500, "the configuration can't be written; all is as it was";
        /// No such text is kept.
        NO_GENERATION = "E0831", 404, "no such generation of the configuration is kept";
        /// A whole text came without saying which one it replaces.
        NO_IF_MATCH = "E0832", 428, "say with If-Match which text is to be replaced";
        /// Also `name`.
        NO_SUCH_RULE = "E0853", 404, "there is no such rule";
        /// Also `name`.
        RULE_NOT_TRIED = "E0854", 409, "a rule is tried before it is armed";
        /// Also `reason`.
        HOOK_UNREACHED = "E0857", 502, "the receiver of the webhook can't be reached";
        /// Also `reason`.
        HOOK_TLS = "E0858", 502, "no trusted connection to the receiver of the webhook";
        /// Also `reason`.
        HOOK_SLOW = "E0859", 504, "the receiver of the webhook did not answer in time";
        /// Also `name`, `known`.
        NO_SUCH_GROUP = "E0860", 404, "there is no such group";
        /// Also `name`, `known`.
        NO_SUCH_SCENE = "E0861", 404, "there is no such scene";
        /// Also `name`.
        NOT_SIMULATED = "E0862", 404, "this line is not simulated here";
        /// Also `name`.
        NO_SIM_MODULE = "E0863", 404, "there is no such module on the simulated line";
        /// Also `name`.
        NO_SUCH_HOOK = "E0877", 404, "there is no such webhook";
        /// Also `reason`: the status that came back.
        HOOK_REFUSED = "E0878", 502, "the receiver of the webhook did not take the event";
        /// Also `path`, `reason`.
        HOOK_SECRET = "E0879", 500, "the secrets of webhooks can't be kept";
        /// Also `reason`.
        FORBIDDEN = "E0901", 403, "not from there";
        /// Told by the command line alone. Also `socket`, `served`, `config`: the two files.
        OTHER_SITE = "E0884", 409, "the daemon that answers serves another configuration";
        /// Also `module`, `etag`: that of the values there are now.
        SETTINGS_CHANGED = "E0881", 412, "the module keeps other settings than were seen";
        /// Settings came without saying which ones they change.
        NO_SETTINGS_MATCH = "E0882", 428, "say with If-Match which settings are to be changed";
        /// Also `line`, `op`: what is done there.
        LINE_AT_WORK = "E0883", 409, "something else is being done on this line";
        /// Nobody knows who asks.
        UNAUTHENTICATED = "E0902", 401, "log in first, or show a token";
        WRONG_LOGIN = "E0904", 401, "name or password is wrong, or the user is locked";
        /// Also `role`, `need`.
        ROLE = "E0905", 403, "the caller's role does not allow this";
        /// Also `module`, `point`.
        POINT_RIGHT = "E0906", 403, "this point is none of those that the caller may switch";
        /// Also `retry_after_ms`.
        TRIES = "E0907", 429, "too many tries; wait a while";
        CSRF = "E0908", 403, "the request lacks the X-CSRF-Token of its session";
        SETUP = "E0909", 403, "the setup link is not good, or not any more";
        /// Also `name`.
        NO_SUCH_USER = "E0910", 404, "there is no such user";
        /// Also `name`.
        NAME_TAKEN = "E0911", 409, "the name is taken";
        LAST_ADMIN = "E0912", 409, "one administrator must be left who is not locked";
        /// Also `why_weak`: `short`, `long` or `simple`; `letters_min`, `bytes_max`.
        WEAK_PASSWORD = "E0913", 422, "the password is too short, too long or too simple";
        /// Also `name`.
        NO_SUCH_TOKEN = "E0914", 404, "there is no such token";
        /// Also `most`.
        TOO_MANY = "E0915", 409, "there are as many as there may be";
        /// Also `path`, `reason`.
        ACCOUNTS_FILE = "E0916", 500, "the accounts can't be read or kept";
        /// Also `path`.
        ACCOUNTS_HELD = "E0917", 409, "another program holds the accounts";
        /// Also `name`.
        NO_SUCH_SESSION = "E0918", 404, "there is no such session";
        HAS_USER = "E0919", 409, "there is a user already, who may add others";
        /// Also `name`.
        BAD_NAME = "E0920", 422, "the name is none: 1 to 32 letters, digits, and . _ - @ within";
        /// Also `most`.
        BAD_POINTS = "E0921", 422, "points are up to 32 patterns such as pump, pump.* or *.do0";
        /// Also `points`: those that the caller is limited to.
        LIMITED = "E0922", 403, "the caller is limited to points, and this may reach others";
        /// Also `reason`: the tables.
        OWNER_ONLY = "E0923", 403, "only the owner of the daemon may change this";
        /// Also `line`, `port`.
        PORT_NOT_ALLOWED = "E0924", 403, "no configuration from the network may open this port";
        /// Also `name`: host and port.
        HOOK_TARGET = "E0925", 403, "a webhook may not lead to this address";
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
