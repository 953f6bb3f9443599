//! As much of an ELF file as it takes to say how large a program is.

/// What a program needs, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Needs {
    pub(super) flash: u32,
    pub(super) ram: u32,
}

/// Flags of a section: it can be written to, it is there while the program runs.
const WRITABLE: u32 = 1;
const ALLOCATED: u32 = 2;
/// The type of a section that takes no room in the file.
const EMPTY: u32 = 8;

/// What a 32-bit little-endian ELF needs; nothing where the file is none.
pub(super) fn needs(file: &[u8]) -> Option<Needs> {
    if !file.starts_with(b"\x7fELF\x01\x01") {
        return None;
    }
    let table = word(file, 32)? as usize;
    let (size, count) = (half(file, 46)?, half(file, 48)?);
    let mut needs = Needs::default();
    for index in 0..count {
        let section = table + usize::from(index) * usize::from(size);
        let (kind, flags) = (word(file, section + 4)?, word(file, section + 8)?);
        let bytes = word(file, section + 20)?;
        if flags & ALLOCATED == 0 {
            continue;
        }
        if kind != EMPTY {
            needs.flash += bytes;
        }
        if flags & WRITABLE != 0 {
            needs.ram += bytes;
        }
    }
    Some(needs)
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
}
