//! Whatever arrives, and whenever, no engine of any family panics, sends while it sends, sends more
//! than one frame for one request, or touches an output that it does not have.
//!
//! `PROPTEST_CASES` overrides the number of cases.

use proptest::collection::vec;
use proptest::prelude::*;
use railbus_device::{
    Applies, Eeprom, Effect, Engine, Extensions, Family, Input, Layout, Options, Output,
};
use railbus_device::{Setup, SetupError};
use railbus_wire::{Address, Instant, Micros, Protocol, PulseWidth, crc16, sum8};

/// Cases for each property, where the environment does not say.
const CASES: u32 = 1_000;

/// The address of the module under test.
const OWN: u8 = 1;

/// Something that happens to a module.
#[derive(Clone, Debug)]
enum Event {
    Bytes(Vec<u8>),
    BadByte,
    Overrun,
    Timeout,
    Sent,
    Levels(u32),
    Analog(u8, i16),
    Init(bool),
    Dip(u8),
    Stuck(u32),
    /// A driver that does everything right, for the length of the pause.
    Attend,
}

fn address() -> impl Strategy<Value = u8> {
    prop_oneof![6 => Just(OWN), 1 => Just(0), 1 => Just(245), 1 => any::<u8>()]
}

/// Small numbers mostly, as in requests that mean something.
fn number() -> impl Strategy<Value = u16> {
    prop_oneof![
        8 => 0..20_u16,
        2 => 55..70_u16,
        2 => Just(0xFF00),
        2 => 0xBE00..0xBE07_u16,
        1 => any::<u16>(),
    ]
}

fn rtu() -> impl Strategy<Value = Vec<u8>> {
    let functions = vec![1, 2, 3, 4, 5, 6, 8, 0x0F, 0x10];
    let function = prop::sample::select(functions);
    let data = vec(number(), 0..5);
    let parts = (address(), function, number(), number(), data);
    parts.prop_map(|(address, function, at, value, data)| {
        let mut frame = vec![address, function];
        frame.extend(at.to_be_bytes());
        frame.extend(value.to_be_bytes());
        if function >= 0x0F {
            let registers: Vec<u8> = data.iter().flat_map(|word| word.to_be_bytes()).collect();
            let bytes = if function == 0x0F {
                usize::from(value.div_ceil(8))
            } else {
                2 * usize::from(value)
            };
            let bytes = bytes.min(registers.len());
            frame.push(bytes as u8);
            frame.extend(&registers[..bytes]);
        }
        frame.extend(crc16(&frame).to_le_bytes());
        frame
    })
}

/// What is this? With any code and object.
fn identify() -> impl Strategy<Value = Vec<u8>> {
    (address(), 0..6_u8, 0..6_u8).prop_map(|(address, code, object)| {
        let mut frame = vec![address, 0x2B, 0x0E, code, object];
        frame.extend(crc16(&frame).to_le_bytes());
        frame
    })
}

fn ascii() -> impl Strategy<Value = Vec<u8>> {
    let body = prop_oneof![
        4 => "\\$0[01][MF236]",
        2 => "~0[01](0|1|2|4|3[01][0-2][0-9A-F]|50[0-9A-F]0[0-9A-F])",
        1 => "~\\*\\*",
        4 => "%0[01]0[0-9]400[2-8](00|40)",
        4 => "#0[01](00|1[0-8])[0-9A-F]{2}",
        2 => "#0[01]40[0-9A-F]{3}",
        1 => "[$%#@~][ -~]{0,40}",
    ];
    (body, any::<bool>()).prop_map(|(text, checksum)| {
        let sum = sum8(text.as_bytes());
        let sum = if checksum {
            format!("{sum:02X}")
        } else {
            String::new()
        };
        format!("{text}{sum}\r").into_bytes()
    })
}

fn lc02() -> impl Strategy<Value = Vec<u8>> {
    let data = vec(
        prop_oneof![3 => 0..12_u8, 1 => Just(0xFF), 1 => any::<u8>()],
        3,
    );
    (address(), 0..8_u8, data).prop_map(|(address, command, mut data)| {
        data.truncate(match command {
            2 => 3,
            4 | 5 => 2,
            _ => 0,
        });
        let body = [&[address, command], &data[..]].concat();
        [&[0x4C, 0x57], &body[..], &[sum8(&body), 0x0D]].concat()
    })
}

