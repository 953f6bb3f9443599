//! The smallest possible programs: the same bytes in and out as the jobs and the same checks, with
//! every field hard-coded. Nothing here is general, so only other arithmetic could be faster.

use std::hint::black_box;

/// The result of a floor: how many bytes it wrote, and the value it read.
type Done = Option<(usize, u32)>;

const CRC_TABLE: [u16; 256] = {
    let mut table = [0; 256];
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
        table[byte] = crc;
        byte += 1;
    }
    table
};

fn crc(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF;
    for byte in bytes {
        crc = (crc >> 8) ^ CRC_TABLE[usize::from(crc as u8 ^ byte)];
    }
    crc
}

fn sum(bytes: &[u8]) -> u8 {
    bytes
        .iter()
        .fold(0, |sum: u8, byte| sum.wrapping_add(*byte))
}

fn put_crc(out: &mut [u8], len: usize) -> usize {
    let crc = crc(&out[..len]);
    out[len] = crc as u8;
    out[len + 1] = (crc >> 8) as u8;
    len + 2
}

fn hex(byte: u8) -> [u8; 2] {
    let digit = |nibble: u8| {
        if nibble < 10 {
            b'0' + nibble
        } else {
            b'A' - 10 + nibble
        }
    };
    [digit(byte >> 4), digit(byte & 15)]
}

/// A module accepts upper case only, a host either.
fn unhex(digit: u8, lower_case: bool) -> Option<u8> {
    match digit {
        b'0'..=b'9' => Some(digit - b'0'),
        b'A'..=b'F' => Some(digit - b'A' + 10),
        b'a'..=b'f' if lower_case => Some(digit - b'a' + 10),
        _ => None,
    }
}

fn unhex_byte(digits: &[u8], lower_case: bool) -> Option<u8> {
    Some(unhex(digits[0], lower_case)? << 4 | unhex(digits[1], lower_case)?)
}

/// Appends the sum and the CR of an ASCII frame.
fn put_ascii_end(out: &mut [u8], len: usize) -> usize {
    let sum = hex(sum(&out[..len]));
    out[len] = sum[0];
    out[len + 1] = sum[1];
    out[len + 2] = b'\r';
    len + 3
}

/// An ASCII frame ends with its first CR and nothing else, so even the smallest program looks for
/// it.
fn ascii_is_whole(rx: &[u8], len: usize) -> bool {
    rx.iter().position(|&character| character == b'\r') == Some(len - 1)
        && rx[len - 3..len - 1] == hex(sum(&rx[..len - 3]))
}

pub fn rtu_server_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    if rx.len() != 8 || rx[..6] != [black_box(1), 1, 0, 0, 0, 16] || crc(rx) != 0 {
        return None;
    }
    let state = black_box(0x0311u16);
    out[..5].copy_from_slice(&[rx[0], 1, 2, state as u8, (state >> 8) as u8]);
    Some((put_crc(out, 5), 0))
}

pub fn rtu_server_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    if rx.len() != 8 || rx[..2] != [black_box(1), 5] || rx[2] != 0 || crc(rx) != 0 {
        return None;
    }
    let on = rx[4] == 0xFF;
    out[..6].copy_from_slice(&rx[..6]);
    Some((put_crc(out, 6), u32::from(on) << 8 | u32::from(rx[3])))
}

pub fn rtu_client_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    out[..6].copy_from_slice(&[black_box(1), 1, 0, black_box(0), 0, black_box(16)]);
    let len = put_crc(out, 6);
    if rx.len() != 7 || rx[..3] != [out[0], 1, 2] || crc(rx) != 0 {
        return None;
    }
    Some((len, u32::from(rx[4]) << 8 | u32::from(rx[3])))
}

pub fn rtu_client_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    out[..6].copy_from_slice(&[black_box(1), 5, 0, black_box(3), 0xFF, 0]);
    let len = put_crc(out, 6);
    if rx.len() != 8 || rx[..6] != out[..6] || crc(rx) != 0 {
        return None;
    }
    Some((len, 1))
}

pub fn ascii_server_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    if !ascii_is_whole(rx, 7) || rx[0] != b'$' || rx[3] != b'6' {
        return None;
    }
    if unhex_byte(&rx[1..3], false)? != black_box(1) {
        return None;
    }
    let (outputs, inputs) = (hex(black_box(0x11)), hex(black_box(0x22)));
    let [a, b] = outputs;
    let [c, d] = inputs;
    out[..7].copy_from_slice(&[b'!', a, b, c, d, b'0', b'0']);
    Some((put_ascii_end(out, 7), 0))
}

pub fn ascii_server_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    if !ascii_is_whole(rx, 10) || rx[0] != b'#' {
        return None;
    }
    if unhex_byte(&rx[1..3], false)? != black_box(1) {
        return None;
    }
    let (order, data) = (unhex_byte(&rx[3..5], false)?, unhex_byte(&rx[5..7], false)?);
    out[0] = b'>';
    Some((
        put_ascii_end(out, 1),
        u32::from(order) << 8 | u32::from(data),
    ))
}

