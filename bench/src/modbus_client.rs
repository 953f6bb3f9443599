//! A Modbus TCP client that costs little: many connections, one thread, and requests that were
//! made beforehand.

use rustix::net::{AddressFamily, SocketType, bind, connect, socket};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, TcpStream};
use std::time::{Duration, Instant};

/// How many connections may come from one address.
const PER_ADDRESS: usize = 8;
/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Header, function, byte count, and a byte of coils.
const REPLY: usize = 10;

/// What is read: eight coils of a unit.
#[derive(Clone, Copy, Debug)]
pub struct Coils {
    /// The unit.
    pub unit: u8,
    /// The first of them.
    pub first: u16,
}

impl Coils {
    /// The request for them, and its reply but for the coils.
    fn exchange(self, transaction: u8) -> ([u8; 12], [u8; REPLY - 1]) {
        let (unit, [high, low]) = (self.unit, self.first.to_be_bytes());
        let request = [0, transaction, 0, 0, 0, 6, unit, 1, high, low, 0, 8];
        let reply = [0, transaction, 0, 0, 0, 4, unit, 1, 1];
        (request, reply)
    }
}

/// The `number`-th connection to a server, from an address that has room for it.
fn open(to: SocketAddr, number: usize) -> Result<TcpStream, String> {
    let failed = |why: std::io::Error| format!("{to}: {why}");
    let last = 1 + (number / PER_ADDRESS) as u8;
    let from = SocketAddrV4::new(Ipv4Addr::new(127, 0, 0, last), 0);
    let socket = socket(AddressFamily::INET, SocketType::STREAM, None);
    let socket = socket.map_err(|why| failed(why.into()))?;
    bind(&socket, &from).map_err(|why| failed(why.into()))?;
    connect(&socket, &to).map_err(|why| failed(why.into()))?;
    let stream = TcpStream::from(socket);
    stream.set_nodelay(true).map_err(failed)?;
    stream.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
    Ok(stream)
}

/// A connection with as many requests under way as it is deep.
#[derive(Debug)]
pub struct Reader {
    stream: TcpStream,
    requests: Vec<u8>,
    replies: Vec<[u8; REPLY - 1]>,
    received: Vec<u8>,
    sent: Instant,
}

impl Reader {
    /// The `number`-th, once it is answered.
    pub fn open(
        to: SocketAddr,
        (number, depth): (usize, u8),
        coils: Coils,
    ) -> Result<Reader, String> {
        let exchanges: Vec<_> = (0..depth).map(|number| coils.exchange(number)).collect();
        let until = Instant::now() + PATIENCE;
        loop {
            let mut reader = Reader {
                stream: open(to, number)?,
                requests: exchanges.iter().flat_map(|(request, _)| *request).collect(),
                replies: exchanges.iter().map(|(_, reply)| *reply).collect(),
                received: vec![0; REPLY * usize::from(depth)],
                sent: Instant::now(),
            };
            let answered = reader
                .send(Instant::now())
                .and_then(|()| reader.receive_coils());
            match answered {
                Ok(()) => return Ok(reader),
                Err(why) if Instant::now() > until => return Err(why),
                // The server may not know yet that those have gone who had these connections.
                Err(_) => std::thread::sleep(Duration::from_millis(20)),
            }
        }
    }

    fn send(&mut self, now: Instant) -> Result<(), String> {
        self.sent = now;
        let sent = self.stream.write_all(&self.requests);
        sent.map_err(|why| format!("a request: {why}"))
    }

    /// Whether all was answered with coils; an exception is an answer where one is awaited.
    fn receive(&mut self) -> Result<bool, String> {
        let mut filled = 0;
        while filled < self.received.len() {
            let rest = self.received.get_mut(filled..).unwrap_or_default();
            match self.stream.read(rest) {
                Ok(0) => return Err("the server has closed a connection".to_owned()),
                Ok(count) => filled += count,
                Err(why) => return Err(format!("a reply: {why}")),
            }
            let whole = self.received.get(..filled).unwrap_or_default();
            let (replies, last) = whole.as_chunks::<REPLY>();
            // It is shorter, so it is seen before the rest would be waited for.
            if last.get(7).is_some_and(|function| *function != 1) {
                return match self.replies.len() {
                    1 if last.len() == REPLY - 1 => Ok(false),
                    _ => Err(format!("an answer without coils: {whole:02X?}")),
                };
            }
            let mut both = replies.iter().zip(&self.replies);
            if !both.all(|(reply, wanted)| reply.starts_with(wanted)) {
                return Err(format!("an answer to something else: {whole:02X?}"));
            }
        }
        Ok(true)
    }

