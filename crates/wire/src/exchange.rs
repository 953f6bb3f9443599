//! One exchange in any of the four protocols.

use crate::{Address, Decoded, Frame, Malformed, Reply, ascii, lc02, r55, rtu};
use core::fmt;

/// One of the four protocols.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Protocol {
    /// Modbus RTU.
    Rtu,
    /// The ASCII set of the EDA modules, ADAM and DCON.
    Ascii,
    /// LC-02, the hexadecimal protocol of the EDA modules.
    Lc02,
    /// The 0x55/0x22 relay boards.
    R55,
}

impl Protocol {
    /// All four.
    pub const ALL: [Protocol; 4] = [
        Protocol::Rtu,
        Protocol::Ascii,
        Protocol::Lc02,
        Protocol::R55,
    ];

    /// The name in texts and flags: `rtu`, `ascii`, `lc02`, `r55`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Protocol::Rtu => "rtu",
            Protocol::Ascii => "ascii",
            Protocol::Lc02 => "lc02",
            Protocol::R55 => "r55",
        }
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A request to one module and its reply, in any of the four protocols.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exchange<'a> {
    /// In Modbus RTU.
    Rtu(rtu::Exchange<'a>),
    /// In ASCII.
    Ascii(ascii::Exchange),
    /// In LC-02.
    Lc02(lc02::Exchange),
    /// With a 0x55 board.
    R55(r55::Exchange),
}

/// A response in any of the four protocols.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response<'a> {
    /// In Modbus RTU.
    Rtu(rtu::Response<'a>),
    /// In ASCII.
    Ascii(ascii::Response),
    /// In LC-02.
    Lc02(lc02::Response),
    /// Of a 0x55 board.
    R55(r55::Response),
}

impl<'a> Exchange<'a> {
    /// An exchange in Modbus RTU.
    #[must_use]
    #[inline]
    pub const fn rtu(address: Address, request: rtu::Request<'a>) -> Exchange<'a> {
        Exchange::Rtu(rtu::Exchange { address, request })
    }

    /// An exchange in ASCII, with or without checksum.
    #[must_use]
    #[inline]
    pub const fn ascii(address: Address, checksum: bool, request: ascii::Request) -> Exchange<'a> {
        Exchange::Ascii(ascii::Exchange {
            address,
            checksum,
            request,
        })
    }

