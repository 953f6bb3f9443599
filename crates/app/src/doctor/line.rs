//! The line and its modules: the idle line is listened to, then the modules are read by the same
//! rules as everywhere else.

use super::finding::{Finding, Section};
use super::texts::FindingText;
use super::{hearing, port};
use crate::api::convert;
use crate::machine::Machine;
use crate::machine::users::User;
use railbus_host::{
    AnyPort, Event, Fault, Line, LineEvent, LineName, LineOptions, Module, ModuleId, Op, Plan,
    Port, SerialOptions, SerialSettings, Terms,
};
use railbus_wire::{Decoded, Protocol, ascii, lc02, r55, rtu};
use railbus_words::Lang;
use railbus_words::{hex, time};
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// Something that never stops talking is not kept for ever.
const BYTES_MAX: usize = 64 * 1024;
/// Above this part of a line's time, in percent, it counts as never silent.
const BABBLE: u64 = 80;
/// How many of the bytes heard are shown.
const SHOWN: usize = 16;

/// A line to look at.
#[derive(Debug)]
pub struct Chosen {
    /// Its name.
    pub name: String,
    /// Its port.
    pub port: LineName,
    /// How the port is set.
    pub settings: SerialSettings,
    /// Their names, their setup, and a plan without polls.
    pub modules: Vec<(String, Module, Plan)>,
    /// The configuration of the line's state machine.
    pub bus: railbus_host::Config,
}

/// Opens the port, listens, and reads each module once.
pub async fn examine(
    lang: Lang,
    machine: &Machine,
    user: &User,
    line: &Chosen,
    listen: Duration,
) -> Vec<Finding> {
    let name = line.port.to_string();
    let options = SerialOptions {
        settings: line.settings,
        ..SerialOptions::default()
    };
    let mut opened = AnyPort::new(&line.port, options);
    if let Err(error) = opened.open().await {
        let device = device_of(&line.port);
        return vec![port::closed(
            machine,
            user,
            &name,
            device.as_deref(),
            &error,
        )];
    }
    let mut found = vec![opens(lang, &name, line.settings)];
    // A gateway passes on only what it is asked for: there is nothing to listen to.
    if !matches!(line.port, LineName::ModbusTcp { .. }) {
        let heard = hear(&mut opened, listen).await;
        found.push(judge(lang, line, &heard, listen));
    }
    opened.close();
    found.extend(read(lang, line).await);
    found
}

/// The name of a port, where it is one of a serial device.
fn device_of(name: &LineName) -> Option<String> {
    match name {
        LineName::Serial(path) | LineName::Pty(path) => Some(path.display().to_string()),
        LineName::Tcp { .. } | LineName::ModbusTcp { .. } => None,
    }
}

fn opens(lang: Lang, port: &str, settings: SerialSettings) -> Finding {
    let values: &[(&str, &dyn std::fmt::Display)] = &[("port", &port), ("settings", &settings)];
    Finding::good(Section::Port, lang.fill(FindingText::PortGood, values))
}

/// What is heard in so much time.
async fn hear(port: &mut AnyPort, listen: Duration) -> Vec<u8> {
    let until = Instant::now() + listen;
    let mut heard = Vec::new();
    let mut buffer = [0; 512];
    while heard.len() < BYTES_MAX
        && let Ok(Ok(count)) = timeout_at(until, port.read(&mut buffer)).await
    {
        heard.extend_from_slice(buffer.get(..count).unwrap_or_default());
    }
    heard
}

/// The finding on bytes received without a request.
fn judge(lang: Lang, line: &Chosen, heard: &[u8], listen: Duration) -> Finding {
    let millis = u64::try_from(listen.as_millis()).unwrap_or(u64::MAX);
    let time = time::duration(lang, millis);
    if heard.is_empty() {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("line", &line.name), ("time", &time)];
        return Finding::good(Section::Line, lang.fill(FindingText::LineQuiet, values));
    }
    let bytes = hex::spaced(heard.get(..SHOWN.min(heard.len())).unwrap_or_default());
    let (count, frames) = (heard.len(), requests(heard));
    let values: &[(&str, &dyn std::fmt::Display)] = &[
        ("line", &line.name),
        ("time", &time),
        ("bytes", &bytes),
        ("count", &count),
        ("frames", &frames),
    ];
    let on_wire = line.settings.frame_time(count).0 / 1_000;
    if frames > 0 {
        let detail = lang.fill(FindingText::LineFrames, values);
        return Finding::warning(Section::Line, "D202", detail);
    }
    let detail = lang.fill(FindingText::LineHeard, values);
    if count >= BYTES_MAX || on_wire * 100 > millis * BABBLE {
        return Finding::error(Section::Line, "D204", detail);
    }
    Finding::error(Section::Line, "D201", detail)
}

