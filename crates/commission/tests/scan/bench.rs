//! A simulated line, the line's state machine, and a scan that drives it.

use railbus_bus::LateReply;
use railbus_bus::{Bus, Config, Event, Input, Output, Probed};
use railbus_commission::scan::{FoundModule, ProbeOutcome, ScanStep, Scanner, Scope};
use railbus_device::{Eeprom, Effect, Family, Options, Setup};
use railbus_sim::{
    Act, Chunks, Input as Told, Output as Does, Power, SlotId, VirtualLine, VirtualLineConfig,
};
use railbus_wire::{Address, Baud, Exchange, Frame, Instant, Micros, Protocol, SerialSettings};

/// How a scan went.
#[derive(Debug)]
pub(crate) struct Ran {
    /// What was found, by speed, address and protocol.
    pub(crate) found: Vec<String>,
    pub(crate) all: Vec<FoundModule>,
    /// From the first request to the end.
    pub(crate) took: Micros,
    /// The estimate at its beginning.
    pub(crate) estimate: Micros,
    /// After each request: the time so far, and the estimate of what is left.
    pub(crate) estimates: Vec<(Micros, Micros)>,
    /// All frames that were sent.
    pub(crate) frames: Vec<Vec<u8>>,
    pub(crate) scanner: Scanner,
}

pub(crate) struct Bench {
    pub(crate) line: VirtualLine,
    pub(crate) now: Instant,
    bus: Bus,
    deadline: Option<Instant>,
    /// Bytes received since the last frame.
    heard: Vec<u8>,
    late: Vec<LateReply>,
    probed: Option<(Probed, Micros)>,
    frames: Vec<Vec<u8>>,
    /// A module that drops its reply as soon as anything else is sent, in any protocol.
    shy: Vec<SlotId>,
    /// How often an output moved or a setting changed.
    pub(crate) moved: usize,
}

impl Bench {
    pub(crate) fn new() -> Bench {
        let mut bench = Bench {
            line: VirtualLine::new(VirtualLineConfig {
                seed: 7,
                chunks: Chunks::Single,
                ..VirtualLineConfig::default()
            }),
            now: Instant(0),
            bus: Bus::new(Config::default()),
            deadline: None,
            heard: Vec::new(),
            late: Vec::new(),
            probed: None,
            frames: Vec::new(),
            shy: Vec::new(),
            moved: 0,
        };
        bench.bus.handle(bench.now, Input::Opened);
        bench
    }

    /// A module that begins to answer after this many milliseconds.
    pub(crate) fn add(&mut self, setup: &Setup, turnaround: u64) -> SlotId {
        self.add_made_by(setup, turnaround, false)
    }

    /// As above, and it drops its reply as soon as anything else is sent.
    pub(crate) fn add_shy(&mut self, setup: &Setup, turnaround: u64) {
        let module = self.add(setup, turnaround);
        self.shy.push(module);
    }

    /// Enables the extensions of one of our own modules.
    pub(crate) fn add_made_by(&mut self, setup: &Setup, turnaround: u64, us: bool) -> SlotId {
        let options = Options {
            extensions: us,
            turnaround: Micros::from_millis(turnaround),
            // Families whose datasheets have them.
            insist_on_gap: matches!(setup.family, Family::Erc8 | Family::Emd2a2q),
            ..Options::default()
        };
        let name = format!("{}-{}", setup.protocol, setup.address.0);
        let added = self
            .line
            .add(self.now, &name, setup, Eeprom::of(setup), options);
        added.expect("a possible module")
    }

    /// Switches an output on before the scan.
    pub(crate) fn switch_on(&mut self, exchange: &Exchange<'_>, settings: SerialSettings) {
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        let bytes = frame.bytes();
        self.line.handle(self.now, Told::Send { bytes, settings });
        let end = self.now + Micros::from_millis(200);
        let before = self.moved;
        while self.now < end {
            match self.line.poll() {
                Does::Effect { effect, .. } => self.moved += usize::from(moves(&effect)),
                Does::Heard { .. } => {}
                Does::Wait(next) => {
                    self.now = next.map_or(end, |next| next.min(end));
                    self.line.handle(self.now, Told::Timeout);
                }
            }
        }
        assert!(self.moved > before, "an output is on");
        self.moved = before;
    }

