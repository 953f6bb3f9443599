//! Roles and rights.

use crate::config::{Config, PointConfig};
use crate::{CommandError, paths};
use railbus_device::Point;
use railbus_store::audit::Origin;
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

/// What a handle of the site may do ([`crate::Service::on_behalf_of`]): a copy, made when the
/// handle was. A user who gets other rights keeps those of handles that were made before; a request
/// gets a handle of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rights {
    /// Its role. A viewer commands nothing.
    pub role: Role,
    /// The outputs it may command, as selectors of paths; empty for all of them.
    pub points: Arc<[String]>,
}

/// The caller a command acts for.
#[derive(Clone, Debug)]
pub(crate) struct Who {
    /// As recorded in logs.
    pub(crate) origin: Arc<Origin>,
    /// What the caller may do.
    pub(crate) rights: Rights,
}

impl Who {
    /// A part of this program, with all rights.
    pub(crate) fn program(part: &str) -> Who {
        Who {
            origin: Arc::new(Origin::program(part)),
            rights: Rights::all(),
        }
    }
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

    /// Whether it is limited to some points.
    #[must_use]
    pub fn is_limited(&self) -> bool {
        !self.points.is_empty()
    }

    /// Whether the role is this one or a higher one.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`].
    pub fn at_least(&self, need: Role) -> Result<(), CommandError> {
        let role = self.role;
        match role < need {
            true => Err(CommandError::RoleTooLow { role, need }),
            false => Ok(()),
        }
    }

    /// Whether outputs may be commanded at all.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`].
    pub fn may_command(&self) -> Result<(), CommandError> {
        self.at_least(Role::Operator)
    }

    /// Whether lines and modules may be changed. That may affect any output, so a limit to some
    /// points excludes it.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::Limited`].
    pub fn may_change_site(&self) -> Result<(), CommandError> {
        self.at_least(Role::Engineer)?;
        match self.is_limited() {
            true => Err(CommandError::Limited(Arc::clone(&self.points))),
            false => Ok(()),
        }
    }

    /// Whether another configuration may be brought into force. With a limit to some points, only
    /// one that gives these other names.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::Limited`].
    pub(crate) fn may_reload(&self, old: &Config, new: &Config) -> Result<(), CommandError> {
        self.at_least(Role::Engineer)?;
        match self.is_limited() && self.without_names(old) != self.without_names(new) {
            true => Err(CommandError::Limited(Arc::clone(&self.points))),
            false => Ok(()),
        }
    }

    /// A configuration without the names of the points that are covered.
    fn without_names(&self, config: &Config) -> Config {
        let mut config = config.clone();
        for (name, module) in &mut config.modules {
            let setup = module.setup;
            module.points.retain(|point, of| {
                let (letters, number) = setup.label(*point);
                if paths::selects(&self.points, name, &format!("{letters}{number}")) {
                    (of.name_en, of.name_zh) = (None, None);
                }
                *of != PointConfig::default()
            });
        }
        config
    }

    /// Whether this output may be commanded.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::NotPermitted`].
    pub fn may_switch(&self, module: &str, label: &str) -> Result<(), CommandError> {
        self.may_command()?;
        if paths::selects(&self.points, module, label) {
            return Ok(());
        }
        Err(CommandError::NotPermitted {
            module: module.to_owned(),
            label: label.to_owned(),
        })
    }

    /// The same of a point of this configuration.
    ///
    /// # Errors
    /// As [`Rights::may_switch`]; the label of a point that does not exist is empty.
    pub(crate) fn may_switch_in(
        &self,
        config: &Config,
        module: &str,
        point: Point,
    ) -> Result<(), CommandError> {
        if !self.is_limited() {
            return self.may_command();
        }
        let known = config.modules.get(module);
        let label = known.map(|known| known.setup.label(point));
        let label = label.map(|(letters, number)| format!("{letters}{number}"));
        self.may_switch(module, &label.unwrap_or_default())
    }
}