    /// Fails where there are no coils.
    fn receive_coils(&mut self) -> Result<(), String> {
        match self.receive()? {
            true => Ok(()),
            false => Err(format!("an exception: {:02X?}", self.received)),
        }
    }
}

/// What came of it.
#[derive(Debug, Default)]
pub struct Flow {
    /// Requests that were answered, per second.
    pub rate: f64,
    /// How many there were.
    pub count: f64,
    /// From the first byte of a request, or of those that are sent together, to the last byte of
    /// the answer, in µs.
    pub took: Vec<f64>,
    /// How many answers were exceptions.
    pub refused: usize,
}

/// Keeps all connections busy for so long: each asks again when it has its answer.
pub fn read(readers: &mut [Reader], length: Duration) -> Result<Flow, String> {
    let (begun, mut took) = (Instant::now(), Vec::new());
    let mut now = begun;
    for reader in &mut *readers {
        reader.send(now)?;
    }
    while now - begun < length {
        for reader in &mut *readers {
            reader.receive_coils()?;
            now = Instant::now();
            took.push((now - reader.sent).as_secs_f64() * 1e6);
            reader.send(now)?;
        }
    }
    for reader in &mut *readers {
        reader.receive_coils()?;
    }
    let depth = readers.first().map_or(0, |reader| reader.replies.len());
    let count = ((took.len() + readers.len()) * depth) as f64;
    Ok(Flow {
        rate: count / begun.elapsed().as_secs_f64(),
        count,
        took,
        refused: 0,
    })
}

/// Asks on all connections at once, at this pace.
pub fn read_every(
    readers: &mut [Reader],
    every: Duration,
    length: Duration,
) -> Result<Flow, String> {
    let (begun, mut flow) = (Instant::now(), Flow::default());
    let mut due = begun;
    while due - begun < length {
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        due += every;
        for reader in &mut *readers {
            reader.send(Instant::now())?;
        }
        for reader in &mut *readers {
            flow.refused += usize::from(!reader.receive()?);
            flow.took.push(reader.sent.elapsed().as_secs_f64() * 1e6);
        }
    }
    flow.count = flow.took.len() as f64;
    flow.rate = flow.count / begun.elapsed().as_secs_f64();
    Ok(flow)
}

/// A connection that switches a coil, and awaits each answer.
#[derive(Debug)]
pub struct Writer {
    stream: TcpStream,
    coils: Coils,
}

impl Writer {
    /// The `number`-th connection.
    pub fn open(to: SocketAddr, number: usize, coils: Coils) -> Result<Writer, String> {
        let stream = open(to, number)?;
        Ok(Writer { stream, coils })
    }

    /// Switches the first coil on; whether that was done.
    pub fn write(&mut self) -> Result<bool, String> {
        let failed = |why: std::io::Error| format!("a write: {why}");
        let (unit, [high, low]) = (self.coils.unit, self.coils.first.to_be_bytes());
        let request = [0, 0, 0, 0, 0, 6, unit, 5, high, low, 0xFF, 0];
        self.stream.write_all(&request).map_err(failed)?;
        let mut reply = [0; 9];
        self.stream.read_exact(&mut reply).map_err(failed)?;
        if reply[7] != 5 {
            return Ok(false);
        }
        self.stream.read_exact(&mut [0; 3]).map_err(failed)?;
        Ok(true)
    }

    /// Whether the coils are known by now.
    pub fn is_known(&mut self) -> Result<bool, String> {
        let failed = |why: std::io::Error| format!("a read: {why}");
        let (request, wanted) = self.coils.exchange(0);
        self.stream.write_all(&request).map_err(failed)?;
        let mut reply = [0; REPLY - 1];
        self.stream.read_exact(&mut reply).map_err(failed)?;
        if reply != wanted {
            return Ok(false);
        }
        self.stream.read_exact(&mut [0]).map_err(failed)?;
        Ok(true)
    }
}
