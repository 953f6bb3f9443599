//! Users and tokens, and the rules for changing them. Stored by [`super::store`].

use super::password::Hashed;
use super::secret::{Secret, fingerprint, hex, random};
use super::sessions::as_text;
use super::{Role, RoleSchema};
use jiff::Timestamp;
use railbus_api::problem::{Problem, codes};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use utoipa::ToSchema;

/// The most users, tokens, and patterns of one of them.
const USERS_MAX: usize = 64;
const TOKENS_MAX: usize = 64;
const PATTERNS_MAX: usize = 32;
/// The longest name in characters, and the longest pattern.
const NAME_MAX: usize = 32;
const PATTERN_MAX: usize = 65;
/// The longest life of a token, in days.
const DAYS_MAX: u32 = 3_650;
/// The prefix of every token, by which people and scanners recognise it.
const TOKEN_PREFIX: &str = "rb_";
/// Names that logs use for others.
const RESERVED: [&str; 2] = ["owner", "local"];

/// A user as stored.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct User {
    pub(crate) name: String,
    pub(crate) role: Role,
    #[serde(default)]
    pub(crate) points: Vec<String>,
    pub(crate) password: Hashed,
    #[serde(default)]
    pub(crate) locked: bool,
    /// The preferred language.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) lang: Option<String>,
    /// A value that the user's sessions have to carry. A new password or a lock replaces it in the
    /// same write, so all earlier sessions become invalid, whatever is left of them.
    #[serde(default)]
    pub(crate) logins: String,
    pub(crate) created: Timestamp,
}

/// A token as stored: its fingerprint, never the token.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Token {
    pub(crate) id: String,
    pub(crate) name: String,
    pub(crate) role: Role,
    #[serde(default)]
    pub(crate) points: Vec<String>,
    sha256: String,
    pub(crate) by: String,
    pub(crate) created: Timestamp,
    pub(crate) expires: Timestamp,
}

/// A user as shown to those who may see it.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub(crate) struct UserInfo {
    pub(crate) name: String,
    #[schema(value_type = RoleSchema)]
    pub(crate) role: Role,
    pub(crate) points: Vec<String>,
    pub(crate) locked: bool,
    pub(crate) created: String,
}

/// A token as shown to those who may see it.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub(crate) struct TokenInfo {
    pub(crate) id: String,
    pub(crate) name: String,
    #[schema(value_type = RoleSchema)]
    pub(crate) role: Role,
    pub(crate) points: Vec<String>,
    pub(crate) by: String,
    pub(crate) created: String,
    pub(crate) expires: String,
    /// It has expired.
    pub(crate) expired: bool,
}

/// Changes to a user; missing fields stay as they are.
#[derive(Default)]
pub(crate) struct UserChange {
    pub(crate) role: Option<Role>,
    pub(crate) points: Option<Vec<String>>,
    pub(crate) password: Option<Hashed>,
    pub(crate) locked: Option<bool>,
}

/// A token to create.
pub(crate) struct TokenWish {
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) points: Vec<String>,
    pub(crate) days: u32,
}

/// All users and tokens.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Accounts {
    schema: u8,
    users: Vec<User>,
    tokens: Vec<Token>,
}

impl Default for Accounts {
    fn default() -> Accounts {
        Accounts {
            schema: 1,
            users: Vec::new(),
            tokens: Vec::new(),
        }
    }
}

impl Accounts {
    /// Whether there are no users yet.
    pub(crate) const fn is_empty(&self) -> bool {
        self.users.is_empty()
    }

    pub(crate) fn users(&self) -> Vec<UserInfo> {
        self.users.iter().map(User::info).collect()
    }

    pub(crate) fn tokens(&self, now: Timestamp) -> Vec<TokenInfo> {
        self.tokens.iter().map(|token| token.info(now)).collect()
    }

    pub(crate) fn user(&self, name: &str) -> Option<&User> {
        self.users.iter().find(|user| user.name == name)
    }

    /// The token with this text, if it is valid.
    pub(crate) fn token(&self, presented: &str, now: Timestamp) -> Option<&Token> {
        let sha256 = hex(&fingerprint(presented));
        let token = self.tokens.iter().find(|token| token.sha256 == sha256)?;
        token.is_good(now).then_some(token)
    }

    /// The token of this id, if it is valid.
    pub(crate) fn token_by_id(&self, id: &str, now: Timestamp) -> Option<&Token> {
        let token = self.tokens.iter().find(|token| token.id == id)?;
        token.is_good(now).then_some(token)
    }

    /// Adds a user; the first one has to be an administrator.
    pub(crate) fn add_user(&mut self, user: User) -> Result<UserInfo, Problem> {
        check_name(&user.name)?;
        check_points(&user.points)?;
        if self.user(&user.name).is_some() {
            return Err(Problem::new(codes::NAME_TAKEN).with("name", user.name));
        }
        if self.users.len() >= USERS_MAX {
            return Err(Problem::new(codes::TOO_MANY).with("most", USERS_MAX));
        }
        let info = user.info();
        self.users.push(user);
        self.needs_an_admin()?;
        Ok(info)
    }

