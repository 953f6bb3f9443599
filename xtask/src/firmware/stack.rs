//! How much stack an image needs at most: computed from its code, so that no trial has to find the
//! deepest path.
//!
//! A function's frame is what its instructions subtract from the stack pointer, and the path
//! continues along its calls and jumps. That is a bound as long as no function is called through a
//! register, none is recursive, and none subtracts a computed amount. If one does, the result is an
//! error instead of a wrong number.

use std::collections::{BTreeMap, BTreeSet};

use super::elf::Code;

/// What the processor pushes onto the stack when an interrupt begins: eight words, and one for
/// alignment to a multiple of eight bytes.
const INTERRUPTED: u32 = 36;

/// The vectors that can't be masked: the watchdog's warning and a fault.
const UNSTOPPABLE: std::ops::Range<usize> = 2..4;

/// A function as found in the code.
#[derive(Debug, Default, PartialEq)]
struct Function {
    frame: u32,
    calls: BTreeSet<u32>,
}

/// The most stack that is ever in use, in bytes: the program, interrupted at its deepest point, and
/// that by an interrupt that can't be masked. The other interrupts do not interrupt each other. An
/// error names what has no bound.
pub(super) fn most(code: &Code<'_>) -> Result<u32, String> {
    let functions = functions(code)?;
    let mut known = BTreeMap::new();
    let mut down = |from: u32| deepest(from, &functions, &mut known, &mut Vec::new());
    let mut most = down(code.entry & !1)?;
    let mut interrupt = 0;
    for (index, vector) in code.vectors.iter().enumerate().skip(UNSTOPPABLE.start) {
        let Some(handler) = vector.checked_sub(1) else {
            continue;
        };
        let takes = INTERRUPTED + down(handler)?;
        if UNSTOPPABLE.contains(&index) {
            most += takes;
        } else {
            interrupt = interrupt.max(takes);
        }
    }
    Ok(most + interrupt)
}

/// The deepest path from a function.
fn deepest(
    from: u32,
    functions: &BTreeMap<u32, Function>,
    known: &mut BTreeMap<u32, u32>,
    way: &mut Vec<u32>,
) -> Result<u32, String> {
    if let Some(deep) = known.get(&from) {
        return Ok(*deep);
    }
    let function = functions
        .get(&from)
        .ok_or_else(|| format!("no function begins at {from:#x}"))?;
    if way.contains(&from) {
        return Err(format!("what is at {from:#x} calls itself"));
    }
    way.push(from);
    let mut below = 0;
    for call in &function.calls {
        below = below.max(deepest(*call, functions, known, way)?);
    }
    way.pop();
    known.insert(from, function.frame + below);
    Ok(function.frame + below)
}

/// All functions by where they begin.
fn functions(code: &Code<'_>) -> Result<BTreeMap<u32, Function>, String> {
    let all = code.functions.iter();
    all.map(|(start, len)| Ok((*start, read(code, *start, *len)?)))
        .collect()
}

fn read(code: &Code<'_>, start: u32, len: u32) -> Result<Function, String> {
    let mut function = Function::default();
    let mut at = start;
    while at < start + len {
        if code.is_data(at) {
            at += 2;
            continue;
        }
        let first = code.half(at).ok_or("code that is not there")?;
        // Instructions of 32 bits begin with 11101, 11110 or 11111.
        let is_wide = first >> 11 >= 0b11101;
        let step = if is_wide {
            let second = code.half(at + 2).ok_or("code that is not there")?;
            wide(first, second)
        } else {
            narrow(first)
        };
        match step {
            Step::Other => {}
            Step::Takes(bytes) => function.frame += bytes,
            Step::Goes(offset) => {
                let to = at.wrapping_add(4).wrapping_add_signed(offset);
                if !(start..start + len).contains(&to) {
                    function.calls.insert(to);
                }
            }
            Step::Unknown => return Err(format!("nobody knows what happens at {at:#x}")),
        }
        at += if is_wide { 4 } else { 2 };
    }
    Ok(function)
}

/// What an instruction does to the stack.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// Nothing.
    Other,
    /// Subtracts so many bytes.
    Takes(u32),
    /// Calls or jumps there, relative to four bytes after its beginning.
    Goes(i32),
    /// A computed address or amount.
    Unknown,
}

