//! One route of the API: permission, documentation and handler.

use super::access::{AccountsApi, Need, Reach};
use super::doc::Doc;
#[cfg(feature = "fleet")]
use super::hub::HubApi;
use super::site::Site;
use axum::body::Body;
use axum::extract::Query;
use axum::http::Response;
use axum::routing::MethodRouter;
use std::collections::BTreeMap;

/// The prefix of all routes of the API.
pub(super) const BASE: &str = "/api/v1";

pub(super) type Answer = Response<Body>;
pub(super) type Asked = Query<BTreeMap<String, String>>;

/// One method of one path of the API.
pub(super) struct Route {
    /// Its method, as HTTP writes it.
    pub(super) method: &'static str,
    /// Its path below [`BASE`], or below that of the centre's API.
    pub(super) path: &'static str,
    /// The permission it requires.
    pub(super) need: Need,
    /// What it means for callers that are limited to some points.
    pub(super) reach: Reach,
    /// Its answer contains a secret, and so is not compressed: the compressed size would reveal
    /// something of it.
    pub(super) is_secret: bool,
    /// Its answer goes on until the client leaves, or for minutes.
    pub(super) is_stream: bool,
    /// It switches outputs and is carried out once per `Idempotency-Key`, so that it can be given
    /// from afar.
    pub(super) is_command: bool,
    /// Its documentation in the OpenAPI document.
    pub(super) doc: Option<Doc>,
    /// The handler.
    pub(super) handler: RouteHandler,
}

/// The handler of a route, by what it needs.
#[derive(Clone, Copy)]
pub(super) enum RouteHandler {
    /// A site.
    Site(fn() -> MethodRouter<Site>),
    /// Only accounts, which other programs than a site have, too.
    Accounts(fn() -> MethodRouter<AccountsApi>),
    /// The centre of many sites.
    #[cfg(feature = "fleet")]
    Hub(fn() -> MethodRouter<HubApi>),
}

impl RouteHandler {
    /// The handler in the router of a site with these accounts.
    pub(super) fn of_site(self, accounts: &AccountsApi) -> MethodRouter<Site> {
        match self {
            RouteHandler::Site(handler) => handler(),
            RouteHandler::Accounts(handler) => handler().with_state(accounts.clone()),
            // No site has any.
            #[cfg(feature = "fleet")]
            RouteHandler::Hub(_) => MethodRouter::new(),
        }
    }
}

impl Route {
    pub(super) const fn new(
        method: &'static str,
        path: &'static str,
        need: Need,
        handler: fn() -> MethodRouter<Site>,
    ) -> Route {
        Route::with((method, path), need, RouteHandler::Site(handler))
    }

    /// One that needs only accounts.
    pub(super) const fn of_accounts(
        method: &'static str,
        path: &'static str,
        need: Need,
        handler: fn() -> MethodRouter<AccountsApi>,
    ) -> Route {
        Route::with((method, path), need, RouteHandler::Accounts(handler))
    }

    /// One of the centre of many sites.
    #[cfg(feature = "fleet")]
    pub(super) const fn of_hub(
        method: &'static str,
        path: &'static str,
        need: Need,
        handler: fn() -> MethodRouter<HubApi>,
    ) -> Route {
        Route::with((method, path), need, RouteHandler::Hub(handler))
    }

    const fn with(
        (method, path): (&'static str, &'static str),
        need: Need,
        handler: RouteHandler,
    ) -> Route {
        Route {
            method,
            path,
            need,
            reach: Reach::of(method, need),
            is_secret: false,
            is_stream: false,
            is_command: false,
            doc: None,
            handler,
        }
    }

    /// Its answer contains a secret.
    pub(super) const fn secret(self) -> Route {
        Route {
            is_secret: true,
            ..self
        }
    }

    /// Its answer goes on until the client leaves, or for minutes.
    pub(super) const fn stream(self) -> Route {
        Route {
            is_stream: true,
            ..self
        }
    }

    /// It switches outputs, and is carried out once per key.
    pub(super) const fn command(self) -> Route {
        Route {
            is_command: true,
            ..self
        }
    }

    /// Whether remote callers can use it: it is a command, or only reads, is no stream and has no
    /// secret.
    pub(super) fn is_remote(&self) -> bool {
        self.is_command || self.method == "GET" && !self.is_stream && !self.is_secret
    }

    /// Its handler checks the caller's points.
    pub(super) const fn within_points(self) -> Route {
        Route {
            reach: Reach::Points,
            ..self
        }
    }

    /// It affects no output and no configuration, though it is not a GET.
    pub(super) const fn reads(self) -> Route {
        Route {
            reach: Reach::Harmless,
            ..self
        }
    }

    /// Documents it. A route without documentation fails a test.
    pub(super) const fn doc(self, doc: Doc) -> Route {
        Route {
            doc: Some(doc),
            ..self
        }
    }
}
