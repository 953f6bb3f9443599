//! Connections: who is let in, for how long, and how they end.

use super::access::Peer;
use super::tls::Tls;
use axum::Router;
use hyper::Request;
use hyper::body::{Body, Bytes, Frame, Incoming, SizeHint};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use railbus_app::render::out;
use railbus_app::socket::Socket;
use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore, watch};

/// The most connections over TCP, and as many over the socket, so that other machines can't keep
/// its owner out; more wait to be accepted. A browser opens six; WebSockets have a limit of their
/// own.
const CONNECTIONS_MAX: usize = 128;
/// How many of them another machine may have.
const OF_ADDRESS_MAX: usize = 16;
/// The timeout of the TLS handshake.
const GREETING_MAX: Duration = Duration::from_secs(10);
/// The timeout of a request's head, after which an idle connection is closed, too.
const HEAD_MAX: Duration = Duration::from_secs(10);
/// The largest head.
const HEAD_LEN_MAX: usize = 16 << 10;
/// The pause after a connection could not be accepted.
const PAUSE: Duration = Duration::from_millis(100);
/// How long connections have to finish when the daemon stops.
const LINGER: Duration = Duration::from_millis(600);

/// The slot of a connection, released when it ends.
type Place = (Arc<Seat>, Option<OfAddress>);

/// Limits connections. At the limit, the connection is closed that has waited longest for its
/// client: slow or idle clients do not lock others out.
#[derive(Clone, Debug)]
pub(super) struct ConnectionLimit {
    places: Arc<Semaphore>,
    seats: Arc<Mutex<Seats>>,
}

/// The connections.
#[derive(Debug, Default)]
struct Seats {
    next: u64,
    taken: BTreeMap<u64, Taken>,
}

/// A connection.
#[derive(Debug)]
struct Taken {
    /// Since when its client has been waited for, to send a request or to receive an answer; none
    /// while the daemon is working for it.
    awaited: Option<Instant>,
    leave: Arc<Notify>,
}

impl ConnectionLimit {
    pub(super) fn new() -> ConnectionLimit {
        ConnectionLimit {
            places: Arc::new(Semaphore::new(CONNECTIONS_MAX)),
            seats: Arc::default(),
        }
    }

    fn seats(&self) -> MutexGuard<'_, Seats> {
        self.seats.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A slot, as soon as there is one. If there is none, another connection is closed.
    async fn place(&self) -> Option<Arc<Seat>> {
        let permit = loop {
            if self.places.available_permits() == 0 {
                self.close_longest_idle();
            }
            let place = Arc::clone(&self.places).acquire_owned();
            match tokio::time::timeout(PAUSE, place).await {
                Ok(place) => break place.ok()?,
                // Some connection may be waiting for its client by now.
                Err(_) => continue,
            }
        };
        let leave = Arc::new(Notify::new());
        let mut seats = self.seats();
        let number = seats.next;
        seats.next += 1;
        let taken = Taken {
            awaited: Some(Instant::now()),
            leave: Arc::clone(&leave),
        };
        seats.taken.insert(number, taken);
        drop(seats);
        Some(Arc::new(Seat {
            limit: self.clone(),
            number,
            leave,
            _permit: permit,
        }))
    }

    /// Closes the connection that has been waiting for its client for longest, if any.
    fn close_longest_idle(&self) {
        let mut seats = self.seats();
        let awaited = seats
            .taken
            .values_mut()
            .filter(|seat| seat.awaited.is_some());
        if let Some(longest) = awaited.min_by_key(|seat| seat.awaited) {
            longest.awaited = None;
            longest.leave.notify_one();
        }
    }

    /// Waits until all are closed, as long as they may take.
    pub(super) async fn emptied(&self) {
        let all = self.places.acquire_many(CONNECTIONS_MAX as u32);
        let _ = tokio::time::timeout(LINGER, all).await;
    }
}

/// A connection's slot.
#[derive(Debug)]
struct Seat {
    limit: ConnectionLimit,
    number: u64,
    /// The slot is needed for another connection.
    leave: Arc<Notify>,
    _permit: OwnedSemaphorePermit,
}

impl Seat {
    /// Notes whether it is the client's turn or the daemon's.
    fn awaits_client(&self, awaits: bool) {
        let now = awaits.then(Instant::now);
        if let Some(seat) = self.limit.seats().taken.get_mut(&self.number) {
            seat.awaited = now;
        }
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.limit.seats().taken.remove(&self.number);
    }
}

/// A request's body, during which the client is waited for.
struct Coming {
    body: Incoming,
    seat: Arc<Seat>,
}

