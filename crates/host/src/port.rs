//! The interface between the line and what carries its bytes.

use crate::{Granted, LineName, ModbusTcpPort, PortError, SerialOptions, SerialPort, TcpPort};
use railbus_bus::{Medium, PortHistory};
use railbus_wire::SerialSettings;
use std::future::{Future, poll_fn};
use std::io;
use std::task::{Context, Poll};

/// What carries a line's bytes. It is opened again and again under the same name; between a failure
/// and the next [`Port::open`] nothing else is called.
pub trait Port: Send + 'static {
    /// The name of the port.
    fn name(&self) -> String;

    /// What lies behind it; called after it was opened.
    fn medium(&self) -> Medium;

    /// What its driver granted; none if there is no driver.
    fn granted(&self) -> Option<Granted> {
        None
    }

    /// What is known of earlier users, to whom replies may still come.
    fn past(&self) -> PortHistory {
        PortHistory::Unknown
    }

    /// Marks the port as settled: no reply can come any more to what was sent, so the next user
    /// need not wait for late replies. Called before closing; if it was not called and something
    /// was sent recently, the next user waits for as long as a reply can be late.
    fn settle(&mut self) {}

    /// Opens or reopens it. Dropping the future cancels the attempt.
    fn open(&mut self) -> impl Future<Output = Result<(), PortError>> + Send;

    /// Reads the bytes that are available; if there are none, the task is woken when some arrive.
    ///
    /// # Errors
    /// If the port is lost. Never `Ok(0)`: end of file is an error, too.
    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>>;

    /// The same as a future, which is cancel-safe.
    ///
    /// # Errors
    /// As for [`Port::poll_read`].
    fn read(&mut self, buffer: &mut [u8]) -> impl Future<Output = io::Result<usize>> + Send {
        poll_fn(|cx| self.poll_read(cx, buffer))
    }

    /// Passes one frame to the system, with these settings. It does not wait: what can't be sent
    /// now must not be sent later, when the line's time for it is over.
    ///
    /// # Errors
    /// If the port is lost, or does not take the whole frame at once.
    fn send(&mut self, bytes: &[u8], settings: SerialSettings) -> io::Result<()>;

    /// Closes it. What has not been sent yet is lost.
    fn close(&mut self);
}

/// Any port that a [`LineName`] can name.
#[derive(Debug)]
pub enum AnyPort {
    /// A serial port or pseudo-terminal.
    Serial(SerialPort),
    /// A serial server that passes bytes through.
    Tcp(TcpPort),
    /// A Modbus TCP gateway.
    ModbusTcp(ModbusTcpPort),
}

impl AnyPort {
    /// The port with this name, closed. `options` apply to serial ports.
    #[must_use]
    pub fn new(name: &LineName, options: SerialOptions) -> AnyPort {
        match name {
            LineName::Serial(path) => AnyPort::Serial(SerialPort::new(path.clone(), options)),
            LineName::Pty(path) => AnyPort::Serial(SerialPort::pseudo(path.clone(), options)),
            LineName::Tcp { host, port } => AnyPort::Tcp(TcpPort::new(host.clone(), *port)),
            LineName::ModbusTcp { host, port } => {
                AnyPort::ModbusTcp(ModbusTcpPort::new(host.clone(), *port))
            }
        }
    }
}

impl Port for AnyPort {
    fn name(&self) -> String {
        match self {
            AnyPort::Serial(port) => port.name(),
            AnyPort::Tcp(port) => port.name(),
            AnyPort::ModbusTcp(port) => port.name(),
        }
    }

    fn medium(&self) -> Medium {
        match self {
            AnyPort::Serial(port) => port.medium(),
            AnyPort::Tcp(port) => port.medium(),
            AnyPort::ModbusTcp(port) => port.medium(),
        }
    }

    fn granted(&self) -> Option<Granted> {
        match self {
            AnyPort::Serial(port) => port.granted(),
            AnyPort::Tcp(port) => port.granted(),
            AnyPort::ModbusTcp(port) => port.granted(),
        }
    }

    fn past(&self) -> PortHistory {
        match self {
            AnyPort::Serial(port) => port.past(),
            AnyPort::Tcp(port) => port.past(),
            AnyPort::ModbusTcp(port) => port.past(),
        }
    }

    fn settle(&mut self) {
        match self {
            AnyPort::Serial(port) => port.settle(),
            AnyPort::Tcp(port) => port.settle(),
            AnyPort::ModbusTcp(port) => port.settle(),
        }
    }

    async fn open(&mut self) -> Result<(), PortError> {
        match self {
            AnyPort::Serial(port) => port.open().await,
            AnyPort::Tcp(port) => port.open().await,
            AnyPort::ModbusTcp(port) => port.open().await,
        }
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        match self {
            AnyPort::Serial(port) => port.poll_read(cx, buffer),
            AnyPort::Tcp(port) => port.poll_read(cx, buffer),
            AnyPort::ModbusTcp(port) => port.poll_read(cx, buffer),
        }
    }

    fn send(&mut self, bytes: &[u8], settings: SerialSettings) -> io::Result<()> {
        match self {
            AnyPort::Serial(port) => port.send(bytes, settings),
            AnyPort::Tcp(port) => port.send(bytes, settings),
            AnyPort::ModbusTcp(port) => port.send(bytes, settings),
        }
    }

    fn close(&mut self) {
        match self {
            AnyPort::Serial(port) => port.close(),
            AnyPort::Tcp(port) => port.close(),
            AnyPort::ModbusTcp(port) => port.close(),
        }
    }
}
