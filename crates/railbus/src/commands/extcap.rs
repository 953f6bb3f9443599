//! `railbus extcap`: how Wireshark captures from a line. Not meant for people: its words are those
//! of Wireshark's extcap interface.

use super::sniff::{self, SniffText};
use super::{Context, place};
use crate::args;
use clap::{ArgAction, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_sniff::capture::LINK_TYPE;
use railbus_wire::{Baud, Character};
use railbus_words::Code;
use railbus_words::Lang;
use std::path::PathBuf;

/// The name of the command.
pub(crate) const NAME: &str = "extcap";

/// The capture source whose port is entered in Wireshark.
const ANY: &str = "railbus";
/// The prefix of the sources for configured lines.
const LINE: &str = "railbus_";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let flag = |name| args::flag(lang, name, SniffText::ExtcapFlag);
    let set = |name| flag(name).action(ArgAction::SetTrue);
    args::verb(lang, NAME, SniffText::ExtcapAbout, "railbus extcap …")
        .hide(true)
        .arg(set("extcap-interfaces"))
        .arg(set("extcap-dlts"))
        .arg(set("extcap-config"))
        .arg(set("capture"))
        .arg(flag("extcap-interface").value_name("NAME"))
        .arg(flag("extcap-version").value_name("N").num_args(0..=1))
        .arg(flag("extcap-capture-filter").value_name("WORDS"))
        .arg(
            flag("fifo")
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf)),
        )
}

/// Prints what Wireshark asks for, or captures until Wireshark closes the pipe.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let mut context = Context::of(lang, matches)?;
    if matches.get_flag("extcap-interfaces") {
        return out::result(lang, &interfaces(&context));
    }
    if matches.get_flag("extcap-dlts") {
        let name = format!("dlt {{number={LINK_TYPE}}}{{name=USER0}}{{display=RS-485}}\n");
        return out::result(lang, &name);
    }
    let source = matches.get_one::<String>("extcap-interface");
    let line = source.and_then(|source| source.strip_prefix(LINE));
    if matches.get_flag("extcap-config") {
        let config = if line.is_some() {
            String::new()
        } else {
            config(lang)
        };
        return out::result(lang, &config);
    }
    let fifo = matches.get_one::<PathBuf>("fifo");
    let (true, Some(fifo)) = (matches.get_flag("capture"), fifo) else {
        let message = lang.get(SniffText::ExtcapAbout).to_owned();
        return Err(Failure::new(Code::Usage, message).with_try("railbus sniff"));
    };
    if let Some(line) = line {
        context.line = Some(line.to_owned());
    }
    sniff::to_pipe(&context, fifo)
}

/// A source for each line of the configuration, and one for any port.
fn interfaces(context: &Context) -> String {
    let version = env!("CARGO_PKG_VERSION");
    let mut text =
        format!("extcap {{version={version}}}{{help=https://github.com/railbus/railbus}}\n");
    let any = context.lang.get(SniffText::ExtcapAny);
    text += &format!("interface {{value={ANY}}}{{display={any}}}\n");
    for (line, port) in place::configured(context) {
        text += &format!("interface {{value={LINE}{line}}}{{display=railbus: {line} ({port})}}\n");
    }
    text
}

/// The options that Wireshark asks the user for: port and speed.
fn config(lang: Lang) -> String {
    let port = lang.get(SniffText::ExtcapPort);
    let baud = lang.get(SniffText::ExtcapBaud);
    let mut text = format!(
        "arg {{number=0}}{{call=--line}}{{display={port}}}{{type=string}}{{required=true}}\
         {{placeholder=/dev/ttyUSB0}}\n\
         arg {{number=1}}{{call=--baud}}{{display={baud}}}{{type=selector}}\n"
    );
    for known in Baud::ALL {
        let default = known == Baud::B9600;
        text +=
            &format!("value {{arg=1}}{{value={known}}}{{display={known}}}{{default={default}}}\n");
    }
    text += "arg {number=2}{call=--format}{display=8N1}{type=selector}\n";
    for format in Character::ALL.map(Character::name) {
        let default = format == "8N1";
        text += &format!(
            "value {{arg=2}}{{value={format}}}{{display={format}}}{{default={default}}}\n"
        );
    }
    text
}
