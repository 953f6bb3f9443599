//! How a line is operated.

use railbus_wire::{Instant, Micros};

/// Whether the adapter echoes what is sent. The line keeps checking whatever is set here
/// (docs/decisions/0014).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EchoMode {
    /// Detected by the first read after opening: nothing is written before that.
    #[default]
    Auto,
    /// It echoes.
    On,
    /// It does not echo.
    Off,
}

/// What lies between the driver and the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Medium {
    /// A serial port: sending takes time, and no reply can come before the frame has left.
    #[default]
    Wire,
    /// A pseudo-terminal or a network: when the bytes reach the wire is unknown, so a reply may
    /// come at once.
    Buffered,
}

/// What is known of earlier users of the port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PortHistory {
    /// Nothing: replies to their recent requests may still arrive.
    #[default]
    Unknown,
    /// The line was idle recently: there is no need to wait for late replies, nor for the silence
    /// before a request.
    Rested,
    /// The previous user was killed while a reply might still come.
    Abandoned,
}

/// How a line is operated.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Whether the adapter echoes.
    pub echo: EchoMode,
    /// What lies between the driver and the wire.
    pub medium: Medium,
    /// How long to wait after opening before the first request: replies to someone's earlier
    /// requests may still come.
    pub settle: Micros,
    /// How long a line that has duplicated replies waits before it repeats a similar request.
    pub duplicate_window: Micros,
    /// A line is treated as possibly duplicating until this many requests after opening were
    /// answered once.
    pub probation: u8,
    /// Remember unanswered requests, so that their late replies are not taken for others. Off only
    /// to show that a simulation notices when they are not.
    pub ghosts: bool,
    /// After a miss, send a request whose reply shows that nothing older can come
    /// (docs/decisions/0015). Off only to test the rules for modules that have no such request.
    pub fences: bool,
    /// Ask modules that can identify themselves for their model when they come online
    /// (docs/decisions/0031). Off only to test everything else alone.
    pub identify: bool,
}

impl Default for Config {
    fn default() -> Config {
        Config {
            echo: EchoMode::Auto,
            medium: Medium::Wire,
            settle: Micros::from_millis(100),
            duplicate_window: Micros::from_millis(100),
            probation: 20,
            ghosts: true,
            fences: true,
            identify: true,
        }
    }
}

/// How often a module is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Whether it is polled at all.
    pub enabled: bool,
    /// The interval between two readings of a point, if the line has the time.
    pub interval: Micros,
    /// A reading about to become older than this goes before commands.
    pub max_age: Micros,
    /// Ask it for its model, if [`Config::identify`] is set. If not, whatever answers at its
    /// address is taken for the configured model (docs/decisions/0031).
    pub identify: bool,
}

impl Default for Plan {
    fn default() -> Plan {
        Plan {
            enabled: true,
            interval: Micros::from_millis(200),
            max_age: Micros::from_secs(2),
            identify: true,
        }
    }
}

impl Plan {
    /// Never polled: only commands reach the module.
    pub const NEVER: Plan = Plan {
        enabled: false,
        interval: Micros::from_secs(3600),
        max_age: Micros(u64::MAX),
        identify: true,
    };
}

/// The terms of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terms {
    /// Read the outputs back and compare, where the module can.
    pub verify: bool,
    /// When it is dropped if it was not sent; the default is five seconds from now.
    pub expires: Option<Instant>,
}

impl Default for Terms {
    fn default() -> Terms {
        Terms {
            verify: true,
            expires: None,
        }
    }
}
