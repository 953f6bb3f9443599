//! The files of a site in its state folder: keys that it made itself. Their names contain the key:
//! with another key the settings change, and if that is undone, the earlier ones are still there.

use super::settings::FleetAccess;
use super::trial_files::MANAGED;
use crate::clock::unix_s;
use crate::nats::unusable;
use railbus_api::problem::Problem;
use railbus_fleet::{public_site_key, read_site_creds};
use railbus_site::Config;
use railbus_store::durable;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// How many characters of a key are in a name.
const SHOWN: usize = 16;
/// How long a key is kept that was made for an invitation: it is valid for 30 days at most.
const PENDING_MAX: Duration = Duration::from_secs(31 * 86_400);
/// A file of an outlet that is not configured may be of one that is being added.
const ADDED_MAX: Duration = Duration::from_secs(600);

pub(super) const PREFIX: &str = "fleet-";
const JOINING: &str = "joining-";
const CREDS: &str = ".creds";
const CA: &str = ".ca.pem";
const PENDING: &str = ".key";

/// The files of the outlet of a name.
pub(super) struct SiteFiles {
    folder: Arc<Path>,
    name: String,
}

impl SiteFiles {
    pub(super) fn new(folder: Arc<Path>, name: &str) -> SiteFiles {
        SiteFiles {
            folder,
            name: name.to_owned(),
        }
    }

    fn of_key(&self, key: &str, end: &str) -> PathBuf {
        // No name of an outlet has a hyphen.
        let name = format!("{PREFIX}{}-{}{end}", self.name, shown(key));
        self.folder.join(name)
    }

    /// The credentials of this key.
    pub(super) fn creds(&self, key: &str) -> PathBuf {
        self.of_key(key, CREDS)
    }

    /// The authority of the fleet of this key.
    pub(super) fn ca(&self, key: &str) -> PathBuf {
        self.of_key(key, CA)
    }

    /// The key that was made for the invitation with this number, whatever the outlet is to be
    /// called.
    pub(super) fn pending(&self, invitation: &str) -> PathBuf {
        let name = format!("{PREFIX}{JOINING}{}{PENDING}", shown(invitation));
        self.folder.join(name)
    }
}

/// Replaces a file, with these permissions.
pub(super) fn write(path: &Path, text: &str, mode: u32) -> Result<(), Problem> {
    let end = durable::replace(path, text.as_bytes(), Some(mode));
    end.map_err(|error| unusable(path, &error))
}

fn shown(key: &str) -> String {
    key.chars().take(SHOWN).collect()
}

/// The files that the outlets of this kind in a configuration name, and the outlets.
pub(super) struct Configured {
    files: BTreeSet<PathBuf>,
    outlets: BTreeSet<String>,
}

impl Configured {
    pub(super) fn of(config: &Config, kind: &str) -> Configured {
        let own = config.outlets.iter();
        let own = own.filter(|(_, outlet)| outlet.kind == kind);
        let mut configured = Configured {
            files: BTreeSet::new(),
            outlets: BTreeSet::new(),
        };
        for (name, outlet) in own {
            let access = FleetAccess::of(&outlet.settings);
            configured.files.insert(access.credentials);
            configured.files.extend(access.ca);
            configured.outlets.insert(name.clone());
        }
        configured
    }
}

/// A file of the state folder that no outlet names.
struct Unnamed<'f> {
    path: &'f Path,
    /// Its name without the prefix.
    name: &'f str,
    /// How long ago it was written; none if that is not known.
    age: Option<Duration>,
}

impl Unnamed<'_> {
    fn is_older(&self, than: Duration) -> bool {
        self.age.is_some_and(|age| age > than)
    }

    fn text(&self) -> String {
        std::fs::read_to_string(self.path).unwrap_or_default()
    }

    /// Whether it is of no use any more, at this time in seconds since 1970.
    fn is_stale(&self, configured: &Configured, now_s: u64) -> bool {
        if let Some(id) = self.name.strip_prefix(JOINING) {
            let is_key = id.ends_with(PENDING);
            return is_key && (self.is_older(PENDING_MAX) || self.is_accepted(configured));
        }
        if let Some(outlet) = self.name.strip_suffix(MANAGED) {
            return !configured.outlets.contains(outlet);
        }
        let Some((outlet, rest)) = self.name.split_once('-') else {
            return false;
        };
        let is_of_none = !configured.outlets.contains(outlet);
        if rest.ends_with(CREDS) {
            let claims = read_site_creds(&self.text()).ok();
            let expires = claims.and_then(|claims| claims.expires);
            let has_expired = expires.is_some_and(|at| at < now_s);
            return has_expired || is_of_none && self.is_older(ADDED_MAX);
        }
        let Some(key) = rest.strip_suffix(CA) else {
            return false;
        };
        let creds = format!("{PREFIX}{outlet}-{key}{CREDS}");
        let has_creds = self.path.with_file_name(creds).exists();
        (is_of_none || !has_creds) && self.is_older(ADDED_MAX)
    }

    /// Whether an outlet has the credentials of this key.
    fn is_accepted(&self, configured: &Configured) -> bool {
        let Ok(key) = public_site_key(self.text().trim()) else {
            return false;
        };
        let end = format!("-{}{CREDS}", shown(&key));
        let mut files = configured.files.iter();
        files.any(|file| file.to_string_lossy().ends_with(&end))
    }
}

