//! One configuration of several texts: what a fleet has in common, what a group of sites has, and
//! what is a site's own. What a site says counts more than what its groups say, and that more than
//! what all sites have. Tables are merged key by key; anything else is taken whole.

use super::read::line_and_column;
use std::collections::BTreeMap;
use std::fmt;
use toml_edit::{DocumentMut, Item, Table, TableLike, Value};

/// The most layers of a site: the fleet's, those of 16 groups, and its own.
pub const LAYERS_MAX: usize = 18;

/// For which sites a layer is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LayerOf {
    /// All sites.
    Fleet,
    /// Those of this group.
    Group(String),
    /// This site.
    Site(String),
}

impl fmt::Display for LayerOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LayerOf::Fleet => f.write_str("fleet"),
            LayerOf::Group(name) => write!(f, "group {name}"),
            LayerOf::Site(name) => write!(f, "site {name}"),
        }
    }
}

/// Why layers make no configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LayerError {
    /// The text of this layer is no TOML: line and column from 1, and what the parser says.
    Syntax(LayerOf, usize, usize, String),
    /// Two groups say something else about this key, and the site does not say it itself.
    Conflict(LayerOf, LayerOf, String),
    /// There are more than [`LAYERS_MAX`].
    TooMany,
}

impl fmt::Display for LayerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LayerError::Syntax(of, line, column, why) => {
                write!(f, "{of}, line {line}, column {column}: {why}")
            }
            LayerError::Conflict(one, other, path) => {
                write!(f, "{one} and {other} differ in {path}")
            }
            LayerError::TooMany => write!(f, "more than {LAYERS_MAX} layers"),
        }
    }
}

impl std::error::Error for LayerError {}

/// The text of a site with these layers, in any order. Its first line says what it is made of: a
/// change in it would be gone with the next version.
///
/// # Errors
/// One of them is no TOML, or two groups contradict each other.
pub fn rendered(layers: &BTreeMap<LayerOf, String>) -> Result<String, LayerError> {
    if layers.len() > LAYERS_MAX {
        return Err(LayerError::TooMany);
    }
    let mut whole = Table::new();
    // In the order of what counts more; of groups, none does.
    let mut groups: Vec<(&LayerOf, Table)> = Vec::new();
    let mut own = None;
    for (of, text) in layers {
        let table = parsed(of, text)?;
        match of {
            LayerOf::Fleet => merge(&mut whole, &table),
            LayerOf::Group(_) => groups.push((of, table)),
            LayerOf::Site(_) => own = Some(table),
        }
    }
    for (at, (one, table)) in groups.iter().enumerate() {
        for (other, later) in groups.iter().skip(at + 1) {
            let mut path = Vec::new();
            if let Some(path) = difference(table, later, own.as_ref(), &mut path) {
                let (one, other) = ((*one).clone(), (*other).clone());
                return Err(LayerError::Conflict(one, other, path));
            }
        }
    }
    for (_, table) in &groups {
        merge(&mut whole, table);
    }
    if let Some(own) = &own {
        merge(&mut whole, own);
    }
    let of: Vec<String> = layers.keys().map(ToString::to_string).collect();
    let mut document = DocumentMut::new();
    *document.as_table_mut() = whole;
    // Where tables of several texts stand is no order.
    placeless(document.as_table_mut());
    Ok(format!(
        "# Made at the centre of: {}\n{document}",
        of.join(", ")
    ))
}

fn parsed(of: &LayerOf, text: &str) -> Result<Table, LayerError> {
    let document: Result<DocumentMut, _> = text.parse();
    document.map(DocumentMut::into_table).map_err(|error| {
        let span = error.span().unwrap_or_default();
        let (line, column) = line_and_column(text, &span);
        LayerError::Syntax(of.clone(), line, column, error.message().to_owned())
    })
}

/// Adds what a layer says, which counts more.
fn merge(whole: &mut dyn TableLike, layer: &dyn TableLike) {
    for (key, item) in layer.iter() {
        match (
            whole.get_mut(key).and_then(Item::as_table_like_mut),
            item.as_table_like(),
        ) {
            (Some(known), Some(more)) => merge(known, more),
            _ => _ = whole.insert(key, item.clone()),
        }
    }
}