/// An instruction of 16 bits (ARMv7-M A5.2).
fn narrow(code: u16) -> Step {
    let bits = u32::from(code);
    match code {
        // push; sub sp, #imm
        0xB400..=0xB5FF => Step::Takes(4 * (bits & 0x1FF).count_ones()),
        0xB080..=0xB0FF => Step::Takes(4 * (bits & 0x7F)),
        // b
        0xE000..=0xE7FF => Step::Goes(signed(bits, 11) << 1),
        // b with a condition; the last two of the sixteen are none
        0xD000..=0xDDFF => Step::Goes(signed(bits, 8) << 1),
        // bx lr ends a function; bx and blx of another register
        0x4770 => Step::Other,
        0x4700..=0x47FF => Step::Unknown,
        // mov sp, and mov pc, from a register
        _ if matches!(code & 0xFF87, 0x4685 | 0x4687) => Step::Unknown,
        _ => Step::Other,
    }
}

/// An instruction of 32 bits (ARMv7-M A5.3).
fn wide(first: u16, second: u16) -> Step {
    let (high, low) = (u32::from(first), u32::from(second));
    let constant = (high >> 10 & 1) << 11 | (low >> 12 & 7) << 8 | low & 0xFF;
    let to_sp = low & 0x8F00 == 0x0D00;
    // Without the highest bit of a constant, or the sign of an offset.
    let kind = if first >> 11 == 0b11110 {
        first & 0xFBFF
    } else {
        first
    };
    match (kind, second & 0xD000) {
        // stmdb sp!
        (0xE92D, _) => Step::Takes(4 * low.count_ones()),
        // strd and str [sp, #-imm]!
        (0xE96D, _) => Step::Takes(4 * (low & 0xFF)),
        (0xF84D, _) if low & 0x0F00 == 0x0D00 => Step::Takes(low & 0xFF),
        // sub.w and subw sp, sp, #imm; sub.w sp, sp, register
        (0xF1AD | 0xF1BD, _) if to_sp => Step::Takes(expanded(constant)),
        (0xF2AD, _) if to_sp => Step::Takes(constant),
        (0xEBAD, _) if low & 0x0F00 == 0x0D00 => Step::Unknown,
        // ldr pc; but for ldr pc, [sp], #4, which ends a function
        (0xF850..=0xF85F | 0xF8D0..=0xF8DF, _) if low >> 12 == 15 && second != 0xFB04 => {
            Step::Unknown
        }
        // bl and b.w; b.w with a condition
        (0xF000..=0xF3FF, 0xD000 | 0x9000) => {
            let sign = high >> 10 & 1;
            let bit = |at: u32| low >> at & 1 ^ sign ^ 1;
            let far = sign << 23 | bit(13) << 22 | bit(11) << 21;
            let near = (high & 0x3FF) << 11 | low & 0x7FF;
            Step::Goes(signed(far | near, 24) << 1)
        }
        (0xF000..=0xF3FF, 0x8000) if high >> 7 & 7 != 7 => {
            let far = (high >> 10 & 1) << 19 | (low >> 11 & 1) << 18 | (low >> 13 & 1) << 17;
            let near = (high & 0x3F) << 11 | low & 0x7FF;
            Step::Goes(signed(far | near, 20) << 1)
        }
        _ => Step::Other,
    }
}

/// A constant as encoded in instructions (ARMv7-M A5.3.2).
fn expanded(constant: u32) -> u32 {
    let byte = constant & 0xFF;
    match constant >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (byte | 0x80).rotate_right(constant >> 7),
    }
}

