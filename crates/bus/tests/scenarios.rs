//! Scenarios: text trace in, text trace out.
//!
//! Each file of `scenarios/` is a script, a line `---`, and the trace that the rules demand.
//! `UPDATE=1 cargo test -p railbus-bus --test scenarios` writes the traces anew; review the
//! difference against the rule in the file's heading.
//!
//! The script, one thing a line, `#` begins a remark:
//! - `config KEY=VALUE…`: `echo` (auto, on, off), `medium` (wire, buffered), `settle`,
//!   `window` (of duplicates), `probation`. Unlike the product's own, a scenario's line
//!   has `echo=off probation=0 settle=0 fences=off identify=off` unless it says otherwise.
//! - `adapter echoes`: every frame comes back when it ends.
//! - `module NAME FAMILY PROTOCOL ADDRESS [KEY=VALUE…] [polled] [unasked] [alive]`: without
//!   `polled` only commands reach it; an `unasked` one is not asked for its model; an `alive` one
//!   answers what no `answer` is left for.
//! - `at TIME open [at rest]`, `at TIME close`, `at TIME bytes HEX`, `at TIME dies|wakes NAME`,
//!   `at TIME submit NAME OP [unverified] [ttl=TIME]`, `at TIME probe NAME OP timeout=TIME`.
//! - `from TIME to TIME every TIME bytes HEX`: noise.
//! - `answer none`, or `answer DELAY HEX [+ DELAY HEX]…`: what comes back after the next frame,
//!   each piece so long after the end of the one before. `answer alive` leaves it to the modules.
//! - `until TIME`.
//!
//! TIME is a number with `us`, `ms` or `s`. HEX may hold `"text"`, `\r` being CR, and `crc` or
//! `sum`, which are of the bytes before them in the piece.

mod support;

use railbus_bus::{
    Bus, Config, Confirmation, EchoMode, Event, Fault, Input, Medium, ModuleId, Plan, PortHistory,
    Presence, Probe, Terms,
};
use railbus_device::{
    Bank, Eeprom, Engine, Family, Layout, Module, Observation, Op, Options, SettingWrite, Setup,
};
use railbus_wire::{
    Address, Baud, Channel, Character, Frame, Instant, Micros, Protocol, PulseWidth, crc16,
    r55::U24, sum8,
};
use std::collections::VecDeque;
use std::fmt::Write;
use std::path::Path;
use support::{Drive, Happening, millis};

#[test]
fn every_scenario_goes_as_the_rules_demand() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenarios");
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .expect("the folder of scenarios")
        .map(|entry| entry.expect("a file").path())
        .filter(|path| path.extension().is_some_and(|ext| ext == "txt"))
        .collect();
    files.sort();
    assert!(files.len() >= 110, "only {} scenarios", files.len());
    let update = std::env::var_os("UPDATE").is_some();
    let mut wrong = String::new();
    for path in &files {
        let text = std::fs::read_to_string(path).expect("a readable file");
        let (script, expected) = text.split_once("---\n").unwrap_or((&text, ""));
        let trace = Scenario::read(script).run();
        if update {
            std::fs::write(path, format!("{script}---\n{trace}")).expect("a writable file");
        } else if trace != expected {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let _ = write!(wrong, "== {name}\n{}", difference(expected, &trace));
        }
    }
    assert!(wrong.is_empty(), "traces differ:\n{wrong}");
}

/// The lines from the first that differs.
fn difference(expected: &str, trace: &str) -> String {
    let same = expected
        .lines()
        .zip(trace.lines())
        .take_while(|(a, b)| a == b)
        .count();
    let mut text = String::new();
    for line in expected.lines().skip(same).take(6) {
        let _ = writeln!(text, "  expected {line}");
    }
    for line in trace.lines().skip(same).take(6) {
        let _ = writeln!(text, "  happened {line}");
    }
    text
}

/// The reply to a frame.
enum Answer {
    Alive,
    Pieces(Vec<(Micros, Vec<u8>)>),
}

