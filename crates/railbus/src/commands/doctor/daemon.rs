//! The daemon: whether it runs, and who may use it.

use super::texts::DoctorText;
use crate::backend::DaemonClient;
use railbus_app::doctor::{self, Finding, Section};
use railbus_app::failure::Failure;
use railbus_app::machine::users::User;
use railbus_app::socket;
use railbus_words::Code;
use railbus_words::Lang;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

pub(super) async fn check(lang: Lang, named: Option<&Path>, user: &User) -> Vec<Finding> {
    let usual = || socket::places(socket::DAEMON);
    let places = named.map_or_else(usual, |path| vec![path.to_owned()]);
    let mut found = Vec::new();
    for path in &places {
        found.extend(of_socket(lang, path, user).await);
    }
    if found.is_empty() {
        let text = lang.get(DoctorText::NoDaemon).to_owned();
        found.push(Finding::good(Section::Daemon, text));
    }
    found
}

/// Why the daemon is not used, and no line is opened here instead.
pub(super) fn refused(why: &Failure) -> Finding {
    let code = match why.code() {
        Code::OtherSite => "D507",
        _ => "D508",
    };
    Finding::error(Section::Daemon, code, why.why().join(" · "))
}

/// The findings about a socket; none if it does not exist.
async fn of_socket(lang: Lang, path: &PathBuf, user: &User) -> Vec<Finding> {
    let Ok(about) = std::fs::symlink_metadata(path) else {
        return Vec::new();
    };
    let name = path.display().to_string();
    let quoted = format!("'{}'", name.replace('\'', "'\\''"));
    match UnixStream::connect(path) {
        Ok(_) => {
            let mut outlets = Vec::new();
            let mut found = vec![match DaemonClient::at(path).await {
                Ok(daemon) => {
                    // A daemon of an earlier version has none.
                    outlets = daemon.outlets().await.unwrap_or_default();
                    let site = daemon.name(lang);
                    let values: &[(&str, &dyn std::fmt::Display)] =
                        &[("socket", &name), ("site", &site)];
                    Finding::good(Section::Daemon, lang.fill(DoctorText::DaemonRuns, values))
                }
                Err(why) => {
                    let detail = format!("{name}: {}", why.text("reason"));
                    Finding::error(Section::Daemon, "D504", detail)
                }
            }];
            found.extend(doctor::outlets(&outlets));
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
