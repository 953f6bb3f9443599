//! UART1: the module's status, a line at a time, printed when it starts and when it receives a
//! character.

use crate::line::{IN, INTERRUPT_IN, INTERRUPT_OUT, IS_FULL_IN, OUT};
use crate::map::{CLOCK_HZ, UART1};
use core::sync::atomic::{AtomicBool, Ordering};
use railbus_firmware::{Outbox, Text};

const BAUD: u32 = 115_200;

static OUTBOX: Outbox<{ Text::MAX }> = Outbox::new();
static IDLE: AtomicBool = AtomicBool::new(true);
static ASKED: AtomicBool = AtomicBool::new(true);

pub(crate) fn start() {
    UART1.divider.write(CLOCK_HZ / BAUD);
    UART1.control.write(OUT | IN | INTERRUPT_OUT | INTERRUPT_IN);
}

pub(crate) fn take_in() {
    UART1.interrupt.write(IN);
    while UART1.state.read() & IS_FULL_IN != 0 {
        if UART1.data.read() as u8 == b'?' {
            ASKED.store(true, Ordering::Relaxed);
        }
    }
}

pub(crate) fn give_out() {
    UART1.interrupt.write(OUT);
    match OUTBOX.take() {
        Some(byte) => UART1.data.write(byte.into()),
        None => IDLE.store(true, Ordering::Release),
    }
}

/// Whether a line can be printed.
pub(crate) fn is_idle() -> bool {
    IDLE.load(Ordering::Acquire)
}

/// Whether the status has been asked for since the last time.
pub(crate) fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// The request is being answered.
pub(crate) fn answered() {
    ASKED.store(false, Ordering::Relaxed);
}

pub(crate) fn say(line: &[u8]) {
    IDLE.store(false, Ordering::Relaxed);
    OUTBOX.fill(line);
    cortex_m::interrupt::free(|_| give_out());
}
