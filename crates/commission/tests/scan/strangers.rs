//! Modules that are none of the five families: none is reported as one of the families, and none
//! receives anything but reads. Here they are plain register maps like those of other makers'
//! boards.

use crate::bench::told;
use railbus_bus::Probed;
use railbus_commission::scan::{FoundModule, ProbeOutcome, ScanOptions, ScanStep, Scanner, Scope};
use railbus_wire::{Instant, Micros, Protocol};

/// Replies to requests, without address and CRC: `01 0000 0008` for eight coils.
type Slave<'a> = &'a mut dyn FnMut(&[u8]) -> Option<Vec<u8>>;

fn with_crc(address: u8, body: &[u8]) -> Vec<u8> {
    let mut frame = vec![address];
    frame.extend(body);
    frame.extend(railbus_wire::crc16(&frame).to_le_bytes());
    frame
}

/// Scans a line with one slave on it, which answers Modbus at an address.
fn scan(address: u8, slave: Slave<'_>) -> Vec<FoundModule> {
    let wish = ScanOptions {
        addresses: Some(vec![address]),
        protocols: Some(vec![Protocol::Rtu]),
        ..ScanOptions::default()
    };
    drive(Scope::of(&wish, Vec::new()), &mut |frame| {
        let (crc, asked) = (frame.len() - 2, frame[0]);
        assert!((1..=4).contains(&frame[1]), "no read: {frame:02X?}");
        let reply = (asked == address).then(|| slave(&frame[1..crc]))??;
        Some(with_crc(address, &reply))
    })
}

fn drive(scope: Scope, line: Slave<'_>) -> Vec<FoundModule> {
    let mut scanner = Scanner::new(scope);
    let mut now = Instant(0);
    for _ in 0..1_000 {
        let probe = match scanner.next(now) {
            ScanStep::Done => return scanner.found().to_vec(),
            ScanStep::Found(_) => continue,
            ScanStep::Ask(probe) => probe,
        };
        let mut frame = railbus_wire::Frame::new();
        probe.exchange.encode(&mut frame);
        let bytes = line(frame.bytes()).unwrap_or_default();
        now = now + Micros::from_millis(600);
        let outcome = match probe.exchange.find_response(&bytes).1.whole() {
            Some(_) => Probed::Answered,
            None if bytes.is_empty() => Probed::Silent,
            None => Probed::Garbled,
        };
        let after = Micros::from_millis(5);
        scanner.met(
            now,
            ProbeOutcome {
                outcome,
                bytes,
                after,
                late: Vec::new(),
            },
        );
    }
    panic!("it never ends");
}

/// A board's map: how many coils, inputs, registers from where, and what it answers to everything
/// else.
struct Map {
    coils: &'static [(u16, u16)],
    inputs: &'static [(u16, u16)],
    words: &'static [(u16, &'static [u16])],
    /// The exception for addresses outside; `None` if it does not answer to them.
    outside: Option<u8>,
    /// The exception for functions it does not have; `None` if it does not answer to them.
    unknown: Option<u8>,
}

const MAP: Map = Map {
    coils: &[],
    inputs: &[],
    words: &[],
    outside: Some(2),
    unknown: Some(1),
};

impl Map {
    fn answer(&self, request: &[u8]) -> Option<Vec<u8>> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (start, count) = (word(1), word(3));
        let inside = |(first, len): &(u16, u16)| start >= *first && start + count <= first + len;
        let bits = |spans: &[(u16, u16)]| {
            let len = count.div_ceil(8) as u8;
            let reply = || [vec![request[0], len], vec![0; len.into()]].concat();
            spans.iter().any(inside).then(reply)
        };
        let refused = |why: Option<u8>| why.map(|why| vec![request[0] | 0x80, why]);
        let has = |any: bool, reply: Option<Vec<u8>>| match (any, reply) {
            (false, _) => refused(self.unknown),
            (true, Some(reply)) => Some(reply),
            (true, None) => refused(self.outside),
        };
        match request[0] {
            1 => has(!self.coils.is_empty(), bits(self.coils)),
            2 => has(!self.inputs.is_empty(), bits(self.inputs)),
            3 => {
                let of = |(first, words): &(u16, &[u16])| {
                    let at = usize::from(start.checked_sub(*first)?);
                    let words = words.get(at..at + usize::from(count))?;
                    let bytes = words.iter().flat_map(|word| word.to_be_bytes());
                    Some([3, 2 * count as u8].into_iter().chain(bytes).collect())
                };
                has(!self.words.is_empty(), self.words.iter().find_map(of))
            }
            _ => refused(self.unknown),
        }
    }
}

const ZEROS: &[u16] = &[0; 200];

