//! Accepts connections for the server, and reports clients whose certificates are not trusted.

use super::plain::ClientChannel;
use super::relay::relay;
use super::settings;
use super::users::OutletUsers;
use crate::northbound::clients::{self, Clients, plain};
use crate::northbound::kind::texts;
use crate::northbound::network;
use crate::northbound::outlet::Outlet;
use railbus_api::problem::{Problem, codes};
use railbus_opcua::{OpcuaEnd, OpcuaError, OpcuaServer, OpcuaSetup, TurnedAway};
use railbus_wire::Micros;
use std::cell::Cell;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::pin::pin;
use std::rc::Rc;
use std::sync::Arc;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::task::LocalSet;

/// The setting that lets everybody read.
const ANONYMOUS: &str = "anonymous";
/// After so many bytes of a client it is looked at what it has left behind.
const LOOK_EVERY: usize = 64 * 1024;
/// The longest message that a test takes as an answer.
const ANSWER_MAX: usize = 1_024;

/// Serves clients until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let local = LocalSet::new();
    local.run_until(serve(outlet)).await
}

/// What clients come through.
struct Door {
    outlet: Outlet,
    /// Where the server takes them.
    server: SocketAddr,
    turned_away: TurnedAway,
    /// Only programs on this machine can connect.
    is_for_here: bool,
    /// How many came whose certificates are not trusted.
    count: Cell<u32>,
}

/// Why the server of the moment ends.
enum Ended {
    Stopped,
    /// An account with a session was locked, removed or changed, or too many monitored items were
    /// created.
    Anew,
}

async fn serve(outlet: Outlet) -> Result<(), Problem> {
    let mut outlet = outlet;
    loop {
        let end;
        (outlet, end) = serve_once(outlet).await?;
        match end {
            Ended::Stopped => return Ok(()),
            // The others connect again.
            Ended::Anew => {}
        }
    }
}

/// Serves with one server, which ends all connections at its end.
async fn serve_once(outlet: Outlet) -> Result<(Outlet, Ended), Problem> {
    let listen = settings::listen(&outlet.settings.borrow());
    let allowed = network::allowed(&outlet.settings.borrow());
    let mut stopped = pin!(outlet.stopped());
    let mut clients = Clients::listen(listen, allowed, true, &outlet.report).await?;
    let users = Arc::new(OutletUsers::new(
        &outlet.accounts,
        &outlet.service,
        &outlet.service.origin().who,
        outlet.flag(ANONYMOUS),
    ));
    let setup = setup(&outlet, listen);
    let server = OpcuaServer::open(setup, Arc::clone(&users) as _).await;
    let server = server.map_err(|error| unusable(&outlet, error))?;
    let inner = server
        .address()
        .map_err(|error| broken(error.to_string()))?;
    let door = Rc::new(Door {
        server: inner,
        turned_away: server.turned_away(),
        is_for_here: listen.ip().is_loopback(),
        count: Cell::new(0),
        outlet,
    });
    let report = &door.outlet.report;
    let end = {
        let mut running = pin!(server.run());
        let mut revoked = pin!(users.revoked());
        report.ready();
        loop {
            tokio::select! {
                biased;
                () = &mut stopped => break Ended::Stopped,
                () = &mut revoked => break Ended::Anew,
                end = &mut running => match end {
                    Ok(OpcuaEnd::SiteGone) => break Ended::Stopped,
                    Ok(OpcuaEnd::Worn) => break Ended::Anew,
                    Err(reason) => return Err(broken(reason)),
                },
                (stream, from) = clients.next() => {
                    clients.serve(from, admit(Rc::clone(&door), stream));
                }
            }
        }
    };
    // Its clients' tasks, which have the door, end with this.
    drop(clients);
    tokio::task::yield_now().await;
    match Rc::try_unwrap(door) {
        Ok(door) => Ok((door.outlet, end)),
        Err(_) => Err(broken("a connection goes on".to_owned())),
    }
}

