//! Bytes in hexadecimal, as printed in datasheets.

/// `03 05 00 3C`.
pub fn spaced(bytes: &[u8]) -> String {
    let digits: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    digits.join(" ")
}

/// Parses bytes as people paste them: `03 05`, `0305`, `0x03,0x05`, `03h 05h`, `03:05`. An ASCII
/// frame may be given as text, `$016`; its terminator is added.
pub fn parse(text: &str) -> Option<Vec<u8>> {
    let text = text.trim();
    if text.starts_with(['$', '#', '%', '@', '~', '!', '>', '?']) {
        let frame = text.trim_end_matches("<CR>").trim_end_matches("\\r");
        return Some(ascii(frame));
    }
    let mut bytes = Vec::new();
    for word in text.split(|c: char| c.is_whitespace() || ",;:-".contains(c)) {
        let word = word
            .strip_prefix("0x")
            .or_else(|| word.strip_prefix("0X"))
            .unwrap_or(word);
        let word = word.strip_suffix(['h', 'H']).unwrap_or(word);
        let digits = word.bytes().all(|byte| byte.is_ascii_hexdigit());
        if word.len() % 2 == 1 && word.len() > 1 || !digits {
            return None;
        }
        let mut rest = word;
        while !rest.is_empty() {
            let (byte, next) = rest.split_at(rest.len().min(2));
            bytes.push(u8::from_str_radix(byte, 16).ok()?);
            rest = next;
        }
    }
    (!bytes.is_empty()).then_some(bytes)
}

/// An ASCII frame with its terminator.
pub fn ascii(frame: &str) -> Vec<u8> {
    let mut bytes = frame.as_bytes().to_vec();
    bytes.push(railbus_wire::ascii::CR);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_read_as_people_paste_them() {
        let all = [
            "55 04 0a",
            "55040A",
            "0x55,0x04,0x0A",
            "55h 04h 0Ah",
            "55:4:a",
            " 55\n04 0A ",
        ];
        for text in all {
            assert_eq!(parse(text), Some(vec![0x55, 0x04, 0x0A]), "{text}");
        }
        assert_eq!(parse("$016"), Some(b"$016\r".to_vec()));
        assert_eq!(parse("!019060<CR>"), Some(b"!019060\r".to_vec()));
        for wrong in ["", "xx", "555", "+5", "吸合"] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
        assert_eq!(spaced(&[0x03, 0xF5]), "03 F5");
    }
}
