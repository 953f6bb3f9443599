//! Who asks, and what each may do.

use super::answer;
use crate::api::paths;
use crate::api::problem::{Problem, codes};
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use railbus_site::Origin;
use std::sync::Arc;

/// What somebody may do; each may do what those before it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// Look.
    Viewer,
    /// Switch outputs.
    Operator,
    /// Change modules, lines and the configuration.
    Engineer,
    /// Say who may what.
    Admin,
}

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

/// Who asks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Caller {
    /// The name under which it is written down.
    pub(super) name: String,
    /// None for somebody unknown.
    pub(super) role: Option<Role>,
    /// From where: `http`, `socket`, an address.
    pub(super) via: String,
    /// The points whose outputs may be switched, as patterns; empty for all of them.
    pub(super) points: Arc<[String]>,
}

impl Caller {
    /// The user who runs the daemon, who alone may open its socket.
    pub(super) fn owner() -> Caller {
        Caller {
            name: "owner".to_owned(),
            role: Some(Role::Admin),
            via: "socket".to_owned(),
            points: Arc::default(),
        }
    }

    /// Whoever runs a program on this machine.
    pub(super) fn local() -> Caller {
        Caller {
            name: "local".to_owned(),
            role: Some(Role::Admin),
            via: "http".to_owned(),
            points: Arc::default(),
        }
    }
}

impl Caller {
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
}

/// Whether these rights cover an output.
pub(super) fn may_write(points: &[String], module: &str, label: &str) -> Result<(), Problem> {
    if paths::selects(points, module, label) {
        return Ok(());
    }
    let problem = Problem::new(codes::POINT_RIGHT).with("module", module);
    Err(problem.with("point", label))
}

/// Lets through who may.
pub(super) async fn check(State(need): State<Need>, request: Request, next: Next) -> Response {
    let role = request
        .extensions()
        .get::<Caller>()
        .and_then(|caller| caller.role);
    let may = match need {
        Need::Nothing => true,
        Need::Role(least) => role >= Some(least),
        // Such routes are not there for others.
        Need::Owner => true,
    };
    if may {
        return next.run(request).await;
    }
    answer::problem(&Problem::new(codes::FORBIDDEN).with("reason", "the role does not allow it"))
}
