//! Requests concerning accounts, for the daemon's API and for commands when no daemon runs: both
//! take the same requests and give the same answers.

use super::accounts::{Accounts, TokenInfo, TokenWish, User, UserChange, UserInfo, new_logins};
use super::gate::Gate;
use super::password;
use super::secret::{Fingerprint, Secret};
use super::{Role, RoleSchema, session_routes::read};
use jiff::Timestamp;
use railbus_api::problem::Problem;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;
use utoipa::ToSchema;

/// A user to create.
#[derive(Deserialize, ToSchema)]
pub(super) struct AddUser {
    name: String,
    #[schema(value_type = RoleSchema)]
    role: Role,
    #[serde(default)]
    points: Vec<String>,
    #[schema(value_type = String)]
    password: Secret,
}

/// Changes to a user; missing fields stay as they are.
#[derive(Deserialize, ToSchema)]
pub(super) struct ChangeUser {
    #[schema(value_type = Option<RoleSchema>)]
    role: Option<Role>,
    points: Option<Vec<String>>,
    #[schema(value_type = Option<String>)]
    password: Option<Secret>,
    locked: Option<bool>,
}

/// A token to create.
#[derive(Deserialize, ToSchema)]
pub(super) struct AddToken {
    name: String,
    #[schema(value_type = RoleSchema)]
    role: Role,
    #[serde(default)]
    points: Vec<String>,
    #[serde(default = "usual_days")]
    expires_days: u32,
}

/// All users.
#[derive(Serialize, ToSchema)]
pub(super) struct Users {
    schema: u8,
    users: Vec<UserInfo>,
}

/// All tokens.
#[derive(Serialize, ToSchema)]
pub(super) struct Tokens {
    schema: u8,
    tokens: Vec<TokenInfo>,
}

/// A token that was created: the only time that it is shown.
#[derive(Serialize, ToSchema)]
pub(super) struct MadeToken {
    #[serde(flatten)]
    info: TokenInfo,
    token: String,
}

/// What was removed.
#[derive(Serialize, ToSchema)]
pub(super) struct Removed {
    pub(super) removed: String,
}

/// The default life of a token: a season.
const fn usual_days() -> u32 {
    90
}

/// All users.
pub fn users(access: &Arc<Gate>) -> Value {
    let users = access.read(Accounts::users);
    json!(Users { schema: 1, users })
}

/// Adds a user.
///
/// # Errors
/// What is wrong with the request, or that it could not be stored.
pub async fn add_user(access: &Arc<Gate>, body: &[u8]) -> Result<Value, Problem> {
    let wanted: AddUser = read(body)?;
    password::check(&wanted.name, &wanted.password)?;
    let user = User {
        name: wanted.name,
        role: wanted.role,
        points: wanted.points,
        password: access.hashers.hash(wanted.password).await?,
        locked: false,
        lang: None,
        logins: new_logins()?,
        created: Timestamp::now(),
    };
    let info = access.change(|accounts| accounts.add_user(user)).await?;
    access.setup.close();
    Ok(json!(info))
}

/// Changes a user. A new password, or none, ends all sessions but the caller's.
///
/// # Errors
/// There is no such user, or what is wrong with the request.
pub async fn change_user(
    access: &Arc<Gate>,
    name: &str,
    own: Option<&Fingerprint>,
    body: &[u8],
) -> Result<Value, Problem> {
    let wanted: ChangeUser = read(body)?;
    let password = match wanted.password {
        None => None,
        Some(new) => {
            password::check(name, &new)?;
            Some(access.hashers.hash(new).await?)
        }
    };
    let logs_out = password.is_some() || wanted.locked == Some(true);
    let change = UserChange {
        role: wanted.role,
        points: wanted.points,
        password,
        locked: wanted.locked,
    };
    let change = |accounts: &mut Accounts| accounts.change_user(name, change);
    let sessions = logs_out.then_some((name, own));
    let info = access.change_and_end(sessions, change).await?;
    Ok(json!(info))
}

/// Removes a user.
///
/// # Errors
/// There is no such user, or it could not be stored.
pub async fn remove_user(access: &Arc<Gate>, name: &str) -> Result<Value, Problem> {
    let remove = |accounts: &mut Accounts| accounts.remove_user(name);
    access.change_and_end(Some((name, None)), remove).await?;
    let removed = name.to_owned();
    Ok(json!(Removed { removed }))
}

/// All tokens.
pub fn tokens(access: &Arc<Gate>) -> Value {
    let now = Timestamp::now();
    let tokens = access.read(|accounts| accounts.tokens(now));
    json!(Tokens { schema: 1, tokens })
}

/// Creates a token, which is shown this once.
///
/// # Errors
/// What is wrong with the request, or that it could not be stored.
pub async fn add_token(access: &Arc<Gate>, by: &str, body: &[u8]) -> Result<Value, Problem> {
    let wanted: AddToken = read(body)?;
    let wish = TokenWish {
        name: wanted.name,
        role: wanted.role,
        points: wanted.points,
        days: wanted.expires_days,
    };
    let make = |accounts: &mut Accounts| accounts.add_token(wish, by, Timestamp::now());
    let (info, secret) = access.change(make).await?;
    let token = secret.expose().to_owned();
    Ok(json!(MadeToken { info, token }))
}

/// Removes a token, by its id or its name.
///
/// # Errors
/// There is no such token, or it could not be stored.
pub async fn remove_token(access: &Arc<Gate>, named: &str) -> Result<Value, Problem> {
    let remove = access.change(|accounts| accounts.remove_token(named));
    let removed = named.to_owned();
    remove.await.map(|()| json!(Removed { removed }))
}
