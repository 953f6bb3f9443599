//! Board 2: an STM32F103C8 "blue pill", a Cortex-M3 at 72 MHz. Built, and never yet tried.
//!
//! | pins | what |
//! |---|---|
//! | PA9, PA10, PA8 | the line: to, from and direction of the RS-485 transceiver |
//! | PB8 to PB15 | outputs 0 to 7: high is on |
//! | PA0 to PA6 | inputs 0 to 6: open is high |
//! | PA7 | INIT* of an EDA9050: low is grounded |
//! | PB0, PB1, PB5, PB6, PB7 | DIP switch of a 0x55 board: low is on; PB0 counts 1 |
//! | PB0, PB1 | analog inputs of an EMD-2A2Q: a third of 0 to 9.9 V |
//! | PC13 | the LED on the board |
//!
//! The settings lie in the last 4 KiB of the flash. The processor stands still while it writes
//! there: some milliseconds, and some tens of them where a sector is erased before.

#![no_std]
#![no_main]

mod line;
mod terminals;

use core::future::Future;
use core::panic::PanicInfo;
use core::pin::pin;
use core::task::{Context, Waker};
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, entry, exception};
use embassy_stm32::flash::{Blocking, Flash as Chip};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::rcc;
use embassy_stm32::time::Hertz;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;
use line::Line;
use railbus_device::Eeprom;
use railbus_firmware::{Board, Heard, Kept, Module, Sensed};
use railbus_nvm::Flash;
use railbus_wire::{Instant, Micros, SerialSettings};
use terminals::{Shared, Terminals};

/// Where the settings are: as in `memory.x`.
const SETTINGS: core::ops::Range<u32> = 60 * 1024..64 * 1024;

/// How long the loop may take for a pass, in microseconds.
const PATIENCE: u32 = 4_000_000;

/// How often it makes a pass at least.
const FEED_EVERY: Micros = Micros::from_secs(1);

#[entry]
fn main() -> ! {
    let pins = embassy_stm32::init(clocks());
    let mut watchdog: IndependentWatchdog<'_, IWDG> = IndependentWatchdog::new(pins.IWDG, PATIENCE);
    watchdog.unleash();
    let Ok(store) = Flash::new(Chip::new_blocking(pins.FLASH), SETTINGS) else {
        panic!("the range suits the flash");
    };
    let Ok(kept) = Kept::load(store, &terminals::factory()) else {
        panic!("the factory makes modules of the family");
    };
    let Ok(mut module) = Module::new(kept.record(), now()) else {
        panic!("what is kept is a possible module");
    };
    let mut board = BluePill {
        kept,
        line: Line::new(pins.USART1, pins.PA10, pins.PA9, pins.PA8),
        terminals: Terminals::new(
            pins.PC13.into(),
            [
                pins.PB8.into(),
                pins.PB9.into(),
                pins.PB10.into(),
                pins.PB11.into(),
                pins.PB12.into(),
                pins.PB13.into(),
                pins.PB14.into(),
                pins.PB15.into(),
            ],
            [
                pins.PA0.into(),
                pins.PA1.into(),
                pins.PA2.into(),
                pins.PA3.into(),
                pins.PA4.into(),
                pins.PA5.into(),
                pins.PA6.into(),
            ],
            pins.PA7.into(),
            Shared::new(pins.ADC1, pins.PB0, pins.PB1),
            [pins.PB5.into(), pins.PB6.into(), pins.PB7.into()],
        ),
    };
    module.start(&mut board);
    loop {
        watchdog.pet();
        line::look();
        let step_at = module.step(&mut board);
        let save_at = board.kept.poll(now());
        let wake_at = [step_at, save_at].into_iter().flatten();
        sleep_until(wake_at.fold(now() + FEED_EVERY, Instant::min));
    }
}

/// 72 MHz from the crystal of 8 MHz, and 12 MHz for the analog inputs.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse {
        freq: Hertz(8_000_000),
        mode: rcc::HseMode::Oscillator,
    });
    config.rcc.pll = Some(rcc::Pll {
        src: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV1,
        mul: rcc::PllMul::MUL9,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV2;
    config.rcc.adc_pre = rcc::ADCPrescaler::DIV6;
    config
}

/// The time since the start.
fn now() -> Instant {
    Instant(embassy_time::Instant::now().as_micros())
}

/// Sleeps until then, or until the line has something.
fn sleep_until(at: Instant) {
    let alarm = Timer::at(embassy_time::Instant::from_micros(at.0));
    // Polling once sets the alarm; no task has to be woken.
    let _ = pin!(alarm).poll(&mut Context::from_waker(Waker::noop()));
    // An event between the checks and the sleep ends the sleep at once.
    cortex_m::interrupt::free(|_| {
        if !line::has_news() && now() < at {
            cortex_m::asm::wfi();
        }
    });
}

/// The board as its module sees it.
struct BluePill {
    kept: Kept<Flash<Chip<'static, Blocking>>>,
    line: Line,
    terminals: Terminals,
}

impl Board for BluePill {
    fn now(&self) -> Instant {
        now()
    }
    fn hear(&mut self) -> Option<Heard> {
        line::hear()
    }
    fn transmit(&mut self, bytes: &[u8]) {
        self.line.transmit(bytes);
    }
    fn drained(&self) -> Option<Instant> {
        line::drained()
    }
    fn listen(&mut self) {
        self.line.listen();
    }
    fn retune(&mut self, serial: SerialSettings) {
        self.line.retune(serial);
    }
    fn light(&mut self, lit: bool) {
        self.terminals.light(lit);
    }
    fn drive(&mut self, outputs: u32) {
        self.terminals.drive(outputs);
    }
    fn sense(&mut self) -> Sensed {
        self.terminals.sense()
    }
    fn save(&mut self, settings: &Eeprom) {
        self.kept.save(now(), settings);
    }
}

/// A reset releases every pin: the direction pin's resistor then releases the line, and those at
/// the relays' driver switch them off.
#[exception]
unsafe fn HardFault(_frame: &ExceptionFrame) -> ! {
    SCB::sys_reset()
}

#[panic_handler]
fn panic(_info: &PanicInfo<'_>) -> ! {
    SCB::sys_reset()
}
