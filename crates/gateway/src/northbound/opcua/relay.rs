//! Bytes between a client and the server.
//!
//! A client that does not take what it is answered is not read either, so that no answers pile up
//! for it, and is disconnected after a while.

use std::io;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::time::{Instant, sleep_until};

/// How much is taken at a time.
const LEN: usize = 16 * 1024;
/// A side that takes nothing for so long is gone.
const STUCK_MAX: Duration = Duration::from_secs(10);

/// One direction: what was read and not yet written.
#[derive(Debug, Default)]
struct Flow {
    bytes: Vec<u8>,
    /// Until when some of it must go.
    by: Option<Instant>,
}

impl Flow {
    /// Gives what it has; else takes more, where it may, and says whether it did. Can be dropped.
    async fn step(
        &mut self,
        from: &mut (impl AsyncRead + Unpin),
        to: &mut (impl AsyncWrite + Unpin),
        may_read: bool,
    ) -> io::Result<bool> {
        match (self.bytes.is_empty(), may_read) {
            (false, _) => self.write(to).await.map(|()| false),
            (true, true) => self.read(from).await.map(|()| true),
            (true, false) => std::future::pending().await,
        }
    }

    /// Takes from this side.
    async fn read(&mut self, from: &mut (impl AsyncRead + Unpin)) -> io::Result<()> {
        self.bytes.reserve(LEN);
        match from.take(LEN as u64).read_buf(&mut self.bytes).await? {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            _ => {
                self.by = Some(Instant::now() + STUCK_MAX);
                Ok(())
            }
        }
    }

    /// Gives to that side.
    async fn write(&mut self, to: &mut (impl AsyncWrite + Unpin)) -> io::Result<()> {
        let count = to.write(&self.bytes).await?;
        self.bytes.drain(..count);
        let rest = !self.bytes.is_empty();
        self.by = rest.then(|| Instant::now() + STUCK_MAX);
        Ok(())
    }
}

/// Relays until one side closes, or takes nothing any more, or what the client says may not go on.
///
/// # Errors
/// Always: why it ended.
pub(super) async fn relay<R, W>(
    (mut client_in, mut client_out): (R, W),
    (mut server_in, mut server_out): (R, W),
    mut may_go_on: impl FnMut(&[u8]) -> bool,
) -> io::Result<()>
where
    R: AsyncRead + Unpin,
    W: AsyncWrite + Unpin,
{
    let (mut asked, mut answered) = (Flow::default(), Flow::default());
    loop {
        // While it owes us, a client is not read: its answers would pile up.
        let is_paid = answered.bytes.is_empty();
        let by = asked.by.into_iter().chain(answered.by).min();
        let stuck = async {
            match by {
                Some(by) => sleep_until(by).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            read = answered.step(&mut server_in, &mut client_out, true) => {
                read?;
            }
            read = asked.step(&mut client_in, &mut server_out, is_paid) => {
                if read? && !may_go_on(&asked.bytes) {
                    return Err(io::ErrorKind::PermissionDenied.into());
                }
            }
            () = stuck => return Err(io::ErrorKind::TimedOut.into()),
        }
    }
}