impl Body for Coming {
    type Data = Bytes;
    type Error = hyper::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, hyper::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Coming {
    /// It is complete, or not wanted: from now on the daemon is working.
    fn drop(&mut self) {
        self.seat.awaits_client(false);
    }
}

/// A response's body. Between two parts the client is waited for, as it has to receive one before
/// the next is asked for; while a part is not ready yet, it is the daemon's turn.
struct Going {
    body: axum::body::Body,
    seat: Arc<Seat>,
}

impl Body for Going {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let part = Pin::new(&mut self.body).poll_frame(cx);
        self.seat.awaits_client(part.is_ready());
        part
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Going {
    fn drop(&mut self) {
        self.seat.awaits_client(true);
    }
}

/// Waits until the daemon stops.
pub(super) async fn ended(stop: &mut watch::Receiver<bool>) {
    // Fails if the sender is gone, which means the same.
    let _ = stop.wait_for(|stop| *stop).await;
}

/// How many connections each address has over TCP.
#[derive(Clone, Debug, Default)]
struct Addresses(Arc<Mutex<HashMap<IpAddr, usize>>>);

/// One connection of an address.
struct OfAddress(Addresses, IpAddr);

impl Addresses {
    /// A slot for one more; none if an address has as many as it may. This machine may use all of
    /// them: proxies connect from here.
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

/// Accepts clients over TCP until the daemon stops.
pub(super) async fn tcp(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    router: Router,
    limit: ConnectionLimit,
    mut stop: watch::Receiver<bool>,
) {
    let addresses = Addresses::default();
    loop {
        let accepted = tokio::select! {
            () = ended(&mut stop) => return,
            accepted = listener.accept() => accepted,
        };
        let Ok((stream, peer)) = accepted else {
            // A client's own error, or a lack of file handles, which takes time to pass.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let Some(of_address) = addresses.place(peer.ip()) else {
            continue;
        };
        let place = tokio::select! {
            () = ended(&mut stop) => return,
            place = limit.place() => place,
        };
        let Some(place) = place else {
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
        // Lets the new connection run before the next one is accepted.
        tokio::task::yield_now().await;
    }
}

/// Performs the TLS handshake, and serves the client then. One that is not done in time is closed.
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
    let greeted = tokio::select! {
        greeted = tokio::time::timeout(GREETING_MAX, acceptor.accept(stream)) => greeted,
        () = place.0.leave.notified() => return,
    };
    if let Ok(Ok(stream)) = greeted {
        serve(stream, peer, router, place, stop).await;
    }
}

/// Accepts clients over the socket until the daemon stops; then the socket is removed.
pub(super) async fn unix(
    socket: Socket,
    router: Router,
    limit: ConnectionLimit,
    mut stop: watch::Receiver<bool>,
) {
    loop {
        let accepted = tokio::select! {
            () = ended(&mut stop) => return,
            accepted = async { (socket.listener.accept().await, limit.place().await) } => accepted,
        };
        let (Ok((stream, _)), Some(place)) = accepted else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let place = (place, None);
        tokio::spawn(serve(stream, None, router.clone(), place, stop.clone()));
    }
}

/// Serves one connection. However it ends, only its client is affected.
async fn serve(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    peer: Option<Peer>,
    router: Router,
    place: Place,
    mut stop: watch::Receiver<bool>,
) {
    let router = TowerToHyperService::new(router);
    let seat = Arc::clone(&place.0);
    let from_peer = service_fn(move |mut request: Request<Incoming>| {
        if let Some(peer) = peer {
            request.extensions_mut().insert(peer);
        }
        let seat = Arc::clone(&seat);
        if request.body().is_end_stream() {
            seat.awaits_client(false);
        }
        let coming = Arc::clone(&seat);
        let answer = router.call(request.map(|body| Coming { body, seat: coming }));
        async move {
            let answer = answer.await;
            answer.map(|answer| answer.map(|body| Going { body, seat }))
        }
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
        () = place.0.leave.notified() => {}
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

    #[tokio::test(start_paused = true)]
    async fn who_is_awaited_longest_makes_room_and_who_is_served_stays() {
        let limit = ConnectionLimit::new();
        let mut seats = Vec::new();
        for _ in 0..CONNECTIONS_MAX {
            seats.push(limit.place().await.expect("a place"));
        }
        let leaves = |seat: &Arc<Seat>| Arc::clone(&seat.leave);
        // The first is being served, the second has waited longest, the third was active lately.
        seats[0].awaits_client(false);
        seats[2].awaits_client(true);
        let (first, second) = (leaves(&seats[0]), leaves(&seats[1]));
        let one_more = tokio::spawn({
            let limit = limit.clone();
            async move { limit.place().await }
        });
        second.notified().await;
        seats.remove(1);
        seats.push(one_more.await.expect("it ends").expect("a place"));
        for seat in &seats {
            seat.awaits_client(false);
        }
        let waits = tokio::time::timeout(10 * PAUSE, limit.place()).await;
        assert!(waits.is_err(), "all are served");
        let told = tokio::time::timeout(PAUSE, first.notified()).await;
        assert!(told.is_err(), "it stays");
        drop(seats);
        assert!(limit.seats().taken.is_empty());
        limit.emptied().await;
        assert!(limit.place().await.is_some());
    }

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