/// The lowest bits as a signed number.
fn signed(bits: u32, count: u32) -> i32 {
    ((bits << (32 - count)) as i32) >> (32 - count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_takes_from_the_stack_is_seen() {
        assert_eq!(narrow(0xB5F0), Step::Takes(20), "push r4-r7, lr");
        assert_eq!(narrow(0xB084), Step::Takes(16), "sub sp, #16");
        assert_eq!(narrow(0xB004), Step::Other, "add sp, #16");
        assert_eq!(narrow(0xBDF0), Step::Other, "pop r4-r7, pc");
        assert_eq!(wide(0xE92D, 0x0F00), Step::Takes(16), "push.w r8-r11");
        assert_eq!(wide(0xF84D, 0x8D04), Step::Takes(4), "str r8, [sp, #-4]!");
        assert_eq!(
            wide(0xE96D, 0x2304),
            Step::Takes(16),
            "strd r2, r3, [sp, #-16]!"
        );
        assert_eq!(wide(0xF5AD, 0x7D0E), Step::Takes(568), "sub.w sp, sp, #568");
        assert_eq!(
            wide(0xF2AD, 0x4D04),
            Step::Takes(1028),
            "subw sp, sp, #1028"
        );
        assert_eq!(
            wide(0xF6AD, 0x0D04),
            Step::Takes(2052),
            "subw sp, sp, #2052"
        );
        assert_eq!(wide(0xF1A7, 0x0D0C), Step::Other, "sub.w sp, r7, #12");
        assert_eq!(wide(0xF8C0, 0x1004), Step::Other, "str.w r1, [r0, #4]");
    }

    #[test]
    fn what_is_computed_has_no_bound() {
        assert_eq!(narrow(0x4770), Step::Other, "bx lr");
        assert_eq!(narrow(0x4718), Step::Unknown, "bx r3");
        assert_eq!(narrow(0x4798), Step::Unknown, "blx r3");
        assert_eq!(narrow(0x46A5), Step::Unknown, "mov sp, r4");
        assert_eq!(narrow(0x469F), Step::Unknown, "mov pc, r3");
        assert_eq!(wide(0xEBAD, 0x0D03), Step::Unknown, "sub.w sp, sp, r3");
        assert_eq!(wide(0xF8DF, 0xF004), Step::Unknown, "ldr.w pc, [pc, #4]");
        assert_eq!(wide(0xF85D, 0xFB04), Step::Other, "ldr pc, [sp], #4");
    }

    #[test]
    fn calls_and_jumps_lead_where_they_do() {
        assert_eq!(narrow(0xE7FE), Step::Goes(-4), "b to itself");
        assert_eq!(narrow(0xD001), Step::Goes(2), "beq");
        assert_eq!(wide(0xF000, 0xF802), Step::Goes(4), "bl");
        assert_eq!(wide(0xF7FF, 0xFFFE), Step::Goes(-4), "bl to itself");
        assert_eq!(wide(0xF001, 0xB802), Step::Goes(0x1004), "b.w");
        assert_eq!(wide(0xF43F, 0xAFFE), Step::Goes(-4), "beq.w to itself");
        assert_eq!(wide(0xF3BF, 0x8F4F), Step::Other, "dsb");
    }

    /// An image of halfwords from 16 on, with functions of these sizes in bytes, the first being
    /// the entry point; its third vector is the one after it.
    fn most_of(
        halves: &[u16],
        functions: &[(u32, u32)],
        data: &[(u32, bool)],
    ) -> Result<u32, String> {
        let bytes: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        let code = Code {
            entry: functions[0].0 | 1,
            vectors: vec![0x2000_4000, 17, functions[1].0 | 1],
            functions: functions.iter().copied().collect(),
            marks: data.iter().copied().collect(),
            parts: vec![(16, &bytes)],
        };
        most(&code)
    }

    #[test]
    fn the_longest_way_counts_and_an_interrupt_at_its_end() {
        // push {r4, lr}; bl 28; nothing | sub sp, #8; nothing | push {r4-r7, lr}; b.w 24
        let halves = [
            0xB510, 0xF000, 0xF803, 0xBD10, 0xB082, 0xBF00, 0xB5F0, 0xF7FF, 0xBFFB, 0xBF00,
        ];
        let functions = [(16, 8), (24, 4), (28, 8)];
        assert_eq!(
            most_of(&halves, &functions, &[]),
            Ok(8 + 20 + 8 + INTERRUPTED + 8)
        );
        // What follows the second instruction is data.
        let data = [(30, true)];
        assert_eq!(
            most_of(&halves, &functions, &data),
            Ok(8 + 20 + INTERRUPTED + 8)
        );
    }

    #[test]
    fn what_calls_itself_has_no_bound() {
        // bl 20; nothing | bl 16; nothing
        let halves = [0xF000, 0xF800, 0xF7FF, 0xFFFC];
        let found = most_of(&halves, &[(16, 4), (20, 4)], &[]);
        assert!(found.is_err_and(|why| why.contains("calls itself")));
        // blx r3
        let found = most_of(&[0x4798, 0x4770], &[(16, 2), (18, 2)], &[]);
        assert!(found.is_err_and(|why| why.contains("0x10")));
    }
}
