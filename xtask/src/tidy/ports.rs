//! `ports`: a line has one master, `railbus_host::Line`, which knows what may answer. Who opens a
//! port besides it is named here, with the reason.

use super::report::Report;
use super::tree::{Tree, matches};

/// Where the line's master and its ports are.
const HOME: &str = "crates/host/";

/// What opens a port: its types, and the master over a port opened elsewhere.
const OPENERS: [&str; 6] = [
    "AnyPort::new(",
    "SerialPort::new(",
    "SerialPort::pseudo(",
    "TcpPort::new(",
    "ModbusTcpPort::new(",
    "Line::over(",
];

/// Who else may open one, and why. A sender needs exclusive access to the line: the daemon lends
/// it, or the port is locked.
const ALLOWED: &[(&str, &str)] = &[
    (
        "crates/app/src/doctor/line.rs",
        "listens before anybody is asked, and sends nothing",
    ),
    (
        "crates/railbus/src/commands/sniff/source.rs",
        "listens only: the port is opened for reading",
    ),
    (
        "crates/railbus/src/commands/replay/module.rs",
        "answers as the modules of a recording, and is no master",
    ),
    (
        "crates/gateway/src/northbound/modbus_rtu/server.rs",
        "answers a master of its own, and is none",
    ),
    (
        "crates/gateway/src/northbound/modbus_rtu/served.rs",
        "the test of it: another program that has its port",
    ),
    (
        "crates/railbus/src/commands/raw/unknown.rs",
        "sends bytes that are no request, which the line's master can't send",
    ),
    (
        "crates/app/src/settings/port.rs",
        "a change of settings follows its module to another speed, and hears who else answers",
    ),
];

pub(super) fn check(tree: &Tree, report: &mut Report) {
    for (path, source) in tree.rust(&["crates/*/src/"]) {
        let allowed = ALLOWED.iter().any(|(pattern, _)| matches(pattern, path));
        if path.starts_with(HOME) || allowed {
            continue;
        }
        for (line, code) in source.shipped_lines() {
            if OPENERS.iter().any(|opener| code.contains(opener)) {
                report.add(
                    path,
                    line,
                    "opens a port besides the line's master",
                    "use `railbus_host::Line`, or name the file and the reason in ALLOWED of \
                     xtask/src/tidy/ports.rs",
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    /// A port is opened in `railbus`; that in `host`, that of a test and a line of the master are
    /// none of its business.
    #[test]
    fn fixture() {
        let found = crate::tidy::found("ports", check);
        assert_eq!(found, ["crates/railbus/src/lib.rs:5"]);
    }
}