    /// Changes a user.
    pub(crate) fn change_user(
        &mut self,
        name: &str,
        change: UserChange,
    ) -> Result<UserInfo, Problem> {
        check_points(change.points.as_deref().unwrap_or_default())?;
        let user = self.users.iter_mut().find(|user| user.name == name);
        let user = user.ok_or_else(|| no_such_user(name))?;
        let UserChange {
            role,
            points,
            password,
            locked,
        } = change;
        if password.is_some() || locked == Some(true) {
            user.logins = new_logins()?;
        }
        user.role = role.unwrap_or(user.role);
        user.locked = locked.unwrap_or(user.locked);
        if let Some(points) = points {
            user.points = points;
        }
        if let Some(password) = password {
            user.password = password;
        }
        let info = user.info();
        self.needs_an_admin()?;
        Ok(info)
    }

    /// Removes a user.
    pub(crate) fn remove_user(&mut self, name: &str) -> Result<(), Problem> {
        let before = self.users.len();
        self.users.retain(|user| user.name != name);
        if self.users.len() == before {
            return Err(no_such_user(name));
        }
        self.needs_an_admin()
    }

    /// At least one account must remain that can manage permissions. Otherwise the caller discards
    /// the change.
    fn needs_an_admin(&self) -> Result<(), Problem> {
        let is_admin = |user: &User| user.role == Role::Admin && !user.locked;
        match self.users.iter().any(is_admin) {
            true => Ok(()),
            false => Err(Problem::new(codes::LAST_ADMIN)),
        }
    }

    /// Adds a token; the token itself is returned only this once.
    pub(crate) fn add_token(
        &mut self,
        wish: TokenWish,
        by: &str,
        now: Timestamp,
    ) -> Result<(TokenInfo, Secret), Problem> {
        check_name(&wish.name)?;
        check_points(&wish.points)?;
        if self.tokens.iter().any(|token| token.name == wish.name) {
            return Err(Problem::new(codes::NAME_TAKEN).with("name", wish.name));
        }
        self.tokens.retain(|token| token.is_good(now));
        if self.tokens.len() >= TOKENS_MAX {
            return Err(Problem::new(codes::TOO_MANY).with("most", TOKENS_MAX));
        }
        if !(1..=DAYS_MAX).contains(&wish.days) {
            let problem = Problem::new(codes::BAD_REQUEST);
            return Err(problem.with("reason", "expires_days is 1 to 3650"));
        }
        let failed = |error: getrandom::Error| {
            Problem::new(codes::INTERNAL).with("reason", error.to_string())
        };
        let life = Duration::from_secs(u64::from(wish.days) * 24 * 3_600);
        let secret = Secret::random(TOKEN_PREFIX).map_err(failed)?;
        let token = Token {
            id: hex(&random::<8>().map_err(failed)?),
            name: wish.name,
            role: wish.role,
            points: wish.points,
            sha256: hex(&secret.fingerprint()),
            by: by.to_owned(),
            created: now,
            expires: now.saturating_add(life).unwrap_or(Timestamp::MAX),
        };
        let info = token.info(now);
        self.tokens.push(token);
        Ok((info, secret))
    }

    /// Removes a token, by its id or its name.
    pub(crate) fn remove_token(&mut self, named: &str) -> Result<(), Problem> {
        let before = self.tokens.len();
        self.tokens
            .retain(|token| token.id != named && token.name != named);
        match self.tokens.len() < before {
            true => Ok(()),
            false => Err(Problem::new(codes::NO_SUCH_TOKEN).with("name", named)),
        }
    }
}

/// A new value that no session carries yet.
pub(crate) fn new_logins() -> Result<String, Problem> {
    let number = random::<8>();
    let number =
        number.map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?;
    Ok(hex(&number))
}

impl User {
    fn info(&self) -> UserInfo {
        UserInfo {
            name: self.name.clone(),
            role: self.role,
            points: self.points.clone(),
            locked: self.locked,
            created: as_text(self.created),
        }
    }
}

impl Token {
    fn is_good(&self, now: Timestamp) -> bool {
        now < self.expires
    }

    fn info(&self, now: Timestamp) -> TokenInfo {
        TokenInfo {
            id: self.id.clone(),
            name: self.name.clone(),
            role: self.role,
            points: self.points.clone(),
            by: self.by.clone(),
            created: as_text(self.created),
            expires: as_text(self.expires),
            expired: !self.is_good(now),
        }
    }
}

pub(crate) fn no_such_user(name: &str) -> Problem {
    Problem::new(codes::NO_SUCH_USER).with("name", name)
}

/// Names in any script, without anything that could be mistaken for something else in a log.
fn check_name(name: &str) -> Result<(), Problem> {
    let letters = name.chars().count();
    let begins = name.chars().next().is_some_and(char::is_alphanumeric);
    let allowed = |letter: char| letter.is_alphanumeric() || "._-@".contains(letter);
    if !begins || letters > NAME_MAX || !name.chars().all(allowed) || RESERVED.contains(&name) {
        return Err(Problem::new(codes::BAD_NAME).with("name", name));
    }
    Ok(())
}

