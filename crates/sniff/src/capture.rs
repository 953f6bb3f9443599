//! Capture files in the pcapng format, as Wireshark writes and reads them: one interface per line,
//! each frame a packet, with its verdict as a comment.
//!
//! The link type is [`LINK_TYPE`], the first one reserved for private use: there is a registered
//! one for RTU alone (RTAC serial) but none for a line shared by four protocols. A packet contains
//! the bytes of the frame and nothing else. Its time is the beginning of its first byte, in
//! microseconds since 1970, and its direction is that of the master: requests are outbound.

mod read;
mod write;

pub use read::{Broken, Damage, Interface, Packet, ReadStep, Reader};
pub use write::{header, interface, packet};

/// LINKTYPE_USER0: the meaning of the bytes is private to the programs at both ends.
pub const LINK_TYPE: u16 = 147;

/// The direction of a frame, seen from the master.
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
