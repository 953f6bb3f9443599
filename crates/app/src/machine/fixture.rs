//! A machine made of files, removed at the end of a test: for the tests of all crates.

use super::Machine;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;

/// A tree of files.
#[derive(Debug)]
pub struct Fixture(PathBuf);

impl Drop for Fixture {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

impl Fixture {
    /// An empty one, under this name, which no other test may use.
    ///
    /// # Panics
    /// If it can't be created.
    pub fn new(name: &str) -> Fixture {
        let unique = format!("railbus-machine-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        fs::create_dir_all(&folder).unwrap();
        Fixture(folder)
    }

    /// The machine made of these files.
    pub fn machine(&self) -> Machine {
        Machine::at(&self.0)
    }

    /// Writes a file and its parent folders.
    ///
    /// # Panics
    /// If that fails.
    pub fn file(&self, path: &str, text: &str) -> &Fixture {
        let path = self.machine().path(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
        self
    }

    /// Creates a link and its parent folders.
    ///
    /// # Panics
    /// If that fails.
    pub fn link(&self, path: &str, target: &str) -> &Fixture {
        let path = self.machine().path(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        symlink(target, path).unwrap();
        self
    }

    /// An FTDI adapter as shown by Linux, plugged in 90 s after boot.
    pub fn ftdi(&self) -> &Fixture {
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
    pub fn program(&self, pid: u32, name: &str, open: &str) -> &Fixture {
        self.file(&format!("/proc/{pid}/comm"), &format!("{name}\n"))
            .link(&format!("/proc/{pid}/fd/3"), open)
    }
}
