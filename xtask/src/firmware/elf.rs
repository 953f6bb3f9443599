//! The parts of an ELF file that are needed to tell how large a program is.

use std::collections::BTreeMap;

/// What a program needs, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Needs {
    /// Vectors, code, constants and initial values.
    pub(super) flash: u32,
    /// Static memory.
    pub(super) ram: u32,
}

/// Section flags: writable, and loaded while the program runs.
const WRITABLE: u32 = 1;
const ALLOCATED: u32 = 2;
/// The type of a section without contents in the file.
const EMPTY: u32 = 8;

/// The type of the section of symbols.
const SYMBOLS: u32 = 2;

/// A section of the file.
#[derive(Clone, Copy)]
struct Section {
    kind: u32,
    flags: u32,
    address: u32,
    offset: u32,
    bytes: u32,
    link: u32,
}

/// The sections of a 32-bit little-endian ELF; none if the file is not one.
fn sections(file: &[u8]) -> Option<Vec<Section>> {
    if !file.starts_with(b"\x7fELF\x01\x01") {
        return None;
    }
    let table = word(file, 32)? as usize;
    let (size, count) = (half(file, 46)?, half(file, 48)?);
    let section = |index: u16| {
        let at = table + usize::from(index) * usize::from(size);
        Some(Section {
            kind: word(file, at + 4)?,
            flags: word(file, at + 8)?,
            address: word(file, at + 12)?,
            offset: word(file, at + 16)?,
            bytes: word(file, at + 20)?,
            link: word(file, at + 24)?,
        })
    };
    (0..count).map(section).collect()
}

/// What an image needs; none if the file is not one.
pub(super) fn needs(file: &[u8]) -> Option<Needs> {
    let mut needs = Needs::default();
    for section in sections(file)? {
        if section.flags & ALLOCATED == 0 {
            continue;
        }
        if section.kind != EMPTY {
            needs.flash += section.bytes;
        }
        if section.flags & WRITABLE != 0 {
            needs.ram += section.bytes;
        }
    }
    Some(needs)
}

/// The code of an image and its layout.
pub(super) struct Code<'a> {
    /// The entry point.
    pub(super) entry: u32,
    /// The vectors at address 0.
    pub(super) vectors: Vec<u32>,
    /// Where each function begins, and its size in bytes.
    pub(super) functions: BTreeMap<u32, u32>,
    /// From there on: is it data?
    pub(super) marks: BTreeMap<u32, bool>,
    /// Sections with their addresses.
    pub(super) parts: Vec<(u32, &'a [u8])>,
}

/// The code of an image; none if the file is not one, or has no symbols.
pub(super) fn code(file: &[u8]) -> Option<Code<'_>> {
    let sections = sections(file)?;
    let bytes = |section: &Section| {
        let rest = file.get(section.offset as usize..)?;
        rest.get(..section.bytes as usize)
    };
    let symbols = sections.iter().find(|section| section.kind == SYMBOLS)?;
    let names = bytes(sections.get(symbols.link as usize)?)?;
    let there = |section: &&Section| section.flags & ALLOCATED != 0 && section.kind != EMPTY;
    let parts = sections.iter().filter(there);
    let parts: Vec<_> = parts
        .filter_map(|part| Some((part.address, bytes(part)?)))
        .collect();
    let vectors = parts.iter().find(|(address, _)| *address == 0)?.1;
    let vectors = vectors.as_chunks::<4>().0;
    let mut code = Code {
        entry: word(file, 24)?,
        vectors: vectors
            .iter()
            .map(|word| u32::from_le_bytes(*word))
            .collect(),
        functions: BTreeMap::new(),
        marks: BTreeMap::new(),
        parts,
    };
    for symbol in bytes(symbols)?.as_chunks::<16>().0 {
        code.note(symbol, names)?;
    }
    Some(code)
}

