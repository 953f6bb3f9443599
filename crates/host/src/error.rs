//! Why a port can't be used. Data without sentences, so that callers can phrase it in any language.

use rustix::io::Errno;
use std::fmt;
use std::io;

/// Why a port can't be opened, or was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortError {
    /// There is no such device or path.
    Missing,
    /// Another program is using it.
    Busy {
        /// Which one, if that can be found out.
        holder: Option<Holder>,
    },
    /// The user has no permission to open it.
    Permission(PortAccess),
    /// It exists, but is not a terminal.
    NotATty,
    /// The other end refuses the connection.
    Refused,
    /// The other end does not answer.
    Unreachable,
    /// It was open and is gone: unplugged, or closed at the other end.
    Gone,
    /// Sent data is not taken: it piles up, and would reach the modules much too late.
    Stuck,
    /// The other end does not speak Modbus TCP.
    Garbled,
    /// Another part of this program has exclusive access for a while.
    Exclusive,
    /// Anything else, as the system's error number; 0 if there is none.
    Io(i32),
}

/// The program that has a port open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// Its process ID.
    pub pid: u32,
    /// Its name.
    pub name: String,
}

/// The permissions of a port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortAccess {
    /// The user ID of the owner.
    pub owner: u32,
    /// The group ID.
    pub group: u32,
    /// The group's name, if `/etc/group` has one: `dialout` on Debian.
    pub group_name: Option<String>,
    /// The permission bits, such as `0o660`.
    pub mode: u32,
}

/// Groups whose members may do far more than use a port: joining one is never suggested.
const POWERFUL: [&str; 10] = [
    "root", "adm", "admin", "disk", "docker", "kmem", "lxd", "shadow", "sudo", "wheel",
];

impl PortAccess {
    /// The group to join for access to the device, if joining it is reasonable.
    #[must_use]
    pub fn group_to_join(&self) -> Option<&str> {
        let opens = self.mode & 0o060 == 0o060 && self.group != 0;
        let name = self.group_name.as_deref().filter(|_| opens)?;
        (!POWERFUL.contains(&name)).then_some(name)
    }
}

impl PortError {
    /// The name in JSON and logs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            PortError::Missing => "missing",
            PortError::Busy { .. } => "busy",
            PortError::Permission(_) => "permission",
            PortError::NotATty => "not_a_tty",
            PortError::Refused => "refused",
            PortError::Unreachable => "unreachable",
            PortError::Gone => "gone",
            PortError::Stuck => "stuck",
            PortError::Garbled => "garbled",
            PortError::Exclusive => "lent",
            PortError::Io(_) => "io",
        }
    }

    /// The error for a failure while sending or receiving: the port is lost.
    #[must_use]
    pub fn of_loss(error: &io::Error) -> PortError {
        match error.kind() {
            io::ErrorKind::WouldBlock | io::ErrorKind::WriteZero => PortError::Stuck,
            io::ErrorKind::InvalidData => PortError::Garbled,
            io::ErrorKind::UnexpectedEof
            | io::ErrorKind::ConnectionReset
            | io::ErrorKind::ConnectionAborted
            | io::ErrorKind::BrokenPipe
            | io::ErrorKind::NotConnected => PortError::Gone,
            io::ErrorKind::TimedOut
            | io::ErrorKind::HostUnreachable
            | io::ErrorKind::NetworkUnreachable => PortError::Unreachable,
            _ => match error.raw_os_error().map(Errno::from_raw_os_error) {
                Some(Errno::IO | Errno::NXIO | Errno::NODEV) => PortError::Gone,
                other => PortError::Io(other.map_or(0, Errno::raw_os_error)),
            },
        }
    }
}

impl fmt::Display for PortError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::error::Error for PortError {}

impl From<Errno> for PortError {
    fn from(errno: Errno) -> PortError {
        PortError::Io(errno.raw_os_error())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_told_to_join_a_group_that_may_do_everything() {
        let of = |group: u32, name: &str, mode| {
            let access = PortAccess {
                owner: 0,
                group,
                group_name: Some(name.to_owned()),
                mode,
            };
            access.group_to_join().map(str::to_owned)
        };
        assert_eq!(of(20, "dialout", 0o660).as_deref(), Some("dialout"));
        assert_eq!(of(20, "dialout", 0o600), None, "it would not help");
        assert_eq!(of(0, "root", 0o660), None);
        for name in POWERFUL {
            assert_eq!(of(6, name, 0o660), None, "{name}");
        }
    }

    #[test]
    fn a_loss_is_told_by_what_it_means() {
        let of_errno = |errno: Errno| PortError::of_loss(&errno.into());
        assert_eq!(of_errno(Errno::IO), PortError::Gone);
        assert_eq!(of_errno(Errno::NODEV), PortError::Gone);
        assert_eq!(of_errno(Errno::PIPE), PortError::Gone);
        assert_eq!(of_errno(Errno::AGAIN), PortError::Stuck);
        assert_eq!(of_errno(Errno::HOSTUNREACH), PortError::Unreachable);
        assert_eq!(of_errno(Errno::NOMEM), PortError::Io(12));
        let end = io::ErrorKind::UnexpectedEof.into();
        assert_eq!(PortError::of_loss(&end), PortError::Gone);
    }
}
