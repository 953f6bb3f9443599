//! The interrupt handlers: the end of the vector table.

use crate::map::INTERRUPTS;
use crate::{NEWS, clock, console, guard, line};
use core::sync::atomic::Ordering;
use railbus_firmware::Reset;

/// By number, as on the board (ARM DAI0385). It ends with the last one that is enabled:
/// cortex-m-rt's own table has all 240 that a Cortex-M3 may have.
// SAFETY: the linker script takes this section and this name as the end of the vector table.
// The processor keeps what a C function may spoil, so that it may call one.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [extern "C" fn(); 10] = [
    line_in,
    line_out,
    console_in,
    console_out,
    nobody,
    nobody,
    nobody,
    nobody,
    came_round,
    alarm,
];

/// Enables all that have a handler.
pub(crate) fn let_through() {
    INTERRUPTS.write(0b11_0000_1111);
}

extern "C" fn line_in() {
    line::take_in();
    NEWS.store(true, Ordering::Relaxed);
}

extern "C" fn line_out() {
    line::give_out();
    NEWS.store(true, Ordering::Relaxed);
}

extern "C" fn console_in() {
    console::take_in();
    NEWS.store(true, Ordering::Relaxed);
}

extern "C" fn console_out() {
    console::give_out();
    NEWS.store(true, Ordering::Relaxed);
}

extern "C" fn came_round() {
    clock::came_round();
}

extern "C" fn alarm() {
    clock::alarm();
    NEWS.store(true, Ordering::Relaxed);
}

extern "C" fn nobody() {
    guard::give_up(Reset::Fault);
}
