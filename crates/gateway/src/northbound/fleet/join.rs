//! A site joins a fleet by an invitation: it makes its key, which never leaves it, and is given
//! claims for it by the centre.

use super::connection::{CONNECT_MAX, credentials, servers_of};
use super::files::{SiteFiles, write};
use super::settings::{CONFIG_KEY, FleetAccess};
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
use railbus_site::config::change::Keys;
use serde_json::json;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// How long the centre may take to answer.
const ANSWER_MAX: Duration = Duration::from_secs(10);

/// How long all of it may take: callers wait for 30 s.
const REQUEST_MAX: Duration = Duration::from_secs(25);

/// What was made for an invitation before the centre is asked.
struct PendingJoin {
    invitation: Invitation,
    files: SiteFiles,
    /// The seed of the key.
    seed: Secret,
    key: String,
    /// The centre may say the configuration.
    managed: bool,
}

/// What the centre gives for it.
struct Given {
    token: String,
    config_key: String,
}

fn not_invited(reason: &dyn ToString) -> Problem {
    Problem::new(codes::NOT_INVITED).with("reason", reason.to_string())
}

/// Accepts an invitation: writes the key, the credentials and the authority to the state folder.
pub(super) async fn join(invited: Invited) -> Result<Joined, Problem> {
    // Disks may be slow, and lines must not wait for them.
    let prepared = at_disk(move || prepare(&invited)).await?;
    let late = || Problem::new(codes::FLEET_UNREACHED).with("reason", "no answer in time");
    let given = tokio::time::timeout(REQUEST_MAX, request_claims(&prepared)).await;
    let given = given.map_err(|_| late())??;
    at_disk(move || finish(&prepared, &given)).await
}

async fn at_disk<T: Send + 'static>(
    what: impl FnOnce() -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let internal = |reason: String| Problem::new(codes::INTERNAL).with("reason", reason);
    let done = tokio::task::spawn_blocking(what).await;
    done.map_err(|error| internal(error.to_string()))?
}

/// Reads the invitation and makes the key for it.
fn prepare(invited: &Invited) -> Result<PendingJoin, Problem> {
    let invitation = Invitation::parse(invited.invitation.expose());
    let invitation = invitation.map_err(|error| not_invited(&error))?;
    if let Some(settings) = &invited.settings {
        same_fleet(settings, &invitation)?;
    }
    let claims = read_site_creds(&invitation.creds).map_err(|error| not_invited(&error))?;
    let files = SiteFiles::new(Arc::clone(&invited.folder), &invited.name);
    let (seed, key) = pending_key(&files, &claims.id)?;
    write(&files.ca(&key), &invitation.ca, 0o644)?;
    Ok(PendingJoin {
        invitation,
        files,
        seed,
        key,
        managed: invited.managed,
    })
}

/// Whether the invitation is of the fleet and the site of these settings: what the centre may
/// switch, and the changes that it has not received yet, are theirs.
fn same_fleet(settings: &Keys, invitation: &Invitation) -> Result<(), Problem> {
    let access = FleetAccess::of(settings);
    // What can't be read may be what has to be replaced.
    let ca = access
        .ca
        .and_then(|path| std::fs::read_to_string(path).ok());
    let trimmed = |text: &str| text.split_whitespace().collect::<String>();
    let has_its_ca = ca.map(|ca| trimmed(&ca) == trimmed(&invitation.ca));
    let creds = credentials(&access.credentials).ok();
    let is_its_site = creds.is_none_or(|(claims, _)| claims.site == invitation.site);
    let mut servers = access.servers.iter();
    let is_its_fleet =
        has_its_ca.unwrap_or_else(|| servers.any(|server| invitation.servers.contains(server)));
    if is_its_fleet && is_its_site {
        return Ok(());
    }
    Err(Problem::new(codes::OTHER_FLEET).with("name", invitation.site.as_str()))
}

