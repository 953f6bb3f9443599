//! The border between the line and what carries its bytes.

use crate::{Granted, LineName, ModbusTcpPort, PortError, SerialOptions, SerialPort, TcpPort};
use railbus_bus::{Medium, Past};
use railbus_wire::Settings;
use std::future::{Future, poll_fn};
use std::io;
use std::task::{Context, Poll};

/// What carries a line's bytes. It is opened again and again under the same name; between a
/// failure and the next [`Port::open`] nothing else is asked of it.
pub trait Port: Send + 'static {
    /// The name it is opened by.
    fn name(&self) -> String;

    /// What lies behind it; asked after it was opened.
    fn medium(&self) -> Medium;

    /// What its driver granted of what it was asked for; nothing where there is no driver.
    fn granted(&self) -> Option<Granted> {
        None
    }

    /// What is known of those who had it before it was opened, whose replies may still come.
    fn past(&self) -> Past {
        Past::Unknown
    }

    /// Nothing that was sent through it can be answered any more: whoever opens it next need not
    /// fear for that. To be said before it is closed; where it was not, and something was sent
    /// lately, the next one listens for as long as a reply can be late.
    fn settle(&mut self) {}

    /// Opens it, or opens it anew. To drop the future ends the attempt.
    fn open(&mut self) -> impl Future<Output = Result<(), PortError>> + Send;

    /// The next bytes, as many as there are; until there are any, the task is woken for them.
    ///
    /// # Errors
    /// Where the port is lost. Never `Ok(0)`: an end is an error, too.
    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>>;

    /// The same as a future. To drop it loses no bytes.
    ///
    /// # Errors
    /// As of [`Port::poll_read`].
    fn read(&mut self, buffer: &mut [u8]) -> impl Future<Output = io::Result<usize>> + Send {
        poll_fn(|cx| self.poll_read(cx, buffer))
    }

    /// Hands one frame to the system, at this speed and in this format. It does not wait: what
    /// can't leave now must not leave later, when the line's time for it is over.
    ///
    /// # Errors
    /// Where the port is lost, or does not take the whole frame at once.
    fn send(&mut self, bytes: &[u8], settings: Settings) -> io::Result<()>;

    /// Gives it up. What has not left yet is lost.
    fn close(&mut self);
}

/// Any of the ports that a [`LineName`] names.
#[derive(Debug)]
pub enum AnyPort {
    /// A serial port or pseudo-terminal.
    Serial(SerialPort),
    /// A serial server that passes bytes on as they are.
    Tcp(TcpPort),
    /// A gateway that speaks Modbus TCP.
    ModbusTcp(ModbusTcpPort),
}

impl AnyPort {
    /// The port of that name, closed. `options` are for serial ports.
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

    fn past(&self) -> Past {
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

    fn send(&mut self, bytes: &[u8], settings: Settings) -> io::Result<()> {
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
