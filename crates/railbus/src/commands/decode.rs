//! `railbus decode`: what bytes mean.

mod known;

use super::{Context, sniff};
use crate::args;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::frames::decodings::{Check, Decoding};
use railbus_app::render::records;
use railbus_app::render::{Format, out};
use railbus_app::texts::AppText;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::{hex, width};
use serde_json::{Value, json};
use std::io::Read;
use std::path::PathBuf;

/// The name of the command.
pub(crate) const NAME: &str = "decode";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus decode HEX… [--all] | railbus decode - | railbus decode -f FILE";
    args::verb(lang, NAME, Text::DecodeAbout, usage)
        .before_help(args::examples(lang, Text::DecodeExamples))
        .arg(
            Arg::new("HEX")
                .help(lang.get(Text::DecodeHex))
                .num_args(1..)
                .required_unless_present("file")
                .conflicts_with("file"),
        )
        .arg(
            args::flag(lang, "file", sniff::SniffText::DecodeFile)
                .short('f')
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf)),
        )
        .arg(sniff::filter_flag(lang).requires("file"))
        .arg(args::flag(lang, "all", Text::DecodeAll).action(ArgAction::SetTrue))
}

/// Prints the possible decodings, best first.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    if let Some(file) = matches.get_one::<PathBuf>("file") {
        return sniff::of_file(&context, file, sniff::filter_of(lang, matches)?);
    }
    let words: Vec<&str> = matches
        .get_many::<String>("HEX")
        .into_iter()
        .flatten()
        .map(String::as_str)
        .collect();
    let frames = match words.as_slice() {
        ["-"] => standard_input(lang)?,
        words => vec![words.join(" ")],
    };
    let mut bad = None;
    for frame in frames {
        let bytes = hex::parse(&frame).ok_or_else(|| no_bytes(lang, &frame))?;
        let decodings = railbus_app::frames::decodings::of(lang, &bytes);
        let all = matches.get_flag("all");
        let shown = show(&context, &bytes, &decodings, all);
        out::result(lang, &shown)?;
        if !decodings.first().is_some_and(Decoding::is_good) {
            bad = Some(bytes);
        }
    }
    match bad {
        None => Ok(()),
        Some(bytes) => {
            let failure = Failure::of(lang, Code::NoProtocol);
            Err(failure.with_fact("bytes", hex::spaced(&bytes)))
        }
    }
}

/// The failure of text that can't be read as bytes.
pub(super) fn no_bytes(lang: Lang, text: &str) -> Failure {
    let message = lang.fill(Text::NoBytes, &[("text", &text)]);
    Failure::new(Code::Usage, message).with_try("railbus decode 03 05 00 3C FF 00 4D D4")
}

/// Frames from standard input, one per line.
fn standard_input(lang: Lang) -> Result<Vec<String>, Failure> {
    let mut text = String::new();
    let read = std::io::stdin().read_to_string(&mut text);
    read.map_err(|error| Failure::of(lang, Code::System).because(error))?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    Ok(lines.map(str::to_owned).collect())
}

fn show(context: &Context, bytes: &[u8], decodings: &[Decoding], all: bool) -> String {
    let lang = context.lang;
    let known = known::find(bytes);
    if context.format.is_json() {
        let known = known.map(|known| json!({ "id": known.id, "note": known.note(lang) }));
        return records::line(json!({
            "bytes": hex::spaced(bytes),
            "readings": decodings.iter().map(as_json).collect::<Vec<_>>(),
            "known": known,
        }));
    }
    let Some(best) = decodings.first() else {
        return lang.fill(Text::NoReading, &[("count", &bytes.len())]) + "\n";
    };
    if context.format == Format::Value {
        return format!("{}\n", best.meaning);
    }
    // Readings as good as the best one are always shown.
    let count =
        |decoding: &&Decoding| all || decoding.is_good() == best.is_good() && best.is_good();
    let mut text = String::new();
    for decoding in decodings
        .iter()
        .filter(|decoding| all || std::ptr::eq(*decoding, best))
    {
        text += &told(lang, decoding);
    }
    if let Some(known) = known {
        text += &labelled(
            lang,
            Text::KnownLabel,
            &format!("{}: {}", known.id, known.note(lang)),
        );
    }
    let others = decodings.iter().filter(count).count().saturating_sub(1);
    if !all && others > 0 {
        text += &labelled(
            lang,
            Text::AlsoLabel,
            &lang.fill(Text::AlsoCount, &[("count", &others)]),
        );
    }
    text
}

fn labelled(lang: Lang, label: Text, text: &str) -> String {
    format!("  {}{text}\n", width::pad(lang.get(label), 10))
}

fn told(lang: Lang, decoding: &Decoding) -> String {
    let kind = lang.get(if decoding.reply {
        Text::ReplyWord
    } else {
        Text::RequestWord
    });
    let mut head = format!("{} {kind}", decoding.protocol);
    if let Some(address) = decoding.address {
        head += lang.get(AppText::Comma);
        head += &lang.fill(AppText::AtAddress, &[("address", &address)]);
    }
    let mut text = format!("{head}\n  {}\n", decoding.meaning);
    let check = match &decoding.check {
        Check::None => return text,
        Check::Right(is) => lang.fill(Text::CheckRight, &[("is", is)]),
        Check::Wrong { is, should } => {
            lang.fill(Text::CheckWrong, &[("is", is), ("should", should)])
        }
    };
    text += &labelled(lang, Text::CheckLabel, &check);
    text
}

fn as_json(decoding: &Decoding) -> Value {
    let check = match &decoding.check {
        Check::None => Value::Null,
        Check::Right(is) => json!({ "ok": true, "is": is }),
        Check::Wrong { is, should } => json!({ "ok": false, "is": is, "should": should }),
    };
    json!({
        "protocol": decoding.protocol,
        "kind": if decoding.reply { "reply" } else { "request" },
        "address": decoding.address.map(|address| address.0),
        "meaning": decoding.meaning,
        "checksum": check,
    })
}
