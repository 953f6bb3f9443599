//! Time and wake-ups: TIMER0 never stops, TIMER1 is the alarm.

use crate::map::{CLOCK_HZ, TIMER0, TIMER1};
use core::sync::atomic::{AtomicU32, Ordering};
use railbus_wire::Instant;

const RUN_AND_INTERRUPT: u32 = 1 | 1 << 3;
const TICKS_PER_MICRO: u32 = CLOCK_HZ / 1_000_000;
/// TIMER0 wraps every 2^27 µs, so that no time needs a 64-bit division.
const ROUND_SHIFT: u32 = 27;
const ROUND_TICKS: u32 = TICKS_PER_MICRO << ROUND_SHIFT;
const LAST: u32 = ROUND_TICKS - 1;
/// The shortest alarm: a timer that reaches it fires at once.
const SHORTEST: u64 = 1;

/// How often TIMER0 has wrapped: every 134 s.
static ROUNDS: AtomicU32 = AtomicU32::new(0);

pub(crate) fn start() {
    TIMER0.reload.write(LAST);
    TIMER0.value.write(LAST);
    TIMER0.control.write(RUN_AND_INTERRUPT);
}

/// The time since [`start`].
pub(crate) fn now() -> Instant {
    let (rounds, passed, came_round) = loop {
        let rounds = ROUNDS.load(Ordering::Relaxed);
        let passed = LAST.wrapping_sub(TIMER0.value.read());
        let came_round = TIMER0.interrupt.read() & 1 == 1;
        if ROUNDS.load(Ordering::Relaxed) == rounds {
            break (rounds, passed, came_round);
        }
    };
    // It has wrapped, and the interrupt that counts that is still pending.
    let uncounted = came_round && passed < ROUND_TICKS / 2;
    let rounds = u64::from(rounds) + u64::from(uncounted);
    Instant(rounds << ROUND_SHIFT | u64::from(passed / TICKS_PER_MICRO))
}

/// Wakes the processor at that time, or at once if it has passed.
pub(crate) fn wake_at(at: Instant) {
    TIMER1.control.write(0);
    TIMER1.interrupt.write(1);
    let ticks = at
        .since(now())
        .0
        .saturating_mul(TICKS_PER_MICRO.into())
        .max(SHORTEST);
    let ticks = u32::try_from(ticks).unwrap_or(u32::MAX);
    TIMER1.reload.write(ticks);
    TIMER1.value.write(ticks);
    TIMER1.control.write(RUN_AND_INTERRUPT);
}

pub(crate) fn came_round() {
    TIMER0.interrupt.write(1);
    ROUNDS.store(
        ROUNDS.load(Ordering::Relaxed).wrapping_add(1),
        Ordering::Relaxed,
    );
}

pub(crate) fn alarm() {
    TIMER1.control.write(0);
    TIMER1.interrupt.write(1);
}
