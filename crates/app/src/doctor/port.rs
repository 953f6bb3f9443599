//! The ports: how the machine treats adapters, and why one can't be opened.

use super::finding::{Finding, Section};
use crate::machine::Machine;
use crate::machine::ports::{Adapter, adapters as all};
use crate::machine::users::{User, group};
use railbus_host::{PortAccess, PortError};

/// A CH340, which brltty takes for a Braille display.
const CH340: (u16, u16) = (0x1A86, 0x7523);
/// A latency timer above this is reported, in milliseconds.
const LATENCY_MAX: u32 = 2;
/// The path for our own udev rule.
const RULES: &str = "/etc/udev/rules.d/77-railbus.rules";

/// How the machine treats its adapters.
pub fn adapters(machine: &Machine, user: &User) -> Vec<Finding> {
    let sudo = if user.is_root() { "" } else { "sudo " };
    let mut found = Vec::new();
    let manager = machine.programs().any(|(_, name)| name == "ModemManager");
    for adapter in all(machine) {
        let device = &adapter.device;
        if manager && adapter.usb.is_some() && !is_ignored(machine, &adapter) {
            found.extend(ignore(&adapter, sudo));
        }
        if let Some(ms) = adapter.latency_ms.filter(|ms| *ms > LATENCY_MAX) {
            let name = device.trim_start_matches("/dev/");
            let timer = format!("/sys/class/tty/{name}/device/latency_timer");
            let finding = Finding::warning(Section::Port, "D106", format!("{device}, {ms} ms"));
            found.push(finding.with_fix(format!("echo 1 | {sudo}tee {timer}")));
        }
    }
    if takes_ch340(machine) && has_usb(machine, CH340) {
        let detail = format!("{:04x}:{:04x}", CH340.0, CH340.1);
        let finding = Finding::warning(Section::Port, "D108", detail);
        let units = "brltty-udev.service brltty-udev.path";
        found.push(finding.with_fix(format!("{sudo}systemctl mask --now {units}")));
    }
    found
}

/// A name that may change, and the stable one.
pub fn unstable(path: &str, stable: Option<&str>) -> Finding {
    let finding = Finding::warning(Section::Port, "D107", path.to_owned());
    match stable {
        Some(stable) => finding.with_advice(format!("port = \"{stable}\"")),
        None => finding,
    }
}

/// The rules' settings for a device are stored where udev keeps its database.
fn is_ignored(machine: &Machine, adapter: &Adapter) -> bool {
    let name = adapter.device.trim_start_matches("/dev/");
    let number = machine.text(format!("/sys/class/tty/{name}/dev"));
    let number = number.unwrap_or_default();
    let noted = machine.text(format!("/run/udev/data/c{}", number.trim()));
    let noted = noted.unwrap_or_default();
    let marks = ["E:ID_MM_DEVICE_IGNORE=1", "E:ID_MM_PORT_IGNORE=1"];
    noted.lines().any(|line| marks.contains(&line))
}

/// The rule that makes ModemManager ignore such an adapter.
fn ignore(adapter: &Adapter, sudo: &str) -> Option<Finding> {
    let (vendor, product) = adapter.usb?;
    let rule = format!(
        "SUBSYSTEM==\"tty\", ATTRS{{idVendor}}==\"{vendor:04x}\", \
         ATTRS{{idProduct}}==\"{product:04x}\", ENV{{ID_MM_DEVICE_IGNORE}}=\"1\", \
         ENV{{ID_MM_PORT_IGNORE}}=\"1\""
    );
    let detail = format!("{} ({vendor:04x}:{product:04x})", adapter.device);
    let finding = Finding::warning(Section::Port, "D105", detail)
        .with_fix(format!("echo '{rule}' | {sudo}tee -a {RULES}"))
        .with_fix(format!("{sudo}udevadm control --reload"))
        .with_fix(format!("{sudo}udevadm trigger --subsystem-match=tty"));
    Some(finding)
}

