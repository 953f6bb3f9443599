//! Raw frames: what one may do, and sending it. A read is sent between the polls like any other. A
//! frame that may change something is sent only if the caller has confirmed each of the words for
//! what it may do.

mod texts;

use super::{convert, failures};
use crate::frames::meaning;
use railbus_api::problem::{Problem, codes};
use railbus_api::sending::{LateAnswer, Override, SendAnswer, SendPlan, SendRequest};
use railbus_api::types::SCHEMA;
use railbus_commission::{Risk, is_answered, request};
use railbus_device::PointKind;
use railbus_host::{Fault, LateReply};
use railbus_site::config::{Place, PointConfig};
use railbus_site::{CommandError, Config, RawTerms, Service};
use railbus_wire::{
    Baud, Character, Exchange, Frame, Micros, Protocol, SerialSettings, foreign_command, lc02,
};
use railbus_words::Lang;
use railbus_words::hex;
use std::fmt::Display;
use texts::SendText;

/// Maximum length of a raw frame, in bytes.
const FRAME_MAX: usize = 256;
/// The word that lets a frame bypass the restrictions of outputs in the configuration.
pub const OVERRIDE: &str = "override";

/// A raw frame, and what it may do.
#[derive(Debug)]
pub struct RawSend {
    line: String,
    bytes: Vec<u8>,
    asked: Exchange<'static>,
    terms: RawTerms,
    /// The answer to a dry run.
    pub told: SendPlan,
}

impl RawSend {
    /// Whether it may change something.
    fn changes(&self) -> bool {
        !self.told.needs.is_empty()
    }
}

/// The bytes, completed with the frame's checksum and terminator. All modules of an ASCII line use
/// a checksum, or none does.
pub fn completed(protocol: Protocol, checksum: bool, mut bytes: Vec<u8>) -> Vec<u8> {
    match protocol {
        Protocol::Rtu => bytes.extend(railbus_wire::crc16(&bytes).to_le_bytes()),
        Protocol::R55 => bytes.push(railbus_wire::sum8(&bytes)),
        Protocol::Lc02 => {
            bytes.push(railbus_wire::sum8(bytes.get(2..).unwrap_or_default()));
            bytes.push(lc02::envelope::END);
        }
        Protocol::Ascii => {
            if bytes.last() == Some(&railbus_wire::ascii::CR) {
                bytes.pop();
            }
            if checksum {
                bytes.extend(format!("{:02X}", railbus_wire::sum8(&bytes)).bytes());
            }
            bytes.push(railbus_wire::ascii::CR);
        }
    }
    bytes
}

/// What a frame is and may do. Nothing is sent.
pub fn plan(
    service: &Service,
    lang: Lang,
    line: &str,
    wanted: &SendRequest,
) -> Result<RawSend, Problem> {
    let config = service.config();
    let Some(of_line) = config.lines.get(line) else {
        return Err(failures::no_such_line(service, line));
    };
    let protocol = protocol(&wanted.protocol)?;
    let bytes = bytes(&config, line, protocol, wanted)?;
    let bad_frame = |reason: &str| Problem::new(codes::BAD_FRAME).with("reason", reason);
    let asked = request(protocol, &bytes);
    let asked =
        asked.ok_or_else(|| bad_frame("no request of that protocol, or a wrong checksum"))?;
    let risk = Risk::of(&asked);
    let speaks = |other: &Protocol| {
        let mut modules = config.modules_of(line);
        modules.any(|(_, module)| module.setup.protocol == *other)
    };
    let spoken = Protocol::ALL.into_iter().filter(speaks);
    if let Some(other) = foreign_command(&bytes, protocol, spoken)
        && risk > Risk::Read
    {
        let reason = format!("a module of {other} on this line would take it for a command");
        return Err(bad_frame(&reason));
    }
    let modules = match risk {
        Risk::Read => Vec::new(),
        _ => service.concerned(line, &asked),
    };
    let overrides = overrides(&config, &modules);
    let word = word(risk);
    let mut needs: Vec<String> = (risk > Risk::Read)
        .then(|| word.to_owned())
        .into_iter()
        .collect();
    needs.extend((!overrides.is_empty()).then(|| OVERRIDE.to_owned()));
    let terms = RawTerms {
        settings: Some(settings(of_line.serial, &modules, &config, wanted)?),
        gap: wanted.gap_us.map(|us| Micros(us.min(1_000_000))),
        timeout: wanted
            .timeout_ms
            .map(|ms| Micros::from_millis(ms.min(10_000))),
        clear: wanted.clear && risk == Risk::Read,
    };
    let told = SendPlan {
        schema: SCHEMA,
        line: line.to_owned(),
        protocol: protocol.name().to_owned(),
        bytes: hex::spaced(&bytes),
        meaning: meaning::request(lang, &asked),
        risk: word.to_owned(),
        answered: is_answered(&asked),
        may: may(
            lang,
            &asked,
            &modules,
            &overrides,
            foreign_command(&bytes, protocol, Protocol::ALL),
        ),
        modules,
        overrides,
        needs,
    };
    Ok(RawSend {
        line: line.to_owned(),
        bytes,
        asked,
        terms,
        told,
    })
}

