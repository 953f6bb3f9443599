//! Integrations that publish the site to other systems: outlets. A kind of outlet is a folder
//! here, and a line of [`NORTHBOUND`].

mod kind;
pub(super) mod webhook;

use kind::OutletKind;

use super::route::Route;
use railbus_api::problem::Problem;
use railbus_site::Config;

/// Every kind of outlet.
static NORTHBOUND: &[&OutletKind] = &[&webhook::KIND];

/// The routes that kinds have of their own.
pub(super) fn routes() -> impl Iterator<Item = &'static Route> {
    NORTHBOUND.iter().flat_map(|kind| kind.routes)
}

/// The kind whose outlets stand in tables of this name: `webhook` of `[webhook.alerts]`.
pub(super) fn of_table(table: &str) -> Option<&'static OutletKind> {
    NORTHBOUND.iter().copied().find(|kind| kind.table == table)
}

/// Whether a table of the configuration, such as `webhook.alerts`, is one of an outlet.
pub(super) fn is_outlet(table: &str) -> bool {
    let kind = table.split_once('.').map(|(kind, _)| kind);
    kind.is_some_and(|kind| of_table(kind).is_some())
}

/// Whether outlets of a new configuration only lead where the owner of the daemon allows it, or
/// where they led before.
pub(super) fn may_lead(old: &Config, new: &Config) -> Result<(), Problem> {
    NORTHBOUND
        .iter()
        .try_for_each(|kind| (kind.may_lead)(old, new))
}
