//! Roles and rights.

use crate::{Failure, paths};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A role; each includes the rights of those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Read.
    Viewer,
    /// Switch outputs.
    Operator,
    /// Change modules, lines and the configuration.
    Engineer,
    /// Manage accounts and rights.
    Admin,
}

impl Role {
    /// All of them, lowest first.
    pub const ALL: [Role; 4] = [Role::Viewer, Role::Operator, Role::Engineer, Role::Admin];

    /// The names of all roles, lowest first.
    pub const NAMES: [&str; 4] = {
        let [viewer, operator, engineer, admin] = Role::ALL;
        [
            viewer.name(),
            operator.name(),
            engineer.name(),
            admin.name(),
        ]
    };

    /// Its name in configuration and API.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Role::Viewer => "viewer",
            Role::Operator => "operator",
            Role::Engineer => "engineer",
            Role::Admin => "admin",
        }
    }
}

/// What a handle of the site may do ([`crate::Service::on_behalf_of`]).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rights {
    /// Its role. A viewer commands nothing.
    pub role: Role,
    /// The outputs it may command, as selectors of paths; empty for all of them.
    pub points: Arc<[String]>,
}

impl Rights {
    /// Everything: the program itself, and the user who runs it.
    #[must_use]
    pub fn all() -> Rights {
        Rights {
            role: Role::Admin,
            points: Arc::default(),
        }
    }

    /// Whether outputs may be commanded at all.
    ///
    /// # Errors
    /// [`Failure::RoleTooLow`].
    pub fn may_command(&self) -> Result<(), Failure> {
        match self.role < Role::Operator {
            true => Err(Failure::RoleTooLow(self.role)),
            false => Ok(()),
        }
    }

    /// Whether this output may be commanded.
    ///
    /// # Errors
    /// [`Failure::RoleTooLow`], [`Failure::NotPermitted`].
    pub fn may_switch(&self, module: &str, label: &str) -> Result<(), Failure> {
        self.may_command()?;
        if paths::selects(&self.points, module, label) {
            return Ok(());
        }
        Err(Failure::NotPermitted {
            module: module.to_owned(),
            label: label.to_owned(),
        })
    }
}
