//! `railbus raw`: sends a raw frame.

mod unknown;

use super::own_line::OwnLine;
use super::place::{self, Access, Place};
use super::sniff::SniffText;
use super::{Context, decode, stop};
use crate::args;
use crate::backend::Backend;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_api::sending::SendRequest;
use railbus_api::types::Outcome;
use railbus_app::api::{convert, sending};
use railbus_app::failure::Failure;
use railbus_app::frames::meaning;
use railbus_app::render::table::Table;
use railbus_app::render::{Format, out, records};
use railbus_commission::{Risk, is_answered};
use railbus_host::reply_in;
use railbus_site::is_refused;
use railbus_wire::{
    Address, Decoded, Exchange, Micros, Protocol, REPLY_TIMEOUT, ascii, foreign_command, lc02, r55,
    rtu,
};
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::{hex, time};
use serde_json::json;

/// The name of the command.
pub(crate) const NAME: &str = "raw";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus raw [--crc|--proto P] HEX… | railbus raw --ascii TEXT";
    args::verb(lang, NAME, Text::RawAbout, usage)
        .before_help(args::examples(lang, Text::RawExamples))
        .arg(Arg::new("HEX").help(lang.get(Text::RawHex)).num_args(0..))
        .arg(
            args::flag(lang, "ascii", Text::RawAscii)
                .value_name("TEXT")
                .conflicts_with("HEX"),
        )
        .arg(args::flag(lang, "crc", Text::RawCrc).action(ArgAction::SetTrue))
        .arg(
            args::flag(lang, "proto", Text::RawProto)
                .value_name("P")
                .value_parser(Protocol::ALL.map(Protocol::name))
                .hide_possible_values(true)
                .conflicts_with("crc"),
        )
        .arg(args::flag(lang, "yes", Text::RawYes).action(ArgAction::SetTrue))
        .arg(args::flag(lang, "override", Text::RawOverride).action(ArgAction::SetTrue))
}

/// The reply.
struct Answer {
    bytes: Vec<u8>,
    after_ms: u64,
    /// How the exchange ended; none if the frame was not a known request, so it can't be known.
    outcome: Option<Outcome>,
}

/// Sends the frame and prints the reply.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let frame = frame(lang, matches)?;
    let exact = exact(&frame);
    let asked = exact.or_else(|| asked(&frame));
    let stowaway = asked
        .as_ref()
        .and_then(|asked| foreign_command(&frame, asked.protocol(), Protocol::ALL));
    let risky = asked.as_ref().is_none_or(is_risky) || stowaway.is_some();
    if risky && !matches.get_flag("yes") {
        let failure = Failure::of(lang, Code::NeedsYes).because(hex::spaced(&frame));
        let told = asked.as_ref().map(|asked| meaning::request(lang, asked));
        let also = stowaway.map(|protocol| {
            let values: &[(&str, &dyn std::fmt::Display)] = &[("protocol", &protocol)];
            lang.fill(SniffText::Stowaway, values)
        });
        let reasons = told.into_iter().chain(also);
        return Err(reasons.fold(failure, Failure::because));
    }
    let meant = meant(matches, asked.as_ref());
    let answer = context.block(ask(&context, &frame, exact, meant))?;
    show(&context, &frame, asked.as_ref(), &answer)?;
    verdict(&context, asked.as_ref(), &answer)
}

/// The bytes to send, including their checksum.
fn frame(lang: Lang, matches: &ArgMatches) -> Result<Vec<u8>, Failure> {
    if let Some(text) = matches.get_one::<String>("ascii") {
        return Ok(hex::ascii(text));
    }
    let words: Vec<String> = matches
        .get_many("HEX")
        .into_iter()
        .flatten()
        .cloned()
        .collect();
    let text = words.join(" ");
    let bytes = hex::parse(&text).ok_or_else(|| decode::no_bytes(lang, &text))?;
    let named = matches.get_one::<String>("proto");
    let mut protocols = Protocol::ALL.into_iter();
    let protocol = match matches.get_flag("crc") {
        true => Some(Protocol::Rtu),
        false => protocols.find(|protocol| named.is_some_and(|name| name == protocol.name())),
    };
    Ok(match protocol {
        Some(protocol) => sending::completed(protocol, false, bytes),
        None => bytes,
    })
}

