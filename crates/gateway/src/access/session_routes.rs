//! Logging in and out, and the first user.

use super::accounts::{User, new_logins};
use super::gate::{Gate, Peer};
use super::notes::{note_change, note_login};
use super::secret::Secret;
use super::sessions::csrf;
use super::tries::Who;
use super::{AccountsApi, Caller, Known, Need, Role, RoleSchema, password, to_its_end};
use crate::doc::Doc;
use crate::route::{Answer, Route};
use crate::{answer, body};
use axum::Extension;
use axum::body::Bytes;
use axum::http::HeaderMap;
use axum::http::header::{HeaderValue, RETRY_AFTER, SET_COOKIE};
use axum::routing::{get, post};
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::net::IpAddr;
use std::time::Instant;
use utoipa::ToSchema;

/// The routes of this file.
pub(crate) const ROUTES: &[Route] = &[
    Route::of_accounts("GET", "/session", Need::Nothing, || get(session))
        .secret()
        .doc(Doc::new("Who asks, and what there is to know before").answers::<SessionTold>()),
    Route::of_accounts("POST", "/setup", Need::Nothing, || post(set_up)).doc(
        Doc::new("Make the first user, with the key of the one-time link")
            .takes::<SetupRequest>()
            .answers::<SessionTold>(),
    ),
    Route::of_accounts("POST", "/login", Need::Nothing, || post(log_in)).doc(
        Doc::new("Begin a session, which its cookie carries")
            .takes::<LoginRequest>()
            .answers::<SessionTold>(),
    ),
    Route::of_accounts("POST", "/logout", Need::VIEWER, || post(log_out))
        .doc(Doc::new("End one's session").answers::<SessionTold>()),
    Route::of_accounts("POST", "/password", Need::VIEWER, || post(new_password)).doc(
        Doc::new("Change one's password; one's other sessions end")
            .takes::<PasswordRequest>()
            .answers::<Changed>(),
    ),
    Route::of_accounts("POST", "/setup-link", Need::Owner, || post(setup_link))
        .doc(Doc::new("Another link for the first user").answers::<SetupLink>()),
];

/// The first user, and the key that allows it.
#[derive(Deserialize, ToSchema)]
struct SetupRequest {
    #[schema(value_type = String)]
    key: Secret,
    name: String,
    #[schema(value_type = String)]
    password: Secret,
    #[serde(default)]
    lang: Option<String>,
}

/// Name and password.
#[derive(Deserialize, ToSchema)]
struct LoginRequest {
    name: String,
    #[schema(value_type = String)]
    password: Secret,
}

/// The old password and the new one.
#[derive(Deserialize, ToSchema)]
struct PasswordRequest {
    #[schema(value_type = String)]
    old: Secret,
    #[schema(value_type = String)]
    new: Secret,
}

/// The caller, and what the page needs to know before login.
#[derive(Serialize, ToSchema)]
struct SessionTold {
    /// None if not authenticated.
    #[schema(required)]
    user: Option<WhoTold>,
    /// There are no users yet.
    setup: bool,
    /// What mutating requests of this session have to carry as `X-CSRF-Token`.
    #[schema(required)]
    csrf: Option<String>,
    demo: bool,
    /// It is the centre of many sites that answers, about itself and not about one of its sites.
    centre: bool,
    /// Some of its lines are simulated here, and can be controlled.
    simulated: bool,
    version: &'static str,
    #[schema(value_type = railbus_api::words::Language)]
    lang: String,
    site: String,
}

/// The caller.
#[derive(Serialize, ToSchema)]
struct WhoTold {
    name: String,
    #[schema(value_type = RoleSchema)]
    role: Role,
    points: Vec<String>,
}

/// Whose password was changed.
#[derive(Serialize, ToSchema)]
struct Changed {
    changed: String,
}

/// A one-time link for the first user, and how long it is valid.
#[derive(Serialize, ToSchema)]
struct SetupLink {
    setup_link: String,
    minutes: u64,
}

/// Parses a body.
pub(crate) fn read<T: DeserializeOwned>(body: &[u8]) -> Result<T, Problem> {
    // The parser's message could contain a secret, so only the position is reported.
    body::parse(body).map_err(|error| {
        let place = format!(
            "no such request: line {} column {}",
            error.line(),
            error.column()
        );
        Problem::new(codes::BAD_REQUEST).with("reason", place)
    })
}

