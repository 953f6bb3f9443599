//! How a command ended, in the words that outlets tell it with.

use railbus_host::{Confirmation, Fault};
use railbus_site::CommandError;

/// How a command ended, from the best to the worst: what is not known outranks what is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum CommandEnd {
    /// Done, and read back from the module.
    Readback,
    /// Done, by the module's reply.
    Reply,
    /// Sent in a form that gets no reply.
    Sent,
    /// It did not act, or was read back otherwise.
    Failed,
    /// It may have acted.
    Unknown,
}

impl CommandEnd {
    pub(super) const fn name(self) -> &'static str {
        match self {
            CommandEnd::Readback => "readback",
            CommandEnd::Reply => "reply",
            CommandEnd::Sent => "sent",
            CommandEnd::Unknown => "unknown",
            CommandEnd::Failed => "failed",
        }
    }

    pub(super) const fn confirmed(confirmed: Confirmation) -> CommandEnd {
        match confirmed {
            Confirmation::Readback => CommandEnd::Readback,
            Confirmation::Reply => CommandEnd::Reply,
            Confirmation::Sent => CommandEnd::Sent,
        }
    }

    /// The end of a command that was not done. What was read back otherwise is known.
    pub(super) const fn of(failure: &CommandError) -> CommandEnd {
        match failure {
            CommandError::Line(Fault::NotVerified) => CommandEnd::Failed,
            _ if failure.may_have_acted() => CommandEnd::Unknown,
            _ => CommandEnd::Failed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_outranks_what_failed() {
        let ends = [
            CommandEnd::Readback,
            CommandEnd::Reply,
            CommandEnd::Sent,
            CommandEnd::Failed,
            CommandEnd::Unknown,
        ];
        assert!(ends.is_sorted());
        assert_eq!(
            Some(CommandEnd::Failed).max(Some(CommandEnd::Unknown)),
            Some(CommandEnd::Unknown)
        );
    }

    #[test]
    fn what_was_read_back_otherwise_is_known() {
        let of = |failure: CommandError| CommandEnd::of(&failure);
        assert_eq!(
            of(CommandError::Line(Fault::NotVerified)),
            CommandEnd::Failed
        );
        assert_eq!(of(CommandError::Line(Fault::Unknown)), CommandEnd::Unknown);
        assert_eq!(of(CommandError::Line(Fault::Expired)), CommandEnd::Failed);
        assert_eq!(of(CommandError::NotUndone), CommandEnd::Unknown);
        assert_eq!(of(CommandError::Playing), CommandEnd::Failed);
    }
}
