//! The centre's connection to its servers, and the streams it has there.

use super::keys::{self, KeyIssuer, KeyRequests};
use super::site_api::SiteWay;
use crate::nats::{next, unreached, unusable};
use crate::northbound::broker::trusting;
use async_nats::jetstream::consumer::pull::{Ordered, OrderedConfig};
use async_nats::jetstream::consumer::{Consumer, DeliverPolicy};
use async_nats::jetstream::stream::{Config as StreamConfig, Stream as NatsStream};
use async_nats::jetstream::{self, Context};
use async_nats::{Client, ConnectOptions, Event, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::founding::CONFIG_SIGNING;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::sync::watch;

/// A server that does not answer within this time is left.
const CONNECT_MAX: Duration = Duration::from_secs(10);
/// How often it is asked whether the server is there.
const PING: Duration = Duration::from_secs(10);
/// The maximum number of queued messages.
const WAITING_MAX: usize = 8_192;
/// The timeout of a request to the streams: it is lost where no server leads one.
const REQUEST_MAX: Duration = Duration::from_secs(5);
/// How long the next of the documents may take that are there.
const DOCUMENT_MAX: Duration = Duration::from_secs(10);
/// Messages of sites.
const SAID: &str = "rb.up.*.*";
/// Of all centre processes, one gets each request for a session.
const QUEUE: &str = "hub";
/// The documents of sessions.
const LEASES: &str = "rb.fleet.lease.*";
/// What people say of sites.
const OF_SITES: &str = "rb.fleet.site.*";
/// How all points of a site are.
const STATES: &str = "rb.up.*.state";
/// What was wanted of sites, and what came of it.
const COMMANDS: &str = "rb.cmd.*.*";
/// How long that is kept.
const COMMANDS_KEPT: Duration = Duration::from_secs(90 * 24 * 60 * 60);
/// For how long before the newest one it is read: a site knows for a day what came of a command.
const COMMANDS_READ: Duration = Duration::from_secs(7 * 24 * 60 * 60);
/// The longest record of a command, in bytes.
const COMMAND_MAX: i32 = 256 << 10;
/// Configurations that sites are to have, and the stream that keeps them.
pub(super) const DESIRED_STREAM: &str = "DESIRED";
const DESIRED: &str = "rb.desired.*.*";
/// The longest of them with its signature, in bytes: the text has 512 KiB at most.
const DESIRED_MAX: i32 = 516 << 10;
/// The copies that a stream has, where there are enough servers.
const REPLICAS: usize = 3;

/// The files of the centre.
#[derive(Clone, Debug)]
pub(super) struct HubFiles {
    /// The addresses of the servers.
    pub(super) servers: Vec<String>,
    /// The folder of the fleet.
    pub(super) folder: PathBuf,
    ca: PathBuf,
    pub(super) creds: PathBuf,
    /// The public key of the sites' account, and the keys that sign sites and invitations.
    pub(super) account: PathBuf,
    pub(super) site_signing: PathBuf,
    pub(super) join_signing: PathBuf,
    /// The key that signs configurations, which a fleet may lack.
    pub(super) config_signing: PathBuf,
}

/// A connection without subscriptions.
pub(super) struct Opened {
    client: Client,
    streams: Context,
    is_up: watch::Receiver<bool>,
    fleet: Ordered,
    commands: Ordered,
    /// The documents of sessions, what people say of sites, the last states of sites, and commands.
    pub(super) documents: Vec<Document>,
}

/// A message of a stream.
pub(super) struct Document {
    pub(super) subject: String,
    pub(super) payload: Vec<u8>,
    pub(super) number: u64,
    /// How much older it is than the newest of its stream.
    pub(super) age: Duration,
}

/// A subscribed connection.
pub(super) struct Link {
    pub(super) client: Client,
    pub(super) streams: Context,
    /// Ends with the connection.
    pub(super) is_up: watch::Receiver<bool>,
    /// Requests for sessions.
    pub(super) hellos: Subscriber,
    /// All else that sites say, in the order in which each said it.
    pub(super) said: Subscriber,
    /// Documents of sessions, and what people say of sites, as they are stored.
    pub(super) fleet: Ordered,
    /// What is wanted of sites and came of it, as it is stored.
    pub(super) commands: Ordered,
    /// Answers requests for keys.
    _keys: KeyIssuer,
}

/// The folder of the centre in that of its fleet.
pub(super) fn folder(fleet: &Path) -> PathBuf {
    fleet.join("hub")
}

fn no_streams(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_STREAMS).with("reason", reason.to_string())
}

pub(super) fn ended(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_ENDED).with("reason", reason.to_string())
}