/// Refuses a frame whose effects this handle's rights do not cover.
pub fn check_rights(service: &Service, plan: &RawSend) -> Result<(), Problem> {
    let refused = |failure| failures::of_line(service, &plan.line, &failure);
    service.may_send(&plan.line, &plan.asked).map_err(refused)
}

/// Refuses a frame whose effects are not confirmed.
pub fn check_meant(plan: &RawSend, wanted: &SendRequest) -> Result<(), Problem> {
    let told = &plan.told;
    if told.needs.iter().all(|need| wanted.confirm.contains(need)) {
        return Ok(());
    }
    let problem = Problem::new(codes::SEND_CONFIRM).with("line", told.line.as_str());
    let problem = problem.with("risk", told.risk.as_str());
    let problem = problem.with("needs", told.needs.clone());
    Err(problem.with("may", told.may.clone()))
}

/// Sends it, and returns the result.
pub async fn carry_out(
    service: &Service,
    lang: Lang,
    plan: RawSend,
) -> Result<SendAnswer, Problem> {
    let (line, asked) = (plan.line.as_str(), plan.asked);
    let failed = |failure: CommandError| Problem {
        may_have_acted: plan.changes() && failure.may_have_acted(),
        ..failures::of_line(service, line, &failure)
    };
    let (met, audit) = if plan.changes() {
        let what = format!("send {}: {}", plan.told.needs.join("+"), plan.told.bytes);
        let sent = service.send(line, asked, plan.terms, format!("{what} ({line})"));
        let sent = sent.await.map_err(failed)?;
        (sent.met, Some(sent.audit))
    } else {
        let met = service.raw(line, asked, plan.terms).await;
        // A read has no effect.
        let met = met.map_err(|failure| match failure {
            CommandError::Line(Fault::Unknown) => failed(Fault::Closed.into()),
            failure => failed(failure),
        });
        (met?, None)
    };
    let own = met.reply(&asked);
    let found = own.and_then(|own| asked.decode_response(own).whole());
    Ok(SendAnswer {
        schema: SCHEMA,
        line: plan.line.clone(),
        sent: hex::spaced(&plan.bytes),
        meaning: plan.told.meaning.clone(),
        bytes: hex::spaced(&met.bytes),
        outcome: convert::outcome(met.outcome),
        says: found.map(|reply| meaning::response(lang, &asked, &reply.response)),
        refused: own.is_some_and(|own| railbus_site::is_refused(&asked, own)),
        after_ms: convert::millis_tenths(met.after),
        late: met.late.iter().map(late).collect(),
        audit,
    })
}

fn protocol(name: &str) -> Result<Protocol, Problem> {
    let known = Protocol::ALL
        .into_iter()
        .find(|protocol| protocol.name() == name);
    known.ok_or_else(|| {
        let names = Protocol::ALL.map(Protocol::name).to_vec();
        let problem = Problem::new(codes::BAD_REQUEST).with("reason", "\"protocol\" can't be read");
        problem.with("known", names)
    })
}

fn bytes(
    config: &Config,
    line: &str,
    protocol: Protocol,
    wanted: &SendRequest,
) -> Result<Vec<u8>, Problem> {
    let bytes = hex::parse(&wanted.bytes).filter(|bytes| bytes.len() <= FRAME_MAX);
    let bytes = bytes.ok_or_else(|| {
        let reason = "not pairs of hexadecimal digits, or too many of them";
        Problem::new(codes::BAD_FRAME).with("reason", reason)
    })?;
    if !wanted.complete {
        return Ok(bytes);
    }
    // All ASCII modules of a line agree on it.
    let mut modules = config.modules_of(line).map(|(_, module)| module.setup);
    let checksum = modules.any(|setup| setup.protocol == Protocol::Ascii && setup.checksum);
    Ok(completed(protocol, checksum, bytes))
}

