//! Login sessions. They survive a restart of the daemon: their fingerprints, never their secrets,
//! are stored in the state folder.

use super::secret::{Fingerprint, Secret, fingerprint, hex, random};
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use railbus_store::durable;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// Its name in the state folder.
const NAME: &str = "sessions.json";
/// The largest size of the file: more than all sessions of all users need.
const LEN_MAX: u64 = 1 << 20;
/// The most sessions of all users together.
const ALL_MAX: usize = 64 * OF_USER_MAX;
/// A session that is not used for this long ends.
const IDLE_MAX: Duration = Duration::from_secs(12 * 3_600);
/// A session ends after this time in any case.
const AGE_MAX: Duration = Duration::from_secs(7 * 24 * 3_600);
/// The most sessions of a user; a new one ends the one that was unused for longest.
const OF_USER_MAX: usize = 8;
/// The use of sessions is stored no more often than this.
const NOTE_EVERY: Duration = Duration::from_secs(600);

/// One session.
#[derive(Debug)]
struct Session {
    id: String,
    user: String,
    /// The value of the user's record when it began.
    logins: String,
    address: String,
    /// When it began, or this process did; and how old it was then.
    since: Instant,
    aged: Duration,
    began_at: Timestamp,
    /// When it was last used, or this process started; and how long it had been idle then.
    used: Instant,
    rested: Duration,
    used_at: Timestamp,
}

impl Session {
    fn is_over(&self, now: Instant) -> bool {
        now.duration_since(self.used) + self.rested >= IDLE_MAX
            || now.duration_since(self.since) + self.aged >= AGE_MAX
    }
}

/// A session as stored in the file.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// The fingerprint of its secret.
    key: String,
    id: String,
    user: String,
    #[serde(default)]
    logins: String,
    address: String,
    began: Timestamp,
    used: Timestamp,
}

/// The file.
#[derive(Serialize, Deserialize)]
struct Text {
    /// What this daemon's cookies have in their name.
    cookie: String,
    sessions: Vec<Kept>,
}

/// A session as shown to administrators.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SessionInfo {
    pub(crate) id: String,
    pub(crate) user: String,
    pub(crate) address: String,
    pub(crate) began: String,
    pub(crate) used: String,
    /// It is the caller's.
    pub(crate) current: bool,
}

/// All sessions, by their fingerprints. There are at most as many as all users may have.
#[derive(Debug)]
pub(crate) struct Sessions {
    now: Mutex<Now>,
    cookie: String,
    path: PathBuf,
    /// Serialises writes of the file; nothing else waits for the disk.
    turn: Arc<tokio::sync::Mutex<()>>,
}

#[derive(Debug)]
struct Now {
    all: HashMap<Fingerprint, Session>,
    /// When they were last stored.
    noted: Instant,
}

impl Sessions {
    /// The valid sessions of a state folder, of users for whom `is_user` accepts what their
    /// sessions carry. A file that can't be read contains none: users log in again.
    pub(crate) fn open(
        folder: &Path,
        is_user: impl Fn(&str, &str) -> bool,
    ) -> Result<Sessions, Problem> {
        let path = folder.join(NAME);
        let now = Instant::now();
        let (cookie, kept) = match read(&path) {
            Some(text) => (text.cookie, text.sessions),
            None => {
                let number = random::<4>().map_err(failed)?;
                let text = Text {
                    cookie: hex(&number),
                    sessions: Vec::new(),
                };
                write(&path, &text)?;
                (text.cookie, text.sessions)
            }
        };
        let today = Timestamp::now();
        let is_ahead = kept.iter().any(|kept| kept.began.max(kept.used) > today);
        let kept = kept.into_iter().take(ALL_MAX);
        let all = kept
            .filter(|kept| is_user(&kept.user, &kept.logins))
            .filter_map(|kept| Some((unhex(&kept.key)?, begun_before(kept, now, today))))
            .filter(|(_, session)| !session.is_over(now));
        let all = all.collect();
        let sessions = Sessions {
            now: Mutex::new(Now { all, noted: now }),
            cookie,
            path,
            turn: Arc::default(),
        };
        if is_ahead {
            write(&sessions.path, &sessions.text())?;
        }
        Ok(sessions)
    }

