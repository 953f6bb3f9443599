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
type Place = (Arc<Seat>, Option<OfAddress>);

/// The room for connections. When it is full, the one leaves whose client has been awaited for the
/// longest time: who is slow, or has nothing to ask, keeps nobody out who has.
#[derive(Clone, Debug)]
pub(super) struct Room {
    places: Arc<Semaphore>,
    seats: Arc<Mutex<Seats>>,
}

/// Who is in a room.
#[derive(Debug, Default)]
struct Seats {
    next: u64,
    taken: BTreeMap<u64, Taken>,
}

/// A connection in its room.
#[derive(Debug)]
struct Taken {
    /// Since when its client is awaited, with a request or with the taking of an answer; none while
    /// the daemon is at work for it.
    awaited: Option<Instant>,
    leave: Arc<Notify>,
}

impl Room {
    pub(super) fn new() -> Room {
        Room {
            places: Arc::new(Semaphore::new(CONNECTIONS_MAX)),
            seats: Arc::default(),
        }
    }

    fn seats(&self) -> MutexGuard<'_, Seats> {
        self.seats.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place, as soon as there is one. Where there is none, somebody makes room.
    async fn place(&self) -> Option<Arc<Seat>> {
        let permit = loop {
            if self.places.available_permits() == 0 {
                self.make_room();
            }
            let place = Arc::clone(&self.places).acquire_owned();
            match tokio::time::timeout(PAUSE, place).await {
                Ok(place) => break place.ok()?,
                // By now somebody may be awaited.
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
            room: self.clone(),
            number,
            leave,
            _permit: permit,
        }))
    }

    /// Has the one leave whose client has been awaited longest, if any is.
    fn make_room(&self) {
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

    /// Waits until all have left, as long as they may take.
    pub(super) async fn emptied(&self) {
        let all = self.places.acquire_many(CONNECTIONS_MAX as u32);
        let _ = tokio::time::timeout(LINGER, all).await;
    }
}

/// A connection's place in a room.
#[derive(Debug)]
struct Seat {
    room: Room,
    number: u64,
    /// Another needs the place more.
    leave: Arc<Notify>,
    _permit: OwnedSemaphorePermit,
}

impl Seat {
    /// It is for the client to go on, or for the daemon.
    fn awaits_client(&self, awaits: bool) {
        let now = awaits.then(Instant::now);
        if let Some(seat) = self.room.seats().taken.get_mut(&self.number) {
            seat.awaited = now;
        }
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.room.seats().taken.remove(&self.number);
    }
}

/// A request's body, which the client is awaited with.
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
    /// It is whole, or not wanted: from now on the daemon is at work.
    fn drop(&mut self) {
        self.seat.awaits_client(false);
    }
}

/// An answer's body. Between two parts of it the client is awaited, who has to take the one before
/// the next is asked for; while a part is not there yet, it is the daemon's turn.
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
            accepted = listener.accept() => accepted,
        };
        let Ok((stream, peer)) = accepted else {
            // One client's own error, or a lack of file handles, which takes time to pass.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let Some(of_address) = addresses.place(peer.ip()) else {
            continue;
        };
        let place = tokio::select! {
            () = ended(&mut stop) => return,
            place = room.place() => place,
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
        // Who has just come is heard before the next one is let in.
        tokio::task::yield_now().await;
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
    let greeted = tokio::select! {
        greeted = tokio::time::timeout(GREETING_MAX, acceptor.accept(stream)) => greeted,
        () = place.0.leave.notified() => return,
    };
    if let Ok(Ok(stream)) = greeted {
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
            accepted = async { (socket.listener.accept().await, room.place().await) } => accepted,
        };
        let (Ok((stream, _)), Some(place)) = accepted else {
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
        let room = Room::new();
        let mut seats = Vec::new();
        for _ in 0..CONNECTIONS_MAX {
            seats.push(room.place().await.expect("a place"));
        }
        let leaves = |seat: &Arc<Seat>| Arc::clone(&seat.leave);
        // The first is served, the second awaited longest, the third heard from lately.
        seats[0].awaits_client(false);
        seats[2].awaits_client(true);
        let (first, second) = (leaves(&seats[0]), leaves(&seats[1]));
        let one_more = tokio::spawn({
            let room = room.clone();
            async move { room.place().await }
        });
        second.notified().await;
        seats.remove(1);
        seats.push(one_more.await.expect("it ends").expect("a place"));
        for seat in &seats {
            seat.awaits_client(false);
        }
        let waits = tokio::time::timeout(10 * PAUSE, room.place()).await;
        assert!(waits.is_err(), "all are served");
        let told = tokio::time::timeout(PAUSE, first.notified()).await;
        assert!(told.is_err(), "it stays");
        drop(seats);
        assert!(room.seats().taken.is_empty());
        room.emptied().await;
        assert!(room.place().await.is_some());
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
