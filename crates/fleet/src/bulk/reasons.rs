//! Why a site was not commanded.

use crate::message::FleetRefusal;

/// Why something is not done.
pub(super) fn refusal(code: &str, reason: &str) -> FleetRefusal {
    FleetRefusal {
        code: code.to_owned(),
        reason: reason.to_owned(),
    }
}

/// Its time was over.
pub(super) fn over() -> FleetRefusal {
    refusal("E0185", "it was not its turn within 5 minutes")
}

/// The process that carried it out has ended.
pub(super) fn gone() -> FleetRefusal {
    refusal(
        "E0185",
        "the process of the centre that sent them has ended",
    )
}

/// The connection was lost.
pub(super) fn unconnected() -> FleetRefusal {
    refusal("E0185", "the centre lost its connection")
}

/// A stop was requested.
pub(super) fn stopped() -> FleetRefusal {
    refusal("E0185", "it was stopped")
}

/// Its order may not have been recorded.
pub(super) fn uncertain() -> FleetRefusal {
    refusal("E0164", "it was not certain that it was recorded")
}