    /// What this daemon's cookies have in their name, so that they differ from those of another
    /// daemon on the same host.
    pub(crate) fn cookie(&self) -> &str {
        &self.cookie
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Stores the sessions; returns when that is durable. A session that was ended has ended in any
    /// case, but without this only for as long as the process runs.
    pub(crate) async fn keep(&self) -> Result<(), Problem> {
        let turn = Arc::clone(&self.turn).lock_owned().await;
        let text = self.text();
        let path = self.path.clone();
        let kept = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            write(&path, &text)
        });
        kept.await
            .map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?
    }

    fn text(&self) -> Text {
        let mut now = self.now();
        now.noted = Instant::now();
        let sessions = now.all.iter().map(|(key, session)| Kept {
            key: hex(key),
            id: session.id.clone(),
            user: session.user.clone(),
            logins: session.logins.clone(),
            address: session.address.clone(),
            began: session.began_at,
            used: session.used_at,
        });
        Text {
            cookie: self.cookie.clone(),
            sessions: sessions.collect(),
        }
    }

    /// Whether it is time to store which of them are used.
    pub(crate) fn is_time_to_note(&self, at: Instant) -> bool {
        let mut now = self.now();
        let is_time = !now.all.is_empty() && at.duration_since(now.noted) >= NOTE_EVERY;
        if is_time {
            now.noted = at;
        }
        is_time
    }

    /// Begins a session of a user, with the value it has to carry; returns its secret.
    pub(crate) fn begin(
        &self,
        (user, logins): (&str, &str),
        address: &str,
        now: Instant,
    ) -> Result<Secret, Problem> {
        let secret = Secret::random("").map_err(failed)?;
        let at = Timestamp::now();
        let session = Session {
            id: hex(&random::<8>().map_err(failed)?),
            user: user.to_owned(),
            logins: logins.to_owned(),
            address: address.to_owned(),
            since: now,
            aged: Duration::ZERO,
            began_at: at,
            used: now,
            rested: Duration::ZERO,
            used_at: at,
        };
        let all = &mut self.now().all;
        all.retain(|_, session| !session.is_over(now));
        make_room(all, user);
        all.insert(secret.fingerprint(), session);
        Ok(secret)
    }

    /// The user of a session; counts as using it.
    pub(crate) fn user(&self, secret: &str, now: Instant) -> Option<(Fingerprint, String)> {
        let key = fingerprint(secret);
        let all = &mut self.now().all;
        let session = all.get_mut(&key)?;
        if session.is_over(now) {
            all.remove(&key);
            return None;
        }
        (session.used, session.rested) = (now, Duration::ZERO);
        session.used_at = Timestamp::now();
        Some((key, session.user.clone()))
    }

    /// Whether a session is still valid; does not count as using it.
    pub(crate) fn lasts(&self, key: &Fingerprint, now: Instant) -> bool {
        let all = &self.now().all;
        all.get(key).is_some_and(|session| !session.is_over(now))
    }

    /// Ends one session.
    pub(crate) fn end(&self, key: &Fingerprint) {
        let all = &mut self.now().all;
        all.remove(key);
    }

    /// Ends the session with this public id; returns whether there was one.
    pub(crate) fn end_by_id(&self, id: &str) -> bool {
        let all = &mut self.now().all;
        let before = all.len();
        all.retain(|_, session| session.id != id);
        all.len() < before
    }

    /// Ends all sessions of a user but one, which carries this value from now on.
    pub(crate) fn end_of_user(&self, (user, logins): (&str, &str), but: Option<&Fingerprint>) {
        let all = &mut self.now().all;
        all.retain(|key, session| session.user != user || Some(key) == but);
        for session in all.values_mut().filter(|session| session.user == user) {
            logins.clone_into(&mut session.logins);
        }
    }

    /// All valid sessions, the one used last first.
    pub(crate) fn list(&self, current: Option<&Fingerprint>, now: Instant) -> Vec<SessionInfo> {
        let all = &mut self.now().all;
        all.retain(|_, session| !session.is_over(now));
        let mut list: Vec<_> = all.iter().collect();
        list.sort_by_key(|(_, session)| std::cmp::Reverse(session.used));
        let info = |(key, session): (&Fingerprint, &Session)| SessionInfo {
            id: session.id.clone(),
            user: session.user.clone(),
            address: session.address.clone(),
            began: as_text(session.began_at),
            used: as_text(session.used_at),
            current: current == Some(key),
        };
        list.into_iter().map(info).collect()
    }
}

