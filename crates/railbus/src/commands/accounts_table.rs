//! Tables of users and tokens.

use super::user::UserText;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_words::Lang;
use serde_json::Value;

/// All users.
pub(super) fn users(lang: Lang, told: &Value) -> Records {
    let rows = rows(told, "users");
    let mut table = Table::new(lang.get(UserText::UsersHead).split('|'));
    for row in &rows {
        let locked = row.get("locked") == Some(&Value::Bool(true));
        let state = if locked {
            UserText::IsLocked
        } else {
            UserText::Good
        };
        table.add([
            text(row, "name"),
            text(row, "role"),
            points(lang, row),
            lang.get(state).to_owned(),
            day(row, "created"),
        ]);
    }
    Records {
        key: "users",
        rows,
        columns: &["name", "role", "points", "locked", "created"],
        value: "name",
        table,
    }
}

/// All tokens.
pub(super) fn tokens(lang: Lang, told: &Value) -> Records {
    let rows = rows(told, "tokens");
    let mut table = Table::new(lang.get(UserText::TokensHead).split('|'));
    for row in &rows {
        let expired = row.get("expired") == Some(&Value::Bool(true));
        let state = if expired {
            UserText::Expired
        } else {
            UserText::Good
        };
        table.add([
            text(row, "name"),
            text(row, "role"),
            points(lang, row),
            lang.get(state).to_owned(),
            text(row, "by"),
            day(row, "expires"),
            text(row, "id"),
        ]);
    }
    Records {
        key: "tokens",
        rows,
        columns: &["name", "role", "points", "expired", "by", "expires", "id"],
        value: "name",
        table,
    }
}

fn rows(told: &Value, key: &str) -> Vec<Value> {
    let rows = told.get(key).and_then(Value::as_array);
    rows.cloned().unwrap_or_default()
}

/// A text field of an account.
pub(super) fn text(row: &Value, key: &str) -> String {
    let text = row.get(key).and_then(Value::as_str);
    text.unwrap_or_default().to_owned()
}

/// The day of a time.
pub(super) fn day(row: &Value, key: &str) -> String {
    let time = text(row, key);
    time.split('T').next().unwrap_or_default().to_owned()
}

fn points(lang: Lang, row: &Value) -> String {
    let points = row.get("points").and_then(Value::as_array);
    let points = points.into_iter().flatten().filter_map(Value::as_str);
    let points: Vec<&str> = points.collect();
    match points.is_empty() {
        true => lang.get(UserText::All).to_owned(),
        false => points.join(" "),
    }
}
