//! Where the registers are (ARM DAI0385 and DDI0479). The only file that turns numbers into
//! addresses: all the rest of the board is safe code on top.

/// A register of 32 bits, or a word of memory that outlives a reset.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Register(usize);

impl Register {
    pub(crate) fn read(self) -> u32 {
        // SAFETY: only this file makes registers, out of the addresses below. Each is a word of
        // a device, or of memory that no program's variables lie in, and may be read always.
        unsafe { (self.0 as *const u32).read_volatile() }
    }

    pub(crate) fn write(self, value: u32) {
        // SAFETY: as above; and no device here is told to write to memory by itself.
        unsafe { (self.0 as *mut u32).write_volatile(value) }
    }
}

/// A CMSDK timer: counts down at [`CLOCK_HZ`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Timer {
    pub(crate) control: Register,
    pub(crate) value: Register,
    pub(crate) reload: Register,
    /// Reads whether it has reached zero; writing a 1 clears that.
    pub(crate) interrupt: Register,
}

const fn timer(base: usize) -> Timer {
    Timer {
        control: Register(base),
        value: Register(base + 4),
        reload: Register(base + 8),
        interrupt: Register(base + 12),
    }
}

/// A CMSDK UART: one character each way, no parity, one stop bit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uart {
    pub(crate) data: Register,
    pub(crate) state: Register,
    pub(crate) control: Register,
    /// Reads which interrupts are pending; writing ones clears them.
    pub(crate) interrupt: Register,
    pub(crate) divider: Register,
}

const fn uart(base: usize) -> Uart {
    Uart {
        data: Register(base),
        state: Register(base + 4),
        control: Register(base + 8),
        interrupt: Register(base + 12),
        divider: Register(base + 16),
    }
}

/// A CMSDK watchdog: counts down at [`CLOCK_HZ`], interrupts, and resets the second time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Watchdog {
    pub(crate) load: Register,
    pub(crate) control: Register,
    /// Writing any value restarts it.
    pub(crate) clear: Register,
    pub(crate) lock: Register,
}

const fn watchdog(base: usize) -> Watchdog {
    Watchdog {
        load: Register(base),
        control: Register(base + 8),
        clear: Register(base + 12),
        lock: Register(base + 0xC00),
    }
}

/// An SBCON: two pins set by software. Writing ones releases a pin, or pulls it low.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TwoPins {
    /// Reads the state of the pins.
    pub(crate) set: Register,
    pub(crate) clear: Register,
}

/// The clock of processor and peripherals.
pub(crate) const CLOCK_HZ: u32 = 25_000_000;

pub(crate) const TIMER0: Timer = timer(0x4000_0000);
pub(crate) const TIMER1: Timer = timer(0x4000_1000);
pub(crate) const UART0: Uart = uart(0x4000_4000);
pub(crate) const UART1: Uart = uart(0x4000_5000);
pub(crate) const WATCHDOG: Watchdog = watchdog(0x4000_8000);
/// The two LEDs of the board: what this one uses as direction pin and LED.
pub(crate) const LEDS: Register = Register(0x4002_8000);
pub(crate) const SHIELD_I2C: TwoPins = TwoPins {
    set: Register(0x4002_A000),
    clear: Register(0x4002_A004),
};

/// Enabled interrupts: bit n = interrupt n.
pub(crate) const INTERRUPTS: Register = Register(0xE000_E100);

/// Two words that a reset leaves as they are; memory.x keeps variables out of them.
pub(crate) const LAST_WORDS: [Register; 2] = [Register(0x2000_6000), Register(0x2000_6004)];

/// How much of its stack the program has used at most, in bytes: it is painted at start-up.
pub(crate) fn stack_used() -> u32 {
    /// What cortex-m-rt paints with.
    const PAINT: u32 = 0xCCCC_CCCC;
    const STACK: core::ops::Range<usize> = 0x2000_0000..0x2000_4000;
    let mut at = STACK.start;
    while at < STACK.end && Register(at).read() == PAINT {
        at += 4;
    }
    STACK.end.wrapping_sub(at) as u32
}
