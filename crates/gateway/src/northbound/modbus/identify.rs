//! Tests of servers over TCP, from this machine: who is there.

use super::clients::not_listening;
use super::request::GATEWAY;
use railbus_api::problem::Problem;
use railbus_wire::Decoded;
use railbus_wire::mbap::{self, Message};
use railbus_wire::rtu::Identification;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;

/// How long a test waits.
const TEST_MAX: Duration = Duration::from_secs(3);

/// What is found out of a server that listens there, where it can be reached from this machine.
///
/// # Errors
/// [`super::clients::not_listening`].
pub(crate) async fn reached(
    mut listen: SocketAddr,
    ask: impl AsyncFnOnce(SocketAddr) -> io::Result<String>,
) -> Result<String, Problem> {
    if listen.ip().is_unspecified() {
        listen.set_ip(match listen {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    let said = timeout(TEST_MAX, ask(listen)).await;
    let said = said.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
    said.map_err(|error| not_listening(listen, error))
}

/// Asks a gateway what it is, as any client does [BEYOND §5].
pub(crate) async fn identified(listen: SocketAddr) -> io::Result<String> {
    let [_, gateway] = GATEWAY;
    let mut stream = TcpStream::connect(listen).await?;
    let pdu = [gateway, 0x2B, 0x0E, 2, 0];
    let request = [&mbap::header(1, pdu.len())[..], &pdu].concat();
    stream.write_all(&request).await?;
    let mut received = Vec::new();
    loop {
        match Message::decode(&received) {
            Decoded::Whole { value, .. } => {
                let said = value.pdu.get(2..).and_then(Identification::from_packed);
                let said = said.ok_or(io::ErrorKind::InvalidData)?;
                let texts: Vec<_> = said
                    .objects()
                    .map(|(_, text)| String::from_utf8_lossy(text))
                    .collect();
                return Ok(texts.join(" "));
            }
            Decoded::Malformed(_) => return Err(io::ErrorKind::InvalidData.into()),
            Decoded::Partial { .. } => {}
        }
        if stream.read_buf(&mut received).await? == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
    }
}
