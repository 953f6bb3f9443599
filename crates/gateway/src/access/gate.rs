//! Accounts, sessions and login attempts of one daemon, and the authentication of requests.

use super::accounts::{Accounts, User, UserChange};
use super::password::{Hashed, Hashers};
use super::secret::{Fingerprint, Secret};
use super::sessions::{Sessions, csrf};
use super::setup::Setup;
use super::store::Store;
use super::tries::{Tries, Who};
use super::{Caller, Known, Role};
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, COOKIE, UPGRADE};
use axum::middleware::Next;
use axum::response::Response;
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use std::net::IpAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// The prefix of the session cookie's name.
const COOKIE_NAME: &str = "railbus_session";
/// The header that a session's mutating requests carry.
const CSRF_HEADER: &str = "x-csrf-token";

/// Where a request over TCP comes from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Peer(pub(crate) IpAddr);

/// The shortest time between two events about too many login attempts.
const TRIES_TOLD_EVERY: Duration = Duration::from_secs(60);

/// Accounts, sessions and login attempts of one daemon.
#[derive(Debug)]
pub struct Gate {
    accounts: Mutex<Arc<Kept>>,
    /// The file, for changing accounts: one change at a time.
    store: Arc<tokio::sync::Mutex<Store>>,
    pub(super) sessions: Sessions,
    /// The name of the session's cookie. Browsers share cookies among all ports of a host, so two
    /// daemons there would end each other's sessions if it were the same.
    pub(super) cookie_name: String,
    pub(super) hashers: Hashers,
    pub(super) setup: Setup,
    tries: Tries,
    /// When too many attempts were last reported.
    tries_told: Mutex<Option<Instant>>,
    /// Counts changes that may revoke rights.
    changes: watch::Sender<u64>,
}

/// Accounts without `Debug` output.
struct Kept(Accounts);

impl std::fmt::Debug for Kept {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Accounts")
    }
}

impl Gate {
    /// Opens and locks the accounts of a state folder.
    pub fn open(folder: &Path) -> Result<Gate, Problem> {
        let store = Store::open(folder)?;
        let accounts = store.read()?;
        let sessions = Sessions::open(folder, |name, logins| {
            let user = accounts.user(name);
            user.is_some_and(|user| user.logins == logins)
        })?;
        Ok(Gate {
            accounts: Mutex::new(Arc::new(Kept(accounts))),
            store: Arc::new(tokio::sync::Mutex::new(store)),
            cookie_name: format!("{COOKIE_NAME}_{}", sessions.cookie()),
            sessions,
            hashers: Hashers::new(),
            setup: Setup::default(),
            tries: Tries::default(),
            tries_told: Mutex::default(),
            changes: watch::Sender::new(0),
        })
    }

    /// Whether a state folder has a user, without locking it.
    pub(crate) fn has_user(folder: &Path) -> bool {
        Store::look(folder).is_ok_and(|accounts| !accounts.is_empty())
    }

