//! The serial adapters of a machine, without opening them.

use super::Machine;
use std::collections::BTreeMap;

/// Only these are adapters; a PC's own ttyS0 to ttyS31 mostly lead nowhere.
const KINDS: [&str; 5] = ["ttyUSB", "ttyACM", "ttyAMA", "ttySC", "ttyAP"];

/// An adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Its device, such as `/dev/ttyUSB0`.
    pub device: String,
    /// Its kernel driver, if known.
    pub driver: Option<String>,
    /// How long it buffers received data, in milliseconds (FTDI).
    pub latency_ms: Option<u32>,
    /// Its USB vendor and product IDs.
    pub usb: Option<(u16, u16)>,
    /// Its USB name.
    pub product: Option<String>,
    /// The name that stays the same in whichever socket it is plugged.
    pub stable: Option<String>,
    /// The name of its socket: for adapters without a serial number.
    pub socket: Option<String>,
    /// The programs that have it open, as far as this user can see.
    pub holders: Vec<(u32, String)>,
    /// For how long it has been plugged in, in seconds.
    pub plugged_s: Option<u64>,
}

/// All adapters, by name.
pub fn adapters(machine: &Machine) -> Vec<Adapter> {
    let names = machine.names("/sys/class/tty").into_iter();
    let names: Vec<String> = names
        .filter(|name| KINDS.iter().any(|kind| name.starts_with(kind)))
        .collect();
    let (stable, sockets) = (links(machine, "by-id"), links(machine, "by-path"));
    let mut holders = if names.is_empty() {
        BTreeMap::new()
    } else {
        holders(machine)
    };
    let adapter = |name: String| {
        let device = format!("/dev/{name}");
        Adapter {
            driver: driver(machine, &name),
            latency_ms: number(
                machine,
                &format!("/sys/class/tty/{name}/device/latency_timer"),
            ),
            usb: usb(machine, &name),
            product: product(machine, &name),
            stable: stable.get(&name).cloned(),
            socket: sockets.get(&name).cloned(),
            holders: holders.remove(&device).unwrap_or_default(),
            plugged_s: plugged(machine, &name),
            device,
        }
    };
    names.into_iter().map(adapter).collect()
}

/// The symbolic links to devices that udev creates.
fn links(machine: &Machine, kind: &str) -> BTreeMap<String, String> {
    let folder = format!("/dev/serial/{kind}");
    let pair = |name: String| {
        let path = format!("{folder}/{name}");
        let device = machine.link(&path)?;
        Some((device.file_name()?.to_str()?.to_owned(), path))
    };
    machine
        .names(&folder)
        .into_iter()
        .filter_map(pair)
        .collect()
}

fn driver(machine: &Machine, name: &str) -> Option<String> {
    let target = machine.link(format!("/sys/class/tty/{name}/device/driver"))?;
    Some(target.file_name()?.to_str()?.to_owned())
}

fn number(machine: &Machine, path: &str) -> Option<u32> {
    machine.text(path)?.trim().parse().ok()
}

/// Vendor and product.
fn usb(machine: &Machine, name: &str) -> Option<(u16, u16)> {
    let number = |key| u16::from_str_radix(&of_usb(machine, name, key)?, 16).ok();
    Some((number("idVendor")?, number("idProduct")?))
}

/// The name stored by its manufacturer.
fn product(machine: &Machine, name: &str) -> Option<String> {
    let product = of_usb(machine, name, "product")?;
    // It may be anything; the longest that USB allows is 126 characters.
    let shown = product.chars().filter(|c| !c.is_control()).take(126);
    Some(shown.collect())
}

/// The attributes of the USB device: they are some folders above the port, how many depends on the
/// driver.
fn of_usb(machine: &Machine, name: &str, key: &str) -> Option<String> {
    let device = machine.path(format!("/sys/class/tty/{name}/device"));
    let device = device.canonicalize().ok()?;
    let mut folders = device.ancestors().take(5);
    let device = folders.find(|folder| folder.join("idVendor").exists())?;
    let text = std::fs::read_to_string(device.join(key)).ok()?;
    Some(text.trim().to_owned())
}

/// Which program has which terminal open.
fn holders(machine: &Machine) -> BTreeMap<String, Vec<(u32, String)>> {
    let mut found: BTreeMap<String, Vec<(u32, String)>> = BTreeMap::new();
    for (pid, name) in machine.programs() {
        let folder = format!("/proc/{pid}/fd");
        let mut open: Vec<String> = machine
            .names(&folder)
            .into_iter()
            .filter_map(|fd| machine.link(format!("{folder}/{fd}")))
            .filter_map(|target| target.into_os_string().into_string().ok())
            .filter(|target| target.starts_with("/dev/tty"))
            .collect();
        open.sort();
        open.dedup();
        for device in open {
            found.entry(device).or_default().push((pid, name.clone()));
        }
    }
    found
}

/// How long it has been plugged in: udev records when it saw a device first, in microseconds since
/// boot.
fn plugged(machine: &Machine, name: &str) -> Option<u64> {
    let number = machine.text(format!("/sys/class/tty/{name}/dev"))?;
    let noted = machine.text(format!("/run/udev/data/c{}", number.trim()))?;
    let met = noted.lines().find_map(|line| line.strip_prefix("I:"))?;
    let met: u64 = met.trim().parse().ok()?;
    let uptime = machine.text("/proc/uptime")?;
    let uptime: u64 = uptime.split(['.', ' ']).next()?.parse().ok()?;
    uptime.checked_sub(met / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::fixture::Fixture;

    #[test]
    fn an_adapter_is_told_with_all_that_is_known() {
        let tree = Fixture::new("adapter");
        tree.ftdi()
            .program(812, "mbusd", "/dev/ttyUSB0")
            .file("/sys/class/tty/ttyS0/dev", "4:64");
        let found = adapters(&tree.machine());
        let stable = "/dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0";
        let ftdi = Adapter {
            device: "/dev/ttyUSB0".to_owned(),
            driver: Some("ftdi_sio".to_owned()),
            latency_ms: Some(16),
            usb: Some((0x0403, 0x6001)),
            product: None,
            stable: Some(stable.to_owned()),
            socket: None,
            holders: vec![(812, "mbusd".to_owned())],
            plugged_s: Some(3_600),
        };
        assert_eq!(found, [ftdi]);
    }

    #[test]
    fn a_bare_tree_has_no_adapters_and_little_is_known_of_others() {
        let tree = Fixture::new("bare");
        assert_eq!(adapters(&tree.machine()), []);
        tree.file("/sys/class/tty/ttyACM1/dev", "166:1");
        let found = adapters(&tree.machine());
        assert_eq!((found.len(), found[0].device.as_str()), (1, "/dev/ttyACM1"));
        assert_eq!(
            (&found[0].driver, found[0].usb, found[0].plugged_s),
            (&None, None, None)
        );
    }
}
