//! Users, tokens and sessions, for administrators.

use super::accounts::UserInfo;
use super::desk::{AddToken, AddUser, ChangeUser, MadeToken, Removed, Tokens, Users};
use super::gate::Gate;
use super::notes::note_change;
use super::sessions::SessionInfo;
use super::{AccountsApi, Caller, Need, desk, to_its_end};
use crate::answer;
use crate::doc::Doc;
use crate::route::{Answer, Route};
use axum::Extension;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::routing::{delete, get, patch, post};
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use serde::Serialize;
use serde::de::IgnoredAny;
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::Instant;
use utoipa::ToSchema;

/// The routes of this file.
pub(crate) const ROUTES: &[Route] = &[
    Route::of_accounts("GET", "/users", Need::ADMIN, || get(users))
        .doc(Doc::new("All users").answers::<Users>()),
    Route::of_accounts("POST", "/users", Need::ADMIN, || post(add_user)).doc(
        Doc::new("Add a user")
            .takes::<AddUser>()
            .answers::<UserInfo>(),
    ),
    Route::of_accounts("PATCH", "/users/{name}", Need::ADMIN, || patch(change_user)).doc(
        Doc::new("Change a user")
            .takes::<ChangeUser>()
            .answers::<UserInfo>(),
    ),
    Route::of_accounts("DELETE", "/users/{name}", Need::ADMIN, || {
        delete(remove_user)
    })
    .doc(Doc::new("Remove a user").answers::<Removed>()),
    Route::of_accounts("GET", "/tokens", Need::ADMIN, || get(tokens))
        .doc(Doc::new("All tokens, without themselves").answers::<Tokens>()),
    Route::of_accounts("POST", "/tokens", Need::ADMIN, || post(add_token)).doc(
        Doc::new("Make a token, which is told this once")
            .takes::<AddToken>()
            .answers::<MadeToken>(),
    ),
    Route::of_accounts("DELETE", "/tokens/{id}", Need::ADMIN, || {
        delete(remove_token)
    })
    .doc(Doc::new("Revoke a token, by its id or its name").answers::<Removed>()),
    Route::of_accounts("GET", "/sessions", Need::ADMIN, || get(sessions))
        .doc(Doc::new("Who is logged in").answers::<Sessions>()),
    Route::of_accounts("DELETE", "/sessions/{id}", Need::ADMIN, || {
        delete(end_session)
    })
    .doc(Doc::new("End a session").answers::<Removed>()),
];

/// Who is logged in.
#[derive(Serialize, ToSchema)]
struct Sessions {
    schema: u8,
    sessions: Vec<SessionInfo>,
}

async fn users(State(api): State<AccountsApi>) -> Answer {
    answer::json(Ok(desk::users(&api.access)))
}

/// The answer to a change, which is also reported as an event: whom it concerns, by the key of the
/// answer, and what changed.
fn noted(
    (api, who, code): (&AccountsApi, &Caller, &str),
    (key, text): (&str, Option<&str>),
    end: Result<Value, Problem>,
) -> Answer {
    if let Ok(done) = &end {
        let of = done[key].as_str().unwrap_or_default();
        let text = text.or(done["role"].as_str());
        note_change(api, who, code, of, text);
    }
    answer::json(end)
}

async fn add_user(State(api): State<AccountsApi>, who: Extension<Caller>, body: Bytes) -> Answer {
    to_its_end(async move {
        let end = desk::add_user(&api.access, &body).await;
        noted((&api, &who.0, "user_added"), ("name", None), end)
    })
    .await
}

async fn change_user(
    State(api): State<AccountsApi>,
    Path(name): Path<String>,
    who: Extension<Caller>,
    body: Bytes,
) -> Answer {
    to_its_end(async move {
        let own = Gate::session_of(&who);
        let end = desk::change_user(&api.access, &name, own, &body).await;
        let keys: BTreeMap<String, IgnoredAny> = serde_json::from_slice(&body).unwrap_or_default();
        let known = ["role", "points", "password", "locked"].into_iter();
        let known: Vec<&str> = known.filter(|key| keys.contains_key(*key)).collect();
        let text = known.join(" ");
        noted((&api, &who.0, "user_changed"), ("name", Some(&text)), end)
    })
    .await
}

async fn remove_user(
    State(api): State<AccountsApi>,
    Path(name): Path<String>,
    who: Extension<Caller>,
) -> Answer {
    to_its_end(async move {
        let end = desk::remove_user(&api.access, &name).await;
        noted((&api, &who.0, "user_removed"), ("removed", None), end)
    })
    .await
}

async fn tokens(State(api): State<AccountsApi>) -> Answer {
    answer::json(Ok(desk::tokens(&api.access)))
}

async fn add_token(State(api): State<AccountsApi>, who: Extension<Caller>, body: Bytes) -> Answer {
    to_its_end(async move {
        let end = desk::add_token(&api.access, &who.name, &body).await;
        noted((&api, &who.0, "token_created"), ("name", None), end)
    })
    .await
}

async fn remove_token(
    State(api): State<AccountsApi>,
    Path(id): Path<String>,
    who: Extension<Caller>,
) -> Answer {
    to_its_end(async move {
        let all = api
            .access
            .read(|accounts| accounts.tokens(Timestamp::now()));
        let named = all.into_iter().find(|token| token.id == id);
        let name = named.map_or_else(|| id.clone(), |token| token.name);
        let end = desk::remove_token(&api.access, &id).await;
        if end.is_ok() {
            note_change(&api, &who, "token_revoked", &name, None);
        }
        answer::json(end)
    })
    .await
}

async fn sessions(State(api): State<AccountsApi>, who: Extension<Caller>) -> Answer {
    let current = Gate::session_of(&who);
    let sessions = api.access.sessions.list(current, Instant::now());
    answer::json(Ok(Sessions {
        schema: 1,
        sessions,
    }))
}

async fn end_session(
    State(api): State<AccountsApi>,
    Path(id): Path<String>,
    who: Extension<Caller>,
) -> Answer {
    to_its_end(async move {
        let all = api.access.sessions.list(None, Instant::now());
        let whose = all.into_iter().find(|session| session.id == id);
        if !api.access.sessions.end_by_id(&id) {
            return answer::problem(&Problem::new(codes::NO_SUCH_SESSION).with("name", id));
        }
        api.access.changed();
        if let Err(problem) = api.access.sessions.keep().await {
            return answer::problem(&problem);
        }
        let whose = whose.map(|session| session.user).unwrap_or_default();
        note_change(&api, &who, "session_ended", &whose, None);
        answer::json(Ok(Removed { removed: id }))
    })
    .await
}
