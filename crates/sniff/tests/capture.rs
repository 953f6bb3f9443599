//! Capture files, ours and those of other programs.

use railbus_sniff::capture::{self, Broken, Damage, Direction, Packet, ReadStep, Reader};
use railbus_wire::Instant;

fn file() -> Vec<u8> {
    let at = Instant(1_795_269_787_412_345);
    [
        capture::header("railbus 0.1.0"),
        capture::interface("main", "9600 8N1"),
        capture::packet(0, at, b"$016\r", Some(Direction::Out), "ok: read outputs"),
        capture::packet(0, at, &[0xFE, 0x00], None, "没有协议能接受"),
    ]
    .concat()
}

/// Lines, and packets with their comments.
fn read(mut bytes: &[u8]) -> Result<(usize, Vec<(Packet<'_>, String)>), Broken> {
    let mut reader = Reader::new();
    let mut packets = Vec::new();
    loop {
        match reader.next(bytes)? {
            ReadStep::More(_) => return Ok((reader.interfaces().len(), packets)),
            ReadStep::Other(len) => bytes = &bytes[len..],
            ReadStep::Packet(len, packet) => {
                let name = reader.interfaces()[packet.line].name.clone();
                packets.push((packet, name));
                bytes = &bytes[len..];
            }
        }
    }
}

#[test]
fn what_was_written_is_read_again() {
    let file = file();
    let (lines, packets) = read(&file).unwrap();
    assert_eq!((lines, packets.len()), (1, 2));
    let (first, name) = &packets[0];
    assert_eq!(name, "main");
    assert_eq!(first.at, Instant(1_795_269_787_412_345));
    assert_eq!(first.bytes, b"$016\r");
    assert_eq!(first.direction, Some(Direction::Out));
    assert_eq!(first.comment, Some("ok: read outputs"));
    assert_eq!(packets[1].0.comment, Some("没有协议能接受"));
    assert_eq!(packets[1].0.direction, None);
}

#[test]
fn other_machines_order_and_resolution_are_read() {
    let be = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|w| w.to_be_bytes()).collect() };
    let file = [
        be(&[0x0A0D_0D0A, 28, 0x1A2B_3C4D, 0x0001_0000, !0, !0, 28]),
        be(&[1, 32, 147 << 16, 0, 0x0009_0001, 0x0900_0000, 0, 32]),
        be(&[6, 36, 0, 0, 5_000, 1, 1, 0xAB00_0000, 36]),
    ]
    .concat();
    let (lines, packets) = read(&file).unwrap();
    assert_eq!((lines, packets.len()), (1, 1));
    assert_eq!(packets[0].0.at, Instant(5)); // 5000 ns
    assert_eq!(packets[0].0.bytes, [0xAB]);
}

#[test]
fn what_is_no_capture_is_told_so_with_its_place() {
    let whole = file();
    let why = |bytes: &[u8]| read(bytes).map(|_| ()).map_err(|broken| broken.why);
    assert_eq!(why(b"PK\x03\x04 something else"), Err(Damage::NoCapture));
    assert_eq!(why(b"PK"), Err(Damage::NoCapture));
    let mut wrong = whole.clone();
    wrong[8] = 0;
    assert_eq!(why(&wrong), Err(Damage::NoCapture));
    let head = capture::header("railbus 0.1.0").len();
    let mut wrong = whole.clone();
    wrong[head + 4] = 0xFF;
    assert_eq!(why(&wrong), Err(Damage::Length));
    wrong[head + 4..head + 8].copy_from_slice(&[0, 0, 0, 0x7F]);
    let broken = read(&wrong).unwrap_err();
    assert_eq!(
        broken,
        Broken {
            at: head as u64,
            why: Damage::TooMuch
        }
    );
    let lost = [
        capture::header("x"),
        capture::packet(3, Instant(0), b"x", None, ""),
    ];
    assert_eq!(why(&lost.concat()), Err(Damage::Interface));
    let mut long = whole.clone();
    let packet = head + capture::interface("main", "9600 8N1").len();
    long[packet + 20..packet + 24].copy_from_slice(&[0xFF; 4]);
    assert_eq!(why(&long), Err(Damage::Packet));
}

#[test]
fn any_damage_is_read_without_harm() {
    let whole = file();
    for at in 0..whole.len() {
        for value in [0, 1, 0x7F, 0x80, 0xFF, whole[at].wrapping_add(4)] {
            let mut wrong = whole.clone();
            wrong[at] = value;
            let _ = read(&wrong);
        }
        let _ = read(&whole[..at]);
    }
}