/// How many good requests of any protocol the bytes hold. Noise hardly ever makes one: all but
/// those of ASCII without checksum end in a check of what came before.
fn requests(heard: &[u8]) -> usize {
    let (mut count, mut at) = (0, 0);
    while let Some(rest) = heard.get(at..).filter(|rest| !rest.is_empty()) {
        match request_len(rest) {
            Some(len) => {
                count += 1;
                at += len.max(1);
            }
            None => at += 1,
        }
    }
    count
}

fn request_len(rest: &[u8]) -> Option<usize> {
    let rules = |checksum| ascii::DecodeRules {
        checksum,
        lower_case: true,
    };
    let lens = [
        len(&r55::Exchange::decode_request(rest)),
        len(&lc02::Exchange::decode_request(rest)),
        len(&rtu::Exchange::decode_request(rest)),
        len(&ascii::Exchange::decode_request(rest, rules(true))),
        len(&ascii::Exchange::decode_request(rest, rules(false))),
    ];
    lens.into_iter().flatten().next()
}

const fn len<T>(decoded: &Decoded<T>) -> Option<usize> {
    match decoded {
        Decoded::Whole { len, .. } => Some(*len),
        _ => None,
    }
}

/// Reads each module once, and says what came of it.
async fn read(lang: Lang, line: &Chosen) -> Vec<Finding> {
    if line.modules.is_empty() {
        let text = lang.fill(FindingText::NoModules, &[("line", &line.name)]);
        return vec![Finding::good(Section::Modules, text)];
    }
    let mut config = LineOptions::new(line.port.clone());
    config.bus = line.bus;
    config.serial.settings = line.settings;
    for (_, module, plan) in &line.modules {
        config = config.with(module.clone(), *plan);
    }
    let Ok(handle) = Line::open(config) else {
        return Vec::new();
    };
    let mut events = handle.events();
    // The port was open a moment ago; where it is not now, the reads say so.
    let _ = handle.opened().await;
    let mut protocols = line.modules.iter().map(|(_, m, _)| m.setup().protocol);
    let only_modbus = protocols.all(|protocol| protocol == Protocol::Rtu);
    let (mut ends, mut hearings) = (Vec::new(), Vec::new());
    for (index, (name, module, _)) in line.modules.iter().enumerate() {
        let op = module.full_poll().next().unwrap_or(Op::ReadOutputs);
        let id = ModuleId(index);
        let end = handle.run(id, op, Terms::default()).await;
        if end.is_ok()
            && let Some(told) = hearing::ask(&handle, module).await
        {
            let at = (name.as_str(), module.setup().address);
            hearings.extend(hearing::judge(lang, at, only_modbus, told));
        }
        ends.push(end.err());
    }
    handle.close().await;
    let mut late = Vec::new();
    let mut found = Vec::new();
    while let Some(event) = events.next().await {
        match event {
            LineEvent::Bus(Event::Echo) => {
                found.push(Finding::warning(Section::Line, "D203", line.name.clone()));
            }
            LineEvent::Bus(Event::Babble) => {
                found.push(Finding::error(Section::Line, "D204", line.name.clone()));
            }
            LineEvent::Bus(Event::Late { module, .. }) => late.push(module.0),
            _ => {}
        }
    }
    found.extend(verdicts(lang, line, &ends, &late));
    found.extend(hearings);
    found
}

