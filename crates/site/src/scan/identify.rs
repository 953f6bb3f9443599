//! What a module is, by what it answers: a table of facts of the datasheets.

use super::ask::{Ask, Question};
use railbus_device::Family;
use railbus_wire::{Address, Protocol, Response, ascii, lc02, rtu};

/// A question and the bytes that came back; none where it was silent.
pub type Answer = (Ask, Vec<u8>);

/// What a module is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Its family, where it is one of the five.
    pub family: Option<Family>,
    /// Its model, or the name that it gives itself.
    pub model: Option<String>,
    /// It does not say what it is, but behaves so.
    pub by_behaviour: bool,
    /// Nothing but refusals came back.
    pub refused: bool,
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
    rule(Ask::Registers4, is_eda9060a, Family::Eda9060a),
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

/// How a module took a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Took {
    Answered,
    Refused,
    Silent,
}

/// What is to be asked next of a module that has answered, to find out what it is; nothing where
/// that is known, or can't be known.
pub(super) fn follow_up(asked: Question, answers: &[Answer]) -> Option<Ask> {
    let took = |ask: Ask| took(asked.with(ask), answers);
    let unasked = |ask: Ask| took(ask).is_none().then_some(ask);
    match asked.ask {
        Ask::Coils0 if took(Ask::Coils0) == Some(Took::Answered) => match took(Ask::Registers4) {
            None => Some(Ask::Registers4),
            Some(Took::Silent) => unasked(Ask::NineCoils),
            Some(_) => None,
        },
        Ask::Registers4 if shows(asked, answers, is_eda9060a) => None,
        Ask::Coils0 | Ask::Registers4 => match took(Ask::Coils60) {
            None => Some(Ask::Coils60),
            Some(Took::Answered) => None,
            Some(_) => unasked(Ask::Registers8),
        },
        _ => None,
    }
}

/// What a module that was found is to be asked yet, so that it says of itself what it is. A module
/// of the makers' refuses that, or an EDA module is silent: it is asked what costs less first.
pub(super) fn describe(asked: Question, answers: &[Answer]) -> Option<Ask> {
    let was_asked = |ask: Ask| answers.iter().any(|(known, _)| *known == ask);
    let knows = |ask: Ask| took(asked.with(ask), answers) == Some(Took::Answered);
    let next = match asked.ask {
        Ask::AsciiName(checksum) => Ask::AsciiFirmware(checksum),
        ask if ask.protocol() != Protocol::Rtu => return None,
        _ => match identify(asked, answers).family {
            Some(Family::Eda9060a | Family::Eda9050) if !knows(Ask::Diagnosis) => Ask::Diagnosis,
            _ => Ask::Identification,
        },
    };
    (!was_asked(next)).then_some(next)
}

/// What a module says of itself: maker, product and version, or its firmware.
pub(super) fn description(asked: Question, answers: &[Answer]) -> Option<String> {
    let firmware = |response: &Response<'_>| match response {
        Response::Ascii(ascii::Response::Text(text)) => Some(text.as_str().to_owned()),
        _ => None,
    };
    let says = |response: &Response<'_>| match response {
        Response::Rtu(rtu::Response::Identification(says)) => {
            let objects = says.objects().take(3);
            let texts: Vec<String> = objects
                .map(|(_, text)| text.escape_ascii().to_string())
                .collect();
            Some(texts.join(" "))
        }
        _ => None,
    };
    let by_ascii = [false, true].map(Ask::AsciiFirmware).into_iter();
    let mut by_ascii = by_ascii.map(|ask| response(asked.with(ask), answers, firmware));
    let by_rtu = response(asked.with(Ask::Identification), answers, says);
    by_ascii.find_map(Option::flatten).or(by_rtu.flatten())
}

/// What the answers of one module say.
pub(super) fn identify(asked: Question, answers: &[Answer]) -> Identity {
    let known = |family: Family, by_behaviour| Identity {
        family: Some(family),
        model: Some(family.to_string()),
        by_behaviour,
        refused: false,
    };
    let shown = |rule: &&Rule| shows(asked.with(rule.ask), answers, rule.shows);
    if let Some(rule) = RULES.iter().find(shown) {
        return known(rule.family, rule.by_behaviour);
    }
    // An EDA9050 has eight coils, answers them, and is silent to all else [EDA9050 §5.1].
    let took = |ask: Ask| took(asked.with(ask), answers);
    let silent = |ask: Ask| took(ask) == Some(Took::Silent);
    let any = |wanted: Took| {
        let mut asks = answers.iter().map(|(ask, _)| *ask);
        asks.any(|ask| !ask.is_description() && took(ask) == Some(wanted))
    };
    let has_coils = took(Ask::Coils0) == Some(Took::Answered);
    if has_coils && silent(Ask::Registers4) && silent(Ask::NineCoils) {
        return known(Family::Eda9050, true);
    }
    Identity {
        family: None,
        model: named(asked, answers),
        by_behaviour: false,
        refused: any(Took::Refused) && !any(Took::Answered),
    }
}

/// The version that an EMD-2A2Q has in its first register [EMD-2A2Q §4.1].
pub(super) fn version(asked: Question, answers: &[Answer]) -> Option<u16> {
    response(asked.with(Ask::Registers8), answers, |response| {
        words(response).map(|[version, _]| version)
    })
    .flatten()
}

/// The 32 bits of a 0x55 board.
pub(super) fn state(asked: Question, answers: &[Answer]) -> Option<u32> {
    response(
        asked.with(Ask::R55State),
        answers,
        |response| match response {
            Response::R55(response) => Some(response.to_word()),
            _ => None,
        },
    )
    .flatten()
}

/// The address that a lone 0x55 board gives.
pub(super) fn board(asked: Question, bytes: &[u8]) -> Option<Address> {
    let exchange = asked.exchange()?;
    exchange.find_response(bytes).1.whole()?.from
}

/// What a response to the question says, where one came.
fn response<T>(
    asked: Question,
    answers: &[Answer],
    look: impl Fn(&Response<'_>) -> T,
) -> Option<T> {
    let exchange = asked.exchange()?;
    let (_, bytes) = answers.iter().find(|(ask, _)| *ask == asked.ask)?;
    let reply = exchange.find_response(bytes).1.whole()?;
    Some(look(&reply.response))
}

fn took(asked: Question, answers: &[Answer]) -> Option<Took> {
    let (_, bytes) = answers.iter().find(|(ask, _)| *ask == asked.ask)?;
    if bytes.is_empty() {
        return Some(Took::Silent);
    }
    response(asked, answers, |response| match is_refusal(response) {
        true => Took::Refused,
        false => Took::Answered,
    })
}

fn shows(asked: Question, answers: &[Answer], look: Shows) -> bool {
    let shown = |response: &Response<'_>| !is_refusal(response) && look(asked.address, response);
    response(asked, answers, shown).unwrap_or_default()
}

/// The name that a module of no known family gives itself.
fn named(asked: Question, answers: &[Answer]) -> Option<String> {
    let name = |response: &Response<'_>| match response {
        Response::Ascii(ascii::Response::Text(text)) => Some(text.as_str().to_owned()),
        _ => None,
    };
    let mut asks = [Ask::AsciiName(false), Ask::AsciiName(true)].into_iter();
    asks.find_map(|ask| response(asked.with(ask), answers, name).flatten())
}

fn is_eda9060a(address: Address, response: &Response<'_>) -> bool {
    words(response).is_some_and(|[model, at]| {
        [0x9060, 9060].contains(&model) && at >> 8 == u16::from(address.0)
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