/// Something that happens at a given moment.
enum Action {
    Open(PortHistory),
    Close,
    Bytes(Vec<u8>),
    Power(usize, bool),
    Submit(usize, Op, String, Terms, Option<Micros>),
    Probe(usize, Op, Micros, bool),
}

struct Scenario {
    drive: Drive,
    names: Vec<String>,
    modules: Vec<Module>,
    actions: VecDeque<(Instant, Action)>,
    answers: VecDeque<Answer>,
    /// Addresses that no module answers.
    unheard: Vec<Vec<u8>>,
    until: Instant,
    trace: String,
}

impl Scenario {
    fn read(script: &str) -> Scenario {
        let mut config = Config {
            echo: EchoMode::Off,
            settle: Micros::ZERO,
            probation: 0,
            fences: false,
            identify: false,
            ..Config::default()
        };
        for line in script.lines().filter(|line| line.starts_with("config")) {
            for (key, value) in line.split_whitespace().skip(1).filter_map(pair) {
                match key {
                    "echo" => {
                        config.echo = match value {
                            "auto" => EchoMode::Auto,
                            "on" => EchoMode::On,
                            _ => EchoMode::Off,
                        };
                    }
                    "medium" if value == "buffered" => config.medium = Medium::Buffered,
                    "fences" => config.fences = value == "on",
                    "identify" => config.identify = value == "on",
                    "settle" => config.settle = span(value),
                    "window" => config.duplicate_window = span(value),
                    "probation" => config.probation = value.parse().expect("a number"),
                    _ => panic!("{line}"),
                }
            }
        }
        let mut scenario = Scenario {
            drive: Drive::new(Bus::new(config)),
            names: Vec::new(),
            modules: Vec::new(),
            actions: VecDeque::new(),
            answers: VecDeque::new(),
            unheard: Vec::new(),
            until: Instant(0),
            trace: String::new(),
        };
        for line in script.lines() {
            let line = line.split('#').next().unwrap_or_default().trim();
            scenario.read_line(line);
        }
        scenario
    }

