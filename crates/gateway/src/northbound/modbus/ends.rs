//! How a command ended and how good a value is, in the codes of Modbus.

use railbus_host::{Confirmation, Fault};
use railbus_site::{BadReason, CommandError, PointQuality};
use railbus_wire::rtu::Exception;

/// How a command ended, as it stands in the register of the last command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u16)]
pub(crate) enum LastEnd {
    /// There was no command.
    #[default]
    None = 0,
    /// Done, and read back from the module.
    Readback = 1,
    /// Done, by the module's reply.
    Reply = 2,
    /// Sent in a form that gets no reply.
    Sent = 3,
    /// It may have acted.
    Unknown = 4,
    /// It did not act.
    Failed = 5,
    /// It is under way.
    UnderWay = 6,
}

impl From<Confirmation> for LastEnd {
    fn from(confirmed: Confirmation) -> LastEnd {
        match confirmed {
            Confirmation::Readback => LastEnd::Readback,
            Confirmation::Reply => LastEnd::Reply,
            Confirmation::Sent => LastEnd::Sent,
        }
    }
}

/// The exception for a value that can't be said; none where it is good.
pub(crate) const fn of_quality(quality: PointQuality) -> Option<Exception> {
    Some(match quality {
        PointQuality::Good => return None,
        PointQuality::Stale => Exception::TARGET,
        PointQuality::Bad(reason) => match reason {
            BadReason::NeverRead | BadReason::Offline | BadReason::OtherModel => Exception::TARGET,
            BadReason::LineAbsent
            | BadReason::LineBusy
            | BadReason::Exclusive
            | BadReason::LineClosed => Exception::PATH,
        },
    })
}

/// A quality as the number in its register; the higher one is the worse.
pub(crate) const fn number_of(quality: PointQuality) -> u16 {
    match quality {
        PointQuality::Good => 0,
        PointQuality::Stale => 1,
        PointQuality::Bad(reason) => match reason {
            BadReason::NeverRead => 2,
            BadReason::Offline => 3,
            BadReason::LineAbsent => 4,
            BadReason::LineBusy => 5,
            BadReason::Exclusive => 6,
            BadReason::LineClosed => 7,
            BadReason::OtherModel => 8,
        },
    }
}

/// The exception for a command that was not done. One that may have acted is always
/// [`Exception::TARGET`], also if an output was read back otherwise: of several, others may have
/// been switched.
pub(crate) fn of_failure(failure: &CommandError) -> (Exception, LastEnd) {
    let exception = match failure {
        CommandError::NoSuchLine
        | CommandError::NoSuchModule
        | CommandError::NoSuchPoint
        | CommandError::NoSuchGroup
        | CommandError::NoSuchScene
        | CommandError::NotAnOutput(_)
        | CommandError::Locked(_)
        | CommandError::RoleTooLow { .. }
        | CommandError::NotPermitted { .. }
        | CommandError::Limited(_) => Exception::ADDRESS,
        CommandError::Lent => Exception::PATH,
        CommandError::NotTakenOver(_) | CommandError::NotUndone => Exception::TARGET,
        CommandError::NotAsAsked(..)
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
        | CommandError::Playing => Exception::FAILURE,
        CommandError::NotRead(fault) | CommandError::Line(fault) => of_fault(fault),
    };
    match failure.may_have_acted() {
        true => (Exception::TARGET, LastEnd::Unknown),
        false => (exception, LastEnd::Failed),
    }
}

const fn of_fault(fault: &Fault) -> Exception {
    match fault {
        Fault::Unsupported => Exception::FUNCTION,
        Fault::Overloaded | Fault::Expired => Exception::BUSY,
        Fault::Locked => Exception::ADDRESS,
        Fault::Closed => Exception::PATH,
        Fault::Refused(_) => Exception::FAILURE,
        Fault::NotVerified
        | Fault::NoReply(_)
        | Fault::Garbled(_)
        | Fault::Unknown
        | Fault::OtherModel { .. } => Exception::TARGET,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::{Point, PointKind};

    #[test]
    fn what_may_have_acted_is_never_said_to_have_failed() {
        let point = Point {
            kind: PointKind::Output,
            index: 0,
        };
        let evidence = railbus_host::Evidence::default();
        for (failure, exception, end) in [
            (
                CommandError::Line(Fault::NoReply(evidence)),
                Exception::TARGET,
                LastEnd::Unknown,
            ),
            (
                CommandError::NotRead(Fault::NoReply(evidence)),
                Exception::TARGET,
                LastEnd::Failed,
            ),
            (
                CommandError::Line(Fault::NotVerified),
                Exception::TARGET,
                LastEnd::Unknown,
            ),
            (
                CommandError::Line(Fault::Expired),
                Exception::BUSY,
                LastEnd::Failed,
            ),
            (
                CommandError::Line(Fault::OtherModel { sent: true }),
                Exception::TARGET,
                LastEnd::Unknown,
            ),
            (
                CommandError::Line(Fault::OtherModel { sent: false }),
                Exception::TARGET,
                LastEnd::Failed,
            ),
            (
                CommandError::Locked(point),
                Exception::ADDRESS,
                LastEnd::Failed,
            ),
            (
                CommandError::Confirm(point),
                Exception::FAILURE,
                LastEnd::Failed,
            ),
            (
                CommandError::NotTakenOver(std::io::ErrorKind::StorageFull),
                Exception::TARGET,
                LastEnd::Unknown,
            ),
            (CommandError::Lent, Exception::PATH, LastEnd::Failed),
        ] {
            assert_eq!(of_failure(&failure), (exception, end), "{failure}");
        }
    }
}
