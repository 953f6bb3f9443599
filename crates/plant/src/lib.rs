//! Simulated lines in real time, for any master: the demo line, or the plant of a configuration.
//!
//! # Where things are
//! - What a test or a technician can order (at the prompt, over the control socket or HTTP):
//!   `orders`; where orders come from: `prompt`, `remote`; what is answered: `answers`.
//! - What they do to a line and its modules: `stage`, `active_faults`; what can befall a module at
//!   all is in `railbus_sim`.
//! - A line driven by the real clock: `serve`, over `pty` or `tcp`. What simulated
//!   modules keep over a restart: `keep`.

#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod active_faults;
mod answers;
pub mod background;
pub mod demo;
mod frames;
mod keep;
mod orders;
mod panel;
mod places;
pub mod plant;
mod prompt;
mod pty;
pub mod remote;
mod serve;
mod stage;
mod tcp;
mod texts;

use pty::Pty;
use railbus_app::failure::Failure;
use railbus_app::texts::AppText;
use railbus_sim::demo::modules;
use railbus_wire::SerialSettings;
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

/// Default path of the demo line.
const DEMO_PTY: &str = "/tmp/railbus-main";
const DEMO_TCP: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 4001);

/// A simulated line, for programs.
fn line_row(
    name: &str,
    serial: SerialSettings,
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

/// Everything that is served, and the socket of `sim ctl`, for programs.
fn served_json(lines: &[Value], control: Option<&str>) -> String {
    format!(
        "{}\n",
        json!({ "schema": 1, "lines": lines, "control": control })
    )
}

/// Options of the demo line.
#[derive(Clone, Debug, Default)]
pub struct DemoOptions {
    /// The link to its PTY; `/tmp/railbus-main` if not given.
    pub pty: Option<PathBuf>,
    /// The TCP address it listens on; `127.0.0.1:4001` if not given.
    pub tcp: Option<String>,
    /// The seed of its random numbers.
    pub seed: u64,
    /// Show each frame as it is sent.
    pub verbose: bool,
    /// Report what is served as JSON.
    pub json: bool,
}

/// The same, parsed.
struct Demo {
    pty: PathBuf,
    tcp: SocketAddr,
    seed: u64,
    verbose: bool,
    json: bool,
}

impl Demo {
    fn read(lang: Lang, asked: &DemoOptions) -> Result<Demo, Failure> {
        let tcp = match &asked.tcp {
            None => DEMO_TCP,
            Some(text) => text.parse().map_err(|_| {
                let message = lang.fill(SimText::BadAddress, &[("value", text)]);
                Failure::new(Code::Usage, message).with_try("railbus sim --demo --tcp 127.0.0.1:0")
            })?,
        };
        Ok(Demo {
            pty: asked.pty.clone().unwrap_or_else(|| DEMO_PTY.into()),
            tcp,
            seed: asked.seed,
            verbose: asked.verbose,
            json: asked.json,
        })
    }
}

/// Serves the demo line until the process is asked to stop.
///
/// # Errors
/// If the PTY or the address is not available, or the system refuses something it normally grants.
pub async fn serve_demo(lang: Lang, asked: &DemoOptions) -> Result<(), Failure> {
    let demo = &Demo::read(lang, asked)?;
    serve_read(lang, demo).await
}

async fn serve_read(lang: Lang, demo: &Demo) -> Result<(), Failure> {
    let mut stop = serve::Stop::new().map_err(|error| system(lang, error))?;
    // TCP first: a second simulator fails here, before it replaces the first one's link.
    let tcp = listen(lang, demo.tcp, "railbus sim --demo --tcp 127.0.0.1:0").await?;
    let elsewhere = "railbus sim --demo --pty /tmp/railbus-2";
    let pty =
        Pty::open(&demo.pty).map_err(|error| error.into_failure(lang, &demo.pty, elsewhere))?;
    announce(lang, demo, tcp.address());
    let frames = demo.verbose.then(|| {
        frames::heading(lang, frames::WIDTH, demo.json);
        frames::Frames::new(None, frames::WIDTH, demo.json)
    });
    let (stage, _) = demo::stage(lang, demo.seed, demo.verbose)?;
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
        let message = lang.fill(AppText::NoTcp, &[("address", &address)]);
        Failure::new(Code::Listen, message)
            .because(error)
            .with_try(elsewhere)
    })
}

/// The system refuses something it normally grants.
pub fn system(lang: Lang, error: std::io::Error) -> Failure {
    Failure::new(Code::System, lang.get(AppText::CantServe).to_owned()).because(error)
}

/// Why the control socket can't be used.
pub fn unreachable(lang: Lang, path: &Path, error: &std::io::Error) -> Failure {
    let message = lang.fill(SimText::NoControl, &[("path", &path.display())]);
    Failure::new(Code::SimControl, message)
        .diagnosed()
        .because(error)
        .with_try("railbus sim plant.toml --control ./ctl")
}

/// Prints what is served and how to connect. The reader may have gone; the line is served
/// nevertheless.
fn announce(lang: Lang, demo: &Demo, tcp: SocketAddr) {
    let text = if demo.json {
        let (pty, modules) = (Some(demo.pty.as_path()), modules().len());
        let line = line_row(demo::LINE, SerialSettings::FACTORY, modules, pty, Some(tcp));
        served_json(&[line], None)
    } else {
        told(lang, demo, tcp)
    };
    let mut stdout = std::io::stdout();
    let _ = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
}

fn told(lang: Lang, demo: &Demo, tcp: SocketAddr) -> String {
    let mut text = format!(
        "{}\n  PTY  {}\n  TCP  {tcp}   {}\n\n{}\n  {}\n",
        lang.get(SimText::Served),
        demo.pty.display(),
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
