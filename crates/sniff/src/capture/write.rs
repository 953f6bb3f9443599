//! Writes blocks.

use super::{Direction, ENHANCED_PACKET, INTERFACE, LINK_TYPE, MAGIC, SECTION, option};
use railbus_wire::Instant;

/// The longest text of an option; longer ones are truncated.
const TEXT_MAX: usize = 4_096;
/// Times count microseconds: ten to the power of minus this.
const MICROSECONDS: u8 = 6;

/// The beginning of a file written by this program.
#[must_use]
pub fn header(program: &str) -> Vec<u8> {
    let mut body = MAGIC.to_le_bytes().to_vec();
    body.extend([1, 0, 0, 0]); // Version 1.0.
    body.extend([0xFF; 8]); // The section's length is not specified.
    text(&mut body, option::USER_APPLICATION, program);
    block(SECTION, body)
}

/// A line, written before its packets; lines are numbered from 0 in this order.
#[must_use]
pub fn interface(name: &str, description: &str) -> Vec<u8> {
    let mut body = LINK_TYPE.to_le_bytes().to_vec();
    body.extend([0; 6]); // Reserved, and packets of any length.
    text(&mut body, option::IF_NAME, name);
    text(&mut body, option::IF_DESCRIPTION, description);
    add(&mut body, option::IF_TSRESOL, &[MICROSECONDS]);
    block(INTERFACE, body)
}

/// A frame on a line.
#[must_use]
pub fn packet(
    line: u32,
    at: Instant,
    bytes: &[u8],
    direction: Option<Direction>,
    comment: &str,
) -> Vec<u8> {
    let len = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
    let words = [line, (at.0 >> 32) as u32, at.0 as u32, len, len];
    let mut body: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    body.extend(bytes);
    pad(&mut body);
    text(&mut body, option::COMMENT, comment);
    if let Some(direction) = direction {
        let flags: u32 = match direction {
            Direction::In => 1,
            Direction::Out => 2,
        };
        add(&mut body, option::EPB_FLAGS, &flags.to_le_bytes());
    }
    block(ENHANCED_PACKET, body)
}

/// Wraps a block, and ends its options.
fn block(kind: u32, mut body: Vec<u8>) -> Vec<u8> {
    body.extend(option::END.to_le_bytes());
    body.extend([0, 0]);
    let len = u32::try_from(body.len() + 12).unwrap_or(u32::MAX);
    let mut block = Vec::with_capacity(body.len() + 12);
    block.extend(kind.to_le_bytes());
    block.extend(len.to_le_bytes());
    block.extend(body);
    block.extend(len.to_le_bytes());
    block
}

fn text(body: &mut Vec<u8>, code: u16, text: &str) {
    if text.is_empty() {
        return;
    }
    let mut len = text.len().min(TEXT_MAX);
    while !text.is_char_boundary(len) {
        len -= 1;
    }
    add(body, code, text.get(..len).unwrap_or_default().as_bytes());
}

fn add(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    body.extend(code.to_le_bytes());
    body.extend((value.len() as u16).to_le_bytes());
    body.extend(value);
    pad(body);
}

/// Pads to a multiple of four.
fn pad(body: &mut Vec<u8>) {
    body.resize(body.len().next_multiple_of(4), 0);
}
