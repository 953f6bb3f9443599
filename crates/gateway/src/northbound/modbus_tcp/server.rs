//! Sockets: who may connect, and for how long.

use super::conn::{self, AskedWrite, ModbusConn};
use super::security::Security;
use super::stream::Answers;
use crate::northbound::clients::{self, Clients};
use crate::northbound::modbus::identify;
use crate::northbound::modbus::request::WriteEnd;
use crate::northbound::modbus::site_units::SiteUnits;
use crate::northbound::network;
use crate::northbound::outlet::Outlet;
use railbus_api::problem::Problem;
use railbus_site::Service;
use std::cell::Cell;
use std::io;
use std::net::IpAddr;
use std::rc::Rc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt as _, split};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::task::{LocalSet, spawn_local, yield_now};
use tokio::time::{Instant, sleep_until};

/// A message has so long to become complete, and a client to take what it was answered.
const PARTIAL_MAX: Duration = Duration::from_secs(10);
/// A client that says nothing for so long is gone.
const IDLE_MAX: Duration = Duration::from_secs(5 * 60);
/// A client that leaves so many bytes of answers unread is not read any more.
const UNREAD_MAX: usize = 64 * 1024;
/// How much is read at a time, and how often before others have their turn.
const READ_LEN: usize = 4 * 1024;
const READS_MAX: usize = 4;

/// Serves clients until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let local = LocalSet::new();
    local.run_until(serve(outlet)).await
}

/// What clients come through.
struct Door {
    outlet: Outlet,
    units: Rc<SiteUnits>,
    /// Without it they need not show who they are.
    security: Option<Security>,
    /// How many were not let in, or not with the role that they show.
    turned_away: Cell<u32>,
}

async fn serve(outlet: Outlet) -> Result<(), Problem> {
    let security = Security::open(&outlet.settings.borrow())?;
    let listen = outlet.listen();
    let allowed = network::allowed(&outlet.settings.borrow());
    let mut clients = Clients::listen(listen, allowed, security.is_some(), &outlet.report).await?;
    let (mut site, stopped) = (outlet.service.follow(), outlet.stopped());
    tokio::pin!(stopped);
    let (units, mut syncs) = SiteUnits::new(&outlet);
    let units = Rc::new(units);
    let door = Rc::new(Door {
        outlet,
        units: Rc::clone(&units),
        security,
        turned_away: Cell::new(0),
    });
    let outlet = &door.outlet;
    outlet.report.ready();
    loop {
        // In this order: however many requests come, values are those of now, and it stops.
        tokio::select! {
            biased;
            () = &mut stopped => return Ok(()),
            news = site.next() => match news {
                Some(news) => units.take(&news),
                None => return Ok(()),
            },
            Some(done) = syncs.recv() => {
                while let Some(news) = site.next_now() {
                    units.take(&news);
                }
                // Fails if the connection has gone.
                let _ = done.send(());
            }
            (stream, from) = clients.next() => {
                clients.serve(from, admit(Rc::clone(&door), from, stream));
            }
        }
    }
}

/// Serves one client as what it is, until it goes, or is to go.
async fn admit(door: Rc<Door>, from: IpAddr, stream: TcpStream) {
    // Only makes answers later.
    let _ = stream.set_nodelay(true);
    let units = Rc::clone(&door.units);
    let Some(security) = &door.security else {
        let service = door.outlet.service_for(from);
        return client(units, service, stream.into_split()).await;
    };
    match security.admit(stream, from).await {
        Ok((stream, peer)) => {
            let service = door.outlet.service_as(from, &peer.who, &peer.points);
            if let Some(flaw) = peer.flaw {
                door.note(flaw);
            }
            client(units, service, split(stream)).await;
        }
        Err(why) => {
            if let Some(why) = why {
                door.outlet.report.counts().dropped.fetch_add(1, Relaxed);
                door.note(why);
            }
        }
    }
}

impl Door {
    /// The last one who was turned away is to be seen. There is no event: anybody could make many.
    fn note(&self, why: Problem) {
        let count = self.turned_away.get().saturating_add(1);
        self.turned_away.set(count);
        self.outlet.report.noted(why, count);
    }
}

/// Serves one client until it goes, or is to go.
async fn client<R: AsyncRead + Unpin, W: Answers>(
    units: Rc<SiteUnits>,
    service: Service,
    (from, to): (R, W),
) {
    if units.are_all() {
        units.report.worked();
    }
    // No more can be under way than wait.
    let (ended, ends) = mpsc::channel(conn::WAITING_MAX);
    let mut client = Client {
        units,
        service,
        from,
        to,
        conn: ModbusConn::default(),
        ended,
        ends,
        heard: Instant::now(),
        unsent: None,
    };
    // It is closed for whatever reason.
    let _ = client.serve().await;
    client.to.close();
}