/// Whether a rule hands CH340 adapters to brltty.
fn takes_ch340(machine: &Machine) -> bool {
    let folders = [
        "/etc/udev/rules.d",
        "/usr/lib/udev/rules.d",
        "/lib/udev/rules.d",
    ];
    folders.into_iter().any(|folder| {
        let names = machine.names(folder).into_iter();
        let mut rules = names.filter(|name| name.contains("brltty"));
        rules.any(|name| {
            let text = machine.text(format!("{folder}/{name}")).unwrap_or_default();
            text.to_lowercase()
                .lines()
                .any(|line| !line.trim_start().starts_with('#') && line.contains("1a86/7523"))
        })
    })
}

/// Whether such a device is plugged in, with or without a port.
fn has_usb(machine: &Machine, (vendor, product): (u16, u16)) -> bool {
    let folder = "/sys/bus/usb/devices";
    machine.names(folder).into_iter().any(|name| {
        let number = |file: &str| {
            let text = machine.text(format!("{folder}/{name}/{file}"))?;
            u16::from_str_radix(text.trim(), 16).ok()
        };
        number("idVendor") == Some(vendor) && number("idProduct") == Some(product)
    })
}

/// Why a port could not be opened.
pub fn closed(
    machine: &Machine,
    user: &User,
    port: &str,
    device: Option<&str>,
    error: &PortError,
) -> Finding {
    let plain = |code| Finding::error(Section::Port, code, port.to_owned());
    match error {
        PortError::Missing => plain("D103"),
        PortError::NotATty => plain("D111"),
        PortError::Refused | PortError::Unreachable => plain("D112"),
        PortError::Permission(access) => denied(machine, user, device.unwrap_or(port), access),
        PortError::Busy { holder } => {
            let holder = holder.as_ref();
            let holder = holder.map(|holder| format!(", {} ({})", holder.name, holder.pid));
            let detail = format!("{port}{}", holder.unwrap_or_default());
            Finding::error(Section::Port, "D104", detail)
        }
        other => {
            let detail = format!("{port}, {other}");
            Finding::error(Section::Port, "D113", detail)
        }
    }
}

