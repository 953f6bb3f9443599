//! A fixed buffer for one frame to send.

/// The longest frame of all four protocols in bytes, that of Modbus RTU [MODBUS §1.3].
pub const FRAME_MAX: usize = 256;

/// One frame to send: at most [`FRAME_MAX`] bytes, without allocation.
#[derive(Clone)]
pub struct Frame {
    len: usize,
    buffer: [u8; FRAME_MAX],
}

impl Frame {
    /// An empty frame.
    #[must_use]
    pub const fn new() -> Frame {
        Frame {
            len: 0,
            buffer: [0; FRAME_MAX],
        }
    }

    /// The bytes to send.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        self.buffer.get(..self.len).unwrap_or_default()
    }

    /// Forgets the bytes.
    #[inline]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds bytes at the end; false, and nothing added, when they do not fit.
    #[inline]
    pub fn extend(&mut self, bytes: &[u8]) -> bool {
        let end = self.len + bytes.len();
        match self.buffer.get_mut(self.len..end) {
            Some(free) => {
                free.copy_from_slice(bytes);
                self.len = end;
                true
            }
            None => false,
        }
    }

    /// Replaces the content.
    #[inline]
    pub(crate) fn set<const N: usize>(&mut self, bytes: [u8; N]) {
        if let Some(front) = self.buffer.first_chunk_mut::<N>() {
            *front = bytes;
            self.len = N;
        }
    }

    #[inline]
    pub(crate) fn push(&mut self, byte: u8) {
        if let Some(slot) = self.buffer.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
    }
}

impl Default for Frame {
    fn default() -> Frame {
        Frame::new()
    }
}

impl PartialEq for Frame {
    fn eq(&self, other: &Frame) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Eq for Frame {}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:02X?}", self.bytes())
    }
}
