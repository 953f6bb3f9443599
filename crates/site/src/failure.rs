//! Why a command was not done, or is not known to be.

use crate::Role;
use railbus_device::Point;
use railbus_host::Fault;
use railbus_wire::Micros;
use std::fmt;
use std::io::ErrorKind;

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
    /// The output wants to be told that it is really meant.
    Confirm(Point),
    /// The output must not be on while another one is, which is on or may be.
    Interlock {
        /// Which output.
        point: Point,
        /// The path of the other one.
        by: String,
    },
    /// The output must stay off for a while yet.
    MinOff {
        /// Which output.
        point: Point,
        /// How long.
        left: Micros,
    },
    /// The output may be on for so long only, and nobody would switch it off then: only what
    /// runs day and night does so.
    Unwatched(Point),
    /// Nobody holds the output.
    NoLease(Point),
    /// A lease can't be so long.
    LeaseTime(Point),
    /// What is to be done later can't be written down.
    NotKept(ErrorKind),
    /// It was done, but that it takes the output over from a pulse or a lease can't be written
    /// down: that one ends still.
    NotTakenOver(ErrorKind),
    /// The line is not lent: an output has been on for nearly as long as it may, and must be
    /// switched off then.
    Due {
        /// Its path.
        path: String,
        /// How long it is until then.
        left: Micros,
    },
    /// Not done, because another part of the same command was not.
    NotTried,
    /// Done, and taken back, because another part of the same command failed.
    Undone,
    /// Done, and could not be taken back, though another part of the same command failed.
    NotUndone,
    /// Whoever asks for it has this role, which is too low. Nothing was sent.
    RoleTooLow(Role),
    /// Whoever asks for it is limited to other outputs. Nothing was sent.
    NotPermitted {
        /// The output's module.
        module: String,
        /// Its label; empty where the module has no such output.
        label: String,
    },
    /// There is no such group.
    NoSuchGroup,
    /// There is no such scene.
    NoSuchScene,
    /// The scene is being played already.
    Playing,
    /// What the line said of a read that had to come first. The command was not sent.
    NotRead(Fault),
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
            Failure::RoleTooLow(_) => "role_too_low",
            Failure::NotPermitted { .. } => "not_permitted",
            Failure::NoSuchGroup => "no_such_group",
            Failure::NoSuchScene => "no_such_scene",
            Failure::Playing => "playing",
            Failure::NotRead(fault) | Failure::Line(fault) => fault.name(),
        }
    }

    /// Whether the command may still have taken effect. What was done and taken back is as it was
    /// before. There is no arm for the rest here: a new failure must be decided.
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
            | Failure::RoleTooLow(_)
            | Failure::NotPermitted { .. }
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
