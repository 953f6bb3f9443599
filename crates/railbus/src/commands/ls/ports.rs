//! The serial ports of this machine. Listing them opens none.

use crate::texts::Text;
use railbus_app::machine::{Machine, ports};
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_words::Lang;
use railbus_words::time;
use serde_json::json;

pub(super) fn records(lang: Lang, machine: &Machine) -> Records {
    // Columns that may be dropped: latency, since when, driver, holder.
    let mut table = Table::new(lang.get(Text::LsPortsHead).split('|')).spare(&[2, 4, 1, 3]);
    let mut rows = Vec::new();
    for port in ports::adapters(machine) {
        let dash = || "–".to_owned();
        let holders = port.holders.iter();
        let held: Vec<String> = holders
            .map(|(pid, name)| format!("{name} ({pid})"))
            .collect();
        let plugged = port.plugged_s.map(|seconds| time::span(lang, seconds));
        let stable = port.stable.as_ref().or(port.socket.as_ref());
        table.add([
            port.device.clone(),
            port.driver.clone().unwrap_or_else(dash),
            port.latency_ms.map_or_else(dash, |ms| format!("{ms} ms")),
            if held.is_empty() {
                dash()
            } else {
                held.join(" ")
            },
            plugged.unwrap_or_else(dash),
            stable.cloned().unwrap_or_else(dash),
        ]);
        rows.push(json!({
            "port": port.device, "driver": port.driver, "latency_timer_ms": port.latency_ms,
            "held_by": held, "plugged_s": port.plugged_s, "stable": stable,
            "usb": port.usb.map(|(vendor, product)| format!("{vendor:04x}:{product:04x}")),
        }));
    }
    Records {
        key: "ports",
        rows,
        columns: &["port", "driver", "latency_timer_ms", "plugged_s", "stable"],
        value: "port",
        table,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_app::machine::fixture::Fixture;
    use railbus_app::render::Format;

    #[test]
    fn a_port_is_listed_with_its_holder_in_both_languages() {
        let tree = Fixture::new("ls-ports");
        tree.ftdi().program(812, "mbusd", "/dev/ttyUSB0");
        let shown = |lang| records(lang, &tree.machine()).render(Format::Table);
        assert_eq!(
            shown(Lang::En),
            "PORT          DRIVER    LATENCY  HELD BY      PLUGGED IN  STABLE NAME\n\
             /dev/ttyUSB0  ftdi_sio  16 ms    mbusd (812)  1 h         \
             /dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0\n"
        );
        assert_eq!(
            shown(Lang::Zh),
            "端口          驱动      延迟   占用者       已插入  固定名称\n\
             /dev/ttyUSB0  ftdi_sio  16 ms  mbusd (812)  1 小时  \
             /dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0\n"
        );
    }
}
