//! Passwords: Argon2id, which takes time and memory on purpose, and is limited so that it can't be
//! used to overload the daemon.

use super::secret::{Secret, random};
use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use argon2::{Algorithm, Argon2, Params, Version};
use railbus_api::problem::{Problem, codes};
use std::sync::Arc;
use tokio::sync::Semaphore;

/// Memory of one run, in KiB.
const MEMORY: u32 = 19 << 10;
/// The number of passes over the memory.
const PASSES: u32 = 2;
/// How many run at once: 38 MiB and two cores at most.
const RUNNING_MAX: usize = 2;
/// How many run or wait; more are refused at once.
const WAITING_MAX: usize = 16;
/// The shortest password in characters and the longest in bytes.
const LETTERS_MIN: usize = 10;
const BYTES_MAX: usize = 256;
/// What a password is compared with if there is no such user, so that it takes the same time.
const NOBODY: &str = "$argon2id$v=19$m=19456,t=2,p=1$cmFpbGJ1cy1ub2JvZHkhIQ$\
                      AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA";

/// A stored password: its hash with salt and costs.
#[derive(Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub(crate) struct Hashed(String);

fn argon() -> Argon2<'static> {
    // These are the defaults, so this can't fail.
    let costs = Params::new(MEMORY, PASSES, 1, None).unwrap_or_default();
    Argon2::new(Algorithm::Argon2id, Version::V0x13, costs)
}

/// Refuses passwords that are easy to guess or too long.
pub(crate) fn check(name: &str, password: &Secret) -> Result<(), Problem> {
    let text = password.expose();
    let weak = |why: &str| Err(Problem::new(codes::WEAK_PASSWORD).with("why_weak", why));
    if text.chars().count() < LETTERS_MIN {
        return weak("short").map_err(|weak| weak.with("letters_min", LETTERS_MIN));
    }
    if text.len() > BYTES_MAX {
        return weak("long").map_err(|weak| weak.with("bytes_max", BYTES_MAX));
    }
    let first = text.chars().next();
    if text.chars().all(|letter| Some(letter) == first) || text.eq_ignore_ascii_case(name) {
        return weak("simple");
    }
    Ok(())
}

/// Hashes a password, which takes tens of milliseconds.
pub(crate) fn hash(password: &Secret) -> Result<Hashed, Problem> {
    let failed = |why: String| Problem::new(codes::INTERNAL).with("reason", why);
    let salt = random::<16>().map_err(|error| failed(error.to_string()))?;
    let hash = argon().hash_password_with_salt(password.expose().as_bytes(), &salt);
    let hash = hash.map_err(|error| failed(error.to_string()))?;
    Ok(Hashed(hash.to_string()))
}

/// Whether this is the password; false, but after the same time, if there is no user.
fn is_right(password: &Secret, of_user: Option<&Hashed>) -> bool {
    let hash = of_user.map_or(NOBODY, |hashed| &hashed.0);
    let fits = argon().verify_password(password.expose().as_bytes(), hash);
    of_user.is_some() && fits.is_ok()
}

/// Hashes passwords outside the daemon's own thread.
#[derive(Debug)]
pub(crate) struct Hashers {
    running: Arc<Semaphore>,
    waiting: Semaphore,
}

impl Hashers {
    pub(crate) fn new() -> Hashers {
        Hashers {
            running: Arc::new(Semaphore::new(RUNNING_MAX)),
            waiting: Semaphore::new(WAITING_MAX),
        }
    }

    /// Hashes a password.
    pub(crate) async fn hash(&self, password: Secret) -> Result<Hashed, Problem> {
        self.run(move || hash(&password)).await?
    }

    /// Whether this is the user's password, if there is such a user. Returns the password.
    pub(crate) async fn is_right(
        &self,
        password: Secret,
        of_user: Option<Hashed>,
    ) -> Result<bool, Problem> {
        self.run(move || is_right(&password, of_user.as_ref()))
            .await
    }

    async fn run<T: Send + 'static>(
        &self,
        job: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let full = || Problem::new(codes::OVERLOADED);
        let _seat = self.waiting.try_acquire().map_err(|_| full())?;
        let running = Arc::clone(&self.running).acquire_owned().await;
        let running = running.map_err(|_| full())?;
        let done = tokio::task::spawn_blocking(move || {
            let done = job();
            // Released when the work is done, not when its caller has given up.
            drop(running);
            done
        });
        let broken = |error: tokio::task::JoinError| {
            Problem::new(codes::INTERNAL).with("reason", error.to_string())
        };
        done.await.map_err(broken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn secret(text: &str) -> Secret {
        Secret::new(text.to_owned())
    }

    #[test]
    fn a_password_fits_its_own_hash_only() {
        let password = secret("correct horse");
        let hashed = hash(&password).unwrap_or_else(|_| panic!("it hashes"));
        assert!(hashed.0.starts_with("$argon2id$v=19$m=19456,t=2,p=1$"));
        assert!(is_right(&password, Some(&hashed)));
        assert!(!is_right(&secret("correct horsf"), Some(&hashed)));
        assert!(!is_right(&password, None));
        let again = hash(&password).unwrap_or_else(|_| panic!("it hashes"));
        assert!(again != hashed, "each has a salt of its own");
    }

    #[test]
    fn the_hash_of_nobody_is_worked_through_as_any_other() {
        let error = argon().verify_password(b"any", NOBODY);
        let wrong = argon2::password_hash::Error::PasswordInvalid;
        assert_eq!(error, Err(wrong), "it must not be refused before the work");
    }

    #[test]
    fn weak_passwords_are_refused() {
        for weak in ["", "short", "123456789", "aaaaaaaaaaaa", "Administrator"] {
            assert!(check("administrator", &secret(weak)).is_err(), "{weak}");
        }
        assert!(check("li", &secret(&"x1".repeat(200))).is_err());
        assert!(check("li", &secret("correct horse")).is_ok());
        assert!(check("li", &secret("一二三四五六七八九十")).is_ok());
    }

    #[tokio::test]
    async fn no_more_than_two_hash_at_once_and_a_crowd_is_sent_away() {
        let hashers = Arc::new(Hashers::new());
        let (open, gate) = std::sync::mpsc::channel::<()>();
        let gate = Arc::new(std::sync::Mutex::new(gate));
        let most = Arc::new(std::sync::atomic::AtomicUsize::new(0));
        let mut jobs = Vec::new();
        for _ in 0..WAITING_MAX {
            let (hashers, gate, most) = (hashers.clone(), gate.clone(), most.clone());
            jobs.push(tokio::spawn(async move {
                let running = hashers.running.clone();
                let job = move || {
                    let now = RUNNING_MAX - running.available_permits();
                    most.fetch_max(now, std::sync::atomic::Ordering::Relaxed);
                    let _ = gate.lock().map(|gate| gate.recv());
                };
                hashers.run(job).await
            }));
        }
        while hashers.waiting.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        let refused = hashers.run(|| ()).await;
        assert_eq!(refused.map_err(|problem| problem.code), Err("E0105".into()));
        drop(open);
        for job in jobs {
            job.await.unwrap().unwrap();
        }
        assert_eq!(most.load(std::sync::atomic::Ordering::Relaxed), RUNNING_MAX);
    }
}
