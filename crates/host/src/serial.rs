//! Serial ports, and the pseudo-terminals that stand in for them.

mod access;
mod holder;
mod mark;
mod mode;
mod rest;
mod tty;

use crate::{LineName, Port, PortError};
use railbus_bus::{Medium, Past};
use railbus_wire::Settings;
use std::io;
use std::path::PathBuf;
use std::task::{Context, Poll};
use std::time::Duration;
use tty::Tty;

/// How a serial port is to be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialOptions {
    /// Speed and character format at the opening; each frame brings its own.
    pub settings: Settings,
    /// Have the driver switch the transceiver by RTS; none for adapters that need no help.
    pub rs485: Option<Rs485>,
    /// Ask the driver to hand bytes over at once.
    pub low_latency: bool,
    /// Only listen: the port is opened for reading alone, so that nothing can be sent through
    /// it, and RTS is lowered at once, so that a transceiver switched by it listens, too.
    pub listen_only: bool,
}

impl Default for SerialOptions {
    fn default() -> SerialOptions {
        SerialOptions {
            settings: Settings::FACTORY,
            rs485: None,
            low_latency: true,
            listen_only: false,
        }
    }
}

/// How RTS switches the transceiver from listening to talking, in the words of the kernel's
/// `serial_rs485`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rs485 {
    /// RTS is high while talking and low while listening, or the reverse.
    pub rts_high_on_send: bool,
    /// Listen to what is sent: the line has an echo then.
    pub listen_on_send: bool,
    /// Switch on the termination, where the board has one to switch.
    pub terminate: bool,
    /// From RTS to the first bit; whole milliseconds, which drivers limit to about 100.
    pub delay_before_send: Duration,
    /// From the last bit to RTS.
    pub delay_after_send: Duration,
}

impl Default for Rs485 {
    fn default() -> Rs485 {
        Rs485 {
            rts_high_on_send: true,
            listen_on_send: false,
            terminate: false,
            delay_before_send: Duration::ZERO,
            delay_after_send: Duration::ZERO,
        }
    }
}

/// What a driver granted of what it was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Granted {
    /// It hands bytes over at once. Without that, an FTDI adapter may add 16 ms to each reply.
    pub low_latency: bool,
    /// It switches the transceiver by RTS.
    pub rs485: bool,
}

/// A serial port of Linux, or a pseudo-terminal.
#[derive(Debug)]
pub struct SerialPort {
    path: PathBuf,
    options: SerialOptions,
    /// Treated as a pseudo-terminal, whatever it is.
    pseudo: bool,
    tty: Option<Box<Tty>>,
}

impl SerialPort {
    /// The port at a path, closed.
    #[must_use]
    pub fn new(path: PathBuf, options: SerialOptions) -> SerialPort {
        SerialPort {
            path,
            options,
            pseudo: false,
            tty: None,
        }
    }

    /// The same for a terminal that has no wire behind it, even where that can't be seen.
    #[must_use]
    pub fn pseudo(path: PathBuf, options: SerialOptions) -> SerialPort {
        SerialPort {
            pseudo: true,
            ..SerialPort::new(path, options)
        }
    }

    /// Speed and format last asked for. A pseudo-terminal takes no parity, so that this can't be
    /// read from the port itself.
    #[must_use]
    pub fn settings(&self) -> Option<Settings> {
        self.tty.as_ref().map(|tty| tty.settings())
    }
}

impl Port for SerialPort {
    fn name(&self) -> String {
        let path = self.path.clone();
        let name = match self.pseudo {
            true => LineName::Pty(path),
            false => LineName::Serial(path),
        };
        name.to_string()
    }

    fn medium(&self) -> Medium {
        let seen = self.tty.as_ref().is_some_and(|tty| tty.is_pts());
        if self.pseudo || seen {
            Medium::Buffered
        } else {
            Medium::Wire
        }
    }

    fn granted(&self) -> Option<Granted> {
        self.tty.as_ref().map(|tty| tty.granted())
    }

    fn past(&self) -> Past {
        self.tty.as_ref().map(|tty| tty.past()).unwrap_or_default()
    }

    fn settle(&mut self) {
        if let Some(tty) = &mut self.tty {
            tty.settle();
        }
    }

    async fn open(&mut self) -> Result<(), PortError> {
        self.close();
        let (path, options) = (self.path.clone(), self.options);
        // Drivers may take long to open, and to find the holder of a busy port takes a walk
        // through all processes: the other lines are not to wait for that.
        let tty = tokio::task::spawn_blocking(move || Tty::open(&path, options).map(Box::new));
        self.tty = Some(tty.await.map_err(|_| PortError::Io(0))??);
        Ok(())
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        match &self.tty {
            Some(tty) => tty.poll_read(cx, buffer),
            None => Poll::Ready(Err(io::ErrorKind::NotConnected.into())),
        }
    }

    fn send(&mut self, bytes: &[u8], settings: Settings) -> io::Result<()> {
        let tty = self.tty.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        tty.send(bytes, settings)
    }

    fn close(&mut self) {
        self.tty = None;
    }
}
