//! The server: what it is made of, and its one loop.

use crate::certificates::{Certificates, OWN_CERT, OWN_KEY, Thumbprint, UnknownCertificate};
use crate::known::KnownSite;
use crate::login::{Login, OpcuaUsers, endpoints};
use crate::manager::{Shared, SiteBuilder, SiteNodes};
use opcua::crypto::CertificateStore;
use opcua::server::node_manager::memory::InMemoryNodeManagerBuilder;
use opcua::server::{Limits, Server, ServerBuilder, ServerHandle, SubscriptionLimits};
use opcua::types::{BuildInfo, DateTime};
use railbus_site::{Follower, Service};
use railbus_wire::Micros;
use railbus_words::Lang;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, oneshot};
use tokio::task::yield_now;

/// How many requests may wait for what their commands changed; more wait before that.
const SYNCS_MAX: usize = 32;
/// How many clients may have a session.
const SESSIONS_MAX: usize = 20;
/// How many items a subscription may have, and how many values wait in each.
const ITEMS_MAX: usize = 2_000;
const QUEUE_MAX: usize = 100;
/// How many messages of a subscription may wait to be fetched; the library drops the oldest without
/// a word.
const MESSAGES_MAX: usize = 100;
/// How often the library looks whether a subscription has something to tell, in milliseconds, and
/// so the shortest time between two messages of one.
const TICK_MS: u64 = 50;
/// How many elements an array in a message may have: the library lets a request name as many nodes.
const ARRAY_MAX: usize = 10_000;
/// Messages in so many pieces at most, of this size.
const CHUNK_LEN: usize = 65_535;
const CHUNKS_MAX: usize = 16;
/// A client that does not ask for anything for so long has no session any more.
const SESSION_MAX_MS: u64 = 60_000;
/// A connection must say who it is within this time, in seconds.
const HELLO_MAX_S: u32 = 5;

/// Told once everything that has happened by now is known to all.
pub(crate) type Sync = oneshot::Sender<()>;

/// What a server is made with.
#[derive(Debug)]
pub struct OpcuaSetup {
    /// The site, as whoever reads it. Commands are carried out in the name of their users.
    pub service: Service,
    /// What the site is called.
    pub site: String,
    /// What commands come by, as logs have it.
    pub via: String,
    /// The host of the endpoint URL that clients get.
    pub host: String,
    /// The port of it.
    pub port: u16,
    /// Only programs on this machine can connect: then also without encryption.
    pub is_for_here: bool,
    /// Whoever does not sign in may read.
    pub allows_anonymous: bool,
    /// The clients whose certificates are trusted.
    pub trusted: Vec<Thumbprint>,
    /// The folder of certificates.
    pub folder: PathBuf,
    /// The language of names and texts.
    pub lang: Lang,
    /// The modules that are shown; empty for all.
    pub modules: Vec<String>,
    /// A command must be sent within this time.
    pub within: Micros,
}

/// Why a server has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OpcuaEnd {
    /// The site is gone.
    SiteGone,
    /// It had so many monitored items that it has to begin anew: the library keeps what was of
    /// them.
    Worn,
}

/// Ends what was asked of a server with it.
struct Ending(Arc<Shared>);

impl Drop for Ending {
    fn drop(&mut self) {
        self.0.has_ended.store(true, Relaxed);
    }
}

/// Why there is no server.
#[derive(Debug)]
pub enum OpcuaError {
    /// Its certificate can't be made or read, or its folder not be used.
    Certificates(std::io::Error),
    /// The library refuses it.
    Refused(String),
}

/// A server that waits for connections.
pub struct OpcuaServer {
    server: Server,
    handle: ServerHandle,
    shared: Arc<Shared>,
    syncs: mpsc::Receiver<Sync>,
    listener: TcpListener,
    follower: Follower,
    certificates: Arc<Certificates>,
    port: u16,
    /// By which its clients know it.
    thumbprint: String,
}