impl Code<'_> {
    /// Reads a symbol, if it is a function or marks code or data.
    fn note(&mut self, symbol: &[u8; 16], names: &[u8]) -> Option<()> {
        /// The type of a function among the lower bits of its kind.
        const FUNCTION: u8 = 2;
        let (value, len) = (word(symbol, 4)?, word(symbol, 8)?);
        let name = names.get(word(symbol, 0)? as usize..)?;
        if symbol.get(12)? & 0xF == FUNCTION {
            let known = self.functions.entry(value & !1).or_default();
            *known = len.max(*known);
        } else if let [b'$', kind @ (b't' | b'd'), b'\0' | b'.', ..] = name {
            self.marks.insert(value, *kind == b'd');
        }
        Some(())
    }

    /// Whether there is data at this address.
    pub(super) fn is_data(&self, at: u32) -> bool {
        self.marks
            .range(..=at)
            .next_back()
            .is_some_and(|(_, data)| *data)
    }

    /// The halfword at this address.
    pub(super) fn half(&self, at: u32) -> Option<u16> {
        self.parts
            .iter()
            .find_map(|(address, bytes)| half(bytes, at.checked_sub(*address)? as usize))
    }
}

fn word(file: &[u8], at: usize) -> Option<u32> {
    file.get(at..)?
        .first_chunk()
        .map(|bytes| u32::from_le_bytes(*bytes))
}

fn half(file: &[u8], at: usize) -> Option<u16> {
    file.get(at..)?
        .first_chunk()
        .map(|bytes| u16::from_le_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with these sections: type, flags, size.
    fn elf(sections: &[(u32, u32, u32)]) -> Vec<u8> {
        let mut file = vec![0; 52];
        file[..6].copy_from_slice(b"\x7fELF\x01\x01");
        file[32..36].copy_from_slice(&52u32.to_le_bytes());
        file[46..48].copy_from_slice(&40u16.to_le_bytes());
        file[48..50].copy_from_slice(&(sections.len() as u16).to_le_bytes());
        for (kind, flags, size) in sections {
            for word in [0, *kind, *flags, 0, 0, *size, 0, 0, 0, 0] {
                file.extend(word.to_le_bytes());
            }
        }
        file
    }

    #[test]
    fn code_is_in_flash_variables_in_ram_and_first_values_in_both() {
        let (code, data, bss, debug) = ((1, 6, 1000), (1, 3, 20), (8, 3, 300), (1, 0, 9999));
        let needs = needs(&elf(&[code, data, bss, debug]));
        assert_eq!(
            needs,
            Some(Needs {
                flash: 1020,
                ram: 320
            })
        );
    }

    #[test]
    fn what_is_no_elf_or_is_cut_off_needs_nothing_known() {
        assert_eq!(needs(b"#!/bin/sh"), None);
        let whole = elf(&[(1, 6, 1000)]);
        assert_eq!(needs(&whole[..whole.len() - 20]), None);
    }

    #[test]
    fn functions_are_found_and_the_data_between() {
        let code = [0xAAu8; 8];
        let names = b"\0main\0$t\0$d.1\0";
        // Name, value, size, kind and section of each.
        let symbols = [(1, 5, 4, 2u8), (6, 4, 0, 0), (9, 8, 0, 0)];
        let mut file = elf(&[(1, 6, 8), (SYMBOLS, 0, 48), (3, 0, names.len() as u32)]);
        let begin = file.len() as u32;
        for (index, offset) in [(0, begin), (1, begin + 8), (2, begin + 56)] {
            let at = 52 + 40 * index;
            file[at + 16..at + 20].copy_from_slice(&u32::to_le_bytes(offset));
        }
        file[52 + 40 + 24] = 2;
        file[24] = 5;
        file.extend(code);
        for (name, value, len, kind) in symbols {
            for word in [name, value, len, u32::from(kind)] {
                file.extend(u32::to_le_bytes(word));
            }
        }
        file.extend(names);
        let code = super::code(&file).unwrap();
        assert_eq!(code.entry, 5);
        assert_eq!(code.vectors, [0xAAAA_AAAA; 2]);
        assert_eq!(code.functions, BTreeMap::from([(4, 4)]));
        assert_eq!(
            [3, 4, 7, 8].map(|at| code.is_data(at)),
            [false, false, false, true]
        );
        assert_eq!((code.half(6), code.half(7)), (Some(0xAAAA), None));
        assert!(
            super::code(&elf(&[(1, 6, 8)])).is_none(),
            "it has no symbols"
        );
    }
}
