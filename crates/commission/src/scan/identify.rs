//! Identifies a module by its responses. The signs of each family are data of its datasheet.

use super::ask::{ProbeKind, ScanProbe};
use railbus_device::{Family, ReadOutcome, Sign};
use railbus_wire::{Address, Protocol, Response, ascii, lc02, rtu};

/// A request and the response bytes; empty if there was no reply.
pub type Answer = (ProbeKind, Vec<u8>);

/// The identity of a module.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Its family, if it is one of the five.
    pub family: Option<Family>,
    /// Its model, or the name that it reports.
    pub model: Option<String>,
    /// It does not identify itself, but behaves like this family, and like no other.
    pub by_behaviour: bool,
    /// The families it could be: no response rules them out, and none proves them.
    pub could_be: Vec<Family>,
    /// Only refusals were received.
    pub refused: bool,
}

/// How a module responded to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Took {
    Answered,
    Refused,
    Silent,
}

/// What the responses say about a family that does not identify itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Case {
    /// It is one: it refuses what only such a module refuses.
    Proven,
    /// Nothing rules it out, and there is evidence for it.
    Possible,
    /// Nothing rules it out.
    Open,
    /// It is ruled out.
    RuledOut,
}

/// The next request to identify a module that has answered; `None` if it is identified, or can't
/// be.
pub(super) fn follow_up(asked: ScanProbe, answers: &[Answer]) -> Option<ProbeKind> {
    if asked.ask.protocol() != Protocol::Rtu || says_so(asked, answers).is_some() {
        return None;
    }
    let unasked = |sign: Sign| {
        let ask = ProbeKind::of(&sign)?;
        (!answers.iter().any(|(known, _)| *known == ask)).then_some(ask)
    };
    let open = |family: &Family| case(asked, answers, *family) != Case::RuledOut;
    let mut families = unnamed().filter(open);
    families.find_map(|family| family.signs().find_map(unasked))
}

/// Whether an unanswered request need not be repeated.
pub(super) fn is_certain(asked: ScanProbe, answers: &[Answer], ask: ProbeKind) -> bool {
    // An EDA9060A has more coils than an EDA9050: it is not one, with or without registers.
    let nine = took(asked.with(ProbeKind::NineCoils), answers);
    ask == ProbeKind::Registers4 && nine == Some(Took::Silent)
}

/// The families that do not identify themselves over Modbus, those with refusals first.
fn unnamed() -> impl Iterator<Item = Family> {
    let refuses = |family: &Family| family.signs().any(|sign| sign.is_refusal());
    let named = |family: &Family| family.signs().next().is_none();
    let proven = Family::ALL.into_iter().filter(refuses);
    let others = Family::ALL.into_iter();
    proven.chain(others.filter(move |family| !refuses(family) && !named(family)))
}

fn case(asked: ScanProbe, answers: &[Answer], family: Family) -> Case {
    let (low, high) = family.profile().addresses;
    if !(low..=high).contains(&asked.address.0) {
        return Case::RuledOut;
    }
    let (mut all, mut refuses, mut speaks) = (true, false, false);
    for sign in family.signs() {
        let answer = ProbeKind::of(&sign).and_then(|ask| shown(asked.with(ask), answers, &sign));
        match answer {
            Some(false) => return Case::RuledOut,
            Some(true) => {
                refuses |= sign.is_refusal();
                speaks |= !sign.is_refusal() && !matches!(sign.reply, ReadOutcome::Silence);
            }
            None => all = false,
        }
    }
    match (all && refuses, speaks) {
        (true, _) => Case::Proven,
        (false, true) => Case::Possible,
        (false, false) => Case::Open,
    }
}

/// Whether a sign was shown; `None` if it was not tested, or the result is unclear.
fn shown(asked: ScanProbe, answers: &[Answer], sign: &Sign) -> Option<bool> {
    let (_, bytes) = answers.iter().find(|(ask, _)| *ask == asked.ask)?;
    let exchange = asked.exchange()?;
    let reply = exchange.find_response(bytes).1.whole();
    let reply = reply.as_ref().map(|reply| &reply.response);
    sign.shown_by(asked.address, reply)
}

/// Whether the responses rule this family out.
pub(super) fn rules_out(asked: ScanProbe, answers: &[Answer], family: Family) -> bool {
    let is = identify(asked, answers).family;
    match asked.ask.protocol() {
        _ if is.is_some() => is != Some(family),
        Protocol::Rtu if family.datasheet().says_model_in_registers() => {
            took(asked.with(ProbeKind::Registers4), answers) == Some(Took::Answered)
                && says_so(asked, answers).is_none()
        }
        Protocol::Rtu => case(asked, answers, family) == Case::RuledOut,
        Protocol::Ascii | Protocol::Lc02 => {
            took(asked, answers) == Some(Took::Answered) && says_so(asked, answers).is_none()
        }
        Protocol::R55 => false,
    }
}

/// The family that a module reports.
fn says_so(asked: ScanProbe, answers: &[Answer]) -> Option<Family> {
    let name = |response: &Response<'_>| match response {
        Response::Ascii(ascii::Response::Text(name)) => Family::of_name(name.bytes()),
        Response::Lc02(lc02::Response::Config { model, .. }) => Family::of_number(*model),
        // The number, and its own address [EDA9060A §6.18].
        Response::Rtu(rtu::Response::Words(words)) => {
            let [address, _] = words.get(1)?.to_be_bytes();
            let family = Family::of_number(words.get(0)?);
            family
                .filter(|is| is.datasheet().says_model_in_registers() && address == asked.address.0)
        }
        _ => None,
    };
    let asks = [
        ProbeKind::Lc02Config,
        ProbeKind::AsciiName(false),
        ProbeKind::AsciiName(true),
        ProbeKind::Registers4,
    ];
    let mut said = asks
        .into_iter()
        .map(|ask| response(asked.with(ask), answers, name));
    said.find_map(Option::flatten)
}

