//! Raw bytes over TCP, like a serial device server. Several clients share the line.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::WriteHalf;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{broadcast, mpsc};

/// Maximum number of clients; more are rejected.
const CLIENTS_MAX: usize = 32;
/// Queued reads of clients.
const REQUESTS_MAX: usize = 16;
/// Number of chunks that a slow client may be behind before it is dropped.
const BEHIND_MAX: usize = 4_096;
/// How long a client that has closed its sending side still receives replies.
const LINGER: Duration = Duration::from_secs(2);

/// Pause after a client could not be accepted.
const PAUSE: Duration = Duration::from_millis(100);

type Heard = broadcast::Receiver<Arc<[u8]>>;

/// All clients.
pub(super) struct Tcp {
    address: SocketAddr,
    heard: broadcast::Sender<Arc<[u8]>>,
    requests: mpsc::Receiver<Vec<u8>>,
}

impl Tcp {
    /// Listens, and accepts clients from now on.
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

    /// The address it listens on.
    pub(super) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// The next data from a client.
    pub(super) async fn received(&mut self) -> Vec<u8> {
        match self.requests.recv().await {
            Some(bytes) => bytes,
            // The listener holds the other end as long as the program runs.
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
            // An error of a single client, or a lack of file handles, which will pass.
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        if heard.receiver_count() < CLIENTS_MAX {
            tokio::spawn(serve_client(stream, requests.clone(), heard.subscribe()));
        }
    }
}

/// Serves one client until it has gone. Its errors only affect that client.
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

/// Forwards received bytes; `None` if the client has gone or is too far behind.
async fn forward(
    bytes: Result<Arc<[u8]>, broadcast::error::RecvError>,
    writer: &mut WriteHalf<'_>,
) -> Option<()> {
    writer.write_all(&bytes.ok()?).await.ok()
}