    fn read_line(&mut self, line: &str) {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "" | "config" => {}
            "adapter" => self.drive.echoes = true,
            "module" => self.read_module(rest),
            "at" => {
                let (time, rest) = rest.split_once(' ').expect("a time and an action");
                let action = self.read_action(rest);
                self.actions.push_back((Instant(span(time).0), action));
            }
            "from" => {
                let words: Vec<&str> = rest.splitn(7, ' ').collect();
                let &[from, _, to, _, every, _, bytes] = words.as_slice() else {
                    panic!("{line}")
                };
                let (mut at, step) = (span(from).0, span(every).0);
                while at < span(to).0 {
                    self.actions
                        .push_back((Instant(at), Action::Bytes(hex(bytes))));
                    at += step;
                }
            }
            "answer" => self.answers.push_back(match rest {
                "none" => Answer::Pieces(Vec::new()),
                "alive" => Answer::Alive,
                pieces => Answer::Pieces(
                    pieces
                        .split('+')
                        .map(|piece| {
                            let (delay, bytes) = piece.trim().split_once(' ').expect("a piece");
                            (span(delay), hex(bytes))
                        })
                        .collect(),
                ),
            }),
            "until" => self.until = Instant(span(rest).0),
            _ => panic!("{line}"),
        }
    }

    fn read_module(&mut self, text: &str) {
        let words: Vec<&str> = text.split_whitespace().collect();
        let &[name, family, protocol, address, ref options @ ..] = words.as_slice() else {
            panic!("module {text}")
        };
        let family = Family::from_name(family).expect("a family");
        let address = Address(address.parse().expect("an address"));
        let mut setup = Setup {
            protocol: Protocol::ALL
                .into_iter()
                .find(|known| known.name() == protocol)
                .expect("a protocol"),
            ..Setup::new(family, address)
        };
        let mut plan = Plan {
            enabled: false,
            ..Plan::default()
        };
        let (mut alive, mut turnaround) = (false, millis(2));
        let (mut mute, mut unknown) = (false, false);
        for option in options {
            match *option {
                "polled" => plan.enabled = true,
                "unasked" => plan.identify = false,
                "alive" => alive = true,
                "mute" => mute = true,
                "unknown" => unknown = true,
                "checksum" => setup.checksum = true,
                "mixed" => setup.layout = Layout::Mixed,
                "8E1" => setup.serial.character = Character::E1,
                option => {
                    let (key, value) = pair(option).expect("a key and a value");
                    match key {
                        "baud" => {
                            let rate = value.parse().expect("a speed");
                            setup.serial.baud = Baud::from_rate(rate).expect("a speed");
                        }
                        "outputs" => setup.outputs = value.parse().expect("a number"),
                        "inputs" => setup.inputs = value.parse().expect("a number"),
                        "variables" => setup.variables = value.parse().expect("a number"),
                        "gap" => setup.gap = Some(span(value)),
                        "interval" => plan.interval = span(value),
                        "age" => plan.max_age = span(value),
                        "turnaround" => turnaround = span(value),
                        _ => panic!("{option}"),
                    }
                }
            }
        }
        let module = Module::new(setup).expect("a possible module");
        if !unknown {
            self.drive.bus.add(module.clone(), plan);
        }
        for op in [Op::Identify, Op::Fence, Op::ReadPulse] {
            if let Ok(exchange) = module.exchange(&op)
                && mute
            {
                let mut frame = Frame::new();
                exchange.encode(&mut frame);
                self.unheard.push(frame.bytes().to_vec());
            }
        }
        self.names.push(name.to_owned());
        self.modules.push(module);
        let options = Options {
            turnaround,
            ..Options::default()
        };
        let engine = Engine::new(&setup, Eeprom::of(&setup), options, Instant(0));
        self.drive.play(engine.expect("a possible module"));
        if let Some(player) = self.drive.players.last_mut() {
            player.alive = alive;
        }
    }

    fn read_action(&self, text: &str) -> Action {
        let (word, rest) = text.split_once(' ').unwrap_or((text, ""));
        match word {
            "open" => Action::Open(match rest {
                "" => PortHistory::Unknown,
                "at rest" => PortHistory::Rested,
                "abandoned" => PortHistory::Abandoned,
                other => panic!("opened how? {other}"),
            }),
            "close" => Action::Close,
            "bytes" => Action::Bytes(hex(rest)),
            "dies" | "wakes" => Action::Power(self.module(rest), word == "wakes"),
            "submit" | "probe" | "master" => {
                let mut terms = Terms::default();
                let (mut ttl, mut timeout) = (None, millis(100));
                let mut words: Vec<&str> = rest.split_whitespace().collect();
                words.retain(|word| match (*word, pair(word)) {
                    ("unverified", _) => {
                        terms.verify = false;
                        false
                    }
                    (_, Some(("ttl", value))) => {
                        ttl = Some(span(value));
                        false
                    }
                    (_, Some(("timeout", value))) => {
                        timeout = span(value);
                        false
                    }
                    _ => true,
                });
                let module = self.module(words[0]);
                let op = op(&words[1..]);
                match word {
                    "submit" => Action::Submit(module, op, words[1..].join(" "), terms, ttl),
                    word => Action::Probe(module, op, timeout, word == "master"),
                }
            }
            _ => panic!("at … {text}"),
        }
    }

    fn module(&self, name: &str) -> usize {
        self.names
            .iter()
            .position(|known| known == name)
            .unwrap_or_else(|| panic!("no module {name}"))
    }

    fn run(mut self) -> String {
        self.actions.make_contiguous().sort_by_key(|(at, _)| *at);
        while let Some((at, action)) = self.actions.pop_front() {
            self.run_until(at);
            self.act(action);
        }
        self.run_until(self.until);
        if !self.answers.is_empty() {
            let left = self.answers.len();
            self.note("left", &format!("{left} answers that no request came for"));
        }
        self.trace
    }

    fn run_until(&mut self, until: Instant) {
        while let Some(happening) = self.drive.step(until) {
            match happening {
                Happening::Frame {
                    bytes,
                    settings,
                    end,
                } => {
                    let speed = if settings == railbus_wire::SerialSettings::FACTORY {
                        String::new()
                    } else {
                        format!("  ({settings})")
                    };
                    self.note("tx", &format!("{}{speed}", shown(&bytes)));
                    self.answer(&bytes, settings, end);
                }
                Happening::Heard(bytes) => self.note("rx", &shown(&bytes)),
                Happening::Told(event) => {
                    let text = self.event(&event);
                    self.note("event", &text);
                }
            }
        }
    }

    fn answer(&mut self, request: &[u8], settings: railbus_wire::SerialSettings, end: Instant) {
        match self.answers.pop_front() {
            None | Some(Answer::Alive) if self.unheard.iter().any(|other| other == request) => {}
            None | Some(Answer::Alive) => self.drive.ask_players(end, request),
            Some(Answer::Pieces(pieces)) => {
                let mut at = end;
                for (delay, bytes) in pieces {
                    at = at + delay + settings.frame_time(bytes.len());
                    self.drive.hear_at(at, &bytes);
                }
            }
        }
    }

    fn act(&mut self, action: Action) {
        let now = self.drive.now;
        match action {
            Action::Open(past) => {
                let how = match past {
                    PortHistory::Unknown => "open",
                    PortHistory::Rested => "open at rest",
                    PortHistory::Abandoned => "open abandoned",
                };
                self.note("call", how);
                self.drive.bus.found(past);
                self.drive.input(Input::Opened);
            }
            Action::Close => {
                self.note("call", "close");
                self.drive.input(Input::Closed);
            }
            Action::Bytes(bytes) => {
                self.note("rx", &shown(&bytes));
                self.drive.input(Input::Bytes(&bytes));
            }
            Action::Power(module, on) => {
                let name = self.names[module].clone();
                self.note(
                    "call",
                    &format!("{name} {}", if on { "wakes" } else { "dies" }),
                );
                self.drive.players[module].alive = on;
            }
            Action::Submit(module, op, text, terms, ttl) => {
                let terms = Terms {
                    expires: ttl.map(|ttl| now + ttl),
                    ..terms
                };
                let name = self.names[module].clone();
                let (text, times) = match text.split_once(" times=") {
                    Some((text, times)) => (text, times.parse().expect("a number")),
                    None => (text.as_str(), 1),
                };
                for _ in 0..times {
                    let taken = self.drive.bus.submit(now, ModuleId(module), op, terms);
                    let answer = match taken {
                        Ok(ticket) => format!("#{}", ticket.0),
                        Err(fault) => fault.to_string(),
                    };
                    self.note("call", &format!("submit {name} {text} -> {answer}"));
                }
                self.drive.touched();
            }
            Action::Probe(module, op, timeout, as_module) => {
                let setup = *self.modules[module].setup();
                let exchange = self.modules[module].exchange(&op).expect("an exchange");
                let probe = Probe {
                    exchange,
                    settings: setup.serial,
                    gap: setup.request_gap(),
                    timeout,
                    clear: false,
                    changes: !op.is_read(),
                    as_module,
                };
                let taken = self.drive.bus.submit_probe(now, probe);
                self.note("call", &format!("probe -> {taken}"));
                self.drive.touched();
            }
        }
    }

    fn note(&mut self, kind: &str, text: &str) {
        let now = self.drive.now.0;
        let line = format!("{kind:<5} {text}");
        if kind == "rx" && self.trace.ends_with(&format!("{line}\n")) {
            // Noise comes at every step: once is enough.
            return;
        }
        let _ = writeln!(self.trace, "{now:>9} {line}");
    }

    fn event(&self, event: &Event) -> String {
        let name = |id: &ModuleId| &self.names[id.0];
        match event {
            Event::Seen {
                module,
                op,
                seen,
                asked,
                ..
            } => format!(
                "seen {} {} {} asked {}",
                name(module),
                op_text(op),
                seen_text(seen),
                asked.0
            ),
            Event::Missed { module, op, fault } => {
                format!(
                    "missed {} {} {}",
                    name(module),
                    op_text(op),
                    fault_text(fault)
                )
            }
            Event::Done { ticket, end, took } => {
                let end = match end {
                    Ok(Confirmation::Readback) => "readback".to_owned(),
                    Ok(Confirmation::Reply) => "reply".to_owned(),
                    Ok(Confirmation::Sent) => "sent".to_owned(),
                    Err(fault) => fault_text(fault),
                };
                format!("done #{} {end} after {}", ticket.0, took.0)
            }
            Event::Presence { module, presence } => {
                let presence = match presence {
                    Presence::Unheard => "unheard",
                    Presence::Online => "online",
                    Presence::Silent => "silent",
                    Presence::OtherModel => "other-model",
                };
                format!("{} {presence}", name(module))
            }
            Event::Late { module, after } => format!("late {} after {}", name(module), after.0),
            Event::Echo => "echo".to_owned(),
            Event::EchoGone => "echo gone".to_owned(),
            Event::Duplicates => "duplicates".to_owned(),
            Event::Overflow { lost } => format!("overflow: {lost} lost"),
            Event::Babble => "babble".to_owned(),
            Event::Quiet => "quiet".to_owned(),
            Event::ProbedLate { after, again, .. } => {
                format!("probed late after {} again={again}", after.0)
            }
            Event::Probed { outcome, after } => format!("probed {outcome:?} after {}", after.0),
        }
    }
}

