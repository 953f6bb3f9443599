//! Who asks, and what each may do.

pub(crate) mod accounts;
pub mod desk;
mod gate;
pub(crate) mod password;
pub mod secret;
mod session_routes;
mod sessions;
pub(crate) mod setup;
pub(crate) mod store;
mod tries;
mod user_routes;

pub use gate::Gate;
pub(super) use gate::{Peer, identify};
pub(super) use session_routes::{ROUTES as SESSION_ROUTES, read};
pub(super) use user_routes::ROUTES as USER_ROUTES;

use super::answer;
use super::routes::Site;
use axum::extract::{Request, State};
use axum::http::Method;
use axum::http::header::{HeaderValue, WWW_AUTHENTICATE};
use axum::middleware::Next;
use axum::response::Response;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::paths;
use railbus_app::render::out;
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use secret::Fingerprint;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;
use utoipa::ToSchema;

/// What somebody may do; each may do what those before it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Role {
    /// Look.
    Viewer,
    /// Switch outputs.
    Operator,
    /// Change modules, lines and the configuration.
    Engineer,
    /// Say who may what.
    Admin,
}

impl Role {
    /// All of them, the least first.
    pub(crate) const ALL: [Role; 4] = [Role::Viewer, Role::Operator, Role::Engineer, Role::Admin];

    /// As it is written.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Role::Viewer => "viewer",
            Role::Operator => "operator",
            Role::Engineer => "engineer",
            Role::Admin => "admin",
        }
    }
}

/// The names of all roles, the least first.
pub const ROLES: [&str; 4] = {
    let [viewer, operator, engineer, admin] = Role::ALL;
    [
        viewer.name(),
        operator.name(),
        engineer.name(),
        admin.name(),
    ]
};

/// What a route asks of those who use it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Need {
    /// Nothing: anybody may.
    Nothing,
    /// At least this role.
    Role(Role),
    /// To be the user who runs the daemon: over the socket only.
    Owner,
}

impl Need {
    pub(super) const VIEWER: Need = Need::Role(Role::Viewer);
    pub(super) const OPERATOR: Need = Need::Role(Role::Operator);
    pub(super) const ENGINEER: Need = Need::Role(Role::Engineer);
    pub(super) const ADMIN: Need = Need::Role(Role::Admin);
}

/// What a route is to those who are limited to points. One that says nothing of it is closed to
/// them if it changes anything: a route that was forgotten lets nobody through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reach {
    /// The same as to everybody: it reads, or is about the caller alone.
    Harmless,
    /// Its handler asks of each output, or each point, whether it is one of theirs.
    Points,
    /// Nothing: it may reach other outputs, by whatever way.
    Beyond,
}

impl Reach {
    /// What a route has that says nothing of it.
    pub(super) const fn of(method: &str, need: Need) -> Reach {
        let reads = matches!(method.as_bytes(), b"GET");
        let is_own = matches!(need, Need::Nothing | Need::Role(Role::Viewer));
        match reads || is_own {
            true => Reach::Harmless,
            false => Reach::Beyond,
        }
    }
}

/// How a caller is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// Not at all.
    Not,
    /// By the socket, which only the owner can open.
    Owner,
    /// By a session's cookie.
    Session {
        key: Fingerprint,
        /// The request carries what only pages of ours know.
        is_ours: bool,
    },
    /// By a token of this id.
    Token(String),
}

/// Who asks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Caller {
    /// The name under which it is written down.
    pub(super) name: String,
    /// Whose is what is kept of it: a name that is given again is another one's.
    pub(super) id: String,
    /// None for somebody unknown.
    pub(super) role: Option<Role>,
    /// From where: `socket`; `http` for this machine, and with an address for another.
    pub(super) via: String,
    /// The points whose outputs may be switched, as patterns; empty for all of them.
    pub(super) points: Arc<[String]>,
    pub(super) known: Known,
}

impl Caller {
    /// The user who runs the daemon, who alone may open its socket.
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

    /// As it is written down.
    pub(super) fn origin(&self) -> Origin {
        Origin {
            who: self.name.clone(),
            via: self.via.clone(),
        }
    }

