//! Webhooks in the table of outlets. Their sections, `[webhook.NAME]`, are read by
//! `railbus_site::config`.

use super::routes::ROUTES;
use super::target;
use crate::northbound::OutletKind;
use railbus_api::problem::codes;

/// Webhooks: events of the site, sent over HTTP.
pub(in crate::northbound) static KIND: OutletKind = OutletKind {
    table: "webhook",
    missing: codes::NO_SUCH_HOOK,
    may_lead: target::may_lead,
    routes: ROUTES,
};
