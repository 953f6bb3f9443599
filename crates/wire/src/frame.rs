//! A fixed buffer for one frame to be sent.

/// The longest frame of all four protocols in bytes, that of Modbus RTU [MODBUS §1.3].
pub const FRAME_MAX: usize = 256;

/// One frame to be sent: at most [`FRAME_MAX`] bytes, without allocation.
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

    /// Removes all bytes.
    #[inline]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends bytes; false, without appending any, if they do not fit.
    #[cfg_attr(feature = "small", inline(never))]
    #[cfg_attr(not(feature = "small"), inline)]
    pub fn extend(&mut self, bytes: &[u8]) -> bool {
        let end = self.len.saturating_add(bytes.len());
        match self.buffer.get_mut(self.len..end) {
            Some(free) => {
                free.copy_from_slice(bytes);
                self.len = end;
                true
            }
            None => false,
        }
    }

    /// Removes the first bytes; the others move up.
    pub fn drop_front(&mut self, count: usize) {
        let rest = self.len.saturating_sub(count);
        for at in 0..rest {
            let byte = self.buffer.get(at.saturating_add(count)).copied();
            if let (Some(slot), Some(byte)) = (self.buffer.get_mut(at), byte) {
                *slot = byte;
            }
        }
        self.len = rest;
    }

    /// Replaces the content.
    #[inline]
    pub(crate) fn set<const N: usize>(&mut self, bytes: [u8; N]) {
        if let Some(front) = self.buffer.first_chunk_mut::<N>() {
            *front = bytes;
            self.len = N;
        }
    }

    #[cfg_attr(feature = "small", inline(never))]
    #[cfg_attr(not(feature = "small"), inline)]
    pub(crate) fn push(&mut self, byte: u8) {
        let at = self.len;
        if let Some(slot) = self.buffer.get_mut(at) {
            *slot = byte;
            self.len = at + 1;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_behind_moves_up() {
        let mut frame = Frame::new();
        frame.extend(&[1, 2, 3, 4, 5]);
        frame.drop_front(0);
        assert_eq!(frame.bytes(), [1, 2, 3, 4, 5]);
        frame.drop_front(2);
        assert_eq!(frame.bytes(), [3, 4, 5]);
        frame.drop_front(usize::MAX);
        assert_eq!(frame.bytes(), []);
        frame.extend(&[9; FRAME_MAX]);
        frame.drop_front(1);
        assert_eq!(frame.bytes(), [9; FRAME_MAX - 1]);
        assert!(frame.extend(&[7]) && !frame.extend(&[8]));
    }
}
