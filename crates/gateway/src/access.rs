//! Authentication and permissions.

pub(crate) mod accounts;
mod accounts_api;
pub mod desk;
mod gate;
mod notes;
pub(crate) mod password;
pub mod secret;
mod session_routes;
mod sessions;
pub(crate) mod setup;
#[cfg(feature = "opcua")]
mod sign_in;
pub(crate) mod store;
mod tries;
mod user_routes;

pub(crate) use accounts::is_selector;
pub(crate) use accounts_api::{AccountsApi, AccountsPlace};
pub use gate::Gate;
pub(super) use gate::{Peer, identify};
#[cfg(feature = "opcua")]
pub(crate) use notes::note_login;
pub(super) use session_routes::{ROUTES as SESSION_ROUTES, read};
pub(super) use user_routes::ROUTES as USER_ROUTES;

use super::answer;
use axum::extract::{Request, State};
use axum::http::Method;
use axum::http::header::{HeaderValue, WWW_AUTHENTICATE};
use axum::middleware::Next;
use axum::response::Response;
use railbus_api::problem::{Problem, codes};
pub(crate) use railbus_site::Role;
use railbus_site::{Rights, paths};
use railbus_store::audit::Origin;
use secret::Fingerprint;
use std::borrow::Cow;
use std::sync::Arc;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// How [`Role`] is described in the OpenAPI document.
struct RoleSchema;

impl PartialSchema for RoleSchema {
    fn schema() -> RefOr<Schema> {
        let role = ObjectBuilder::new().schema_type(Type::String);
        let role = role.enum_values(Some(Role::NAMES));
        let description = "What somebody may do; each may do what those before it may.";
        role.description(Some(description)).into()
    }
}

impl ToSchema for RoleSchema {
    fn name() -> Cow<'static, str> {
        "Role".into()
    }
}

/// The permission that a route requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Need {
    /// None: it is public.
    Nothing,
    /// At least this role.
    Role(Role),
    /// The user who runs the daemon: over the socket only.
    Owner,
}

impl Need {
    pub(super) const VIEWER: Need = Need::Role(Role::Viewer);
    pub(super) const OPERATOR: Need = Need::Role(Role::Operator);
    pub(super) const ENGINEER: Need = Need::Role(Role::Engineer);
    pub(super) const ADMIN: Need = Need::Role(Role::Admin);
}

/// What a route means for callers that are limited to some points. The default for one that changes
/// anything is closed: a forgotten route denies all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reach {
    /// The same as for all others: it only reads, or concerns the caller alone.
    Harmless,
    /// Its handler checks each output, or each point, against the caller's rights.
    Points,
    /// Forbidden: it may affect other outputs, in whatever way.
    Beyond,
}

impl Reach {
    /// The default for a route.
    pub(super) const fn of(method: &str, need: Need) -> Reach {
        let reads = matches!(method.as_bytes(), b"GET");
        let is_own = matches!(need, Need::Nothing | Need::Role(Role::Viewer));
        match reads || is_own {
            true => Reach::Harmless,
            false => Reach::Beyond,
        }
    }
}

/// How a caller was authenticated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// Not at all.
    Not,
    /// By the socket, which only the owner can open.
    Owner,
    /// By a session's cookie.
    Session {
        key: Fingerprint,
        /// The request carries the CSRF token, which only our own pages know.
        is_ours: bool,
    },
    /// By a token of this id.
    Token(String),
    /// By the outlet through which a remote caller asks.
    Outlet,
}

/// The caller of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Caller {
    /// The name for logs.
    pub(super) name: String,
    /// Distinguishes accounts of the same name: a name that is reused is another account.
    pub(super) id: String,
    /// None if not authenticated.
    pub(super) role: Option<Role>,
    /// Where the request came from: `socket`; `http` for this machine, and with an address for
    /// another.
    pub(super) via: String,
    /// The points whose outputs may be switched, as patterns; empty for all.
    pub(super) points: Arc<[String]>,
    pub(super) known: Known,
}

impl Caller {
    /// The user who runs the daemon, who alone can open its socket.
    pub(super) fn owner() -> Caller {
        Caller {
            name: "owner".to_owned(),
            id: "owner".to_owned(),
            role: Some(Role::Admin),
            via: "socket".to_owned(),
            points: Arc::default(),
            known: Known::Owner,
        }
    }

    /// As recorded in logs.
    pub(super) fn origin(&self) -> Origin {
        Origin {
            who: self.name.clone(),
            via: self.via.clone(),
        }
    }

    /// What it may do at the site. An unknown caller may do nothing; no route lets one that far.
    pub(super) fn rights(&self) -> Rights {
        Rights {
            role: self.role.unwrap_or(Role::Viewer),
            points: Arc::clone(&self.points),
        }
    }

    /// Whether the output with this path, such as `pump.do0`, may be switched.
    pub(super) fn may_write(&self, path: &str) -> Result<(), Problem> {
        let (module, label) = paths::split(path).unwrap_or((path, ""));
        may_write(&self.points, module, label)
    }

    /// Whether the caller is limited to some points: then nothing may be changed that could affect
    /// others.
    pub(super) fn is_limited(&self) -> bool {
        !self.points.is_empty()
    }

    /// Why a caller limited to some points may not do this.
    pub(super) fn limited(&self) -> Problem {
        limited(&self.points)
    }

