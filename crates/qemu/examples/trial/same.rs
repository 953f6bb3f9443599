//! The same bytes, to the engine in virtual time and to the firmware in QEMU.

mod clocked;
mod pair;
mod random;
mod traces;

use crate::World;
use clocked::Clock;
use pair::Count;
use railbus_device::Setup;
use random::Known;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// So many streams of random bursts.
const STREAMS: u64 = 25;

/// Boards side by side.
const BOARDS: usize = 6;

/// What a module goes through.
#[derive(Clone, Copy)]
enum Life {
    /// Something of it runs by the clock. These come first, as they take longest.
    Clocked(Clock),
    /// The committed frames.
    Trace(Setup),
    /// A stream of random bursts.
    Random(u64),
}

impl Life {
    fn all() -> Vec<Life> {
        let clocked = Clock::ALL.into_iter().map(Life::Clocked);
        let traces = traces::setups().map(Life::Trace);
        let random = (0..STREAMS).map(Life::Random);
        clocked.chain(traces).chain(random).collect()
    }

    const fn kind(self) -> usize {
        match self {
            Life::Clocked(_) => 0,
            Life::Trace(_) => 1,
            Life::Random(_) => 2,
        }
    }

    fn live(self, world: &World, requests: &[Known]) -> Result<Count, String> {
        match self {
            Life::Clocked(clock) => clocked::live(world, clock),
            Life::Trace(setup) => traces::live(world, setup),
            Life::Random(seed) => {
                random::live(world, seed, requests).map_err(|why| format!("seed {seed}: {why}"))
            }
        }
    }
}

/// Compares replies and outputs.
pub(crate) fn the_same_bytes_get_the_same_replies(world: &World) -> Result<String, String> {
    let requests = random::requests()?;
    let lives = Life::all();
    let next = AtomicUsize::new(0);
    let (counts, failures) = (Mutex::new([Count::default(); 3]), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..BOARDS {
            scope.spawn(|| {
                while let Some(life) = lives.get(next.fetch_add(1, Ordering::Relaxed)) {
                    match life.live(world, &requests) {
                        Ok(count) => {
                            let counts = &mut counts.lock().expect("no thread panics");
                            counts[life.kind()].frames += count.frames;
                            counts[life.kind()].replies += count.replies;
                        }
                        Err(why) => failures.lock().expect("no thread panics").push(why),
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().expect("no thread panics");
    let counts = counts.into_inner().expect("no thread panics");
    let told = ["by the clock", "of traces", "random"]
        .into_iter()
        .zip(counts);
    let told = told.map(|(kind, Count { frames, replies })| {
        format!("{frames} frames {kind} with {replies} replies")
    });
    let done = format!(
        "{} lives: {}",
        lives.len(),
        told.collect::<Vec<_>>().join(", ")
    );
    // Frames without any reply would prove nothing.
    let answered = counts.iter().all(|count| count.replies > count.frames / 5);
    if failures.is_empty() && answered {
        Ok(done)
    } else {
        Err(format!("{done}\n{}", failures.join("\n")))
    }
}
