//! UART0 on its RS-485 transceiver: the interrupts' half, and the loop's.
//!
//! LED 0 is the direction pin: high drives the line, low listens, which is its state after a reset.
//! The receiver is off while the line is driven.
//!
//! QEMU delivers all characters of a frame at once, or late when its machine is busy. On a line
//! they take their time, and so they do here: none ends earlier than one character time after the
//! one before it, and those that arrive together end right after one another. If characters come at
//! full speed, that changes nothing.

use crate::map::{CLOCK_HZ, LEDS, UART0};
use crate::{clock, guard};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use railbus_firmware::{Heard, Outbox, Ring, What};
use railbus_wire::{FRAME_MAX, Instant, Micros, SerialSettings};

const DRIVE: u32 = 1;
const LED: u32 = 1 << 1;

/// Bits of the UART's state, control and interrupt registers.
pub(crate) const IS_FULL_IN: u32 = 1 << 1;
const OVERRUN_IN: u32 = 1 << 3;
pub(crate) const OUT: u32 = 1;
pub(crate) const IN: u32 = 1 << 1;
pub(crate) const INTERRUPT_OUT: u32 = 1 << 2;
pub(crate) const INTERRUPT_IN: u32 = 1 << 3;
/// Receiving, with or without waiting for room to send.
const HEARING: u32 = OUT | IN | INTERRUPT_OUT | INTERRUPT_IN;
const DEAF: u32 = OUT | IN | INTERRUPT_OUT;

static RING: Ring = Ring::new();
static OUTBOX: Outbox<FRAME_MAX> = Outbox::new();
/// When the last character ended, in two halves: only [`take_in`] uses them.
static LAST_AT: [AtomicU32; 2] = [AtomicU32::new(0), AtomicU32::new(0)];
/// How many microseconds a character takes.
static CHARACTER: AtomicU32 = AtomicU32::new(0);
/// When the last byte of a reply went out: the low half of its microseconds.
static DRAINED_AT: AtomicU32 = AtomicU32::new(0);
static DRAINED: AtomicBool = AtomicBool::new(false);

/// Characters came, or there is room for more.
pub(crate) fn take_in() {
    UART0.interrupt.write(IN);
    // Once for all that have arrived: QEMU may be held up while we take them, and that is no pause
    // between them.
    let now = clock::now();
    while RING.has_room() {
        let state = UART0.state.read();
        let what = if state & OVERRUN_IN != 0 {
            UART0.state.write(OVERRUN_IN);
            What::Lost
        } else if state & IS_FULL_IN != 0 {
            // It has neither parity nor a bit for a missing stop bit.
            What::Byte(UART0.data.read() as u8)
        } else {
            return;
        };
        RING.push(Heard {
            at: ends_at(now),
            what,
        });
    }
    // The loop turns it on again; the UART then reports what it had to drop.
    UART0.control.write(DEAF);
}

/// When a character that comes now ends.
fn ends_at(now: Instant) -> Instant {
    let [high, low] = &LAST_AT;
    let last =
        u64::from(high.load(Ordering::Relaxed)) << 32 | u64::from(low.load(Ordering::Relaxed));
    let character = Micros(CHARACTER.load(Ordering::Relaxed).into());
    let at = now.max(Instant(last) + character);
    high.store((at.0 >> 32) as u32, Ordering::Relaxed);
    low.store(at.0 as u32, Ordering::Relaxed);
    at
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
    if UART0.control.read() == DEAF && RING.has_room() {
        cortex_m::interrupt::free(|_| {
            UART0.control.write(HEARING);
            take_in();
        });
    }
    heard
}

pub(crate) fn heard_at() -> Option<Instant> {
    RING.next_at(clock::now)
}

pub(crate) fn transmit(bytes: &[u8]) {
    let takes = CHARACTER.load(Ordering::Relaxed);
    guard::driving(takes.saturating_mul(bytes.len() as u32));
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

/// Releases the line, whatever was in progress.
pub(crate) fn listen() {
    LEDS.write(LEDS.read() & !DRIVE);
    guard::listening();
    OUTBOX.clear();
}

/// Only the speed: this UART has one character format. Parity is neither sent nor checked, but the
/// length of its characters counts in all times.
pub(crate) fn retune(serial: SerialSettings) {
    let character = serial.frame_time(1).0 as u32;
    CHARACTER.store(character, Ordering::Relaxed);
    UART0.divider.write(CLOCK_HZ / serial.baud.rate());
    UART0.control.write(HEARING);
    // QEMU's multiplexer keeps what came before this, and delivers it when a character is taken.
    if UART0.state.read() & IS_FULL_IN == 0 {
        UART0.data.read();
    }
}

pub(crate) fn light(lit: bool) {
    let others = LEDS.read() & !LED;
    LEDS.write(if lit { others | LED } else { others });
}
