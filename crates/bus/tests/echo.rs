//! An echo that appears and disappears on a running line: what it may cost, and that no frame that
//! may be an echo is taken for an acknowledgement.

mod support;

use railbus_bus::{
    Bus, Config, Confirmation, EchoMode, Event, Fault, Input, Medium, ModuleId, Plan, Presence,
    Terms,
};
use railbus_device::{Bank, Eeprom, Engine, Family, Module, Op, Options, Setup};
use railbus_wire::{Address, Instant, Micros, Protocol};
use support::{Drive, Happening, millis};

/// The longest time that a line may be without a reading of each of its modules.
const OUT_OF_SERVICE_MAX: Micros = Micros::from_secs(2);

fn setup(protocol: Protocol, address: u8) -> Setup {
    let family = match protocol {
        Protocol::Rtu => Family::Erc8,
        Protocol::R55 => Family::R55,
        Protocol::Ascii | Protocol::Lc02 => Family::Eda9060a,
    };
    Setup {
        protocol,
        ..Setup::new(family, Address(address))
    }
}

/// Two polled modules, and what was read of each and when.
struct Line {
    drive: Drive,
    seen: [Instant; 2],
    /// The longest time from one reading of a module to the next.
    gap: Micros,
    told: Vec<Event>,
    /// Which frames come back, by their number.
    comes_back: fn(u64) -> bool,
    frames: u64,
    polled: Vec<u8>,
}

impl Line {
    fn new(protocol: Protocol, plan: Plan) -> Line {
        let config = Config {
            echo: EchoMode::Auto,
            medium: Medium::Buffered,
            ..Config::default()
        };
        let mut line = Line {
            drive: Drive::new(Bus::new(config)),
            seen: [Instant(0); 2],
            gap: Micros::ZERO,
            told: Vec::new(),
            comes_back: |_| false,
            frames: 0,
            polled: Vec::new(),
        };
        for address in [1, 2] {
            let setup = setup(protocol, address);
            let module = Module::new(setup).expect("a possible module");
            line.drive.bus.add(module, plan);
            let options = Options {
                turnaround: millis(3),
                ..Options::default()
            };
            let engine = Engine::new(&setup, Eeprom::of(&setup), options, Instant(0));
            line.drive.play(engine.expect("a possible module"));
        }
        line.drive.input(Input::Opened);
        line
    }

    fn run(&mut self, time: Micros) {
        let until = self.drive.now + time;
        while let Some(happening) = self.drive.step(until) {
            match happening {
                Happening::Frame { bytes, end, .. } => {
                    self.frames += 1;
                    if (self.comes_back)(self.frames) {
                        self.drive.hear_at(end, &bytes);
                    }
                    self.drive.ask_players(end, &bytes);
                    self.polled = bytes;
                }
                Happening::Told(Event::Seen { module, .. }) => {
                    let now = self.drive.now;
                    self.gap = self.gap.max(now.since(self.seen[module.0]));
                    self.seen[module.0] = now;
                }
                Happening::Told(event) => self.told.push(event),
                Happening::Heard(_) => {}
            }
        }
    }

    fn count(&self, wanted: &Event) -> usize {
        self.told.iter().filter(|event| *event == wanted).count()
    }

    /// Both modules are online and were read recently, all the time before too.
    fn is_in_service(&self) {
        let now = self.drive.now;
        for module in [0, 1] {
            let presence = self.drive.bus.presence(ModuleId(module));
            assert_eq!(presence, Presence::Online, "module {module}");
            let age = now.since(self.seen[module]);
            assert!(age < millis(400), "module {module} was read {age:?} ago");
        }
        assert!(self.gap <= OUT_OF_SERVICE_MAX, "{:?}", self.gap);
    }
}

const PROTOCOLS: [Protocol; 4] = Protocol::ALL;

#[test]
fn one_request_that_comes_back_costs_nothing() {
    for protocol in PROTOCOLS {
        let mut line = Line::new(protocol, Plan::default());
        line.comes_back = |frame| frame == 40;
        line.run(Micros::from_secs(20));
        line.is_in_service();
        assert_eq!(line.count(&Event::Echo), 0, "{protocol:?}");
        assert_eq!(line.drive.bus.echoes(), Some(false));
    }
}

#[test]
fn a_jumper_that_is_set_and_taken_away_costs_two_seconds_at_most() {
    for protocol in PROTOCOLS {
        let mut line = Line::new(protocol, Plan::default());
        for (echoes, gone) in [(false, 0), (true, 0), (false, 1)] {
            line.drive.echoes = echoes;
            line.run(Micros::from_secs(10));
            line.is_in_service();
            assert_eq!(line.drive.bus.echoes(), Some(echoes), "{protocol:?}");
            assert_eq!(line.count(&Event::EchoGone), gone, "{protocol:?}");
        }
        assert_eq!(line.count(&Event::Echo), 1, "{protocol:?}");
    }
}

/// Two requests in a row are echoed, so that the line detects an echo, again and again.
#[test]
fn what_was_taken_for_an_echo_is_given_up_again() {
    for protocol in PROTOCOLS {
        let mut line = Line::new(protocol, Plan::default());
        line.comes_back = |frame| frame % 50 > 47;
        line.run(Micros::from_secs(60));
        assert!(line.count(&Event::EchoGone) > 5, "{protocol:?}");
        line.comes_back = |_| false;
        line.run(Micros::from_secs(1));
        line.is_in_service();
    }
}

#[test]
fn a_second_master_that_asks_the_same_does_not_put_the_line_out_of_service() {
    for protocol in PROTOCOLS {
        let mut line = Line::new(protocol, Plan::default());
        let mut seed = 7_u64;
        line.run(Micros::from_secs(1));
        let end = line.drive.now + Micros::from_secs(60);
        while line.drive.now < end {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            line.run(millis(300 + (seed >> 33) % 400));
            let asked = line.polled.clone();
            let now = line.drive.now;
            line.drive.hear_at(now, &asked);
            // Its reply.
            line.drive.ask_players(now, &asked);
        }
        line.run(Micros::from_secs(1));
        line.is_in_service();
    }
}

/// The adapter begins to echo and the module dies at the same time, at any moment before or
/// between the frames of a command, also of one that is not to be verified.
#[test]
fn an_echo_that_begins_late_is_no_acknowledgement() {
    let mut lost = 0;
    for protocol in PROTOCOLS {
        for (verify, delay) in (0..60).flat_map(|delay| [(true, delay), (false, delay)]) {
            let mut line = Line::new(protocol, Plan::default());
            line.run(Micros::from_secs(3));
            let write = Op::Write(Bank::new(1, 1));
            let now = line.drive.now;
            let terms = Terms {
                verify,
                ..Terms::default()
            };
            let taken = line.drive.bus.submit(now, ModuleId(0), write, terms);
            taken.expect("taken");
            line.drive.touched();
            line.run(millis(delay));
            line.drive.echoes = true;
            line.drive.players[0].alive = false;
            line.run(Micros::from_secs(10));
            let moved = line.drive.players[0].engine.outputs() == 1;
            let end = line.told.iter().find_map(|event| match event {
                Event::Done { end, .. } => Some(*end),
                _ => None,
            });
            match end.expect("it ends") {
                Ok(Confirmation::Readback | Confirmation::Reply) => {
                    assert!(moved, "{protocol:?}, {verify} after {delay} ms");
                }
                Err(Fault::NoReply(_) | Fault::Garbled(_)) => lost += 1,
                other => panic!("{protocol:?}, {verify} after {delay} ms: {other:?}"),
            }
        }
    }
    assert!(lost > 40, "it came to it {lost} times only");
}
