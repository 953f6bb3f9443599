//! How a line is to be treated.

use railbus_wire::{Instant, Micros};

/// Whether the adapter gives back what is sent. Whatever is said, the line goes on looking
/// (docs/decisions/0014).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EchoMode {
    /// Found out by the first read after the opening: until then nothing is written.
    #[default]
    Auto,
    /// It does.
    On,
    /// It does not.
    Off,
}

/// What lies between the driver and the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Medium {
    /// A serial port: what is sent takes its time, and no reply can come before it has left.
    #[default]
    Wire,
    /// A pseudo-terminal or a network: nobody knows when the bytes are on the wire, so a reply
    /// may come at once.
    Buffered,
}

/// What is known of those who had the port before it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Past {
    /// Nothing: what somebody asked lately may still be answered.
    #[default]
    Unknown,
    /// Nobody has sent anything lately: there is nothing to wait for, neither late replies nor the
    /// silence before a request.
    Rested,
    /// Whoever had it last was killed while a reply might still come.
    Abandoned,
}

/// How a line is to be treated.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Whether the adapter echoes.
    pub echo: EchoMode,
    /// What lies between the driver and the wire.
    pub medium: Medium,
    /// After the opening nothing is asked for so long: replies to someone's earlier requests
    /// may still come.
    pub settle: Micros,
    /// How long a line that has shown duplicated replies waits before it asks the like again.
    pub duplicate_window: Micros,
    /// After the opening a line counts as one that may duplicate until so many requests were
    /// answered once.
    pub probation: u8,
    /// Unanswered requests are remembered, so that their late replies are not taken for
    /// others. Off only to show that a simulation notices when they are not.
    pub ghosts: bool,
    /// After a miss something is asked whose reply shows that nothing older can come
    /// (docs/decisions/0015). Off only where the rules are to be seen by which a module is treated
    /// that answers nothing of the kind.
    pub fences: bool,
    /// A module that can say what it is is asked for that when it is heard anew
    /// (docs/decisions/0031). Off only where nothing but the rest is to be seen.
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

/// How often a module is to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Whether it is polled at all.
    pub enabled: bool,
    /// From one reading of a point to the next, where the line has the time.
    pub interval: Micros,
    /// A reading that becomes older than this goes before commands.
    pub max_age: Micros,
    /// Whether it is asked for its model, where [`Config::identify`] holds. If not, whatever
    /// answers at its address is taken for the model that it should be (docs/decisions/0031).
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

/// On what terms a command is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terms {
    /// Read the outputs back and compare, where the module can.
    pub verify: bool,
    /// Not sent any more from then on; none is five seconds from now.
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
