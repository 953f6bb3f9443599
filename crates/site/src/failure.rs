//! Why a command was not done, or is not known to be.

use railbus_device::Point;
use railbus_host::Fault;
use railbus_wire::Micros;
use std::fmt;

/// Why a command was not done, or is not known to be. Data without sentences: whoever shows it
/// finds the words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// There is no such line.
    NoSuchLine,
    /// There is no such module.
    NoSuchModule,
    /// The module has no such point.
    NoSuchPoint,
    /// Somebody else has the line for a while.
    Lent,
    /// The point is no output.
    NotAnOutput(Point),
    /// The configuration locks the point.
    Locked(Point),
    /// The output is in this state, and the command was for the other one only. Nothing was
    /// sent.
    NotAsAsked(Point, bool),
    /// The module gives no pulse of that length.
    PulseWidth {
        /// Which output.
        point: Point,
        /// The width asked for.
        asked: Option<Micros>,
        /// The module's own width, where it times pulses and says so.
        own: Option<Micros>,
        /// The output is in pulse mode.
        pulse_mode: bool,
    },
    /// It can't be written down, and the configuration wants that first. Nothing was sent.
    NotAudited,
    /// What the line said.
    Line(Fault),
}

impl Failure {
    /// The name in logs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Failure::NoSuchLine => "no_such_line",
            Failure::NoSuchModule => "no_such_module",
            Failure::NoSuchPoint => "no_such_point",
            Failure::Lent => "lent",
            Failure::NotAnOutput(_) => "not_an_output",
            Failure::Locked(_) => Fault::Locked.name(),
            Failure::NotAsAsked(..) => "not_as_asked",
            Failure::PulseWidth { .. } => "pulse_width",
            Failure::NotAudited => "not_audited",
            Failure::Line(fault) => fault.name(),
        }
    }

    /// Whether the module may have acted all the same.
    #[must_use]
    pub const fn may_have_acted(&self) -> bool {
        match self {
            Failure::Line(fault) => fault.may_have_acted(),
            _ => false,
        }
    }
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Failure {
        Failure::Line(fault)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::error::Error for Failure {}
