//! Sockets: who may connect, and for how long.

use super::conn::{Answered, GATEWAY, ModbusConn, UnitWrite, Units, WriteEnd};
use super::image::UnitImage;
use super::{not_listening, settings};
use crate::northbound::outlet::{Outlet, Report};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures;
use railbus_host::{Fault, Presence};
use railbus_site::{Config, News, PointStatus, Service, Within, WriteTerms};
use railbus_wire::mbap::{self, Message};
use railbus_wire::rtu::Identification;
use railbus_wire::{Decoded, Micros};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, oneshot};
use tokio::task::{JoinSet, LocalSet};
use tokio::time::{Instant, sleep_until, timeout};

/// How many clients there may be, and how many at one address.
const CLIENTS_MAX: usize = 32;
const PER_ADDRESS_MAX: usize = 8;
/// A message has so long to become complete.
const PARTIAL_MAX: Duration = Duration::from_secs(10);
/// A client that says nothing for so long is gone.
const IDLE_MAX: Duration = Duration::from_secs(5 * 60);
/// A client that leaves so many bytes of answers unread is closed.
const UNREAD_MAX: usize = 64 * 1024;
/// How much is read at a time.
const READ_LEN: usize = 4 * 1024;
/// After an error of the system no connection is accepted for so long.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// How long a test waits.
const TEST_MAX: Duration = Duration::from_secs(3);

/// What all connections share, on the one thread of the outlet.
struct Shared {
    service: Service,
    site: Arc<str>,
    report: Report,
    state: RefCell<State>,
    /// To be told once everything that has happened by now is in the images.
    sync: mpsc::Sender<oneshot::Sender<()>>,
    within: Within,
}

struct State {
    /// The configuration of which the units are.
    config: Arc<Config>,
    images: BTreeMap<u8, UnitImage>,
}

/// Serves clients until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let local = LocalSet::new();
    local.run_until(serve(outlet)).await
}

async fn serve(outlet: Outlet) -> Result<(), Problem> {
    let listen = outlet.listen();
    let failed = |error: io::Error| not_listening(listen, error);
    let listener = TcpListener::bind(listen).await.map_err(failed)?;
    let keys = outlet.settings.borrow().clone();
    let allowed = settings::allowed(&keys);
    let is_uniform = settings::is_uniform(&keys);
    let (mut site, stopped) = (outlet.service.follow(), outlet.stopped());
    tokio::pin!(stopped);
    // One for each connection: it waits for its answer before it asks again.
    let (sync, mut syncs) = mpsc::channel(CLIENTS_MAX);
    let within = Micros::from_millis(outlet.number("within_ms").unsigned_abs());
    let shared = Rc::new(Shared {
        service: outlet.service.clone(),
        site: Arc::clone(&outlet.site),
        report: outlet.report.clone(),
        state: RefCell::new(State {
            config: outlet.service.config(),
            images: BTreeMap::new(),
        }),
        sync,
        within: Within::new(within).unwrap_or_default(),
    });
    let take = |news: News| shared.take(&keys, is_uniform, &news);
    let mut clients: JoinSet<IpAddr> = JoinSet::new();
    let mut at_address: BTreeMap<IpAddr, usize> = BTreeMap::new();
    outlet.report.ready();
    loop {
        tokio::select! {
            () = &mut stopped => return Ok(()),
            news = site.next() => match news {
                Some(news) => take(news)?,
                None => return Ok(()),
            },
            Some(done) = syncs.recv() => {
                while let Some(news) = site.next_now() {
                    take(news)?;
                }
                // Fails if the connection has gone.
                let _ = done.send(());
            }
            Some(gone) = clients.join_next() => if let Ok(address) = gone
                && let Some(count) = at_address.get_mut(&address)
            {
                *count = count.saturating_sub(1);
                if *count == 0 {
                    at_address.remove(&address);
                }
            },
            accepted = listener.accept() => match accepted {
                Ok((stream, from)) => {
                    let from = from.ip().to_canonical();
                    let here = at_address.get(&from).copied().unwrap_or_default();
                    let may = from.is_loopback() || allowed.iter().any(|net| net.contains(from));
                    let fits = clients.len() < CLIENTS_MAX && here < PER_ADDRESS_MAX;
                    if may && fits {
                        at_address.insert(from, here + 1);
                        let service = outlet.service_for(from);
                        clients.spawn_local(client(Rc::clone(&shared), service, stream, from));
                    } else {
                        shared.report.counts().dropped.fetch_add(1, Relaxed);
                    }
                }
                // The client was gone already, or there are too many open files.
                Err(_) => tokio::time::sleep(ACCEPT_PAUSE).await,
            },
        }
    }
}

