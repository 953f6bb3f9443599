//! The permissions of a port, for the error when they are missing.

use crate::PortAccess;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// The permissions of a device. Read from the device itself, because the group differs between
/// systems.
pub(crate) fn of(path: &Path) -> PortAccess {
    match fs::metadata(path) {
        Ok(device) => PortAccess {
            owner: device.uid(),
            group: device.gid(),
            group_name: fs::read_to_string("/etc/group")
                .ok()
                .and_then(|groups| name_of(&groups, device.gid())),
            mode: device.mode() & 0o7777,
        },
        Err(_) => PortAccess::default(),
    }
}

/// The name of a group in the text of `/etc/group`.
fn name_of(groups: &str, group: u32) -> Option<String> {
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        let number = fields.nth(1)?;
        (number.parse() == Ok(group)).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_is_found_by_its_number() {
        let groups = "root:x:0:\nbroken\ndialout:x:20:li,wang\nstaff:x:50:\n";
        assert_eq!(name_of(groups, 20).as_deref(), Some("dialout"));
        assert_eq!(name_of(groups, 0).as_deref(), Some("root"));
        assert_eq!(name_of(groups, 7), None);
    }

    #[test]
    fn the_rights_are_those_of_the_device() {
        let access = of(Path::new("/dev/null"));
        assert_eq!((access.owner, access.mode), (0, 0o666));
        assert_eq!(of(Path::new("/dev/none such")), PortAccess::default());
    }
}
