//! A site joins a fleet by an invitation: it makes its key, which never leaves it, and is given
//! claims for it by the centre.

use super::connection::{CONNECT_MAX, servers_of};
use crate::access::secret::Secret;
use crate::nats::{unreached, unusable};
use crate::northbound::broker::trusting;
use crate::northbound::kind::{Invited, Joined};
use async_nats::{Client, ConnectOptions, RequestErrorKind};
use prost::Message as _;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::invitation::Invitation;
use railbus_fleet::message::{KeyAnswer, KeyRequest, KeyResult};
use railbus_fleet::{
    CredsError, JOIN_INBOX, joined_creds, new_site_key, public_site_key, read_site_creds,
    site_token,
};
use railbus_store::durable;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long the centre may take to answer.
const ANSWER_MAX: Duration = Duration::from_secs(10);

/// A file that is younger may be of an invitation that is being taken up.
const YOUNG: Duration = Duration::from_secs(60);
/// How many characters of its public key are in the name of a file.
const KEY_SHOWN: usize = 12;

/// The files of a site in its state folder.
struct SiteFiles {
    ca: PathBuf,
    /// The key that was made for an invitation, until the outlet is configured: if the answer is
    /// lost, or the configuration can't be changed, the invitation counts for this key only.
    pending: PathBuf,
}

impl SiteFiles {
    /// Those of the outlet of this name.
    fn of(folder: &Path, name: &str) -> SiteFiles {
        let file = |end: &str| folder.join(format!("fleet-{name}.{end}"));
        SiteFiles {
            ca: file("ca.pem"),
            pending: file("joining"),
        }
    }
}

/// How the names of files with credentials of this outlet begin. No name of an outlet has a hyphen.
fn creds_prefix(name: &str) -> String {
    format!("fleet-{name}-")
}

/// The file with its credentials for this key. With another key it is another file: the settings
/// change, and so the outlet takes it at once.
fn creds_file(folder: &Path, name: &str, key: &str) -> PathBuf {
    let shown: String = key.chars().take(KEY_SHOWN).collect();
    folder.join(format!("{}{shown}.creds", creds_prefix(name)))
}

fn not_invited(reason: &dyn ToString) -> Problem {
    Problem::new(codes::NOT_INVITED).with("reason", reason.to_string())
}

fn written(path: &Path, text: &str, mode: u32) -> Result<(), Problem> {
    let end = durable::replace(path, text.as_bytes(), Some(mode));
    end.map_err(|error| unusable(path, &error))
}

/// Takes up an invitation. What it leaves in the state folder is what the outlet needs.
pub(super) async fn join(invited: Invited) -> Result<Joined, Problem> {
    let invitation = Invitation::parse(invited.invitation.expose());
    let invitation = invitation.map_err(|error| not_invited(&error))?;
    let files = SiteFiles::of(&invited.folder, &invited.name);
    let (seed, key) = pending_key(&files.pending, &invitation)?;
    let token = asked(&invitation, &files, key).await?;
    let creds = joined_creds(&invitation.site, seed.expose(), &token);
    let creds = creds.map_err(|error| not_invited(&error))?;
    let claims = read_site_creds(&creds).map_err(|error| not_invited(&error))?;
    let file = creds_file(&invited.folder, &invited.name, &claims.key);
    written(&file, &creds, 0o600)?;
    written(&files.ca, &invitation.ca, 0o644)?;
    let servers: Vec<String> = invitation.servers.iter().map(ToString::to_string).collect();
    let settings = json!({
        "servers": servers,
        "credentials": file.display().to_string(),
        "ca": files.ca.display().to_string(),
    });
    Ok(Joined {
        settings: settings.as_object().cloned().unwrap_or_default(),
        called: claims.site,
        until: claims.expires.and_then(|at| i64::try_from(at).ok()),
    })
}