/// What the reads of a line's modules came to.
fn verdicts(lang: Lang, line: &Chosen, ends: &[Option<Fault>], late: &[usize]) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut answered = Vec::new();
    for (index, ((name, module, _), end)) in line.modules.iter().zip(ends).enumerate() {
        let setup = module.setup();
        let protocol = setup.protocol.name();
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("module", name),
            ("address", &setup.address),
            ("protocol", &protocol),
            ("settings", &setup.serial),
        ];
        let at = || lang.fill(FindingText::At, values);
        found.push(match end {
            None if late.contains(&index) => Finding::warning(Section::Modules, "D304", at()),
            None => {
                answered.push(name.as_str());
                continue;
            }
            Some(Fault::NoReply(met) | Fault::Garbled(met)) => {
                Finding::unanswered(lang, &at(), Some(&convert::lost(*met)))
            }
            Some(Fault::Refused(_)) => Finding::error(Section::Modules, "D303", at()),
            Some(Fault::OtherModel { .. }) => Finding::error(Section::Modules, "D307", at()),
            Some(_) => Finding::unanswered(lang, &at(), None),
        });
    }
    if answered.is_empty()
        && ends
            .iter()
            .all(|end| matches!(end, Some(Fault::NoReply(_))))
    {
        found.push(Finding::error(Section::Line, "D205", line.name.clone()));
    }
    if !answered.is_empty() {
        let (count, modules) = (answered.len(), answered.join(" "));
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("count", &count),
            ("line", &line.name),
            ("modules", &modules),
        ];
        let text = lang.fill(FindingText::Answers, values);
        found.insert(0, Finding::good(Section::Modules, text));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_bus::Evidence;
    use railbus_device::{Family, Refusal, Setup};
    use railbus_wire::{Address, Malformed};

    fn line() -> Chosen {
        let module = |address| Module::new(Setup::new(Family::Erc8, Address(address))).unwrap();
        Chosen {
            name: "main".to_owned(),
            port: "/dev/ttyUSB0".parse().unwrap(),
            settings: SerialSettings::FACTORY,
            modules: vec![
                ("oven".to_owned(), module(3), Plan::NEVER),
                ("cold".to_owned(), module(4), Plan::NEVER),
            ],
            bus: railbus_host::Config::default(),
        }
    }

    fn judged(heard: &[u8]) -> Option<&'static str> {
        judge(Lang::En, &line(), heard, Duration::from_secs(2)).code
    }

    #[test]
    fn what_is_heard_while_idle_is_told_apart() {
        assert_eq!(judged(&[]), None);
        assert_eq!(judged(&[0xFF, 0x00, 0x12]), Some("D201"));
        assert_eq!(judged(&[0x55; 1_900]), Some("D204"));
        assert_eq!(judged(b"\x00$016\r"), Some("D202"));
        // [R55 §1.1] and a Modbus request, with garbage before each.
        let mut heard = vec![0, 0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69, 0xFE];
        heard.extend([0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22]);
        assert_eq!(requests(&heard), 2);
        assert_eq!(judged(&heard), Some("D202"));
    }

    #[test]
    fn what_the_reads_came_to_is_told_module_by_module() {
        let silent = Fault::NoReply(Evidence::default());
        let told = |ends: &[Option<Fault>], late: &[usize]| {
            let found = verdicts(Lang::En, &line(), ends, late).into_iter();
            found
                .map(|finding| finding.code.unwrap_or("ok"))
                .collect::<Vec<_>>()
        };
        assert_eq!(told(&[None, None], &[]), ["ok"]);
        assert_eq!(told(&[None, None], &[1]), ["ok", "D304"]);
        assert_eq!(told(&[Some(silent), None], &[]), ["ok", "D301"]);
        assert_eq!(
            told(&[Some(silent), Some(silent)], &[]),
            ["D301", "D301", "D205"]
        );
        let met = |attempts| Evidence {
            attempts,
            garbled: 1,
            bytes: 6,
            why: Some(Malformed::Checksum),
        };
        let garbled = Fault::Garbled(met(2));
        let refused = Fault::Refused(Refusal::Invalid);
        assert_eq!(told(&[Some(garbled), Some(refused)], &[]), ["D302", "D303"]);
        // Mostly it is silent.
        let once = Fault::Garbled(met(3));
        assert_eq!(told(&[Some(once), None], &[]), ["ok", "D301"]);
    }
}
