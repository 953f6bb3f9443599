//! The machine as its files tell it: ports, programs, users. Nothing here opens a port.

pub(crate) mod ports;
pub(crate) mod users;

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The longest file that is read; those of the kernel are short.
const LEN_MAX: u64 = 1 << 20;

/// A machine's tree of files; that of another one in tests.
#[derive(Clone, Debug)]
pub(crate) struct Machine {
    root: PathBuf,
}

impl Machine {
    /// This machine.
    pub(crate) fn this() -> Machine {
        Machine::at("/")
    }

    /// The machine whose files lie below a folder.
    pub(crate) fn at(root: impl Into<PathBuf>) -> Machine {
        Machine { root: root.into() }
    }

    /// Where a file of the machine lies.
    pub(crate) fn path(&self, absolute: impl AsRef<Path>) -> PathBuf {
        let absolute = absolute.as_ref();
        self.root
            .join(absolute.strip_prefix("/").unwrap_or(absolute))
    }

    /// The text of a file; none where it can't be read.
    pub(crate) fn text(&self, absolute: impl AsRef<Path>) -> Option<String> {
        let file = fs::File::open(self.path(absolute)).ok()?;
        let mut bytes = Vec::new();
        file.take(LEN_MAX).read_to_end(&mut bytes).ok()?;
        Some(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The names in a folder, sorted; none where it can't be read.
    pub(crate) fn names(&self, folder: impl AsRef<Path>) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder))
            .into_iter()
            .flatten()
            .flatten();
        let mut names: Vec<String> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    /// Where a link leads, as it is written.
    pub(crate) fn link(&self, absolute: impl AsRef<Path>) -> Option<PathBuf> {
        fs::read_link(self.path(absolute)).ok()
    }

    /// The programs that run, by number and name.
    pub(crate) fn programs(&self) -> impl Iterator<Item = (u32, String)> {
        let numbers = self.names("/proc").into_iter();
        numbers.filter_map(|name| {
            let pid = name.parse().ok()?;
            let name = self.text(format!("/proc/{pid}/comm"))?;
            Some((pid, name.trim_end().to_owned()))
        })
    }
}

/// A tree of files that is gone at the end of a test.
#[cfg(test)]
pub(crate) mod fixture {
    use super::Machine;
    use std::fs;
    use std::os::unix::fs::symlink;
    use std::path::PathBuf;

    #[derive(Debug)]
    pub(crate) struct Fixture(PathBuf);

    impl Drop for Fixture {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    impl Fixture {
        pub(crate) fn new(name: &str) -> Fixture {
            let unique = format!("railbus-machine-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(unique);
            fs::create_dir_all(&folder).unwrap();
            Fixture(folder)
        }

        pub(crate) fn machine(&self) -> Machine {
            Machine::at(&self.0)
        }

        pub(crate) fn file(&self, path: &str, text: &str) -> &Fixture {
            let path = self.machine().path(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
            self
        }

        pub(crate) fn link(&self, path: &str, target: &str) -> &Fixture {
            let path = self.machine().path(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            symlink(target, path).unwrap();
            self
        }

        /// An FTDI adapter as Linux shows it, plugged in 90 s after the start.
        pub(crate) fn ftdi(&self) -> &Fixture {
            let device = "/sys/devices/usb1/1-1/1-1:1.0/ttyUSB0";
            self.file("/sys/devices/usb1/1-1/idVendor", "0403\n")
                .file("/sys/devices/usb1/1-1/idProduct", "6001\n")
                .file(&format!("{device}/latency_timer"), "16\n")
                .link(
                    &format!("{device}/driver"),
                    "../../../../../bus/usb-serial/drivers/ftdi_sio",
                )
                .file(&format!("{device}/tty/ttyUSB0/dev"), "188:0\n")
                .link(&format!("{device}/tty/ttyUSB0/device"), "../../../ttyUSB0")
                .link(
                    "/sys/class/tty/ttyUSB0",
                    "../../devices/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0",
                )
                .file("/dev/ttyUSB0", "")
                .link(
                    "/dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0",
                    "../../ttyUSB0",
                )
                .file("/run/udev/data/c188:0", "S:serial/x\nI:90000000\nE:ID=1\n")
                .file("/proc/uptime", "3690.50 100.00\n")
        }

        /// A program that has a file open.
        pub(crate) fn program(&self, pid: u32, name: &str, open: &str) -> &Fixture {
            self.file(&format!("/proc/{pid}/comm"), &format!("{name}\n"))
                .link(&format!("/proc/{pid}/fd/3"), open)
        }
    }
}
