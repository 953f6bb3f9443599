//! `railbus sim`: simulated lines in real time, for any master: the demo line, or the plant of a
//! configuration.

mod answers;
pub(crate) mod background;
mod ctl;
pub(crate) mod demo;
mod frames;
mod keep;
mod orders;
mod panel;
mod places;
mod plant;
mod prompt;
mod pty;
pub(crate) mod remote;
mod serve;
mod stage;
mod standing;
mod tcp;
mod texts;

use crate::cli;
use crate::texts::Text;
use clap::{Arg, ArgAction, ArgGroup, ArgMatches, Command, value_parser};
use pty::Pty;
use railbus_app::failure::Failure;
use railbus_app::render::Format;
use railbus_sim::demo::modules;
use railbus_wire::Settings;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::{Value, json};
use serve::{Clock, Jobs, Served};
use stage::Stage;
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use tcp::Tcp;
use texts::SimText;

/// The name of the command.
pub(crate) const NAME: &str = "sim";

/// Where the demo line lies unless it is told otherwise.
const DEMO_PTY: &str = "/tmp/railbus-main";
const DEMO_TCP: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 4001);

/// What the arguments say of the demo.
struct Wanted {
    pty: PathBuf,
    tcp: SocketAddr,
    seed: u64,
    verbose: bool,
    json: bool,
}

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus sim PLANT.toml | --demo | ctl SOCKET ORDER";
    let many = |name, help| cli::flag(lang, name, help).action(ArgAction::Append);
    let of_plant = |arg: Arg| arg.conflicts_with("demo");
    cli::verb(lang, NAME, SimText::About, usage)
        .before_help(cli::examples(lang, SimText::Examples))
        .after_help(lang.get(SimText::Guide))
        .subcommand(ctl::define(lang))
        .subcommand_help_heading(lang.get(Text::Commands))
        .subcommand_negates_reqs(true)
        .args_conflicts_with_subcommands(true)
        .arg(
            Arg::new("FILE")
                .help(lang.get(SimText::File))
                .value_parser(value_parser!(PathBuf)),
        )
        .arg(cli::flag(lang, "demo", SimText::Demo).action(ArgAction::SetTrue))
        .group(ArgGroup::new("what").args(["FILE", "demo"]).required(true))
        .arg(many("pty", SimText::Pty).value_name("[LINE=]PATH"))
        .arg(many("tcp", SimText::Tcp).value_name("[LINE=]ADDR"))
        .arg(
            cli::flag(lang, "seed", SimText::Seed)
                .value_name("N")
                .value_parser(value_parser!(u64)),
        )
        .arg(of_plant(
            cli::flag(lang, "speed", SimText::Speed)
                .value_name("F")
                .value_parser(speed),
        ))
        .arg(of_plant(
            many("fault", SimText::FaultFlag).value_name("WHO: WHAT"),
        ))
        .arg(of_plant(
            cli::flag(lang, "control", SimText::Control)
                .value_name("PATH")
                .value_parser(value_parser!(PathBuf)),
        ))
        .arg(of_plant(
            cli::flag(lang, "state", SimText::State)
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf)),
        ))
}

/// How many times faster than real.
fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok();
    speed
        .filter(|speed| (0.01..=1_000.0).contains(speed))
        .ok_or_else(String::new)
}

/// Serves the lines until it is stopped.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    if let Some((ctl::NAME, matches)) = matches.subcommand() {
        return ctl::run(lang, matches);
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| system(lang, error))?;
    match matches.get_one::<PathBuf>("FILE") {
        Some(file) => runtime.block_on(plant::run(lang, &plant_wanted(file, matches))),
        None => runtime.block_on(serve_demo(lang, &demo_wanted(lang, matches)?)),
    }
}

fn texts_of(matches: &ArgMatches, name: &str) -> Vec<String> {
    let all = matches.get_many::<String>(name);
    all.into_iter().flatten().cloned().collect()
}

fn plant_wanted(file: &Path, matches: &ArgMatches) -> plant::Wanted {
    plant::Wanted {
        file: file.to_owned(),
        ptys: texts_of(matches, "pty"),
        tcps: texts_of(matches, "tcp"),
        seed: matches.get_one("seed").copied(),
        speed: matches.get_one("speed").copied(),
        faults: texts_of(matches, "fault"),
        control: matches.get_one("control").cloned(),
        state: matches.get_one("state").cloned(),
        verbose: matches.get_count("verbose") > 0,
        json: for_programs(matches),
    }
}

fn for_programs(matches: &ArgMatches) -> bool {
    let format = matches.get_one::<String>("output");
    let format = format.and_then(|name| Format::from_name(name));
    format.is_some_and(Format::is_json)
}

