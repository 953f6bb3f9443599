//! Who a client is, and what it may do.

use async_trait::async_trait;
use opcua::crypto::SecurityPolicy;
use opcua::server::ServerEndpoint;
use opcua::server::address_space::AccessLevel;
use opcua::server::authenticator::{
    AuthManager, Password, UserToken, user_pass_security_policy_id,
};
use opcua::types::{
    Error, Identifier, NodeId, StatusCode, UAString, UserTokenPolicy, UserTokenType,
};
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

    fn effective_user_access_level(
        &self,
        token: &UserToken,
        level: AccessLevel,
        node: &NodeId,
    ) -> AccessLevel {
        let may_switch = || {
            let Identifier::String(path) = &node.identifier else {
                return None;
            };
            let (module, label) = path.as_ref().split_once('.')?;
            let user = self.users.user(&token.0)?;
            user.rights.may_switch(module, label).ok()
        };
        match level.contains(AccessLevel::CURRENT_WRITE) && may_switch().is_none() {
            true => level.difference(AccessLevel::CURRENT_WRITE),
            false => level,
        }
    }

    fn is_user_executable(&self, token: &UserToken, _: &NodeId) -> bool {
        let user = self.users.user(&token.0);
        user.is_some_and(|user| user.rights.may_command().is_ok())
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

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_site::Role;

    /// Whose identity is the name of its role; limited to one output.
    struct Roles;

    impl OpcuaUsers for Roles {
        fn sign_in<'a>(&'a self, _: &'a str, _: String) -> SignIn<'a> {
            Box::pin(async { None })
        }

        fn user(&self, identity: &str) -> Option<OpcuaUser> {
            let role = match identity {
                "operator" => Role::Operator,
                "viewer" => Role::Viewer,
                _ => return None,
            };
            Some(OpcuaUser {
                name: identity.to_owned(),
                rights: Rights {
                    role,
                    points: Arc::new(["oven.k1".to_owned()]),
                },
            })
        }
    }

    #[test]
    fn each_user_sees_what_it_may_switch() {
        let login = Login {
            users: Arc::new(Roles),
            allows_anonymous: false,
        };
        let all = AccessLevel::CURRENT_READ | AccessLevel::CURRENT_WRITE;
        for (identity, output, may_write) in [
            ("operator", "oven.k1", true),
            ("operator", "oven.k2", false),
            ("viewer", "oven.k1", false),
            ("nobody", "oven.k1", false),
        ] {
            let (token, node) = (UserToken(identity.to_owned()), NodeId::new(2, output));
            let level = login.effective_user_access_level(&token, all, &node);
            let expected = match may_write {
                true => all,
                false => AccessLevel::CURRENT_READ,
            };
            assert_eq!(level.bits(), expected.bits(), "{identity}, {output}");
            let method = NodeId::new(2, "oven/Pulse");
            let may_call = login.is_user_executable(&token, &method);
            assert_eq!(may_call, identity == "operator", "{identity}");
        }
    }
}