fn r55() -> impl Strategy<Value = Vec<u8>> {
    let command = prop_oneof![4 => 0x10..0x48_u8, 1 => 0x70..0x72_u8, 1 => any::<u8>()];
    let small = prop_oneof![3 => 0..40_u8, 1 => 0xE0..0xE7_u8, 1 => any::<u8>()];
    (address(), command, vec(small, 4)).prop_map(|(address, command, data)| {
        let mut frame = vec![0x55, address, command];
        frame.extend(data);
        frame.push(sum8(&frame));
        frame
    })
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        3 => rtu().prop_map(Event::Bytes),
        1 => identify().prop_map(Event::Bytes),
        3 => ascii().prop_map(Event::Bytes),
        3 => lc02().prop_map(Event::Bytes),
        3 => r55().prop_map(Event::Bytes),
        2 => vec(any::<u8>(), 0..300).prop_map(Event::Bytes),
        1 => Just(Event::BadByte),
        1 => Just(Event::Overrun),
        3 => Just(Event::Timeout),
        2 => Just(Event::Sent),
        1 => any::<u32>().prop_map(Event::Levels),
        1 => any::<(u8, i16)>().prop_map(|(channel, value)| Event::Analog(channel, value)),
        1 => any::<bool>().prop_map(Event::Init),
        1 => (0..4_u8).prop_map(Event::Dip),
        1 => any::<u32>().prop_map(Event::Stuck),
        8 => Just(Event::Attend),
    ]
}

/// Pauses: none, such as lie inside frames, between them, and long ones.
fn pause() -> impl Strategy<Value = Micros> {
    prop_oneof![1 => Just(0), 2 => 0..5_000_u64, 4 => 0..60_000_u64, 2 => 0..30_000_000_u64]
        .prop_map(Micros)
}

fn setup() -> impl Strategy<Value = Setup> {
    let layout = prop::sample::select(vec![Layout::Outputs, Layout::Inputs, Layout::Mixed]);
    let family = prop::sample::select(Family::ALL.to_vec());
    let protocol = any::<prop::sample::Index>();
    let parts = (family, protocol, layout, 0..=16_u8, any::<[bool; 2]>());
    parts.prop_map(
        |(family, protocol, layout, channels, [checksum, invert_on_off])| {
            let protocol = *protocol.get(family.profile().protocols);
            let setup = Setup {
                protocol,
                checksum: checksum && protocol == Protocol::Ascii,
                ..Setup::new(family, Address(OWN))
            };
            if family != Family::R55 {
                return setup;
            }
            Setup {
                layout,
                invert_on_off,
                outputs: if layout == Layout::Inputs {
                    0
                } else {
                    channels
                },
                inputs: if layout == Layout::Outputs {
                    0
                } else {
                    channels
                },
                variables: channels,
                ..setup
            }
        },
    )
}

fn options() -> impl Strategy<Value = Options> {
    let applies = prop::sample::select(vec![
        Applies::AfterReply,
        Applies::AfterRestart,
        Applies::AddressAfterReply,
    ]);
    let parts = (applies, any::<[bool; 5]>(), 0..30_000_u64);
    parts.prop_map(|(applies, switches, turnaround)| {
        let [
            refuse_aloud,
            lower_case,
            answer_bad_frames,
            insist_on_gap,
            extensions,
        ] = switches;
        Options {
            turnaround: Micros(turnaround),
            applies,
            refuse_aloud,
            lower_case,
            answer_bad_frames,
            insist_on_gap,
            extensions,
        }
    })
}

/// What an EEPROM may hold, be it possible or not.
fn extensions() -> impl Strategy<Value = Extensions> {
    let watchdog = prop_oneof![1 => Just(0), 2 => 1..10_u8, 1 => any::<u8>()];
    let parts = (watchdog, any::<[u32; 2]>(), any::<bool>());
    parts.prop_map(|(watchdog, [power_on, safe], tripped)| Extensions {
        watchdog,
        power_on,
        safe,
        tripped,
    })
}

/// A module under observation.
struct Watched {
    engine: Engine,
    setup: Setup,
    now: Instant,
    sending: bool,
    /// Characters that ended while it did not send, and frames that it sent.
    heard: usize,
    said: usize,
    /// The shortest request that it may answer.
    shortest: usize,
}