/// A key and a value.
fn pair(word: &str) -> Option<(&str, &str)> {
    word.split_once('=')
}

/// A time with its unit.
fn span(text: &str) -> Micros {
    let at = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(at);
    let number: u64 = number.parse().unwrap_or_else(|_| panic!("time {text}"));
    match unit {
        "us" => Micros(number),
        "ms" => Micros::from_millis(number),
        "s" => Micros::from_secs(number),
        _ if number == 0 => Micros::ZERO,
        _ => panic!("time {text}"),
    }
}

/// Bytes in hexadecimal or quoted, with `crc` and `sum` of those before them.
fn hex(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in text.split_whitespace() {
        if let Some(quoted) = word.strip_prefix('"') {
            let quoted = quoted.strip_suffix('"').expect("a closing quote");
            bytes.extend(quoted.replace("\\r", "\r").bytes());
        } else if word == "crc" {
            let crc = crc16(&bytes);
            bytes.extend(crc.to_le_bytes());
        } else if word == "sum" {
            bytes.push(sum8(&bytes));
        } else {
            for pair in word.as_bytes().chunks(2) {
                let pair = std::str::from_utf8(pair).expect("ASCII");
                bytes.push(u8::from_str_radix(pair, 16).unwrap_or_else(|_| panic!("hex {text}")));
            }
        }
    }
    bytes
}

