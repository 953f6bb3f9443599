//! The gateway over sockets: the line, the site and the clients on the outlet's one thread.

use super::LISTEN;
use super::passage::{ClientId, ClientWrite, LineRead, Output, Passage, ReadEnd, Site};
use super::socket::Socket;
use super::verdict::{module_at, of_failure};
use crate::northbound::clients::{self, Clients};
use crate::northbound::modbus::identify;
use crate::northbound::network::{self, allowed};
use crate::northbound::outlet::{Outlet, Report};
use railbus_api::problem::Problem;
use railbus_host::{Fault, LineState, Presence, Probed};
use railbus_site::{CommandError, RawTerms, Service, WriteTerms};
use railbus_wire::mbap::Message;
use railbus_wire::rtu::Exception;
use railbus_wire::{Decoded, Micros};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::task::{LocalSet, spawn_local};
use tokio::time::{Instant, sleep_until, timeout};

/// A read that was not sent by then is taken back: the line has no time for it.
const READ_TTL: Duration = Duration::from_secs(5);

/// What all tasks share.
struct Shared {
    service: Service,
    report: Report,
    /// The line, by name.
    line: String,
    began: Instant,
    passage: RefCell<Passage>,
    clients: RefCell<BTreeMap<ClientId, Handle>>,
    /// The deadline of the passage may have changed.
    rearm: Notify,
}

/// A client, for the tasks of others.
struct Handle {
    /// The site, in its name.
    service: Service,
    /// There are answers for it.
    answered: Rc<Notify>,
}

/// Serves clients until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let local = LocalSet::new();
    local.run_until(serve(outlet)).await
}