/// Relays one client until it goes.
async fn admit(door: Rc<Door>, stream: TcpStream) {
    // Only makes answers later.
    let _ = stream.set_nodelay(true);
    if let Ok(server) = TcpStream::connect(door.server).await {
        let _ = server.set_nodelay(true);
        door.outlet.report.worked();
        // It is closed for whatever reason.
        let (mut channel, mut count) = (ClientChannel::default(), 0);
        let may_go_on = |bytes: &[u8]| {
            count += bytes.len();
            if count >= LOOK_EVERY {
                count = 0;
                door.tell();
            }
            door.is_for_here || channel.passes(bytes)
        };
        let _ = relay(stream.into_split(), server.into_split(), may_go_on).await;
    }
    door.tell();
}

impl Door {
    /// The last client whose certificate is not trusted is to be seen, and the certificates that
    /// clients leave behind do not grow. There is no event: anybody could make many.
    fn tell(&self) {
        let unknown = self.turned_away.unknown();
        let Some(newest) = unknown.last() else {
            return;
        };
        let more = u32::try_from(unknown.len()).unwrap_or(u32::MAX);
        let count = self.count.get().saturating_add(more);
        self.count.set(count);
        let thumbprint = newest.thumbprint.as_str();
        let reason = format!("{thumbprint} ({})", plain(&newest.subject));
        let problem = Problem::new(codes::CLIENT_UNTRUSTED).with("reason", reason);
        self.outlet.report.noted(problem, count);
    }
}

fn setup(outlet: &Outlet, listen: SocketAddr) -> OpcuaSetup {
    let settings = outlet.settings.borrow();
    let within = Micros::from_millis(outlet.number("within_ms").unsigned_abs());
    OpcuaSetup {
        service: outlet.service.clone(),
        site: outlet.site.to_string(),
        via: outlet.service.origin().who.clone(),
        host: settings::host(&settings, listen),
        port: listen.port(),
        is_for_here: listen.ip().is_loopback(),
        allows_anonymous: outlet.flag(ANONYMOUS),
        trusted: settings::trusted(&settings),
        folder: folder(outlet),
        lang: settings::lang(&settings),
        modules: texts(&settings, "modules").map(str::to_owned).collect(),
        within,
    }
}

/// Where its certificates are.
fn folder(outlet: &Outlet) -> PathBuf {
    outlet.kept().with_extension("pki")
}

fn unusable(outlet: &Outlet, error: OpcuaError) -> Problem {
    match error {
        OpcuaError::Certificates(error) => Problem::new(codes::OUTLET_TLS)
            .with("path", folder(outlet).display().to_string())
            .with("reason", error.to_string()),
        OpcuaError::Refused(reason) => broken(reason),
    }
}

fn broken(reason: String) -> Problem {
    Problem::new(codes::INTERNAL).with("reason", reason)
}

/// Says hello to the server, as any client does.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let listen = settings::listen(&outlet.settings.borrow());
    let host = settings::host(&outlet.settings.borrow(), listen);
    let url = format!("opc.tcp://{host}:{}/", listen.port());
    clients::reached(listen, async |at| {
        let mut stream = TcpStream::connect(at).await?;
        stream.write_all(&hello(&url)).await?;
        let mut header = [0; 8];
        stream.read_exact(&mut header).await?;
        let len = u32::from_le_bytes([header[4], header[5], header[6], header[7]]);
        match (&header[..4], len as usize) {
            (b"ACKF", 8..ANSWER_MAX) => Ok(url),
            _ => Err(io::ErrorKind::InvalidData.into()),
        }
    })
    .await
}

/// The first message of a client [OPC UA part 6, 7.1.2.3].
fn hello(url: &str) -> Vec<u8> {
    const BUFFER: u32 = 65_535;
    // Its version; how much it takes and sends at a time; messages and pieces as many as wanted.
    let numbers = [0, BUFFER, BUFFER, 0, 0, url.len() as u32];
    let len = 8 + 4 * numbers.len() + url.len();
    let mut message = b"HELF".to_vec();
    message.extend((len as u32).to_le_bytes());
    message.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    message.extend(url.bytes());
    message
}
