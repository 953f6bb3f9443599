//! Connections: who is let in, for how long, and how they end.

use super::access::Peer;
use super::socket::Socket;
use super::tls::Tls;
use crate::render::out;
use axum::Router;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

/// How many connections there may be over TCP, and as many over the socket, so that nobody from
/// without keeps its owner out; more wait to be let in.
/// A browser opens six; WebSockets have a room of their own.
const CONNECTIONS_MAX: usize = 128;
/// How many of them another machine may have.
const OF_ADDRESS_MAX: usize = 16;
/// A client must have been greeted by TLS after this time.
const GREETING_MAX: Duration = Duration::from_secs(10);
/// A request's head must have come after this time; an idle connection is closed then.
const HEAD_MAX: Duration = Duration::from_secs(10);
/// The longest head.
const HEAD_LEN_MAX: usize = 16 << 10;
/// After a connection could not be let in, so long until the next.
const PAUSE: Duration = Duration::from_millis(100);
/// At the end, connections have this time to finish what they are at.
const LINGER: Duration = Duration::from_millis(600);

/// The place of a connection, given back when it ends.
type Place = (OwnedSemaphorePermit, Option<OfAddress>);

/// The room for connections.
#[derive(Clone, Debug)]
pub(super) struct Room(Arc<Semaphore>);

impl Room {
    pub(super) fn new() -> Room {
        Room(Arc::new(Semaphore::new(CONNECTIONS_MAX)))
    }

    /// A place, as soon as there is one.
    async fn place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.0).acquire_owned().await.ok()
    }

    /// Waits until all have left, as long as they may take.
    pub(super) async fn emptied(&self) {
        let all = self.0.acquire_many(CONNECTIONS_MAX as u32);
        let _ = tokio::time::timeout(LINGER, all).await;
    }
}

/// Waits for the end of the daemon.
pub(super) async fn ended(stop: &mut watch::Receiver<bool>) {
    // Fails where the other end has gone, which is the end too.
    let _ = stop.wait_for(|stop| *stop).await;
}

/// How many connections each address has over TCP.
#[derive(Clone, Debug, Default)]
struct Addresses(Arc<Mutex<HashMap<IpAddr, usize>>>);

/// One of an address's connections.
struct OfAddress(Addresses, IpAddr);

impl Addresses {
    /// A place for one more; none where an address has as many as it may. This machine may have
    /// all there are: what forwards for others does so from here.
    fn place(&self, address: IpAddr) -> Option<OfAddress> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = all.entry(address).or_default();
        if *count >= OF_ADDRESS_MAX && !address.to_canonical().is_loopback() {
            return None;
        }
        *count += 1;
        Some(OfAddress(self.clone(), address))
    }
}

impl Drop for OfAddress {
    fn drop(&mut self) {
        let mut all = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = all.get_mut(&self.1) {
            *count -= 1;
            if *count == 0 {
                all.remove(&self.1);
            }
        }
    }
}

/// Lets clients in over TCP until the daemon ends.
pub(super) async fn tcp(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    router: Router,
    room: Room,
    mut stop: watch::Receiver<bool>,
) {
    let addresses = Addresses::default();
    loop {
        let accepted = tokio::select! {
            () = ended(&mut stop) => return,
            accepted = async { (room.place().await, listener.accept().await) } => accepted,
        };
        let (Some(place), Ok((stream, peer))) = accepted else {
            // One client's own error, or a lack of file handles, which takes time to pass.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let Some(of_address) = addresses.place(peer.ip()) else {
            continue;
        };
        let _ = stream.set_nodelay(true);
        let peer = Some(Peer(peer.ip()));
        let place = (place, Some(of_address));
        let (router, stop) = (router.clone(), stop.clone());
        match &tls {
            None => tokio::spawn(serve(stream, peer, router, place, stop)),
            Some(tls) => tokio::spawn(greet(Arc::clone(tls), stream, peer, router, place, stop)),
        };
    }
}

/// Greets a client by TLS, and serves it then. Whoever is not done in time leaves.
async fn greet(
    tls: Arc<Tls>,
    stream: TcpStream,
    peer: Option<Peer>,
    router: Router,
    place: Place,
    stop: watch::Receiver<bool>,
) {
    let (acceptor, read) = tls.acceptor();
    if let Err(problem) = read {
        out::note(&format!(
            "tls: {}: {}; the certificate before stays",
            problem.text("path"),
            problem.text("reason")
        ));
    }
    let greeted = tokio::time::timeout(GREETING_MAX, acceptor.accept(stream));
    if let Ok(Ok(stream)) = greeted.await {
        serve(stream, peer, router, place, stop).await;
    }
}

/// Lets clients in over the socket until the daemon ends; then the socket goes away.
pub(super) async fn unix(
    socket: Socket,
    router: Router,
    room: Room,
    mut stop: watch::Receiver<bool>,
) {
    loop {
        let accepted = tokio::select! {
            () = ended(&mut stop) => return,
            accepted = async { (room.place().await, socket.listener.accept().await) } => accepted,
        };
        let (Some(place), Ok((stream, _))) = accepted else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let place = (place, None);
        tokio::spawn(serve(stream, None, router.clone(), place, stop.clone()));
    }
}

/// Serves one connection. Whatever ends it is the client's business alone.
async fn serve(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    peer: Option<Peer>,
    router: Router,
    place: Place,
    mut stop: watch::Receiver<bool>,
) {
    let router = TowerToHyperService::new(router);
    let from_peer = service_fn(move |mut request: Request<Incoming>| {
        if let Some(peer) = peer {
            request.extensions_mut().insert(peer);
        }
        router.call(request)
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_MAX)
        .max_buf_size(HEAD_LEN_MAX)
        .serve_connection(TokioIo::new(stream), from_peer)
        .with_upgrades();
    let mut connection = std::pin::pin!(connection);
    tokio::select! {
        _ = &mut connection => {}
        () = ended(&mut stop) => {
            connection.as_mut().graceful_shutdown();
            let _ = tokio::time::timeout(LINGER, connection).await;
        }
    }
    drop(place);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_has_so_many_places_and_gives_them_back() {
        let addresses = Addresses::default();
        let [far, near] = [[10, 0, 0, 7], [127, 0, 0, 1]].map(IpAddr::from);
        let mut places: Vec<_> = (0..OF_ADDRESS_MAX).map(|_| addresses.place(far)).collect();
        assert!(places.iter().all(Option::is_some));
        assert!(addresses.place(far).is_none());
        assert!(addresses.place(IpAddr::from([10, 0, 0, 8])).is_some());
        let many: Vec<_> = (0..100).map(|_| addresses.place(near)).collect();
        assert!(many.iter().all(Option::is_some));
        places.pop();
        assert!(addresses.place(far).is_some());
        drop((places, many));
        assert!(addresses.0.lock().unwrap().is_empty());
    }
}
