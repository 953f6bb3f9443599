//! Why a command was not executed, or may not have been.

use crate::Role;
use railbus_device::Point;
use railbus_host::Fault;
use railbus_wire::Micros;
use std::fmt;
use std::io::ErrorKind;
use std::sync::Arc;

/// Why a command was not executed, or may not have been. Data without sentences: the text is made
/// where it is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// There is no such line.
    NoSuchLine,
    /// There is no such module.
    NoSuchModule,
    /// The module has no such point.
    NoSuchPoint,
    /// Another client has exclusive access to the line.
    Lent,
    /// The point is no output.
    NotAnOutput(Point),
    /// The configuration locks the point.
    Locked(Point),
    /// The output is in this state, and the command was conditional on the other. Nothing was sent.
    NotAsAsked(Point, bool),
    /// The module can't give a pulse of that width.
    PulseWidth {
        /// Which output.
        point: Point,
        /// The requested width.
        asked: Option<Micros>,
        /// The module's own width, if it times pulses and reports it.
        own: Option<Micros>,
        /// The output is in pulse mode.
        pulse_mode: bool,
    },
    /// The audit entry can't be written, and the configuration requires it. Nothing was sent.
    NotAudited,
    /// Switching the output must be confirmed.
    Confirm(Point),
    /// The output is interlocked with another, which is on or may be.
    Interlock {
        /// Which output.
        point: Point,
        /// The path of the other one.
        by: String,
    },
    /// The output must still stay off for some time.
    MinOff {
        /// Which output.
        point: Point,
        /// How long.
        left: Micros,
    },
    /// The output has a maximum on time, and this program would not be there to switch it off: only
    /// a daemon is.
    Unwatched(Point),
    /// The output has no lease.
    NoLease(Point),
    /// The time of a lease is out of range.
    LeaseTime(Point),
    /// A scheduled action can't be stored.
    NotKept(ErrorKind),
    /// The command was executed, but the takeover from a pulse or a lease can't be stored: that one
    /// still ends.
    NotTakenOver(ErrorKind),
    /// No exclusive access to the line: an output is near its maximum on time, and must be switched
    /// off then.
    Due {
        /// Its path.
        path: String,
        /// How long it is until then.
        left: Micros,
    },
    /// Not executed, because another part of the same command was not.
    NotTried,
    /// Executed and reverted, because another part of the same command failed.
    Undone,
    /// Executed, and could not be reverted, though another part of the same command failed.
    NotUndone,
    /// The caller's role is too low. Nothing was sent.
    RoleTooLow {
        /// The caller's role.
        role: Role,
        /// The least role that may do it.
        need: Role,
    },
    /// The caller is limited to other outputs. Nothing was sent.
    NotPermitted {
        /// The output's module; empty where it is none of the site.
        module: String,
        /// Its label; empty where the module has no such output.
        label: String,
    },
    /// The caller is limited to these points, and what was asked for may affect others. Nothing was
    /// sent or changed.
    Limited(Arc<[String]>),
    /// There is no such group.
    NoSuchGroup,
    /// There is no such scene.
    NoSuchScene,
    /// The scene is being played already.
    Playing,
    /// The line's fault at a read that had to come first. The command was not sent.
    NotRead(Fault),
    /// The line's fault.
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
            Failure::Confirm(_) => "confirm",
            Failure::Interlock { .. } => "interlock",
            Failure::MinOff { .. } => "min_off",
            Failure::Unwatched(_) => "unwatched",
            Failure::NoLease(_) => "no_lease",
            Failure::LeaseTime(_) => "lease_time",
            Failure::NotKept(_) => "not_kept",
            Failure::NotTakenOver(_) => "not_taken_over",
            Failure::Due { .. } => "output_due",
            Failure::NotTried => "not_tried",
            Failure::Undone => "undone",
            Failure::NotUndone => "not_undone",
            Failure::RoleTooLow { .. } => "role_too_low",
            Failure::NotPermitted { .. } => "not_permitted",
            Failure::Limited(_) => "limited",
            Failure::NoSuchGroup => "no_such_group",
            Failure::NoSuchScene => "no_such_scene",
            Failure::Playing => "playing",
            Failure::NotRead(fault) | Failure::Line(fault) => fault.name(),
        }
    }

    /// Whether the command may still have taken effect. What was executed and reverted is as it was
    /// before. There is no wildcard arm: a new failure must be decided.
    #[must_use]
    pub const fn may_have_acted(&self) -> bool {
        match self {
            Failure::Line(fault) => fault.may_have_acted(),
            Failure::NotUndone | Failure::NotTakenOver(_) => true,
            Failure::NoSuchLine
            | Failure::NoSuchModule
            | Failure::NoSuchPoint
            | Failure::Lent
            | Failure::NotAnOutput(_)
            | Failure::Locked(_)
            | Failure::NotAsAsked(..)
            | Failure::PulseWidth { .. }
            | Failure::NotAudited
            | Failure::Confirm(_)
            | Failure::Interlock { .. }
            | Failure::MinOff { .. }
            | Failure::Unwatched(_)
            | Failure::NoLease(_)
            | Failure::LeaseTime(_)
            | Failure::NotKept(_)
            | Failure::Due { .. }
            | Failure::NotTried
            | Failure::Undone
            | Failure::RoleTooLow { .. }
            | Failure::NotPermitted { .. }
            | Failure::Limited(_)
            | Failure::NoSuchGroup
            | Failure::NoSuchScene
            | Failure::Playing
            | Failure::NotRead(_) => false,
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
