//! `railbus serve`: starts the daemon.

use crate::args;
use crate::texts::Text;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use railbus_app::failure::Failure;
use railbus_app::render::Format;
use railbus_gateway::{CertificateSource, LISTEN, ServeOptions};
use railbus_words::{Code, Lang, Phrase};
use std::net::SocketAddr;
use std::path::PathBuf;

/// The name of the command.
pub(crate) const NAME: &str = "serve";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus serve [--demo|--config FILE] [--listen ADDR] [--tls auto]";
    let switch = |name, help| args::flag(lang, name, help).action(ArgAction::SetTrue);
    args::verb(lang, NAME, Text::ServeAbout, usage)
        .before_help(args::examples(lang, Text::ServeExamples))
        .arg(switch("demo", Text::ServeDemo))
        .args(listen_flags(lang, Text::ServeListen))
        .arg(switch("check", Text::ServeCheck))
}

/// The flags of a program that listens on the network. `listen` says where by default.
pub(crate) fn listen_flags(lang: Lang, listen: impl Phrase) -> [Arg; 5] {
    let file = |name, help| {
        let flag = args::flag(lang, name, help).value_name("FILE");
        flag.value_parser(value_parser!(PathBuf))
    };
    [
        args::flag(lang, "listen", listen)
            .value_name("ADDR")
            .value_parser(value_parser!(SocketAddr)),
        args::flag(lang, "tls", Text::ServeTls)
            .value_name("HOW")
            .value_parser(["auto"])
            .hide_possible_values(true)
            .conflicts_with_all(["tls-cert", "tls-key"]),
        file("tls-cert", Text::ServeTlsCert).requires("tls-key"),
        file("tls-key", Text::ServeTlsKey).requires("tls-cert"),
        args::flag(lang, "name", Text::ServeName)
            .value_name("HOST")
            .action(ArgAction::Append),
    ]
}

/// Serves until it is stopped.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    if matches.value_source("line") == Some(ValueSource::CommandLine) {
        let line = matches.get_one::<String>("line");
        let line = line.map(String::as_str).unwrap_or_default();
        let failure = Failure::new(Code::Usage, lang.get(Text::ServeNoLine).to_owned());
        return Err(failure
            .with_try(format!("railbus -l {line} scan --add"))
            .with_try("railbus serve"));
    }
    let format = matches.get_one::<String>("output");
    let format = format.and_then(|name| Format::from_name(name));
    let options = ServeOptions {
        config: matches.get_one("config").cloned(),
        demo: matches.get_flag("demo"),
        listen: matches.get_one("listen").copied().unwrap_or(LISTEN),
        tls: tls_wish(matches),
        names: names(matches),
        socket: matches.get_one("socket").cloned(),
        check: matches
            .get_flag("check")
            .then(|| format.unwrap_or_default()),
    };
    railbus_gateway::run(lang, &options)
}

/// The names that `--name` adds.
pub(crate) fn names(matches: &ArgMatches) -> Vec<String> {
    let names = matches.get_many("name").into_iter().flatten();
    names.cloned().collect()
}

/// Certificate and key, if they are wanted.
pub(crate) fn tls_wish(matches: &ArgMatches) -> Option<CertificateSource> {
    let path = |name: &str| matches.get_one::<PathBuf>(name).cloned();
    match (path("tls-cert"), path("tls-key")) {
        (Some(cert), Some(key)) => Some(CertificateSource::Files { cert, key }),
        _ => matches
            .contains_id("tls")
            .then_some(CertificateSource::Auto),
    }
}
