//! Finding and reading the configuration.

use crate::api::failures::bad_config;
use crate::socket;
use railbus_api::problem::{Problem, codes};
use railbus_site::Config;
use railbus_words::Lang;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The name of the file.
pub const NAME: &str = "railbus.toml";
/// Maximum size of a configuration.
const LEN_MAX: u64 = 1 << 20;

/// A configuration and its path.
#[derive(Debug)]
pub struct FoundConfig {
    /// The file.
    pub path: PathBuf,
    /// Its content.
    pub config: Config,
}

/// Reads the configuration: the given one, or else the first of `$RAILBUS_CONFIG`, `railbus.toml`
/// here or in a parent, the user's own, and the system's.
pub fn read(lang: Lang, named: Option<&Path>) -> Result<FoundConfig, Problem> {
    let path = path(named)?;
    let text = text_of(&path)?;
    let config = Config::parse(&text)
        .map_err(|problems| bad_config(lang, &path.display().to_string(), &problems))?;
    Ok(FoundConfig { path, config })
}

/// The path of the configuration that [`read`] reads.
pub fn path(named: Option<&Path>) -> Result<PathBuf, Problem> {
    chosen(named).map(|(path, _)| path)
}

/// The text of a file.
pub fn text_of(path: &Path) -> Result<String, Problem> {
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

/// Why this configuration is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigOrigin {
    /// Given by a flag.
    Flag,
    /// Given by `RAILBUS_CONFIG`.
    Environment,
    /// The first one found at the usual places.
    Place,
    /// There is none here, but a daemon has one.
    Daemon,
}

impl ConfigOrigin {
    /// The name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            ConfigOrigin::Flag => "flag",
            ConfigOrigin::Environment => "environment",
            ConfigOrigin::Place => "place",
            ConfigOrigin::Daemon => "daemon",
        }
    }
}

/// The configuration to use: the given one, that of the environment, or the first existing one of
/// the usual places.
pub fn chosen(named: Option<&Path>) -> Result<(PathBuf, ConfigOrigin), Problem> {
    if let Some(path) = named {
        return Ok((path.to_owned(), ConfigOrigin::Flag));
    }
    if let Some(path) = std::env::var_os("RAILBUS_CONFIG").filter(|path| !path.is_empty()) {
        return Ok((path.into(), ConfigOrigin::Environment));
    }
    let places = places();
    match places.iter().find(|path| path.is_file()) {
        Some(path) => Ok((path.clone(), ConfigOrigin::Place)),
        None => {
            let looked: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
            let problem = Problem::new(codes::NO_CONFIG).with("looked", looked);
            let problem = match socket::answers() {
                // With a daemon that can be queried, no other is needed.
                Some(socket) => {
                    problem.with_hint(format!("railbus --socket {} ls", socket.display()))
                }
                None => problem.with_hint("railbus serve --demo"),
            };
            Err(problem.with_hint("railbus -l /dev/ttyUSB0 -m eda9060a -a 1 get eda9060a"))
        }
    }
}

/// The canonical path of a file, which need not exist yet: absolute, without links.
pub fn real(file: &Path) -> PathBuf {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    std::fs::canonicalize(&file).unwrap_or_else(|_| match (file.parent(), file.file_name()) {
        (Some(folder), Some(name)) => {
            let folder = std::fs::canonicalize(folder);
            folder.map_or_else(|_| file.clone(), |folder| folder.join(name))
        }
        _ => file.clone(),
    })
}

/// The state folder of a site: next to its configuration; without one, the usual place for the
/// user's programs. `RAILBUS_STATE` takes precedence over both.
pub fn state_folder(config: Option<&Path>) -> PathBuf {
    if let Some(named) = std::env::var_os("RAILBUS_STATE").filter(|path| !path.is_empty()) {
        return named.into();
    }
    match config {
        Some(file) => file.parent().unwrap_or(Path::new("")).join(".railbus"),
        None => {
            let named = std::env::var_os("XDG_STATE_HOME").filter(|path| !path.is_empty());
            let home = || {
                std::env::home_dir()
                    .unwrap_or_default()
                    .join(".local/state")
            };
            named.map_or_else(home, PathBuf::from).join("railbus")
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
