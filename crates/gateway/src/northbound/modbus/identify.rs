//! The test of a server of Modbus, from this machine: who is there.

use super::request::GATEWAY;
use railbus_wire::Decoded;
use railbus_wire::mbap::{self, Message};
use railbus_wire::rtu::Identification;
use std::io;
use std::net::SocketAddr;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

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
