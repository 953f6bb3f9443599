//! Who is logged in. Sessions live in memory: the end of the daemon ends them all.

use super::secret::{Fingerprint, Secret, fingerprint, hex, random};
use crate::api::problem::{Problem, codes};
use jiff::Timestamp;
use serde::Serialize;
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// A session nobody used for so long ends.
const IDLE_MAX: Duration = Duration::from_secs(12 * 3_600);
/// A session ends after so long in any case.
const AGE_MAX: Duration = Duration::from_secs(7 * 24 * 3_600);
/// So many sessions a user may have; a new one ends the one longest unused.
const OF_USER_MAX: usize = 8;

/// One session.
#[derive(Debug)]
struct Session {
    id: String,
    user: String,
    address: String,
    began: Instant,
    began_at: Timestamp,
    used: Instant,
    used_at: Timestamp,
}

impl Session {
    fn is_over(&self, now: Instant) -> bool {
        now.duration_since(self.used) >= IDLE_MAX || now.duration_since(self.began) >= AGE_MAX
    }
}

/// A session as administrators see it.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct SessionInfo {
    pub(crate) id: String,
    pub(crate) user: String,
    pub(crate) address: String,
    pub(crate) began: String,
    pub(crate) used: String,
    /// It is the one that asks.
    pub(crate) current: bool,
}

/// All sessions, by what their secrets are remembered by. There are at most as many as all users
/// may have.
#[derive(Debug, Default)]
pub(crate) struct Sessions(Mutex<HashMap<Fingerprint, Session>>);

impl Sessions {
    /// Begins a session; what comes back is its secret.
    pub(crate) fn begin(&self, user: &str, address: &str, now: Instant) -> Result<Secret, Problem> {
        let failed = |error: getrandom::Error| {
            Problem::new(codes::INTERNAL).with("reason", error.to_string())
        };
        let secret = Secret::random("").map_err(failed)?;
        let at = Timestamp::now();
        let session = Session {
            id: hex(&random::<8>().map_err(failed)?),
            user: user.to_owned(),
            address: address.to_owned(),
            began: now,
            began_at: at,
            used: now,
            used_at: at,
        };
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|_, session| !session.is_over(now));
        make_room(&mut all, user);
        all.insert(secret.fingerprint(), session);
        Ok(secret)
    }

    /// The user of a session, which is used by this.
    pub(crate) fn user(&self, secret: &str, now: Instant) -> Option<(Fingerprint, String)> {
        let key = fingerprint(secret);
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let session = all.get_mut(&key)?;
        if session.is_over(now) {
            all.remove(&key);
            return None;
        }
        (session.used, session.used_at) = (now, Timestamp::now());
        Some((key, session.user.clone()))
    }

    /// Whether a session still lasts; it is not used by this.
    pub(crate) fn lasts(&self, key: &Fingerprint, now: Instant) -> bool {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.get(key).is_some_and(|session| !session.is_over(now))
    }

    /// Ends one session.
    pub(crate) fn end(&self, key: &Fingerprint) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.remove(key);
    }

    /// Ends the session that administrators know by this; whether there was one.
    pub(crate) fn end_by_id(&self, id: &str) -> bool {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let before = all.len();
        all.retain(|_, session| session.id != id);
        all.len() < before
    }

    /// Ends all sessions of a user but one.
    pub(crate) fn end_of_user(&self, user: &str, but: Option<&Fingerprint>) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|key, session| session.user != user || Some(key) == but);
    }

    /// All that last, the one used last first.
    pub(crate) fn list(&self, current: Option<&Fingerprint>, now: Instant) -> Vec<SessionInfo> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
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

/// The time as the API writes it.
pub(crate) fn as_text(at: Timestamp) -> String {
    format!("{at:.3}")
}

/// What a session's mutating requests carry, which only pages of ours can know. It follows from
/// the session's secret, and does not lead back to it.
pub(crate) fn csrf(session: &str) -> String {
    hex(&fingerprint(&format!("railbus csrf {session}")))
}

/// Ends the session that its user has not used for the longest time, where there are too many.
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

    fn begin(sessions: &Sessions, user: &str, now: Instant) -> Secret {
        let begun = sessions.begin(user, "127.0.0.1", now);
        begun.unwrap_or_else(|problem| panic!("{problem:?}"))
    }

    #[test]
    fn a_session_ends_when_idle_and_when_old() {
        let (sessions, start) = (Sessions::default(), Instant::now());
        let secret = begin(&sessions, "li", start);
        let user = |at| sessions.user(secret.expose(), at).map(|(_, user)| user);
        assert_eq!(user(start), Some("li".to_owned()));
        assert_eq!(sessions.user("", start), None);
        let mut now = start;
        while now + IDLE_MAX / 2 < start + AGE_MAX {
            now += IDLE_MAX / 2;
            assert!(user(now).is_some(), "{:?}", now - start);
        }
        assert_eq!(user(start + AGE_MAX), None, "however much it is used");
        let idle = begin(&sessions, "li", start);
        assert_eq!(sessions.user(idle.expose(), start + IDLE_MAX), None);
        assert!(sessions.list(None, start).is_empty());
    }

    #[test]
    fn a_user_has_so_many_sessions_and_takes_none_of_others() {
        let (sessions, mut now) = (Sessions::default(), Instant::now());
        let of_wang = begin(&sessions, "wang", now);
        let mut of_li = Vec::new();
        for _ in 0..=OF_USER_MAX {
            now += Duration::from_secs(1);
            of_li.push(begin(&sessions, "li", now));
        }
        assert!(sessions.user(of_li[0].expose(), now).is_none());
        assert!(sessions.user(of_li[1].expose(), now).is_some());
        assert!(sessions.user(of_wang.expose(), now).is_some());
        assert_eq!(sessions.list(None, now).len(), OF_USER_MAX + 1);
        let kept = of_li[3].fingerprint();
        sessions.end_of_user("li", Some(&kept));
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
}