#[test]
fn no_stranger_is_given_the_name_of_a_family() {
    let strangers: [(&str, u8, Map); 9] = [
        (
            "coils where an ERC-8 has its own, and everywhere",
            7,
            Map {
                coils: &[(0, 100)],
                ..MAP
            },
        ),
        (
            "coils from 10 on",
            7,
            Map {
                coils: &[(10, 90)],
                ..MAP
            },
        ),
        (
            "an ERC-8's coils, with inputs",
            7,
            Map {
                coils: &[(60, 8)],
                inputs: &[(0, 8)],
                ..MAP
            },
        ),
        (
            "an ERC-8's coils, other refusals",
            7,
            Map {
                coils: &[(60, 8)],
                outside: Some(3),
                ..MAP
            },
        ),
        (
            "an ERC-8 where there can't be one",
            40,
            Map {
                coils: &[(60, 8)],
                ..MAP
            },
        ),
        (
            "its own address in register 1",
            8,
            Map {
                words: &[(0, &[12, 8, 2, 0, 0, 0, 0, 0, 0, 0])],
                ..MAP
            },
        ),
        (
            "all of an EMD-2A2Q's registers, and no relays",
            8,
            Map {
                words: &[(0, &[12, 8, 2, 0, 500, 0, 0, 0])],
                ..MAP
            },
        ),
        (
            "an EMD-2A2Q with a speed that it does not have",
            8,
            Map {
                coils: &[(8, 2)],
                words: &[(0, &[12, 8, 9, 0, 500, 0, 0, 0])],
                ..MAP
            },
        ),
        (
            "everything",
            8,
            Map {
                coils: &[(0, 999)],
                inputs: &[(0, 999)],
                words: &[(0, ZEROS)],
                ..MAP
            },
        ),
    ];
    for (what, address, map) in strangers {
        let found = scan(address, &mut |request| map.answer(request));
        assert_eq!(found.len(), 1, "{what}");
        let verdict = found[0].verdict().name();
        assert_eq!(
            found[0].identity.family,
            None,
            "{what}: {}",
            told(&found[0])
        );
        assert!(
            ["odd", "refused"].contains(&verdict),
            "{what}: {}",
            told(&found[0])
        );
    }
}

/// No Modbus reply of an EDA9050 is unique to it.
#[test]
fn a_board_that_is_silent_to_what_it_lacks_could_be_an_eda9050() {
    let board = Map {
        coils: &[(0, 8)],
        outside: None,
        unknown: None,
        ..MAP
    };
    let found = scan(4, &mut |request| board.answer(request));
    assert_eq!(told(&found[0]), "9600 8N1 004 rtu ? could_be");
    assert_eq!(found[0].identity.family, None);
}

/// A module with another name is no EDA module, however its name begins.
#[test]
fn a_name_is_compared_whole() {
    for (name, wanted) in [
        ("9060", "9600 8N1 007 ascii EDA9060A ok"),
        ("9060A", "9600 8N1 007 ascii EDA9060A ok"),
        ("9060D", "9600 8N1 007 ascii 9060D odd"),
        ("9050D", "9600 8N1 007 ascii 9050D odd"),
        ("4060", "9600 8N1 007 ascii 4060 odd"),
    ] {
        let wish = ScanOptions {
            addresses: Some(vec![7]),
            protocols: Some(vec![Protocol::Ascii]),
            ..ScanOptions::default()
        };
        let found = drive(Scope::of(&wish, Vec::new()), &mut |frame| {
            let asked = frame.ends_with(b"$07M\r");
            asked.then(|| format!("!07{name}\r").into_bytes())
        });
        assert_eq!(told(&found[0]), wanted);
    }
}

/// The replies of an ERC-8 and an EMD-2A2Q.
const ERC8: Map = Map {
    coils: &[(60, 8)],
    words: &[(0, &[5, 1, 0])],
    ..MAP
};
const EMD: Map = Map {
    coils: &[(8, 2)],
    words: &[(0, &[12, 5, 2, 0, 500, 0, 1, 2])],
    ..MAP
};

/// A refusal that is lost once is requested again; one that never comes proves nothing. A garbled
/// one counts as lost.
#[test]
fn a_refusal_that_is_lost_is_asked_for_once_more() {
    let refusals: [(&Map, &str, &[&[u8]]); 2] = [
        (
            &ERC8,
            "ERC-8",
            &[&[1, 0, 0, 0, 8], &[1, 0, 60, 0, 9], &[2, 0, 0, 0, 1]],
        ),
        (
            &EMD,
            "EMD-2A2Q",
            &[&[1, 0, 0, 0, 8], &[3, 0, 0, 0, 9], &[1, 0, 10, 0, 1]],
        ),
    ];
    for (map, model, lost) in refusals {
        for lost in lost {
            for garbled in [false, true] {
                for times in [0, 1, 9] {
                    let mut left = times;
                    let found = scan(5, &mut |request| {
                        if request != *lost || left == 0 {
                            return map.answer(request);
                        }
                        left -= 1;
                        garbled.then(|| vec![0x55; 3])
                    });
                    let wanted = match times {
                        0 | 1 => format!("9600 8N1 005 rtu {model} ok"),
                        _ => "9600 8N1 005 rtu ? could_be".to_owned(),
                    };
                    // Garbled every time at the first request: it may be two modules.
                    if garbled && times == 9 && lost[..] == [1, 0, 0, 0, 8] {
                        continue;
                    }
                    assert_eq!(
                        told(&found[0]),
                        wanted,
                        "{lost:?} lost {times} times, {garbled}"
                    );
                }
            }
        }
    }
}

/// A gateway answers for modules it can't reach, and some report a garbled request: neither is a
/// refusal.
#[test]
fn a_gateway_that_reaches_nobody_is_no_module() {
    for why in [0x0A, 0x0B] {
        let found = scan(5, &mut |request| Some(vec![request[0] | 0x80, why]));
        assert_eq!(told(&found[0]), "9600 8N1 005 rtu ? refused");
        let found = scan(5, &mut |request| match ERC8.answer(request) {
            Some(reply) if reply[0] & 0x80 != 0 => Some(vec![reply[0], why]),
            other => other,
        });
        assert_eq!(told(&found[0]), "9600 8N1 005 rtu ? refused");
    }
}
