//! What goes to a broker and comes from there, in either version of the protocol.

/// What is published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// The broker keeps it for those who come later.
    pub(super) is_retained: bool,
    /// Delivered at least once, instead of at most once.
    pub(super) is_sure: bool,
    pub(super) correlation: Option<Vec<u8>>,
}

/// What was received.
#[derive(Clone, Debug, Default)]
pub(super) struct Received {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// The broker kept it for us.
    pub(super) is_retained: bool,
    /// The number of its packet, if it has one.
    pub(super) packet: Option<u16>,
    /// It may have been delivered before.
    pub(super) is_again: bool,
    /// When it expires, in seconds.
    pub(super) expiry: Option<u32>,
    pub(super) response: Option<String>,
    pub(super) correlation: Option<Vec<u8>>,
}

/// What a broker said of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Taken,
    /// Nobody is there who receives it.
    NoReceiver,
    Refused,
}