async fn serve(outlet: Outlet) -> Result<(), Problem> {
    let listen = outlet_listen(&outlet);
    let allowed = allowed(&outlet.settings.borrow());
    let mut clients = Clients::listen(listen, allowed, false, &outlet.report).await?;
    let (stopped, line) = (outlet.stopped(), outlet.text("line"));
    tokio::pin!(stopped);
    let shared = Rc::new(Shared {
        service: outlet.service.clone(),
        report: outlet.report.clone(),
        passage: RefCell::new(Passage::new(&line)),
        line,
        began: Instant::now(),
        clients: RefCell::default(),
        rearm: Notify::new(),
    });
    let mut count = 0;
    outlet.report.ready();
    loop {
        let deadline = shared.passage.borrow().deadline();
        let due = async {
            match deadline {
                Some(at) => sleep_until(shared.began + at).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            () = &mut stopped => return Ok(()),
            () = shared.rearm.notified() => {}
            () = due => shared.drive(|_, _, _| {}),
            (stream, from) = clients.next() => {
                count += 1;
                let service = outlet.service_for(from);
                let client = client(Rc::clone(&shared), ClientId(count), service, stream);
                clients.serve(from, client);
            }
        }
    }
}

impl Shared {
    /// Changes the passage, and does what it says.
    fn drive(self: &Rc<Self>, change: impl FnOnce(&mut Passage, Duration, &Site<'_>)) {
        let config = self.service.config();
        let line = self.service.line(&self.line);
        let is_up = line.is_some_and(|line| line.state == LineState::Up);
        let is_online = |module: &str| {
            if !is_up {
                return None;
            }
            let status = self.service.module(module);
            match status?.presence {
                Presence::Online => Some(true),
                Presence::Silent => Some(false),
                Presence::Unheard | Presence::OtherModel => None,
            }
        };
        let site = Site {
            config: &config,
            is_up,
            is_online: &is_online,
        };
        let passage = &mut *self.passage.borrow_mut();
        let (now, before) = (self.began.elapsed(), passage.deadline());
        change(passage, now, &site);
        while let Some(output) = passage.poll(now, &site) {
            match output {
                Output::Read(read) => drop(spawn_local(Rc::clone(self).read(read))),
                Output::Write(write) => drop(spawn_local(Rc::clone(self).write(write))),
                Output::Answered(client) => {
                    if let Some(handle) = self.clients.borrow().get(&client) {
                        handle.answered.notify_one();
                    }
                }
            }
        }
        if passage.deadline() != before {
            self.rearm.notify_one();
        }
        let counts = self.report.counts();
        let answered = std::mem::take(&mut passage.answered);
        counts.sent.fetch_add(answered.good, Relaxed);
        counts.refused.fetch_add(answered.refused, Relaxed);
    }

    /// Sends a read to the line.
    async fn read(self: Rc<Self>, read: LineRead) {
        let config = self.service.config();
        let setup = module_at(&config, &self.line, read.unit).map(|(_, setup)| setup);
        let terms = RawTerms {
            // Those of the line, and the silence that the slowest wants, where nothing is known.
            settings: setup.map(|setup| setup.serial),
            gap: setup.map(|setup| setup.request_gap()),
            timeout: Some(read.timeout),
            clear: false,
        };
        let met = self
            .service
            .read_for_master(&self.line, read.exchange, terms);
        let met = timeout(READ_TTL, met).await;
        let late = met.iter().flatten().flat_map(|met| &met.late);
        let late = late.filter(|late| !late.again);
        let late: Vec<(u8, Micros)> = late
            .map(|late| (late.exchange.address().0, late.after))
            .collect();
        let end = match met {
            Ok(Ok(met)) => match met.outcome {
                // Another module could take it for a command.
                Probed::Unsafe => ReadEnd::NotAsked(Exception::FUNCTION),
                Probed::Answered | Probed::Garbled | Probed::Silent => {
                    // Without address and CRC.
                    let pdu = met.reply(&read.exchange).and_then(|reply| {
                        let end = reply.len().checked_sub(2)?;
                        reply.get(1..end)
                    });
                    pdu.map_or(ReadEnd::Silent, |pdu| {
                        ReadEnd::Answered(pdu.to_vec(), met.after)
                    })
                }
            },
            Ok(Err(failure)) => ReadEnd::NotAsked(not_read(&failure)),
            Err(_) => ReadEnd::NotAsked(Exception::BUSY),
        };
        self.drive(|passage, now, _| {
            for (unit, after) in late {
                passage.answered_late(unit, after);
            }
            passage.read_ended(now, &end);
        });
    }

    /// Gives a command to the site.
    async fn write(self: Rc<Self>, write: ClientWrite) {
        let service = self
            .clients
            .borrow()
            .get(&write.client)
            .map(|handle| handle.service.clone());
        // It has gone in the same step in which it asked.
        let service = service.unwrap_or_else(|| self.service.clone());
        let wanted = &write.write;
        let terms = WriteTerms::default();
        let end = service.write_since(&wanted.asked_by, &wanted.module, &wanted.set, terms);
        let end = end.await.map(drop);
        self.drive(|passage, _, _| passage.write_ended(&write, end.as_ref().copied()));
    }
}

/// The exception for a read that the line did not carry out.
fn not_read(failure: &CommandError) -> Exception {
    match failure {
        // The port was lost, or is not there: a read has no effect that could be unknown.
        CommandError::NoSuchLine | CommandError::Line(Fault::Unknown) => Exception::PATH,
        failure => of_failure(failure),
    }
}

/// Serves one client until it goes, or is to go.
async fn client(shared: Rc<Shared>, id: ClientId, service: Service, stream: TcpStream) {
    let answered = Rc::new(Notify::new());
    let handle = Handle {
        service,
        answered: Rc::clone(&answered),
    };
    shared.clients.borrow_mut().insert(id, handle);
    shared.passage.borrow_mut().came(id);
    let _leaves = Leaves(Rc::clone(&shared), id);
    shared.report.worked();
    let mut socket = Socket::new(stream);
    // It is closed for whatever reason.
    let _ = converse(&shared, id, &mut socket, &answered).await;
}

/// A client goes when this is dropped.
struct Leaves(Rc<Shared>, ClientId);

impl Drop for Leaves {
    fn drop(&mut self) {
        self.0.clients.borrow_mut().remove(&self.1);
        self.0.passage.borrow_mut().gone(self.1);
    }
}

async fn converse(
    shared: &Rc<Shared>,
    id: ClientId,
    socket: &mut Socket,
    answered: &Notify,
) -> io::Result<()> {
    loop {
        let received = tokio::select! {
            () = answered.notified() => false,
            next = socket.next() => next.map(|()| true)?,
        };
        let end = match received {
            true => take(shared, id, socket),
            false => Ok(()),
        };
        let answers = shared.passage.borrow_mut().take_answers(id);
        socket.send(&answers)?;
        end?;
    }
}

/// Takes what a client sent, as far as it is complete.
fn take(shared: &Rc<Shared>, id: ClientId, socket: &mut Socket) -> io::Result<()> {
    let received = std::mem::take(&mut socket.received);
    let mut rest = &received[..];
    let mut end = Ok(());
    shared.drive(|passage, _, site| {
        loop {
            match Message::decode(rest) {
                Decoded::Whole { len, value } => {
                    passage.request(id, &value, site);
                    rest = rest.get(len..).unwrap_or_default();
                }
                Decoded::Partial { .. } => break,
                // Nothing says where the next message begins [MODBUS §5.2].
                Decoded::Malformed(_) => {
                    end = Err(io::ErrorKind::InvalidData.into());
                    break;
                }
            }
        }
    });
    if rest.len() < received.len() {
        socket.made_sense();
    }
    socket.received = rest.to_vec();
    end
}

/// Where it listens.
fn outlet_listen(outlet: &Outlet) -> SocketAddr {
    let listen = network::listen(&outlet.settings.borrow(), LISTEN);
    // Nothing else passes the check of a configuration.
    listen.unwrap_or(LISTEN)
}

/// Asks the gateway what it is, as any client does.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    clients::reached(outlet_listen(&outlet), identify::identified).await
}
