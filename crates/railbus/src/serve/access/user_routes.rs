//! Users, tokens and sessions, for those who say who may what.

use super::accounts::{TokenWish, User, UserChange};
use super::gate::Access;
use super::secret::Secret;
use super::session_routes::read;
use super::{Caller, Need, Role, password};
use crate::api::problem::{Problem, codes};
use crate::serve::answer;
use crate::serve::routes::{Answer, Route, Site};
use axum::Extension;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::routing::{delete, get, patch, post};
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Value, json};
use std::time::Instant;

/// The routes of this file.
pub(in crate::serve) const ROUTES: &[Route] = &[
    Route::new("GET", "/users", Need::ADMIN, || get(users)),
    Route::new("POST", "/users", Need::ADMIN, || post(add_user)),
    Route::new("PATCH", "/users/{name}", Need::ADMIN, || patch(change_user)),
    Route::new("DELETE", "/users/{name}", Need::ADMIN, || {
        delete(remove_user)
    }),
    Route::new("GET", "/tokens", Need::ADMIN, || get(tokens)),
    Route::new("POST", "/tokens", Need::ADMIN, || post(add_token)),
    Route::new("DELETE", "/tokens/{id}", Need::ADMIN, || {
        delete(remove_token)
    }),
    Route::new("GET", "/sessions", Need::ADMIN, || get(sessions)),
    Route::new("DELETE", "/sessions/{id}", Need::ADMIN, || {
        delete(end_session)
    }),
];

#[derive(Deserialize)]
struct AddUser {
    name: String,
    role: Role,
    #[serde(default)]
    points: Vec<String>,
    password: Secret,
}

#[derive(Deserialize)]
struct ChangeUser {
    role: Option<Role>,
    points: Option<Vec<String>>,
    password: Option<Secret>,
    locked: Option<bool>,
}

#[derive(Deserialize)]
struct AddToken {
    name: String,
    role: Role,
    #[serde(default)]
    points: Vec<String>,
    #[serde(default = "usual_days")]
    expires_days: u32,
}

/// Tokens live for a season unless told otherwise.
const fn usual_days() -> u32 {
    90
}

async fn users(State(site): State<Site>) -> Answer {
    let users = site.access.read(|accounts| accounts.users());
    answer::json(Ok(json!({ "schema": 1, "users": users })))
}

async fn add_user(State(site): State<Site>, body: Bytes) -> Answer {
    answer::json(added(&site, &body).await)
}

async fn added(site: &Site, body: &Bytes) -> Result<Value, Problem> {
    let wanted: AddUser = read(body)?;
    password::check(&wanted.name, &wanted.password)?;
    let user = User {
        name: wanted.name,
        role: wanted.role,
        points: wanted.points,
        password: site.access.hashers.hash(wanted.password).await?,
        locked: false,
        lang: None,
        created: Timestamp::now(),
    };
    let info = site
        .access
        .change(|accounts| accounts.add_user(user))
        .await?;
    site.access.setup.close();
    Ok(json!(info))
}

async fn change_user(
    State(site): State<Site>,
    Path(name): Path<String>,
    who: Extension<Caller>,
    body: Bytes,
) -> Answer {
    answer::json(changed(&site, &name, &who, &body).await)
}

async fn changed(site: &Site, name: &str, who: &Caller, body: &Bytes) -> Result<Value, Problem> {
    let wanted: ChangeUser = read(body)?;
    let password = match wanted.password {
        None => None,
        Some(new) => {
            password::check(name, &new)?;
            Some(site.access.hashers.hash(new).await?)
        }
    };
    let logs_out = password.is_some() || wanted.locked == Some(true);
    let change = UserChange {
        role: wanted.role,
        points: wanted.points,
        password,
        locked: wanted.locked,
    };
    let change = |accounts: &mut super::accounts::Accounts| accounts.change_user(name, change);
    let info = site.access.change(change).await?;
    if logs_out {
        let own = Access::session_of(who).filter(|_| !info.locked);
        site.access.sessions.end_of_user(name, own);
        site.access.changed();
    }
    Ok(json!(info))
}

async fn remove_user(State(site): State<Site>, Path(name): Path<String>) -> Answer {
    let removed = site.access.change(|accounts| accounts.remove_user(&name));
    let removed = removed.await.map(|()| {
        site.access.sessions.end_of_user(&name, None);
        site.access.changed();
        json!({ "removed": name })
    });
    answer::json(removed)
}

async fn tokens(State(site): State<Site>) -> Answer {
    let now = Timestamp::now();
    let tokens = site.access.read(|accounts| accounts.tokens(now));
    answer::json(Ok(json!({ "schema": 1, "tokens": tokens })))
}

async fn add_token(State(site): State<Site>, who: Extension<Caller>, body: Bytes) -> Answer {
    answer::json(made(&site, &who, &body).await)
}

async fn made(site: &Site, who: &Caller, body: &Bytes) -> Result<Value, Problem> {
    let wanted: AddToken = read(body)?;
    let wish = TokenWish {
        name: wanted.name,
        role: wanted.role,
        points: wanted.points,
        days: wanted.expires_days,
    };
    let make = |accounts: &mut super::accounts::Accounts| {
        accounts.add_token(wish, &who.name, Timestamp::now())
    };
    let (info, secret) = site.access.change(make).await?;
    let mut told = json!(info);
    // This once, and never again.
    told["token"] = secret.expose().into();
    Ok(told)
}

async fn remove_token(State(site): State<Site>, Path(id): Path<String>) -> Answer {
    let removed = site
        .access
        .change(|accounts| accounts.remove_token(&id))
        .await;
    answer::json(removed.map(|()| json!({ "removed": id })))
}

async fn sessions(State(site): State<Site>, who: Extension<Caller>) -> Answer {
    let current = Access::session_of(&who);
    let sessions = site.access.sessions.list(current, Instant::now());
    answer::json(Ok(json!({ "schema": 1, "sessions": sessions })))
}

async fn end_session(State(site): State<Site>, Path(id): Path<String>) -> Answer {
    if !site.access.sessions.end_by_id(&id) {
        return answer::problem(&Problem::new(codes::NO_SUCH_SESSION).with("name", id));
    }
    site.access.changed();
    answer::json(Ok(json!({ "removed": id })))
}
