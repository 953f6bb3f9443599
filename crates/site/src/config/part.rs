//! The part of a configuration that a centre may say. The rest is the site's own: which
//! integrations it has, what is recorded, and what its owner allows. A layer of a centre can't know
//! where a site keeps its credentials.

use super::Config;
use super::read::line_and_column;
use std::fmt;
use toml_edit::{DocumentMut, Item, Table};

/// The tables that only a site itself says.
pub const OWN_TABLES: [&str; 6] = ["audit", "history", "outlet", "ports", "webhook", "webhooks"];

/// Behind everything else.
const BEHIND: isize = 1 << 30;

/// Why two texts make no configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PartError {
    /// It is no TOML: line and column from 1, and what the parser says.
    Syntax(usize, usize, String),
    /// It says what only the site itself says: these tables.
    Own(Vec<String>),
}

impl fmt::Display for PartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PartError::Syntax(line, column, why) => {
                write!(f, "line {line}, column {column}: {why}")
            }
            PartError::Own(tables) => f.write_str(&tables.join(" ")),
        }
    }
}

impl std::error::Error for PartError {}

/// What a centre may say of this text; empty if there is no key in it.
///
/// # Errors
/// It is no TOML.
pub fn part_of(text: &str) -> Result<String, PartError> {
    let mut document = parsed(text)?;
    document.retain(|name, _| !is_own(name));
    Ok(match document.is_empty() {
        true => String::new(),
        false => document.to_string(),
    })
}

/// The text of the file with this part in the place of the one that it has.
///
/// # Errors
/// One of them is no TOML, or the part says what is the site's own.
pub fn with_part(file: &str, part: &str) -> Result<String, PartError> {
    let mut document = parsed(part)?;
    let said = document.iter().map(|(name, _)| name);
    let said: Vec<String> = said
        .filter(|name| is_own(name))
        .map(str::to_owned)
        .collect();
    if !said.is_empty() {
        return Err(PartError::Own(said));
    }
    let mut file = parsed(file)?.into_table();
    for name in OWN_TABLES {
        // With what is said of the key.
        if let Some((key, mut item)) = file.remove_entry(name) {
            behind(&mut item);
            document.insert_formatted(&key, item);
        }
    }
    Ok(document.to_string())
}

/// The text before, as far as a centre may say it, in a file whose other part may have been changed
/// since; the whole text before, where nothing was, or where that makes no configuration: what was
/// changed may name a module that is there no longer.
#[must_use]
pub fn taken_back(now: &str, after: &str, before: &str) -> String {
    let composed = || {
        let text = with_part(now, &part_of(before).ok()?).ok()?;
        Config::parse(&text).is_ok().then_some(text)
    };
    let composed = if now == after { None } else { composed() };
    composed.unwrap_or_else(|| before.to_owned())
}

fn is_own(table: &str) -> bool {
    OWN_TABLES.contains(&table)
}

fn parsed(text: &str) -> Result<DocumentMut, PartError> {
    text.parse().map_err(|error: toml_edit::TomlError| {
        let (line, column) = line_and_column(text, &error.span().unwrap_or_default());
        PartError::Syntax(line, column, error.message().to_owned())
    })
}

/// Moves it behind everything else, in its order.
fn behind(item: &mut Item) {
    match item {
        Item::Table(table) => table_behind(table),
        Item::ArrayOfTables(all) => all.iter_mut().for_each(table_behind),
        _ => {}
    }
}

