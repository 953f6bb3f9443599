//! The same bytes, to the engine in virtual time and to the firmware in QEMU.

use crate::World;
use railbus_cases::{Bench, Simulated, Step, all};
use railbus_device::{Family, Layout, Options, Setup};
use railbus_qemu::Board;
use railbus_wire::{Address, Protocol, crc16, sum8};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Streams of so many bursts each.
const STREAMS: u64 = 25;
const BURSTS: usize = 40;

/// Boards side by side, and tries of each stream. As with cases: held up is not wrong, and wrong
/// is wrong each time.
const BOARDS: usize = 4;
const TRIES: u32 = 4;

/// Valid requests, damaged ones and noise: replies and outputs are the same.
pub(crate) fn the_same_bytes_get_the_same_replies(world: &World) -> Result<String, String> {
    let requests = requests()?;
    let (next, answered) = (AtomicU64::new(0), AtomicU64::new(0));
    let failures = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..BOARDS {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= STREAMS {
                        break;
                    }
                    match tries(world, seed, &requests) {
                        Ok(replies) => _ = answered.fetch_add(replies, Ordering::Relaxed),
                        Err(why) => {
                            let text = format!("seed {seed}: {why}");
                            failures.lock().expect("no thread panics").push(text);
                        }
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().expect("no thread panics");
    let replies = answered.into_inner();
    let bursts = STREAMS as usize * BURSTS;
    let done = format!("{STREAMS} streams, {bursts} bursts, {replies} replies");
    // Streams that nobody answers would prove nothing.
    if failures.is_empty() && replies > bursts as u64 / 5 {
        Ok(done)
    } else {
        Err(format!("{done}\n{}", failures.join("\n")))
    }
}

/// A request of a case, and whose it is.
type Known = (Family, Protocol, Vec<u8>);

fn tries(world: &World, seed: u64, requests: &[Known]) -> Result<u64, String> {
    let mut result = Err(String::new());
    for slower in 1..=TRIES {
        result = stream(world, seed, slower, requests);
        if result.is_ok() {
            break;
        }
    }
    result
}

/// The requests of the cases, as something to begin with.
fn requests() -> Result<Vec<Known>, String> {
    let mut requests = Vec::new();
    for case in all()? {
        for (_, step) in &case.steps {
            if let Step::Ask(request, _) = step {
                let subject = case.modules.first().ok_or("a case without a module")?;
                let setup = subject.setup;
                requests.push((setup.family, setup.protocol, request.clone()));
            }
        }
    }
    Ok(requests)
}

/// One module's life; how many replies it gave.
fn stream(world: &World, seed: u64, slower: u32, requests: &[Known]) -> Result<u64, String> {
    let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let setup = setup(seed, &mut random);
    let own: Vec<&Vec<u8>> = requests
        .iter()
        .filter(|(family, protocol, _)| (*family, *protocol) == (setup.family, setup.protocol))
        .map(|(_, _, request)| request)
        .collect();
    let mut simulated =
        Simulated::new(setup, Options::default()).map_err(|error| error.to_string())?;
    let board = Board::new(&world.images, &setup, Options::default());
    let mut board = board.map_err(|error| error.to_string())?.slower(slower);
    let mut replies = 0;
    for number in 0..BURSTS {
        let burst = timeless(setup.family, &own, &mut random);
        let Ok(expected) = simulated.ask(&burst, 0);
        let answer = board
            .ask(&burst, expected.len())
            .map_err(|error| error.to_string())?;
        let Ok(outputs) = simulated.outputs(0);
        let shown = board.outputs(outputs).map_err(|error| error.to_string())?;
        if (&answer, shown) != (&expected, outputs) {
            return Err(format!(
                "{} ({:?}), burst {number}, {burst:02X?}: the simulator says {expected:02X?} and \
                 has {outputs:X}, the firmware {answer:02X?} and {shown:X}",
                setup.family, setup.protocol
            ));
        }
        replies += u64::from(!answer.is_empty());
    }
    Ok(replies)
}

fn setup(seed: u64, random: &mut Random) -> Setup {
    let family = Family::ALL[(seed % 5) as usize];
    let protocols = family.profile().protocols;
    let setup = Setup {
        protocol: protocols[random.below(protocols.len())],
        ..Setup::new(family, Address(1))
    };
    match (family, setup.protocol) {
        (Family::R55, _) => Setup {
            layout: Layout::Mixed,
            outputs: 16,
            inputs: 8,
            ..setup
        },
        (_, Protocol::Ascii) => Setup {
            checksum: random.below(4) == 0,
            ..setup
        },
        _ => setup,
    }
}

/// A burst that lets nothing run by the clock, as virtual and real time don't agree: no pulse, no
/// jog, no calibration, no address that a board takes for its first ten seconds only.
fn timeless(family: Family, own: &[&Vec<u8>], random: &mut Random) -> Vec<u8> {
    loop {
        let burst = burst(own, random);
        let runs = match (family, &burst[..]) {
            (Family::R55, bytes) => bytes
                .iter()
                .any(|byte| [0x21, 0x22, 0x37, 0x38, 0x41].contains(byte)),
            (Family::Eda9060a, [b'#', _, _, b'4', ..] | [0x4C, 0x57, _, 0x05, ..]) => true,
            (Family::Eda9060a, [_, 0x10, ..]) => true,
            (Family::Emd2a2q, [_, 0x06, _, 0x05, ..] | [_, 0x10, ..]) => true,
            _ => false,
        };
        if !runs {
            return burst;
        }
    }
}

/// A request as it is, damaged, cut off or with another value, or noise.
fn burst(own: &[&Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = own[random.below(own.len())].clone();
    match random.below(8) {
        0 => {
            let at = random.below(bytes.len());
            bytes[at] ^= 1 << random.below(8);
        }
        1 => bytes.truncate(random.below(bytes.len())),
        2 => {
            bytes = (0..1 + random.below(40))
                .map(|_| random.below(256) as u8)
                .collect()
        }
        3 => {
            // Another value with a right seal.
            let at = random.below(bytes.len());
            bytes[at] = random.below(256) as u8;
            reseal(&mut bytes);
        }
        _ => {}
    }
    if bytes.is_empty() { vec![0] } else { bytes }
}

/// Computes what ends a frame anew, by the frame's own protocol.
fn reseal(bytes: &mut [u8]) {
    let count = bytes.len();
    match bytes {
        [0x55, .., last] if count == 8 => *last = 0,
        [0x4C, 0x57, ..] | [b'$' | b'#' | b'%', ..] => return,
        _ => {}
    }
    if let [body @ .., low, high] = bytes
        && body.first() != Some(&0x55)
    {
        [*low, *high] = crc16(body).to_le_bytes();
    } else if let [body @ .., last] = bytes {
        *last = sum8(body);
    }
}

/// Xorshift: streams that a seed can bring back.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % limit.max(1)
    }
}
