//! Serial servers that pass bytes through.

use crate::clock::within;
use crate::{LineName, Port, PortError};
use railbus_bus::Medium;
use railbus_wire::{Micros, SerialSettings};
use rustix::net::sockopt;
use std::io;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::net::TcpStream;

/// The longest that connecting may take.
const CONNECT_MAX: Micros = Micros::from_secs(3);
/// A server that acknowledges nothing for this long is gone. Otherwise a server without power would
/// look like a line of silent modules for a quarter of an hour.
const SILENT_MAX: Duration = Duration::from_secs(5);

/// A connection to a serial server.
#[derive(Debug)]
pub struct TcpPort {
    host: String,
    port: u16,
    stream: Option<TcpStream>,
}

impl TcpPort {
    /// The port of a server, closed.
    #[must_use]
    pub const fn new(host: String, port: u16) -> TcpPort {
        TcpPort {
            host,
            port,
            stream: None,
        }
    }
}

impl Port for TcpPort {
    fn name(&self) -> String {
        let (host, port) = (self.host.clone(), self.port);
        LineName::Tcp { host, port }.to_string()
    }

    fn medium(&self) -> Medium {
        Medium::Buffered
    }

    async fn open(&mut self) -> Result<(), PortError> {
        self.stream = None;
        self.stream = Some(connect(&self.host, self.port).await?);
        Ok(())
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        match &self.stream {
            Some(stream) => poll_read(stream, cx, buffer),
            None => Poll::Ready(Err(io::ErrorKind::NotConnected.into())),
        }
    }

    fn send(&mut self, bytes: &[u8], _: SerialSettings) -> io::Result<()> {
        send(self.stream.as_ref(), bytes)
    }

    fn close(&mut self) {
        self.stream = None;
    }
}

/// A connection that sends small frames at once and notices when the other end is gone.
pub(crate) async fn connect(host: &str, port: u16) -> Result<TcpStream, PortError> {
    let attempt = within(CONNECT_MAX, TcpStream::connect((host, port))).await;
    let attempt = attempt.map_err(|error| PortError::of_loss(&error))?;
    let stream = attempt
        .ok_or(PortError::Unreachable)?
        .map_err(|error| refused(&error))?;
    stream
        .set_nodelay(true)
        .map_err(|e| PortError::of_loss(&e))?;
    watch(&stream)?;
    Ok(stream)
}

fn watch(stream: &TcpStream) -> rustix::io::Result<()> {
    let millis = SILENT_MAX.as_millis();
    sockopt::set_tcp_user_timeout(stream, u32::try_from(millis).unwrap_or(u32::MAX))?;
    sockopt::set_tcp_keepidle(stream, SILENT_MAX)?;
    sockopt::set_tcp_keepintvl(stream, Duration::from_secs(1))?;
    sockopt::set_socket_keepalive(stream, true)
}

/// The next bytes of a connection; never `Ok(0)`.
pub(crate) fn poll_read(
    stream: &TcpStream,
    cx: &mut Context<'_>,
    buffer: &mut [u8],
) -> Poll<io::Result<usize>> {
    loop {
        ready!(stream.poll_read_ready(cx))?;
        match stream.try_read(buffer) {
            Ok(0) => return Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into())),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            end => return Poll::Ready(end),
        }
    }
}

/// Sends a whole frame; if that fails the connection can't be used any more, because the other
/// end's position in a frame is unknown.
pub(crate) fn send(stream: Option<&TcpStream>, bytes: &[u8]) -> io::Result<()> {
    let stream = stream.ok_or(io::ErrorKind::NotConnected)?;
    match stream.try_write(bytes)? {
        written if written == bytes.len() => Ok(()),
        _ => Err(io::ErrorKind::WriteZero.into()),
    }
}

/// Why connecting failed.
fn refused(error: &io::Error) -> PortError {
    match error.kind() {
        io::ErrorKind::ConnectionRefused => PortError::Refused,
        // Errors of the resolver have no system error number: there is no such host.
        _ if error.raw_os_error().is_none() => PortError::Missing,
        _ => PortError::of_loss(error),
    }
}