/// The key for the invitation with this number, as it was made the first time: its seed and its
/// public key. The invitation counts for this key only, so it is kept until the outlet is
/// configured.
fn pending_key(files: &SiteFiles, invitation: &str) -> Result<(Secret, String), Problem> {
    let broken =
        |error: CredsError| Problem::new(codes::INTERNAL).with("reason", error.to_string());
    let path = files.pending(invitation);
    match std::fs::read_to_string(&path) {
        Ok(seed) => {
            if let Ok(key) = public_site_key(seed.trim()) {
                return Ok((Secret::new(seed.trim().to_owned()), key));
            }
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(unusable(&path, &error)),
    }
    let (seed, key) = new_site_key().map_err(broken)?;
    write(&path, &format!("{seed}\n"), 0o600)?;
    Ok((Secret::new(seed), key))
}

/// Writes the credentials.
fn finish(prepared: &PendingJoin, given: &Given) -> Result<Joined, Problem> {
    let PendingJoin {
        invitation,
        files,
        seed,
        key,
        managed,
    } = prepared;
    if *managed && given.config_key.is_empty() {
        return Err(Problem::new(codes::NO_CONFIG_KEY));
    }
    let creds = joined_creds(&invitation.site, seed.expose(), &given.token);
    let creds = creds.map_err(|error| not_invited(&error))?;
    let claims = read_site_creds(&creds).map_err(|error| not_invited(&error))?;
    write(&files.creds(key), &creds, 0o600)?;
    let servers: Vec<String> = invitation.servers.iter().map(ToString::to_string).collect();
    let mut settings = json!({
        "servers": servers,
        "credentials": files.creds(key).display().to_string(),
        "ca": files.ca(key).display().to_string(),
    });
    if *managed {
        settings[CONFIG_KEY] = given.config_key.as_str().into();
    }
    Ok(Joined {
        settings: settings.as_object().cloned().unwrap_or_default(),
        called: claims.site,
        until: claims.expires.and_then(|at| i64::try_from(at).ok()),
    })
}

/// Asks the centre for claims of the key.
async fn request_claims(prepared: &PendingJoin) -> Result<Given, Problem> {
    let invitation = &prepared.invitation;
    let client = connected(invitation, &prepared.files.ca(&prepared.key)).await?;
    let token = site_token(&invitation.creds).unwrap_or_default().to_owned();
    let key = prepared.key.clone();
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
    let not_issued =
        |reason: &dyn ToString| Problem::new(codes::NO_KEY).with("reason", reason.to_string());
    let answer = KeyAnswer::decode(answer.payload).map_err(|error| not_issued(&error))?;
    match answer.end {
        Some(KeyResult::Token(token)) => Ok(Given {
            token,
            config_key: answer.config_key,
        }),
        Some(KeyResult::Refusal(refusal)) if refusal.code == codes::NOT_INVITED.code => {
            Err(not_invited(&refusal.reason))
        }
        Some(KeyResult::Refusal(refusal)) => Err(not_issued(&refusal.reason)),
        None => Err(not_issued(&"the answer can't be read")),
    }
}

/// Connects to one of the servers with what the invitation has, trusting this authority.
async fn connected(invitation: &Invitation, ca: &Path) -> Result<Client, Problem> {
    let tls = trusting(Some(ca), None, codes::FLEET_FILE)?;
    let options = ConnectOptions::with_credentials(&invitation.creds);
    let options = options.map_err(|error| not_invited(&error))?;
    let options = options
        .name(format!("railbus {} joins", invitation.site))
        .custom_inbox_prefix(format!("{JOIN_INBOX}.{}", invitation.site))
        .require_tls(true)
        .tls_client_config(tls)
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
    use railbus_fleet::founding::found;
    use railbus_fleet::{NodeAddress, SiteSigner};

    /// A fleet: what is in its files.
    fn fleet() -> impl Fn(&str) -> String {
        let founded = found(&[NodeAddress::parse("a").unwrap()], 7).unwrap();
        move |path| {
            let file = founded.iter().find(|file| file.path == path).unwrap();
            file.text.trim().to_owned()
        }
    }

    fn invitation(text: &impl Fn(&str) -> String, site: &str) -> Invitation {
        let (signing, account) = (text("hub/join-signing.nk"), text("hub/sites-account.pub"));
        let signer = SiteSigner::new(&signing, &account).unwrap();
        Invitation {
            site: site.to_owned(),
            servers: vec![NodeAddress::parse("a").unwrap()],
            ca: text("hub/ca.pem"),
            creds: signer.creds(site, 7, 100).unwrap(),
        }
    }

    fn folder(what: &str) -> std::path::PathBuf {
        let name = format!("railbus-{what}-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_key_is_kept_for_its_invitation() {
        let folder = folder("pending");
        let files = SiteFiles::new(Arc::from(&*folder), "hq");
        let other = SiteFiles::new(Arc::from(&*folder), "other");
        let key = |files: &SiteFiles, id| pending_key(files, id).unwrap().1;
        let (first, second) = (key(&files, "A"), key(&files, "B"));
        assert_ne!(first, second);
        // Whatever was accepted meanwhile, and whatever the outlet is to be called.
        assert_eq!(key(&files, "A"), first);
        assert_eq!(key(&other, "A"), first);
        std::fs::write(files.pending("B"), "half of").unwrap();
        assert_ne!(key(&files, "B"), second);
        std::fs::remove_file(files.pending("A")).unwrap();
        std::fs::create_dir(files.pending("A")).unwrap();
        assert!(
            pending_key(&files, "A").is_err(),
            "what can't be read is not replaced"
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn an_outlet_of_another_fleet_or_site_stays_as_it_is() {
        let folder = folder("same-fleet");
        let (text, beta) = (fleet(), fleet());
        let own = invitation(&text, "plant7");
        let file = |name: &str, text: &str| {
            let path = folder.join(name);
            std::fs::write(&path, text).unwrap();
            path.display().to_string()
        };
        let settings = json!({
            "servers": ["a"],
            "credentials": file("creds", &own.creds),
            "ca": file("ca.pem", &own.ca),
            "write": ["*"],
        });
        let settings = settings.as_object().unwrap();
        let end = |invitation: &Invitation| {
            let end = same_fleet(settings, invitation);
            end.map_err(|problem| problem.code)
        };
        let refused = Err(codes::OTHER_FLEET.code.to_owned());
        assert_eq!(end(&invitation(&text, "plant7")), Ok(()));
        assert_eq!(end(&invitation(&text, "plant8")), refused);
        assert_eq!(end(&invitation(&beta, "plant7")), refused);
        // What can't be read is no proof of another fleet, if the servers are the same.
        std::fs::remove_file(folder.join("creds")).unwrap();
        assert_eq!(end(&invitation(&text, "plant7")), Ok(()));
        assert_eq!(end(&invitation(&beta, "plant7")), refused);
        std::fs::remove_file(folder.join("ca.pem")).unwrap();
        assert_eq!(end(&invitation(&text, "plant7")), Ok(()));
        let mut elsewhere = invitation(&text, "plant7");
        elsewhere.servers = vec![NodeAddress::parse("b").unwrap()];
        assert_eq!(end(&elsewhere), refused);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
