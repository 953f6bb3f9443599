//! Changes a configuration file's text; what is not changed stays as written, comments and blank
//! lines included.

use super::Config;
use super::keeper::{TEXT_MAX, too_long};
use railbus_commission::BusAddress;
use railbus_store::durable::{self, beside};
use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use toml_edit::{DocumentMut, Item, Value, value};

/// How many backups of a file are kept beside it: `railbus.toml.1` is the newest.
pub const GENERATIONS: usize = 5;

/// The text with a module's address and serial settings changed to those it answers at now. `None`
/// if the text has no such module, or would not be a valid configuration afterwards.
#[must_use]
pub fn moved(text: &str, module: &str, place: BusAddress) -> Option<String> {
    let before = Config::parse(text).ok()?;
    let of_line = before.lines.get(&before.modules.get(module)?.line)?.serial;
    let mut document: DocumentMut = text.parse().ok()?;
    let table = document
        .get_mut("module")?
        .get_mut(module)?
        .as_table_like_mut()?;
    set(table, "address", i64::from(place.address.0).into(), true);
    let baud = i64::from(place.serial.baud.rate());
    set(
        table,
        "baud",
        baud.into(),
        place.serial.baud != of_line.baud,
    );
    let format = place.serial.character.to_string();
    set(
        table,
        "format",
        format.into(),
        place.serial.character != of_line.character,
    );
    set(table, "checksum", place.checksum.into(), place.checksum);
    let after = document.to_string();
    let read = Config::parse(&after).ok()?;
    (BusAddress::of(&read.modules.get(module)?.setup) == place).then_some(after)
}

/// Sets a key, keeping its comment. A key with the default value is not added.
fn set(table: &mut dyn toml_edit::TableLike, key: &str, new: Value, needed: bool) {
    match table.get_mut(key) {
        Some(Item::Value(old)) => {
            let decor = old.decor().clone();
            *old = new;
            *old.decor_mut() = decor;
        }
        Some(other) => *other = value(new),
        None if needed => {
            table.insert(key, value(new));
        }
        None => {}
    }
}

/// Why a text was not written.
#[derive(Debug)]
pub enum WriteError {
    /// The file was changed since the writer read it.
    Changed,
    /// The system refused.
    Io(io::Error),
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            WriteError::Changed => f.write_str("the file was changed meanwhile"),
            WriteError::Io(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for WriteError {}

impl From<io::Error> for WriteError {
    fn from(error: io::Error) -> WriteError {
        WriteError::Io(error)
    }
}

/// Replaces or creates a file; if `seen` is given, only while the file still has that text. The
/// previous texts are kept beside it, up to [`GENERATIONS`].
///
/// # Errors
/// If the file was changed since it was read, or the system refuses.
pub fn replace(file: &Path, seen: Option<&str>, text: &str) -> Result<(), WriteError> {
    let _held = hold(file)?;
    if let Some(seen) = seen
        && text_of(file)? != seen
    {
        return Err(WriteError::Changed);
    }
    if file.exists() {
        keep(&real(file))?;
    }
    Ok(put(file, text)?)
}

/// Locks the folder: no other process of this program changes a file in it until this is dropped.
pub(super) fn hold(file: &Path) -> io::Result<File> {
    let folder = File::open(folder_of(&real(file)))?;
    folder.lock()?;
    Ok(folder)
}

/// The text of a file; empty if there is no file.
pub(super) fn text_of(file: &Path) -> io::Result<String> {
    let opened = match File::open(file) {
        Ok(opened) => opened,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(String::new()),
        Err(error) => return Err(error),
    };
    let mut text = String::new();
    let most = TEXT_MAX as u64 + 1;
    opened.take(most).read_to_string(&mut text)?;
    if text.len() > TEXT_MAX {
        return Err(too_long());
    }
    Ok(text)
}

/// Through a link, the file itself is replaced.
fn real(file: &Path) -> PathBuf {
    std::fs::canonicalize(file).unwrap_or_else(|_| file.to_owned())
}

fn folder_of(file: &Path) -> &Path {
    let folder = file.parent().filter(|path| !path.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Replaces or creates a file atomically: there is a whole one at every moment, and after every
/// loss of power.
pub(super) fn put(file: &Path, text: &str) -> io::Result<()> {
    let file = &real(file);
    let before = match std::fs::metadata(file) {
        Ok(before) => Some(before.mode() & 0o777),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    durable::replace(file, text.as_bytes(), before)
}

/// Keeps a copy of the file as its newest backup.
fn keep(file: &Path) -> io::Result<()> {
    for generation in (1..GENERATIONS).rev() {
        let older = beside(file, &(generation + 1).to_string());
        match std::fs::rename(beside(file, &generation.to_string()), older) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    let kept = beside(file, "1");
    std::fs::copy(file, &kept)?;
    File::open(&kept)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_wire::{Address, Baud, Character, SerialSettings};

    const TEXT: &str = "# our site\n[line.main] # the only one\nport = \"/dev/ttyUSB0\"\n\n\
        [module.pump] # in the cellar\nline = \"main\"\nmodel = \"eda9060a\"\n\
        address = 1    # DIP has none\n\n[module.oven]\nline = \"main\"\nmodel = \"erc8\"\n\
        address = 0x03\n";

    fn place(address: u8, baud: Baud) -> BusAddress {
        let serial = SerialSettings {
            baud,
            character: Character::N1,
        };
        BusAddress {
            address: Address(address),
            serial,
            checksum: false,
        }
    }

    #[test]
    fn only_what_changes_is_changed() {
        let text = moved(TEXT, "pump", place(9, Baud::B9600)).unwrap();
        assert_eq!(text, TEXT.replace("address = 1    #", "address = 9    #"));
        let text = moved(TEXT, "pump", place(1, Baud::B19200)).unwrap();
        assert_eq!(
            text,
            TEXT.replace("# DIP has none\n", "# DIP has none\nbaud = 19200\n")
        );
        let back = moved(&text, "pump", place(1, Baud::B9600)).unwrap();
        assert!(back.contains("baud = 9600"), "{back}");
    }

    #[test]
    fn a_text_that_would_be_no_configuration_is_not_made() {
        assert_eq!(moved(TEXT, "tank", place(9, Baud::B9600)), None);
        assert_eq!(moved(TEXT, "oven", place(99, Baud::B9600)), None);
        assert_eq!(moved("[line", "oven", place(9, Baud::B9600)), None);
    }

    #[test]
    fn the_last_generations_are_kept() {
        let folder = std::env::temp_dir().join(format!("railbus-{}-edit", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("railbus.toml");
        std::fs::write(&file, "0").unwrap();
        for text in 1..=7 {
            replace(&file, Some(&(text - 1).to_string()), &text.to_string()).unwrap();
        }
        let unseen = replace(&file, Some("6"), "8");
        assert!(matches!(unseen, Err(WriteError::Changed)), "{unseen:?}");
        let read = |file: &Path| std::fs::read_to_string(file).unwrap();
        assert_eq!(read(&file), "7");
        for (generation, text) in (1..=GENERATIONS).zip(["6", "5", "4", "3", "2"]) {
            assert_eq!(read(&beside(&file, &generation.to_string())), text);
        }
        assert!(!beside(&file, "6").exists() && !beside(&file, "new").exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
