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
pub enum CommandError {
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

impl CommandError {
    /// The name in logs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            CommandError::NoSuchLine => "no_such_line",
            CommandError::NoSuchModule => "no_such_module",
            CommandError::NoSuchPoint => "no_such_point",
            CommandError::Lent => "lent",
            CommandError::NotAnOutput(_) => "not_an_output",
            CommandError::Locked(_) => Fault::Locked.name(),
            CommandError::NotAsAsked(..) => "not_as_asked",
            CommandError::PulseWidth { .. } => "pulse_width",
            CommandError::NotAudited => "not_audited",
            CommandError::Confirm(_) => "confirm",
            CommandError::Interlock { .. } => "interlock",
            CommandError::MinOff { .. } => "min_off",
            CommandError::Unwatched(_) => "unwatched",
            CommandError::NoLease(_) => "no_lease",
            CommandError::LeaseTime(_) => "lease_time",
            CommandError::NotKept(_) => "not_kept",
            CommandError::NotTakenOver(_) => "not_taken_over",
            CommandError::Due { .. } => "output_due",
            CommandError::NotTried => "not_tried",
            CommandError::Undone => "undone",
            CommandError::NotUndone => "not_undone",
            CommandError::RoleTooLow { .. } => "role_too_low",
            CommandError::NotPermitted { .. } => "not_permitted",
            CommandError::Limited(_) => "limited",
            CommandError::NoSuchGroup => "no_such_group",
            CommandError::NoSuchScene => "no_such_scene",
            CommandError::Playing => "playing",
            CommandError::NotRead(fault) | CommandError::Line(fault) => fault.name(),
        }
    }

    /// Whether the command may still have taken effect. What was executed and reverted is as it was
    /// before. There is no wildcard arm: a new failure must be decided.
    #[must_use]
    pub const fn may_have_acted(&self) -> bool {
        match self {
            CommandError::Line(fault) => fault.may_have_acted(),
            CommandError::NotUndone | CommandError::NotTakenOver(_) => true,
            CommandError::NoSuchLine
            | CommandError::NoSuchModule
            | CommandError::NoSuchPoint
            | CommandError::Lent
            | CommandError::NotAnOutput(_)
            | CommandError::Locked(_)
            | CommandError::NotAsAsked(..)
            | CommandError::PulseWidth { .. }
            | CommandError::NotAudited
            | CommandError::Confirm(_)
            | CommandError::Interlock { .. }
            | CommandError::MinOff { .. }
            | CommandError::Unwatched(_)
            | CommandError::NoLease(_)
            | CommandError::LeaseTime(_)
            | CommandError::NotKept(_)
            | CommandError::Due { .. }
            | CommandError::NotTried
            | CommandError::Undone
            | CommandError::RoleTooLow { .. }
            | CommandError::NotPermitted { .. }
            | CommandError::Limited(_)
            | CommandError::NoSuchGroup
            | CommandError::NoSuchScene
            | CommandError::Playing
            | CommandError::NotRead(_) => false,
        }
    }
}

impl From<Fault> for CommandError {
    fn from(fault: Fault) -> CommandError {
        CommandError::Line(fault)
    }
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::error::Error for CommandError {}