    fn now(&self) -> Arc<Kept> {
        Arc::clone(&self.accounts.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Reads from the accounts.
    pub(super) fn read<T>(&self, look: impl FnOnce(&Accounts) -> T) -> T {
        look(&self.now().0)
    }

    /// Whether there is no user yet.
    pub(crate) fn is_new(&self) -> bool {
        self.read(Accounts::is_empty)
    }

    /// Changes the accounts: they are stored before they apply, and stay as they were if the change
    /// is refused or can't be stored. Even if the caller goes away, a change is whole or not made
    /// at all.
    pub(super) async fn change<T>(
        self: &Arc<Self>,
        change: impl FnOnce(&mut Accounts) -> Result<T, Problem>,
    ) -> Result<T, Problem> {
        self.change_and_end(None, change).await
    }

    /// The same, and ends all sessions of a user but one, for good.
    pub(super) async fn change_and_end<T>(
        self: &Arc<Self>,
        sessions: Option<(&str, Option<&Fingerprint>)>,
        change: impl FnOnce(&mut Accounts) -> Result<T, Problem>,
    ) -> Result<T, Problem> {
        let store = Arc::clone(&self.store).lock_owned().await;
        let mut accounts = self.now().0.clone();
        let done = change(&mut accounts)?;
        let sessions = sessions.map(|(user, but)| (user.to_owned(), but.copied()));
        let access = Arc::clone(self);
        let kept = tokio::spawn(async move {
            let write = move || store.write(&accounts).map(|()| (store, accounts));
            let written = tokio::task::spawn_blocking(write).await;
            let (store, accounts) = written.unwrap_or_else(|error| Err(broken(&error)))?;
            *access
                .accounts
                .lock()
                .unwrap_or_else(PoisonError::into_inner) = Arc::new(Kept(accounts));
            if let Some((user, but)) = &sessions {
                access.end_of_user(user, but.as_ref());
            }
            access.changed();
            drop(store);
            match sessions {
                Some(_) => access.sessions.keep().await,
                None => Ok(()),
            }
        });
        kept.await.unwrap_or_else(|error| Err(broken(&error)))?;
        Ok(done)
    }

    /// Makes open streams check whether they are still permitted.
    pub(super) fn changed(&self) {
        self.changes
            .send_modify(|count| *count = count.wrapping_add(1));
    }

    /// Notified of changes that may revoke rights.
    #[cfg_attr(
        not(feature = "opcua"),
        expect(dead_code, reason = "no other interface has connections that last")
    )]
    pub(crate) fn follow_changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// A new link for creating the first user, on this daemon's own page.
    pub(crate) fn setup_link(&self, origin: &str) -> Result<String, Problem> {
        if !self.is_new() {
            return Err(Problem::new(codes::HAS_USER));
        }
        let key = self.setup.key(Instant::now());
        let key =
            key.map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?;
        Ok(format!("{origin}/setup#k={}", key.expose()))
    }

    /// Counts one attempt to log in, for a name and an address.
    pub(super) fn take_try(&self, whose: &[Who]) -> Result<(), Problem> {
        self.tries.take(whose, Instant::now()).map_err(|wait| {
            let wait = u64::try_from(wait.as_millis()).unwrap_or(u64::MAX);
            Problem::new(codes::TRIES).with("retry_after_ms", wait)
        })
    }

    /// Whether too many attempts should be reported again.
    pub(super) fn is_time_to_tell(&self, now: Instant) -> bool {
        let mut told = self
            .tries_told
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let is_time = told.is_none_or(|at| now.duration_since(at) >= TRIES_TOLD_EVERY);
        if is_time {
            *told = Some(now);
        }
        is_time
    }

    /// The password was right: earlier attempts are forgotten.
    pub(super) fn forget_tries(&self, whose: &[Who]) {
        self.tries.give_back(whose);
    }

    /// A session for the user with this password.
    pub(super) async fn log_in(
        &self,
        name: &str,
        password: Secret,
        address: IpAddr,
    ) -> Result<Secret, Problem> {
        let logins = self.confirm(name, password, address).await?;
        self.begin_session(name, &logins, address).await
    }

    /// Whether this is the user's password, and if so the value that the user's sessions have to
    /// carry. It takes the same time for a name that does not exist.
    pub(super) async fn confirm(
        &self,
        name: &str,
        password: Secret,
        address: IpAddr,
    ) -> Result<String, Problem> {
        let whose = [Who::Account(name.to_owned()), Who::address(address)];
        self.confirm_for(name, password, &whose).await
    }

    /// The same, with tries counted for these.
    pub(super) async fn confirm_for(
        &self,
        name: &str,
        password: Secret,
        whose: &[Who],
    ) -> Result<String, Problem> {
        self.take_try(whose)?;
        let hashed = self.password_of(name);
        let is_right = self.hashers.is_right(password, hashed.clone()).await?;
        // The user may have been locked, or given a new password, in the meantime.
        let user = self.unlocked(name);
        let user = user.filter(|user| is_right && Some(&user.password) == hashed.as_ref());
        let user = user.ok_or_else(|| Problem::new(codes::WRONG_LOGIN))?;
        self.forget_tries(whose);
        Ok(user.logins)
    }

