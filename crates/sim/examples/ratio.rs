//! How much faster than real time the line runs: five ERC-8 at 9600 with full traffic, and the
//! demo line of four protocols. Run it with `--release`.
#![allow(clippy::print_stdout, reason = "printing is what it is for")]

use railbus_device::{Eeprom, Family, Options, Setup};
use railbus_sim::demo::Demo;
use railbus_sim::{Chance, Faults, Input, Output, VirtualLine, VirtualLineConfig};
use railbus_wire::{Address, Instant, Micros, SerialSettings, crc16};

const VIRTUAL: Micros = Micros::from_secs(3_600);
const GAP: Micros = Micros::from_millis(20);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let started = std::time::Instant::now();
    let replies = five_ovens(Faults::NONE)?;
    report("5 x ERC-8, clean", replies, started);

    let started = std::time::Instant::now();
    let replies = five_ovens(Faults {
        flip: Chance::per_million(1_000),
        lose_character: Chance::per_million(1_000),
        ..Faults::NONE
    })?;
    report("5 x ERC-8, 0.2 % of characters spoilt", replies, started);

    let started = std::time::Instant::now();
    let replies = demo_line()?;
    report("demo line, four protocols", replies, started);
    Ok(())
}

fn five_ovens(faults: Faults) -> Result<u64, Box<dyn std::error::Error>> {
    let mut line = VirtualLine::new(VirtualLineConfig {
        faults,
        ..VirtualLineConfig::default()
    });
    let options = Options {
        turnaround: Micros::from_millis(5),
        ..Options::default()
    };
    for address in 1..=5 {
        let setup = Setup::new(Family::Erc8, Address(address));
        line.add(Instant(0), "oven", &setup, Eeprom::of(&setup), options)?;
    }
    let requests: Vec<Vec<u8>> = (1..=5).map(read_relays).collect();
    Ok(talk(
        |now, input| line_step(&mut line, now, input),
        &requests,
    ))
}

fn demo_line() -> Result<u64, Box<dyn std::error::Error>> {
    let mut demo = Demo::new(Instant(0), VirtualLineConfig::default())?;
    let requests = [
        b"$016\r".to_vec(),
        b"LW\x02\x03\x05\r".to_vec(),
        read_relays(3),
        vec![0x55, 4, 0x10, 0, 0, 0, 0, 0x69],
        with_crc(&[5, 3, 0, 6, 0, 2]),
    ];
    let step = |now, input: Option<&[u8]>| {
        demo.handle(now, as_input(input));
        let mut heard = 0;
        loop {
            match demo.poll() {
                Output::Heard { bytes, .. } => heard += bytes.len(),
                Output::Effect { .. } => {}
                Output::Wait(at) => return (heard, at),
            }
        }
    };
    Ok(talk(step, &requests))
}

/// Asks one request after another for as long as the virtual time lasts: the next one follows
/// the last character of a reply after the gap, or 100 ms of silence. Counts the replies.
fn talk(
    mut step: impl FnMut(Instant, Option<&[u8]>) -> (usize, Option<Instant>),
    requests: &[Vec<u8>],
) -> u64 {
    let (mut now, mut replies, mut heard) = (Instant(0), 0, 0);
    let mut send_at = Instant(100_000);
    let mut turn = requests.iter().cycle();
    let (_, mut wake) = step(now, None);
    while now < Instant(VIRTUAL.0) {
        now = wake.map_or(send_at, |wake| wake.min(send_at));
        let request = if now == send_at { turn.next() } else { None };
        let (count, next) = step(now, request.map(Vec::as_slice));
        wake = next;
        if let Some(request) = request {
            replies += u64::from(heard > 0);
            heard = 0;
            let took = SerialSettings::FACTORY.frame_time(request.len());
            send_at = now + took + Micros::from_millis(100);
        } else if count > 0 {
            heard += count;
            send_at = now + GAP;
        }
    }
    replies
}

fn line_step(
    line: &mut VirtualLine,
    now: Instant,
    input: Option<&[u8]>,
) -> (usize, Option<Instant>) {
    line.handle(now, as_input(input));
    let mut heard = 0;
    loop {
        match line.poll() {
            Output::Heard { bytes, .. } => heard += bytes.len(),
            Output::Effect { .. } => {}
            Output::Wait(at) => return (heard, at),
        }
    }
}

fn as_input(bytes: Option<&[u8]>) -> Input<'_> {
    match bytes {
        Some(bytes) => Input::Send {
            bytes,
            settings: SerialSettings::FACTORY,
        },
        None => Input::Timeout,
    }
}

fn read_relays(address: u8) -> Vec<u8> {
    with_crc(&[address, 1, 0, 60, 0, 8])
}

fn with_crc(bytes: &[u8]) -> Vec<u8> {
    let mut frame = bytes.to_vec();
    frame.extend(crc16(bytes).to_le_bytes());
    frame
}

fn report(what: &str, replies: u64, started: std::time::Instant) {
    let took = started.elapsed();
    let ratio = VIRTUAL.0 as f64 / took.as_micros() as f64;
    println!("{what:<40} {replies:>8} replies in {took:>8.0?}, {ratio:>7.0} x real time");
}