impl HubFiles {
    /// Those of a fleet in this folder.
    ///
    /// # Errors
    /// The addresses of the servers can't be read. Other files are read at each connection.
    pub(super) fn read(folder: &Path) -> Result<HubFiles, Problem> {
        let hub = self::folder(folder);
        let path = hub.join("servers");
        let text = std::fs::read_to_string(&path).map_err(|error| unusable(&path, &error))?;
        let servers: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
        if servers.is_empty() {
            return Err(unusable(&path, &"it names no server"));
        }
        Ok(HubFiles {
            servers,
            ca: hub.join("ca.pem"),
            creds: hub.join("hub.creds"),
            account: hub.join("sites-account.pub"),
            site_signing: hub.join("site-signing.nk"),
            join_signing: hub.join("join-signing.nk"),
            config_signing: folder.join(CONFIG_SIGNING),
            // Commands that help are given elsewhere.
            folder: folder.canonicalize().unwrap_or_else(|_| folder.to_owned()),
        })
    }

    /// The streams that sites and centre need.
    fn streams(&self) -> [StreamConfig; 5] {
        let day = Duration::from_secs(24 * 60 * 60);
        let replicas = if self.servers.len() < REPLICAS {
            1
        } else {
            REPLICAS
        };
        let stream = |name: &str, subject: &str, of_subject| StreamConfig {
            name: name.to_owned(),
            subjects: vec![subject.to_owned()],
            max_messages_per_subject: of_subject,
            num_replicas: replicas,
            ..StreamConfig::default()
        };
        [
            StreamConfig {
                max_age: day,
                // Sites send half as much at a time.
                max_message_size: 128 << 10,
                duplicate_window: Duration::from_secs(120),
                ..stream("DATA", "rb.up.*.data", 9_000)
            },
            stream("STATE", STATES, 1),
            stream("FLEET", "rb.fleet.*.*", 20),
            StreamConfig {
                max_age: COMMANDS_KEPT,
                max_message_size: COMMAND_MAX,
                ..stream("LEDGER", COMMANDS, 3)
            },
            StreamConfig {
                max_message_size: DESIRED_MAX,
                // Each site reads its own this way.
                allow_direct: true,
                ..stream(DESIRED_STREAM, DESIRED, 20)
            },
        ]
    }
}

/// Connects to one of the servers with these credentials, with the files as they are now; and
/// whether the connection lasts.
///
/// # Errors
/// None of them can be reached, or they don't accept these credentials.
pub(super) async fn connect(
    files: &HubFiles,
    creds_file: &Path,
) -> Result<(Client, watch::Receiver<bool>), Problem> {
    let creds = std::fs::read_to_string(creds_file);
    let creds = creds.map_err(|error| unusable(creds_file, &error))?;
    let tls = trusting(Some(&files.ca), None, codes::FLEET_FILE)?;
    let options = ConnectOptions::with_credentials(&creds);
    let options = options.map_err(|error| unusable(creds_file, &error))?;
    let (told, is_up) = watch::channel(true);
    let options = options
        .name("railbus hub")
        .require_tls(true)
        .tls_client_config(tls)
        // Names are those of the certificates, not what servers say of each other.
        .ignore_discovered_servers()
        .connection_timeout(CONNECT_MAX)
        .ping_interval(PING)
        .subscription_capacity(WAITING_MAX)
        // A new connection is made instead: messages were missed.
        .max_reconnects(files.servers.len())
        .event_callback(move |event| {
            if matches!(event, Event::Disconnected | Event::Closed) {
                told.send_replace(false);
            }
            std::future::ready(())
        });
    let servers = files.servers.iter().map(|server| format!("tls://{server}"));
    let servers: Vec<String> = servers.collect();
    let client = options.connect(servers).await.map_err(unreached)?;
    Ok((client, is_up))
}

impl Opened {
    /// Connects to one of the servers, with the files as they are now.
    ///
    /// # Errors
    /// None of them can be reached, they don't accept this centre, or they have no streams.
    pub(super) async fn open(files: &HubFiles) -> Result<Opened, Problem> {
        let (client, is_up) = connect(files, &files.creds).await?;
        let mut streams = jetstream::new(client.clone());
        streams.set_timeout(REQUEST_MAX);
        let mut made = Vec::new();
        for config in files.streams() {
            let stream = streams.get_or_create_stream(config).await;
            made.push(stream.map_err(|error| no_streams(&error))?);
        }
        let [_, states, fleet, ledger, _] = &made[..] else {
            return Err(no_streams(&"a stream is missing"));
        };
        let mut documents = Vec::new();
        let last = DeliverPolicy::LastPerSubject;
        let fleet = read(fleet, (&[LEASES, OF_SITES], last), &mut documents).await?;
        read(states, (&[STATES], last), &mut documents).await?;
        // By the servers' clocks: this machine's may be wrong.
        let newest = ledger.cached_info().state.last_timestamp;
        let since = DeliverPolicy::ByStartTime {
            start_time: newest - COMMANDS_READ,
        };
        let commands = read(ledger, (&[COMMANDS], since), &mut documents).await?;
        Ok(Opened {
            client,
            streams,
            is_up,
            fleet,
            commands,
            documents,
        })
    }

