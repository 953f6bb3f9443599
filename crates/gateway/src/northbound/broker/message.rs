//! What goes to a broker and comes from there, in either version of the protocol.

/// What is published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Message {
    pub(crate) topic: String,
    pub(crate) payload: Vec<u8>,
    /// The broker keeps it for those who come later.
    pub(crate) is_retained: bool,
    /// Delivered at least once, instead of at most once.
    pub(crate) is_sure: bool,
    pub(crate) correlation: Option<Vec<u8>>,
}

/// What was received.
#[derive(Clone, Debug, Default)]
pub(crate) struct Received {
    pub(crate) topic: String,
    pub(crate) payload: Vec<u8>,
    /// The broker kept it for us.
    pub(crate) is_retained: bool,
    /// The number of its packet, if it has one.
    pub(crate) packet: Option<u16>,
    /// It may have been delivered before.
    pub(crate) is_again: bool,
    /// When it expires, in seconds.
    pub(crate) expiry: Option<u32>,
    pub(crate) response: Option<String>,
    pub(crate) correlation: Option<Vec<u8>>,
}

/// What a broker said of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Taken,
    /// Nobody is there who receives it.
    NoReceiver,
    Refused,
}