impl Shared {
    /// Takes over what happened at the site.
    fn take(
        &self,
        keys: &railbus_site::config::change::Keys,
        is_uniform: bool,
        news: &News,
    ) -> Result<(), Problem> {
        let state = &mut *self.state.borrow_mut();
        match news {
            News::Picture(picture) => {
                let config = self.service.config();
                // Refused with the configuration, so that it is never so.
                let units = settings::units(keys, &config);
                let units = units.map_err(|_| Problem::new(codes::OUTLET_ENDED))?;
                let images = units.into_iter().filter_map(|(unit, name)| {
                    let setup = config.modules.get(&name)?.setup;
                    let mut image = UnitImage::new(&name, setup, is_uniform);
                    let before = state.images.get(&unit);
                    if let Some(before) = before.filter(|before| before.module == image.module) {
                        image.last = before.last;
                    }
                    Some((unit, image))
                });
                state.images = images.collect();
                state.config = config;
                apply(&mut state.images, picture.points.iter());
            }
            News::Batch(batch) => {
                let points = batch.points.iter().map(|reading| &reading.status);
                apply(&mut state.images, points);
            }
        }
        Ok(())
    }

    /// Answers what a connection received.
    fn with_units<T>(&self, work: impl FnOnce(&mut Units<'_>) -> T) -> T {
        let look = |module: &str| look(&self.service, module);
        let state = &mut *self.state.borrow_mut();
        work(&mut Units {
            images: &mut state.images,
            look: &look,
            site: &self.site,
        })
    }

    /// Carries a write out. When this returns, its effect is in the images.
    async fn carry_out(
        &self,
        service: &Service,
        asked_by: &Arc<Config>,
        write: &UnitWrite,
    ) -> WriteEnd {
        // By another configuration the unit may be another module.
        let is_current = Arc::ptr_eq(asked_by, &service.config());
        let terms = WriteTerms {
            within: self.within,
            ..WriteTerms::default()
        };
        let end = match is_current {
            true => service.write(&write.module, &write.set, terms).await,
            false => Err(Fault::Expired.into()),
        };
        let (done, synced) = oneshot::channel();
        if self.sync.send(done).await.is_ok() {
            // Fails if the outlet stops.
            let _ = synced.await;
        }
        match end {
            Ok(done) => Ok(done.confirmed),
            Err(failure) => {
                let point = write.set.first().map(|(point, _)| *point);
                let problem = failures::problem(service, &write.module, point, &failure);
                let digits = problem.code.trim_start_matches('E').parse();
                Err((failure, digits.unwrap_or_default()))
            }
        }
    }

    fn count(&self, answered: Answered) {
        let counts = self.report.counts();
        counts.sent.fetch_add(answered.good, Relaxed);
        counts.refused.fetch_add(answered.refused, Relaxed);
    }
}

fn apply<'p>(images: &mut BTreeMap<u8, UnitImage>, points: impl Iterator<Item = &'p PointStatus>) {
    for point in points {
        let mut units = images.values_mut();
        if let Some(unit) = units.find(|unit| *unit.module == *point.module) {
            unit.apply(point);
        }
    }
}

/// Age, presence and round trip of a module, as they stand in its registers.
fn look(service: &Service, module: &str) -> [u16; 3] {
    let (_, points) = service.points_now(module);
    let ages: Option<Vec<Micros>> = points.iter().map(|point| point.age).collect();
    let oldest = ages.and_then(|ages| ages.into_iter().max());
    let tenths = oldest.and_then(|age| u16::try_from(age.0 / 100_000).ok());
    let status = service.module(module);
    let presence = match status.as_ref().map(|status| status.presence) {
        None | Some(Presence::Unheard) => 0,
        Some(Presence::Online) => 1,
        Some(Presence::Silent) => 2,
        Some(Presence::OtherModel) => 3,
    };
    let rtt = status.and_then(|status| status.rtt);
    let rtt = rtt.map_or(0, |rtt| u16::try_from(rtt.0 / 1_000).unwrap_or(u16::MAX));
    [tenths.unwrap_or(u16::MAX), presence, rtt]
}

/// Serves one client until it goes, or is to go; its address.
async fn client(shared: Rc<Shared>, service: Service, stream: TcpStream, from: IpAddr) -> IpAddr {
    // Only makes answers later.
    let _ = stream.set_nodelay(true);
    shared.report.worked();
    let mut client = Client {
        shared,
        service,
        stream,
        conn: ModbusConn::default(),
        writes: JoinSet::new(),
        heard: Instant::now(),
    };
    // It is closed for whatever reason.
    let _ = client.serve().await;
    from
}

