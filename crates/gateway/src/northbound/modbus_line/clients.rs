//! Who may connect, and how many: a listener that accepts no more than it serves.

use crate::northbound::network::Network;
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::{Id, JoinSet};
use tokio::time::{Instant, sleep_until};

/// How many clients there may be, and how many at one address.
const CLIENTS_MAX: usize = 32;
const PER_ADDRESS_MAX: usize = 8;
/// After an error of the system no connection is accepted for so long.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// A listener and its clients, each of which is a task of its own. They end with it.
#[derive(Debug)]
pub(super) struct Clients {
    listener: TcpListener,
    allowed: Vec<Network>,
    tasks: JoinSet<()>,
    addresses: BTreeMap<Id, IpAddr>,
    accepts_at: Instant,
}

impl Clients {
    /// Listens for clients of these networks, and of this machine.
    pub(super) async fn listen(at: SocketAddr, allowed: Vec<Network>) -> io::Result<Clients> {
        Ok(Clients {
            listener: TcpListener::bind(at).await?,
            allowed,
            tasks: JoinSet::new(),
            addresses: BTreeMap::new(),
            accepts_at: Instant::now(),
        })
    }

    /// The next client, to be served by [`Clients::serve`]; none where it may not connect, and is
    /// disconnected. Nothing is lost where this is dropped.
    pub(super) async fn next(&mut self) -> Option<(TcpStream, IpAddr)> {
        loop {
            let accepts = self.accepts_at <= Instant::now();
            tokio::select! {
                Some(gone) = self.tasks.join_next_with_id() => {
                    let id = match gone {
                        Ok((id, ())) => id,
                        Err(error) => error.id(),
                    };
                    self.addresses.remove(&id);
                }
                accepted = self.listener.accept(), if accepts => match accepted {
                    Ok((stream, from)) => {
                        let from = from.ip().to_canonical();
                        return self.may_connect(&stream, from).then_some((stream, from));
                    }
                    // The client was gone already, or there are too many open files.
                    Err(_) => self.accepts_at = Instant::now() + ACCEPT_PAUSE,
                },
                () = sleep_until(self.accepts_at), if !accepts => {}
            }
        }
    }

    /// How many are served.
    pub(super) fn len(&self) -> usize {
        self.tasks.len()
    }

    fn may_connect(&self, stream: &TcpStream, from: IpAddr) -> bool {
        // Also over an address of its own.
        let own = stream.local_addr().map(|at| at.ip().to_canonical());
        let is_here = from.is_loopback() || own.is_ok_and(|own| own == from);
        let may = is_here || self.allowed.iter().any(|net| net.contains(from));
        let here = self.addresses.values().filter(|address| **address == from);
        may && self.tasks.len() < CLIENTS_MAX && here.count() < PER_ADDRESS_MAX
    }

    /// Serves a client until this ends.
    pub(super) fn serve(&mut self, from: IpAddr, client: impl Future<Output = ()> + 'static) {
        let id = self.tasks.spawn_local(client).id();
        self.addresses.insert(id, from);
    }
}
