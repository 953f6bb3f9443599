//! A short byte buffer, with a reader and a writer.

/// Up to 128 bytes.
#[derive(Clone, Copy, Debug)]
pub struct Bytes {
    buffer: [u8; Bytes::MAX],
    len: usize,
}

impl Bytes {
    /// The maximum length.
    pub const MAX: usize = 128;

    /// An empty buffer.
    #[must_use]
    pub const fn new() -> Bytes {
        Bytes {
            buffer: [0; Bytes::MAX],
            len: 0,
        }
    }

    /// These bytes; none if there are too many.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Option<Bytes> {
        let mut all = Bytes::new();
        all.push(bytes).then_some(all)
    }

    /// The bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.buffer.get(..self.len).unwrap_or_default()
    }

    /// Removes all bytes.
    pub(crate) const fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends all of these bytes, or none if there are too many.
    pub(crate) fn push(&mut self, bytes: &[u8]) -> bool {
        let end = self.len.saturating_add(bytes.len());
        let Some(room) = self.buffer.get_mut(self.len..end) else {
            return false;
        };
        room.copy_from_slice(bytes);
        self.len = end;
        true
    }

    /// Space for this many bytes, to be filled in; none if there are too many.
    pub(crate) fn room(&mut self, len: usize) -> Option<&mut [u8]> {
        let room = self.buffer.get_mut(..len)?;
        self.len = len;
        Some(room)
    }
}

impl Default for Bytes {
    fn default() -> Bytes {
        Bytes::new()
    }
}

impl PartialEq for Bytes {
    fn eq(&self, other: &Bytes) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Eq for Bytes {}

/// Reads from the front. The caller has checked the length.
pub(crate) struct Reader<'a>(pub(crate) &'a [u8]);

impl Reader<'_> {
    /// The next `N` bytes; if there are fewer, zeros, and none is consumed.
    pub(crate) fn take<const N: usize>(&mut self) -> [u8; N] {
        let Some((taken, rest)) = self.0.split_first_chunk() else {
            return [0; N];
        };
        self.0 = rest;
        *taken
    }

    pub(crate) fn u8(&mut self) -> u8 {
        u8::from_le_bytes(self.take())
    }

    pub(crate) fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    pub(crate) fn i16(&mut self) -> i16 {
        i16::from_le_bytes(self.take())
    }

    pub(crate) fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }
}

/// Writes from the front.
pub(crate) struct Writer<'a>(pub(crate) &'a mut [u8]);

impl Writer<'_> {
    /// Writes these bytes, or none if they do not all fit.
    pub(crate) fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        if let Some((room, rest)) = core::mem::take(&mut self.0).split_first_chunk_mut() {
            *room = bytes;
            self.0 = rest;
        }
    }
}
