//! Adds modules to a configuration file's text; what is already there stays as written, comments
//! and blank lines included.

use super::Config;
use railbus_device::Setup;
use railbus_wire::SerialSettings;
use toml_edit::{DocumentMut, Item, Table, value};

/// A line to be written with its modules if the text has none of that name.
#[derive(Clone, Copy, Debug)]
pub struct NewLine<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its port.
    pub port: &'a str,
    /// The speed and character format of its modules.
    pub serial: SerialSettings,
}

/// The text with these modules added to a line, each under its name. `None` if the text is no valid
/// configuration, or would not be one afterwards.
#[must_use]
pub fn with_modules(text: &str, line: NewLine<'_>, modules: &[(String, Setup)]) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let before = Config::parse(text).ok()?;
    let serial = match before.lines.get(line.name) {
        Some(known) => known.serial,
        None => {
            let mut table = Table::new();
            table.insert("port", value(line.port));
            serial_keys(&mut table, line.serial, SerialSettings::FACTORY);
            insert(&mut document, "line", line.name, table)?;
            line.serial
        }
    };
    for (name, setup) in modules {
        let mut table = Table::new();
        table.insert("line", value(line.name));
        table.insert("model", value(setup.family.name()));
        table.insert("address", value(i64::from(setup.address.0)));
        if setup.family.profile().protocols.first() != Some(&setup.protocol) {
            table.insert("protocol", value(setup.protocol.name()));
        }
        serial_keys(&mut table, setup.serial, serial);
        if setup.family.datasheet().channels_vary {
            // No reply tells it: it is written out so that it can be corrected.
            table.insert("outputs", value(i64::from(setup.outputs)));
        }
        if setup.checksum {
            table.insert("checksum", value(true));
        }
        insert(&mut document, "module", name, table)?;
    }
    let after = document.to_string();
    let read = Config::parse(&after).ok()?;
    let is_right = |(name, setup): &(String, Setup)| {
        read.modules
            .get(name)
            .is_some_and(|read| read.setup == *setup)
    };
    modules.iter().all(is_right).then_some(after)
}

/// A name for a module that this configuration does not use yet: `erc8_3`, `erc8_3_2`.
#[must_use]
pub fn free_name(config: &Config, taken: &[(String, Setup)], setup: &Setup) -> String {
    let base = format!("{}_{}", setup.family.name(), setup.address.0);
    let is_free = |name: &String| {
        !config.modules.contains_key(name) && taken.iter().all(|(other, _)| other != name)
    };
    let numbered = (2..).map(|number: u32| format!("{base}_{number}"));
    let mut names = std::iter::once(base.clone()).chain(numbered);
    names.find(is_free).unwrap_or(base)
}

/// Writes speed and format where they differ from the defaults.
fn serial_keys(table: &mut Table, serial: SerialSettings, anyway: SerialSettings) {
    if serial.baud != anyway.baud {
        table.insert("baud", value(i64::from(serial.baud.rate())));
    }
    if serial.character != anyway.character {
        table.insert("format", value(serial.character.to_string()));
    }
}

/// Adds the table `[kind.name]` at the end.
fn insert(document: &mut DocumentMut, kind: &str, name: &str, mut table: Table) -> Option<()> {
    if !document.as_table().is_empty() {
        table.decor_mut().set_prefix("\n");
    }
    let kinds = document.as_table_mut().entry(kind).or_insert_with(|| {
        let mut implicit = Table::new();
        implicit.set_implicit(true);
        Item::Table(implicit)
    });
    match kinds {
        Item::Table(kinds) => kinds.insert(name, Item::Table(table)),
        other => {
            let inline = Item::Value(table.into_inline_table().into());
            other.as_table_like_mut()?.insert(name, inline)
        }
    };
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;
    use railbus_wire::{Address, Baud, Protocol};

    const LINE: NewLine<'_> = NewLine {
        name: "main",
        port: "/dev/ttyUSB0",
        serial: SerialSettings::FACTORY,
    };

    fn found() -> Vec<(String, Setup)> {
        let oven = Setup::new(Family::Erc8, Address(3));
        let gate = Setup {
            protocol: Protocol::Lc02,
            serial: SerialSettings {
                baud: Baud::B19200,
                ..SerialSettings::FACTORY
            },
            ..Setup::new(Family::Eda9050, Address(2))
        };
        let pump = Setup {
            checksum: true,
            ..Setup::new(Family::Eda9060a, Address(1))
        };
        let all = [oven, gate, pump].into_iter();
        all.map(|setup| (free_name(&Config::default(), &[], &setup), setup))
            .collect()
    }

    #[test]
    fn a_new_text_says_all_of_it() {
        let text = with_modules("", LINE, &found()).unwrap();
        let expected = "[line.main]\nport = \"/dev/ttyUSB0\"\n\n\
            [module.erc8_3]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\n\
            [module.eda9050_2]\nline = \"main\"\nmodel = \"eda9050\"\naddress = 2\n\
            protocol = \"lc02\"\nbaud = 19200\n\n\
            [module.eda9060a_1]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n\
            checksum = true\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_board_that_does_not_tell_its_channels_is_written_with_their_number() {
        let board = Setup {
            outputs: 8,
            ..Setup::new(Family::R55, Address(1))
        };
        let text = with_modules("", LINE, &[("yard".to_owned(), board)]).unwrap();
        assert!(text.ends_with("address = 1\noutputs = 8\n"), "{text}");
    }

    #[test]
    fn what_was_written_stays_as_it_was() {
        let text = "# our site\n[line.main] # the only one\nport = \"/dev/ttyUSB0\"\n\n\
            [module.erc8_3] # ours\nline = 'main'\nmodel = \"erc8\"\naddress = 0x04 # moved\n";
        let config = Config::parse(text).unwrap();
        let setup = Setup::new(Family::Erc8, Address(3));
        let name = free_name(&config, &[], &setup);
        assert_eq!(name, "erc8_3_2");
        let after = with_modules(text, LINE, &[(name, setup)]).unwrap();
        assert!(after.starts_with(text), "{after}");
        assert!(after.contains("\n[module.erc8_3_2]\n"), "{after}");
    }

    #[test]
    fn a_text_that_would_be_no_configuration_is_not_made() {
        let taken = "[line.main]\nport = \"/dev/ttyUSB0\"\n[module.oven]\nline = \"main\"\n\
            model = \"erc8\"\naddress = 3\n";
        assert_eq!(with_modules(taken, LINE, &found()), None);
        assert_eq!(with_modules("[line", LINE, &found()), None);
    }
}
