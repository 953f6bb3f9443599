//! `railbus sim`: a simulated line in real time, for any master.

pub(crate) mod background;
mod frames;
mod pty;
mod serve;
mod tcp;

use crate::cli;
use crate::failure::{Code, Failure};
use crate::i18n::Lang;
use crate::texts::Text;
use clap::{ArgAction, ArgMatches, Command, value_parser};
use pty::Pty;
use railbus_sim::demo;
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use tcp::Tcp;

/// The name of the command.
pub(crate) const NAME: &str = "sim";

/// Where the demo line lies unless it is told otherwise.
const DEMO_PTY: &str = "/tmp/railbus-main";
const DEMO_TCP: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 4001);

/// What the arguments say.
struct Wanted {
    pty: PathBuf,
    tcp: SocketAddr,
    seed: u64,
    verbose: bool,
}

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus sim --demo [--pty PATH] [--tcp ADDR] [--seed N]";
    cli::verb(lang, NAME, Text::SimAbout, usage)
        .before_help(cli::examples(lang, Text::SimExamples))
        .arg(
            cli::flag(lang, "demo", Text::SimDemo)
                .action(ArgAction::SetTrue)
                .required(true),
        )
        .arg(
            cli::flag(lang, "pty", Text::SimPty)
                .value_name("PATH")
                .value_parser(value_parser!(PathBuf)),
        )
        .arg(
            cli::flag(lang, "tcp", Text::SimTcp)
                .value_name("ADDR")
                .value_parser(value_parser!(SocketAddr)),
        )
        .arg(
            cli::flag(lang, "seed", Text::SimSeed)
                .value_name("N")
                .value_parser(value_parser!(u64)),
        )
}

/// Serves the line until it is stopped.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let wanted = Wanted {
        pty: matches
            .get_one("pty")
            .cloned()
            .unwrap_or_else(|| PathBuf::from(DEMO_PTY)),
        tcp: matches.get_one("tcp").copied().unwrap_or(DEMO_TCP),
        seed: matches.get_one("seed").copied().unwrap_or_default(),
        verbose: matches.get_flag("verbose"),
    };
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| system(lang, error))?
        .block_on(open_and_serve(lang, &wanted))
}

async fn open_and_serve(lang: Lang, wanted: &Wanted) -> Result<(), Failure> {
    let mut stop = serve::Stop::new().map_err(|error| system(lang, error))?;
    // TCP first: a second simulator fails here, before it takes the first one's link away.
    let tcp = Tcp::listen(wanted.tcp).await.map_err(|error| {
        let message = lang.fill(Text::NoTcp, &[("address", &wanted.tcp)]);
        Failure::new(Code::Listen, message)
            .because(error)
            .with_try("railbus sim --demo --tcp 127.0.0.1:0")
    })?;
    let pty = Pty::open(&wanted.pty).map_err(|error| error.into_failure(lang, &wanted.pty))?;
    announce(lang, wanted, tcp.address());
    let frames = wanted.verbose.then(|| frames::Frames::begin(lang));
    serve::serve(wanted.seed, stop.requested(), pty, Some(tcp), frames)
        .await
        .map_err(|error| system(lang, error))
}

/// The system refuses what it always grants.
fn system(lang: Lang, error: std::io::Error) -> Failure {
    Failure::new(Code::System, lang.get(Text::CantServe).to_owned()).because(error)
}

/// Says what is served and how to connect. Who reads it may have gone; the line is served all
/// the same.
fn announce(lang: Lang, wanted: &Wanted, tcp: SocketAddr) {
    let mut text = format!(
        "{}\n  PTY  {}\n  TCP  {tcp}   {}\n\n{}\n  {}\n",
        lang.get(Text::SimServed),
        wanted.pty.display(),
        lang.get(Text::SimRawBytes),
        lang.get(Text::SimModules),
        lang.get(Text::SimColumns),
    );
    for (name, setup) in demo::modules() {
        let model = setup.family.to_string();
        let address = setup.address.to_string();
        text += &format!("  {name:<7} {model:<12} {address:<9} {}\n", setup.protocol);
    }
    let mut stdout = std::io::stdout();
    let _ = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
}