    /// Sets a new password for a user who has proved to know the old one, when these `logins` were
    /// valid. One that an administrator has set in the meantime stays.
    pub(super) async fn change_own_password(
        self: &Arc<Self>,
        (name, logins): (&str, &str),
        password: Hashed,
        session: &Fingerprint,
    ) -> Result<(), Problem> {
        let change = UserChange {
            password: Some(password),
            ..UserChange::default()
        };
        let own = |accounts: &mut Accounts| {
            let user = accounts.user(name).filter(|user| user.logins == logins);
            user.ok_or_else(|| Problem::new(codes::WRONG_LOGIN))?;
            accounts.change_user(name, change)
        };
        let sessions = Some((name, Some(session)));
        self.change_and_end(sessions, own).await.map(|_| ())
    }

    /// A session for a user who has been authenticated.
    pub(super) async fn begin_session(
        &self,
        name: &str,
        logins: &str,
        address: IpAddr,
    ) -> Result<Secret, Problem> {
        let address = address.to_canonical().to_string();
        let secret = self
            .sessions
            .begin((name, logins), &address, Instant::now())?;
        // A password changed after this ends the session along with the others.
        if self.logins_of(name).as_deref() != Some(logins) {
            self.sessions.end(&secret.fingerprint());
            return Err(Problem::new(codes::WRONG_LOGIN));
        }
        // A session that can't be stored lasts as long as the process.
        let _ = self.sessions.keep().await;
        Ok(secret)
    }