/// A stored session, on this process's clock. If the system clock was set back, nothing gets older,
/// and nothing begins later than now, so that the next start does not see that again.
fn begun_before(kept: Kept, now: Instant, today: Timestamp) -> Session {
    let ago = |at: Timestamp| Duration::try_from(today.duration_since(at)).unwrap_or_default();
    Session {
        id: kept.id,
        user: kept.user,
        logins: kept.logins,
        address: kept.address,
        since: now,
        aged: ago(kept.began),
        began_at: kept.began.min(today),
        used: now,
        rested: ago(kept.used),
        used_at: kept.used.min(today),
    }
}

fn read(path: &Path) -> Option<Text> {
    let mut text = String::new();
    let file = File::open(path).ok()?;
    file.take(LEN_MAX).read_to_string(&mut text).ok()?;
    serde_json::from_str(&text).ok()
}

fn write(path: &Path, text: &Text) -> Result<(), Problem> {
    let bytes = serde_json::to_vec(text).unwrap_or_default();
    durable::replace(path, &bytes, Some(0o600)).map_err(|error: io::Error| {
        Problem::new(codes::ACCOUNTS_FILE)
            .with("path", path.display().to_string())
            .with("reason", error.to_string())
    })
}

fn failed(error: getrandom::Error) -> Problem {
    Problem::new(codes::INTERNAL).with("reason", error.to_string())
}

/// Parses what [`hex`] made of a fingerprint.
fn unhex(text: &str) -> Option<Fingerprint> {
    let mut key = Fingerprint::default();
    if text.len() != 2 * key.len() || !text.is_ascii() {
        return None;
    }
    for (at, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * at..2 * at + 2)?, 16).ok()?;
    }
    Some(key)
}

/// A time as the API writes it.
pub(crate) fn as_text(at: Timestamp) -> String {
    format!("{at:.3}")
}

/// What a session's mutating requests have to carry, which only our own pages can know. It is
/// derived from the session's secret, and does not reveal it.
pub(crate) fn csrf(session: &str) -> String {
    hex(&fingerprint(&format!("railbus csrf {session}")))
}