/// The line's own speed and format, or those of the only module addressed, unless given explicitly.
fn settings(
    own: SerialSettings,
    modules: &[String],
    config: &Config,
    wanted: &SendRequest,
) -> Result<SerialSettings, Problem> {
    let wrong = |what: &str| Problem::new(codes::BAD_REQUEST).with("reason", what);
    let own = match modules {
        [one] => config
            .modules
            .get(one)
            .map_or(own, |module| module.setup.serial),
        _ => own,
    };
    let baud = match wanted.baud {
        None => own.baud,
        Some(rate) => Baud::from_rate(rate).ok_or_else(|| wrong("\"baud\" can't be read"))?,
    };
    let character = match &wanted.format {
        None => Some(own.character),
        Some(name) => Character::from_name(name),
    };
    Ok(SerialSettings {
        baud,
        character: character.ok_or_else(|| wrong("\"format\" can't be read"))?,
    })
}

/// What it may do, in one word.
pub const fn word(risk: Risk) -> &'static str {
    match risk {
        Risk::Read => "read",
        Risk::Output => "output",
        Risk::Kept => "settings",
        Risk::All => "broadcast",
    }
}

/// The restrictions of these modules' outputs in the configuration that a frame bypasses.
fn overrides(config: &Config, modules: &[String]) -> Vec<Override> {
    let mut all = Vec::new();
    for (name, module) in modules
        .iter()
        .filter_map(|name| config.modules.get_key_value(name))
    {
        for (point, said) in &module.points {
            let rules = rules(said);
            if point.kind == PointKind::Output && !rules.is_empty() {
                let point = config.path(&Place::new(name, *point));
                all.push(Override { point, rules });
            }
        }
    }
    all
}

fn rules(said: &PointConfig) -> Vec<String> {
    let safety = &said.safety;
    let rules = [
        ("locked", said.locked),
        ("confirm", safety.confirm.is_some()),
        ("interlock", !safety.interlock.is_empty()),
        ("max_on", safety.max_on.is_some()),
        ("min_off", safety.min_off.is_some()),
    ];
    let held = rules.into_iter().filter(|(_, holds)| *holds);
    held.map(|(rule, _)| rule.to_owned()).collect()
}

/// What it may do, in plain words.
fn may(
    lang: Lang,
    asked: &Exchange<'_>,
    modules: &[String],
    overrides: &[Override],
    stowaway: Option<Protocol>,
) -> Vec<String> {
    let risk = Risk::of(asked);
    if risk == Risk::Read {
        return Vec::new();
    }
    let names = match modules.is_empty() {
        true => lang.fill(SendText::Whoever, &[("address", &asked.address())]),
        false => modules.join(", "),
    };
    let of: &[(&str, &dyn Display)] = &[("modules", &names), ("protocol", &asked.protocol())];
    let what = match risk {
        Risk::Kept => SendText::MayKeep,
        Risk::All => SendText::MayAll,
        Risk::Read | Risk::Output => SendText::MaySwitch,
    };
    let mut told = vec![lang.fill(what, of)];
    told.extend(stowaway.map(|protocol| lang.fill(SendText::Stowaway, &[("protocol", &protocol)])));
    let rules = |one: &Override| {
        let words = one.rules.iter().map(|rule| lang.get(rule_text(rule)));
        let words = words.collect::<Vec<_>>().join(lang.get(SendText::Comma));
        let values: &[(&str, &dyn Display)] = &[("point", &one.point), ("rules", &words)];
        lang.fill(SendText::Overrides, values)
    };
    told.extend(overrides.iter().map(rules));
    told
}

fn rule_text(rule: &str) -> SendText {
    match rule {
        "locked" => SendText::Locked,
        "confirm" => SendText::Confirm,
        "interlock" => SendText::Interlock,
        "max_on" => SendText::MaxOn,
        _ => SendText::MinOff,
    }
}

fn late(reply: &LateReply) -> LateAnswer {
    let mut sent = Frame::new();
    reply.exchange.encode(&mut sent);
    LateAnswer {
        protocol: reply.exchange.protocol().name().to_owned(),
        sent: hex::spaced(sent.bytes()),
        after_ms: convert::millis_tenths(reply.after),
        again: reply.again,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_ended_as_its_protocol_wants() {
        for (protocol, checksum, begun, whole) in [
            (
                Protocol::Rtu,
                false,
                "03 01 00 3C 00 08",
                "03 01 00 3C 00 08 FC 22",
            ),
            (
                Protocol::R55,
                false,
                "55 04 10 00 00 00 00",
                "55 04 10 00 00 00 00 69",
            ),
            (Protocol::Lc02, false, "4C 57 01 03", "4C 57 01 03 04 0D"),
            (Protocol::Ascii, false, "$016", "24 30 31 36 0D"),
            (Protocol::Ascii, true, "$016", "24 30 31 36 42 42 0D"),
        ] {
            let bytes = hex::parse(begun).unwrap();
            let bytes = completed(protocol, checksum, bytes);
            assert_eq!(hex::spaced(&bytes), whole, "{protocol}");
            assert!(request(protocol, &bytes).is_some(), "{protocol}");
        }
    }
}