/// The path of a key about which two tables say different things, and a third one says nothing.
fn difference(
    one: &dyn TableLike,
    other: &dyn TableLike,
    own: Option<&Table>,
    path: &mut Vec<String>,
) -> Option<String> {
    for (key, item) in one.iter() {
        let Some(theirs) = other.get(key) else {
            continue;
        };
        path.push(key.to_owned());
        let found = match (item.as_table_like(), theirs.as_table_like()) {
            (Some(item), Some(theirs)) => difference(item, theirs, own, path),
            _ if is_said(own, path) || is_same(item, theirs) => None,
            _ => Some(path.join(".")),
        };
        path.pop();
        if found.is_some() {
            return found;
        }
    }
    None
}

/// Whether a table says something about this key.
fn is_said(table: Option<&Table>, path: &[String]) -> bool {
    let Some((last, above)) = path.split_last() else {
        return false;
    };
    let mut table = table.map(|table| table as &dyn TableLike);
    for key in above {
        table = table.and_then(|table| table.get(key)?.as_table_like());
    }
    table.is_some_and(|table| table.contains_key(last))
}

/// Whether two values are the same, however they are written.
fn is_same(one: &Item, other: &Item) -> bool {
    if let (Some(one), Some(other)) = (one.as_table_like(), other.as_table_like()) {
        return are_same(one, other);
    }
    match (one, other) {
        (Item::Value(one), Item::Value(other)) => is_same_value(one, other),
        (Item::ArrayOfTables(one), Item::ArrayOfTables(other)) => {
            let mut both = one.iter().zip(other.iter());
            one.len() == other.len() && both.all(|(one, other)| are_same(one, other))
        }
        _ => false,
    }
}

/// The same for all keys of two tables.
fn are_same(one: &dyn TableLike, other: &dyn TableLike) -> bool {
    let has = |(key, item): (&str, &Item)| {
        let theirs = other.get(key);
        theirs.is_some_and(|theirs| is_same(item, theirs))
    };
    one.len() == other.len() && one.iter().all(has)
}

fn is_same_value(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::String(one), Value::String(other)) => one.value() == other.value(),
        (Value::Integer(one), Value::Integer(other)) => one.value() == other.value(),
        (Value::Float(one), Value::Float(other)) => {
            one.value().to_bits() == other.value().to_bits()
        }
        (Value::Boolean(one), Value::Boolean(other)) => one.value() == other.value(),
        (Value::Datetime(one), Value::Datetime(other)) => one.value() == other.value(),
        (Value::InlineTable(one), Value::InlineTable(other)) => are_same(one, other),
        (Value::Array(one), Value::Array(other)) => {
            let mut both = one.iter().zip(other.iter());
            one.len() == other.len() && both.all(|(one, other)| is_same_value(one, other))
        }
        _ => false,
    }
}

