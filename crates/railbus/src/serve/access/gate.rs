//! The gate: accounts, sessions and tries of one daemon, and who a request comes from.

use super::accounts::{Accounts, User, UserChange};
use super::password::{Hashed, Hashers};
use super::secret::{Fingerprint, Secret};
use super::sessions::{Sessions, csrf};
use super::setup::Setup;
use super::store::Store;
use super::tries::{Tries, Who};
use super::{Caller, Known, Role};
use crate::api::problem::{Problem, codes};
use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, COOKIE, UPGRADE};
use axum::middleware::Next;
use axum::response::Response;
use jiff::Timestamp;
use std::net::IpAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// How the name of the session's cookie begins.
const COOKIE_NAME: &str = "railbus_session";
/// The header that a session's mutating requests carry.
const CSRF_HEADER: &str = "x-csrf-token";

/// Where a request over TCP comes from.
#[derive(Clone, Copy, Debug)]
pub(in crate::serve) struct Peer(pub(in crate::serve) IpAddr);

/// It is told so often at most that somebody tries too often.
const TRIES_TOLD_EVERY: Duration = Duration::from_secs(60);

/// Accounts, sessions and tries of one daemon.
#[derive(Debug)]
pub(crate) struct Access {
    accounts: Mutex<Arc<Kept>>,
    /// The file, for whoever changes accounts: one at a time.
    store: Arc<tokio::sync::Mutex<Store>>,
    pub(super) sessions: Sessions,
    /// The name of the session's cookie. Browsers keep one jar for all ports of a host, so that two
    /// daemons there would throw out each other's sessions if it were the same.
    pub(super) cookie_name: String,
    pub(super) hashers: Hashers,
    pub(super) setup: Setup,
    tries: Tries,
    /// When it was last told that somebody tries too often.
    tries_told: Mutex<Option<Instant>>,
    /// Counts what may end somebody's rights.
    changes: watch::Sender<u64>,
}

/// Accounts that can't be shown by mistake.
struct Kept(Accounts);

impl std::fmt::Debug for Kept {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Accounts")
    }
}

