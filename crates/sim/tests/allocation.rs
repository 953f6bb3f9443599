//! A line with full traffic allocates nothing once it has run for a while.
#![allow(unsafe_code, reason = "a counting allocator")]

mod support;

use railbus_device::{Family, Setup};
use railbus_sim::{Input, Output, VirtualLine, VirtualLineConfig};
use railbus_wire::{Address, Instant, Micros, SerialSettings};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};
use support::hex;

struct Counting;

static COUNT: AtomicU64 = AtomicU64::new(0);

thread_local! {
    /// Only the test's own thread counts: the test harness allocates beside it when it likes.
    static COUNTS: Cell<bool> = const { Cell::new(false) };
}

// SAFETY: everything is left to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if COUNTS.try_with(Cell::get).unwrap_or(false) {
            COUNT.fetch_add(1, Ordering::Relaxed);
        }
        // SAFETY: the caller keeps the same promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the same promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Asks module 1, waits 50 ms, and counts the characters heard.
fn ask(line: &mut VirtualLine, now: &mut Instant, bytes: &[u8]) -> usize {
    let settings = SerialSettings::FACTORY;
    line.handle(*now, Input::Send { bytes, settings });
    let end = *now + Micros::from_millis(50);
    let mut heard = 0;
    loop {
        match line.poll() {
            Output::Heard { bytes, .. } => heard += bytes.len(),
            Output::Effect { .. } => {}
            Output::Wait(Some(at)) if at <= end => {
                *now = at;
                line.handle(at, Input::Timeout);
            }
            Output::Wait(_) => {
                *now = end;
                return heard;
            }
        }
    }
}

#[test]
fn the_steady_state_allocates_nothing() {
    let mut line = VirtualLine::new(VirtualLineConfig::default());
    for address in 1..=5 {
        let setup = Setup::new(Family::Erc8, Address(address));
        let eeprom = railbus_device::Eeprom::of(&setup);
        line.add(Instant(0), "oven", &setup, eeprom, Default::default())
            .expect("a possible module");
    }
    let request = hex("01 05 00 3C FF 00 4C 36");
    let mut now = Instant(100_000);
    for _ in 0..10 {
        ask(&mut line, &mut now, &request);
    }
    let before = COUNT.load(Ordering::Relaxed);
    COUNTS.set(true);
    let heard: usize = (0..1_000).map(|_| ask(&mut line, &mut now, &request)).sum();
    let allocated = COUNT.load(Ordering::Relaxed) - before;
    assert_eq!((heard, allocated), (8_000, 0));
}
