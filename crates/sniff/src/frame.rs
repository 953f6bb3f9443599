//! What was heard.

use railbus_wire::{Address, Decoded, Exchange, Instant, Micros, Protocol, ascii, lc02, r55, rtu};

/// Something that a listener tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Heard {
    /// Bytes that belong together.
    Frame(Frame),
    /// A request that nobody answered.
    Missing(Missing),
}

/// A request that nobody answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The request.
    pub asked: Asked,
    /// When the waiting ended.
    pub at: Instant,
    /// How long nothing came.
    pub after: Micros,
}

/// Bytes that belong together: a frame, or what is left between frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// When its first byte began.
    pub at: Instant,
    /// When its last byte ended.
    pub end: Instant,
    /// The silence before it; none before the first one.
    pub gap: Option<Micros>,
    /// All of it, at most [`Frame::LEN_MAX`] bytes.
    pub bytes: Vec<u8>,
    /// The ways to read it, likeliest first; several where it is a right frame of each. None
    /// where no protocol fits.
    pub readings: Vec<Reading>,
    /// The request that it answers.
    pub asked: Option<Asked>,
    /// How long after that request's end it began.
    pub after: Option<Micros>,
    /// Whether it came after its request was told to be unanswered.
    pub late: bool,
    /// What is to be thought of it.
    pub verdict: Verdict,
}

impl Frame {
    /// The most bytes of one frame. Longer noise is cut into pieces.
    pub const LEN_MAX: usize = 512;
}

/// One way to read a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// In which protocol.
    pub protocol: Protocol,
    /// As what; unknown for functions that are not known here.
    pub role: Option<Role>,
    /// An ASCII frame with a checksum. The others always have one.
    pub checksum: bool,
    /// The address it carries, or that of the request it answers.
    pub address: Option<Address>,
}

/// Who speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The master.
    Request,
    /// A module.
    Reply,
}

/// What is to be thought of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// A right frame.
    Good,
    /// A right reply that says no.
    Refused,
    /// A right frame whose function or command is not known here.
    Unknown,
    /// No right frame.
    Bad(Flaw),
}

impl Verdict {
    /// In one or two words for programs: `ok`, `refused`, `unknown`, `bad checksum`, …
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Verdict::Good => "ok",
            Verdict::Refused => "refused",
            Verdict::Unknown => "unknown",
            Verdict::Bad(Flaw::Checksum) => "bad checksum",
            Verdict::Bad(Flaw::Short) => "bad short",
            Verdict::Bad(Flaw::Form) => "bad form",
            Verdict::Bad(Flaw::Foreign) => "bad foreign",
        }
    }
}

/// Why bytes are no right frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// The checksum is wrong.
    Checksum,
    /// Its end is missing.
    Short,
    /// It is not what such a frame looks like, or not what was asked for.
    Form,
    /// It begins like no frame of the four protocols.
    Foreign,
}

/// A request that was heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    protocol: Protocol,
    checksum: bool,
    bytes: Vec<u8>,
}

impl Asked {
    /// The request that a frame is by one of its readings.
    pub(crate) fn new(reading: Reading, bytes: &[u8]) -> Option<Asked> {
        let asked = Asked {
            protocol: reading.protocol,
            checksum: reading.checksum,
            bytes: bytes.to_vec(),
        };
        asked.exchange().is_some().then_some(asked)
    }

    /// The frame.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Its protocol.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// What it asks, and of whom. There is one: only what can be read is kept.
    #[must_use]
    pub fn exchange(&self) -> Option<Exchange<'_>> {
        read_request(self.protocol, self.checksum, &self.bytes)
    }
}

impl Reading {
    /// What a frame asks by this reading, where it is a request.
    #[must_use]
    pub fn request<'a>(&self, bytes: &'a [u8]) -> Option<Exchange<'a>> {
        read_request(self.protocol, self.checksum, bytes)
    }
}

fn read_request(protocol: Protocol, checksum: bool, bytes: &[u8]) -> Option<Exchange<'_>> {
    let whole = |len: usize| len == bytes.len();
    match protocol {
        Protocol::Rtu => rtu::Exchange::decode_frame(bytes).ok().map(Exchange::Rtu),
        Protocol::R55 => match r55::Exchange::decode_request(bytes) {
            Decoded::Whole { len, value } if whole(len) => Some(Exchange::R55(value)),
            _ => None,
        },
        Protocol::Lc02 => match lc02::Exchange::decode_request(bytes) {
            Decoded::Whole { len, value } if whole(len) => Some(Exchange::Lc02(value)),
            _ => None,
        },
        Protocol::Ascii => {
            let rules = ascii::Rules {
                checksum,
                lower_case: true,
            };
            match ascii::Exchange::decode_request(bytes, rules) {
                Decoded::Whole { len, value } if whole(len) => Some(Exchange::Ascii(value)),
                _ => None,
            }
        }
    }
}