/// Removes what no outlet names and is of no use any more: keys of accepted invitations, keys that
/// have expired, and those of outlets that are gone. What can't be removed stays.
pub(super) fn remove_stale(folder: &Path, configured: &Configured) {
    let now = SystemTime::now();
    let now_s = unix_s();
    let all = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for path in all.map(|entry| entry.path()) {
        let name = path.file_name().and_then(|name| name.to_str());
        let Some(name) = name.and_then(|name| name.strip_prefix(PREFIX)) else {
            continue;
        };
        let written = path.metadata().and_then(|file| file.modified()).ok();
        let file = Unnamed {
            path: &path,
            name,
            age: written.and_then(|at| now.duration_since(at).ok()),
        };
        if !configured.files.contains(&path) && file.is_stale(configured, now_s) {
            let _ = std::fs::remove_file(&path);
        }
    }
}

/// Removes the credentials of an outlet that is gone, if they were made here and no other outlet
/// has them.
pub(super) fn remove_of(folder: &Path, name: &str, credentials: &Path, configured: &Configured) {
    let file = credentials.file_name().and_then(|file| file.to_str());
    let key = file.and_then(|file| {
        let rest = file.strip_prefix(PREFIX)?.strip_prefix(name)?;
        rest.strip_prefix('-')?.strip_suffix(CREDS)
    });
    if let Some(key) = key.filter(|_| credentials.parent() == Some(folder)) {
        let files = SiteFiles::new(Arc::from(folder), name);
        for path in [files.creds(key), files.ca(key)] {
            if !configured.files.contains(&path) {
                let _ = std::fs::remove_file(path);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_fleet::{SiteSigner, new_site_key};

    #[test]
    fn what_is_of_use_stays() {
        let name = format!("railbus-site-files-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let founded =
            railbus_fleet::founding::found(&[railbus_fleet::NodeAddress::parse("a").unwrap()], 7);
        let founded = founded.unwrap();
        let text = |path: &str| {
            let file = founded.iter().find(|file| file.path == path).unwrap();
            file.text.trim().to_owned()
        };
        let signer = SiteSigner::new(&text("hub/site-signing.nk"), &text("hub/sites-account.pub"));
        let signer = signer.unwrap();
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let now = now.unwrap().as_secs();
        let file = |path: PathBuf, text: &str, age: Duration| {
            std::fs::write(&path, text).unwrap();
            let opened = std::fs::File::options().write(true).open(&path).unwrap();
            opened.set_modified(SystemTime::now() - age).unwrap();
            path
        };
        let (hq, gone) = ("hq", "gone");
        let files = |name| SiteFiles::new(Arc::from(&*folder), name);
        let (valid, expired) = (
            signer.creds("plant7", now, 1_000).unwrap(),
            signer.creds("plant7", 7, 1).unwrap(),
        );
        let (young, old) = (Duration::ZERO, 2 * ADDED_MAX);
        let (seed, key) = new_site_key().unwrap();
        let configured = file(files(hq).creds(&key), &valid, old);
        let stay = [
            configured.clone(),
            file(files(hq).ca(&key), "", old),
            // A change can be undone, and another outlet has keys, too.
            file(files(hq).creds("UBEFORE"), &valid, old),
            file(files("hq_2").creds("U2"), &valid, old),
            file(
                files(hq).pending("ANOTHER"),
                &new_site_key().unwrap().0,
                old,
            ),
            file(files("added").creds("UADDED"), &valid, young),
            file(folder.join("fleet-hq.json"), "", old),
            file(folder.join("fleet-hq.managed"), "", old),
            file(folder.join("hq.creds"), &expired, old),
        ];
        let go = [
            file(files(hq).creds("UEXPIRED"), &expired, old),
            file(files(hq).pending("OWN"), &format!("{seed}\n"), young),
            file(folder.join("fleet-gone.managed"), "", old),
            file(files(hq).pending("LONGAGO"), "", 2 * PENDING_MAX),
            file(files(gone).creds("UGONE"), &valid, old),
            file(files(gone).ca("UGONE"), "", old),
            file(files(hq).ca("UREFUSED"), "", old),
        ];
        let configured_now = |creds: &Path| Configured {
            files: [creds, &files(hq).ca(&key)].map(Path::to_owned).into(),
            outlets: [hq, "hq_2"].map(str::to_owned).into(),
        };
        remove_stale(&folder, &configured_now(&configured));
        for path in &stay {
            assert!(path.exists(), "{}", path.display());
        }
        for path in &go {
            assert!(!path.exists(), "{}", path.display());
        }
        // One that was made by hand is not ours, nor is one that another outlet names.
        let by_hand = folder.join("hq.creds");
        remove_of(&folder, hq, &by_hand, &configured_now(&by_hand));
        assert!(by_hand.exists());
        remove_of(&folder, hq, &configured, &configured_now(&configured));
        assert!(configured.exists());
        remove_of(&folder, hq, &configured, &configured_now(&by_hand));
        assert!(!configured.exists() && files(hq).creds("UBEFORE").exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