/// A line that is served, for programs.
fn line_row(
    name: &str,
    serial: Settings,
    modules: usize,
    pty: Option<&Path>,
    tcp: Option<SocketAddr>,
) -> Value {
    json!({
        "line": name,
        "baud": serial.baud.rate(),
        "format": serial.character.to_string(),
        "modules": modules,
        "pty": pty.map(|path| path.display().to_string()),
        "tcp": tcp.map(|address| address.to_string()),
    })
}

/// All that is served, and the socket of `sim ctl`, for programs.
fn served_json(lines: &[Value], control: Option<&str>) -> String {
    format!(
        "{}\n",
        json!({ "schema": 1, "lines": lines, "control": control })
    )
}

fn demo_wanted(lang: Lang, matches: &ArgMatches) -> Result<Wanted, Failure> {
    let tcp = match texts_of(matches, "tcp").pop() {
        None => DEMO_TCP,
        Some(text) => text.parse().map_err(|_| {
            let message = lang.fill(SimText::BadAddress, &[("value", &text)]);
            Failure::new(Code::Usage, message).with_try("railbus sim --demo --tcp 127.0.0.1:0")
        })?,
    };
    let pty = texts_of(matches, "pty").pop();
    Ok(Wanted {
        pty: pty.unwrap_or_else(|| DEMO_PTY.to_owned()).into(),
        tcp,
        seed: matches.get_one("seed").copied().unwrap_or_default(),
        verbose: matches.get_count("verbose") > 0,
        json: for_programs(matches),
    })
}

async fn serve_demo(lang: Lang, wanted: &Wanted) -> Result<(), Failure> {
    let mut stop = serve::Stop::new().map_err(|error| system(lang, error))?;
    // TCP first: a second simulator fails here, before it takes the first one's link away.
    let tcp = listen(lang, wanted.tcp, "railbus sim --demo --tcp 127.0.0.1:0").await?;
    let elsewhere = "railbus sim --demo --pty /tmp/railbus-2";
    let pty =
        Pty::open(&wanted.pty).map_err(|error| error.into_failure(lang, &wanted.pty, elsewhere))?;
    announce(lang, wanted, tcp.address());
    let frames = wanted.verbose.then(|| {
        frames::heading(lang, frames::WIDTH, wanted.json);
        frames::Frames::new(None, frames::WIDTH, wanted.json)
    });
    let (stage, _) = demo::stage(lang, wanted.seed, wanted.verbose)?;
    let served = demo_line(stage, pty, Some(tcp), frames, None);
    serve::serve(Clock::new(1.0), served, stop.requested())
        .await
        .map_err(|error| system(lang, error))
}

/// The demo line, ready to be served.
fn demo_line(
    stage: Stage,
    pty: Pty,
    tcp: Option<Tcp>,
    frames: Option<frames::Frames>,
    jobs: Option<Jobs>,
) -> Served {
    Served {
        serial: stage.serial(),
        stage: Box::new(stage),
        pty: Some(pty),
        unplugged: None,
        tcp,
        frames,
        jobs,
        keeper: None,
    }
}

async fn listen(lang: Lang, address: SocketAddr, elsewhere: &str) -> Result<Tcp, Failure> {
    Tcp::listen(address).await.map_err(|error| {
        let message = lang.fill(Text::NoTcp, &[("address", &address)]);
        Failure::new(Code::Listen, message)
            .because(error)
            .with_try(elsewhere)
    })
}

/// The system refuses what it always grants.
fn system(lang: Lang, error: std::io::Error) -> Failure {
    Failure::new(Code::System, lang.get(Text::CantServe).to_owned()).because(error)
}

/// Says what is served and how to connect. Who reads it may have gone; the line is served all
/// the same.
fn announce(lang: Lang, wanted: &Wanted, tcp: SocketAddr) {
    let text = if wanted.json {
        let (pty, modules) = (Some(wanted.pty.as_path()), modules().len());
        let line = line_row(demo::LINE, Settings::FACTORY, modules, pty, Some(tcp));
        served_json(&[line], None)
    } else {
        told(lang, wanted, tcp)
    };
    let mut stdout = std::io::stdout();
    let _ = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
}

fn told(lang: Lang, wanted: &Wanted, tcp: SocketAddr) -> String {
    let mut text = format!(
        "{}\n  PTY  {}\n  TCP  {tcp}   {}\n\n{}\n  {}\n",
        lang.get(SimText::Served),
        wanted.pty.display(),
        lang.get(SimText::RawBytes),
        lang.get(SimText::Modules),
        lang.get(SimText::Columns),
    );
    for (name, setup) in modules() {
        let model = setup.family.to_string();
        let address = setup.address.to_string();
        text += &format!("  {name:<7} {model:<12} {address:<9} {}\n", setup.protocol);
    }
    text
}