impl Access {
    /// The accounts of a state folder, held from now on.
    pub(crate) fn open(folder: &Path) -> Result<Access, Problem> {
        let store = Store::open(folder)?;
        let accounts = store.read()?;
        let sessions = Sessions::open(folder, |name, logins| {
            let user = accounts.user(name);
            user.is_some_and(|user| user.logins == logins)
        })?;
        Ok(Access {
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

    /// Whether a state folder holds a user, whoever holds the folder.
    pub(crate) fn has_user(folder: &Path) -> bool {
        Store::look(folder).is_ok_and(|accounts| !accounts.is_empty())
    }

    fn now(&self) -> Arc<Kept> {
        Arc::clone(&self.accounts.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Looks something up in the accounts as they are.
    pub(super) fn read<T>(&self, look: impl FnOnce(&Accounts) -> T) -> T {
        look(&self.now().0)
    }

    /// Whether there is no user yet.
    pub(crate) fn is_new(&self) -> bool {
        self.read(Accounts::is_empty)
    }

    /// Changes the accounts: they are on the disk before they count, and stay as they were where
    /// the change is refused or can't be kept. Who asks may go away: it is whole, or not at all.
    pub(super) async fn change<T>(
        self: &Arc<Self>,
        change: impl FnOnce(&mut Accounts) -> Result<T, Problem>,
    ) -> Result<T, Problem> {
        self.change_and_end(None, change).await
    }

    /// The same, and with it all sessions of a user but one end, for good.
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

    /// Those who look on find out whether they still may.
    pub(super) fn changed(&self) {
        self.changes
            .send_modify(|count| *count = count.wrapping_add(1));
    }

    /// A new link for the first user, on this daemon's own page.
    pub(crate) fn setup_link(&self, origin: &str) -> Result<String, Problem> {
        if !self.is_new() {
            return Err(Problem::new(codes::HAS_USER));
        }
        let key = self.setup.key(Instant::now());
        let key =
            key.map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?;
        Ok(format!("{origin}/setup#k={}", key.expose()))
    }

    /// One try to log in, of a name and from an address.
    pub(super) fn take_try(&self, whose: &[Who]) -> Result<(), Problem> {
        self.tries.take(whose, Instant::now()).map_err(|wait| {
            let wait = u64::try_from(wait.as_millis()).unwrap_or(u64::MAX);
            Problem::new(codes::TRIES).with("retry_after_ms", wait)
        })
    }

    /// Whether it is time to tell again that somebody tries too often.
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

    /// It was the right one: what was tried before is forgotten.
    pub(super) fn forget_tries(&self, whose: &[Who]) {
        self.tries.give_back(whose);
    }

    /// A session for the user whose password this is.
    pub(super) async fn log_in(
        &self,
        name: &str,
        password: Secret,
        address: IpAddr,
    ) -> Result<Secret, Problem> {
        let logins = self.confirm(name, password, address).await?;
        self.begin_session(name, &logins, address).await
    }

    /// Whether this is a user's password, and if so what his sessions have to carry. It takes as
    /// long for a name that there is not.
    pub(super) async fn confirm(
        &self,
        name: &str,
        password: Secret,
        address: IpAddr,
    ) -> Result<String, Problem> {
        let whose = [Who::Account(name.to_owned()), Who::address(address)];
        self.take_try(&whose)?;
        let hashed = self.password_of(name);
        let is_right = self.hashers.is_right(password, hashed.clone()).await?;
        // The user may have been locked, or given another password, meanwhile.
        let user = self.unlocked(name);
        let user = user.filter(|user| is_right && Some(&user.password) == hashed.as_ref());
        let user = user.ok_or_else(|| Problem::new(codes::WRONG_LOGIN))?;
        self.forget_tries(&whose);
        Ok(user.logins)
    }

    /// Another password for somebody who showed to know the one before, which let him carry these
    /// `logins`. One that an administrator gave meanwhile stays.
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

    /// A session of somebody who showed who he is.
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
        // Who changes the password after this ends the session with the others.
        if self.logins_of(name).as_deref() != Some(logins) {
            self.sessions.end(&secret.fingerprint());
            return Err(Problem::new(codes::WRONG_LOGIN));
        }
        // One that can't be kept lasts as long as the program.
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

    /// Who a request over TCP comes from.
    fn caller(&self, headers: &HeaderMap, query: Option<&str>, peer: IpAddr) -> Caller {
        let via = match peer.to_canonical() {
            address if address.is_loopback() => "http".to_owned(),
            address => format!("http {address}"),
        };
        let nobody = Caller {
            name: "nobody".to_owned(),
            role: None,
            via,
            points: Arc::default(),
            known: Known::Not,
        };
        // Who shows a token is known by it alone: a cookie may come along unasked.
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
            // A browser can't give a header to a WebSocket.
            true => query.and_then(csrf_in),
            false => header(headers, CSRF_HEADER),
        };
        let is_ours = presented.is_some_and(|presented| presented == csrf(cookie));
        Caller {
            name: user.name,
            role: Some(user.role),
            points: user.points.into(),
            known: Known::Session { key, is_ours },
            ..nobody
        }
    }

    /// Whether somebody may still do what this role may.
    fn may_still(&self, caller: &Caller, least: Role) -> bool {
        let role = match &caller.known {
            Known::Not => None,
            Known::Owner => Some(Role::Admin),
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

    /// Waits until somebody may no longer look on: the session or the token has ended, or the
    /// user was locked. What streams on and on ends then. Can be dropped and called again.
    pub(in crate::serve) async fn gone(&self, caller: &Caller) {
        /// How late the end of a session may be noticed that nothing but time has ended.
        const LATE: Duration = Duration::from_secs(60);
        let mut changes = self.changes.subscribe();
        while self.may_still(caller, Role::Viewer) {
            // Neither can fail while this lives; a time that is up is looked at again.
            let _ = tokio::time::timeout(LATE, changes.changed()).await;
        }
    }

    /// Ends all sessions of a user but one, which lasts only where he is not locked.
    fn end_of_user(&self, user: &str, but: Option<&Fingerprint>) {
        let lasts = self.unlocked(user);
        let but = but.filter(|_| lasts.is_some());
        let logins = lasts.map(|user| user.logins).unwrap_or_default();
        self.sessions.end_of_user((user, &logins), but);
    }

    /// The session of a caller, where it has one.
    pub(super) fn session_of(caller: &Caller) -> Option<&Fingerprint> {
        match &caller.known {
            Known::Session { key, .. } => Some(key),
            _ => None,
        }
    }
}

/// What a task broke off with.
fn broken(error: &tokio::task::JoinError) -> Problem {
    Problem::new(codes::INTERNAL).with("reason", error.to_string())
}

/// Says of every request over TCP who it comes from.
pub(in crate::serve) async fn identify(
    State(access): State<Arc<Access>>,
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
        // What can't be noted now will be the next time.
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
mod tests {
    use super::super::accounts::{TokenWish, new_logins};
    use super::super::password;
    use super::*;
    use axum::http::HeaderValue;

    const HERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    struct Folder(std::path::PathBuf);

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn opened(folder: &Path) -> Arc<Access> {
        let access = Access::open(folder);
        Arc::new(access.unwrap_or_else(|problem| panic!("{problem:?}")))
    }

    async fn access(name: &str) -> (Arc<Access>, Folder) {
        let unique = format!("railbus-gate-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let access = opened(&folder);
        let user = User {
            name: "li".to_owned(),
            role: Role::Admin,
            points: Vec::new(),
            password: hashed("correct horse"),
            locked: false,
            lang: None,
            logins: new_logins().unwrap_or_else(|problem| panic!("{problem:?}")),
            created: Timestamp::now(),
        };
        let second = User {
            name: "wang".to_owned(),
            ..user.clone()
        };
        let added = access.change(|accounts| accounts.add_user(user)).await;
        assert!(added.is_ok());
        let added = access.change(|accounts| accounts.add_user(second)).await;
        assert!(added.is_ok());
        (access, Folder(folder))
    }

    async fn log_in(access: &Access, name: &str, password: &str) -> Result<Secret, String> {
        let password = Secret::new(password.to_owned());
        let done = access.log_in(name, password, HERE).await;
        done.map_err(|problem| problem.code)
    }

    fn with(name: &'static str, value: &str) -> HeaderMap {
        let value = HeaderValue::from_str(value).unwrap_or_else(|_| panic!("ASCII"));
        HeaderMap::from_iter([(axum::http::HeaderName::from_static(name), value)])
    }

    #[tokio::test]
    async fn wrong_tries_are_refused_alike_and_counted() {
        let (access, _folder) = access("tries").await;
        let code = |end: Result<Secret, String>| end.err().unwrap_or_default();
        assert_eq!(code(log_in(&access, "li", "correct horse").await), "");
        assert_eq!(code(log_in(&access, "li", "wrong").await), "E0904");
        assert_eq!(code(log_in(&access, "nobody", "wrong").await), "E0904");
        for _ in 0..3 {
            assert_eq!(code(log_in(&access, "nobody", "wrong").await), "E0904");
        }
        let right = log_in(&access, "li", "correct horse").await;
        assert_eq!(code(right), "E0907", "the address has no try left");
    }

    #[tokio::test]
    async fn a_session_is_known_by_its_cookie_and_ends_with_its_user() {
        let (access, _folder) = access("session").await;
        let Ok(secret) = log_in(&access, "li", "correct horse").await else {
            panic!("it logs in");
        };
        let cookie = |name: &str| with("cookie", &format!("a=b; {name}={}", secret.expose()));
        let others = cookie(&format!("{COOKIE_NAME}_0"));
        assert!(access.cookie(&others).is_none(), "another daemon's");
        let mut headers = cookie(&access.cookie_name);
        let caller = access.caller(&headers, None, HERE);
        assert_eq!(
            (caller.name.as_str(), caller.role),
            ("li", Some(Role::Admin))
        );
        assert!(matches!(
            caller.known,
            Known::Session { is_ours: false, .. }
        ));
        let token = HeaderValue::from_str(&csrf(secret.expose())).unwrap();
        headers.insert(CSRF_HEADER, token);
        let ours = access.caller(&headers, None, HERE);
        assert!(matches!(ours.known, Known::Session { is_ours: true, .. }));
        headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
        let query = format!("a=1&csrf={}", csrf(secret.expose()));
        let socket = access.caller(&headers, Some(&query), HERE);
        assert!(matches!(socket.known, Known::Session { is_ours: true, .. }));

        let lock = UserChange {
            locked: Some(true),
            ..UserChange::default()
        };
        let gone = access.gone(&ours);
        let locked = access.change(|accounts| accounts.change_user("li", lock));
        let (locked, ()) = tokio::join!(locked, gone);
        assert!(locked.is_ok());
        assert_eq!(access.caller(&headers, None, HERE).role, None);
        let again = log_in(&access, "li", "correct horse").await;
        assert_eq!(again.err().as_deref(), Some("E0904"));
    }

    /// The program ends between the write of another password and that of the sessions.
    #[tokio::test]
    async fn a_crash_brings_no_session_back_that_a_password_or_a_lock_has_ended() {
        let (access, folder) = access("crash").await;
        let mut cookies = Vec::new();
        for name in ["li", "wang"] {
            cookies.push(log_in(&access, name, "correct horse").await.unwrap());
        }
        let changes = [
            UserChange {
                password: Some(hashed("battery staple")),
                ..UserChange::default()
            },
            UserChange {
                locked: Some(true),
                ..UserChange::default()
            },
        ];
        for (name, change) in ["li", "wang"].into_iter().zip(changes) {
            let changed = access.change(|accounts| accounts.change_user(name, change));
            assert!(changed.await.is_ok());
        }
        drop(access);
        let again = opened(&folder.0);
        let unlock = UserChange {
            locked: Some(false),
            ..UserChange::default()
        };
        let unlocked = again.change(|accounts| accounts.change_user("wang", unlock));
        assert!(unlocked.await.is_ok());
        for secret in &cookies {
            let cookie = format!("{}={}", again.cookie_name, secret.expose());
            let caller = again.caller(&with("cookie", &cookie), None, HERE);
            assert_eq!(caller.role, None, "{}", caller.name);
        }
        // Who asks for another password himself stays logged in, also over a restart.
        let own = log_in(&again, "li", "battery staple").await.unwrap();
        let logins = again.logins_of("li").unwrap();
        let key = own.fingerprint();
        let changed = again.change_own_password(("li", &logins), hashed("staple"), &key);
        assert!(changed.await.is_ok());
        drop(again);
        let third = opened(&folder.0);
        let cookie = format!("{}={}", third.cookie_name, own.expose());
        let caller = third.caller(&with("cookie", &cookie), None, HERE);
        assert_eq!(caller.name, "li");
    }

    fn hashed(password: &str) -> Hashed {
        let hashed = password::hash(&Secret::new(password.to_owned()));
        hashed.unwrap_or_else(|problem| panic!("{problem:?}"))
    }

    /// Its connection is cut while it is written.
    #[tokio::test]
    async fn a_change_whose_asker_goes_away_is_whole() {
        let (access, folder) = access("gone").await;
        let session = log_in(&access, "wang", "correct horse").await.unwrap();
        let lock = UserChange {
            locked: Some(true),
            ..UserChange::default()
        };
        {
            let lock = |accounts: &mut Accounts| accounts.change_user("wang", lock);
            let change = access.change_and_end(Some(("wang", None)), lock);
            let mut context = std::task::Context::from_waker(std::task::Waker::noop());
            assert!(std::pin::pin!(change).poll(&mut context).is_pending());
        }
        // One after the other: the next one is done when that is.
        assert!(access.change(|_| Ok(())).await.is_ok());
        let on_disk = Store::look(&folder.0).unwrap_or_else(|problem| panic!("{problem:?}"));
        assert!(on_disk.user("wang").is_some_and(|user| user.locked));
        assert!(access.unlocked("wang").is_none());
        assert!(
            !access
                .sessions
                .lasts(&session.fingerprint(), Instant::now())
        );
    }

    /// An administrator gives another password, or locks, while the one that is asked for by who
    /// knew the old one is hashed.
    #[tokio::test]
    async fn a_password_under_way_undoes_no_reset_and_no_lock() {
        let (access, _folder) = access("reset").await;
        let reset = UserChange {
            password: Some(hashed("reset by li")),
            ..UserChange::default()
        };
        let lock = UserChange {
            locked: Some(true),
            ..UserChange::default()
        };
        for (password, change) in [("correct horse", reset), ("reset by li", lock)] {
            let own = log_in(&access, "wang", password)
                .await
                .unwrap()
                .fingerprint();
            let old = Secret::new(password.to_owned());
            let logins = access.confirm("wang", old, HERE).await;
            let logins = logins.unwrap_or_else(|problem| panic!("{problem:?}"));
            let changed = access.change(|accounts| accounts.change_user("wang", change));
            assert!(changed.await.is_ok());
            let before = access.password_of("wang");
            let new = hashed("of the thief");
            let late = access.change_own_password(("wang", &logins), new, &own);
            let refused = late.await.err().map(|problem| problem.code);
            assert_eq!(refused.as_deref(), Some("E0904"));
            assert!(access.password_of("wang") == before);
        }
    }

    #[tokio::test]
    async fn a_token_is_known_and_only_by_itself() {
        let (access, _folder) = access("token").await;
        let wish = TokenWish {
            name: "ci".to_owned(),
            role: Role::Operator,
            points: vec!["pump.*".to_owned()],
            days: 1,
        };
        let made = access.change(|accounts| accounts.add_token(wish, "li", Timestamp::now()));
        let Ok((_, secret)) = made.await else {
            panic!("it is made");
        };
        let bearer = |text: String| access.caller(&with("authorization", &text), None, HERE);
        let caller = bearer(format!("Bearer {}", secret.expose()));
        assert_eq!(caller.name, "token:ci");
        assert_eq!(caller.role, Some(Role::Operator));
        assert!(caller.may_write("oven.k1").is_err());
        for other in ["Bearer rb_0", "Bearer ", "", "Basic bGk6eA=="] {
            assert_eq!(bearer(other.to_owned()).role, None, "{other}");
        }
        let lost = format!("Token {}", secret.expose());
        assert_eq!(bearer(lost).role, None);
    }

    #[tokio::test]
    async fn what_was_changed_is_there_after_a_new_start() {
        let (access, folder) = access("restart").await;
        let removed = access.change(|accounts| accounts.remove_user("wang")).await;
        assert!(removed.is_ok());
        let refused = access.change(|accounts| accounts.remove_user("li")).await;
        assert!(refused.is_err(), "the last one");
        drop(access);
        let again = opened(&folder.0);
        assert_eq!(again.read(|accounts| accounts.users().len()), 1);
        assert!(!again.is_new());
    }
}
