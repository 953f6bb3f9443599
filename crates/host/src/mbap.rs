//! Converts Modbus RTU frames to Modbus TCP and back.
//!
//! Modbus TCP puts a header before each message: a transaction number, a protocol number (0), and
//! the length of what follows, which is the module's address and the PDU. There is no CRC.

use railbus_wire::crc16;
use std::io;

/// Transaction, protocol and length.
const HEADER: usize = 6;
/// Address and PDU are 2 to 254 bytes.
const INSIDE_MIN: usize = 2;
const INSIDE_MAX: usize = 254;
/// The longest message.
pub(crate) const ENVELOPE_MAX: usize = HEADER + INSIDE_MAX;
/// The longest RTU frame.
const FRAME_MAX: usize = INSIDE_MAX + 2;

/// Both directions of one connection. One request is in flight at a time.
#[derive(Debug)]
pub(crate) struct Mbap {
    transaction: u16,
    /// The transaction whose reply is pending.
    awaited: Option<u16>,
    request: [u8; ENVELOPE_MAX],
    received: [u8; 2 * ENVELOPE_MAX],
    len: usize,
}

impl Mbap {
    /// `first` is the number of the first transaction. It should differ between connections, for
    /// gateways whose queue outlives a connection.
    pub(crate) const fn new(first: u16) -> Mbap {
        Mbap {
            transaction: first,
            awaited: None,
            request: [0; ENVELOPE_MAX],
            received: [0; 2 * ENVELOPE_MAX],
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
        let [high, low] = self.transaction.to_be_bytes();
        let header = [high, low, 0, 0, 0, inside.len() as u8];
        let len = HEADER + inside.len();
        let envelope = self.request.get_mut(..len)?;
        let (front, back) = envelope.split_at_mut(HEADER);
        front.copy_from_slice(&header);
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
        while let Some((transaction, inside)) = self.envelope()? {
            let (start, end) = (HEADER, HEADER + inside);
            let mut written = None;
            if self.awaited == Some(transaction) {
                self.awaited = None;
                let inside = self.received.get(start..end).unwrap_or_default();
                written = Some(write_frame(inside, out)?);
            }
            self.received.copy_within(end..self.len, 0);
            self.len -= end;
            if written.is_some() {
                return Ok(written);
            }
        }
        Ok(None)
    }

    /// Transaction and length of the first message, once it is complete.
    fn envelope(&self) -> io::Result<Option<(u16, usize)>> {
        let received = self.received.get(..self.len).unwrap_or_default();
        let Some(&[t1, t0, p1, p0, l1, l0]) = received.first_chunk::<HEADER>() else {
            return Ok(None);
        };
        let inside = usize::from(u16::from_be_bytes([l1, l0]));
        if (p1, p0) != (0, 0) || !(INSIDE_MIN..=INSIDE_MAX).contains(&inside) {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let whole = received.len() >= HEADER + inside;
        Ok(whole.then_some((u16::from_be_bytes([t1, t0]), inside)))
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
