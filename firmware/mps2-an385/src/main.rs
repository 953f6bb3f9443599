//! Board 1: QEMU's `mps2-an385`, a Cortex-M3 at 25 MHz.
//!
//! UART0 is the line and UART1 the console; terminals and settings are chips on the I2C bus of
//! the first shield. `firmware/README.md` has QEMU's command line.

#![no_std]
#![no_main]

mod clock;
mod console;
mod guard;
mod interrupts;
mod line;
mod map;

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use railbus_device::Eeprom;
use railbus_firmware::{About, At24c, Board, Heard, I2c, Kept, Module, Panel, Pins, Reset, Sensed};
use railbus_nvm::Slots;
use railbus_wire::{Instant, SerialSettings};

/// An interrupt has had something for the loop since the loop last looked.
pub(crate) static NEWS: AtomicBool = AtomicBool::new(true);

#[entry]
fn main() -> ! {
    clock::start();
    guard::start();
    console::start();
    interrupts::let_through();
    let store = Slots::new(At24c::new(I2c::new(ShieldPins)));
    // By reference, and so is the module: they are most of the memory in use, and must not be
    // copied.
    let Ok(kept) = &mut Kept::load(store, &railbus_firmware::factory()) else {
        panic!("the factory makes modules of the family");
    };
    let mut board = Mps2 {
        panel: Panel::new(I2c::new(ShieldPins), kept.record().setup()),
        kept,
        reset: guard::why_reset(),
        next_line: 0,
    };
    match &mut Module::new(board.kept.record(), clock::now()) {
        Ok(module) => run(module, &mut board),
        Err(_) => panic!("what is kept is a possible module"),
    }
}

/// Makes a pass whenever something has happened or is due, and sleeps in between.
fn run(module: &mut Module, board: &mut Mps2<'_>) -> ! {
    module.start(board);
    loop {
        guard::feed();
        NEWS.store(false, Ordering::Relaxed);
        let step_at = module.step(board);
        let save_at = board.kept.poll(clock::now());
        board.talk(module);
        let feed_at = clock::now() + guard::FEED_EVERY;
        let due = Instant::earliest(&[step_at, save_at, Some(feed_at)]);
        clock::wake_at(due.unwrap_or(feed_at));
        // An event between the check and the sleep ends the sleep at once.
        cortex_m::interrupt::disable();
        if !NEWS.load(Ordering::Relaxed) {
            cortex_m::asm::wfi();
        }
        // SAFETY: no critical section is open here.
        unsafe { cortex_m::interrupt::enable() };
    }
}

/// The board as its module sees it.
struct Mps2<'a> {
    panel: Panel<ShieldPins>,
    kept: &'a mut Kept<Slots<At24c<ShieldPins>>>,
    reset: Reset,
    /// The line that the console prints next.
    next_line: u8,
}

impl Mps2<'_> {
    /// Prints a line on the console, if there is one to print.
    fn talk(&mut self, module: &Module) {
        if self.next_line == 0 && !console::asked() || !console::is_idle() {
            return;
        }
        if self.next_line == 0 {
            console::answered();
        }
        let about = About {
            board: "mps2-an385",
            reset: self.reset,
            origin: self.kept.origin(),
            store: self.kept.counters(),
            stack: map::stack_used(),
            uptime: clock::now().since(Instant(0)).seconds().0 as u32,
        };
        let missing = self.panel.missing();
        match railbus_firmware::line(self.next_line, module, &about, missing) {
            Some(text) => {
                self.next_line += 1;
                console::say(text.bytes());
            }
            None => self.next_line = 0,
        }
    }
}

impl Board for Mps2<'_> {
    fn now(&self) -> Instant {
        clock::now()
    }
    fn hear(&mut self) -> Option<Heard> {
        line::hear()
    }
    fn heard_at(&self) -> Option<Instant> {
        line::heard_at()
    }
    fn transmit(&mut self, bytes: &[u8]) {
        line::transmit(bytes);
    }
    fn drained(&self) -> Option<Instant> {
        line::drained()
    }
    fn listen(&mut self) {
        line::listen();
    }
    fn retune(&mut self, serial: SerialSettings) {
        line::retune(serial);
    }
    fn light(&mut self, lit: bool) {
        line::light(lit);
    }
    fn drive(&mut self, outputs: u32) {
        self.panel.drive(outputs);
    }
    fn sense(&mut self) -> Sensed {
        self.panel.sense()
    }
    fn save(&mut self, settings: &Eeprom) {
        self.kept.save(clock::now(), settings);
    }
}

/// The I2C pins of the first shield: bit 0 is the clock, bit 1 the data.
struct ShieldPins;

impl ShieldPins {
    fn put(bit: u32, high: bool) {
        let register = if high {
            map::SHIELD_I2C.set
        } else {
            map::SHIELD_I2C.clear
        };
        register.write(bit);
    }
}

impl Pins for ShieldPins {
    fn clock(&mut self, high: bool) {
        ShieldPins::put(1, high);
    }
    fn data(&mut self, high: bool) {
        ShieldPins::put(2, high);
    }
    fn data_is_high(&self) -> bool {
        map::SHIELD_I2C.set.read() & 2 != 0
    }
    fn pause(&self) {
        // 0.64 µs.
        cortex_m::asm::delay(16);
    }
}

#[exception]
unsafe fn DefaultHandler(_number: i16) {
    guard::give_up(Reset::Fault);
}

#[exception]
unsafe fn NonMaskableInt() {
    guard::give_up(Reset::Watchdog);
}

#[exception]
unsafe fn HardFault(_frame: &ExceptionFrame) -> ! {
    guard::give_up(Reset::Fault)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    guard::give_up(Reset::Panic(info.location().map_or(0, |at| at.line())))
}
