//! The ports of this machine, for setting up lines. Listing them opens none.

use super::access::Need;
use super::answer;
use super::doc::Doc;
use super::route::{Answer, Route};
use super::site::Site;
use axum::extract::State;
use axum::routing::get;
use railbus_api::problem::{Problem, codes};
use railbus_app::machine::Machine;
use railbus_app::machine::ports::{Adapter, adapters};
use railbus_site::Config;
use railbus_site::paths::matches;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::Metadata;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

/// The routes of this file.
pub(super) const ROUTES: &[Route] = &[Route::new("GET", "/ports", Need::ENGINEER, || get(ports))
    .doc(Doc::new("The serial ports of this machine; none is opened"))];

async fn ports(State(site): State<Site>) -> Answer {
    let config = site.service.config();
    // Going through all processes takes a while.
    let rows = tokio::task::spawn_blocking(move || rows(&Machine::this(), &config)).await;
    let rows =
        rows.map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()));
    answer::json(rows.map(|rows| json!({ "schema": 1, "ports": rows })))
}

/// The ports that a configuration from the network may use without the owner's consent.
const USUAL: [&str; 2] = ["/dev/tty*", "/dev/serial/by-id/*"];

/// Whether a line may use this port if the owner did not configure it: a serial port, a
/// pseudo-terminal of the daemon's own user, or one that the owner allows. Anything else could be
/// any host that the daemon reaches, or any file.
pub(super) fn may_be_opened(allowed: &[String], port: &str) -> bool {
    let climbs = port.split('/').any(|part| part == "..");
    let named = |pattern: &str| matches(pattern.as_bytes(), port.as_bytes());
    !climbs
        && (USUAL.into_iter().any(named)
            || allowed.iter().any(|pattern| named(pattern))
            || leads_to_terminal(port))
}

/// Whether a name leads to a serial port, or to a pseudo-terminal of the daemon's own user.
fn leads_to_terminal(port: &str) -> bool {
    let path = Path::new(port.strip_prefix("pty:").unwrap_or(port));
    let Ok(device) = path.canonicalize() else {
        return false;
    };
    let is_serial = matches(USUAL[0].as_bytes(), device.as_os_str().as_bytes());
    let user = rustix::process::geteuid().as_raw();
    let is_own = |found: Metadata| found.uid() == user && found.file_type().is_char_device();
    is_serial || device.starts_with("/dev/pts") && std::fs::metadata(device).is_ok_and(is_own)
}

/// The adapters, and the ports of lines that are no adapters or not plugged in.
fn rows(machine: &Machine, config: &Config) -> Vec<Value> {
    let own = std::process::id();
    let mut lines: BTreeMap<PathBuf, &String> = BTreeMap::new();
    for (name, line) in &config.lines {
        lines.insert(device(machine, &line.port), name);
    }
    let mut rows = Vec::new();
    for adapter in adapters(machine) {
        let line = lines.remove(&machine.path(&adapter.device));
        rows.push(row(&adapter, line, own));
    }
    rows.extend(lines.into_values().map(|name| {
        let port = config.lines.get(name).map(|line| &line.port);
        json!({ "path": port, "present": false, "line": name })
    }));
    rows
}

/// The device behind a port's name.
fn device(machine: &Machine, port: &str) -> PathBuf {
    let path = machine.path(Path::new(port.strip_prefix("pty:").unwrap_or(port)));
    path.canonicalize().unwrap_or(path)
}

fn row(adapter: &Adapter, line: Option<&String>, own: u32) -> Value {
    let usb = adapter
        .usb
        .map(|(vendor, product)| format!("{vendor:04x}:{product:04x}"));
    let others = adapter.holders.iter().filter(|(pid, _)| *pid != own);
    let held = others.map(|(pid, name)| format!("{name} ({pid})"));
    let held: Vec<String> = held.collect();
    let stable = adapter.stable.as_ref().or(adapter.socket.as_ref());
    let mut row = json!({
        "path": adapter.device, "stable": stable, "by_id": adapter.stable,
        "driver": adapter.driver, "description": adapter.product.as_ref().or(usb.as_ref()),
        "usb": usb, "present": true, "plugged_s": adapter.plugged_s,
    });
    let facts = [
        ("latency_ms", adapter.latency_ms.map(Value::from)),
        (
            "in_use_by",
            (!held.is_empty()).then(|| held.join(" ").into()),
        ),
        ("line", line.map(|name| name.as_str().into())),
    ];
    for (key, value) in facts {
        if let Some(value) = value {
            row[key] = value;
        }
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_app::machine::fixture::Fixture;

    #[test]
    fn serial_ports_may_be_opened_and_what_the_owner_allows() {
        let allowed = ["tcp:10.0.0.*:4001".to_owned()];
        for port in [
            "/dev/ttyUSB7",
            "/dev/serial/by-id/usb-x-port0",
            "tcp:10.0.0.7:4001",
        ] {
            assert!(may_be_opened(&allowed, port), "{port}");
        }
        for port in [
            "tcp:10.0.0.7:22",
            "mbtcp:10.0.0.7",
            "/dev/tty/../mem",
            "/dev/mem",
            "/etc/passwd",
            "pty:/etc/passwd",
            "pty:/dev/null",
            "/dev/pts/../null",
            "/tmp/there/is/none",
        ] {
            assert!(!may_be_opened(&allowed, port), "{port}");
        }
    }

    #[test]
    fn a_port_is_told_with_its_line_and_who_has_it() {
        let tree = Fixture::new("api-ports");
        tree.ftdi()
            .file("/sys/devices/usb1/1-1/product", "FT232R USB UART\n")
            .program(812, "mbusd", "/dev/ttyUSB0");
        let stable = "/dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0";
        let text =
            format!("[line.main]\nport = \"{stable}\"\n[line.far]\nport = \"tcp:gateway:4001\"\n");
        let config = Config::parse(&text).unwrap();
        let rows = rows(&tree.machine(), &config);
        assert_eq!(rows.len(), 2, "{rows:?}");
        let told = json!({
            "path": "/dev/ttyUSB0", "stable": stable, "by_id": stable, "driver": "ftdi_sio",
            "description": "FT232R USB UART", "usb": "0403:6001", "present": true,
            "plugged_s": 3600, "latency_ms": 16, "in_use_by": "mbusd (812)", "line": "main",
        });
        assert_eq!(rows[0], told);
        let far = json!({"path": "tcp:gateway:4001", "present": false, "line": "far"});
        assert_eq!(rows[1], far);
    }
}
