//! Who a client is, and what it may do.

use async_trait::async_trait;
use opcua::crypto::SecurityPolicy;
use opcua::server::ServerEndpoint;
use opcua::server::authenticator::{
    AuthManager, Password, UserToken, user_pass_security_policy_id,
};
use opcua::types::{Error, StatusCode, UAString, UserTokenPolicy, UserTokenType};
use railbus_site::Rights;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

/// The user that everybody is who does not sign in.
pub const ANONYMOUS: &str = opcua::server::ANONYMOUS_USER_TOKEN_ID;
/// The policy of clients that do not sign in, as the library has it.
const ANONYMOUS_POLICY: &str = "anonymous";

/// A client of the server, as its accounts have it now.
#[derive(Clone, Debug)]
pub struct OpcuaUser {
    /// The name for logs.
    pub name: String,
    /// What it may do.
    pub rights: Rights,
}

/// The end of signing in: the identity of the user, or none if it is refused.
pub type SignIn<'a> = Pin<Box<dyn Future<Output = Option<String>> + Send + 'a>>;

/// The accounts of the daemon.
pub trait OpcuaUsers: Send + Sync {
    /// Signs a user in. The identity is what [`OpcuaUsers::user`] gets from then on.
    fn sign_in<'a>(&'a self, name: &'a str, password: String) -> SignIn<'a>;

    /// The user of this identity; none where it may no longer do anything.
    fn user(&self, identity: &str) -> Option<OpcuaUser>;
}

/// Asks the accounts for the library.
pub(crate) struct Login {
    pub(crate) users: Arc<dyn OpcuaUsers>,
    pub(crate) allows_anonymous: bool,
}

#[async_trait]
impl AuthManager for Login {
    async fn authenticate_anonymous_token(&self, _: &ServerEndpoint) -> Result<(), Error> {
        match self.allows_anonymous {
            true => Ok(()),
            false => Err(refused()),
        }
    }

    async fn authenticate_username_identity_token(
        &self,
        _: &ServerEndpoint,
        username: &str,
        password: &Password,
    ) -> Result<UserToken, Error> {
        let signed_in = self.users.sign_in(username, password.get().to_owned());
        signed_in.await.map(UserToken).ok_or_else(refused)
    }

    fn user_token_policies(&self, endpoint: &ServerEndpoint) -> Vec<UserTokenPolicy> {
        let policy = |policy_id, token_type| UserTokenPolicy {
            policy_id,
            token_type,
            issued_token_type: UAString::null(),
            issuer_endpoint_url: UAString::null(),
            security_policy_uri: UAString::null(),
        };
        let anonymous = policy(ANONYMOUS_POLICY.into(), UserTokenType::Anonymous);
        let named = policy(
            user_pass_security_policy_id(endpoint),
            UserTokenType::UserName,
        );
        let mut policies = vec![named];
        if self.allows_anonymous {
            policies.push(anonymous);
        }
        policies
    }
}

/// The same for a wrong name and a wrong password.
fn refused() -> Error {
    Error::new(StatusCode::BadIdentityTokenRejected, "not signed in")
}

/// The endpoints of a server: with security, and for this machine alone also without.
pub(crate) fn endpoints(is_for_here: bool) -> Vec<(&'static str, ServerEndpoint)> {
    let encrypted = |policy| {
        ServerEndpoint::new(
            PATH,
            policy,
            opcua::types::MessageSecurityMode::SignAndEncrypt,
            &[],
        )
    };
    let mut endpoints = vec![
        (
            "aes256_sha256_rsapss",
            encrypted(SecurityPolicy::Aes256Sha256RsaPss),
        ),
        ("basic256sha256", encrypted(SecurityPolicy::Basic256Sha256)),
    ];
    if is_for_here {
        endpoints.push(("none", ServerEndpoint::new_none(PATH, &[])));
    }
    endpoints
}

/// The path of all endpoints.
const PATH: &str = "/";