impl Watched {
    fn new(setup: Setup, eeprom: Eeprom, options: Options) -> Result<Watched, SetupError> {
        let shortest = match setup.protocol {
            Protocol::Rtu if options.answer_bad_frames => 2,
            Protocol::Rtu => 4,
            // An EDA9050 goes from the one to the other.
            Protocol::Ascii | Protocol::Lc02 => b"$01M\r".len(),
            Protocol::R55 => 8,
        };
        Ok(Watched {
            engine: Engine::new(&setup, eeprom, options, Instant(0))?,
            setup,
            now: Instant(0),
            sending: false,
            heard: 0,
            said: 0,
            shortest,
        })
    }

    fn happens(&mut self, event: &Event) -> Result<(), TestCaseError> {
        let input = match event {
            Event::Bytes(bytes) => Input::Bytes(bytes),
            Event::BadByte => Input::BadByte,
            Event::Overrun => Input::Overrun,
            Event::Timeout | Event::Attend => Input::Timeout,
            Event::Sent => Input::Sent,
            Event::Levels(levels) => Input::Levels(*levels),
            Event::Analog(channel, value) => Input::Analog(*channel, *value),
            Event::Init(grounded) => Input::Init(*grounded),
            Event::Dip(dip) => Input::Dip(*dip),
            Event::Stuck(mask) => Input::Stuck(*mask),
        };
        self.heard += match input {
            Input::Bytes(bytes) if !self.sending => bytes.len(),
            Input::BadByte | Input::Overrun if !self.sending => 1,
            _ => 0,
        };
        if input == Input::Sent {
            self.sending = false;
        }
        self.engine.handle(self.now, input);
        let deadline = self.drain()?;
        if input == Input::Timeout {
            // Everything due is done: a driver never loops.
            prop_assert!(deadline.is_none_or(|at| at > self.now));
        }
        Ok(())
    }

    /// Does what the engine wants done now; until when it then waits.
    fn drain(&mut self) -> Result<Option<Instant>, TestCaseError> {
        for _ in 0..100 {
            match self.engine.poll() {
                Output::Wait(deadline) => {
                    let outside = self.engine.outputs() & !self.setup.output_mask();
                    prop_assert_eq!(outside, 0);
                    return Ok(deadline);
                }
                Output::Transmit(bytes) => {
                    prop_assert!(!bytes.is_empty());
                    prop_assert!(!self.sending, "it talks while it talks");
                    self.sending = true;
                    self.said += 1;
                    let requests = self.heard / self.shortest;
                    prop_assert!(self.said <= requests, "an answer without a request");
                }
                Output::Effect(Effect::Output { channel, .. }) => {
                    prop_assert!(channel < self.setup.outputs);
                }
                Output::Effect(Effect::Save(eeprom)) => {
                    prop_assert_eq!(&eeprom, self.engine.eeprom());
                }
                Output::Effect(Effect::Serial(serial)) => {
                    prop_assert_eq!(serial, self.engine.active().serial);
                }
                Output::Effect(Effect::Led(_)) => {}
            }
        }
        Err(TestCaseError::fail("poll does not come to an end"))
    }

    /// Lets time pass as a driver does that keeps every deadline. What is being sent ends when
    /// it begins; what then begins is still being sent when it ends.
    fn attend(&mut self, until: Instant) -> Result<(), TestCaseError> {
        if self.sending {
            self.happens(&Event::Sent)?;
        }
        while let Some(at) = self.drain()?.filter(|at| *at <= until) {
            self.now = self.now.max(at);
            self.happens(&Event::Timeout)?;
        }
        self.now = until;
        Ok(())
    }
}

fn config() -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES").ok();
    ProptestConfig {
        cases: cases.and_then(|n| n.parse().ok()).unwrap_or(CASES),
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn engines_are_total(
        setup in setup(),
        options in options(),
        (pulse_mask, tenths, checksum) in (0..16_u8, 1..=200_u8, any::<bool>()),
        extensions in extensions(),
        events in vec((pause(), event()), 0..40),
    ) {
        let eeprom = Eeprom {
            pulse_mask,
            pulse_width: PulseWidth::from_tenths(tenths).expect("1 to 200"),
            checksum: checksum && setup.protocol != Protocol::R55,
            extensions,
            ..Eeprom::of(&setup)
        };
        let mut module = Watched::new(setup, eeprom, options).expect("a possible module");
        module.drain()?;
        for (pause, event) in events {
            let then = module.now + pause;
            match event {
                Event::Attend => module.attend(then)?,
                event => {
                    module.now = then;
                    module.happens(&event)?;
                }
            }
        }
    }
}
