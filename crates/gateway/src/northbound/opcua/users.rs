//! Clients of the server as accounts of the daemon.

use crate::access::secret::Secret;
use crate::access::{Gate, note_login};
use railbus_opcua::{ANONYMOUS, OpcuaUser, OpcuaUsers, SignIn};
use railbus_site::{Rights, Role, Service};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How late it may be noticed that a token is no longer valid, which nothing tells.
const LATE: Duration = Duration::from_secs(60);

/// Who may use the server.
pub(super) struct OutletUsers {
    accounts: Arc<Gate>,
    service: Service,
    /// What they come by, as logs have it.
    via: String,
    allows_anonymous: bool,
    /// Those who signed in. There are no more than accounts.
    signed_in: Mutex<BTreeSet<String>>,
}

impl OutletUsers {
    pub(super) fn new(
        accounts: &Arc<Gate>,
        service: &Service,
        via: &str,
        allows_anonymous: bool,
    ) -> OutletUsers {
        OutletUsers {
            accounts: Arc::clone(accounts),
            service: service.clone(),
            via: via.to_owned(),
            allows_anonymous,
            signed_in: Mutex::default(),
        }
    }

    fn identities(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.signed_in
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns once a session's account may do nothing any more: its subscriptions must end.
    pub(super) async fn revoked(&self) {
        let mut changes = self.accounts.follow_changes();
        loop {
            let lasts = |identity: &String| self.accounts.signed_in(identity).is_some();
            if !self.identities().iter().all(lasts) {
                return;
            }
            // The accounts live as long as this; a time that is up is looked at again.
            let _ = tokio::time::timeout(LATE, changes.changed()).await;
        }
    }
}

impl OpcuaUsers for OutletUsers {
    fn sign_in<'a>(&'a self, name: &'a str, password: String) -> SignIn<'a> {
        Box::pin(async move {
            let end = self.accounts.sign_in(name, Secret::new(password)).await;
            let known = end.as_ref().ok().and_then(|identity| self.user(identity));
            let told = known.as_ref().map_or(name, |user| &user.name);
            let refused = end.as_ref().err();
            let events = Some(&self.service);
            note_login((&self.accounts, events), Some(told), &self.via, refused);
            let identity = end.ok()?;
            self.identities().insert(identity.clone());
            Some(identity)
        })
    }

    fn user(&self, identity: &str) -> Option<OpcuaUser> {
        if identity == ANONYMOUS {
            return self.allows_anonymous.then(|| OpcuaUser {
                name: "anonymous".to_owned(),
                rights: Rights {
                    role: Role::Viewer,
                    points: Arc::default(),
                },
            });
        }
        let (name, rights) = self.accounts.signed_in(identity)?;
        Some(OpcuaUser { name, rights })
    }
}
