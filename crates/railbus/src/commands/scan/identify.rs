//! What a module is, by what it answers: a table of facts of the datasheets.

use super::plan::Ask;
use railbus_device::Family;
use railbus_wire::{Address, Response, ascii, lc02, rtu};

/// A question and the bytes that came back; none where it was silent.
pub(super) type Answer = (Ask, Vec<u8>);

/// What a module is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Identity {
    /// Its model, or the name that it gives itself.
    pub(super) model: Option<String>,
    /// By which of the answers it is known.
    pub(super) by_behaviour: bool,
    /// Nothing but refusals came back.
    pub(super) refused: bool,
}

/// Whether a response shows the family at that address.
type Shows = fn(Address, &Response<'_>) -> bool;

/// How a family is known: it says so itself, or it behaves so.
struct Rule {
    ask: Ask,
    shows: Shows,
    family: Family,
    by_behaviour: bool,
}

const RULES: &[Rule] = &[
    // [EDA §3.7], and the same as two BCD bytes.
    rule(
        Ask::Lc02Config,
        |_, r| model(r, [0x9060, 9060]),
        Family::Eda9060a,
    ),
    rule(
        Ask::Lc02Config,
        |_, r| model(r, [0x9050, 9050]),
        Family::Eda9050,
    ),
    // [EDA9060A §1.2]
    rule(
        Ask::AsciiName(false),
        |_, r| name(r, "9060"),
        Family::Eda9060a,
    ),
    rule(
        Ask::AsciiName(true),
        |_, r| name(r, "9060"),
        Family::Eda9060a,
    ),
    rule(
        Ask::AsciiName(false),
        |_, r| name(r, "9050"),
        Family::Eda9050,
    ),
    rule(
        Ask::AsciiName(true),
        |_, r| name(r, "9050"),
        Family::Eda9050,
    ),
    // [EDA9060A §6.18]
    rule(
        Ask::Registers4,
        |address, r| {
            words(r).is_some_and(|[model, at]| {
                [0x9060, 9060].contains(&model) && at >> 8 == u16::from(address.0)
            })
        },
        Family::Eda9060a,
    ),
    behaviour(
        Ask::Registers8,
        |address, r| words(r).is_some_and(|[_, at]| at == u16::from(address.0)),
        Family::Emd2a2q,
    ),
    behaviour(Ask::Coils60, |_, r| is_bits(r), Family::Erc8),
    // A 0x55 board tells neither its model nor how many relays it has.
    behaviour(Ask::R55State, |_, _| true, Family::R55),
];

const fn rule(ask: Ask, shows: Shows, family: Family) -> Rule {
    Rule {
        ask,
        shows,
        family,
        by_behaviour: false,
    }
}

const fn behaviour(ask: Ask, shows: Shows, family: Family) -> Rule {
    Rule {
        ask,
        shows,
        family,
        by_behaviour: true,
    }
}

/// What the answers of one module say.
pub(super) fn identify(address: Address, answers: &[Answer]) -> Identity {
    let said = |ask: Ask, bytes: &[u8], look: &dyn Fn(&Response<'_>) -> bool| {
        let reply = ask.exchange(address).and_then(|exchange| {
            let (_, found) = exchange.find_response(bytes);
            found.whole().map(|reply| look(&reply.response))
        });
        reply.unwrap_or(false)
    };
    let refused = answers
        .iter()
        .all(|(ask, bytes)| said(*ask, bytes, &is_refusal));
    for rule in RULES {
        let shown = answers.iter().any(|(ask, bytes)| {
            let look =
                |response: &Response<'_>| !is_refusal(response) && (rule.shows)(address, response);
            *ask == rule.ask && said(*ask, bytes, &look)
        });
        if shown {
            return Identity {
                model: Some(rule.family.to_string()),
                by_behaviour: rule.by_behaviour,
                refused,
            };
        }
    }
    Identity {
        model: named(address, answers).or_else(|| silent_on_registers(answers)),
        by_behaviour: true,
        refused,
    }
}

/// An EDA9050 answers coils and is silent when asked for registers [EDA9050 §5.1].
fn silent_on_registers(answers: &[Answer]) -> Option<String> {
    let coils = answers
        .iter()
        .any(|(ask, bytes)| *ask == Ask::Coils0 && bytes.len() > 5);
    let silent = answers
        .iter()
        .any(|(ask, bytes)| *ask == Ask::Registers4 && bytes.is_empty());
    (coils && silent).then(|| Family::Eda9050.to_string())
}

/// The name that a module of no known family gives itself.
fn named(address: Address, answers: &[Answer]) -> Option<String> {
    answers.iter().find_map(|(ask, bytes)| {
        let exchange = ask.exchange(address)?;
        match exchange.find_response(bytes).1.whole()?.response {
            Response::Ascii(ascii::Response::Text(text)) => Some(text.as_str().to_owned()),
            _ => None,
        }
    })
}

fn model(response: &Response<'_>, wanted: [u16; 2]) -> bool {
    let model = match response {
        Response::Lc02(lc02::Response::Config { model, .. }) => *model,
        _ => return false,
    };
    wanted.contains(&model)
}

fn name(response: &Response<'_>, wanted: &str) -> bool {
    match response {
        Response::Ascii(ascii::Response::Text(text)) => text.as_str().starts_with(wanted),
        _ => false,
    }
}

fn words(response: &Response<'_>) -> Option<[u16; 2]> {
    match response {
        Response::Rtu(rtu::Response::Words(words)) => Some([words.get(0)?, words.get(1)?]),
        _ => None,
    }
}

const fn is_bits(response: &Response<'_>) -> bool {
    matches!(response, Response::Rtu(rtu::Response::Bits(_)))
}

const fn is_refusal(response: &Response<'_>) -> bool {
    matches!(
        response,
        Response::Rtu(rtu::Response::Exception(_))
            | Response::Ascii(ascii::Response::Invalid | ascii::Response::Ignored)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::scan::plan::{Scope, follow_ups};
    use railbus_device::{Eeprom, Engine, Input, Options, Output, Setup};
    use railbus_wire::{Frame, Instant, Micros, Protocol};

    /// What a module's own engine answers.
    fn answer(setup: &Setup, ask: Ask) -> Vec<u8> {
        let mut now = Instant(0);
        let mut engine = Engine::new(setup, Eeprom::of(setup), Options::default(), now).unwrap();
        let exchange = ask.exchange(setup.address).unwrap();
        let mut frame = Frame::new();
        exchange.encode(&mut frame);
        let end = now + Micros::from_secs(1);
        let mut rest = frame.bytes().iter();
        loop {
            match engine.poll() {
                Output::Transmit(reply) => return reply.to_vec(),
                Output::Effect(_) => {}
                Output::Wait(at) => match (rest.next(), at) {
                    (Some(byte), _) => {
                        now = now + setup.serial.frame_time(1);
                        engine.handle(now, Input::Bytes(&[*byte]));
                    }
                    (None, Some(at)) if at < end => {
                        now = at;
                        engine.handle(now, Input::Timeout);
                    }
                    (None, _) => return Vec::new(),
                },
            }
        }
    }

    #[test]
    fn every_family_is_found_and_known_in_every_protocol() {
        for family in Family::ALL {
            for protocol in family.profile().protocols {
                let setup = Setup {
                    protocol: *protocol,
                    ..Setup::new(family, Address(5))
                };
                let scope = Scope {
                    addresses: vec![5],
                    protocols: Protocol::ALL.to_vec(),
                    checksums: vec![false, true],
                };
                let mut answers: Vec<Answer> = Vec::new();
                for ask in scope
                    .asks()
                    .into_iter()
                    .filter(|ask| ask.protocol() == *protocol)
                {
                    let bytes = answer(&setup, ask);
                    if !bytes.is_empty() && answers.is_empty() {
                        answers.push((ask, bytes));
                        for next in follow_ups(ask) {
                            answers.push((*next, answer(&setup, *next)));
                        }
                    }
                }
                let identity = identify(setup.address, &answers);
                assert_eq!(
                    identity.model,
                    Some(family.to_string()),
                    "{protocol} {answers:?}"
                );
            }
        }
    }
}