/// Bytes as the trace shows them: as text where they are.
fn shown(bytes: &[u8]) -> String {
    let is_text = |byte: &u8| byte.is_ascii_graphic() || *byte == b'\r';
    if !bytes.is_empty() && bytes.iter().all(is_text) && bytes.ends_with(b"\r") {
        return format!(
            "\"{}\"",
            String::from_utf8_lossy(bytes).replace('\r', "\\r")
        );
    }
    let mut text = String::new();
    for byte in bytes {
        let _ = write!(text, "{byte:02X} ");
    }
    text.trim_end().to_owned()
}

/// An op: `read`, `inputs`, `analogs`, `pulses`, `config`, `identity`, `write 0=on,3=off`,
/// `write 0-15=310D`, `silent 0=on`, `toggle 0,1`, `jog 0 MILLIS`, `set-pulse 0,1 TENTHS`,
/// `variable N`, `set-variable N VALUE`.
fn op(words: &[&str]) -> Op {
    let number = |index: usize| words[index].parse::<u32>().expect("a number");
    let u24 = |index| U24::new(number(index)).expect("24 bits");
    match words[0] {
        "read" => Op::ReadOutputs,
        "inputs" => Op::ReadInputs,
        "analogs" => Op::ReadAnalogs,
        "pulses" => Op::ReadPulse,
        "config" => Op::ReadConfig,
        "identity" => Op::Identify,
        "write" => Op::Write(bank(words[1])),
        "silent" => Op::WriteSilent(bank(words[1])),
        "toggle" => Op::Toggle(mask(words[1])),
        "jog" => Op::Jog {
            channel: Channel::new(number(1) as u8).expect("a channel"),
            close: true,
            millis: u24(2),
        },
        "set-pulse" => Op::Configure(SettingWrite::Pulse {
            mask: mask(words[1]) as u8,
            width: PulseWidth::from_tenths(number(2) as u8).expect("a width"),
        }),
        "variable" => Op::ReadVariable(number(1) as u8),
        "set-variable" => Op::WriteVariable(number(1) as u8, u24(2)),
        other => panic!("op {other}"),
    }
}

