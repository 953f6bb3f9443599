//! Signing in over interfaces other than HTTP, whose connections last: who it is, and what they may
//! do from then on.

use super::gate::Gate;
use super::secret::{Secret, fingerprint, hex};
use super::tries::Who;
use jiff::Timestamp;
use railbus_api::problem::Problem;
use railbus_site::Rights;

/// How many digits of a fingerprint tell one password of a user from the next.
const TAG_LEN: usize = 16;

impl Gate {
    /// Signs a client in: by a token as the password, whatever the name, or by the name of a user
    /// and the password. Returns an identity of the account, which is invalid once the account is
    /// removed, locked, or has another password.
    ///
    /// # Errors
    /// Name or password is wrong, or there were too many tries for this account: its address is not
    /// known here.
    pub(crate) async fn sign_in(&self, name: &str, password: Secret) -> Result<String, Problem> {
        let now = Timestamp::now();
        let token = self.read(|accounts| {
            let token = accounts.token(password.expose(), now)?;
            Some(format!("token:{}", token.id))
        });
        if let Some(token) = token {
            return Ok(token);
        }
        // By address, clients that reconnect together would exhaust each other's tries.
        let whose = [Who::Account(name.to_owned())];
        let logins = self.confirm_for(name, password, &whose).await?;
        Ok(format!("user:{}:{name}", tag(&logins)))
    }

    /// The name for logs and the rights of an identity, as they are now; none where it may not do
    /// anything any more.
    pub(crate) fn signed_in(&self, identity: &str) -> Option<(String, Rights)> {
        let rights = |role, points: &[String]| Rights {
            role,
            points: points.into(),
        };
        if let Some(id) = identity.strip_prefix("token:") {
            return self.read(|accounts| {
                let token = accounts.token_by_id(id, Timestamp::now())?;
                let name = format!("token:{}", token.name);
                Some((name, rights(token.role, &token.points)))
            });
        }
        let (known, name) = identity.strip_prefix("user:")?.split_once(':')?;
        self.read(|accounts| {
            let user = accounts.user(name).filter(|user| !user.locked)?;
            let is_it = tag(&user.logins) == known;
            is_it.then(|| (user.name.clone(), rights(user.role, &user.points)))
        })
    }
}

/// What tells the sign-ins of one password from those of the next.
fn tag(logins: &str) -> String {
    let mut tag = hex(&fingerprint(logins));
    tag.truncate(TAG_LEN);
    tag
}