/// `GET /session`.
async fn session(api: AccountsApi, who: Extension<Caller>, headers: HeaderMap) -> Answer {
    let csrf = match who.known {
        Known::Session { .. } => api.access.cookie(&headers).map(csrf),
        _ => None,
    };
    answer::json(Ok(told(&api, &who, csrf)))
}

/// A session as reported to its owner.
fn told(api: &AccountsApi, who: &Caller, csrf: Option<String>) -> SessionTold {
    let chosen = api.access.read(|accounts| {
        let user = accounts.user(&who.name);
        user.and_then(|user| user.lang.clone())
    });
    SessionTold {
        user: api.role(who).map(|role| WhoTold {
            name: who.name.clone(),
            role,
            points: who.points.to_vec(),
        }),
        setup: api.access.is_new(),
        csrf,
        demo: api.demo,
        centre: api.place.is_centre(),
        simulated: api.simulated,
        version: env!("CARGO_PKG_VERSION"),
        lang: chosen.unwrap_or_else(|| api.lang.name().to_owned()),
        site: api.name.to_string(),
    }
}

/// `POST /setup`: creates the first user, who may do everything.
async fn set_up(
    api: AccountsApi,
    who: Extension<Caller>,
    peer: Option<Extension<Peer>>,
    body: Bytes,
) -> Answer {
    to_its_end(async move {
        let end = first_user(&api, address(peer), &body).await;
        let name = end.as_ref().ok().map(|(name, _)| name.as_str());
        note_login(
            (&api.access, api.events.as_ref()),
            name,
            &who.via,
            end.as_ref().err(),
        );
        if let Some(name) = name {
            let first = Caller {
                name: name.to_owned(),
                ..who.0.clone()
            };
            note_change(&api, &first, "user_added", name, Some(Role::Admin.name()));
        }
        begun((&api, &who), end)
    })
    .await
}

async fn first_user(
    api: &AccountsApi,
    address: IpAddr,
    body: &[u8],
) -> Result<(String, Secret), Problem> {
    let wanted: SetupRequest = read(body)?;
    let access = &api.access;
    let whose = [Who::address(address)];
    access.take_try(&whose)?;
    if !access.is_new() {
        return Err(Problem::new(codes::HAS_USER));
    }
    if !access.setup.fits(&wanted.key, Instant::now()) {
        return Err(Problem::new(codes::SETUP));
    }
    access.forget_tries(&whose);
    password::check(&wanted.name, &wanted.password)?;
    let user = User {
        name: wanted.name.clone(),
        role: Role::Admin,
        points: Vec::new(),
        password: access.hashers.hash(wanted.password).await?,
        locked: false,
        lang: wanted
            .lang
            .filter(|lang| ["en", "zh"].contains(&lang.as_str())),
        logins: new_logins()?,
        created: Timestamp::now(),
    };
    let logins = user.logins.clone();
    let key = wanted.key;
    let add = |accounts: &mut super::accounts::Accounts| {
        // Two requests may have come this far at once.
        if !accounts.is_empty() || !access.setup.fits(&key, Instant::now()) {
            return Err(Problem::new(codes::HAS_USER));
        }
        accounts.add_user(user)
    };
    access.change(add).await?;
    access.setup.close();
    let secret = access.begin_session(&wanted.name, &logins, address).await?;
    Ok((wanted.name, secret))
}

/// `POST /login`.
async fn log_in(
    api: AccountsApi,
    who: Extension<Caller>,
    peer: Option<Extension<Peer>>,
    body: Bytes,
) -> Answer {
    to_its_end(async move {
        let wanted: LoginRequest = match read(&body) {
            Ok(wanted) => wanted,
            Err(problem) => return answer::problem(&problem),
        };
        let LoginRequest { name, password } = wanted;
        let end = api.access.log_in(&name, password, address(peer)).await;
        note_login(
            (&api.access, api.events.as_ref()),
            Some(&name),
            &who.via,
            end.as_ref().err(),
        );
        begun((&api, &who), end.map(|secret| (name, secret)))
    })
    .await
}

