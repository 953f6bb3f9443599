//! What handlers of sessions and accounts need: of a site, or of another program that has accounts.

use super::{Caller, Gate, Role};
use axum::extract::rejection::RawPathParamsRejection;
use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::request::Parts;
use railbus_site::Service;
use railbus_words::Lang;
use std::convert::Infallible;
use std::sync::Arc;

/// What accounts are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AccountsPlace {
    /// The site that has them.
    Site,
    /// The centre of many sites that has them.
    #[cfg(feature = "fleet")]
    Centre,
    /// A far site: they are those of its centre.
    FarSite,
}

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
    /// What that is.
    pub(crate) place: AccountsPlace,
    /// The URL of its pages: `http://127.0.0.1:7485`.
    pub(crate) origin: Arc<str>,
    /// Browsers use TLS.
    pub(crate) is_tls: bool,
}

impl AccountsPlace {
    /// Whether it is the centre of many sites.
    pub(super) const fn is_centre(self) -> bool {
        match self {
            #[cfg(feature = "fleet")]
            AccountsPlace::Centre => true,
            AccountsPlace::Site | AccountsPlace::FarSite => false,
        }
    }
}

impl AccountsApi {
    /// What a caller's role permits at what this is for.
    ///
    /// A far site is only read and switched. An account that is limited to some points does not
    /// switch there: its patterns have no names of sites.
    pub(super) fn role(&self, who: &Caller) -> Option<Role> {
        let most = match (self.place == AccountsPlace::FarSite, who.is_limited()) {
            (false, _) => Role::Admin,
            (true, false) => Role::Operator,
            (true, true) => Role::Viewer,
        };
        who.role.map(|role| role.min(most))
    }
}

/// The accounts as a request asks for them: at the centre of many sites, `/s/plant7/…` asks for
/// what they are at the site of that name.
impl FromRequestParts<AccountsApi> for AccountsApi {
    type Rejection = Infallible;

    async fn from_request_parts(
        parts: &mut Parts,
        api: &AccountsApi,
    ) -> Result<AccountsApi, Infallible> {
        let named = RawPathParams::from_request_parts(parts, api).await;
        let site = match &named {
            Ok(named) => named.iter().find(|(key, _)| *key == "site"),
            // A name that can't be read is none of a site, and does not stand for the centre.
            Err(RawPathParamsRejection::InvalidUtf8InPathParam(_)) => Some(("site", "")),
            Err(_) => None,
        };
        Ok(match site {
            Some((_, site)) => AccountsApi {
                name: site.into(),
                place: AccountsPlace::FarSite,
                ..api.clone()
            },
            None => api.clone(),
        })
    }
}