    /// An exchange in LC-02.
    #[must_use]
    #[inline]
    pub const fn lc02(address: Address, request: lc02::Request) -> Exchange<'a> {
        Exchange::Lc02(lc02::Exchange { address, request })
    }

    /// An exchange with a 0x55 board, in the form with a reply.
    #[must_use]
    #[inline]
    pub const fn r55(address: Address, request: r55::Request) -> Exchange<'a> {
        Exchange::R55(r55::Exchange::new(address, request))
    }

    /// The protocol.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        match self {
            Exchange::Rtu(_) => Protocol::Rtu,
            Exchange::Ascii(_) => Protocol::Ascii,
            Exchange::Lc02(_) => Protocol::Lc02,
            Exchange::R55(_) => Protocol::R55,
        }
    }

    /// The module.
    #[must_use]
    pub const fn address(&self) -> Address {
        match self {
            Exchange::Rtu(exchange) => exchange.address,
            Exchange::Ascii(exchange) => exchange.address,
            Exchange::Lc02(exchange) => exchange.address,
            Exchange::R55(exchange) => exchange.address(),
        }
    }

    /// Writes the request frame.
    #[inline]
    pub fn encode(&self, out: &mut Frame) {
        match self {
            Exchange::Rtu(exchange) => exchange.encode(out),
            Exchange::Ascii(exchange) => exchange.encode(out),
            Exchange::Lc02(exchange) => exchange.encode(out),
            Exchange::R55(exchange) => exchange.encode(out),
        }
    }

    /// Whether the request gets a reply.
    #[must_use]
    pub const fn expects_reply(&self) -> bool {
        match self {
            Exchange::Rtu(exchange) => exchange.expects_reply(),
            Exchange::Ascii(exchange) => exchange.expects_reply(),
            Exchange::Lc02(_) => true,
            Exchange::R55(exchange) => exchange.expects_reply(),
        }
    }

    /// How many bytes the good reply has; the maximum where that varies, 0 if there is none.
    #[must_use]
    pub const fn response_len_max(&self) -> usize {
        match self {
            Exchange::Rtu(exchange) if exchange.expects_reply() => exchange.response_len(),
            Exchange::Ascii(exchange) => exchange.response_len_max(),
            Exchange::Lc02(exchange) => exchange.response_len(),
            Exchange::R55(exchange) if exchange.expects_reply() => r55::FRAME_LEN,
            Exchange::Rtu(_) | Exchange::R55(_) => 0,
        }
    }

    /// Decodes the beginning of `rx` as the reply to this request. Total for any bytes.
    #[inline]
    pub fn decode_response<'r>(&self, rx: &'r [u8]) -> Decoded<Reply<Response<'r>>> {
        match self {
            Exchange::Rtu(e) => e.decode_response(rx).map(|reply| reply.map(Response::Rtu)),
            Exchange::Ascii(e) => e
                .decode_response(rx)
                .map(|reply| reply.map(Response::Ascii)),
            Exchange::Lc02(e) => e.decode_response(rx).map(|reply| reply.map(Response::Lc02)),
            Exchange::R55(e) => e.decode_response(rx).map(|reply| reply.map(Response::R55)),
        }
    }

    /// Looks for the reply anywhere in `rx`: at the first position where it could begin. The number
    /// is how many bytes precede that position.
    ///
    /// This skips a glitch before the reply [MODBUS §4.3]. A position where a reply has only begun
    /// hides what follows it until more bytes come; the caller decides when to stop waiting, drops
    /// the first byte and looks again.
    #[inline]
    pub fn find_response<'r>(&self, rx: &'r [u8]) -> (usize, Decoded<Reply<Response<'r>>>) {
        if rx.is_empty() {
            return (0, Decoded::Malformed(Malformed::Start));
        }
        match self.decode_response(rx) {
            Decoded::Malformed(why) => self.find_later_response(rx, why),
            found => (0, found),
        }
    }

    /// The same after the first byte, where it did not begin. On its own, because the reply nearly
    /// always begins with the first byte, and a loop would be prepared for nothing.
    #[cold]
    fn find_later_response<'r>(
        &self,
        rx: &'r [u8],
        why: Malformed,
    ) -> (usize, Decoded<Reply<Response<'r>>>) {
        for skip in 1..rx.len() {
            match self.decode_response(rx.get(skip..).unwrap_or_default()) {
                Decoded::Malformed(_) => {}
                found => return (skip, found),
            }
        }
        (rx.len(), Decoded::Malformed(why))
    }

    /// Whether one frame could be a reply to both, so that a late reply to one could be taken for a
    /// reply to the other.
    #[must_use]
    pub fn confusable(&self, other: &Exchange<'_>) -> bool {
        match (self, other) {
            (Exchange::Rtu(a), Exchange::Rtu(b)) => a.confusable(b),
            (Exchange::Ascii(a), Exchange::Ascii(b)) => a.confusable(b),
            (Exchange::Lc02(a), Exchange::Lc02(b)) => a.confusable(b),
            (Exchange::R55(a), Exchange::R55(b)) => a.confusable(b),
            _ => false,
        }
    }
}

impl Exchange<'_> {
    /// Whether a good reply to this request can't be a reply to the other one, and no reply to the
    /// other one a good reply to this. A refusal is not a good reply.
    ///
    /// Modules answer in the order in which they were asked. So if this was sent after the other
    /// and is answered, no reply to the other can come any more.
    #[must_use]
    pub fn stands_apart(&self, other: &Exchange<'_>) -> bool {
        match (self, other) {
            (Exchange::Ascii(a), Exchange::Ascii(b)) => a.stands_apart(b),
            (Exchange::Lc02(a), Exchange::Lc02(b)) => a.stands_apart(b),
            _ => !self.confusable(other),
        }
    }
}

impl<R> Reply<R> {
    /// The same reply with another kind of response.
    #[inline]
    pub fn map<S>(self, change: impl FnOnce(R) -> S) -> Reply<S> {
        Reply {
            from: self.from,
            response: change(self.response),
        }
    }
}
