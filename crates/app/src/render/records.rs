//! A list of similar records, in any format.

use super::Format;
use super::table::Table;
use railbus_words::width;
use serde_json::{Map, Value, json};

/// A result that is a list.
#[derive(Debug)]
pub struct Records {
    /// The key of the list in JSON.
    pub key: &'static str,
    /// The records for programs.
    pub rows: Vec<Value>,
    /// The keys that CSV contains, in this order.
    pub columns: &'static [&'static str],
    /// The key whose bare value `-o value` prints.
    pub value: &'static str,
    /// For people.
    pub table: Table,
}

impl Records {
    /// The whole result in this format.
    pub fn render(&self, format: Format) -> String {
        match format {
            Format::Table => self.table.render_within(width::terminal()),
            Format::Json => {
                let mut all = Map::new();
                all.insert("schema".to_owned(), json!(1));
                all.insert(self.key.to_owned(), self.rows.clone().into());
                format!("{}\n", Value::from(all))
            }
            Format::Ndjson => self.rows.iter().map(|row| line(row.clone())).collect(),
            Format::Csv => self.columns.join(",") + "\n" + &self.rows_in(format),
            Format::Value => self.rows_in(format),
        }
    }

    /// The rows alone, as CSV or as bare values.
    pub fn rows_in(&self, format: Format) -> String {
        if format == Format::Csv {
            return self.rows.iter().map(|row| csv(row, self.columns)).collect();
        }
        // A bare value can't show its quality, nor the reason for a missing one.
        let doubtful = |row: &Value| {
            let quality = row.get("quality").and_then(Value::as_str);
            quality.is_some_and(|quality| quality != "good")
        };
        let bare = |row: &Value| match row.get(self.value).unwrap_or(&Value::Null) {
            Value::Null if self.value == "value" => "?".to_owned(),
            _ if doubtful(row) => "?".to_owned(),
            value => plain(value),
        };
        self.rows.iter().map(|row| bare(row) + "\n").collect()
    }
}

/// One document of a stream.
pub fn line(mut row: Value) -> String {
    if let Some(row) = row.as_object_mut() {
        row.insert("schema".to_owned(), json!(1));
    }
    format!("{row}\n")
}

/// One line of CSV.
pub fn csv(row: &Value, columns: &[&str]) -> String {
    let of = |key: &&str| cell(row.get(*key).unwrap_or(&Value::Null));
    let cells: Vec<String> = columns.iter().map(of).collect();
    cells.join(",") + "\n"
}

/// A value without quotes; states as `on` and `off`.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::Bool(on) => if *on { "on" } else { "off" }.to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// A cell of CSV, quoted if necessary.
fn cell(value: &Value) -> String {
    let text = plain(value);
    if text.contains([',', '"', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn records() -> Records {
        let mut table = Table::new(["POINT"]);
        table.add(["a".to_owned()]);
        Records {
            key: "points",
            rows: vec![
                json!({"path": "a", "value": true}),
                json!({"path": "b, \"c\"", "value": 8.5}),
                json!({"path": "d", "value": null}),
            ],
            columns: &["path", "value", "unit"],
            value: "value",
            table,
        }
    }

    #[test]
    fn every_form_tells_the_same() {
        let of = |format| records().render(format);
        assert_eq!(of(Format::Table), "POINT\na\n");
        assert_eq!(of(Format::Value), "on\n8.5\n?\n");
        assert_eq!(
            of(Format::Csv),
            "path,value,unit\na,on,\n\"b, \"\"c\"\"\",8.5,\nd,,\n"
        );
        let json: Value = serde_json::from_str(&of(Format::Json)).unwrap();
        assert_eq!(json["schema"], 1);
        assert_eq!(json["points"][1]["value"], 8.5);
        for line in of(Format::Ndjson).lines() {
            let json: Value = serde_json::from_str(line).unwrap();
            assert_eq!(json["schema"], 1);
        }
    }
}
