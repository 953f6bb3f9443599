//! A WebSocket to the daemon of a test.

use crate::daemon::Daemon;
use crate::websocket::Client;
use serde_json::Value;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

/// What a test waits for comes within this time, or never.
const PATIENCE: Duration = Duration::from_secs(60);

impl Client {
    /// Connects as a program.
    pub(crate) fn open(daemon: &Daemon) -> Client {
        Client::try_open(daemon, "", "/api/v1/ws").expect("it is let in")
    }

    /// As above with more lines in the head, or the status of the refusal.
    pub(crate) fn try_open(daemon: &Daemon, more: &str, path: &str) -> Result<Client, u16> {
        let stream = daemon.connect();
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
        Client::over(Box::new(stream), &(daemon.head() + more), path)
    }

    /// Connects over the daemon's socket, whose buffers hold little of what is not read; the second
    /// is that socket.
    pub(crate) fn over_socket(daemon: &Daemon) -> (Client, UnixStream) {
        let stream = daemon.connect_to_socket();
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
        let same = stream.try_clone().expect("a socket");
        let client = Client::over(Box::new(stream), &daemon.head(), "/api/v1/ws");
        (client.expect("it is let in"), same)
    }

    /// The next message; none once the daemon has closed.
    pub(crate) fn next(&mut self) -> Option<Value> {
        let text = self.next_text()?;
        Some(serde_json::from_str(&text).expect("JSON"))
    }

    /// The next matching message; those before it are skipped.
    pub(crate) fn until(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < PATIENCE, "{what}: it never came");
            let message = self.next().expect("the connection lasts");
            if wanted(&message) {
                return message;
            }
        }
    }
}
