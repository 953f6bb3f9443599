//! Connections: who is let in, for how long, and how they end.

use super::access::Peer;
use super::socket::Socket;
use axum::Router;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

/// How many connections there may be, over TCP and the socket together; more wait to be let in.
/// A browser opens six; WebSockets have a room of their own.
const CONNECTIONS_MAX: usize = 128;
/// A request's head must have come after this time; an idle connection is closed then.
const HEAD_MAX: Duration = Duration::from_secs(10);
/// The longest head.
const HEAD_LEN_MAX: usize = 16 << 10;
/// After a connection could not be let in, so long until the next.
const PAUSE: Duration = Duration::from_millis(100);
/// At the end, connections have this time to finish what they are at.
const LINGER: Duration = Duration::from_millis(800);

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

/// Lets clients in over TCP until the daemon ends.
pub(super) async fn tcp(
    listener: TcpListener,
    router: Router,
    room: Room,
    mut stop: watch::Receiver<bool>,
) {
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
        let _ = stream.set_nodelay(true);
        let peer = Some(Peer(peer.ip()));
        tokio::spawn(serve(stream, peer, router.clone(), place, stop.clone()));
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
        tokio::spawn(serve(stream, None, router.clone(), place, stop.clone()));
    }
}

/// Serves one connection. Whatever ends it is the client's business alone.
async fn serve(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    peer: Option<Peer>,
    router: Router,
    place: OwnedSemaphorePermit,
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
