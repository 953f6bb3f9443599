//! What a kind of outlet is: its table of the configuration, its routes, and its functions.

use crate::route::Route;
use railbus_api::problem::{Kind as ProblemKind, Problem};
use railbus_site::Config;

/// A kind of outlet.
pub(crate) struct OutletKind {
    /// The table of the configuration in which its outlets stand by name.
    pub(crate) table: &'static str,
    /// The problem where there is no outlet of a name.
    pub(crate) missing: ProblemKind,
    /// Refuses destinations that only the owner of the daemon may add.
    pub(crate) may_lead: fn(old: &Config, new: &Config) -> Result<(), Problem>,
    /// Routes of its own, besides those of all outlets.
    pub(crate) routes: &'static [Route],
}