    /// Subscribes to the messages of sites. Only after the documents were applied: messages queued
    /// meanwhile would look fresher than they are. What is missed is requested.
    ///
    /// Also why keys can't be issued on it, if they can't.
    ///
    /// # Errors
    /// The connection has ended.
    pub(super) async fn subscribe(
        self,
        files: &HubFiles,
    ) -> Result<(Link, Result<(), Problem>), Problem> {
        let client = self.client;
        let hellos = client.queue_subscribe("rb.up.*.hello", QUEUE.to_owned());
        let hellos = hellos.await.map_err(|error| ended(&error))?;
        let said = client.subscribe(SAID).await;
        let said = said.map_err(|error| ended(&error))?;
        let joins = client.queue_subscribe("rb.join.*", QUEUE.to_owned());
        let joins = joins.await.map_err(|error| ended(&error))?;
        let renewals = client.queue_subscribe("rb.up.*.renew", QUEUE.to_owned());
        let renewals = renewals.await.map_err(|error| ended(&error))?;
        let requests = KeyRequests { joins, renewals };
        let (keys, can_sign) = keys::open(files, client.clone(), self.streams.clone(), requests);
        let link = Link {
            client,
            streams: self.streams,
            is_up: self.is_up,
            hellos,
            said,
            fleet: self.fleet,
            commands: self.commands,
            _keys: keys,
        };
        Ok((link, can_sign))
    }
}

impl Link {
    /// The server that it is connected to.
    pub(super) fn server(&self) -> String {
        let info = self.client.server_info();
        format!("{} {}", info.server_name, info.version)
    }

    /// How a site is asked in this session.
    pub(super) fn way(&self, site: &str, session: &str, what: &str) -> SiteWay {
        SiteWay {
            client: self.client.clone(),
            subject: format!("rb.down.{site}.{session}.{what}"),
            is_up: self.is_up.clone(),
        }
    }
}

/// Reads these messages; what comes after them is in the stream that is returned.
async fn read(
    stream: &NatsStream,
    (subjects, deliver_policy): (&[&str], DeliverPolicy),
    into: &mut Vec<Document>,
) -> Result<Ordered, Problem> {
    let config = OrderedConfig {
        deliver_policy,
        filter_subjects: subjects.iter().map(ToString::to_string).collect(),
        ..OrderedConfig::default()
    };
    let consumer: Consumer<OrderedConfig> = stream
        .create_consumer(config)
        .await
        .map_err(|error| no_streams(&error))?;
    let newest = stream.cached_info().state.last_timestamp;
    let mut left = consumer.cached_info().num_pending;
    let mut messages = consumer
        .messages()
        .await
        .map_err(|error| no_streams(&error))?;
    while left > 0 {
        let message = tokio::time::timeout(DOCUMENT_MAX, next(&mut messages)).await;
        let message = message.map_err(|_| no_streams(&"no document came"))?;
        let message = message.ok_or_else(|| ended(&"closed"))?;
        let message = message.map_err(|error| no_streams(&error))?;
        let info = message.info().map_err(|error| no_streams(&error))?;
        left = info.pending;
        into.push(Document {
            number: info.stream_sequence,
            // One that came since is new.
            age: (newest - info.published).try_into().unwrap_or_default(),
            subject: message.subject.to_string(),
            payload: message.payload.to_vec(),
        });
    }
    Ok(messages)
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_fleet::desired::{CONFIG_TEXT_MAX, ConfigSigner};
    use railbus_fleet::message::ConfigDocument;

    #[test]
    fn the_longest_configuration_has_a_place() {
        let folder = std::env::temp_dir().join(format!("railbus-link-{}", std::process::id()));
        std::fs::create_dir_all(self::folder(&folder)).unwrap();
        std::fs::write(self::folder(&folder).join("servers"), "nats1\n").unwrap();
        let files = HubFiles::read(&folder).unwrap_or_else(|problem| panic!("{problem:?}"));
        std::fs::remove_dir_all(&folder).unwrap();
        let streams = files.streams();
        let found = streams.iter().find(|stream| stream.name == DESIRED_STREAM);
        let stream = found.unwrap();
        assert_eq!(
            (stream.max_messages_per_subject, stream.num_replicas),
            (20, 1)
        );
        assert!(stream.allow_direct);
        let longest = ConfigDocument {
            site: "s".repeat(64),
            version: 1 << 53,
            text: "#".repeat(CONFIG_TEXT_MAX),
            user: "u".repeat(256),
            at_ms: i64::MAX,
            replaces: vec![7; 32],
        };
        let signed = ConfigSigner::generate().sign(&longest).unwrap();
        // With room for headers.
        let long = i32::try_from(signed.len()).unwrap() + 2_048;
        assert!(long < stream.max_message_size, "{long}");
    }
}