/// Forgets where tables stood in their texts: they stand one after the other then.
fn placeless(table: &mut Table) {
    table.set_position(None);
    for (_, item) in table.iter_mut() {
        match item {
            Item::Table(table) => placeless(table),
            Item::ArrayOfTables(all) => all.iter_mut().for_each(placeless),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;

    const FLEET: &str = "[line.main]\nbaud = 9600\n\n[retention]\ndays = 30\n";
    const NORTH: &str = "[line.main]\nbaud = 19200 # slow cables\n";
    const OVENS: &str = "[module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
    const SITE: &str = "[line.main]\nport = \"/dev/ttyS1\"\n\n[module.oven]\naddress = 7\n";

    fn layers(of: &[(LayerOf, &str)]) -> Result<String, LayerError> {
        let all = of.iter();
        rendered(
            &all.map(|(of, text)| (of.clone(), (*text).to_owned()))
                .collect(),
        )
    }

    fn group(name: &str) -> LayerOf {
        LayerOf::Group(name.to_owned())
    }

    fn site() -> LayerOf {
        LayerOf::Site("plant7".to_owned())
    }

    #[test]
    fn what_is_said_closer_to_the_site_counts_more() {
        let text = layers(&[
            (site(), SITE),
            (group("ovens"), OVENS),
            (
                LayerOf::Fleet,
                "[line.main]\nbaud = 9600\nport = \"none\"\n",
            ),
            (group("north"), NORTH),
        ])
        .unwrap();
        let first = "# Made at the centre of: fleet, group north, group ovens, site plant7\n";
        assert!(text.starts_with(first), "{text}");
        let config = Config::parse(&text).unwrap();
        let line = &config.lines["main"];
        assert_eq!(line.port, "/dev/ttyS1");
        assert_eq!(line.serial.baud.rate(), 19_200);
        assert_eq!(config.modules["oven"].setup.address.0, 7);
        // The comment of a value goes with it.
        assert!(text.contains("# slow cables"), "{text}");
    }

    #[test]
    fn groups_must_not_contradict_each_other() {
        let two = |one: &str, other: &str, own: &str| {
            layers(&[(group("a"), one), (group("b"), other), (site(), own)])
        };
        let conflict = |path: &str| {
            let path = path.to_owned();
            Err(LayerError::Conflict(group("a"), group("b"), path))
        };
        let (slow, fast) = (
            "[line.main]\nbaud = 9600\n",
            "line.main = { baud = 19200 }\n",
        );
        assert_eq!(two(slow, fast, ""), conflict("line.main.baud"));
        // The site says what is so.
        let own = two(slow, fast, "[line.main]\nbaud = 4800\n").unwrap();
        assert!(own.contains("4800") && !own.contains("19200"), "{own}");
        // The same in other words is no contradiction.
        assert!(two("a = [1, 2]\n", "a = [ 1,2 ] # so\n", "").is_ok());
        assert_eq!(two("a = [1, 2]\n", "a = [2, 1]\n", ""), conflict("a"));
        assert_eq!(two("[a]\nb = 1\n", "a = 1\n", ""), conflict("a"));
        assert!(two("[a]\nb = 1\n", "[a]\nc = 1\n", "").is_ok());
    }

    #[test]
    fn a_text_that_is_none_is_named_with_its_place() {
        let wrong = layers(&[
            (LayerOf::Fleet, FLEET),
            (group("north"), "a = 1\nb = = 2\n"),
        ]);
        let Err(LayerError::Syntax(of, line, column, why)) = wrong else {
            panic!("{wrong:?}");
        };
        assert_eq!((of, line, column), (group("north"), 2, 5));
        assert!(!why.is_empty());
        let many = (0..=LAYERS_MAX).map(|at| (group(&at.to_string()), String::new()));
        assert_eq!(rendered(&many.collect()), Err(LayerError::TooMany));
    }

    #[test]
    fn what_is_no_table_is_taken_whole() {
        let text = layers(&[
            (
                LayerOf::Fleet,
                "[[a]]\nb = 1\n[[a]]\nb = 2\n[c]\nd = [1, 2]\n",
            ),
            (site(), "[[a]]\nb = 3\n[c]\nd = []\ne = { f = 1 }\n"),
        ])
        .unwrap();
        let value: DocumentMut = text.parse().unwrap();
        assert_eq!(value["a"].as_array_of_tables().unwrap().len(), 1);
        assert_eq!(value["a"][0]["b"].as_integer(), Some(3));
        assert_eq!(value["c"]["d"].as_array().unwrap().len(), 0);
        assert_eq!(value["c"]["e"]["f"].as_integer(), Some(1));
        assert_eq!(layers(&[]).unwrap(), "# Made at the centre of: \n");
    }

    fn is_the_same(one: &str, other: &str) -> bool {
        let table = |text| parsed(&LayerOf::Fleet, text).unwrap();
        are_same(&table(one), &table(other))
    }

    /// Tables of several texts stand by their names, and not by where they stood.
    #[test]
    fn it_reads_as_one_text() {
        let fleet = "[line.main]\nbaud = 9600\n\n[module.oven]\nmodel = \"erc8\"\n";
        let own = "[module.oven.k1]\nname = \"fan\"\n[line.yard]\nport = \"b\"\n";
        let text = layers(&[(LayerOf::Fleet, fleet), (site(), own)]).unwrap();
        let heads: Vec<&str> = text.lines().filter(|line| line.starts_with('[')).collect();
        let wanted = [
            "[line.main]",
            "[line.yard]",
            "[module.oven]",
            "[module.oven.k1]",
        ];
        assert_eq!(heads, wanted);
    }

    /// What is in one layer alone is in the whole, and no layer is changed by its neighbours.
    #[test]
    fn one_layer_says_what_it_says_alone() {
        for text in [FLEET, NORTH, OVENS, SITE] {
            for of in [LayerOf::Fleet, group("north"), site()] {
                let whole = layers(&[(of, text)]).unwrap();
                assert!(is_the_same(&whole, text), "{whole}");
            }
        }
        let whole = layers(&[(LayerOf::Fleet, FLEET), (group("ovens"), OVENS)]).unwrap();
        let again = layers(&[(site(), &whole)]).unwrap();
        assert!(is_the_same(&whole, &again), "{again}");
        assert!(!is_the_same(FLEET, &again));
    }
}
