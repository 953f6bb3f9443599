//! Raw bytes over TCP: what a serial server does. Several clients share the line.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::WriteHalf;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{broadcast, mpsc};

/// More clients than this are turned away.
const CLIENTS_MAX: usize = 32;
/// Reads of clients that wait for the line.
const REQUESTS_MAX: usize = 16;
/// Pieces that a slow client may be behind before it is dropped.
const BEHIND_MAX: usize = 4_096;
/// A client that has closed its sending side still hears the reply for so long.
const LINGER: Duration = Duration::from_secs(2);

/// After a client could not be let in, so long until the next.
const PAUSE: Duration = Duration::from_millis(100);

type Heard = broadcast::Receiver<Arc<[u8]>>;

/// The clients, together.
pub(super) struct Tcp {
    address: SocketAddr,
    heard: broadcast::Sender<Arc<[u8]>>,
    requests: mpsc::Receiver<Vec<u8>>,
}

impl Tcp {
    /// Listens, and lets clients in from now on.
    pub(super) async fn listen(address: SocketAddr) -> io::Result<Tcp> {
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        let (heard, _) = broadcast::channel(BEHIND_MAX);
        let (sender, requests) = mpsc::channel(REQUESTS_MAX);
        tokio::spawn(accept(listener, sender, heard.clone()));
        Ok(Tcp {
            address,
            heard,
            requests,
        })
    }

    /// Where it listens.
    pub(super) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// What a client sends next.
    pub(super) async fn received(&mut self) -> Vec<u8> {
        match self.requests.recv().await {
            Some(bytes) => bytes,
            // The listener holds the other end for as long as the program runs.
            None => std::future::pending().await,
        }
    }

    /// Sends to all clients; it does not matter if there are none.
    pub(super) fn send(&self, bytes: &[u8]) {
        if self.heard.receiver_count() > 0 {
            let _ = self.heard.send(bytes.into());
        }
    }
}

async fn accept(
    listener: TcpListener,
    requests: mpsc::Sender<Vec<u8>>,
    heard: broadcast::Sender<Arc<[u8]>>,
) {
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // One client's own error, or a lack of file handles, which takes time to pass.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        if heard.receiver_count() < CLIENTS_MAX {
            tokio::spawn(serve_client(stream, requests.clone(), heard.subscribe()));
        }
    }
}

/// Serves one client until it has gone. Whatever ends it is the client's business alone.
async fn serve_client(mut stream: TcpStream, requests: mpsc::Sender<Vec<u8>>, mut heard: Heard) {
    let _ = stream.set_nodelay(true);
    let (mut reader, mut writer) = stream.split();
    let mut buffer = [0; 512];
    loop {
        tokio::select! {
            read = reader.read(&mut buffer) => match read {
                Ok(0) => break,
                Ok(count) if requests.send(buffer[..count].to_vec()).await.is_ok() => {}
                Ok(_) | Err(_) => return,
            },
            bytes = heard.recv() => {
                if forward(bytes, &mut writer).await.is_none() {
                    return;
                }
            }
        }
    }
    let rest = async { while forward(heard.recv().await, &mut writer).await.is_some() {} };
    let _ = tokio::time::timeout(LINGER, rest).await;
}

/// Hands on what was heard; nothing where the client has gone or is too far behind.
async fn forward(
    bytes: Result<Arc<[u8]>, broadcast::error::RecvError>,
    writer: &mut WriteHalf<'_>,
) -> Option<()> {
    writer.write_all(&bytes.ok()?).await.ok()
}
