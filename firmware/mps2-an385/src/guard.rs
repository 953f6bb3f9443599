//! What happens when the program fails: the line is released first, then the program restarts.

use crate::line;
use crate::map::{CLOCK_HZ, LAST_WORDS, WATCHDOG};
use cortex_m::peripheral::SCB;
use railbus_firmware::Reset;
use railbus_wire::Micros;

/// How long the loop may take for a pass; while it drives the line, in addition to twice the time
/// that its characters take.
const PATIENCE_MICROS: u32 = 4_000_000;
const DRIVING_MICROS: u32 = 1_000_000;
/// How often it makes a pass at least.
pub(crate) const FEED_EVERY: Micros = Micros::from_secs(1);

const UNLOCK: u32 = 0x1ACC_E551;
const INTERRUPT_THEN_RESET: u32 = 0b11;

/// Marks that the word after it is ours.
const MARK: u32 = 0x7261_696C;
const WATCHDOG_BIT: u32 = 1 << 31;
const FAULT_BIT: u32 = 1 << 30;

/// Starts the watchdog.
pub(crate) fn start() {
    WATCHDOG.lock.write(UNLOCK);
    WATCHDOG.control.write(INTERRUPT_THEN_RESET);
    WATCHDOG.lock.write(0);
    listening();
}

/// The line is driven, and its characters take this many microseconds.
pub(crate) fn driving(micros: u32) {
    expect(micros.saturating_mul(2).saturating_add(DRIVING_MICROS));
}

/// The line is released.
pub(crate) fn listening() {
    expect(PATIENCE_MICROS);
}

fn expect(micros: u32) {
    WATCHDOG.lock.write(UNLOCK);
    WATCHDOG
        .load
        .write(micros.saturating_mul(CLOCK_HZ / 1_000_000));
    WATCHDOG.lock.write(0);
}

/// The loop has made a pass.
pub(crate) fn feed() {
    WATCHDOG.lock.write(UNLOCK);
    WATCHDOG.clear.write(1);
    WATCHDOG.lock.write(0);
}

/// Why the program started; cleared by reading.
pub(crate) fn why_reset() -> Reset {
    let [mark, word] = LAST_WORDS;
    if mark.read() != MARK {
        return Reset::Power;
    }
    mark.write(0);
    match word.read() {
        WATCHDOG_BIT => Reset::Watchdog,
        FAULT_BIT => Reset::Fault,
        line => Reset::Panic(line),
    }
}

pub(crate) fn give_up(why: Reset) -> ! {
    line::listen();
    let [mark, word] = LAST_WORDS;
    word.write(match why {
        Reset::Watchdog => WATCHDOG_BIT,
        Reset::Panic(line) => line,
        Reset::Fault | Reset::Power => FAULT_BIT,
    });
    mark.write(MARK);
    SCB::sys_reset()
}
