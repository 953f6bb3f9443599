//! Inputs from a seed: random bytes, damaged frames, spliced frames and repaired checksums.

/// The generator xorshift64*: small, fast, and the same everywhere.
pub struct Random(u64);

impl Random {
    /// Creates a generator; every seed gives another sequence.
    pub fn new(seed: u64) -> Random {
        // Seeds are small numbers; spread them, and never start at zero.
        Random((seed ^ 0x9E37_79B9_7F4A_7C15).wrapping_mul(0xBF58_476D_1CE4_E5B9) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// A number below `end`, which is not 0.
    pub fn below(&mut self, end: usize) -> usize {
        ((self.next() >> 33) as usize) % end
    }

    fn byte(&mut self) -> u8 {
        self.next() as u8
    }

    fn bytes(&mut self, most: usize) -> Vec<u8> {
        let len = self.below(most + 1);
        (0..len).map(|_| self.byte()).collect()
    }

    /// One input for a target: a few bytes that choose the exchange, then what is received.
    pub fn input(&mut self, corpus: &[Vec<u8>]) -> Vec<u8> {
        let mut input: Vec<u8> = (0..crate::targets::CHOICE).map(|_| self.byte()).collect();
        let mut frame = match self.below(8) {
            0 => self.bytes(300),
            1 => self.bytes(16),
            _ => self.pick(corpus),
        };
        for _ in 0..self.below(4) {
            self.mutate(&mut frame, corpus);
        }
        if self.below(2) == 0 {
            self.repair(&mut frame);
        }
        input.extend(frame);
        input
    }

    fn pick(&mut self, corpus: &[Vec<u8>]) -> Vec<u8> {
        match corpus.len() {
            0 => Vec::new(),
            len => corpus[self.below(len)].clone(),
        }
    }

    /// One random change.
    fn mutate(&mut self, frame: &mut Vec<u8>, corpus: &[Vec<u8>]) {
        /// Bytes with a meaning in one of the codecs.
        const SPECIAL: &[u8] =
            b"\x00\x01\x0D\x0F\x10\x7F\x80\xFF\x55\x22\x4C\x57\x6C\x63\xF5$%#@~!>?*0Aa";
        let at = self.below(frame.len() + 1);
        match self.below(8) {
            0 => frame.truncate(at),
            1 => frame.insert(at, self.byte()),
            2 => frame.extend(self.bytes(4)),
            3 => {
                let other = self.pick(corpus);
                frame.splice(at..at, other);
            }
            4 => frame.drain(..at).for_each(drop),
            change => {
                if let Some(byte) = frame.get_mut(at) {
                    *byte = match change {
                        5 => *byte ^ (1 << self.below(8)),
                        6 => SPECIAL[self.below(SPECIAL.len())],
                        _ => self.byte(),
                    };
                }
            }
        }
    }

    /// Repairs a checksum, so that the checks behind it are reached.
    fn repair(&mut self, frame: &mut Vec<u8>) {
        let len = frame.len();
        match (self.below(4), frame.first().copied()) {
            (0, _) if len >= 4 => {
                frame.truncate(len - 2);
                let crc = railbus_wire::crc16(frame);
                frame.extend(crc.to_le_bytes());
            }
            (_, Some(0x4C | 0x6C)) if len >= 5 => {
                frame[len - 2] = railbus_wire::sum8(&frame[2..len - 2]);
                frame[len - 1] = 0x0D;
            }
            (_, Some(0x55 | 0x22)) if len >= 8 => {
                frame[7] = railbus_wire::sum8(&frame[..7]);
            }
            (_, Some(b'$' | b'%' | b'#' | b'@' | b'~' | b'!' | b'>' | b'?')) if len >= 4 => {
                frame.truncate(len - 3);
                let sum = railbus_wire::sum8(frame);
                frame.extend(format!("{sum:02X}\r").into_bytes());
            }
            _ => {}
        }
    }
}
