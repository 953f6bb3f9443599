//! The user of this process, and their groups: of the login session, and in the user database.

use super::Machine;
use rustix::process::{geteuid, getgroups};

/// The user of this process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct User {
    /// Its number.
    pub number: u32,
    /// Its name.
    pub name: String,
    /// The groups of this login session. They do not change with the database.
    pub groups: Vec<u32>,
}

impl User {
    /// The user of this process.
    pub fn this(machine: &Machine) -> User {
        let number = geteuid().as_raw();
        let mut groups: Vec<u32> = getgroups()
            .unwrap_or_default()
            .into_iter()
            .map(rustix::process::Gid::as_raw)
            .collect();
        groups.push(rustix::process::getegid().as_raw());
        User {
            number,
            name: name_of(machine, number).unwrap_or_else(|| number.to_string()),
            groups,
        }
    }

    /// Whether it is the superuser.
    pub const fn is_root(&self) -> bool {
        self.number == 0
    }
}

/// The name of a user.
fn name_of(machine: &Machine, number: u32) -> Option<String> {
    let number = number.to_string();
    machine.text("/etc/passwd")?.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == number).then(|| name.to_owned())
    })
}

/// The name of a group, and whether a user is a member according to the database.
pub fn group(machine: &Machine, number: u32, user: &str) -> Option<(String, bool)> {
    let number = number.to_string();
    machine.text("/etc/group")?.lines().find_map(|line| {
        let fields: Vec<&str> = line.split(':').collect();
        let [name, _, found, members] = fields.as_slice() else {
            return None;
        };
        let is_member = members.split(',').any(|member| member == user);
        (*found == number).then(|| ((*name).to_owned(), is_member))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::fixture::Fixture;

    #[test]
    fn users_and_groups_are_found_in_the_books() {
        let tree = Fixture::new("users");
        tree.file(
            "/etc/passwd",
            "root:x:0:0::/root:/bin/sh\nli:x:1000:1000::/srv/li:/bin/sh\n",
        )
        .file("/etc/group", "root:x:0:\ndialout:x:20:wang,li\nbroken\n");
        let machine = tree.machine();
        assert_eq!(name_of(&machine, 1000).as_deref(), Some("li"));
        assert_eq!(name_of(&machine, 7), None);
        assert_eq!(
            group(&machine, 20, "li"),
            Some(("dialout".to_owned(), true))
        );
        assert_eq!(
            group(&machine, 20, "zhao"),
            Some(("dialout".to_owned(), false))
        );
        assert_eq!(group(&machine, 5, "li"), None);
    }
}