    /// Why this caller may not use a route with these requirements.
    fn refused(
        &self,
        (need, reach): (Need, Reach),
        method: &Method,
        is_upgrade: bool,
    ) -> Option<Problem> {
        // Routes for the owner alone do not exist for others.
        let (Need::Role(least), Some(role)) = (need, self.role) else {
            let is_unknown = matches!(need, Need::Role(_));
            return is_unknown.then(|| Problem::new(codes::UNAUTHENTICATED));
        };
        if role < least {
            // What an outlet may switch is not a matter of roles.
            if self.known == Known::Outlet && least == Role::Operator {
                let problem = Problem::new(codes::READS_ONLY);
                let outlet = self.id.trim_start_matches("outlet:");
                return Some(problem.with("outlet", outlet));
            }
            let problem = Problem::new(codes::ROLE).with("role", role.name());
            return Some(problem.with("need", least.name()));
        }
        if reach == Reach::Beyond && self.is_limited() {
            return Some(self.limited());
        }
        let reads = matches!(*method, Method::GET | Method::HEAD) && !is_upgrade;
        match self.known {
            Known::Session { is_ours: false, .. } if !reads => Some(Problem::new(codes::CSRF)),
            _ => None,
        }
    }
}

/// Whether these rights cover an output.
pub(super) fn may_write(points: &[String], module: &str, label: &str) -> Result<(), Problem> {
    if paths::selects(points, module, label) {
        return Ok(());
    }
    let problem = Problem::new(codes::POINT_RIGHT).with("module", module);
    Err(problem.with("point", label))
}

/// Why a caller limited to these points may not do what could affect others.
pub(super) fn limited(points: &[String]) -> Problem {
    Problem::new(codes::LIMITED).with("points", points)
}

/// Lets permitted requests through.
pub(super) async fn check(
    State(rule): State<(Need, Reach)>,
    request: Request,
    next: Next,
) -> Response {
    let is_upgrade = gate::is_upgrade(request.headers());
    let refused = match request.extensions().get::<Caller>() {
        Some(caller) => caller.refused(rule, request.method(), is_upgrade),
        // Without an authenticated caller nothing is let through.
        None => Some(Problem::new(codes::UNAUTHENTICATED)),
    };
    let Some(problem) = refused else {
        return next.run(request).await;
    };
    let mut response = answer::problem(&problem);
    if problem.code == codes::UNAUTHENTICATED.code {
        let how = HeaderValue::from_static("Bearer realm=\"railbus\"");
        response.headers_mut().insert(WWW_AUTHENTICATE, how);
    }
    response
}

/// Runs a request to its end, even if the caller goes away: a change is always reported, by an
/// event and to the sessions that it ends.
pub(super) async fn to_its_end(asked: impl Future<Output = Response> + Send + 'static) -> Response {
    tokio::spawn(asked).await.unwrap_or_else(|error| {
        let problem = Problem::new(codes::INTERNAL).with("reason", error.to_string());
        answer::problem(&problem)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn caller(role: Option<Role>, known: Known) -> Caller {
        Caller {
            role,
            known,
            ..Caller::owner()
        }
    }

    #[test]
    fn roles_rise_and_have_names() {
        assert!(Role::ALL.is_sorted());
        for role in Role::ALL {
            let json = serde_json::to_value(role).unwrap();
            assert_eq!(json, role.name());
        }
    }

    #[test]
    fn each_need_is_met_by_those_who_may() {
        let code = |role, need| {
            let refused =
                caller(role, Known::Owner).refused((need, Reach::Harmless), &Method::PUT, false);
            refused.map(|problem| (problem.status, problem.code))
        };
        assert_eq!(code(None, Need::Nothing), None);
        assert_eq!(code(None, Need::VIEWER), Some((401, "E0902".to_owned())));
        for (at, role) in Role::ALL.into_iter().enumerate() {
            for (least_at, least) in Role::ALL.into_iter().enumerate() {
                let refused = (at < least_at).then(|| (403, "E0905".to_owned()));
                assert_eq!(code(Some(role), Need::Role(least)), refused);
            }
        }
    }

    #[test]
    fn a_cookie_alone_changes_nothing() {
        let session = |is_ours| Known::Session {
            key: Fingerprint::default(),
            is_ours,
        };
        let code = |known, method: Method, is_upgrade| {
            let admin = caller(Some(Role::Admin), known);
            let refused = admin.refused((Need::VIEWER, Reach::Harmless), &method, is_upgrade);
            refused.map(|problem| problem.code)
        };
        for method in [Method::POST, Method::PUT, Method::PATCH, Method::DELETE] {
            let refused = Some("E0908".to_owned());
            assert_eq!(code(session(false), method.clone(), false), refused);
            assert_eq!(code(session(true), method.clone(), false), None);
            assert_eq!(code(Known::Token(String::new()), method, false), None);
        }
        assert_eq!(code(session(false), Method::GET, false), None);
        let upgrade = code(session(false), Method::GET, true);
        assert_eq!(upgrade, Some("E0908".to_owned()));
        assert_eq!(code(session(true), Method::GET, true), None);
    }

    #[test]
    fn points_limit_what_may_be_switched() {
        let limited = Caller {
            points: ["pump.*".to_owned(), "oven.k1".to_owned()].into(),
            ..Caller::owner()
        };
        for allowed in ["pump.do0", "pump.do1", "oven.k1"] {
            assert!(limited.may_write(allowed).is_ok(), "{allowed}");
        }
        for other in ["oven.k2", "yard.k1", ""] {
            let refused = limited.may_write(other);
            let code = refused.err().map(|problem| problem.code);
            assert_eq!(code.as_deref(), Some("E0906"), "{other}");
        }
        assert!(Caller::owner().may_write("yard.k1").is_ok());
    }
}
