//! Reads blocks. A file comes from anywhere: every number in it is checked.

use super::{Direction, ENHANCED_PACKET, INTERFACE, MAGIC, SECTION, option};
use railbus_wire::Instant;

/// The longest block. Wireshark's own limit for a packet is a quarter of this.
const BLOCK_MAX: usize = 1 << 20;
/// The most lines in a file.
const INTERFACES_MAX: usize = 1_024;
/// The longest text kept for a line.
const TEXT_MAX: usize = 256;

/// Reads a file block by block, from as much of it as there is.
#[derive(Debug, Default)]
pub struct Reader {
    big_endian: Option<bool>,
    interfaces: Vec<Interface>,
    offset: u64,
}

/// A line in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its name; may be empty.
    pub name: String,
    /// Its description; in our own files the speed and format, as `9600 8N1`.
    pub description: String,
    /// Its link type; [`super::LINK_TYPE`] for frames.
    pub link_type: u16,
    /// The resolution of its times, per second.
    ticks: u128,
}

/// A frame in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// The number of its line.
    pub line: usize,
    /// When it began.
    pub at: Instant,
    /// The whole frame.
    pub bytes: &'a [u8],
    /// Its direction, if the file has it.
    pub direction: Option<Direction>,
    /// Its comment, if the file has one.
    pub comment: Option<&'a str>,
}

/// What the available bytes begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadStep<'a> {
    /// At least this many bytes are missing. At the end of a file there must be none left.
    More(usize),
    /// A frame, with the length of its block.
    Packet(usize, Packet<'a>),
    /// A block of this length with something else.
    Other(usize),
}

/// Where and why a file can't be read any further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Broken {
    /// The offset of the block in the file.
    pub at: u64,
    /// What is wrong with it.
    pub why: Damage,
}

/// What is wrong with a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The file does not begin like a capture file.
    NoCapture,
    /// Its length is impossible, or differs between its two ends.
    Length,
    /// It is too long, or the file has too many lines.
    TooMuch,
    /// A packet of a line that is not in the file.
    Interface,
    /// A packet that is longer than its block.
    Packet,
}

impl Reader {
    /// A reader at the beginning of a file.
    #[must_use]
    pub fn new() -> Reader {
        Reader::default()
    }

    /// The lines found so far, by number.
    #[must_use]
    pub fn interfaces(&self) -> &[Interface] {
        &self.interfaces
    }

