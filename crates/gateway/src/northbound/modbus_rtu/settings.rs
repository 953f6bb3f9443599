//! Its settings: which port, and what is wrong with them.

use super::KIND;
use crate::northbound::modbus::units::units;
use crate::ports;
use railbus_api::problem::{Problem, codes};
use railbus_host::LineName;
use railbus_site::Config;
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use railbus_wire::{Baud, Character, SerialSettings};
use std::path::{Path, PathBuf};

fn text<'s>(settings: &'s Keys, key: &str) -> Option<&'s str> {
    settings.get(key).and_then(|value| value.as_str())
}

/// The port; none if it is no serial one.
pub(super) fn port(settings: &Keys) -> Option<LineName> {
    let port = text(settings, "port")?.parse().ok()?;
    match port {
        LineName::Serial(_) | LineName::Pty(_) => Some(port),
        LineName::Tcp { .. } | LineName::ModbusTcp { .. } => None,
    }
}

/// Speed and format; none if there is no such speed.
pub(super) fn serial(settings: &Keys) -> Option<SerialSettings> {
    let default = SerialSettings::FACTORY;
    let baud = match settings.get("baud") {
        None => Some(default.baud),
        Some(rate) => {
            let rate = rate.as_u64().and_then(|rate| u32::try_from(rate).ok());
            rate.and_then(Baud::from_rate)
        }
    };
    let format = text(settings, "format").and_then(Character::from_name);
    Some(SerialSettings {
        baud: baud?,
        character: format.unwrap_or(default.character),
    })
}

/// The file of a serial port.
fn file(port: &LineName) -> Option<&Path> {
    match port {
        LineName::Serial(path) | LineName::Pty(path) => Some(path),
        LineName::Tcp { .. } | LineName::ModbusTcp { .. } => None,
    }
}

/// The device behind a port, whose file may be a link.
fn device(port: &str) -> Option<PathBuf> {
    let port = port.parse().ok()?;
    let file = file(&port)?;
    Some(file.canonicalize().unwrap_or_else(|_| file.to_owned()))
}

/// What is wrong with its settings beyond their shapes.
pub(super) fn check(settings: &Keys, config: &Config) -> Vec<(&'static str, Invalid)> {
    let mut found = Vec::new();
    if port(settings).is_none() {
        found.push(("port", Invalid::NotOneOf(vec!["/dev/…", "pty:/…"])));
    }
    let taken = text(settings, "port").and_then(device).and_then(|ours| {
        let mut lines = config.lines.iter();
        lines.find(|(_, line)| device(&line.port).as_ref() == Some(&ours))
    });
    if let Some((line, _)) = taken {
        found.push(("port", Invalid::PortTaken(line.clone())));
    }
    if serial(settings).is_none() {
        found.push(("baud", Invalid::NotOneOf(Baud::NAMES.to_vec())));
    }
    let problems = units(settings, config).problems.into_iter();
    found.extend(problems.map(|why| ("units", why)));
    found
}

/// Refuses ports that the owner of the daemon has not allowed, and that none of its lines and none
/// of these had before.
pub(super) fn may_lead(old: &Config, new: &Config) -> Result<(), Problem> {
    let ports_of = |config: &Config| {
        let all = (KIND.outlets)(&KIND, config).into_iter();
        let named = all.filter_map(|(_, settings)| text(&settings, "port").map(str::to_owned));
        named.collect::<Vec<String>>()
    };
    let mut known = ports_of(old);
    known.extend(old.lines.values().map(|line| line.port.clone()));
    let may =
        |port: &String| known.contains(port) || ports::may_be_opened(&new.allowed.ports, port);
    match ports_of(new).into_iter().find(|port| !may(port)) {
        None => Ok(()),
        Some(port) => {
            let hint = format!("[ports] allow = [\"{port}\"]");
            let problem = Problem::new(codes::PORT_NOT_ALLOWED).with("port", port);
            Err(problem.with_hint(hint))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(value: serde_json::Value) -> Keys {
        value.as_object().cloned().unwrap()
    }

    fn config(more: &str) -> Config {
        let text = "[line.a]\nport = \"/dev/ttyS8\"\n[line.b]\nport = \"pty:/tmp/none/b\"\n\
             [module.oven]\nline = \"a\"\nmodel = \"erc8\"\naddress = 3\n";
        Config::parse(&format!("{text}{more}")).unwrap()
    }

    #[test]
    fn a_port_is_a_serial_one_and_no_lines() {
        let check = |settings| check(&keys(settings), &config(""));
        assert_eq!(check(json!({"port": "/dev/ttyS9"})), []);
        let serial = json!({"port": "pty:/tmp/x", "baud": 19200, "format": "8E1"});
        assert_eq!(check(serial), []);
        for port in ["/dev/ttyS8", "pty:/dev/ttyS8"] {
            let found = check(json!({ "port": port }));
            assert_eq!(found, [("port", Invalid::PortTaken("a".to_owned()))]);
        }
        let found = check(json!({"port": "/tmp/none/b"}));
        assert_eq!(found, [("port", Invalid::PortTaken("b".to_owned()))]);
        for port in ["ttyS9", "tcp:10.0.0.1:4001", "mbtcp:10.0.0.1"] {
            let found = check(json!({ "port": port }));
            assert!(
                matches!(&found[..], [("port", Invalid::NotOneOf(_))]),
                "{port}"
            );
        }
        let found = check(json!({"port": "/dev/ttyS9", "baud": 9601}));
        assert!(matches!(&found[..], [("baud", Invalid::NotOneOf(_))]));
        let found = check(json!({"port": "/dev/ttyS9", "units": ["oven"]}));
        assert_eq!(found, [("units", Invalid::BadUnit)]);
    }

    /// A link is the device that it leads to.
    #[test]
    fn a_line_is_found_by_its_device() {
        let folder = std::env::temp_dir().join(format!("railbus-rtu-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let link = folder.join("plc");
        let _ = std::fs::remove_file(&link);
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        let config = config("[line.c]\nport = \"/dev/null\"\n");
        let found = check(&keys(json!({ "port": link })), &config);
        assert_eq!(found, [("port", Invalid::PortTaken("c".to_owned()))]);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn serial_settings_are_those_of_lines() {
        let serial = |settings| serial(&keys(settings)).map(|serial| serial.to_string());
        assert_eq!(serial(json!({})).as_deref(), Some("9600 8N1"));
        let fast = serial(json!({"baud": 115_200, "format": "8O1"}));
        assert_eq!(fast.as_deref(), Some("115200 8O1"));
        assert_eq!(serial(json!({"baud": 9_601})), None);
    }

    #[test]
    fn only_the_owner_gives_it_any_port() {
        let with = |port: &str, more: &str| {
            let outlet = format!("[outlet.plc]\ntype = \"modbus_rtu\"\nport = \"{port}\"\n");
            config(&format!("{outlet}{more}"))
        };
        let nothing = config("");
        assert!(may_lead(&nothing, &with("/dev/ttyUSB9", "")).is_ok());
        let other = "/srv/keys/id";
        let refused = may_lead(&nothing, &with(other, "")).unwrap_err();
        assert_eq!(refused.code, codes::PORT_NOT_ALLOWED.code);
        assert!(may_lead(&with(other, ""), &with(other, "")).is_ok());
        let allowed = with(other, "[ports]\nallow = [\"/srv/*/id\"]\n");
        assert!(may_lead(&nothing, &allowed).is_ok());
    }
}