struct Client<R, W> {
    units: Rc<SiteUnits>,
    /// The site, in the name of this client.
    service: Service,
    from: R,
    to: W,
    conn: ModbusConn,
    /// Writes that have ended. They go on where the client has gone.
    ended: mpsc::Sender<(AskedWrite, WriteEnd)>,
    ends: mpsc::Receiver<(AskedWrite, WriteEnd)>,
    /// When it last sent something that made sense.
    heard: Instant,
    /// Since when it has taken nothing of what it was answered; none where it has all.
    unsent: Option<Instant>,
}

impl<R: AsyncRead + Unpin, W: Answers> Client<R, W> {
    /// An error where it is to be closed.
    async fn serve(&mut self) -> io::Result<()> {
        let until = sleep_until(self.closes_at());
        tokio::pin!(until);
        let mut reads = 0;
        loop {
            self.conn.received.reserve(READ_LEN);
            let was_partial = self.conn.is_partial();
            let (is_read, is_unsent) = (self.conn.out.len() <= UNREAD_MAX, self.unsent.is_some());
            tokio::select! {
                () = &mut until => {
                    // It is set back only here: a request costs no timer.
                    let end = self.closes_at();
                    if end <= Instant::now() {
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                    until.as_mut().reset(end);
                }
                Some((write, end)) = self.ends.recv() => {
                    let conn = &mut self.conn;
                    self.units.with_units(|units| conn.ended(&write, &end, units));
                    self.begin_writes();
                    self.write()?;
                }
                written = self.to.writable(), if is_unsent => {
                    written?;
                    self.write()?;
                }
                // After a short read tokio waits for the socket instead of trying again.
                read = self.from.read_buf(&mut self.conn.received), if is_read => {
                    let len = read?;
                    if len == 0 {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                    self.answer(was_partial)?;
                    reads = if len < READ_LEN { 0 } else { reads + 1 };
                }
            }
            if self.conn.is_partial() || self.unsent.is_some() {
                // Earlier than it was set to, perhaps.
                until.as_mut().reset(self.closes_at());
            }
            if reads >= READS_MAX {
                // The next read would not wait.
                reads = 0;
                yield_now().await;
            }
        }
    }

    /// When it is closed if nothing happens.
    fn closes_at(&self) -> Instant {
        // It is not read while it does not take what it was answered.
        let is_partial = self.conn.is_partial() && self.conn.out.len() <= UNREAD_MAX;
        let heard = match is_partial {
            true => self.heard + PARTIAL_MAX,
            false => self.heard + IDLE_MAX,
        };
        self.unsent
            .map_or(heard, |since| heard.min(since + PARTIAL_MAX))
    }

    /// Answers what was read.
    fn answer(&mut self, was_partial: bool) -> io::Result<()> {
        let conn = &mut self.conn;
        let end = self.units.with_units(|units| conn.answer(units));
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
            let (units, service) = (Rc::clone(&self.units), self.service.clone());
            let ended = self.ended.clone();
            spawn_local(async move {
                let end = units.carry_out(&service, &write.write).await;
                // Fails where the client has gone.
                let _ = ended.send((write, end)).await;
            });
        }
    }

    /// Sends what the client takes by now.
    fn write(&mut self) -> io::Result<()> {
        let answered = std::mem::take(&mut self.conn.answered);
        let counts = self.units.report.counts();
        counts.sent.fetch_add(answered.good, Relaxed);
        counts.refused.fetch_add(answered.refused, Relaxed);
        let was_full = self.conn.out.len() > UNREAD_MAX;
        while !self.conn.out.is_empty() {
            match self.to.try_write(&self.conn.out) {
                Ok(count) => {
                    self.conn.out.drain(..count);
                    self.unsent = None;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    self.unsent.get_or_insert_with(Instant::now);
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        match (self.to.is_sent()?, self.conn.out.is_empty()) {
            (false, _) => {
                self.unsent.get_or_insert_with(Instant::now);
            }
            (true, true) => self.unsent = None,
            (true, false) => {}
        }
        if was_full && self.conn.out.len() <= UNREAD_MAX {
            // It is read again from now on.
            self.heard = Instant::now();
        }
        Ok(())
    }
}

/// Asks the gateway what it is, as any client does. Over TLS it would need the certificate of a
/// client: then it only connects, and tells until when certificates are valid.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let security = Security::open(&outlet.settings.borrow())?;
    let listen = outlet.listen();
    match security {
        None => clients::reached(listen, identify::identified).await,
        Some(security) => {
            clients::reached(listen, async |at| {
                // Leaves without a word, which nobody counts.
                TcpStream::connect(at).await?;
                Ok(security.told().to_owned())
            })
            .await
        }
    }
}
