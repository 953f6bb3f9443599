//! The daemon: whether it runs, and who may use it.

use super::finding::{Finding, Section};
use super::texts::DoctorText;
use crate::i18n::Lang;
use crate::machine::users::User;
use crate::serve::socket;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

pub(super) fn check(lang: Lang, named: Option<&Path>, user: &User) -> Vec<Finding> {
    let places = named.map_or_else(socket::places, |path| vec![path.to_owned()]);
    let mut found: Vec<Finding> = places
        .iter()
        .flat_map(|path| of_socket(lang, path, user))
        .collect();
    if found.is_empty() {
        let text = lang.get(DoctorText::NoDaemon).to_owned();
        found.push(Finding::good(Section::Daemon, text));
    }
    found
}

/// What is to be said of a socket; nothing where there is none.
fn of_socket(lang: Lang, path: &PathBuf, user: &User) -> Vec<Finding> {
    let Ok(about) = std::fs::symlink_metadata(path) else {
        return Vec::new();
    };
    let name = path.display().to_string();
    let quoted = format!("'{}'", name.replace('\'', "'\\''"));
    match UnixStream::connect(path) {
        Ok(_) => {
            let text = lang.fill(DoctorText::DaemonRuns, &[("socket", &name)]);
            let mut found = vec![Finding::good(Section::Daemon, text)];
            if about.mode() & 0o077 != 0 {
                let detail = format!("{name} ({:04o})", about.mode() & 0o7777);
                let finding = Finding::warning(Section::Daemon, "D502", detail);
                found.push(finding.with_fix(format!("chmod 600 {quoted}")));
            }
            found
        }
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            vec![Finding::warning(Section::Daemon, "D503", name)]
        }
        Err(_) => {
            let finding = Finding::warning(Section::Daemon, "D501", name);
            let own = user.is_root() || about.uid() == user.number;
            let sudo = if own { "" } else { "sudo " };
            vec![finding.with_fix(format!("{sudo}rm {quoted}"))]
        }
    }
}
