//! The models that railbus knows.

use crate::texts::Text;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_device::Family;
use railbus_wire::Protocol;
use railbus_words::Lang;
use serde_json::json;

pub(super) fn records(lang: Lang) -> Records {
    // Columns that may be dropped: title, addresses, speeds, protocols.
    let mut table = Table::new(lang.get(Text::LsModelsHead).split('|')).spare(&[1, 5, 7, 6]);
    let mut rows = Vec::new();
    for family in Family::ALL {
        let profile = family.profile();
        let protocols: Vec<&str> = profile
            .protocols
            .iter()
            .copied()
            .map(Protocol::name)
            .collect();
        let bauds: Vec<u32> = profile.bauds.iter().map(|(_, baud)| baud.rate()).collect();
        let (low, high) = profile.addresses;
        let (first, last) = (bauds.iter().min(), bauds.iter().max());
        table.add([
            profile.name.to_owned(),
            profile.model.to_owned(),
            profile.outputs.to_string(),
            profile.inputs.to_string(),
            profile.analogs.to_string(),
            format!("{low}-{high}"),
            protocols.join(" "),
            format!(
                "{}-{}",
                first.copied().unwrap_or_default(),
                last.copied().unwrap_or_default()
            ),
        ]);
        rows.push(json!({
            "model": profile.name, "title": profile.model, "outputs": profile.outputs,
            "inputs": profile.inputs, "analogs": profile.analogs, "address_min": low,
            "address_max": high, "protocols": protocols, "bauds": bauds,
        }));
    }
    Records {
        key: "models",
        rows,
        columns: &[
            "model",
            "title",
            "outputs",
            "inputs",
            "analogs",
            "address_min",
            "address_max",
        ],
        value: "model",
        table,
    }
}