/// Whether this can select points.
pub(crate) fn is_selector(pattern: &str) -> bool {
    let allowed = |letter: char| letter.is_ascii_alphanumeric() || "_.*?".contains(letter);
    (1..=PATTERN_MAX).contains(&pattern.len()) && pattern.chars().all(allowed)
}

fn check_points(points: &[String]) -> Result<(), Problem> {
    if points.len() > PATTERNS_MAX || !points.iter().all(|pattern| is_selector(pattern)) {
        return Err(Problem::new(codes::BAD_POINTS).with("most", PATTERNS_MAX));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn user(name: &str, role: Role) -> User {
        let hashed = serde_json::from_str("\"$argon2id$\"");
        User {
            name: name.to_owned(),
            role,
            points: Vec::new(),
            password: hashed.unwrap_or_else(|_| panic!("a hash")),
            locked: false,
            lang: None,
            logins: String::new(),
            created: Timestamp::UNIX_EPOCH,
        }
    }

    fn wish(name: &str, days: u32) -> TokenWish {
        TokenWish {
            name: name.to_owned(),
            role: Role::Operator,
            points: vec!["pump.*".to_owned()],
            days,
        }
    }

    fn code<T>(result: Result<T, Problem>) -> String {
        result.err().map(|problem| problem.code).unwrap_or_default()
    }

    #[test]
    fn names_are_of_people_and_never_twice() {
        let mut accounts = Accounts::default();
        for name in ["li", "李工", "a.b-c_d@e", "9"] {
            assert_eq!(
                code(accounts.add_user(user(name, Role::Admin))),
                "",
                "{name}"
            );
        }
        assert_eq!(code(accounts.add_user(user("li", Role::Viewer))), "E0911");
        let long = "x".repeat(33);
        for name in [
            "", "owner", "local", "a b", "a\nb", "a:b", "-a", "a/b", &long,
        ] {
            let refused = code(accounts.add_user(user(name, Role::Admin)));
            assert_eq!(refused, "E0920", "{name:?}");
        }
    }

    #[test]
    fn one_admin_is_always_left() {
        let mut accounts = Accounts::default();
        let nobody_yet = accounts.clone().add_user(user("wang", Role::Viewer));
        assert_eq!(code(nobody_yet), "E0912");
        let _ = accounts.add_user(user("li", Role::Admin));
        let _ = accounts.add_user(user("wang", Role::Viewer));
        let lock = || UserChange {
            locked: Some(true),
            ..UserChange::default()
        };
        let demote = UserChange {
            role: Some(Role::Engineer),
            ..UserChange::default()
        };
        assert_eq!(code(accounts.clone().change_user("li", lock())), "E0912");
        assert_eq!(code(accounts.clone().change_user("li", demote)), "E0912");
        assert_eq!(code(accounts.clone().remove_user("li")), "E0912");
        assert_eq!(code(accounts.clone().remove_user("zhao")), "E0910");
        assert_eq!(code(accounts.change_user("wang", lock())), "");
        assert!(accounts.user("wang").is_some_and(|user| user.locked));
    }

    #[test]
    fn a_token_is_good_until_its_day_and_is_not_kept_itself() {
        let (mut accounts, now) = (Accounts::default(), Timestamp::UNIX_EPOCH);
        let Ok((info, secret)) = accounts.add_token(wish("ci", 1), "li", now) else {
            panic!("it is made");
        };
        let hours = |hours: i64| now + jiff::SignedDuration::from_hours(hours);
        assert!(accounts.token(secret.expose(), hours(23)).is_some());
        assert!(accounts.token(secret.expose(), hours(24)).is_none());
        assert!(accounts.token("rb_other", now).is_none());
        assert!(accounts.token_by_id(&info.id, now).is_some());
        let kept = serde_json::to_string(&accounts).unwrap();
        assert!(!kept.contains(secret.expose()), "{kept}");
        assert_eq!(code(accounts.add_token(wish("ci", 1), "li", now)), "E0911");
        assert_eq!(code(accounts.add_token(wish("b", 0), "li", now)), "E0806");
        assert_eq!(code(accounts.remove_token("nope")), "E0914");
        assert_eq!(code(accounts.remove_token("ci")), "");
        assert!(accounts.token(secret.expose(), now).is_none());
    }

    #[test]
    fn there_are_bounds() {
        let (mut accounts, now) = (Accounts::default(), Timestamp::UNIX_EPOCH);
        for number in 0..USERS_MAX {
            let added = accounts.add_user(user(&number.to_string(), Role::Admin));
            assert_eq!(code(added), "");
        }
        assert_eq!(code(accounts.add_user(user("more", Role::Viewer))), "E0915");
        for number in 0..TOKENS_MAX {
            let wish = wish(&number.to_string(), 1);
            assert_eq!(code(accounts.add_token(wish, "li", now)), "");
        }
        assert_eq!(
            code(accounts.add_token(wish("more", 1), "li", now)),
            "E0915"
        );
        let patterns = UserChange {
            points: Some(vec!["pump.do0; rm".to_owned()]),
            ..UserChange::default()
        };
        assert_eq!(code(accounts.change_user("1", patterns)), "E0921");
    }
}
