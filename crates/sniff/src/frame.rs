//! What a listener reports.

use railbus_wire::{Address, Decoded, Exchange, Instant, Micros, Protocol, ascii, lc02, r55, rtu};

/// An event of a listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SniffEvent {
    /// Bytes that belong together.
    Frame(SniffedFrame),
    /// A request without a reply.
    Missing(Missing),
}

/// A request without a reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The request.
    pub asked: Asked,
    /// When the timeout ended.
    pub at: Instant,
    /// How long nothing came.
    pub after: Micros,
}

/// Bytes that belong together: a frame, or what is left between frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SniffedFrame {
    /// When its first byte began.
    pub at: Instant,
    /// When its last byte ended.
    pub end: Instant,
    /// The silence before it; none before the first one.
    pub gap: Option<Micros>,
    /// Its bytes, at most [`SniffedFrame::LEN_MAX`].
    pub bytes: Vec<u8>,
    /// The possible readings, likeliest first; several if it is a valid frame of each. Empty if no
    /// protocol matches.
    pub readings: Vec<Reading>,
    /// The request it answers.
    pub asked: Option<Asked>,
    /// The time from the end of that request to its beginning.
    pub after: Option<Micros>,
    /// Whether it came after its request had been reported as unanswered.
    pub late: bool,
    /// The verdict.
    pub verdict: FrameVerdict,
}

impl SniffedFrame {
    /// The most bytes of one frame. Longer noise is cut into pieces.
    pub const LEN_MAX: usize = 512;
}

/// One reading of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The protocol.
    pub protocol: Protocol,
    /// Request or reply; none for unknown functions.
    pub role: Option<FrameRole>,
    /// Whether an ASCII frame has a checksum. The others always have one.
    pub checksum: bool,
    /// The address it carries, or that of the request it answers.
    pub address: Option<Address>,
}

/// The role of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameRole {
    /// Sent by the master.
    Request,
    /// Sent by a module.
    Reply,
}

/// The verdict on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameVerdict {
    /// A valid frame.
    Good,
    /// A valid reply that is a refusal.
    Refused,
    /// A valid frame with an unknown function or command.
    Unknown,
    /// Not a valid frame.
    Bad(Flaw),
}

impl FrameVerdict {
    /// A short word for programs: `ok`, `refused`, `unknown`, `bad checksum`, …
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            FrameVerdict::Good => "ok",
            FrameVerdict::Refused => "refused",
            FrameVerdict::Unknown => "unknown",
            FrameVerdict::Bad(Flaw::Checksum) => "bad checksum",
            FrameVerdict::Bad(Flaw::Short) => "bad short",
            FrameVerdict::Bad(Flaw::Form) => "bad form",
            FrameVerdict::Bad(Flaw::Foreign) => "bad foreign",
        }
    }
}

/// Why bytes are not a valid frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// The checksum is wrong.
    Checksum,
    /// Its end is missing.
    Short,
    /// It has the wrong form for such a frame, or does not match the request.
    Form,
    /// It does not begin like any frame of the four protocols.
    Foreign,
}

/// A request on the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    protocol: Protocol,
    checksum: bool,
    bytes: Vec<u8>,
}

impl Asked {
    /// The request in a frame, by one of its readings.
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

    /// The exchange. There always is one: only requests that can be decoded are kept.
    #[must_use]
    pub fn exchange(&self) -> Option<Exchange<'_>> {
        read_request(self.protocol, self.checksum, &self.bytes)
    }
}

impl Reading {
    /// The exchange of a frame by this reading, if it is a request.
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
            let rules = ascii::DecodeRules {
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
