//! How good a value is, and how a command ended, in the status codes of OPC UA.

use opcua::types::StatusCode;
use railbus_host::{Confirmation, Fault};
use railbus_site::{BadReason, CommandError, PointQuality};

/// How good a value is.
pub(crate) const fn of_quality(quality: PointQuality) -> StatusCode {
    match quality {
        PointQuality::Good => StatusCode::Good,
        PointQuality::Stale => StatusCode::UncertainLastUsableValue,
        PointQuality::Bad(reason) => match reason {
            BadReason::NeverRead => StatusCode::BadWaitingForInitialData,
            BadReason::Offline | BadReason::LineAbsent => StatusCode::BadNoCommunication,
            BadReason::OtherModel => StatusCode::BadConfigurationError,
            BadReason::LineBusy | BadReason::Exclusive | BadReason::LineClosed => {
                StatusCode::BadOutOfService
            }
        },
    }
}

/// How a command ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct OrderEnd {
    /// The status code that a client gets.
    pub(crate) status: StatusCode,
    /// The same in the words of all interfaces: `readback`, `reply`, `sent`, `unknown`, `failed`.
    pub(crate) end: &'static str,
    /// Why it was not done, as `E0106`; empty if it was.
    pub(crate) code: String,
    /// The number of its audit entry, where it has one.
    pub(crate) audit: String,
}

impl OrderEnd {
    /// It was done.
    pub(crate) fn done(confirmed: Confirmation, audit: &str) -> OrderEnd {
        let (status, end) = match confirmed {
            Confirmation::Readback => (StatusCode::Good, "readback"),
            Confirmation::Reply => (StatusCode::Good, "reply"),
            // The module does not answer it.
            Confirmation::Sent => (StatusCode::GoodCompletesAsynchronously, "sent"),
        };
        OrderEnd {
            status,
            end,
            code: String::new(),
            audit: audit.to_owned(),
        }
    }

    /// It was not done, or not surely. `tells`: an output that was read back otherwise says that it
    /// did not act. Of several, others may have been switched, and a pulse may be over by then.
    pub(crate) fn not_done(failure: &CommandError, code: &str, tells: bool) -> OrderEnd {
        let is_known = tells && matches!(failure, CommandError::Line(Fault::NotVerified));
        let (status, end) = match failure.may_have_acted() && !is_known {
            true => (StatusCode::Uncertain, "unknown"),
            false => (of_failure(failure), "failed"),
        };
        OrderEnd {
            status,
            end,
            code: code.to_owned(),
            audit: String::new(),
        }
    }

    /// It was refused before it became a command.
    pub(crate) fn refused(status: StatusCode) -> OrderEnd {
        OrderEnd {
            status,
            end: "failed",
            code: String::new(),
            audit: String::new(),
        }
    }
}

/// The status of a command that did not act.
const fn of_failure(failure: &CommandError) -> StatusCode {
    match failure {
        CommandError::NoSuchLine
        | CommandError::NoSuchModule
        | CommandError::NoSuchPoint
        | CommandError::NoSuchGroup
        | CommandError::NoSuchScene => StatusCode::BadNodeIdUnknown,
        CommandError::NotAnOutput(_) | CommandError::Locked(_) => StatusCode::BadNotWritable,
        CommandError::RoleTooLow { .. }
        | CommandError::NotPermitted { .. }
        | CommandError::Limited(_) => StatusCode::BadUserAccessDenied,
        CommandError::Lent => StatusCode::BadOutOfService,
        CommandError::NotAudited | CommandError::NotKept(_) | CommandError::NotTakenOver(_) => {
            StatusCode::BadResourceUnavailable
        }
        CommandError::NotAsAsked(..)
        | CommandError::PulseWidth { .. }
        | CommandError::Confirm(_)
        | CommandError::Interlock { .. }
        | CommandError::MinOff { .. }
        | CommandError::Unwatched(_)
        | CommandError::NoLease(_)
        | CommandError::LeaseTime(_)
        | CommandError::Due { .. }
        | CommandError::NotTried
        | CommandError::Undone
        | CommandError::NotUndone
        | CommandError::Playing => StatusCode::BadInvalidState,
        CommandError::NotRead(fault) | CommandError::Line(fault) => of_fault(fault),
    }
}

const fn of_fault(fault: &Fault) -> StatusCode {
    match fault {
        Fault::Unsupported => StatusCode::BadNotSupported,
        Fault::Overloaded => StatusCode::BadResourceUnavailable,
        Fault::Expired => StatusCode::BadTimeout,
        Fault::Locked => StatusCode::BadNotWritable,
        Fault::Closed => StatusCode::BadOutOfService,
        Fault::Refused(_) | Fault::NotVerified => StatusCode::BadDeviceFailure,
        Fault::OtherModel { .. } => StatusCode::BadConfigurationError,
        Fault::NoReply(_) | Fault::Garbled(_) | Fault::Unknown => StatusCode::BadNoCommunication,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::{Point, PointKind};
    use railbus_host::Evidence;

    #[test]
    fn no_value_that_is_not_known_is_good() {
        let bad = [
            BadReason::NeverRead,
            BadReason::Offline,
            BadReason::OtherModel,
            BadReason::LineAbsent,
            BadReason::LineBusy,
            BadReason::Exclusive,
            BadReason::LineClosed,
        ];
        assert!(of_quality(PointQuality::Good).is_good());
        assert!(of_quality(PointQuality::Stale).is_uncertain());
        for reason in bad {
            assert!(of_quality(PointQuality::Bad(reason)).is_bad(), "{reason:?}");
        }
    }

    #[test]
    fn what_may_have_acted_is_never_said_to_have_failed() {
        let point = Point {
            kind: PointKind::Output,
            index: 0,
        };
        let lost = || Fault::NoReply(Evidence::default());
        let (unsure, failed) = ("unknown", "failed");
        for (failure, tells, status, end) in [
            (
                CommandError::Line(lost()),
                true,
                StatusCode::Uncertain,
                unsure,
            ),
            (
                CommandError::NotRead(lost()),
                true,
                StatusCode::BadNoCommunication,
                failed,
            ),
            (
                CommandError::Line(Fault::NotVerified),
                true,
                StatusCode::BadDeviceFailure,
                failed,
            ),
            (
                CommandError::Line(Fault::NotVerified),
                false,
                StatusCode::Uncertain,
                unsure,
            ),
            (
                CommandError::Line(Fault::Expired),
                true,
                StatusCode::BadTimeout,
                failed,
            ),
            (
                CommandError::Line(Fault::OtherModel { sent: true }),
                true,
                StatusCode::Uncertain,
                unsure,
            ),
            (
                CommandError::Locked(point),
                true,
                StatusCode::BadNotWritable,
                failed,
            ),
            (CommandError::NotUndone, true, StatusCode::Uncertain, unsure),
            (
                CommandError::Confirm(point),
                true,
                StatusCode::BadInvalidState,
                failed,
            ),
        ] {
            let told = OrderEnd::not_done(&failure, "E0000", tells);
            assert_eq!((told.status, told.end), (status, end), "{failure}");
            assert!(!told.status.is_good(), "{failure}");
        }
        let sent = OrderEnd::done(Confirmation::Sent, "7");
        assert_eq!(sent.status, StatusCode::GoodCompletesAsynchronously);
    }
}