    /// Reads the block at the beginning of `rx`. The caller removes the bytes that were read.
    ///
    /// # Errors
    /// [`Broken`]: reading can't continue, because the start of the next block is unknown.
    pub fn next<'a>(&mut self, rx: &'a [u8]) -> Result<ReadStep<'a>, Broken> {
        let at = self.offset;
        let step = self.step(rx).map_err(|why| Broken { at, why })?;
        if let ReadStep::Packet(len, _) | ReadStep::Other(len) = step {
            self.offset += len as u64;
        }
        Ok(step)
    }

    fn step<'a>(&mut self, rx: &'a [u8]) -> Result<ReadStep<'a>, Damage> {
        let Some(head) = rx.first_chunk::<12>() else {
            let known = rx.len().min(4);
            let begins = rx.get(..known) == SECTION.to_le_bytes().get(..known);
            return match self.big_endian {
                None if !begins => Err(Damage::NoCapture),
                _ => Ok(ReadStep::More(12 - rx.len())),
            };
        };
        let [kind, len, magic] = words(head);
        if kind(true) == SECTION {
            // Whatever the byte order was before: each section defines its own.
            self.big_endian = Some(match magic(false) {
                MAGIC => false,
                _ if magic(true) == MAGIC => true,
                _ => return Err(Damage::NoCapture),
            });
            self.interfaces.clear();
        }
        let big = self.big_endian.ok_or(Damage::NoCapture)?;
        let len = len(big) as usize;
        if len < 12 || !len.is_multiple_of(4) {
            return Err(Damage::Length);
        }
        if len > BLOCK_MAX {
            return Err(Damage::TooMuch);
        }
        let Some(block) = rx.get(..len) else {
            return Ok(ReadStep::More(len - rx.len()));
        };
        let fields = Fields { big, bytes: block };
        if fields.word(len - 4) != Some(len as u32) {
            return Err(Damage::Length);
        }
        let body = Fields {
            big,
            bytes: block.get(8..len - 4).unwrap_or_default(),
        };
        match kind(big) {
            INTERFACE => self.interface(body).map(|()| ReadStep::Other(len)),
            ENHANCED_PACKET => self
                .packet(body)
                .map(|packet| ReadStep::Packet(len, packet)),
            _ => Ok(ReadStep::Other(len)),
        }
    }

    fn interface(&mut self, body: Fields<'_>) -> Result<(), Damage> {
        if self.interfaces.len() >= INTERFACES_MAX {
            return Err(Damage::TooMuch);
        }
        let mut interface = Interface {
            name: String::new(),
            description: String::new(),
            link_type: body.half(0).ok_or(Damage::Length)?,
            ticks: 1_000_000,
        };
        for (code, value) in body.options(8) {
            match code {
                option::IF_NAME => interface.name = short(value),
                option::IF_DESCRIPTION => interface.description = short(value),
                option::IF_TSRESOL => {
                    let resolution = value.first().copied().unwrap_or(6);
                    let base: u128 = if resolution & 0x80 == 0 { 10 } else { 2 };
                    let ticks = base.checked_pow(u32::from(resolution & 0x7F));
                    interface.ticks = ticks.ok_or(Damage::Length)?;
                }
                _ => {}
            }
        }
        self.interfaces.push(interface);
        Ok(())
    }

    fn packet<'a>(&self, body: Fields<'a>) -> Result<Packet<'a>, Damage> {
        let word = |at| body.word(at).ok_or(Damage::Packet);
        let line = word(0)? as usize;
        let interface = self.interfaces.get(line).ok_or(Damage::Interface)?;
        let ticks = u128::from(word(4)?) << 32 | u128::from(word(8)?);
        let len = word(12)? as usize;
        let end = len.checked_add(20).ok_or(Damage::Packet)?;
        let bytes = body.bytes.get(20..end).ok_or(Damage::Packet)?;
        let mut packet = Packet {
            line,
            at: micros(ticks, interface.ticks),
            bytes,
            direction: None,
            comment: None,
        };
        for (code, value) in body.options(end.next_multiple_of(4)) {
            match code {
                option::COMMENT => packet.comment = std::str::from_utf8(value).ok(),
                option::EPB_FLAGS => {
                    let flags = Fields {
                        big: body.big,
                        bytes: value,
                    };
                    packet.direction = match flags.word(0).unwrap_or_default() & 3 {
                        1 => Some(Direction::In),
                        2 => Some(Direction::Out),
                        _ => None,
                    };
                }
                _ => {}
            }
        }
        Ok(packet)
    }
}

/// 64 bits of ticks times a million fit into 128 bits.
fn micros(ticks: u128, per_second: u128) -> Instant {
    let micros = ticks * 1_000_000 / per_second.max(1);
    Instant(u64::try_from(micros).unwrap_or(u64::MAX))
}

/// Decodes numbers in either byte order.
#[derive(Clone, Copy)]
struct Fields<'a> {
    big: bool,
    bytes: &'a [u8],
}

impl<'a> Fields<'a> {
    fn half(&self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk::<2>()?;
        Some(match self.big {
            true => u16::from_be_bytes(bytes),
            false => u16::from_le_bytes(bytes),
        })
    }

    fn word(&self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk::<4>()?;
        Some(match self.big {
            true => u32::from_be_bytes(bytes),
            false => u32::from_le_bytes(bytes),
        })
    }

    /// The options from an offset on, up to their end or the first truncated one.
    fn options(self, mut at: usize) -> impl Iterator<Item = (u16, &'a [u8])> {
        std::iter::from_fn(move || {
            let code = self.half(at)?;
            let len = usize::from(self.half(at + 2)?);
            let value = self.bytes.get(at + 4..at + 4 + len)?;
            at += 4 + len.next_multiple_of(4);
            (code != option::END).then_some((code, value))
        })
    }
}

/// The first three numbers of a block, in either byte order.
fn words(head: &[u8; 12]) -> [impl Fn(bool) -> u32 + use<>; 3] {
    let head = *head;
    [0, 4, 8].map(|at| {
        move |big| {
            let bytes = head.get(at..).unwrap_or_default();
            Fields { big, bytes }.word(0).unwrap_or_default()
        }
    })
}

fn short(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(text);
    let printable = text.chars().filter(|c| !c.is_control());
    printable.take(TEXT_MAX).collect()
}
