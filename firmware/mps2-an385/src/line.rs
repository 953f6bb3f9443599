//! UART0 on its RS-485 transceiver: the interrupts' half, and the loop's.
//!
//! LED 0 is the direction pin: high drives the line, low listens, which it does after a reset.
//! The receiver is off while the line is driven.

use crate::clock;
use crate::map::{CLOCK_HZ, LEDS, UART0};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use railbus_firmware::{Heard, Outbox, Ring};
use railbus_wire::{FRAME_MAX, Instant, Settings};

const DRIVE: u32 = 1;
const LED: u32 = 1 << 1;

/// Bits of the UART's state, control and interrupt registers.
pub(crate) const IS_FULL_IN: u32 = 1 << 1;
const OVERRUN_IN: u32 = 1 << 3;
pub(crate) const OUT: u32 = 1;
pub(crate) const IN: u32 = 1 << 1;
pub(crate) const INTERRUPT_OUT: u32 = 1 << 2;
pub(crate) const INTERRUPT_IN: u32 = 1 << 3;
/// Hearing, with or without room for more.
const HEARING: u32 = OUT | IN | INTERRUPT_OUT | INTERRUPT_IN;
const DEAF: u32 = OUT | IN | INTERRUPT_OUT;

static RING: Ring = Ring::new();
static OUTBOX: Outbox<FRAME_MAX> = Outbox::new();
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
/// When the last byte of a reply went out: the low half of its microseconds.
static DRAINED_AT: AtomicU32 = AtomicU32::new(0);
static DRAINED: AtomicBool = AtomicBool::new(false);

/// Characters came, or room for them.
pub(crate) fn take_in() {
    UART0.interrupt.write(IN);
    if UART0.state.read() & OVERRUN_IN != 0 {
        UART0.state.write(OVERRUN_IN);
        OVERRUNS.store(lost().wrapping_add(1), Ordering::Relaxed);
    }
    while UART0.state.read() & IS_FULL_IN != 0 {
        if !RING.has_room() {
            // The loop turns it on again; what the UART itself has to drop, it counts.
            UART0.control.write(DEAF);
            return;
        }
        // It has neither parity nor a bit for a missing stop bit.
        let byte = Some(UART0.data.read() as u8);
        RING.push(Heard {
            at: clock::now(),
            byte,
        });
    }
}

/// There is room for another character to send.
pub(crate) fn give_out() {
    UART0.interrupt.write(OUT);
    match OUTBOX.take() {
        Some(byte) => UART0.data.write(byte.into()),
        None => {
            DRAINED_AT.store(clock::now().0 as u32, Ordering::Relaxed);
            DRAINED.store(true, Ordering::Release);
        }
    }
}

pub(crate) fn hear() -> Option<Heard> {
    let heard = RING.pop(clock::now);
    if heard.is_none() && UART0.control.read() == DEAF {
        cortex_m::interrupt::free(|_| {
            UART0.control.write(HEARING);
            take_in();
        });
        return RING.pop(clock::now);
    }
    heard
}

pub(crate) fn transmit(bytes: &[u8]) {
    LEDS.write(LEDS.read() | DRIVE);
    DRAINED.store(false, Ordering::Relaxed);
    OUTBOX.fill(bytes);
    cortex_m::interrupt::free(|_| give_out());
}

pub(crate) fn drained() -> Option<Instant> {
    if !DRAINED.load(Ordering::Acquire) {
        return None;
    }
    let now = clock::now();
    let age = (now.0 as u32).wrapping_sub(DRAINED_AT.load(Ordering::Relaxed));
    Some(Instant(now.0.saturating_sub(age.into())))
}

/// Lets go of the line, whatever was being done.
pub(crate) fn listen() {
    LEDS.write(LEDS.read() & !DRIVE);
    OUTBOX.clear();
}

/// Only the speed: this UART has one format of characters. The others' parity is neither sent
/// nor checked, but their length counts in all times.
pub(crate) fn retune(serial: Settings) {
    UART0.divider.write(CLOCK_HZ / serial.baud.rate());
    UART0.control.write(HEARING);
}

pub(crate) fn light(lit: bool) {
    let others = LEDS.read() & !LED;
    LEDS.write(if lit { others | LED } else { others });
}

/// Characters lost since the UART had no room, or since nobody took them.
pub(crate) fn lost() -> u32 {
    OVERRUNS.load(Ordering::Relaxed)
}
