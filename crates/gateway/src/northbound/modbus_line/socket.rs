//! The bytes of a connection, and its limits: how long it may be silent, how long a message may
//! take to become complete, and how much may wait to be read by the client.

use std::io;
use std::pin::Pin;
use std::time::Duration;
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::task::yield_now;
use tokio::time::{Instant, Sleep, sleep_until};

/// A message has so long to become complete, and a client to take what it was answered.
const PARTIAL_MAX: Duration = Duration::from_secs(10);
/// A client that says nothing for so long is gone.
const IDLE_MAX: Duration = Duration::from_secs(5 * 60);
/// A client that leaves so many bytes of answers unread is not read any more.
const UNREAD_MAX: usize = 64 * 1024;
/// How much is read at a time, and how often before others have their turn.
const READ_LEN: usize = 4 * 1024;
const READS_MAX: usize = 4;

/// A connection of a client.
#[derive(Debug)]
pub(super) struct Socket {
    from: OwnedReadHalf,
    to: OwnedWriteHalf,
    /// What was received and is not yet taken. What is left when [`Socket::next`] is called is the
    /// beginning of a message.
    pub(super) received: Vec<u8>,
    /// What is to be sent.
    out: Vec<u8>,
    /// When it last sent something that made sense.
    heard: Instant,
    /// Since when it has taken nothing of what it was answered; none where it has all.
    unsent: Option<Instant>,
    closes: Pin<Box<Sleep>>,
    /// How often in a row there was more to read at once.
    reads: usize,
}

impl Socket {
    /// A client that has just connected.
    pub(super) fn new(stream: TcpStream) -> Socket {
        // Only makes answers later.
        let _ = stream.set_nodelay(true);
        let (from, to) = stream.into_split();
        let now = Instant::now();
        Socket {
            from,
            to,
            received: Vec::new(),
            out: Vec::new(),
            heard: now,
            unsent: None,
            closes: Box::pin(sleep_until(now + IDLE_MAX)),
            reads: 0,
        }
    }

    /// Waits until there is more in [`Socket::received`]. Nothing is lost where this is dropped.
    ///
    /// # Errors
    /// The client has gone, or has to go.
    pub(super) async fn next(&mut self) -> io::Result<()> {
        if self.reads >= READS_MAX {
            // The next read would not wait.
            self.reads = 0;
            yield_now().await;
        }
        self.received.reserve(READ_LEN);
        let is_new = self.received.is_empty();
        loop {
            // It is set back only here, or to an earlier time: a request costs no timer.
            let closes_at = self.closes_at();
            if closes_at < self.closes.deadline() {
                self.closes.as_mut().reset(closes_at);
            }
            let (is_read, is_unsent) = (self.out.len() <= UNREAD_MAX, self.unsent.is_some());
            tokio::select! {
                () = &mut self.closes => {
                    if closes_at <= Instant::now() {
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                    self.closes.as_mut().reset(closes_at);
                }
                written = self.to.writable(), if is_unsent => {
                    written?;
                    self.write()?;
                }
                // After a short read tokio waits for the socket instead of trying again.
                read = self.from.read_buf(&mut self.received), if is_read => {
                    let len = read?;
                    if len == 0 {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                    if is_new {
                        self.made_sense();
                    }
                    self.reads = if len < READ_LEN { 0 } else { self.reads + 1 };
                    return Ok(());
                }
            }
        }
    }

    /// A message was complete. One that comes byte by byte has no longer for that.
    pub(super) fn made_sense(&mut self) {
        self.heard = Instant::now();
    }

    /// When it is closed if nothing happens.
    fn closes_at(&self) -> Instant {
        // It is not read while it does not take what it was answered.
        let is_partial = !self.received.is_empty() && self.out.len() <= UNREAD_MAX;
        let heard = match is_partial {
            true => self.heard + PARTIAL_MAX,
            false => self.heard + IDLE_MAX,
        };
        self.unsent
            .map_or(heard, |since| heard.min(since + PARTIAL_MAX))
    }

    /// Sends this, and what was not sent before, as far as the client takes it by now.
    ///
    /// # Errors
    /// The client has gone.
    pub(super) fn send(&mut self, more: &[u8]) -> io::Result<()> {
        self.out.extend_from_slice(more);
        self.write()
    }

    fn write(&mut self) -> io::Result<()> {
        let was_full = self.out.len() > UNREAD_MAX;
        while !self.out.is_empty() {
            match self.to.try_write(&self.out) {
                Ok(count) => {
                    self.out.drain(..count);
                    self.unsent = None;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    self.unsent.get_or_insert_with(Instant::now);
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        if was_full && self.out.len() <= UNREAD_MAX {
            // It is read again from now on.
            self.made_sense();
        }
        Ok(())
    }
}
