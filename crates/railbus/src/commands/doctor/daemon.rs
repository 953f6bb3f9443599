//! The daemon: whether it runs, and who may use it.

use super::finding::{Finding, Section};
use super::texts::DoctorText;
use crate::backend::Remote;
use jiff::Timestamp;
use railbus_app::failure::Failure;
use railbus_app::machine::users::User;
use railbus_app::socket;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

/// So many days before its end a certificate is told of.
const EXPIRY_DAYS: i64 = 30;

pub(super) async fn check(lang: Lang, named: Option<&Path>, user: &User) -> Vec<Finding> {
    let places = named.map_or_else(socket::places, |path| vec![path.to_owned()]);
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

/// Why no daemon is asked, and no line opened here instead.
pub(super) fn refused(why: &Failure) -> Finding {
    let code = match why.code() {
        Code::OtherSite => "D507",
        _ => "D508",
    };
    Finding::error(Section::Daemon, code, why.why().join(" · "))
}

/// What is to be said of the daemon's own certificate: nothing while it is good for long.
pub(super) fn certificate(path: &str, end: Timestamp, now: Timestamp) -> Option<Finding> {
    let days = end.duration_since(now).as_secs().div_euclid(86_400);
    let detail = format!("{path} ({})", time::rfc3339(end));
    match days {
        ..0 => Some(Finding::error(Section::Daemon, "D506", detail)),
        0..=EXPIRY_DAYS => Some(Finding::warning(Section::Daemon, "D505", detail)),
        _ => None,
    }
}

/// What is to be said of a socket; nothing where there is none.
async fn of_socket(lang: Lang, path: &PathBuf, user: &User) -> Vec<Finding> {
    let Ok(about) = std::fs::symlink_metadata(path) else {
        return Vec::new();
    };
    let name = path.display().to_string();
    let quoted = format!("'{}'", name.replace('\'', "'\\''"));
    match UnixStream::connect(path) {
        Ok(_) => {
            let mut found = vec![match Remote::at(path).await {
                Ok(daemon) => {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certificate_is_told_of_before_it_ends() {
        let end: Timestamp = "2026-03-01T12:00:00Z".parse().unwrap();
        let code = |now: &str| {
            let found = certificate("tls.pem", end, now.parse().unwrap());
            found.and_then(|found| found.code)
        };
        assert_eq!(code("2026-01-29T12:00:00Z"), None);
        assert_eq!(code("2026-01-30T12:00:00Z"), Some("D505"));
        assert_eq!(code("2026-03-01T11:59:59Z"), Some("D505"));
        assert_eq!(code("2026-03-01T12:00:01Z"), Some("D506"));
    }
}
