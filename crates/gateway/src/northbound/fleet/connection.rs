//! A connection to the servers of a fleet.

use super::settings::FleetAccess;
use crate::access::secret::{hex, random};
use crate::nats::{unreached, unusable};
use crate::northbound::broker::trusting;
use crate::northbound::outlet::Outlet;
use async_nats::{Client, ConnectOptions, Event, ServerError, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::{NodeAddress, SiteClaims, read_site_creds, site_token};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::sync::watch;

/// A server that does not answer within this time is left.
pub(super) const CONNECT_MAX: Duration = Duration::from_secs(10);
/// How often it is asked whether a server is there; after three times without an answer it is not.
const PING: Duration = Duration::from_secs(10);
/// After a connection was lost, the next try comes at a random moment of this time, the first one
/// and all others: where a server fails, thousands of sites try.
const AGAIN: [Duration; 2] = [RECONNECT_MAX, Duration::from_secs(60)];
/// When the first one comes at the latest.
pub(super) const RECONNECT_MAX: Duration = Duration::from_secs(20);
/// How many commands to the client wait.
const COMMANDS_MAX: usize = 64;

/// Whether there is a connection, and what a server complains of.
#[derive(Clone, Debug, Default)]
pub(super) struct LinkState {
    /// How often it was lost.
    pub(super) losses: u64,
    pub(super) is_up: bool,
    /// How often a server complained, and what it said last.
    pub(super) complaints: u64,
    pub(super) complaint: String,
}

/// A connection. Where it is lost, the client tries each server once more by itself; then it ends.
pub(super) struct Connection {
    pub(super) client: Client,
    /// How it is. Ends with it.
    pub(super) state: watch::Receiver<LinkState>,
    /// Where answers come: this, a dot, and the number of the message.
    pub(super) inbox: String,
    /// What comes there.
    pub(super) answers: Subscriber,
}

/// What the credentials say, and they themselves.
///
/// # Errors
/// There are none.
pub(super) fn credentials(path: &Path) -> Result<(SiteClaims, String), Problem> {
    let text = std::fs::read_to_string(path).map_err(|error| unusable(path, &error))?;
    let claims = read_site_creds(&text).map_err(|error| unusable(path, &error))?;
    Ok((claims, text))
}

impl Connection {
    /// Connects to one of the servers, with the files as they are now: credentials are renewed.
    /// Also what these say, and the signed claims in them.
    ///
    /// # Errors
    /// None of them can be reached, or they don't accept this site.
    pub(super) async fn open(outlet: &Outlet) -> Result<(Connection, SiteClaims, String), Problem> {
        let access = FleetAccess::of(&outlet.settings.borrow());
        let (claims, creds) = credentials(&access.credentials)?;
        let tls = trusting(access.ca.as_deref(), None, codes::FLEET_FILE)?;
        let (told, state) = watch::channel(LinkState {
            is_up: true,
            ..LinkState::default()
        });
        let is_open = Arc::new(AtomicBool::new(false));
        let was_open = Arc::clone(&is_open);
        let internal =
            |error: &dyn ToString| Problem::new(codes::INTERNAL).with("reason", error.to_string());
        let prefix = format!("_INBOX.{}", claims.site);
        let options = ConnectOptions::with_credentials(&creds).map_err(|error| {
            Problem::new(codes::FLEET_FILE)
                .with("path", access.credentials.display().to_string())
                .with("reason", error.to_string())
        })?;
        let options = options
            .name(format!("railbus {}", claims.site))
            .custom_inbox_prefix(&prefix)
            .require_tls(true)
            .tls_client_config(tls)
            // Names are those of the certificates, not what servers say of each other.
            .ignore_discovered_servers()
            .connection_timeout(CONNECT_MAX)
            .ping_interval(PING)
            .client_capacity(COMMANDS_MAX)
            .read_buffer_capacity(2_048)
            // Whoever is not let in any more has to read his files anew.
            .max_reconnects(access.servers.len())
            .reconnect_delay_callback(move |tries| match was_open.load(Ordering::Relaxed) {
                true => delay(tries),
                false => Duration::ZERO,
            })
            .event_callback(move |event| {
                told.send_modify(|told| happened(told, event));
                std::future::ready(())
            });
        let servers = servers_of(&access.servers);
        let client = options.connect(servers).await.map_err(unreached)?;
        is_open.store(true, Ordering::Relaxed);
        let nonce = random::<8>().map_err(|error| internal(&error))?;
        let inbox = format!("{prefix}.{}", hex(&nonce));
        let answers = client.subscribe(format!("{inbox}.*")).await;
        let answers = answers.map_err(|error| internal(&error))?;
        let connection = Connection {
            client,
            state,
            inbox,
            answers,
        };
        let token = site_token(&creds).unwrap_or_default().to_owned();
        Ok((connection, claims, token))
    }
}

/// Their addresses, as the client takes them.
pub(super) fn servers_of(nodes: &[NodeAddress]) -> Vec<String> {
    nodes.iter().map(|node| format!("tls://{node}")).collect()
}

fn happened(told: &mut LinkState, event: Event) {
    match event {
        Event::Connected => told.is_up = true,
        Event::Disconnected => {
            told.losses += 1;
            told.is_up = false;
        }
        Event::ServerError(ServerError::Other(complaint)) => {
            told.complaints += 1;
            told.complaint = complaint;
        }
        _ => {}
    }
}

/// How long to wait before this try.
fn delay(tries: usize) -> Duration {
    let longest = if tries <= 1 { AGAIN[0] } else { AGAIN[1] };
    let share = random::<2>().map_or(u16::MAX / 2, u16::from_le_bytes);
    longest.mul_f64(f64::from(share) / f64::from(u16::MAX))
}