fn table_behind(table: &mut Table) {
    let position = table
        .position()
        .map_or(BEHIND, |at| at.saturating_add(BEHIND));
    table.set_position(Some(position));
    table.iter_mut().for_each(|(_, item)| behind(item));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FILE: &str = "\
# The plant in the north.
audit = true

[line.hall] # by the door
port = \"/dev/ttyS1\"

# To the office.
[outlet.hq]
type = \"fleet\"
servers = [\"nats1\"] # one

[module.oven]
line = \"hall\"
model = \"erc8\"
address = 3

[[webhooks]]
x = 1
# The end.
";

    #[test]
    fn a_part_takes_the_place_of_the_one_before_and_the_rest_stays() {
        let part = part_of(FILE).unwrap();
        assert_eq!(
            part,
            "\n[line.hall] # by the door\nport = \"/dev/ttyS1\"\n\n[module.oven]\nline = \"hall\"\n\
             model = \"erc8\"\naddress = 3\n# The end.\n"
        );
        let new = "# New.\n[line.yard]\nport = \"/dev/ttyS2\"\n";
        assert_eq!(
            with_part(FILE, new).unwrap(),
            "# The plant in the north.\naudit = true\n\
             # New.\n[line.yard]\nport = \"/dev/ttyS2\"\n\n\
             # To the office.\n[outlet.hq]\ntype = \"fleet\"\nservers = [\"nats1\"] # one\n\n\
             [[webhooks]]\nx = 1\n"
        );
        assert_eq!(part_of("# Nothing.\n[outlet.hq]\n[ports]\n").unwrap(), "");
        assert_eq!(with_part("", "").unwrap(), "");
    }

    #[test]
    fn what_is_the_sites_own_is_not_taken_from_elsewhere() {
        let refused = with_part(FILE, "[module.oven]\n[audit]\n[outlet.other]\n");
        let own = ["audit", "outlet"].map(str::to_owned);
        assert_eq!(refused, Err(PartError::Own(own.to_vec())));
        let refused = with_part(FILE, "outlet.hq.enabled = false\n");
        assert_eq!(refused, Err(PartError::Own(vec!["outlet".to_owned()])));
        let wrong = with_part(FILE, "[line.hall]\nport = =\n").unwrap_err();
        assert!(matches!(wrong, PartError::Syntax(2, 8, _)), "{wrong}");
    }

    /// Tables in any order, with keys, dotted keys, arrays and comments.
    fn text(names: &'static [&'static str]) -> impl Strategy<Value = String> {
        let table = (
            proptest::sample::select(names),
            "[a-c]",
            proptest::sample::select(vec![
                "[{t}.{n}]\nx = 1\n",
                "\n# About.\n[{t}.{n}] # so\nx = \"[y]\"\n",
                "{t}.{n}.x = 2\n",
                "[[{t}.{n}]]\nx = 1\n[[{t}.{n}]]\nx = 2\n",
                "[{t}.{n}.deep.er]\nx = [\n  1, # one\n  2,\n]\n",
                "# Only said.\n",
            ]),
        );
        let all = proptest::collection::vec(table, 0..7);
        all.prop_map(|all| {
            // Keys of the root stand before all tables.
            let texts = all.iter();
            let texts = texts.map(|(t, n, form)| form.replace("{t}", t).replace("{n}", n));
            let (first, last): (Vec<_>, Vec<_>) =
                texts.partition(|text| !text.contains('[') || text.starts_with("{t}"));
            first.concat() + &last.concat()
        })
        .prop_filter("names are used once", |text| {
            text.parse::<DocumentMut>().is_ok()
        })
    }

    /// The values of the wanted tables, by their paths.
    fn values(text: &str, is_wanted: fn(&str) -> bool) -> Vec<String> {
        let mut document: DocumentMut = text.parse().unwrap();
        document.retain(|name, _| is_wanted(name));
        let mut found = Vec::new();
        flat("", document.as_item(), &mut found);
        found.sort();
        found
    }

    fn flat(path: &str, item: &Item, found: &mut Vec<String>) {
        match item {
            Item::None => {}
            Item::Value(value) => found.push(format!("{path} = {}", value.to_string().trim())),
            Item::Table(table) => {
                let each = table.iter();
                each.for_each(|(name, item)| flat(&format!("{path}.{name}"), item, found));
            }
            Item::ArrayOfTables(all) => {
                for (at, table) in all.iter().enumerate() {
                    let each = table.iter();
                    each.for_each(|(name, item)| flat(&format!("{path}.{at}.{name}"), item, found));
                }
            }
        }
    }

    proptest! {
        #[test]
        fn two_parts_are_told_apart_whatever_their_form(
            file in text(&["line", "outlet", "audit", "module"]),
            part in text(&["line", "group", "module"]),
        ) {
            let whole = with_part(&file, &part).unwrap();
            prop_assert_eq!(values(&whole, is_own), values(&file, is_own));
            prop_assert_eq!(values(&whole, |name| !is_own(name)), values(&part, |_| true));
            // What is known of a text by its hash does not change with the next one.
            let told = part_of(&whole).unwrap();
            prop_assert_eq!(&with_part(&whole, &part).unwrap(), &whole);
            let again = with_part(&whole, &told).unwrap();
            prop_assert_eq!(&part_of(&again).unwrap(), &told);
        }
    }

    #[test]
    fn what_is_taken_back_leaves_what_the_site_has_said_since() {
        let before = "[line.hall]\nport = \"/dev/ttyS1\"\n[ports]\nallow = []\n";
        let after = with_part(before, "[line.yard]\nport = \"/dev/ttyS2\"\n").unwrap();
        assert_eq!(taken_back(&after, &after, before), before);
        let now = after.replace("[]", "[\"/x\"]");
        assert_eq!(
            taken_back(&now, &after, before),
            before.replace("[]", "[\"/x\"]")
        );
        // It has to be a configuration.
        let hook = "[webhook.n]\nurl = \"http://10.0.0.7/\"\nlines = [\"yard\"]\n";
        let named = format!("{after}{hook}");
        assert!(Config::parse(&named).is_ok());
        assert_eq!(taken_back(&named, &after, before), before);
    }
}
