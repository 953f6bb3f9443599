//! A line behind a Modbus TCP gateway: RTU frames on our side.

use crate::mbap::Mbap;
use crate::{LineName, Port, PortError, tcp};
use railbus_bus::Medium;
use railbus_wire::SerialSettings;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io;
use std::task::{Context, Poll, ready};
use tokio::net::TcpStream;

/// A connection to a Modbus TCP gateway. The gateway sets speed and format, and it carries Modbus
/// only: frames of other protocols are dropped, as if no module answered.
#[derive(Debug)]
pub struct ModbusTcpPort {
    host: String,
    port: u16,
    /// Boxed because its buffers are larger than other ports.
    connection: Option<Box<(TcpStream, Mbap)>>,
}

impl ModbusTcpPort {
    /// The port of a gateway, not connected.
    #[must_use]
    pub const fn new(host: String, port: u16) -> ModbusTcpPort {
        ModbusTcpPort {
            host,
            port,
            connection: None,
        }
    }
}

impl Port for ModbusTcpPort {
    fn name(&self) -> String {
        let (host, port) = (self.host.clone(), self.port);
        LineName::ModbusTcp { host, port }.to_string()
    }

    fn medium(&self) -> Medium {
        Medium::Buffered
    }

    async fn open(&mut self) -> Result<(), PortError> {
        self.connection = None;
        let stream = tcp::connect(&self.host, self.port).await?;
        let first = RandomState::new().build_hasher().finish() as u16;
        self.connection = Some(Box::new((stream, Mbap::new(first))));
        Ok(())
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        let connection = self.connection.as_deref_mut();
        let (stream, mbap) = connection.ok_or(io::ErrorKind::NotConnected)?;
        loop {
            if let Some(len) = mbap.unwrap(buffer)? {
                return Poll::Ready(Ok(len));
            }
            let count = ready!(tcp::poll_read(stream, cx, mbap.room()))?;
            mbap.received(count);
        }
    }

    fn send(&mut self, bytes: &[u8], _: SerialSettings) -> io::Result<()> {
        let connection = self.connection.as_deref_mut();
        let (stream, mbap) = connection.ok_or(io::ErrorKind::NotConnected)?;
        match mbap.wrap(bytes) {
            Some(envelope) => tcp::send(Some(stream), envelope),
            None => Ok(()),
        }
    }

    fn close(&mut self) {
        self.connection = None;
    }
}