impl std::fmt::Debug for OpcuaServer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OpcuaServer").finish_non_exhaustive()
    }
}

/// The certificates of clients that were turned away.
#[derive(Clone, Debug)]
pub struct TurnedAway(Arc<Certificates>);

impl TurnedAway {
    /// Those whose certificates are not trusted since this was asked last, the newest last. Those
    /// that are trusted by now are let in from here on.
    #[must_use]
    pub fn unknown(&self) -> Vec<UnknownCertificate> {
        self.0.sort()
    }
}

impl OpcuaServer {
    /// A server for a site, with these accounts. It takes a moment where its key is made first.
    ///
    /// # Errors
    /// [`OpcuaError`].
    pub async fn open(
        setup: OpcuaSetup,
        users: Arc<dyn OpcuaUsers>,
    ) -> Result<OpcuaServer, OpcuaError> {
        let machine = opcua::crypto::hostname().unwrap_or_else(|_| "localhost".to_owned());
        let application = format!("urn:{machine}:railbus:{}", setup.site);
        let mut hosts = vec![setup.host.clone()];
        for host in ["localhost", "127.0.0.1", &machine] {
            if !hosts.iter().any(|known| known == host) {
                hosts.push(host.to_owned());
            }
        }
        let certificates = Certificates::open(&setup.folder, &setup.trusted, &application, &hosts);
        let certificates = Arc::new(certificates.map_err(OpcuaError::Certificates)?);
        let own = CertificateStore::read_cert(&setup.folder.join(OWN_CERT));
        let own = own.map_err(|why| OpcuaError::Certificates(std::io::Error::other(why)))?;
        // Whoever connects from elsewhere comes through its caller.
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await;
        let listener = listener.map_err(|error| OpcuaError::Refused(error.to_string()))?;
        let mut follower = setup.service.follow();
        let mut known = KnownSite::new(setup.modules.clone());
        if let Some(news) = follower.next_now() {
            known.take(&news);
        }
        let (sync, syncs) = mpsc::channel(SYNCS_MAX);
        let login = Login {
            users: Arc::clone(&users),
            allows_anonymous: setup.allows_anonymous,
        };
        let shared = Arc::new(Shared::new(
            (setup.service.clone(), users),
            (setup.site.clone(), setup.via.clone()),
            (setup.lang, setup.within),
            sync,
            known,
        ));
        let builder = builder(&setup, &application)
            .with_authenticator(Arc::new(login))
            .with_node_manager(InMemoryNodeManagerBuilder::new(SiteBuilder(Arc::clone(
                &shared,
            ))));
        let (server, handle) = builder.build().map_err(OpcuaError::Refused)?;
        Ok(OpcuaServer {
            server,
            handle,
            shared,
            syncs,
            listener,
            follower,
            certificates,
            port: setup.port,
            thumbprint: own.thumbprint().as_hex_string(),
        })
    }

    /// Where its caller connects clients to.
    ///
    /// # Errors
    /// Of the system.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// The thumbprint of its own certificate.
    #[must_use]
    pub fn thumbprint(&self) -> &str {
        &self.thumbprint
    }