    pub(crate) fn scan(&mut self, scope: Scope) -> Ran {
        self.drive(Scanner::new(scope), usize::MAX)
    }

    /// Scans, but sends no more than this many requests.
    pub(crate) fn drive(&mut self, mut scanner: Scanner, questions: usize) -> Ran {
        let began = self.now;
        let estimate = scanner.progress().left;
        let (mut asked, mut estimates) = (0, Vec::new());
        while asked < questions {
            match scanner.next(self.now) {
                ScanStep::Ask(probe) => {
                    asked += 1;
                    assert!(self.bus.submit_probe(self.now, probe));
                    let met = self.wait();
                    scanner.met(self.now, met);
                    let progress = scanner.progress();
                    assert!(progress.done <= progress.total, "{progress:?}");
                    estimates.push((self.now.since(began), progress.left));
                }
                ScanStep::Found(_) => {}
                ScanStep::Done => {
                    let progress = scanner.progress();
                    assert_eq!(progress.done, progress.total, "it ends as it was told");
                    break;
                }
            }
        }
        let all = scanner.found().to_vec();
        let mut found: Vec<String> = all.iter().map(told).collect();
        found.sort();
        Ran {
            found,
            all,
            took: self.now.since(began),
            estimate,
            estimates,
            frames: std::mem::take(&mut self.frames),
            scanner,
        }
    }

    fn wait(&mut self) -> ProbeOutcome {
        loop {
            self.drain();
            if let Some((outcome, after)) = self.probed.take() {
                return ProbeOutcome {
                    outcome,
                    bytes: std::mem::take(&mut self.heard),
                    after,
                    late: std::mem::take(&mut self.late),
                };
            }
            self.go_on();
        }
    }

    /// Executes the line's outputs until it waits.
    fn drain(&mut self) {
        loop {
            match self.bus.poll() {
                Output::Transmit { bytes, settings } => {
                    self.heard.clear();
                    for module in &self.shy {
                        let forget = Act::Power(Power::Cycle);
                        self.line.handle(self.now, Told::Act(*module, forget));
                    }
                    self.frames.push(bytes.to_vec());
                    self.line.handle(self.now, Told::Send { bytes, settings });
                }
                Output::Event(Event::Probed { outcome, after }) => {
                    self.probed = Some((outcome, after));
                }
                Output::Event(Event::ProbedLate {
                    exchange,
                    after,
                    again,
                }) => self.late.push(LateReply {
                    exchange,
                    after,
                    again,
                }),
                Output::Event(_) => {}
                Output::Wait(at) => {
                    self.deadline = at;
                    return;
                }
            }
        }
    }

    /// Advances to the next moment at which anything happens.
    fn go_on(&mut self) {
        match self.line.poll() {
            Does::Heard { at, bytes } => {
                self.now = self.now.max(at);
                self.heard.extend_from_slice(bytes);
                self.bus.handle(self.now, Input::Bytes(bytes));
            }
            Does::Effect { effect, .. } => {
                self.moved += usize::from(moves(&effect));
            }
            Does::Wait(next) => {
                let deadline = self.deadline.expect("the line never waits for nothing");
                match next {
                    Some(next) if next < deadline => {
                        self.now = self.now.max(next);
                        self.line.handle(self.now, Told::Timeout);
                    }
                    _ => {
                        self.now = self.now.max(deadline);
                        self.line.handle(self.now, Told::Timeout);
                        self.bus.handle(self.now, Input::Timeout);
                    }
                }
            }
        }
    }
}

/// Whether a module did more than blink.
const fn moves(effect: &Effect) -> bool {
    !matches!(effect, Effect::Led(_))
}

/// A module found, as one line of text.
pub(crate) fn told(found: &FoundModule) -> String {
    let model = found.identity.model.as_deref().unwrap_or("?");
    let checksum = match found.checksum() {
        Some(true) => " sum",
        _ => "",
    };
    format!(
        "{} {:03} {}{checksum} {model} {}",
        found.asked.settings,
        found.asked.address.0,
        found.protocol(),
        found.verdict().name(),
    )
}

/// A module of the family, in a protocol and speed.
pub(crate) fn module(family: Family, address: u8, protocol: Protocol, baud: Baud) -> Setup {
    Setup {
        protocol,
        serial: SerialSettings {
            baud,
            ..SerialSettings::FACTORY
        },
        ..Setup::new(family, Address(address))
    }
}
