//! Capture files in the pcapng format, as Wireshark writes and reads them: one interface per
//! line, each frame a packet, with what was thought of it as its comment.
//!
//! The link type is [`LINK_TYPE`], the first of those that everybody may use for himself: there
//! is a registered one for RTU alone (RTAC serial) but none for a wire that four protocols
//! share. A packet's bytes are the frame's and nothing else. Its time is when its first byte
//! began, in microseconds since 1970, and its direction is seen from the master: requests go
//! out.

mod read;
mod write;

pub use read::{Broken, Interface, Packet, Reader, Step, Why};
pub use write::{header, interface, packet};

/// LINKTYPE_USER0: bytes whose meaning the two ends of a capture agree on.
pub const LINK_TYPE: u16 = 147;

/// Which way a frame went, seen from the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the master.
    In,
    /// From the master.
    Out,
}

const SECTION: u32 = 0x0A0D_0D0A;
const INTERFACE: u32 = 1;
const ENHANCED_PACKET: u32 = 6;
const MAGIC: u32 = 0x1A2B_3C4D;

/// Options of blocks.
mod option {
    pub(super) const END: u16 = 0;
    pub(super) const COMMENT: u16 = 1;
    pub(super) const IF_NAME: u16 = 2;
    pub(super) const EPB_FLAGS: u16 = 2;
    pub(super) const IF_DESCRIPTION: u16 = 3;
    pub(super) const USER_APPLICATION: u16 = 4;
    pub(super) const IF_TSRESOL: u16 = 9;
}
