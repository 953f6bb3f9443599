//! The configurations that sites are to have.

use super::{Driver, StreamEnd, ended};
use crate::clock::since_boot;
use crate::hub::config::{self, GivenConfig};
use crate::hub::keys::config_signer;
use crate::hub::link::{DESIRED_STREAM, Link};
use crate::hub::streams::{last_of, put};
use crate::hub::view::{SCHEMA, presence};
use async_nats::jetstream::Context;
use railbus_api::fleet::{FleetConfig, FleetPresence};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::centre::StoreEnd;
use railbus_fleet::desired::{ConfigSigner, ConfigVerifier};
use railbus_fleet::is_site_name;
use railbus_fleet::message::ConfigDocument;
use railbus_store::history::millis;
use std::time::SystemTime;
use tokio::sync::mpsc::UnboundedSender;
use tokio::sync::mpsc::error::SendError;
use tokio::sync::oneshot;

/// Who waits for a configuration to be read, or to be stored.
pub(super) struct AskedConfig {
    site: String,
    /// It is to be stored.
    acts: bool,
    to: oneshot::Sender<Result<FleetConfig, Problem>>,
}

/// What the streams have now: the newest configuration of a site, if there is one.
pub(super) type NewestConfig = Result<Option<ConfigDocument>, Problem>;

impl AskedConfig {
    /// The connection is lost: whether it was stored is not known.
    pub(super) fn lost(self) {
        let problem = ended(&"disconnected").perhaps_acted(self.acts);
        // Fails if the client is gone.
        let _ = self.to.send(Err(problem));
    }
}

impl Driver {
    /// Somebody asks what is wanted of a site, and how far it is.
    pub(super) fn config(
        &self,
        site: String,
        link: Option<&Link>,
        to: oneshot::Sender<Result<FleetConfig, Problem>>,
    ) {
        let streams = match link {
            // What is no name may be a pattern.
            _ if !is_site_name(&site) => Err(self.no_site(&site)),
            None => Err(self.disconnected()),
            Some(link) => Ok(link.streams.clone()),
        };
        let streams = match streams {
            Ok(streams) => streams,
            Err(problem) => {
                // Fails if the client is gone.
                let _ = to.send(Err(problem));
                return;
            }
        };
        let (ends, acts) = (self.ends.0.clone(), false);
        let signer = config_signer(&self.files).ok().flatten();
        let key = signer.map(|signer| signer.public_key());
        let asked = AskedConfig { site, acts, to };
        tokio::spawn(async move {
            let found = newest(&streams, &asked.site, key.as_deref()).await;
            told(&ends, asked, found.map(|(document, _)| document));
        });
    }

    /// Somebody wants a site to have this configuration.
    pub(super) fn set_config(
        &self,
        given: GivenConfig,
        link: Option<&Link>,
        to: oneshot::Sender<Result<FleetConfig, Problem>>,
    ) {
        let (signer, said, streams) = match self.may_be_set(&given, link) {
            Ok(may) => may,
            Err(problem) => {
                // Fails if the client is gone.
                let _ = to.send(Err(problem));
                return;
            }
        };
        let ends = self.ends.0.clone();
        let asked = AskedConfig {
            site: given.site.clone(),
            acts: true,
            to,
        };
        tokio::spawn(async move {
            let stored = store(&streams, &signer, given, said).await;
            told(&ends, asked, stored.map(Some));
        });
    }

    /// What signs it, the newest version that the site knows of, and the streams; or why the site
    /// can't be given it.
    fn may_be_set(
        &self,
        given: &GivenConfig,
        link: Option<&Link>,
    ) -> Result<(ConfigSigner, u64, Context), Problem> {
        let signer = config_signer(&self.files)?.ok_or_else(|| {
            let folder = self.files.folder.display();
            Problem::new(codes::NO_CONFIG_KEY)
                .with("path", self.files.config_signing.display().to_string())
                .with_hint(format!("railbus fleet config-key {folder}"))
        })?;
        let link = link.ok_or_else(|| self.disconnected())?;
        let site = self.centre.site(since_boot(), &given.site);
        let said = given.may_go(site.as_ref())?;
        Ok((signer, said, link.streams.clone()))
    }

    /// A configuration was read or stored, or not.
    pub(super) fn config_known(&self, asked: AskedConfig, newest: NewestConfig) {
        let site = self.centre.site(since_boot(), &asked.site);
        let found = newest.and_then(|newest| match (newest, &site) {
            (None, None) => Err(self.no_site(&asked.site)),
            (newest, _) => Ok(newest),
        });
        let found = found.map(|newest| FleetConfig {
            schema: SCHEMA,
            site: asked.site,
            // No machine ever had this name: none is there.
            presence: site
                .as_ref()
                .map_or(FleetPresence::Offline, |site| presence(site.presence)),
            wanted: newest.map(config::wanted),
            state: site.and_then(|site| {
                let report = site.config?;
                Some(config::state(site.name, report, site.heard?))
            }),
        });
        // Fails if the client is gone.
        let _ = asked.to.send(found);
    }
}

/// Tells the driver; or its caller that the connection is lost.
fn told(ends: &UnboundedSender<StreamEnd>, asked: AskedConfig, newest: NewestConfig) {
    // Fails once the connection has ended.
    if let Err(SendError(StreamEnd::Config(asked, _))) = ends.send(StreamEnd::Config(asked, newest))
    {
        asked.lost();
    }
}

/// The subject of the configurations of a site.
fn subject(site: &str) -> String {
    format!("rb.desired.{site}.config")
}

/// The newest configuration of a site, and its revision. What this key did not sign for it counts
/// for nothing, as at the site: somebody may have the servers.
async fn newest(
    streams: &Context,
    site: &str,
    key: Option<&str>,
) -> Result<(Option<ConfigDocument>, u64), Problem> {
    let failed = |reason: &str| Problem::new(codes::FLEET_STREAMS).with("reason", reason);
    let found = last_of(streams, DESIRED_STREAM, &subject(site)).await;
    let found = found.ok_or_else(|| failed("the stream can't be read"))?;
    let Some((payload, revision)) = found else {
        return Ok((None, 0));
    };
    let verifier = key.and_then(|key| ConfigVerifier::new(key).ok());
    let document = verifier.and_then(|verifier| verifier.open(site, &payload).ok());
    Ok((document, revision))
}

/// Stores a configuration as the version after the newest one, and after the one that the site
/// knows of.
async fn store(
    streams: &Context,
    signer: &ConfigSigner,
    given: GivenConfig,
    said: u64,
) -> Result<ConfigDocument, Problem> {
    let key = signer.public_key();
    let (document, after) = newest(streams, &given.site, Some(&key)).await?;
    let newest = document.map_or(0, |document| document.version);
    if let Some(problem) = given.conflict(newest) {
        return Err(problem);
    }
    let document = ConfigDocument {
        version: newest.max(said).saturating_add(1),
        site: given.site,
        text: given.text,
        user: given.user,
        at_ms: millis(SystemTime::now()),
        replaces: given.replaces,
    };
    let signed = signer
        .sign(&document)
        .map_err(|error| Problem::new(codes::BAD_REQUEST).with("reason", error.to_string()))?;
    match put(streams, subject(&document.site), signed, after).await {
        (StoreEnd::Stored(_), _) => Ok(document),
        (StoreEnd::Conflict, _) => {
            Err(Problem::new(codes::SITE_CHANGING).with("name", document.site))
        }
        (StoreEnd::Unknown, problem) => {
            let problem = problem.unwrap_or_else(|| Problem::new(codes::FLEET_NOT_STORED));
            Err(problem.perhaps_acted(true))
        }
    }
}
