//! Every point, for a spreadsheet.

use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_site::Config;
use railbus_site::config::ModuleConfig;
use serde_json::{Value, json};

/// Every point, one per line.
pub(super) fn points(config: &Config) -> Records {
    let of_module = |(name, module): (&String, &ModuleConfig)| {
        let (setup, port) = (module.setup, config.lines.get(&module.line));
        let port = port.map_or("", |line| line.port.as_str());
        let row = |point| {
            let (prefix, number) = setup.label(point);
            let label = format!("{prefix}{number}");
            let about = module.points.get(&point);
            json!({
                "point": format!("{name}.{label}"), "module": name, "label": label,
                "index": point.index, "line": module.line, "port": port,
                "model": setup.family.name(), "address": setup.address.0,
                "protocol": setup.protocol.name(), "baud": setup.serial.baud.rate(),
                "format": setup.serial.character.to_string(),
                "name_en": about.and_then(|about| about.name_en.clone()),
                "name_zh": about.and_then(|about| about.name_zh.clone()),
            })
        };
        setup.points().map(row).collect::<Vec<Value>>()
    };
    Records {
        key: "points",
        rows: config.modules.iter().flat_map(of_module).collect(),
        columns: &[
            "point", "module", "label", "index", "line", "port", "model", "address", "protocol",
            "baud", "format", "name_en", "name_zh",
        ],
        value: "point",
        table: Table::bare(),
    }
}
