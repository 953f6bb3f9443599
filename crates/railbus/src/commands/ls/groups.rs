//! `railbus ls groups`: outputs that are switched together.

use crate::texts::Text;
use railbus_api::control::GroupInfo;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::render::values;
use railbus_words::Lang;

/// The list of groups.
pub(super) fn records(lang: Lang, groups: &[GroupInfo]) -> Records {
    let head = lang.get(Text::LsGroupsHead).split('|');
    let mut table = Table::new(head).spare(&[2, 1]).names(1);
    for group in groups {
        let name = values::called(lang, &group.name);
        table.add([
            format!("@{}", group.group),
            name,
            group.frames.to_string(),
            group.members.join(" "),
        ]);
    }
    Records {
        key: "groups",
        rows: super::json_of(groups),
        columns: &["group", "frames"],
        value: "group",
        table,
    }
}
