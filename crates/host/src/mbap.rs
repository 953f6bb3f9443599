//! Converts Modbus RTU frames to Modbus TCP and back: the module's address and what follows it
//! stay, the header takes the place of the CRC.

use railbus_wire::mbap::{self, INSIDE_MAX, INSIDE_MIN, MESSAGE_MAX, Message};
use railbus_wire::{Decoded, crc16};
use std::io;

/// The longest RTU frame.
const FRAME_MAX: usize = INSIDE_MAX + 2;

/// Both directions of one connection. One request is in flight at a time.
#[derive(Debug)]
pub(crate) struct Mbap {
    transaction: u16,
    /// The transaction whose reply is pending.
    awaited: Option<u16>,
    request: [u8; MESSAGE_MAX],
    received: [u8; 2 * MESSAGE_MAX],
    len: usize,
}

impl Mbap {
    /// `first` is the number of the first transaction. It should differ between connections, for
    /// gateways whose queue outlives a connection.
    pub(crate) const fn new(first: u16) -> Mbap {
        Mbap {
            transaction: first,
            awaited: None,
            request: [0; MESSAGE_MAX],
            received: [0; 2 * MESSAGE_MAX],
            len: 0,
        }
    }

    /// The message for a request; none for bytes that are not an RTU frame, since a gateway can't
    /// send those.
    pub(crate) fn wrap(&mut self, frame: &[u8]) -> Option<&[u8]> {
        let inside = frame.get(..frame.len().checked_sub(2)?)?;
        if !(INSIDE_MIN..=INSIDE_MAX).contains(&inside.len()) || crc16(frame) != 0 {
            return None;
        }
        self.transaction = self.transaction.wrapping_add(1);
        self.awaited = Some(self.transaction);
        let len = mbap::HEADER + inside.len();
        let envelope = self.request.get_mut(..len)?;
        let (front, back) = envelope.split_at_mut(mbap::HEADER);
        front.copy_from_slice(&mbap::header(self.transaction, inside.len()));
        back.copy_from_slice(inside);
        Some(envelope)
    }

    /// The buffer for the next bytes received.
    pub(crate) fn room(&mut self) -> &mut [u8] {
        self.received.get_mut(self.len..).unwrap_or_default()
    }

    /// This many bytes were received.
    pub(crate) fn received(&mut self, count: usize) {
        self.len = (self.len + count).min(self.received.len());
    }

    /// Writes the next reply as an RTU frame and returns its length, or none if no reply is
    /// complete. Replies to other transactions are dropped.
    ///
    /// # Errors
    /// If the bytes are not Modbus TCP: the start of the next message is unknown.
    pub(crate) fn unwrap(&mut self, out: &mut [u8]) -> io::Result<Option<usize>> {
        loop {
            let received = self.received.get(..self.len).unwrap_or_default();
            let (len, message) = match Message::decode(received) {
                Decoded::Partial { .. } => return Ok(None),
                Decoded::Malformed(_) => return Err(io::ErrorKind::InvalidData.into()),
                Decoded::Whole { len, value } => (len, value),
            };
            let mut written = None;
            if self.awaited == Some(message.transaction) {
                self.awaited = None;
                written = Some(write_frame(message.inside, out)?);
            }
            self.received.copy_within(len..self.len, 0);
            self.len -= len;
            if written.is_some() {
                return Ok(written);
            }
        }
    }
}

/// Writes address and PDU with the CRC that the line expects.
fn write_frame(inside: &[u8], out: &mut [u8]) -> io::Result<usize> {
    let len = inside.len() + 2;
    debug_assert!(len <= FRAME_MAX);
    let frame = out.get_mut(..len).ok_or(io::ErrorKind::InvalidInput)?;
    let (front, back) = frame.split_at_mut(inside.len());
    front.copy_from_slice(inside);
    back.copy_from_slice(&crc16(inside).to_le_bytes());
    Ok(len)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ERC-8 manual's read of coil 60 and its reply.
    const ASK: [u8; 8] = [0x01, 0x01, 0x00, 0x3C, 0x00, 0x01, 0x3D, 0xC6];
    const REPLY: [u8; 6] = [0x01, 0x01, 0x01, 0x01, 0x90, 0x48];

    fn hear(mbap: &mut Mbap, bytes: &[u8]) -> io::Result<Option<Vec<u8>>> {
        mbap.room()[..bytes.len()].copy_from_slice(bytes);
        mbap.received(bytes.len());
        let mut out = [0; FRAME_MAX];
        Ok(mbap.unwrap(&mut out)?.map(|len| out[..len].to_vec()))
    }

    #[test]
    fn a_request_loses_its_crc_and_a_reply_gets_one() {
        let mut mbap = Mbap::new(6);
        let envelope = [0, 7, 0, 0, 0, 6, 1, 1, 0, 0x3C, 0, 1];
        assert_eq!(mbap.wrap(&ASK), Some(&envelope[..]));
        let reply = hear(&mut mbap, &[0, 7, 0, 0, 0, 4, 1, 1, 1, 1]).unwrap();
        assert_eq!(reply.as_deref(), Some(&REPLY[..]));
    }

    #[test]
    fn a_gateways_own_exceptions_pass() {
        let mut mbap = Mbap::new(0xFFFF);
        for code in [0x0A, 0x0B] {
            mbap.wrap(&ASK).unwrap();
            let transaction = mbap.transaction.to_be_bytes();
            let reply = [transaction[0], transaction[1], 0, 0, 0, 3, 1, 0x81, code];
            let frame = hear(&mut mbap, &reply).unwrap().unwrap();
            assert_eq!(frame[..3], [1, 0x81, code]);
            assert_eq!(crc16(&frame), 0);
        }
    }

    #[test]
    fn replies_to_other_transactions_are_dropped() {
        let mut mbap = Mbap::new(0);
        mbap.wrap(&ASK).unwrap();
        let stale = [0, 9, 0, 0, 0, 4, 1, 1, 1, 0];
        assert_eq!(hear(&mut mbap, &stale).unwrap(), None);
        let own = [0, 1, 0, 0, 0, 4, 1, 1, 1, 1];
        let both = [stale, own].concat();
        assert_eq!(hear(&mut mbap, &both).unwrap().as_deref(), Some(&REPLY[..]));
        // A duplicate of the reply answers nothing.
        assert_eq!(hear(&mut mbap, &own).unwrap(), None);
    }

    #[test]
    fn a_reply_may_come_in_any_pieces() {
        let own = [0, 1, 0, 0, 0, 4, 1, 1, 1, 1];
        for cut in 0..own.len() {
            let mut mbap = Mbap::new(0);
            mbap.wrap(&ASK).unwrap();
            assert_eq!(hear(&mut mbap, &own[..cut]).unwrap(), None);
            let reply = hear(&mut mbap, &own[cut..]).unwrap();
            assert_eq!(reply.as_deref(), Some(&REPLY[..]));
        }
    }

    #[test]
    fn what_is_no_modbus_tcp_is_an_error() {
        for wrong in [
            [0, 1, 0, 1, 0, 4],
            [0, 1, 0, 0, 0, 1],
            [0, 1, 0, 0, 0, 255],
            *b"HTTP/1",
        ] {
            assert!(hear(&mut Mbap::new(0), &wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn what_is_no_rtu_frame_is_not_sent() {
        let mut mbap = Mbap::new(0);
        for frame in [
            &b"$016\r"[..],
            &[],
            &[1],
            &ASK[..7],
            &[0x55, 1, 0x10, 0, 0, 0, 0, 0x66],
        ] {
            assert_eq!(mbap.wrap(frame), None);
        }
    }
}
