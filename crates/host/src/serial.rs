//! Serial ports, and the pseudo-terminals that stand in for them.

mod access;
mod holder;
mod mark;
mod mode;
mod rest;
mod tty;

use crate::{LineName, Port, PortError};
use railbus_bus::{Medium, PortHistory};
use railbus_wire::SerialSettings;
use std::io;
use std::path::PathBuf;
use std::task::{Context, Poll};
use std::time::Duration;
use tty::Tty;

/// How a serial port is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialOptions {
    /// Speed and character format when it is opened; each frame brings its own.
    pub settings: SerialSettings,
    /// Let the driver switch the transceiver by RTS; none for adapters that do it themselves.
    pub rs485: Option<Rs485>,
    /// Ask the driver to pass bytes on at once.
    pub low_latency: bool,
    /// Listen only: the port is opened for reading alone, so that nothing can be sent, and RTS is
    /// lowered at once, so that a transceiver switched by it listens, too.
    pub listen_only: bool,
}

impl Default for SerialOptions {
    fn default() -> SerialOptions {
        SerialOptions {
            settings: SerialSettings::FACTORY,
            rs485: None,
            low_latency: true,
            listen_only: false,
        }
    }
}

/// How RTS switches the transceiver between receiving and sending, in the terms of the kernel's
/// `serial_rs485`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rs485 {
    /// RTS is high while sending and low while receiving, or the reverse.
    pub rts_high_on_send: bool,
    /// Receive while sending: the line then has an echo.
    pub listen_on_send: bool,
    /// Switch the termination on, if the board has a switchable one.
    pub terminate: bool,
    /// From RTS to the first bit; whole milliseconds, limited by drivers to about 100.
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

/// What a driver granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Granted {
    /// It passes bytes on at once. Without that, an FTDI adapter may add 16 ms to each reply.
    pub low_latency: bool,
    /// It switches the transceiver by RTS.
    pub rs485: bool,
}

/// A serial port of Linux, or a pseudo-terminal.
#[derive(Debug)]
pub struct SerialPort {
    path: PathBuf,
    options: SerialOptions,
    /// Treated as a pseudo-terminal even if it is not one.
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

    /// The same for a terminal without a wire behind it, even where that can't be detected.
    #[must_use]
    pub fn pseudo(path: PathBuf, options: SerialOptions) -> SerialPort {
        SerialPort {
            pseudo: true,
            ..SerialPort::new(path, options)
        }
    }

    /// The settings last requested. A pseudo-terminal has no parity, so they can't be read from the
    /// port itself.
    #[must_use]
    pub fn settings(&self) -> Option<SerialSettings> {
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

    fn past(&self) -> PortHistory {
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
        // Opening may be slow in a driver, and finding the holder of a busy port walks all
        // processes: other lines must not wait for that.
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

    fn send(&mut self, bytes: &[u8], settings: SerialSettings) -> io::Result<()> {
        let tty = self.tty.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        tty.send(bytes, settings)
    }

    fn close(&mut self) {
        self.tty = None;
    }
}
