//! The port: opened, lost and opened again; and the slave that answers there.

use super::settings;
use super::slave::{Output, Slave, UNDER_WAY_MAX};
use crate::northbound::modbus::request::{UnitWrite, WriteEnd};
use crate::northbound::modbus::site_units::SiteUnits;
use crate::northbound::outlet::Outlet;
use railbus_api::outlets::OutletState;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures::port_lost;
use railbus_host::{AnyPort, LineName, Medium, Port as _, PortError, SerialOptions};
use railbus_wire::{FRAME_MAX, Micros, SerialSettings};
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;
use std::sync::atomic::Ordering::Relaxed;
use std::task::Poll;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::{JoinHandle, LocalSet, spawn_local, yield_now};
use tokio::time::{Instant, sleep_until};

/// The longest wait before a port is tried again: 1, 2, 4, 8, … seconds.
const RETRY_MAX: Duration = Duration::from_secs(10);
/// How often the port is read before an answer; a master sends no more while it waits for one.
const READS_MAX: usize = 4;
/// Masters ask all the time; that it works is reported so often.
const WORKED_APART: Duration = Duration::from_secs(60);

/// Answers a master until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let local = LocalSet::new();
    local.run_until(serve(outlet)).await
}

/// Where the master is.
struct Place {
    port: LineName,
    serial: SerialSettings,
}

impl Place {
    fn of(outlet: &Outlet) -> Result<Place, Problem> {
        let settings = outlet.settings.borrow();
        let (port, serial) = (settings::port(&settings), settings::serial(&settings));
        match (port, serial) {
            (Some(port), Some(serial)) => Ok(Place { port, serial }),
            // Nothing else passes the check of a configuration.
            _ => Err(Problem::new(codes::INTERNAL).with("reason", "port")),
        }
    }

    fn closed(&self) -> AnyPort {
        let options = SerialOptions {
            settings: self.serial,
            ..SerialOptions::default()
        };
        AnyPort::new(&self.port, options)
    }
}

async fn serve(outlet: Outlet) -> Result<(), Problem> {
    let place = Place::of(&outlet)?;
    let (mut site, stopped) = (outlet.service.follow(), outlet.stopped());
    tokio::pin!(stopped);
    let (units, mut syncs) = SiteUnits::new(&outlet);
    let (ended, mut ends) = mpsc::channel(UNDER_WAY_MAX);
    let reply_within = outlet.number("reply_within_ms").unsigned_abs();
    let mut desk = Desk {
        slave: Slave::new(place.serial, Micros::from_millis(reply_within)),
        units: Rc::new(units),
        link: Link::Opening(opening(&place)),
        tries: 0,
        worked: None,
        began: Instant::now(),
        outlet,
        place,
        ended,
    };
    loop {
        let deadline = desk.drive().await;
        let due = async {
            match deadline {
                Some(at) => sleep_until(at).await,
                None => std::future::pending().await,
            }
        };
        let mut buffer = [0; FRAME_MAX];
        // In this order: values are those of now, and what was received comes before an answer
        // that it makes a wrong one.
        tokio::select! {
            biased;
            () = &mut stopped => return Ok(()),
            news = site.next() => match news {
                Some(news) => desk.units.take(&news),
                None => return Ok(()),
            },
            Some(done) = syncs.recv() => {
                while let Some(news) = site.next_now() {
                    desk.units.take(&news);
                }
                // Fails if nothing waits for it any more.
                let _ = done.send(());
            }
            happened = desk.link.next(&mut buffer) => desk.happened(happened, &buffer),
            Some((write, end)) = ends.recv() => desk.write_ended(&write, &end),
            () = due => {}
        }
    }
}

/// The port, whatever becomes of it.
enum Link {
    /// It is opened then.
    Closed(Instant),
    /// It is being opened, which may take long and is not to be cancelled in between.
    Opening(JoinHandle<Result<AnyPort, PortError>>),
    Open(AnyPort),
}

/// What happened to the port.
enum Happened {
    Due,
    Opened(AnyPort),
    Received(usize),
    Lost(PortError),
}

fn opening(place: &Place) -> JoinHandle<Result<AnyPort, PortError>> {
    let mut port = place.closed();
    spawn_local(async move {
        port.open().await?;
        Ok(port)
    })
}

impl Link {
    /// The next that happens. Nothing is lost where this is dropped.
    async fn next(&mut self, buffer: &mut [u8]) -> Happened {
        match self {
            Link::Closed(until) => {
                sleep_until(*until).await;
                Happened::Due
            }
            Link::Opening(opened) => match opened.await {
                Ok(Ok(port)) => Happened::Opened(port),
                Ok(Err(why)) => Happened::Lost(why),
                Err(_) => Happened::Lost(PortError::Io(0)),
            },
            Link::Open(port) => match port.read(buffer).await {
                Ok(count) => Happened::Received(count),
                Err(error) => Happened::Lost(PortError::of_loss(&error)),
            },
        }
    }
}

/// Everything of a run.
struct Desk {
    outlet: Outlet,
    place: Place,
    units: Rc<SiteUnits>,
    slave: Slave,
    link: Link,
    /// How many times in a row the port could not be used.
    tries: u32,
    /// When it was last reported that it works.
    worked: Option<Instant>,
    /// What the slave's time counts from.
    began: Instant,
    ended: mpsc::Sender<(UnitWrite, WriteEnd)>,
}

