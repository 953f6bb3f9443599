//! The two checksums: the CRC-16 of Modbus and the 8-bit sum of all other protocols.

/// Entries of the table: 256 process a byte per step, 16 half a byte.
const ENTRIES: usize = if cfg!(feature = "small") { 16 } else { 256 };

static CRC_TABLE: [u16; ENTRIES] = crc_table();

/// The CRC contribution of the lowest bits, for every value the table has.
const fn crc_table<const N: usize>() -> [u16; N] {
    let mut table = [0u16; N];
    let mut low = 0;
    while low < N {
        let mut crc = low as u16;
        let mut bit = 0;
        while bit < N.ilog2() {
            crc = if crc & 1 == 1 {
                (crc >> 1) ^ 0xA001
            } else {
                crc >> 1
            };
            bit += 1;
        }
        #[allow(
            clippy::indexing_slicing,
            reason = "low < N, evaluated by the compiler"
        )]
        {
            table[low] = crc;
        }
        low += 1;
    }
    table
}

/// CRC-16/MODBUS: polynomial 8005h reflected, start FFFFh. It goes on the wire low byte first
/// [MODBUS §1.2]. Over a frame *with* its CRC the result is 0.
#[must_use]
#[cfg_attr(feature = "small", inline(never))]
#[cfg_attr(not(feature = "small"), inline)]
pub fn crc16(bytes: &[u8]) -> u16 {
    crc16_by(&CRC_TABLE, bytes)
}

#[inline]
fn crc16_by<const N: usize>(table: &[u16; N], bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        let mut crc = crc ^ u16::from(byte);
        for _ in 0..8 / N.ilog2() {
            #[allow(clippy::indexing_slicing, reason = "the lowest bits count its entries")]
            let entry = table[usize::from(crc) % N];
            crc = crc >> N.ilog2() ^ entry;
        }
        crc
    })
}

/// The low byte of the sum of all bytes, as ASCII, LC-02 and the 0x55 boards use it.
#[must_use]
#[cfg_attr(feature = "small", inline(never))]
#[cfg_attr(not(feature = "small"), inline)]
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

    #[test]
    fn a_small_table_says_the_same() {
        let bytes: [u8; 256] = core::array::from_fn(|at| (at * 167 + 3) as u8);
        for len in 0..bytes.len() {
            let large = crc16_by::<256>(&crc_table(), &bytes[..len]);
            assert_eq!(crc16_by::<16>(&crc_table(), &bytes[..len]), large);
        }
    }
}