    /// What is known of clients that were turned away.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAway {
        TurnedAway(Arc::clone(&self.certificates))
    }

    /// Serves until the site is gone, or it has to begin anew. It stops where this is dropped: what
    /// its clients have asked for and is not begun is not begun any more.
    ///
    /// # Errors
    /// Why it can't go on.
    pub async fn run(self) -> Result<OpcuaEnd, String> {
        let OpcuaServer {
            server,
            handle,
            shared,
            mut syncs,
            listener,
            mut follower,
            port,
            ..
        } = self;
        let nodes = handle.node_managers().get_of_type::<SiteNodes>();
        let nodes = nodes.ok_or("our nodes are not there")?;
        let info = Arc::clone(handle.info());
        let subscriptions = Arc::clone(handle.subscriptions());
        let _ending = Ending(Arc::clone(&shared));
        let mut serving = pin!(server.run_with(listener));
        let follow = async {
            // The library tells clients the port that it listens at, once it does.
            while info.port.load(Relaxed) == 0 {
                yield_now().await;
            }
            info.port.store(port, Relaxed);
            loop {
                tokio::select! {
                    biased;
                    news = follower.next() => match news {
                        Some(news) => shared.take(&news, &nodes, &subscriptions),
                        None => return,
                    },
                    Some(done) = syncs.recv() => {
                        while let Some(news) = follower.next_now() {
                            shared.take(&news, &nodes, &subscriptions);
                        }
                        // Fails if the client has gone.
                        let _ = done.send(());
                    }
                }
            }
        };
        tokio::select! {
            biased;
            end = &mut serving => end.map(|()| OpcuaEnd::SiteGone),
            () = follow => Ok(OpcuaEnd::SiteGone),
            () = shared.is_worn.notified() => Ok(OpcuaEnd::Worn),
        }
    }
}

fn limits() -> Limits {
    let subscriptions = SubscriptionLimits {
        // So that a client that wants every change gets it, with its time.
        min_sampling_interval_ms: 0.0,
        #[expect(clippy::cast_precision_loss, reason = "it is 50")]
        min_publishing_interval_ms: TICK_MS as f64,
        max_monitored_items_per_sub: ITEMS_MAX,
        max_monitored_item_queue_size: QUEUE_MAX,
        // A subscription whose client takes few values at a time needs many messages.
        max_queued_notifications: MESSAGES_MAX,
        max_subscriptions_per_session: 10,
        ..SubscriptionLimits::default()
    };
    Limits {
        max_sessions: SESSIONS_MAX,
        max_array_length: ARRAY_MAX,
        max_chunk_count: CHUNKS_MAX,
        max_message_size: CHUNK_LEN * CHUNKS_MAX,
        send_buffer_size: CHUNK_LEN,
        receive_buffer_size: CHUNK_LEN,
        subscriptions,
        ..Limits::default()
    }
}

/// The settings of the library.
fn builder(setup: &OpcuaSetup, application: &str) -> ServerBuilder {
    let version = env!("CARGO_PKG_VERSION");
    let mut builder = ServerBuilder::new()
        .application_name(format!("railbus {}", setup.site))
        .application_uri(application)
        .product_uri("urn:railbus")
        .build_info(BuildInfo {
            product_uri: "urn:railbus".into(),
            manufacturer_name: "railbus".into(),
            product_name: "railbus".into(),
            software_version: version.into(),
            build_number: version.into(),
            build_date: DateTime::null(),
        })
        .host(setup.host.clone())
        .port(setup.port)
        .hello_timeout(HELLO_MAX_S)
        .pki_dir(setup.folder.clone())
        .certificate_path(OWN_CERT)
        .private_key_path(OWN_KEY)
        .limits(limits())
        .locale_ids(vec![setup.lang.name().to_owned()])
        .discovery_urls(vec![format!("opc.tcp://{}:{}/", setup.host, setup.port)]);
    let config = builder.config_mut();
    config.subscription_poll_interval_ms = TICK_MS;
    config.max_session_timeout_ms = SESSION_MAX_MS;
    for (name, endpoint) in endpoints(setup.is_for_here) {
        builder = builder.add_endpoint(name, endpoint);
    }
    builder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_may_name_as_many_nodes_as_clients_are_told() {
        let limits = limits();
        let told = limits.operational;
        for nodes in [
            told.max_nodes_per_read,
            told.max_nodes_per_write,
            told.max_nodes_per_browse,
            told.max_monitored_items_per_call,
            limits.subscriptions.max_monitored_items_per_sub,
        ] {
            assert!(nodes <= limits.max_array_length, "{nodes}");
        }
    }
}