fn mask(text: &str) -> u32 {
    text.split(',')
        .map(|bit| 1 << bit.parse::<u32>().expect("a channel"))
        .sum()
}

fn bank(text: &str) -> Bank {
    let mut bank = Bank::default();
    for (channel, state) in text.split(',').filter_map(pair) {
        if let Some((first, last)) = channel.split_once('-') {
            let (first, last) = (mask(first), mask(last));
            let states = u32::from_str_radix(state, 16).expect("states in hexadecimal");
            return Bank::new(last | (last - first), states * first);
        }
        let bit = mask(channel);
        let on = if state == "on" { bit } else { 0 };
        bank = Bank::new(bank.mask | bit, bank.on | on);
    }
    bank
}

fn bank_text(bank: &Bank) -> String {
    let channels = (0..32u32).filter(|bit| bank.mask >> bit & 1 == 1);
    let states = channels.rev().map(|bit| bank.on >> bit & 1);
    states
        .map(|state| if state == 1 { '1' } else { '0' })
        .collect()
}

fn op_text(op: &Op) -> String {
    match op {
        Op::ReadOutputs => "read".to_owned(),
        Op::ReadInputs => "inputs".to_owned(),
        Op::ReadAnalogs => "analogs".to_owned(),
        Op::ReadPulse => "pulses".to_owned(),
        Op::ReadConfig => "config".to_owned(),
        Op::Identify => "identity".to_owned(),
        Op::Write(_) => "write".to_owned(),
        Op::Toggle(_) => "toggle".to_owned(),
        Op::Jog { .. } => "jog".to_owned(),
        Op::ReadVariable(index) => format!("variable {index}"),
        Op::WriteVariable(index, _) => format!("set-variable {index}"),
        other => format!("{other:?}"),
    }
}

fn seen_text(seen: &Observation) -> String {
    match seen {
        Observation::Channels { outputs, inputs } if inputs.mask == 0 => {
            format!("out={}", bank_text(outputs))
        }
        Observation::Channels { outputs, inputs } if outputs.mask == 0 => {
            format!("in={}", bank_text(inputs))
        }
        Observation::Channels { outputs, inputs } => {
            format!("out={} in={}", bank_text(outputs), bank_text(inputs))
        }
        Observation::Analogs([first, second]) => format!("{first} {second}"),
        Observation::Pulse { mask, width } => format!("mask={mask:04b} tenths={}", width.tenths()),
        Observation::Variable(index, value) => format!("v{index}={}", value.get()),
        Observation::Name(name) => name.as_str().to_owned(),
        Observation::Model(number) => format!("{number:04X}"),
        other => format!("{other:?}"),
    }
}

fn fault_text(fault: &Fault) -> String {
    match fault {
        Fault::NoReply(e) | Fault::Garbled(e) => {
            let why = match e.why {
                Some(why) => format!(": {why}"),
                None => String::new(),
            };
            let (attempts, garbled, bytes) = (e.attempts, e.garbled, e.bytes);
            // Where they are not all alike.
            let garbled = match garbled {
                0 => String::new(),
                all if all == attempts => String::new(),
                some => format!("{some} garbled, "),
            };
            format!("{fault} ({attempts} tried, {garbled}{bytes} bytes{why})")
        }
        Fault::Refused(refusal) => format!("{fault} ({refusal:?})"),
        Fault::OtherModel { sent: true } => format!("{fault} (sent)"),
        _ => fault.to_string(),
    }
}
