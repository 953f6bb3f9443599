//! A client of WebSockets [RFC 6455], as small as one can be.

use std::io::{Read, Write};

/// What bytes go through.
pub(crate) trait Wire: Read + Write {}
impl<T: Read + Write> Wire for T {}

/// A connection.
pub(crate) struct Client {
    stream: Box<dyn Wire>,
}

impl Client {
    /// Asks for a WebSocket at this path with these lines in the head; else the status with which
    /// it is refused.
    pub(crate) fn over(mut stream: Box<dyn Wire>, lines: &str, path: &str) -> Result<Client, u16> {
        write!(
            stream,
            "GET {path} HTTP/1.1\r\n{lines}Connection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        .expect("it takes bytes");
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).expect("a head");
            head.push(byte[0]);
        }
        let head = String::from_utf8(head).expect("text");
        let status = head.split(' ').nth(1).and_then(|text| text.parse().ok());
        match status.expect("a status") {
            101 => {
                // The key and its answer stand in the RFC.
                assert!(head.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{head}");
                Ok(Client { stream })
            }
            refused => Err(refused),
        }
    }

    pub(crate) fn send(&mut self, text: &str) {
        self.send_frame(1, text.as_bytes());
    }

    fn send_frame(&mut self, kind: u8, text: &[u8]) {
        let mut frame = vec![0x80 | kind];
        match u16::try_from(text.len()) {
            Ok(short @ 0..126) => frame.push(0x80 | short as u8),
            Ok(length) => {
                frame.push(0x80 | 126);
                frame.extend(length.to_be_bytes());
            }
            Err(_) => {
                frame.push(0x80 | 127);
                frame.extend((text.len() as u64).to_be_bytes());
            }
        }
        // A mask of zeros is a mask.
        frame.extend([0; 4]);
        frame.extend(text);
        // A daemon that closes during a message does not read the rest; reading then shows it.
        let _ = self.stream.write_all(&frame);
    }

    /// The next message; none once the daemon has closed.
    pub(crate) fn next_text(&mut self) -> Option<String> {
        loop {
            let mut head = [0; 2];
            self.stream.read_exact(&mut head).ok()?;
            let length = match head[1] & 0x7F {
                126 => {
                    let mut length = [0; 2];
                    self.stream.read_exact(&mut length).ok()?;
                    usize::from(u16::from_be_bytes(length))
                }
                127 => {
                    let mut length = [0; 8];
                    self.stream.read_exact(&mut length).ok()?;
                    usize::try_from(u64::from_be_bytes(length)).expect("it fits")
                }
                length => usize::from(length),
            };
            let mut data = vec![0; length];
            self.stream.read_exact(&mut data).ok()?;
            match head[0] & 0x0F {
                1 => return Some(String::from_utf8(data).expect("text")),
                8 => return None,
                9 => self.send_frame(10, &data),
                _ => {}
            }
        }
    }
}