    /// Whether the output of this path, as `pump.do0`, may be switched. Every handler that
    /// switches something asks this of every output before it begins.
    pub(super) fn may_write(&self, path: &str) -> Result<(), Problem> {
        let (module, label) = paths::split(path).unwrap_or((path, ""));
        may_write(&self.points, module, label)
    }

    /// Whether some points only may be switched: then nothing may be changed from which another
    /// could be.
    pub(super) fn is_limited(&self) -> bool {
        !self.points.is_empty()
    }

    /// Why somebody who is limited to points may not do this.
    pub(super) fn limited(&self) -> Problem {
        limited(&self.points)
    }

    /// Why this caller may not do what needs and reaches this.
    fn refused(
        &self,
        (need, reach): (Need, Reach),
        method: &Method,
        is_upgrade: bool,
    ) -> Option<Problem> {
        // Routes for the owner alone are not there for others.
        let (Need::Role(least), Some(role)) = (need, self.role) else {
            let is_unknown = matches!(need, Need::Role(_));
            return is_unknown.then(|| Problem::new(codes::UNAUTHENTICATED));
        };
        if role < least {
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

/// Why somebody who is limited to these points may not do what could reach another.
pub(super) fn limited(points: &[String]) -> Problem {
    Problem::new(codes::LIMITED).with("points", points)
}

/// Lets through who may.
pub(super) async fn check(
    State(rule): State<(Need, Reach)>,
    request: Request,
    next: Next,
) -> Response {
    let is_upgrade = gate::is_upgrade(request.headers());
    let refused = match request.extensions().get::<Caller>() {
        Some(caller) => caller.refused(rule, request.method(), is_upgrade),
        // Nobody said who asks: nobody is let through.
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

/// Notes a try to log in: the one place that does. A name that there is not may be a password
/// that somebody typed into the wrong field, and so it is not written down.
fn note_login(site: &Site, name: Option<&str>, via: &str, refused: Option<&Problem>) {
    if refused.is_some_and(|why| why.code == codes::TRIES.code) {
        return note_tries(site, via);
    }
    let known = |name: &&str| site.access.read(|accounts| accounts.user(name).is_some());
    let name = name.filter(known).unwrap_or("an unknown name");
    let end = refused.map_or("logged in", |problem| problem.title.as_str());
    out::note(&format!("login: {name} via {via}: {end}"));
    let origin = Origin {
        who: name.to_owned(),
        via: via.to_owned(),
    };
    let event = match refused {
        None => Event::new(EventKind::Login, Severity::Info, "logged_in"),
        Some(why) => {
            Event::new(EventKind::Login, Severity::Warning, "login_refused").text(&why.code)
        }
    };
    site.service.tell_event(event.by(&origin));
}

/// Who tries too often is told of once in a while: whoever wants to fill the history with it can't.
fn note_tries(site: &Site, via: &str) {
    if !site.access.is_time_to_tell(Instant::now()) {
        return;
    }
    out::note(&format!("login: too many tries, the last via {via}"));
    let event = Event::new(EventKind::Login, Severity::Warning, "logins_many");
    site.service.tell_event(event.by(&Origin {
        who: "an unknown name".to_owned(),
        via: via.to_owned(),
    }));
}

/// Does what was asked to its end, whether or not the caller waits for it: what was changed is
/// told, by an event and to the sessions that it ends.
async fn to_its_end(asked: impl Future<Output = Response> + Send + 'static) -> Response {
    tokio::spawn(asked).await.unwrap_or_else(|error| {
        let problem = Problem::new(codes::INTERNAL).with("reason", error.to_string());
        answer::problem(&problem)
    })
}

/// Tells that somebody changed who may what, and of whom.
fn note_change(site: &Site, who: &Caller, code: &str, of: &str, text: Option<&str>) {
    let event = Event::new(EventKind::Login, Severity::Info, code).by(&who.origin());
    let event = match of {
        "" => event,
        of => event.what(of),
    };
    site.service.tell_event(match text {
        Some(text) => event.text(text),
        None => event,
    });
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
