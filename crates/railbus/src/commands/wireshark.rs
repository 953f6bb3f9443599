//! Installs the Wireshark dissector and capture source.

use super::Context;
use super::sniff::SniffText;
use railbus_app::failure::Failure;
use railbus_app::render::{out, records};
use railbus_words::Code;
use serde_json::json;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Dissects what `sniff` records, with the same verdicts.
const DISSECTOR: &str = include_str!("wireshark/railbus.lua");

/// A file to install.
struct Piece {
    path: PathBuf,
    text: String,
    mode: u32,
}

/// Writes both files, or only prints where they would go.
pub(super) fn install(
    context: &Context,
    folder: Option<&Path>,
    dry_run: bool,
) -> Result<(), Failure> {
    let pieces = pieces(context, folder)?;
    if !dry_run {
        for piece in &pieces {
            let failed = |error: std::io::Error| {
                let path = piece.path.display().to_string();
                Failure::of(context.lang, Code::Install)
                    .because(format!("{path}: {error}"))
                    .with_fact("file", path)
            };
            put(piece).map_err(failed)?;
        }
    }
    let word = match dry_run {
        true => SniffText::WouldWrite,
        false => SniffText::Wrote,
    };
    let paths = pieces.iter().map(|piece| piece.path.display().to_string());
    let text = if context.format.is_json() {
        let written: Vec<String> = paths.collect();
        records::line(json!({ "files": written, "written": !dry_run }))
    } else {
        let lines = paths.map(|path| context.lang.fill(word, &[("path", &path)]) + "\n");
        lines.collect()
    };
    out::result(context.lang, &text)
}

fn pieces(context: &Context, folder: Option<&Path>) -> Result<[Piece; 2], Failure> {
    let system = |error| Failure::of(context.lang, Code::System).because(error);
    let program = std::env::current_exe().map_err(system)?;
    let (lua, extcap) = match folder {
        Some(folder) => (folder.join("plugins"), folder.join("extcap")),
        None => folders(),
    };
    // Wireshark runs every program of that folder, with flags alone, to find out what it can
    // capture.
    let quoted = program.display().to_string().replace('\'', "'\\''");
    let script = format!("#!/bin/sh\nexec '{quoted}' extcap \"$@\"\n");
    Ok([
        Piece {
            path: lua.join("railbus.lua"),
            text: DISSECTOR.to_owned(),
            mode: 0o644,
        },
        Piece {
            path: extcap.join("railbus-extcap"),
            text: script,
            mode: 0o755,
        },
    ])
}

/// The user's folders for plugins and capture sources, as the installed Wireshark reports them:
/// they moved from one version to another.
fn folders() -> (PathBuf, PathBuf) {
    let listed = Command::new("tshark").args(["-G", "folders"]).output();
    let listed = listed.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    let listed = listed.unwrap_or_default();
    let named = |name: &str| folder_named(&listed, name);
    let data = std::env::var_os("XDG_DATA_HOME").map(PathBuf::from);
    let home = || std::env::home_dir().map(|home| home.join(".local/share"));
    let lib = match data.or_else(home) {
        Some(data) => data.with_file_name("lib").join("wireshark"),
        None => PathBuf::from("/usr/local/lib/wireshark"),
    };
    (
        named("Personal Lua Plugins").unwrap_or_else(|| lib.join("plugins")),
        named("Personal Extcap path")
            .or_else(|| named("Extcap path"))
            .unwrap_or_else(|| lib.join("extcap")),
    )
}

/// The folder of a name in the list that `tshark -G folders` prints.
fn folder_named(listed: &str, name: &str) -> Option<PathBuf> {
    let mut lines = listed.lines().filter_map(|line| line.split_once(':'));
    let found = lines.find(|(known, _)| known.trim() == name)?;
    // Several are separated by colons; the first one takes precedence.
    let first = found.1.trim().split(':').next()?;
    (!first.is_empty()).then(|| first.into())
}

/// Writes a temporary file next to it and renames that, so that the file is never seen incomplete.
fn put(piece: &Piece) -> std::io::Result<()> {
    if let Some(folder) = piece.path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let beside = piece.path.with_extension("new");
    std::fs::write(&beside, &piece.text)?;
    std::fs::set_permissions(&beside, std::fs::Permissions::from_mode(piece.mode))?;
    std::fs::rename(&beside, &piece.path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folders_are_those_that_wireshark_names() {
        let listed = "Personal Lua Plugins:\t/users/li/.local/lib/wireshark/plugins\n\
                      Extcap path:         \t/usr/lib/wireshark/extcap\n";
        let named = |name| folder_named(listed, name);
        assert_eq!(
            named("Extcap path"),
            Some("/usr/lib/wireshark/extcap".into())
        );
        assert_eq!(named("Personal Extcap path"), None);
        let lua = named("Personal Lua Plugins");
        assert_eq!(lua, Some("/users/li/.local/lib/wireshark/plugins".into()));
    }
}
