//! The two checksums: CRC-16 of Modbus and the 8-bit sum of everything else.

static CRC_TABLE: [u16; 256] = crc_table();

const fn crc_table() -> [u16; 256] {
    let mut table = [0u16; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 {
                (crc >> 1) ^ 0xA001
            } else {
                crc >> 1
            };
            bit += 1;
        }
        #[allow(
            clippy::indexing_slicing,
            reason = "byte < 256, evaluated by the compiler"
        )]
        {
            table[byte] = crc;
        }
        byte += 1;
    }
    table
}

/// CRC-16/MODBUS: polynomial 8005h reflected, start FFFFh. It goes on the wire low byte first
/// [MODBUS §1.2]. Over a frame *with* its CRC the result is 0.
#[must_use]
#[inline]
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        let index = usize::from((crc as u8) ^ byte);
        #[allow(clippy::indexing_slicing, reason = "a byte always indexes 256 entries")]
        let entry = CRC_TABLE[index];
        (crc >> 8) ^ entry
    })
}

/// The low byte of the sum of all bytes, as ASCII, LC-02 and the 0x55 boards use it.
#[must_use]
#[inline]
pub fn sum8(bytes: &[u8]) -> u8 {
    bytes
        .iter()
        .fold(0, |sum: u8, &byte| sum.wrapping_add(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_values() {
        assert_eq!(crc16(b"123456789"), 0x4B37); // the published check value
        assert_eq!(crc16(&[1, 1, 0, 0x3C, 0, 1]), 0xC63D); // printed as 3D C6
        assert_eq!(crc16(&[1, 1, 0, 0x3C, 0, 1, 0x3D, 0xC6]), 0);
        assert_eq!(sum8(b"$016"), 0xBB); // printed as BB
    }
}