    /// The session's cookie.
    pub(super) fn cookie<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        let all = headers.get_all(COOKIE).iter();
        let pairs = all
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(';'));
        pairs
            .filter_map(|pair| pair.trim().split_once('='))
            .find(|(name, _)| *name == self.cookie_name)
            .map(|(_, value)| value)
    }

    fn password_of(&self, name: &str) -> Option<Hashed> {
        self.read(|accounts| accounts.user(name).map(|user| user.password.clone()))
    }

    fn logins_of(&self, name: &str) -> Option<String> {
        self.read(|accounts| accounts.user(name).map(|user| user.logins.clone()))
    }

    fn unlocked(&self, name: &str) -> Option<User> {
        let user = self.read(|accounts| accounts.user(name).cloned());
        user.filter(|user| !user.locked)
    }

    /// The caller of a request over TCP.
    fn caller(&self, headers: &HeaderMap, query: Option<&str>, peer: IpAddr) -> Caller {
        let via = match peer.to_canonical() {
            address if address.is_loopback() => "http".to_owned(),
            address => format!("http {address}"),
        };
        let nobody = Caller {
            name: "nobody".to_owned(),
            id: "nobody".to_owned(),
            role: None,
            via,
            points: Arc::default(),
            known: Known::Not,
        };
        // A token takes precedence: browsers send cookies unasked.
        if let Some(presented) = header(headers, AUTHORIZATION.as_str()) {
            return self.of_token(presented, nobody);
        }
        self.of_session(headers, query, nobody)
    }

    fn of_token(&self, presented: &str, nobody: Caller) -> Caller {
        let (scheme, token) = presented.split_once(' ').unwrap_or_default();
        if !scheme.eq_ignore_ascii_case("bearer") {
            return nobody;
        }
        let now = Timestamp::now();
        let token = self.read(|accounts| accounts.token(token.trim(), now).cloned());
        match token {
            None => nobody,
            Some(token) => Caller {
                name: format!("token:{}", token.name),
                id: format!("token:{}", token.id),
                role: Some(token.role),
                points: token.points.into(),
                known: Known::Token(token.id),
                ..nobody
            },
        }
    }

    fn of_session(&self, headers: &HeaderMap, query: Option<&str>, nobody: Caller) -> Caller {
        let now = Instant::now();
        let found = self.cookie(headers).and_then(|cookie| {
            let (key, name) = self.sessions.user(cookie, now)?;
            Some((cookie, key, self.unlocked(&name)?))
        });
        let Some((cookie, key, user)) = found else {
            return nobody;
        };
        let presented = match is_upgrade(headers) {
            // A browser can't set headers for a WebSocket.
            true => query.and_then(csrf_in),
            false => header(headers, CSRF_HEADER),
        };
        let is_ours = presented.is_some_and(|presented| presented == csrf(cookie));
        Caller {
            id: format!("user:{}:{}", user.name, user.created.as_millisecond()),
            name: user.name,
            role: Some(user.role),
            points: user.points.into(),
            known: Known::Session { key, is_ours },
            ..nobody
        }
    }

    /// Whether the caller still has the rights of this role.
    fn may_still(&self, caller: &Caller, least: Role) -> bool {
        let role = match &caller.known {
            Known::Not => None,
            Known::Owner => Some(Role::Admin),
            Known::Outlet => Some(Role::Viewer),
            Known::Session { key, .. } => {
                let lasts = self.sessions.lasts(key, Instant::now());
                let user = self.unlocked(&caller.name).filter(|_| lasts);
                user.map(|user| user.role)
            }
            Known::Token(id) => {
                let now = Timestamp::now();
                self.read(|accounts| accounts.token_by_id(id, now).map(|token| token.role))
            }
        };
        role >= Some(least)
    }

    /// Waits until the caller loses access: the session or token has ended, or the user was
    /// locked. Its streams end then. Cancel-safe.
    pub(crate) async fn gone(&self, caller: &Caller) {
        /// How late the end of a session may be noticed that nothing but time has ended.
        const LATE: Duration = Duration::from_secs(60);
        let mut changes = self.changes.subscribe();
        while self.may_still(caller, Role::Viewer) {
            // Neither can fail while this lives; a time that is up is looked at again.
            let _ = tokio::time::timeout(LATE, changes.changed()).await;
        }
    }

    /// Ends all sessions of a user but one, which stays only if the user is not locked.
    fn end_of_user(&self, user: &str, but: Option<&Fingerprint>) {
        let lasts = self.unlocked(user);
        let but = but.filter(|_| lasts.is_some());
        let logins = lasts.map(|user| user.logins).unwrap_or_default();
        self.sessions.end_of_user((user, &logins), but);
    }

    /// The session of a caller, if there is one.
    pub(super) fn session_of(caller: &Caller) -> Option<&Fingerprint> {
        match &caller.known {
            Known::Session { key, .. } => Some(key),
            _ => None,
        }
    }
}

/// The problem of a task that panicked.
fn broken(error: &tokio::task::JoinError) -> Problem {
    Problem::new(codes::INTERNAL).with("reason", error.to_string())
}

/// Authenticates every request over TCP.
pub(crate) async fn identify(
    State(access): State<Arc<Gate>>,
    mut request: Request,
    next: Next,
) -> Response {
    let caller = match request.extensions().get::<Peer>() {
        Some(Peer(peer)) => {
            let query = request.uri().query();
            Some(access.caller(request.headers(), query, *peer))
        }
        None => None,
    };
    if access.sessions.is_time_to_note(Instant::now()) {
        let access = Arc::clone(&access);
        // What can't be stored now is stored the next time.
        tokio::spawn(async move { access.sessions.keep().await });
    }
    if let Some(caller) = caller {
        request.extensions_mut().insert(caller);
    }
    next.run(request).await
}

/// Whether the connection is to become a WebSocket.
pub(super) fn is_upgrade(headers: &HeaderMap) -> bool {
    headers.contains_key(UPGRADE)
}

fn header<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// `csrf=…` of a query.
fn csrf_in(query: &str) -> Option<&str> {
    let mut pairs = query.split('&').filter_map(|pair| pair.split_once('='));
    pairs
        .find(|(name, _)| *name == "csrf")
        .map(|(_, value)| value)
}

#[cfg(test)]
mod tests;