/// The outlet of this name is configured with these credentials: no invitation has to be taken up
/// again, and keys of before are not needed any more. What can't be removed stays.
pub(super) fn forget_others(folder: &Path, name: &str, credentials: &Path) {
    let pending = SiteFiles::of(folder, name).pending;
    let seed = std::fs::read_to_string(&pending).unwrap_or_default();
    let key = seed
        .trim()
        .split_once(' ')
        .map(|(_, seed)| public_site_key(seed));
    if let Some(Ok(key)) = key
        && creds_file(folder, name, &key) == credentials
    {
        let _ = std::fs::remove_file(pending);
    }
    let prefix = creds_prefix(name);
    let is_own = |path: &Path| {
        let file = path.file_name().and_then(|file| file.to_str());
        path.parent() == Some(folder)
            && file.is_some_and(|file| file.starts_with(&prefix) && file.ends_with(".creds"))
    };
    if !is_own(credentials) {
        return;
    }
    let all = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for path in all.map(|entry| entry.path()) {
        let written = path.metadata().and_then(|file| file.modified()).ok();
        let age = written.and_then(|at| at.elapsed().ok());
        let is_young = age.is_none_or(|age| age < YOUNG);
        if is_own(&path) && path != credentials && !is_young {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// The outlet with these credentials is there no longer, nor are they needed, if they were made
/// here.
pub(super) fn forget(folder: &Path, name: &str, credentials: &Path) {
    let is_file = |file: &str| file.starts_with(&creds_prefix(name));
    let file = credentials.file_name().and_then(|file| file.to_str());
    if credentials.parent() == Some(folder) && file.is_some_and(is_file) {
        let _ = std::fs::remove_file(credentials);
        let _ = std::fs::remove_file(SiteFiles::of(folder, name).ca);
    }
}

/// The key for this invitation, as it was made the first time: its seed and its public key.
fn pending_key(path: &Path, invitation: &Invitation) -> Result<(Secret, String), Problem> {
    let broken = |error: CredsError| not_invited(&error);
    let claims = read_site_creds(&invitation.creds).map_err(broken)?;
    if let Ok(text) = std::fs::read_to_string(path)
        && let Some((id, seed)) = text.trim().split_once(' ')
        && id == claims.id
        && let Ok(key) = public_site_key(seed)
    {
        return Ok((Secret::new(seed.to_owned()), key));
    }
    let (seed, key) = new_site_key().map_err(broken)?;
    written(path, &format!("{} {seed}\n", claims.id), 0o600)?;
    Ok((Secret::new(seed), key))
}

/// Asks the centre for claims of this key.
async fn asked(invitation: &Invitation, files: &SiteFiles, key: String) -> Result<String, Problem> {
    let client = connected(invitation, files).await?;
    let token = site_token(&invitation.creds).unwrap_or_default().to_owned();
    let request = KeyRequest { token, key }.encode_to_vec();
    let subject = format!("rb.join.{}", invitation.site);
    let answer = tokio::time::timeout(ANSWER_MAX, client.request(subject, request.into())).await;
    let away = |reason: &str| {
        let problem = Problem::new(codes::FLEET_AWAY).with("reason", reason);
        problem.with_hint("railbus fleet serve")
    };
    let answer = answer.map_err(|_| away("no answer in time"))?;
    let answer = answer.map_err(|error| match error.kind() {
        RequestErrorKind::NoResponders | RequestErrorKind::TimedOut => away("no answer"),
        _ => Problem::new(codes::FLEET_ENDED).with("reason", error.to_string()),
    })?;
    let answer = KeyAnswer::decode(answer.payload).map_err(|error| not_invited(&error))?;
    match answer.end {
        Some(KeyResult::Token(token)) => Ok(token),
        Some(KeyResult::Refusal(refusal)) => Err(not_invited(&refusal.reason)),
        None => Err(not_invited(&"the answer can't be read")),
    }
}

/// Connects to one of the servers with what the invitation has.
async fn connected(invitation: &Invitation, files: &SiteFiles) -> Result<Client, Problem> {
    // Beside the outlet's, which may be at work with another one.
    let draft = files.ca.with_extension("new");
    written(&draft, &invitation.ca, 0o644)?;
    let tls = trusting(Some(&draft), None, codes::FLEET_FILE);
    // What stays is replaced by the next one.
    let _ = std::fs::remove_file(&draft);
    let options = ConnectOptions::with_credentials(&invitation.creds);
    let options = options.map_err(|error| not_invited(&error))?;
    let options = options
        .name(format!("railbus {} joins", invitation.site))
        .custom_inbox_prefix(format!("{JOIN_INBOX}.{}", invitation.site))
        .require_tls(true)
        .tls_client_config(tls?)
        .ignore_discovered_servers()
        .connection_timeout(CONNECT_MAX)
        .max_reconnects(invitation.servers.len());
    let servers = servers_of(&invitation.servers);
    options.connect(servers).await.map_err(|error| {
        let problem = unreached(error);
        match problem.code == codes::FLEET_LOGIN.code {
            true => not_invited(&"the servers do not accept it"),
            false => problem,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_fleet::{NodeAddress, SiteSigner};

    #[test]
    fn a_key_is_kept_for_its_invitation_until_that_is_answered() {
        let founded =
            railbus_fleet::founding::found(&[NodeAddress::parse("a").unwrap()], 7).unwrap();
        let text = |path: &str| {
            let file = founded.iter().find(|file| file.path == path).unwrap();
            file.text.trim().to_owned()
        };
        let (signing, account) = (text("hub/join-signing.nk"), text("hub/sites-account.pub"));
        let signer = SiteSigner::new(&signing, &account).unwrap();
        let invitation = || Invitation {
            site: "plant7".to_owned(),
            servers: Vec::new(),
            ca: text("hub/ca.pem"),
            creds: signer.creds("plant7", 7, 100).unwrap(),
            until: 107,
        };
        let folder = std::env::temp_dir().join(format!("railbus-joining-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let files = SiteFiles::of(&folder, "hq");
        let (first, second) = (invitation(), invitation());
        let key = |of: &Invitation| pending_key(&files.pending, of).unwrap().1;
        let own = key(&first);
        assert_eq!(key(&first), own);
        let other = key(&second);
        assert_ne!(other, own);
        assert_eq!(key(&second), other);
        std::fs::write(&files.pending, "half of").unwrap();
        assert_ne!(key(&second), other);
        // Configured, it needs the key that it has, and no other. Others keep theirs.
        let creds = |name: &str, key: &str| {
            let file = creds_file(&folder, name, key);
            std::fs::write(&file, "").unwrap();
            let long_ago = std::time::SystemTime::now() - 2 * YOUNG;
            let opened = std::fs::File::options().write(true).open(&file).unwrap();
            opened.set_modified(long_ago).unwrap();
            file
        };
        let last = key(&second);
        let (old, now) = (creds("hq", "UOLD"), creds("hq", &last));
        let young = creds_file(&folder, "hq", "UYOUNG");
        std::fs::write(&young, "").unwrap();
        let (longer, by_hand) = (creds("hq_2", "UOLD"), folder.join("hq.creds"));
        std::fs::write(&by_hand, "").unwrap();
        forget_others(&folder, "hq", &by_hand);
        assert!(old.exists() && files.pending.exists());
        forget_others(&folder, "hq", &now);
        assert!(!old.exists() && !files.pending.exists() && young.exists());
        assert!(now.exists() && longer.exists() && by_hand.exists());
        forget(&folder, "hq", &by_hand);
        assert!(now.exists());
        forget(&folder, "hq", &now);
        assert!(!now.exists() && longer.exists() && by_hand.exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
