//! The module's terminals: pins.

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use embassy_stm32::adc::{Adc, AdcChannel, InterruptHandler, SampleTime};
use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Pull, Speed};
use embassy_stm32::peripherals::{ADC1, PB0, PB1};
use embassy_stm32::{Peri, bind_interrupts};
use railbus_device::{Family, Setup};
use railbus_firmware::{FAMILY, Pinned, Sensed};

bind_interrupts!(struct Interrupts {
    ADC1_2 => InterruptHandler<ADC1>;
});

/// Outputs and inputs for which there are pins.
const OUTPUTS: usize = 8;
const INPUTS: usize = 7;

/// The voltage at the terminal that is full scale of the converter, in hundredths of a volt: three
/// times the 3.3 V of the pin.
const FULL: u32 = 990;
const MOST: u32 = 4095;

/// A module with factory settings. A 0x55 board has the eight outputs that exist.
pub(crate) fn factory() -> Setup {
    let setup = railbus_firmware::factory();
    Setup {
        outputs: setup.outputs.min(OUTPUTS as u8),
        ..setup
    }
}

/// The use of PB0 and PB1.
pub(crate) enum Shared {
    /// The two lowest DIP switches.
    Dip([Input<'static>; 2]),
    /// The analog inputs.
    Analog(Adc<'static, ADC1>, Peri<'static, PB0>, Peri<'static, PB1>),
}

impl Shared {
    pub(crate) fn new(
        adc: Peri<'static, ADC1>,
        one: Peri<'static, PB0>,
        two: Peri<'static, PB1>,
    ) -> Shared {
        match FAMILY {
            Family::Emd2a2q => Shared::Analog(Adc::new(adc), one, two),
            _ => Shared::Dip([one.into(), two.into()].map(pulled_up)),
        }
    }
}

/// All terminals but the line.
pub(crate) struct Terminals {
    led: Output<'static>,
    outputs: [Output<'static>; OUTPUTS],
    inputs: [Input<'static>; INPUTS],
    init: Input<'static>,
    shared: Shared,
    /// The DIP switches from the third on.
    dip: [Input<'static>; 3],
}

impl Terminals {
    /// Outputs off, LED dark.
    pub(crate) fn new(
        led: Peri<'static, AnyPin>,
        outputs: [Peri<'static, AnyPin>; OUTPUTS],
        inputs: [Peri<'static, AnyPin>; INPUTS],
        init: Peri<'static, AnyPin>,
        shared: Shared,
        dip: [Peri<'static, AnyPin>; 3],
    ) -> Terminals {
        Terminals {
            led: Output::new(led, Level::High, Speed::Low),
            outputs: outputs.map(|pin| Output::new(pin, Level::Low, Speed::Low)),
            inputs: inputs.map(pulled_up),
            init: pulled_up(init),
            shared,
            dip: dip.map(pulled_up),
        }
    }

    /// The board's LED lights when its pin is low.
    pub(crate) fn light(&mut self, lit: bool) {
        self.led.set_level(Level::from(!lit));
    }

    pub(crate) fn drive(&mut self, outputs: u32) {
        for (index, pin) in self.outputs.iter_mut().enumerate() {
            pin.set_level(Level::from(outputs >> index & 1 == 1));
        }
    }

    pub(crate) fn sense(&mut self) -> Sensed {
        let absent = u32::MAX << INPUTS;
        let mut sensed = Sensed {
            panel: None,
            analogs: [None; 2],
            stuck: u32::MAX << OUTPUTS,
        };
        let mut dip = bits(&self.dip, Input::is_low) << 2;
        match &mut self.shared {
            Shared::Dip(pins) => dip |= bits(pins, Input::is_low),
            Shared::Analog(adc, one, two) => {
                sensed.analogs = [Some(volts(adc, one)), Some(volts(adc, two))];
            }
        }
        sensed.panel = Some(Pinned {
            levels: bits(&self.inputs, Input::is_high) | absent,
            dip: dip as u8,
            init_grounded: self.init.is_low(),
        });
        sensed
    }
}

fn pulled_up(pin: Peri<'static, AnyPin>) -> Input<'static> {
    Input::new(pin, Pull::Up)
}

/// Bit n = the condition holds for pin n.
fn bits(pins: &[Input<'static>], is: fn(&Input<'static>) -> bool) -> u32 {
    let bits = pins.iter().rev();
    bits.fold(0, |bits, pin| bits << 1 | u32::from(is(pin)))
}

/// The voltage at an analog terminal, in hundredths of a volt.
fn volts(adc: &mut Adc<'static, ADC1>, pin: &mut impl AdcChannel<ADC1>) -> i16 {
    let raw = outcome(adc.read(pin, SampleTime::CYCLES239_5));
    (u32::from(raw) * FULL / MOST) as i16
}

/// The result of something that takes some microseconds. If it never ends, the watchdog resets.
fn outcome<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        let mut nobody = Context::from_waker(Waker::noop());
        if let Poll::Ready(outcome) = future.as_mut().poll(&mut nobody) {
            return outcome;
        }
    }
}
