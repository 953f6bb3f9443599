//! The notation for the bytes of a frame: hexadecimal, quoted texts, and words for computed bytes.

use railbus_wire::{crc16, sum8};

/// Parses the bytes of a line such as `01 05 003C FF00 crc`: hexadecimal, quoted texts, and `crc`,
/// `sum` and `cr` for the end of a frame.
///
/// # Errors
/// Why it can't be parsed.
pub fn bytes(line: &str) -> Result<Vec<u8>, String> {
    let mut frame = Frame::default();
    let mut rest = line.trim();
    while !rest.is_empty() {
        if let Some(text) = rest.strip_prefix('"') {
            let (text, after) = text.split_once('"').ok_or("a text has no end")?;
            frame.bytes.extend(text.as_bytes());
            rest = after.trim_start();
        } else {
            let end = rest.find(|c: char| c.is_whitespace()).unwrap_or(rest.len());
            frame.word(&rest[..end])?;
            rest = rest[end..].trim_start();
        }
    }
    Ok(frame.bytes)
}

#[derive(Default)]
struct Frame {
    bytes: Vec<u8>,
    /// Where the last of several frames begins.
    start: usize,
}

impl Frame {
    fn word(&mut self, word: &str) -> Result<(), String> {
        match word {
            "crc" => {
                let crc = crc16(&self.bytes[self.start..]);
                self.bytes.extend(crc.to_le_bytes());
                self.start = self.bytes.len();
            }
            "cr" => {
                self.bytes.push(b'\r');
                self.start = self.bytes.len();
            }
            "sum" => self.sum(),
            _ => self.bytes.extend(hex(word)?),
        }
        Ok(())
    }

    /// Appends the sum of the frame's protocol, which its first byte determines.
    fn sum(&mut self) {
        let frame = &self.bytes[self.start..];
        match frame.first() {
            // LC-02: the two start bytes are not included [EDA §3.1].
            Some(0x4C | 0x6C) => self.bytes.push(sum8(frame.get(2..).unwrap_or_default())),
            Some(0x55 | 0x22) => {
                self.bytes.push(sum8(frame));
                self.start = self.bytes.len();
            }
            _ => self.bytes.extend(format!("{:02X}", sum8(frame)).as_bytes()),
        }
    }
}

fn hex(word: &str) -> Result<Vec<u8>, String> {
    let digits: Option<Vec<u8>> = word
        .chars()
        .map(|c| c.to_digit(16).map(|digit| digit as u8))
        .collect();
    match digits {
        Some(digits) if digits.len().is_multiple_of(2) => Ok(digits
            .chunks(2)
            .map(|pair| pair[0] << 4 | pair[1])
            .collect()),
        _ => Err(format!(
            "`{word}` is neither hexadecimal nor crc, sum or cr"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::bytes;

    #[test]
    fn each_protocol_has_its_own_seal() {
        let same = [
            ("01 05 003C FF00 crc", "01 05 00 3C FF 00 4C 36"),
            ("\"$016\" sum cr", "24 30 31 36 42 42 0D"),
            ("4C57 01 03 sum cr", "4C 57 01 03 04 0D"),
            ("55 01 12 00000001 sum", "55 01 12 00 00 00 01 69"),
            (
                "55 01 12 00000001 sum 55 01 12 00000001 sum",
                "55 01 12 00 00 00 01 69 55 01 12 00 00 00 01 69",
            ),
        ];
        for (short, long) in same {
            assert_eq!(bytes(short), bytes(long), "{short}");
        }
    }

    #[test]
    fn what_is_no_byte() {
        for wrong in ["0", "01 G0", "\"$016", "CRC", "sum8"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }
}