/// The request that is encoded as exactly these bytes, as the line's master sends it.
fn exact(bytes: &[u8]) -> Option<Exchange<'static>> {
    let protocol = asked(bytes)?.protocol();
    railbus_commission::request(protocol, bytes)
}

/// The request that the bytes are, if any.
fn asked(bytes: &[u8]) -> Option<Exchange<'_>> {
    let whole = |len: usize| len == bytes.len();
    if let Decoded::Whole { len, value } = r55::Exchange::decode_request(bytes)
        && whole(len)
    {
        return Some(Exchange::R55(value));
    }
    if let Decoded::Whole { len, value } = lc02::Exchange::decode_request(bytes)
        && whole(len)
    {
        return Some(Exchange::Lc02(value));
    }
    for checksum in [false, true] {
        let rules = ascii::DecodeRules {
            checksum,
            lower_case: true,
        };
        if let Decoded::Whole { len, value } = ascii::Exchange::decode_request(bytes, rules)
            && whole(len)
        {
            return Some(Exchange::Ascii(value));
        }
    }
    rtu::Exchange::decode_frame(bytes).ok().map(Exchange::Rtu)
}

/// The confirmations that are passed to the daemon. Switching outputs of one module is sent without
/// asking, as on a line opened here; a frame that passes a lock is not.
fn meant(matches: &ArgMatches, asked: Option<&Exchange<'_>>) -> Vec<String> {
    let risk = asked.map(Risk::of);
    let said = risk.filter(|risk| *risk <= Risk::Output || matches.get_flag("yes"));
    let past = matches.get_flag("override").then_some(sending::OVERRIDE);
    let words = said.map(sending::word).into_iter().chain(past);
    words.map(str::to_owned).collect()
}

/// Whether it is a broadcast, or changes stored settings.
fn is_risky(asked: &Exchange<'_>) -> bool {
    Risk::of(asked) >= Risk::Kept
}

/// Whether it may do more than read. Bytes that are not a known request may do anything.
fn acts(asked: Option<&Exchange<'_>>) -> bool {
    asked.is_none_or(|asked| Risk::of(asked) > Risk::Read)
}

async fn ask(
    context: &Context,
    frame: &[u8],
    asked: Option<Exchange<'static>>,
    confirm: Vec<String>,
) -> Result<Answer, Failure> {
    let timeout = context.timeout.unwrap_or(REPLY_TIMEOUT);
    match place::find(context).await? {
        Access::Here(place) => {
            let mut stop = stop::Stop::new(context)?;
            let answer = match asked {
                Some(asked) => here(context, &place, asked, timeout, &mut stop).await,
                None => stop.or(unknown::ask(context, &place, frame, timeout)).await,
            };
            let interrupted = || stop::interrupted(context).perhaps_acted(acts(asked.as_ref()));
            answer.ok_or_else(interrupted)?
        }
        Access::Daemon(backend) => {
            let protocol = asked.map_or(Protocol::Rtu, |asked| asked.protocol());
            let wanted = SendRequest {
                protocol: protocol.name().to_owned(),
                bytes: hex::spaced(frame),
                timeout_ms: Some(timeout.0 / 1_000),
                confirm,
                ..SendRequest::default()
            };
            let line = line_of(context, &backend).await?;
            let answer = backend.send(&line, wanted).await;
            let answer = answer.map_err(|problem| context.failure(&problem))?;
            Ok(Answer {
                bytes: hex::parse(&answer.bytes).unwrap_or_default(),
                after_ms: answer.after_ms.round() as u64,
                outcome: Some(answer.outcome),
            })
        }
    }
}

/// Sends it on a line opened here; none if it was interrupted. In either case the port is held
/// until no late reply can arrive any more.
async fn here(
    context: &Context,
    place: &Place,
    asked: Exchange<'static>,
    timeout: Micros,
    stop: &mut stop::Stop,
) -> Option<Result<Answer, Failure>> {
    let mut line = match stop.or(OwnLine::open(context, place)).await? {
        Ok(line) => line,
        Err(failure) => return Some(Err(failure)),
    };
    let met = stop.or(line.ask(asked, timeout)).await;
    line.close().await;
    Some(met?.map(|met| Answer {
        bytes: met.bytes,
        after_ms: met.after.0 / 1_000,
        outcome: Some(convert::outcome(met.outcome)),
    }))
}

