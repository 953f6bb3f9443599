//! Every table of a configuration and its keys: those the reader knows and those of the published
//! schema. A test compares them.

use super::{control, outlet, owner, past, plant, ranges, read, rules, webhook};

/// The published JSON Schema of a configuration.
pub const SCHEMA: &str = include_str!("schema.json");

/// The keys of each table, under the table's name in [`SCHEMA`]; that of the whole file is empty.
pub const TABLES: [(&str, &[&str]); 21] = [
    ("", &read::ROOT_KEYS),
    ("line", &read::LINE_KEYS),
    ("module", &read::MODULE_KEYS),
    ("point", &read::POINT_KEYS),
    ("names", &read::NAME_KEYS),
    ("scale", &ranges::RANGE_KEYS),
    ("group", &control::GROUP_KEYS),
    ("scene", &control::SCENE_KEYS),
    ("step", &control::STEP_KEYS),
    ("rule", &rules::RULE_KEYS),
    ("when", &rules::WHEN_KEYS),
    ("action", &rules::ACTION_KEYS),
    ("webhook", &webhook::WEBHOOK_KEYS),
    ("outlet", &outlet::OUTLET_KEYS),
    ("ports", &owner::ALLOW_KEYS),
    ("webhooks", &owner::ALLOW_KEYS),
    ("history", &past::HISTORY_KEYS),
    ("audit", &past::AUDIT_KEYS),
    ("sim", &plant::SIM_KEYS),
    ("line_sim", &plant::LINE_KEYS),
    ("module_sim", &plant::MODULE_KEYS),
];
