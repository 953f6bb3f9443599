//! Who may connect, and how many: a listener that accepts no more than it serves.

use super::network::Network;
use super::outlet::Report;
use super::supervisor::OutletCounts;
use railbus_api::problem::{Problem, codes};
use railbus_words::width::is_shown;
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::{Id, JoinSet};
use tokio::time::{Instant, sleep_until, timeout};

/// How many clients there may be, and how many at one address.
const CLIENTS_MAX: usize = 32;
const PER_ADDRESS_MAX: usize = 8;
/// After an error of the system no connection is accepted for so long.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// How long the test of a server waits.
const TEST_MAX: Duration = Duration::from_secs(3);

/// How much of a client's name there is in logs, in characters.
const NAME_MAX: usize = 64;

/// A listener and its clients, each of which is a task of its own. They end with it.
#[derive(Debug)]
pub(crate) struct Clients {
    listener: TcpListener,
    allowed: Vec<Network>,
    /// Clients show certificates.
    is_guarded: bool,
    /// Where they are counted, and those that were not let in.
    counts: Arc<OutletCounts>,
    tasks: JoinSet<()>,
    addresses: BTreeMap<Id, IpAddr>,
    accepts_at: Instant,
}

impl Clients {
    /// Listens for clients of these networks, and of this machine. `is_guarded`: they show
    /// certificates, so that without networks everybody may try.
    ///
    /// # Errors
    /// [`codes::OUTLET_LISTEN`], with the reason of the system.
    pub(crate) async fn listen(
        at: SocketAddr,
        allowed: Vec<Network>,
        is_guarded: bool,
        report: &Report,
    ) -> Result<Clients, Problem> {
        let listener = TcpListener::bind(at).await;
        Ok(Clients {
            listener: listener.map_err(|error| not_listening(at, error))?,
            allowed,
            is_guarded,
            counts: Arc::clone(&report.counts),
            tasks: JoinSet::new(),
            addresses: BTreeMap::new(),
            accepts_at: Instant::now(),
        })
    }

    /// The next client, to be served by [`Clients::serve`]. Those that may not connect are
    /// disconnected. Nothing is lost where this is dropped.
    pub(crate) async fn next(&mut self) -> (TcpStream, IpAddr) {
        loop {
            let accepts = self.accepts_at <= Instant::now();
            tokio::select! {
                Some(gone) = self.tasks.join_next_with_id() => {
                    let id = match gone {
                        Ok((id, ())) => id,
                        Err(error) => error.id(),
                    };
                    self.addresses.remove(&id);
                    self.count();
                }
                accepted = self.listener.accept(), if accepts => match accepted {
                    Ok((stream, from)) => {
                        let from = from.ip().to_canonical();
                        if self.may_connect(&stream, from) {
                            return (stream, from);
                        }
                        self.counts.dropped.fetch_add(1, Relaxed);
                    }
                    // The client was gone already, or there are too many open files.
                    Err(_) => self.accepts_at = Instant::now() + ACCEPT_PAUSE,
                },
                () = sleep_until(self.accepts_at), if !accepts => {}
            }
        }
    }

    /// Tells how many are served.
    fn count(&self) {
        self.counts.clients.store(self.tasks.len(), Relaxed);
    }

    fn may_connect(&self, stream: &TcpStream, from: IpAddr) -> bool {
        let own = stream.local_addr().map(|at| at.ip().to_canonical());
        let may = is_allowed(from, own.ok(), &self.allowed, self.is_guarded);
        let here = self.addresses.values().filter(|address| **address == from);
        may && self.tasks.len() < CLIENTS_MAX && here.count() < PER_ADDRESS_MAX
    }

    /// Serves a client until this ends.
    pub(crate) fn serve(&mut self, from: IpAddr, client: impl Future<Output = ()> + 'static) {
        let id = self.tasks.spawn_local(client).id();
        self.addresses.insert(id, from);
        self.count();
    }
}

impl Drop for Clients {
    fn drop(&mut self) {
        self.counts.clients.store(0, Relaxed);
    }
}

/// Whether a client at this address may connect to one of our own. Where clients show
/// certificates, everybody may unless networks are named.
fn is_allowed(from: IpAddr, own: Option<IpAddr>, allowed: &[Network], is_guarded: bool) -> bool {
    // Of this machine, also over an address of its own.
    let is_here = from.is_loopback() || own == Some(from);
    let is_open = is_guarded && allowed.is_empty();
    is_here || is_open || allowed.iter().any(|network| network.contains(from))
}

/// It can't listen, or nothing listens there.
pub(crate) fn not_listening(listen: SocketAddr, why: impl ToString) -> Problem {
    let problem = Problem::new(codes::OUTLET_LISTEN).with("listen", listen.to_string());
    problem.with("reason", why.to_string())
}

/// What is found out of a server that listens there, where it can be reached from this machine.
///
/// # Errors
/// [`not_listening`].
pub(crate) async fn reached(
    mut listen: SocketAddr,
    ask: impl AsyncFnOnce(SocketAddr) -> io::Result<String>,
) -> Result<String, Problem> {
    if listen.ip().is_unspecified() {
        listen.set_ip(match listen {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    let said = timeout(TEST_MAX, ask(listen)).await;
    let said = said.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
    said.map_err(|error| not_listening(listen, error))
}

/// What a client says of itself, as it may stand in a log.
pub(crate) fn plain(text: &str) -> String {
    let shown = text.chars().filter(|letter| is_shown(*letter));
    shown.take(NAME_MAX).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn others_may_connect_where_they_are_named_or_certificates_are_asked_for() {
        let address = |text: &str| text.parse::<IpAddr>().unwrap();
        let (far, own) = (address("10.0.0.5"), Some(address("10.0.0.1")));
        let named = [Network::parse("10.0.0.0/24").unwrap()];
        let other = [Network::parse("192.168.1.0/24").unwrap()];
        for (allowed, asks, may) in [
            (&[][..], false, false),
            (&[][..], true, true),
            (&named[..], false, true),
            (&named[..], true, true),
            (&other[..], false, false),
            (&other[..], true, false),
        ] {
            assert_eq!(
                is_allowed(far, own, allowed, asks),
                may,
                "{allowed:?} {asks}"
            );
            assert!(is_allowed(address("127.0.0.1"), own, allowed, asks));
            assert!(is_allowed(address("10.0.0.1"), own, allowed, asks));
        }
    }

    #[test]
    fn what_a_client_says_of_itself_can_not_change_a_log() {
        assert_eq!(plain("CN=scada\r\n\u{202E}nimda\u{2066}"), "CN=scadanimda");
        assert_eq!(plain("CN=锅炉房"), "CN=锅炉房");
        assert_eq!(plain(&"x".repeat(1_000)).len(), NAME_MAX);
    }
}