/// The group is that of the device, since it differs between systems.
fn denied(machine: &Machine, user: &User, device: &str, access: &PortAccess) -> Finding {
    let in_books = group(machine, access.group, &user.name);
    let name = access.group_name.clone();
    let name = name.or_else(|| in_books.as_ref().map(|(name, _)| name.clone()));
    let name = name.unwrap_or_else(|| access.group.to_string());
    let detail = format!("{device} ({}:{name} {:04o})", access.owner, access.mode);
    let for_group = access.mode & 0o060 == 0o060;
    let is_member = in_books.is_some_and(|(_, is_member)| is_member);
    if for_group && is_member && !user.groups.contains(&access.group) {
        return Finding::error(Section::Port, "D109", detail).with_advice(format!("newgrp {name}"));
    }
    let finding = Finding::error(Section::Port, "D102", detail);
    let named = PortAccess {
        group_name: Some(name),
        ..access.clone()
    };
    if let Some(name) = named.group_to_join()
        && !user.groups.contains(&access.group)
    {
        return finding.with_fix(format!("sudo usermod -aG {name} {}", user.name));
    }
    finding.with_advice(format!("ls -l {device}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::fixture::Fixture;
    use railbus_host::Holder;

    fn li() -> User {
        User {
            number: 1000,
            name: "li".to_owned(),
            groups: vec![1000],
        }
    }

    fn codes(found: &[Finding]) -> Vec<&'static str> {
        found.iter().filter_map(|finding| finding.code).collect()
    }

    #[test]
    fn latency_and_modem_manager_are_told_with_what_mends_them() {
        let tree = Fixture::new("doctor-ftdi");
        tree.ftdi();
        let found = adapters(&tree.machine(), &li());
        assert_eq!(codes(&found), ["D106"]);
        assert_eq!(
            found[0].fix,
            ["echo 1 | sudo tee /sys/class/tty/ttyUSB0/device/latency_timer"]
        );
        tree.program(700, "ModemManager", "/dev/null");
        let found = adapters(&tree.machine(), &li());
        assert_eq!(codes(&found), ["D105", "D106"]);
        assert!(
            found[0].fix[0].contains("ATTRS{idVendor}==\"0403\""),
            "{found:?}"
        );
        tree.file("/run/udev/data/c188:0", "I:1\nE:ID_MM_DEVICE_IGNORE=1\n");
        tree.file("/sys/devices/usb1/1-1/1-1:1.0/ttyUSB0/latency_timer", "1\n");
        assert_eq!(adapters(&tree.machine(), &li()), []);
    }

    #[test]
    fn brltty_matters_only_where_both_are() {
        let tree = Fixture::new("doctor-brltty");
        tree.file("/sys/bus/usb/devices/1-2/idVendor", "1a86\n")
            .file("/sys/bus/usb/devices/1-2/idProduct", "7523\n");
        assert_eq!(adapters(&tree.machine(), &li()), []);
        let rules = "/usr/lib/udev/rules.d/85-brltty.rules";
        tree.file(rules, "# ENV{PRODUCT}==\"1a86/7523/*\"\n");
        assert_eq!(adapters(&tree.machine(), &li()), []);
        tree.file(rules, "ENV{PRODUCT}==\"1A86/7523/*\", GOTO=\"x\"\n");
        let found = adapters(&tree.machine(), &li());
        assert_eq!(codes(&found), ["D108"]);
        assert!(found[0].fix[0].starts_with("sudo systemctl mask"));
    }

    #[test]
    fn rights_are_judged_by_the_device_and_by_the_login() {
        let tree = Fixture::new("doctor-rights");
        tree.file("/etc/group", "dialout:x:20:\n");
        let access = PortAccess {
            owner: 0,
            group: 20,
            group_name: Some("dialout".to_owned()),
            mode: 0o660,
        };
        let error = PortError::Permission(access.clone());
        let told = |machine: &Machine, user: &User| {
            closed(machine, user, "/dev/ttyUSB0", Some("/dev/ttyUSB0"), &error)
        };
        let found = told(&tree.machine(), &li());
        assert_eq!(found.code, Some("D102"));
        assert_eq!(found.fix, ["sudo usermod -aG dialout li"]);
        assert_eq!(found.detail, "/dev/ttyUSB0 (0:dialout 0660)");
        tree.file("/etc/group", "dialout:x:20:li\n");
        let found = told(&tree.machine(), &li());
        assert_eq!((found.code, found.fix.len()), (Some("D109"), 0));
        // In the group, and still no access: no group helps.
        let inside = User {
            groups: vec![20],
            ..li()
        };
        let found = told(&tree.machine(), &inside);
        assert_eq!((found.code, found.fix.len()), (Some("D102"), 0));
        // The group has no access: joining it does not help.
        let closed_to_group = PortAccess {
            mode: 0o600,
            ..access
        };
        let found = denied(&tree.machine(), &li(), "/dev/x", &closed_to_group);
        assert_eq!((found.code, found.fix.len()), (Some("D102"), 0));
    }

    #[test]
    fn whoever_holds_a_port_is_named() {
        let tree = Fixture::new("doctor-held");
        let holder = Some(Holder {
            pid: 812,
            name: "mbusd".to_owned(),
        });
        let told = |error: &PortError| closed(&tree.machine(), &li(), "/dev/x", None, error);
        let found = told(&PortError::Busy { holder });
        assert_eq!(
            (found.code, found.detail.as_str()),
            (Some("D104"), "/dev/x, mbusd (812)")
        );
        for (error, code) in [
            (PortError::Missing, "D103"),
            (PortError::NotATty, "D111"),
            (PortError::Refused, "D112"),
            (PortError::Gone, "D113"),
        ] {
            assert_eq!(told(&error).code, Some(code));
        }
    }
}
