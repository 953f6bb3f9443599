//! Where answers go to: a socket as it is, or TLS above it.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};
use tokio::io::{AsyncWrite, WriteHalf};
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedWriteHalf;
use tokio_rustls::server::TlsStream;

/// The way to a client. Only [`Answers::writable`] waits.
pub(super) trait Answers {
    /// Resolves when the client may take more.
    async fn writable(&mut self) -> io::Result<()>;

    /// How much of this the client takes by now.
    fn try_write(&mut self, answers: &[u8]) -> io::Result<usize>;

    /// Whether nothing of what was taken is still here.
    fn is_sent(&mut self) -> io::Result<bool>;

    /// Says that nothing more will come, where that can be said.
    fn close(&mut self);
}

impl Answers for OwnedWriteHalf {
    async fn writable(&mut self) -> io::Result<()> {
        OwnedWriteHalf::writable(self).await
    }

    fn try_write(&mut self, answers: &[u8]) -> io::Result<usize> {
        OwnedWriteHalf::try_write(self, answers)
    }

    fn is_sent(&mut self) -> io::Result<bool> {
        Ok(true)
    }

    fn close(&mut self) {}
}

/// TLS keeps up to 64 KiB of what it has encrypted and the socket does not take.
impl Answers for WriteHalf<TlsStream<TcpStream>> {
    async fn writable(&mut self) -> io::Result<()> {
        std::future::poll_fn(|cx| Pin::new(&mut *self).poll_flush(cx)).await
    }

    fn try_write(&mut self, answers: &[u8]) -> io::Result<usize> {
        // Whoever has something left waits until it is writable, and is woken by that.
        let mut cx = Context::from_waker(Waker::noop());
        match Pin::new(self).poll_write(&mut cx, answers) {
            Poll::Ready(taken) => taken,
            Poll::Pending => Err(io::ErrorKind::WouldBlock.into()),
        }
    }

    fn is_sent(&mut self) -> io::Result<bool> {
        let mut cx = Context::from_waker(Waker::noop());
        match Pin::new(self).poll_flush(&mut cx) {
            Poll::Ready(sent) => sent.map(|()| true),
            Poll::Pending => Ok(false),
        }
    }

    fn close(&mut self) {
        let mut cx = Context::from_waker(Waker::noop());
        // A client that does not take it finds the connection closed.
        let _ = Pin::new(self).poll_shutdown(&mut cx);
    }
}