impl Desk {
    fn now(&self) -> railbus_wire::Instant {
        let micros = self.began.elapsed().as_micros();
        railbus_wire::Instant(u64::try_from(micros).unwrap_or(u64::MAX))
    }

    /// Does what the slave says; until when there is nothing more to do.
    async fn drive(&mut self) -> Option<Instant> {
        let deadline = loop {
            let (now, slave) = (self.now(), &mut self.slave);
            match self.units.with_units(|units| slave.poll(now, units)) {
                Output::Begin(write) => self.begin(write),
                Output::TakeIn => self.take_in().await,
                Output::Send(frame) => {
                    // Whoever is answered finds it counted.
                    self.count();
                    self.send(&frame);
                }
                Output::Wait(deadline) => break deadline,
            }
        };
        self.count();
        deadline.map(|at| self.began + Duration::from_micros(at.0))
    }

    fn count(&mut self) {
        let heard = std::mem::take(&mut self.slave.heard);
        let counts = self.outlet.report.counts();
        counts.sent.fetch_add(heard.good, Relaxed);
        counts.refused.fetch_add(heard.refused, Relaxed);
        counts.given_up.fetch_add(heard.unanswered, Relaxed);
        counts.dropped.fetch_add(heard.damaged, Relaxed);
        let is_told = self.worked.is_some_and(|at| at.elapsed() < WORKED_APART);
        let is_open = matches!(self.link, Link::Open(_));
        if heard.good > 0 && is_open && !is_told && self.units.are_all() {
            self.outlet.report.worked();
            self.worked = Some(Instant::now());
        }
    }

    /// Hands over what waits at the port. What the runtime knows of it may be from before this
    /// thread had to wait for the processor.
    async fn take_in(&mut self) {
        yield_now().await;
        for _ in 0..READS_MAX {
            let mut buffer = [0; FRAME_MAX];
            let happened = {
                let mut next = pin!(self.link.next(&mut buffer));
                poll_fn(|cx| Poll::Ready(next.as_mut().poll(cx))).await
            };
            match happened {
                Poll::Ready(happened) => self.happened(happened, &buffer),
                Poll::Pending => break,
            }
        }
        self.slave.is_up_to_date();
    }

    fn happened(&mut self, happened: Happened, buffer: &[u8]) {
        match happened {
            Happened::Due => self.link = Link::Opening(opening(&self.place)),
            Happened::Opened(port) => self.opened(port),
            Happened::Lost(why) => self.lost(&why),
            Happened::Received(count) => {
                let now = self.now();
                let received = buffer.get(..count).unwrap_or_default();
                self.slave.handle(now, received);
            }
        }
    }

    fn begin(&self, write: UnitWrite) {
        let (units, service) = (Rc::clone(&self.units), self.outlet.service.clone());
        let ended = self.ended.clone();
        spawn_local(async move {
            let end = units.carry_out(&service, &write).await;
            // Fails where the outlet stops.
            let _ = ended.send((write, end)).await;
        });
    }

    fn write_ended(&mut self, write: &UnitWrite, end: &WriteEnd) {
        let slave = &mut self.slave;
        self.units
            .with_units(|units| slave.ended(write, end, units));
    }

    fn send(&mut self, frame: &[u8]) {
        let Link::Open(port) = &mut self.link else {
            return;
        };
        if let Err(error) = port.send(frame, self.place.serial) {
            self.lost(&PortError::of_loss(&error));
        }
    }

    fn opened(&mut self, port: AnyPort) {
        self.slave.opened(port.medium() == Medium::Wire);
        self.link = Link::Open(port);
        match std::mem::take(&mut self.tries) {
            0 => self.outlet.report.ready(),
            _ => self.units.tell(),
        }
    }

    /// The port can't be used, and is tried again.
    fn lost(&mut self, why: &PortError) {
        let wait = Duration::from_secs(1 << self.tries.min(6)).min(RETRY_MAX);
        self.tries += 1;
        self.link = Link::Closed(Instant::now() + wait);
        self.slave.closed();
        let problem = port_lost(&self.place.port.to_string(), why);
        self.outlet.report.failed(problem, self.tries, Some(wait));
    }
}

/// Says how the port does. It is not opened a second time where the outlet runs.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let place = Place::of(&outlet)?;
    let found = outlet.look(|running| {
        let problem = running.error().map(|error| error.problem.clone());
        let counts = running.counts();
        let heard = [&counts.sent, &counts.refused, &counts.given_up];
        let heard: u64 = heard.map(|count| count.load(Relaxed)).iter().sum();
        let damaged = counts.dropped.load(Relaxed);
        (running.state(), problem, heard, damaged)
    });
    let (state, problem, heard, damaged) = found.unwrap_or((OutletState::Stopped, None, 0, 0));
    let Place { port, serial } = &place;
    match (state, problem) {
        (OutletState::Waiting, Some(problem)) => Err(problem),
        (OutletState::Running, _) => Ok(format!(
            "{port} is open, {serial}; requests: {heard}, damaged: {damaged} · 端口已打开，请求 {heard} 个，\
             损坏 {damaged} 个"
        )),
        (OutletState::Stopped, _) => match place.closed().open().await {
            Ok(()) => Ok(format!("{port} can be opened · 端口可以打开")),
            Err(why) => Err(port_lost(&port.to_string(), &why)),
        },
        // It will say itself how that ended.
        _ => Ok(format!("{port} is being opened · 正在打开端口")),
    }
}