struct Client {
    shared: Rc<Shared>,
    /// The site, in the name of this client.
    service: Service,
    stream: TcpStream,
    conn: ModbusConn,
    writes: JoinSet<(UnitWrite, WriteEnd)>,
    /// When it last sent something that made sense.
    heard: Instant,
}

impl Client {
    /// An error where it is to be closed.
    async fn serve(&mut self) -> io::Result<()> {
        let until = sleep_until(self.heard + IDLE_MAX);
        tokio::pin!(until);
        self.conn.received.reserve(READ_LEN);
        loop {
            tokio::select! {
                read = self.stream.readable() => {
                    read?;
                    match self.read() {
                        Ok(()) => {}
                        Err(error) if error.kind() == io::ErrorKind::WouldBlock => continue,
                        Err(error) => return Err(error),
                    }
                    if self.conn.is_partial() {
                        // Its last message has until then, unless more comes.
                        until.as_mut().reset(self.heard + PARTIAL_MAX);
                    }
                }
                Some(ended) = self.writes.join_next(), if !self.writes.is_empty() => {
                    // Fails where it has panicked, which is the end of the connection.
                    let (write, end) = ended.map_err(io::Error::other)?;
                    let conn = &mut self.conn;
                    self.shared.with_units(|units| conn.ended(&write, &end, units));
                    self.begin_writes();
                    self.write()?;
                }
                written = self.stream.writable(), if !self.conn.out.is_empty() => {
                    written?;
                    self.write()?;
                }
                () = &mut until => {
                    let limit = match self.conn.is_partial() {
                        true => PARTIAL_MAX,
                        false => IDLE_MAX,
                    };
                    // It is set back only here: a request costs no timer.
                    let end = self.heard + limit;
                    if end <= Instant::now() {
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                    until.as_mut().reset(end);
                }
            }
        }
    }

    /// Reads what is there, and answers it.
    fn read(&mut self) -> io::Result<()> {
        self.conn.received.reserve(READ_LEN);
        let was_partial = self.conn.is_partial();
        let len = self.stream.try_read_buf(&mut self.conn.received)?;
        if len == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let conn = &mut self.conn;
        let end = self.shared.with_units(|units| conn.answer(units));
        // A message that comes byte by byte has no longer for that.
        if !was_partial || end.is_ok_and(|requests| requests > 0) {
            self.heard = Instant::now();
        }
        self.begin_writes();
        self.write()?;
        end.map(drop).map_err(|_| io::ErrorKind::InvalidData.into())
    }

    /// Begins the writes that were asked for.
    fn begin_writes(&mut self) {
        while let Some(write) = self.conn.writes.pop_front() {
            let (shared, service) = (Rc::clone(&self.shared), self.service.clone());
            let asked_by = Arc::clone(&shared.state.borrow().config);
            let carry_out = async move {
                let end = shared.carry_out(&service, &asked_by, &write).await;
                (write, end)
            };
            self.writes.spawn_local(carry_out);
        }
    }

    /// Sends what the client takes by now.
    fn write(&mut self) -> io::Result<()> {
        self.shared.count(std::mem::take(&mut self.conn.answered));
        while !self.conn.out.is_empty() {
            match self.stream.try_write(&self.conn.out) {
                Ok(count) => _ = self.conn.out.drain(..count),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        match self.conn.out.len() > UNREAD_MAX {
            true => Err(io::ErrorKind::TimedOut.into()),
            false => Ok(()),
        }
    }
}

/// Asks the gateway what it is, as any client does.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let mut listen = outlet.listen();
    if listen.ip().is_unspecified() {
        listen.set_ip(match listen {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    let said = timeout(TEST_MAX, identified(listen)).await;
    let said = said.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
    said.map_err(|error| not_listening(listen, error))
}

async fn identified(listen: SocketAddr) -> io::Result<String> {
    let [_, gateway] = GATEWAY;
    let mut stream = TcpStream::connect(listen).await?;
    let pdu = [gateway, 0x2B, 0x0E, 2, 0];
    let request = [&mbap::header(1, pdu.len())[..], &pdu].concat();
    stream.write_all(&request).await?;
    let mut received = Vec::new();
    loop {
        match Message::decode(&received) {
            Decoded::Whole { value, .. } => {
                let said = value.pdu.get(2..).and_then(Identification::from_packed);
                let said = said.ok_or(io::ErrorKind::InvalidData)?;
                let texts: Vec<_> = said
                    .objects()
                    .map(|(_, text)| String::from_utf8_lossy(text))
                    .collect();
                return Ok(texts.join(" "));
            }
            Decoded::Malformed(_) => return Err(io::ErrorKind::InvalidData.into()),
            Decoded::Partial { .. } => {}
        }
        if stream.read_buf(&mut received).await? == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
    }
}