/// The answer to a login: the session, and its cookie.
fn begun((api, who): (&AccountsApi, &Caller), end: Result<(String, Secret), Problem>) -> Answer {
    let (name, secret) = match end {
        Ok(begun) => begun,
        Err(problem) => return refused(&problem),
    };
    let user = api.access.read(|accounts| accounts.user(&name).cloned());
    let who = Caller {
        role: user.as_ref().map(|user| user.role),
        points: user.map(|user| user.points.into()).unwrap_or_default(),
        name,
        ..who.clone()
    };
    let told = told(api, &who, Some(csrf(secret.expose())));
    with_cookie(answer::json(Ok(told)), api, secret.expose(), None)
}

/// A refusal that says when to try again.
fn refused(problem: &Problem) -> Answer {
    let mut response = answer::problem(problem);
    let wait = problem
        .with
        .get("retry_after_ms")
        .and_then(serde_json::Value::as_u64);
    if let Some(wait) = wait {
        let seconds = HeaderValue::from(wait.div_ceil(1_000));
        response.headers_mut().insert(RETRY_AFTER, seconds);
    }
    response
}

fn with_cookie(mut response: Answer, api: &AccountsApi, value: &str, age: Option<u32>) -> Answer {
    let name = &api.access.cookie_name;
    let secure = if api.is_tls { "; Secure" } else { "" };
    let age = age
        .map(|age| format!("; Max-Age={age}"))
        .unwrap_or_default();
    let cookie = format!("{name}={value}; HttpOnly; SameSite=Strict; Path=/{secure}{age}");
    // It is all ASCII.
    if let Ok(mut value) = HeaderValue::from_str(&cookie) {
        value.set_sensitive(true);
        response.headers_mut().insert(SET_COOKIE, value);
    }
    response
}

/// `POST /logout`.
async fn log_out(api: AccountsApi, who: Extension<Caller>) -> Answer {
    to_its_end(async move {
        if let Some(key) = Gate::session_of(&who) {
            api.access.sessions.end(key);
            api.access.changed();
            // Reported as ended once that is stored.
            if let Err(problem) = api.access.sessions.keep().await {
                return answer::problem(&problem);
            }
            note_change(&api, &who, "logged_out", "", None);
        }
        let nobody = Caller {
            role: None,
            ..who.0
        };
        let told = told(&api, &nobody, None);
        with_cookie(answer::json(Ok(told)), &api, "", Some(0))
    })
    .await
}

/// `POST /password`: changes the caller's password. All other sessions of the user end.
async fn new_password(
    api: AccountsApi,
    who: Extension<Caller>,
    peer: Option<Extension<Peer>>,
    body: Bytes,
) -> Answer {
    to_its_end(async move {
        match change_password(&api, &who, address(peer), &body).await {
            Ok(()) => answer::json(Ok(Changed {
                changed: who.0.name,
            })),
            Err(problem) => refused(&problem),
        }
    })
    .await
}

async fn change_password(
    api: &AccountsApi,
    who: &Caller,
    address: IpAddr,
    body: &[u8],
) -> Result<(), Problem> {
    let wanted: PasswordRequest = read(body)?;
    let access = &api.access;
    let Some(key) = Gate::session_of(who) else {
        let reason = "only a user who has logged in has a password";
        return Err(Problem::new(codes::FORBIDDEN).with("reason", reason));
    };
    password::check(&who.name, &wanted.new)?;
    let logins = access.confirm(&who.name, wanted.old, address).await?;
    let new = access.hashers.hash(wanted.new).await?;
    access
        .change_own_password((&who.name, &logins), new, key)
        .await?;
    note_change(api, who, "password_changed", "", None);
    Ok(())
}

/// `POST /setup-link`, for the owner: a new link for the first user.
async fn setup_link(api: AccountsApi) -> Answer {
    let link = api.access.setup_link(&api.origin);
    let minutes = super::setup::LIFE.as_secs() / 60;
    answer::json(link.map(|setup_link| SetupLink {
        setup_link,
        minutes,
    }))
}

/// The address of a request; over the socket, this machine's.
fn address(peer: Option<Extension<Peer>>) -> IpAddr {
    let here = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);
    peer.map_or(here, |Extension(Peer(address))| address)
}
