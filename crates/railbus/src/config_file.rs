//! Where the configuration lies, and how it is read.

use crate::api::failures::bad_config;
use crate::api::problem::{Problem, codes};
use crate::i18n::Lang;
use railbus_site::Config;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The name of the file.
const NAME: &str = "railbus.toml";
/// The longest configuration.
const LEN_MAX: u64 = 1 << 20;

/// A configuration and where it was found.
#[derive(Debug)]
pub(crate) struct Found {
    /// The file.
    pub(crate) path: PathBuf,
    /// What it says.
    pub(crate) config: Config,
}

/// Reads the configuration: the one named, or else the first of `$RAILBUS_CONFIG`,
/// `railbus.toml` here or in a parent, the user's own, and the system's.
pub(crate) fn read(lang: Lang, named: Option<&Path>) -> Result<Found, Problem> {
    let path = match named {
        Some(path) => path.to_owned(),
        None => find()?,
    };
    let text = text_of(&path)?;
    let config = Config::parse(&text)
        .map_err(|problems| bad_config(lang, &path.display().to_string(), &problems))?;
    Ok(Found { path, config })
}

/// The text of a file.
pub(crate) fn text_of(path: &Path) -> Result<String, Problem> {
    let failed = |why: String| {
        Problem::new(codes::CONFIG_FILE)
            .with("file", path.display().to_string())
            .with("reason", why)
    };
    let file = std::fs::File::open(path).map_err(|error| failed(error.to_string()))?;
    let mut text = String::new();
    let read = file.take(LEN_MAX + 1).read_to_string(&mut text);
    let len = read.map_err(|error| failed(error.to_string()))?;
    if len as u64 > LEN_MAX {
        return Err(failed(format!("longer than {LEN_MAX} bytes")));
    }
    Ok(text)
}

/// The first of the usual places where there is a file.
fn find() -> Result<PathBuf, Problem> {
    if let Some(path) = std::env::var_os("RAILBUS_CONFIG").filter(|path| !path.is_empty()) {
        return Ok(path.into());
    }
    let places = places();
    match places.iter().find(|path| path.is_file()) {
        Some(path) => Ok(path.clone()),
        None => {
            let looked: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
            let problem = Problem::new(codes::NO_CONFIG).with("looked", looked);
            Err(problem
                .with_hint("railbus serve --demo")
                .with_hint("railbus -l /dev/ttyUSB0 -m eda9060a -a 1 get eda9060a"))
        }
    }
}

fn places() -> Vec<PathBuf> {
    let here = std::env::current_dir().unwrap_or_default();
    let of_user = std::env::var_os("XDG_CONFIG_HOME")
        .map(PathBuf::from)
        .or_else(|| std::env::home_dir().map(|home| home.join(".config")));
    let above = here.ancestors().map(|folder| folder.join(NAME));
    let others = [of_user, Some(PathBuf::from("/etc"))].into_iter().flatten();
    above
        .chain(others.map(|folder| folder.join("railbus").join(NAME)))
        .collect()
}
