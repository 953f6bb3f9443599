//! Notifies systemd that the daemon is ready, alive, or about to stop: a datagram to the socket
//! that systemd names; nothing if it names none.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::Path;
use std::time::Duration;

/// The daemon is ready.
pub(super) const READY: &str = "READY=1\n";
/// The daemon is about to stop.
pub(super) const STOPPING: &str = "STOPPING=1\n";
/// The daemon is alive.
const ALIVE: &str = "WATCHDOG=1\n";

/// systemd's socket.
#[derive(Debug)]
pub(super) struct Notify {
    to: Option<(UnixDatagram, SocketAddr)>,
    /// The watchdog interval.
    every: Option<Duration>,
}

impl Notify {
    /// From the environment.
    pub(super) fn of_environment() -> Notify {
        let text = |name| std::env::var(name).ok();
        let socket = std::env::var_os("NOTIFY_SOCKET").filter(|path| !path.is_empty());
        let to = socket.and_then(|path| Notify::socket(Path::new(&path)).ok());
        // The watchdog may be meant for another process of the service.
        let of_us = text("WATCHDOG_PID").is_none_or(|pid| pid == std::process::id().to_string());
        let micros = text("WATCHDOG_USEC").and_then(|micros| micros.parse().ok());
        // Twice per watchdog timeout.
        let every = micros.map(|micros: u64| Duration::from_micros(micros / 2));
        Notify {
            every: every.filter(|every| of_us && to.is_some() && !every.is_zero()),
            to,
        }
    }

    fn socket(path: &Path) -> io::Result<(UnixDatagram, SocketAddr)> {
        let address = match path.as_os_str().as_bytes().strip_prefix(b"@") {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(path)?,
        };
        let socket = UnixDatagram::unbound()?;
        // A receiver that does not read must not stop the daemon.
        socket.set_nonblocking(true)?;
        Ok((socket, address))
    }

    /// Sends a notification. Errors are ignored.
    pub(super) fn tell(&self, word: &str) {
        if let Some((socket, address)) = &self.to {
            let _ = socket.send_to_addr(word.as_bytes(), address);
        }
    }

    /// Keeps notifying that the daemon is alive; never returns.
    pub(super) async fn stay_alive(&self) {
        let Some(every) = self.every else {
            return std::future::pending().await;
        };
        loop {
            self.tell(ALIVE);
            tokio::time::sleep(every).await;
        }
    }
}