pub fn ascii_client_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    let [high, low] = hex(black_box(1));
    out[..4].copy_from_slice(&[b'$', high, low, b'6']);
    let len = put_ascii_end(out, 4);
    if !ascii_is_whole(rx, 10) || rx[0] != b'!' || rx[5..7] != *b"00" {
        return None;
    }
    let (outputs, inputs) = (unhex_byte(&rx[1..3], true)?, unhex_byte(&rx[3..5], true)?);
    Some((len, u32::from(outputs) << 8 | u32::from(inputs)))
}

pub fn ascii_client_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    let [a, b] = hex(black_box(1));
    let [c, d] = hex(black_box(0x13));
    let [e, f] = hex(black_box(1));
    out[..7].copy_from_slice(&[b'#', a, b, c, d, e, f]);
    let len = put_ascii_end(out, 7);
    (ascii_is_whole(rx, 4) && rx[0] == b'>').then_some((len, 1))
}

/// Appends sum and end byte of an LC-02 frame.
fn put_lc02_end(out: &mut [u8], len: usize) -> usize {
    out[len] = sum(&out[2..len]);
    out[len + 1] = 0x0D;
    len + 2
}

fn lc02_is_whole(rx: &[u8], start: [u8; 2], len: usize) -> bool {
    rx.len() == len
        && rx[..2] == start
        && rx[len - 1] == 0x0D
        && rx[len - 2] == sum(&rx[2..len - 2])
}

pub fn lc02_server_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    if !lc02_is_whole(rx, *b"LW", 6) || rx[2..4] != [black_box(1), 3] {
        return None;
    }
    out[..5].copy_from_slice(&[0x6C, 0x63, rx[2], black_box(0x11), black_box(0x22)]);
    Some((put_lc02_end(out, 5), 0))
}

pub fn lc02_server_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    if !lc02_is_whole(rx, *b"LW", 8) || rx[2..4] != [black_box(1), 4] || rx[4] > 7 || rx[5] > 1 {
        return None;
    }
    out[..3].copy_from_slice(&[0x6C, 0x63, rx[2]]);
    Some((
        put_lc02_end(out, 3),
        u32::from(rx[5]) << 8 | u32::from(rx[4]),
    ))
}

pub fn lc02_client_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    out[..4].copy_from_slice(&[0x4C, 0x57, black_box(1), 3]);
    let len = put_lc02_end(out, 4);
    if !lc02_is_whole(rx, *b"lc", 7) || rx[2] != out[2] {
        return None;
    }
    Some((len, u32::from(rx[3]) << 8 | u32::from(rx[4])))
}

pub fn lc02_client_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    out[..6].copy_from_slice(&[0x4C, 0x57, black_box(1), 4, black_box(3), 1]);
    let len = put_lc02_end(out, 6);
    (lc02_is_whole(rx, *b"lc", 5) && rx[2] == out[2]).then_some((len, 1))
}

fn put_r55(out: &mut [u8], head: [u8; 3], word: u32) -> usize {
    out[..3].copy_from_slice(&head);
    out[3..7].copy_from_slice(&word.to_be_bytes());
    out[7] = sum(&out[..7]);
    8
}

fn r55_is_whole(rx: &[u8], head: [u8; 3]) -> bool {
    rx.len() == 8 && rx[..3] == head && rx[7] == sum(&rx[..7])
}

fn r55_word(rx: &[u8]) -> u32 {
    u32::from_be_bytes([rx[3], rx[4], rx[5], rx[6]])
}

pub fn r55_server_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    let head = [0x55, black_box(1), 0x10];
    r55_is_whole(rx, head).then(|| (put_r55(out, [0x22, head[1], 0x10], black_box(0x0311)), 0))
}

pub fn r55_server_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    let head = [0x55, black_box(1), 0x12];
    if !r55_is_whole(rx, head) || rx[6] == 0 || rx[6] > 32 {
        return None;
    }
    let learned = 1 << 8 | u32::from(rx[6] - 1);
    Some((
        put_r55(out, [0x22, head[1], 0x12], black_box(0x0311)),
        learned,
    ))
}

pub fn r55_client_read(rx: &[u8], out: &mut [u8; 256]) -> Done {
    let address = black_box(1);
    let len = put_r55(out, [0x55, address, 0x10], 0);
    r55_is_whole(rx, [0x22, address, 0x10]).then(|| (len, r55_word(rx)))
}

pub fn r55_client_write(rx: &[u8], out: &mut [u8; 256]) -> Done {
    let address = black_box(1);
    let len = put_r55(out, [0x55, address, 0x12], u32::from(black_box(3u8)) + 1);
    r55_is_whole(rx, [0x22, address, 0x12]).then(|| (len, r55_word(rx)))
}