/// The next identification request for a module that was found. Original modules refuse it, or stay
/// silent: then the cheaper request goes first.
pub(super) fn describe(asked: ScanProbe, answers: &[Answer]) -> Option<ProbeKind> {
    let was_asked = |ask: ProbeKind| answers.iter().any(|(known, _)| *known == ask);
    let knows = |ask: ProbeKind| took(asked.with(ask), answers) == Some(Took::Answered);
    let next = match asked.ask {
        ProbeKind::AsciiName(checksum) => ProbeKind::AsciiFirmware(checksum),
        ask if ask.protocol() != Protocol::Rtu => return None,
        _ => match identify(asked, answers).family {
            Some(family) if !family.datasheet().refuses && !knows(ProbeKind::Diagnosis) => {
                ProbeKind::Diagnosis
            }
            _ => ProbeKind::Identification,
        },
    };
    (!was_asked(next)).then_some(next)
}

/// A module's identification: manufacturer, product and version, or its firmware.
pub(super) fn description(asked: ScanProbe, answers: &[Answer]) -> Option<String> {
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
    let by_ascii = [false, true].map(ProbeKind::AsciiFirmware).into_iter();
    let mut by_ascii = by_ascii.map(|ask| response(asked.with(ask), answers, firmware));
    let by_rtu = response(asked.with(ProbeKind::Identification), answers, says);
    by_ascii.find_map(Option::flatten).or(by_rtu.flatten())
}

/// The identity that the responses of one module show.
pub(super) fn identify(asked: ScanProbe, answers: &[Answer]) -> Identity {
    let known = |family: Family, by_behaviour| Identity {
        family: Some(family),
        model: Some(family.to_string()),
        by_behaviour,
        ..Identity::default()
    };
    if let Some(family) = says_so(asked, answers) {
        return known(family, false);
    }
    // A 0x55 board reports neither its model nor its number of relays.
    if took(asked.with(ProbeKind::R55State), answers) == Some(Took::Answered) {
        let mut families = Family::ALL.into_iter();
        let speaks = |family: &Family| family.profile().protocols.contains(&Protocol::R55);
        if let Some(family) = families.find(speaks) {
            return known(family, true);
        }
    }
    let is = |wanted: Case| move |family: &Family| case(asked, answers, *family) == wanted;
    if let Some(family) = unnamed().find(is(Case::Proven)) {
        return known(family, true);
    }
    let took = |ask: ProbeKind| took(asked.with(ask), answers);
    let any = |wanted: Took| {
        let mut asks = answers.iter().map(|(ask, _)| *ask);
        asks.any(|ask| !ask.is_description() && took(ask) == Some(wanted))
    };
    Identity {
        family: None,
        model: named(asked, answers),
        by_behaviour: false,
        could_be: unnamed().filter(is(Case::Possible)).collect(),
        refused: any(Took::Refused) && !any(Took::Answered),
    }
}

/// The version that an EMD-2A2Q has in its first register [EMD-2A2Q §4.1].
pub(super) fn version(asked: ScanProbe, answers: &[Answer]) -> Option<u16> {
    response(
        asked.with(ProbeKind::Registers8),
        answers,
        |response| match response {
            Response::Rtu(rtu::Response::Words(words)) => words.get(0),
            _ => None,
        },
    )
    .flatten()
}

/// The 32 bits of a 0x55 board.
pub(super) fn state(asked: ScanProbe, answers: &[Answer]) -> Option<u32> {
    response(
        asked.with(ProbeKind::R55State),
        answers,
        |response| match response {
            Response::R55(response) => Some(response.to_word()),
            _ => None,
        },
    )
    .flatten()
}

/// The address that a lone 0x55 board reports.
pub(super) fn board(asked: ScanProbe, bytes: &[u8]) -> Option<Address> {
    let exchange = asked.exchange()?;
    exchange.find_response(bytes).1.whole()?.from
}

/// The meaning of a response to the request, if there was one.
fn response<T>(
    asked: ScanProbe,
    answers: &[Answer],
    look: impl Fn(&Response<'_>) -> T,
) -> Option<T> {
    let exchange = asked.exchange()?;
    let (_, bytes) = answers.iter().find(|(ask, _)| *ask == asked.ask)?;
    let reply = exchange.find_response(bytes).1.whole()?;
    Some(look(&reply.response))
}

fn took(asked: ScanProbe, answers: &[Answer]) -> Option<Took> {
    let (_, bytes) = answers.iter().find(|(ask, _)| *ask == asked.ask)?;
    if bytes.is_empty() {
        return Some(Took::Silent);
    }
    response(asked, answers, |response| match is_refusal(response) {
        true => Took::Refused,
        false => Took::Answered,
    })
}

/// The name reported by a module of an unknown family.
fn named(asked: ScanProbe, answers: &[Answer]) -> Option<String> {
    let name = |response: &Response<'_>| match response {
        Response::Ascii(ascii::Response::Text(text)) => Some(text.as_str().to_owned()),
        _ => None,
    };
    let mut asks = [ProbeKind::AsciiName(false), ProbeKind::AsciiName(true)].into_iter();
    asks.find_map(|ask| response(asked.with(ask), answers, name).flatten())
}

const fn is_refusal(response: &Response<'_>) -> bool {
    matches!(
        response,
        Response::Rtu(rtu::Response::Exception(_))
            | Response::Ascii(ascii::Response::Invalid | ascii::Response::Ignored)
    )
}
