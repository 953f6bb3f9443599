//! USART1 on its RS-485 transceiver: the interrupt's half, and the loop's.
//!
//! The direction pin drives the line when it is high. The receiver is off meanwhile.

use crate::now;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use embassy_embedded_hal::SetConfig;
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::USART1 as UART;
use embassy_stm32::peripherals::{PA8, PA9, PA10, USART1};
use embassy_stm32::usart::{Config, Parity, StopBits, Uart};
use embassy_stm32::{Peri, interrupt};
use railbus_firmware::{Heard, Outbox, Ring, What};
use railbus_wire::{Character, FRAME_MAX, Instant, SerialSettings};

static RING: Ring = Ring::new();
static OUTBOX: Outbox<FRAME_MAX> = Outbox::new();
/// The interrupt has had something for the loop since the loop last looked.
static NEWS: AtomicBool = AtomicBool::new(true);
/// When the last byte of a reply went out: the low half of its microseconds.
static DRAINED_AT: AtomicU32 = AtomicU32::new(0);
static DRAINED: AtomicBool = AtomicBool::new(false);

/// How many times to check whether the last stop bit has left: more than a bit at 1200 baud.
const PATIENCE: u32 = 50_000;

#[interrupt]
fn USART1() {
    let state = UART.sr().read();
    if state.rxne() || state.ore() {
        // Reading takes the character and its error flags.
        let byte = UART.dr().read().dr() as u8;
        if state.rxne() {
            let bad = state.fe() || state.pe();
            heard(if bad { What::Bad } else { What::Byte(byte) });
        }
        if state.ore() {
            heard(What::Lost);
        }
    }
    if UART.cr1().read().txeie() && state.txe() {
        match OUTBOX.take() {
            Some(byte) => UART.dr().write(|data| data.set_dr(byte.into())),
            None => {
                UART.cr1().modify(|control| control.set_txeie(false));
                DRAINED_AT.store(now().0 as u32, Ordering::Relaxed);
                DRAINED.store(true, Ordering::Release);
            }
        }
    }
    NEWS.store(true, Ordering::Relaxed);
}

fn heard(what: What) {
    RING.push(Heard { at: now(), what });
}

/// The loop starts a pass.
pub(crate) fn look() {
    NEWS.store(false, Ordering::Relaxed);
}

pub(crate) fn has_news() -> bool {
    NEWS.load(Ordering::Relaxed)
}

pub(crate) fn hear() -> Option<Heard> {
    RING.pop(now)
}

pub(crate) fn drained() -> Option<Instant> {
    if !DRAINED.load(Ordering::Acquire) {
        return None;
    }
    let now = now();
    let age = (now.0 as u32).wrapping_sub(DRAINED_AT.load(Ordering::Relaxed));
    Some(Instant(now.0.saturating_sub(age.into())))
}

/// The loop's half.
pub(crate) struct Line {
    uart: Uart<'static, Blocking>,
    direction: Output<'static>,
}

impl Line {
    pub(crate) fn new(
        uart: Peri<'static, USART1>,
        from: Peri<'static, PA10>,
        to: Peri<'static, PA9>,
        direction: Peri<'static, PA8>,
    ) -> Line {
        let direction = Output::new(direction, Level::Low, Speed::Low);
        let Ok(uart) = Uart::new_blocking(uart, from, to, config(SerialSettings::FACTORY)) else {
            panic!("the factory's settings suit the UART");
        };
        Line { uart, direction }
    }

    pub(crate) fn transmit(&mut self, bytes: &[u8]) {
        UART.cr1().modify(|control| control.set_re(false));
        self.direction.set_high();
        DRAINED.store(false, Ordering::Relaxed);
        OUTBOX.fill(bytes);
        UART.cr1().modify(|control| control.set_txeie(true));
    }

    /// Releases the line, whatever was in progress.
    pub(crate) fn listen(&mut self) {
        UART.cr1().modify(|control| control.set_txeie(false));
        OUTBOX.clear();
        // The module waits until the last character has left; only a rounding error may be missing.
        for _ in 0..PATIENCE {
            if UART.sr().read().tc() {
                break;
            }
        }
        self.direction.set_low();
        UART.cr1().modify(|control| {
            control.set_re(true);
            control.set_rxneie(true);
        });
    }

    pub(crate) fn retune(&mut self, serial: SerialSettings) {
        // The UART supports every speed and format that a module has.
        let _ = self.uart.set_config(&config(serial));
        // That leaves the receiver on and its interrupt off.
        UART.cr1().modify(|control| control.set_rxneie(true));
    }
}

fn config(serial: SerialSettings) -> Config {
    let mut config = Config::default();
    config.baudrate = serial.baud.rate();
    (config.parity, config.stop_bits) = match serial.character {
        Character::N1 => (Parity::ParityNone, StopBits::STOP1),
        Character::E1 => (Parity::ParityEven, StopBits::STOP1),
        Character::O1 => (Parity::ParityOdd, StopBits::STOP1),
        Character::N2 => (Parity::ParityNone, StopBits::STOP2),
    };
    // The transceiver's output floats while it drives.
    config.rx_pull = Pull::Up;
    config
}