/// Ends the session that its user has not used for longest, if there are too many.
fn make_room(all: &mut HashMap<Fingerprint, Session>, user: &str) {
    let of_user = || all.iter().filter(|(_, session)| session.user == user);
    if of_user().count() < OF_USER_MAX {
        return;
    }
    let oldest = of_user().min_by_key(|(_, session)| session.used);
    if let Some(key) = oldest.map(|(key, _)| *key) {
        all.remove(&key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sessions in a temporary folder.
    struct Here(Sessions, PathBuf);

    impl Here {
        fn new(name: &str) -> Here {
            let unique = format!("railbus-sessions-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(unique);
            std::fs::create_dir_all(&folder).unwrap();
            Here(Here::open(&folder), folder)
        }

        fn open(folder: &Path) -> Sessions {
            let sessions = Sessions::open(folder, |user, _| user != "gone");
            sessions.unwrap_or_else(|problem| panic!("{problem:?}"))
        }
    }

    impl Drop for Here {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.1);
        }
    }

    fn begin(sessions: &Sessions, user: &str, now: Instant) -> Secret {
        let begun = sessions.begin((user, ""), "127.0.0.1", now);
        begun.unwrap_or_else(|problem| panic!("{problem:?}"))
    }

    #[test]
    fn a_session_ends_when_idle_and_when_old() {
        let here = Here::new("over");
        let (sessions, start) = (&here.0, Instant::now());
        let secret = begin(sessions, "li", start);
        let user = |at| sessions.user(secret.expose(), at).map(|(_, user)| user);
        assert_eq!(user(start), Some("li".to_owned()));
        assert_eq!(sessions.user("", start), None);
        let mut now = start;
        while now + IDLE_MAX / 2 < start + AGE_MAX {
            now += IDLE_MAX / 2;
            assert!(user(now).is_some(), "{:?}", now - start);
        }
        assert_eq!(user(start + AGE_MAX), None, "however much it is used");
        let idle = begin(sessions, "li", start);
        assert_eq!(sessions.user(idle.expose(), start + IDLE_MAX), None);
        assert!(sessions.list(None, start).is_empty());
    }

    #[test]
    fn a_user_has_so_many_sessions_and_takes_none_of_others() {
        let here = Here::new("many");
        let (sessions, mut now) = (&here.0, Instant::now());
        let of_wang = begin(sessions, "wang", now);
        let mut of_li = Vec::new();
        for _ in 0..=OF_USER_MAX {
            now += Duration::from_secs(1);
            of_li.push(begin(sessions, "li", now));
        }
        assert!(sessions.user(of_li[0].expose(), now).is_none());
        assert!(sessions.user(of_li[1].expose(), now).is_some());
        assert!(sessions.user(of_wang.expose(), now).is_some());
        assert_eq!(sessions.list(None, now).len(), OF_USER_MAX + 1);
        let kept = of_li[3].fingerprint();
        sessions.end_of_user(("li", ""), Some(&kept));
        assert!(sessions.lasts(&kept, now));
        assert_eq!(sessions.list(Some(&kept), now).len(), 2);
        let id = &sessions.list(Some(&kept), now)[0].id.clone();
        assert!(sessions.end_by_id(id) && !sessions.end_by_id(id));
    }

    #[test]
    fn the_csrf_token_is_of_the_session_and_is_not_it() {
        assert_eq!(csrf("a"), csrf("a"));
        assert_ne!(csrf("a"), csrf("b"));
        assert_ne!(csrf("a"), hex(&fingerprint("a")));
    }

    #[tokio::test]
    async fn they_outlive_the_program_and_their_secrets_are_not_kept() {
        use std::os::unix::fs::PermissionsExt;
        let here = Here::new("kept");
        let (sessions, now) = (&here.0, Instant::now());
        let [one, other, gone] = ["li", "wang", "gone"].map(|user| begin(sessions, user, now));
        sessions.keep().await.unwrap();
        let file = here.1.join(NAME);
        let text = std::fs::read_to_string(&file).unwrap();
        for secret in [&one, &other, &gone] {
            assert!(!text.contains(secret.expose()), "{text}");
            assert!(!text.contains(&csrf(secret.expose())), "{text}");
        }
        let mode = std::fs::metadata(&file).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        let again = Here::open(&here.1);
        assert_eq!(again.cookie(), sessions.cookie());
        let user = |sessions: &Sessions, secret: &Secret| {
            let found = sessions.user(secret.expose(), Instant::now());
            found.map(|(_, user)| user)
        };
        assert_eq!(user(&again, &one).as_deref(), Some("li"));
        assert_eq!(user(&again, &gone), None, "its user is no more");
        again.end(&one.fingerprint());
        again.keep().await.unwrap();
        let third = Here::open(&here.1);
        assert_eq!(
            (user(&third, &one), user(&third, &other).is_some()),
            (None, true)
        );
        // Sessions that are too old have ended, and an invalid file contains none.
        let old = Timestamp::now() - jiff::SignedDuration::from_hours(13);
        let mut kept = third.text();
        kept.sessions.iter_mut().for_each(|kept| kept.used = old);
        write(&file, &kept).unwrap();
        assert!(Here::open(&here.1).list(None, Instant::now()).is_empty());
        // Nor does a session last anew at every start after the clock was set back.
        let ahead = Timestamp::now() + jiff::SignedDuration::from_hours(1_000);
        let mut kept = sessions.text();
        kept.sessions.iter_mut().for_each(|kept| kept.began = ahead);
        write(&file, &kept).unwrap();
        assert!(!Here::open(&here.1).list(None, Instant::now()).is_empty());
        let written = read(&file).unwrap().sessions;
        assert!(written.iter().all(|kept| kept.began <= Timestamp::now()));
        std::fs::write(&file, "{").unwrap();
        let fresh = Here::open(&here.1);
        assert!(fresh.list(None, Instant::now()).is_empty());
        assert_ne!(fresh.cookie(), sessions.cookie());
    }
}
