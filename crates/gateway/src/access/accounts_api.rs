//! What handlers of sessions and accounts need: of a site, or of another program that has accounts.

use super::Gate;
use railbus_site::Service;
use railbus_words::Lang;
use std::sync::Arc;

/// What handlers of sessions and accounts need.
#[derive(Clone, Debug)]
pub(crate) struct AccountsApi {
    /// Accounts and permissions.
    pub(crate) access: Arc<Gate>,
    /// Where logins and changes are recorded; none in a program that has no events.
    pub(crate) events: Option<Service>,
    /// The default language.
    pub(crate) lang: Lang,
    /// It is the demo: nothing is real.
    pub(crate) demo: bool,
    /// Some of its lines are simulated here.
    pub(crate) simulated: bool,
    /// The name of what the accounts are for.
    pub(crate) name: Arc<str>,
    /// The URL of its pages: `http://127.0.0.1:7485`.
    pub(crate) origin: Arc<str>,
    /// Browsers use TLS.
    pub(crate) is_tls: bool,
}