/// The line that is named, or the only one.
async fn line_of(context: &Context, daemon: &Backend) -> Result<String, Failure> {
    if let Some(line) = &context.line {
        return Ok(line.clone());
    }
    let lines = daemon.lines().await;
    let lines = lines.map_err(|problem| context.failure(&problem))?;
    match &lines[..] {
        [one] => Ok(one.line.clone()),
        all => {
            let names: Vec<&str> = all.iter().map(|line| line.line.as_str()).collect();
            Err(Failure::of(context.lang, Code::NoLine).because(names.join(" ")))
        }
    }
}

/// The meaning of the reply, if it is one, and the address it comes from.
fn read(
    lang: Lang,
    asked: Option<&Exchange<'_>>,
    answer: &Answer,
) -> Option<(String, Option<Address>, bool)> {
    let asked = asked.filter(|_| answer.outcome == Some(Outcome::Answered))?;
    let own = reply_in(asked, &answer.bytes)?;
    let reply = asked.decode_response(own).whole()?;
    let refused = is_refused(asked, &answer.bytes);
    let text = meaning::response(lang, asked, &reply.response);
    Some((text, reply.from, refused))
}

fn show(
    context: &Context,
    frame: &[u8],
    asked: Option<&Exchange<'_>>,
    answer: &Answer,
) -> Result<(), Failure> {
    let lang = context.lang;
    let said = read(lang, asked, answer);
    let text = match context.format {
        Format::Table | Format::Csv => {
            let mut table = Table::bare();
            let asked = asked.map(|asked| meaning::request(lang, asked));
            table.add([
                "→".to_owned(),
                hex::spaced(frame),
                asked.unwrap_or_default(),
            ]);
            if !answer.bytes.is_empty() {
                let after = time::duration(lang, answer.after_ms);
                let said = said.map(|(said, ..)| said);
                let said = said.unwrap_or_else(|| lang.get(Text::NotUnderstood).to_owned());
                table.add(["←".to_owned(), hex::spaced(&answer.bytes), said, after]);
            }
            table.render()
        }
        Format::Value => format!("{}\n", hex::spaced(&answer.bytes)),
        Format::Json | Format::Ndjson => records::line(json!({
            "sent": hex::spaced(frame),
            "bytes": hex::spaced(&answer.bytes),
            "asked": asked.map(|asked| meaning::request(lang, asked)),
            "meaning": said.as_ref().map(|(said, ..)| said),
            "address": said.and_then(|(_, from, _)| from).map(|from| from.0),
            "after_ms": answer.after_ms,
        })),
    };
    out::result(lang, &text)
}

fn verdict(
    context: &Context,
    asked: Option<&Exchange<'_>>,
    answer: &Answer,
) -> Result<(), Failure> {
    let lang = context.lang;
    let expected = asked.is_none_or(is_answered);
    match read(lang, asked, answer) {
        Some((said, _, true)) => Err(Failure::of(lang, Code::Refused).because(said)),
        Some(_) => Ok(()),
        None if answer.bytes.is_empty() && !expected => Ok(()),
        None if answer.bytes.is_empty() => {
            Err(Failure::of(lang, Code::NoReply).perhaps_acted(acts(asked)))
        }
        // It is not known what the reply to such a frame should be.
        None if asked.is_none() => Ok(()),
        None => {
            let failure = Failure::of(lang, Code::Garbled);
            let failure = failure.because(hex::spaced(&answer.bytes));
            Err(failure.perhaps_acted(acts(asked)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_or_for_all_is_asked_about() {
        for (text, risky) in [
            ("03 01 00 3C 00 08 FC 22", false),
            ("03 05 00 3C FF 00 4D D4", false),
            ("55 04 10 00 00 00 00 69", false),
            ("55 F5 13 00 00 00 FF 5C", true),
            ("55 F5 40 00 00 00 00 8A", false),
            ("55 01 41 00 00 00 04 9B", true),
            ("$016", false),
            ("#010003", false),
            ("#**", true),
            ("%0102400600", true),
            ("4C 57 01 03 04 0D", false),
            ("4C 57 01 02 02 06 00 0B 0D", true),
        ] {
            let bytes = hex::parse(text).unwrap();
            let asked = asked(&bytes).unwrap();
            assert_eq!(is_risky(&asked), risky, "{text}");
        }
        assert_eq!(asked(&[1, 2, 3]), None);
    }
}
