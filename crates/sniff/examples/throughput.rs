//! How many lines one core can listen to: 32 lines at 115200 baud carry 32 × 11520 bytes a
//! second, all of them busy all the time.
//!
//! ```text
//! cargo run --release -p railbus-sniff --example throughput
//! ```
//! Each line is heard in pieces of 16 bytes, as adapters give them. Half of the lines carry
//! frames of all four protocols, one in four of them damaged; the other half nothing but noise.
#![allow(clippy::print_stdout, reason = "that is what it is for")]

use railbus_sniff::{Input, Listener, Output, SniffEvent};
use railbus_wire::{Baud, Character, Instant, SerialSettings, crc16};
use std::time;

const LINES: usize = 32;
const PIECE: usize = 16;
/// Seconds of each line.
const SECONDS: usize = 20;

fn main() {
    let settings = SerialSettings {
        baud: Baud::B115200,
        character: Character::N1,
    };
    let per_line = 11_520 * SECONDS;
    let traffic: Vec<Vec<u8>> = (0..LINES).map(|line| line_of(line, per_line)).collect();
    let mut listeners: Vec<Listener> = (0..LINES).map(|_| Listener::new(settings)).collect();
    let (mut frames, mut good) = (0_u64, 0_u64);
    let start = time::Instant::now();
    for from in (0..per_line).step_by(PIECE) {
        let now = Instant(from as u64 * 1_000_000 / 11_520);
        for (listener, bytes) in listeners.iter_mut().zip(&traffic) {
            let to = (from + PIECE).min(bytes.len());
            listener.handle(now, Input::Bytes(&bytes[from..to]));
            while let Output::Heard(heard) = listener.poll() {
                if let SniffEvent::Frame(frame) = heard {
                    frames += 1;
                    good += u64::from(!frame.readings.is_empty());
                }
            }
        }
    }
    let took = start.elapsed().as_secs_f64();
    let bytes = (LINES * per_line) as f64;
    println!("{frames} frames, {good} of them read, {bytes} bytes in {took:.2} s");
    println!(
        "{:.0} bytes/s on one core; 32 lines at 115200 baud need {}; that is {:.1} times as much",
        bytes / took,
        LINES * 11_520,
        bytes / took / (LINES * 11_520) as f64
    );
}

/// What one line carries.
fn line_of(line: usize, len: usize) -> Vec<u8> {
    let mut seed = line as u32 + 1;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 16) as usize
    };
    let mut read = vec![0x03, 0x01, 0x01, 0x05];
    read.extend(crc16(&read).to_le_bytes());
    let good: [&[u8]; 8] = [
        b"$016\r",
        b"!030200\r",
        &[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22],
        &read,
        &[0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69],
        &[0x22, 0x04, 0x10, 0, 0, 0, 5, 0x3B],
        &[0x4C, 0x57, 0x02, 0x03, 0x05, 0x0D],
        &[0x6C, 0x63, 0x02, 0x03, 0x02, 0x07, 0x0D],
    ];
    let mut bytes = Vec::with_capacity(len + 300);
    let mut next = 0;
    while bytes.len() < len {
        if line % 2 == 1 {
            bytes.push(random() as u8);
            continue;
        }
        let mut frame = good[next % 8].to_vec();
        next += 1;
        if random() % 4 == 0 {
            let at = random() % frame.len();
            frame[at] ^= 1 << (random() % 8);
        }
        bytes.extend(frame);
    }
    bytes.truncate(len);
    bytes
}
