//! A plant: the lines of a configuration, simulated and served.

use super::keep::{Keeper, Store};
use super::orders::{Directory, Order};
use super::places::{Place, places};
use super::prompt::{self, Prompt, Typed};
use super::pty::Pty;
use super::serve::{self, Clock, Job, Jobs, Served, Stop, line_config};
use super::stage::{FaultTarget, Stage};
use super::tcp::Tcp;
use super::texts::SimText;
use super::{answers, frames, line_row, listen, served_json, system, unreachable};
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_app::render::table::Table;
use railbus_app::socket::Socket;
use railbus_site::Config;
use railbus_wire::Instant;
use railbus_words::Code;
use railbus_words::Lang;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::{Notify, mpsc};
use tokio::task::JoinSet;

/// Queued commands per line.
const JOBS_MAX: usize = 16;

/// Options from the command line.
#[derive(Clone, Debug, Default)]
pub struct PlantOptions {
    /// The configuration whose lines and modules are simulated.
    pub file: PathBuf,
    /// `[LINE=]PATH`.
    pub ptys: Vec<String>,
    /// `[LINE=]ADDR`.
    pub tcps: Vec<String>,
    /// The seed of its random numbers; by default that of the configuration, or 0.
    pub seed: Option<u64>,
    /// Speed factor; by default that of the configuration, or 1.
    pub speed: Option<f64>,
    /// `TARGET: FAULT`, in addition to those of the configuration.
    pub faults: Vec<String>,
    /// The path of the control socket, if wanted.
    pub control: Option<PathBuf>,
    /// The file for the modules' persistent state, if wanted.
    pub state: Option<PathBuf>,
    /// Show each frame as it is sent.
    pub verbose: bool,
    /// Report what is served as JSON.
    pub json: bool,
}

/// Serves all lines until it is stopped.
pub async fn run(lang: Lang, wanted: &PlantOptions) -> Result<(), Failure> {
    let mut stop = Stop::new().map_err(|error| system(lang, error))?;
    let found = config_file::read(lang, Some(&wanted.file))
        .map_err(|problem| Failure::of_problem(lang, &problem))?;
    let config = found.config;
    let directory = Directory::of(&config);
    if directory.lines.is_empty() {
        let file = wanted.file.display();
        let message = lang.fill(SimText::NoLines, &[("file", &file)]);
        return Err(Failure::new(Code::SimPlant, message).diagnosed());
    }
    let store = wanted.state.as_deref();
    let store = store.map(|path| Store::open(lang, path)).transpose()?;
    let stages = stages(lang, &config, &directory, store.as_ref(), wanted)?;
    let places = places(lang, &config, &directory, wanted)?;
    let control = control(lang, wanted)?;
    let served = open(lang, &directory, stages, places, store, wanted).await?;
    announce(lang, wanted, &directory, &config, &served, control.as_ref());

    let directory = Arc::new(directory);
    let clock = Clock::new(wanted.speed.or(config.plant.speed).unwrap_or(1.0));
    let mut tasks = JoinSet::new();
    let mut lines = Vec::new();
    for (mut served, _) in served {
        let (sender, receiver) = mpsc::channel::<Job>(JOBS_MAX);
        served.jobs = Some(Jobs {
            lang,
            directory: Arc::clone(&directory),
            receiver,
        });
        lines.push(sender);
        tasks.spawn(serve::serve(clock, served, std::future::pending()));
    }
    let prompt = Arc::new(Prompt {
        lang,
        directory,
        lines,
        quit: Notify::new(),
    });
    let ended = attend(&mut stop, &prompt, control.as_ref(), &mut tasks).await;
    tasks.shutdown().await;
    ended.map_err(|error| system(lang, error))
}

/// Executes commands until one of them, a signal or a failure ends it.
async fn attend(
    stop: &mut Stop,
    prompt: &Arc<Prompt>,
    control: Option<&Socket>,
    tasks: &mut JoinSet<std::io::Result<()>>,
) -> std::io::Result<()> {
    let mut typed = Typed::listen();
    let control = async {
        match control {
            Some(socket) => prompt::accept(&socket.listener, prompt).await,
            None => std::future::pending().await,
        }
    };
    let mut control = std::pin::pin!(control);
    loop {
        tokio::select! {
            () = stop.requested() => return Ok(()),
            () = prompt.quit.notified() => return Ok(()),
            () = &mut control => {}
            Some(ended) = tasks.join_next() => return ended.map_err(std::io::Error::other)?,
            line = typed.next() => match line {
                Some(line) => typed.show(&prompt.answer(&line).await),
                None => return Ok(()),
            },
        }
    }
}

/// The lines in virtual time, in the order of the directory.
pub(super) fn stages(
    lang: Lang,
    config: &Config,
    directory: &Directory,
    store: Option<&Store>,
    wanted: &PlantOptions,
) -> Result<Vec<Stage>, Failure> {
    let seed = wanted.seed.or(config.plant.seed).unwrap_or_default();
    let mut stages = Vec::new();
    for (index, (name, line)) in (0..).zip(&config.lines) {
        let own = line_config(seed.wrapping_add(index), wanted.verbose);
        let mut stage = Stage::new(name, own, line.serial);
        for (name, module) in config.modules_of(name) {
            let setup = &module.setup;
            let kept = match store {
                Some(store) => store.kept(lang, name, setup.family)?,
                None => None,
            };
            let sim = config.plant.modules.get(name).cloned();
            stage
                .add(name, setup, &sim.unwrap_or_default(), kept)
                .map_err(|error| system(lang, std::io::Error::other(error)))?;
        }
        for order in config.plant.lines.get(name).iter().flat_map(|s| &s.faults) {
            stage.add_fault(Instant(0), FaultTarget::Line, order);
        }
        stages.push(stage);
    }
    for text in &wanted.faults {
        if let Order::Line(line, order) = directory.read_fault(lang, text)? {
            answers::perform(lang, &mut stages[line], Instant(0), order);
        }
    }
    Ok(stages)
}

fn control(lang: Lang, wanted: &PlantOptions) -> Result<Option<Socket>, Failure> {
    let listen = |path: &PathBuf| {
        Socket::listen(lang, path).map_err(|error| unreachable(lang, path, &error))
    };
    wanted.control.as_ref().map(listen).transpose()
}

/// Opens all places. TCP first: a second simulator fails there, before it replaces the links of the
/// first one.
async fn open(
    lang: Lang,
    directory: &Directory,
    stages: Vec<Stage>,
    places: Vec<Place>,
    store: Option<Store>,
    wanted: &PlantOptions,
) -> Result<Vec<(Served, Place)>, Failure> {
    let mut tcps = Vec::new();
    for place in &places {
        tcps.push(match place.tcp {
            Some(address) => Some(listen(lang, address, "railbus sim --tcp 127.0.0.1:0").await?),
            None => None,
        });
    }
    let several = directory.lines.len() > 1;
    let width = width_of_names(directory);
    let mut all = Vec::new();
    let lines = stages.into_iter().zip(places).zip(tcps);
    for (((stage, mut place), tcp), name) in lines.zip(&directory.lines) {
        place.tcp = tcp.as_ref().map(Tcp::address);
        let pty = place.pty.as_deref().map(|path| open_pty(lang, name, path));
        let served = Served {
            serial: stage.serial(),
            stage: Box::new(stage),
            pty: pty.transpose()?,
            unplugged: None,
            tcp,
            frames: wanted
                .verbose
                .then(|| frames::Frames::new(several.then(|| name.clone()), width, wanted.json)),
            jobs: None,
            keeper: store.clone().map(Keeper::new),
        };
        all.push((served, place));
    }
    Ok(all)
}

fn open_pty(lang: Lang, name: &str, path: &Path) -> Result<Pty, Failure> {
    let elsewhere = format!("railbus sim plant.toml --pty {name}=/tmp/railbus-2");
    Pty::open(path).map_err(|error| error.into_failure(lang, path, &elsewhere))
}

/// The width of the names of lines and modules in the trace.
fn width_of_names(directory: &Directory) -> usize {
    let hosts = directory
        .lines
        .iter()
        .map(|line| "host.".len() + line.len());
    let names = directory.modules().map(str::len).chain(hosts);
    names.fold(frames::WIDTH, usize::max)
}

/// Prints what is served and how to connect. The reader may have gone; the lines are served
/// nevertheless.
fn announce(
    lang: Lang,
    wanted: &PlantOptions,
    directory: &Directory,
    config: &Config,
    served: &[(Served, Place)],
    control: Option<&Socket>,
) {
    let control = control.map(|socket| socket.path().display().to_string());
    let lines = config.lines.iter().zip(served);
    let text = if wanted.json {
        let lines: Vec<_> = lines
            .map(|((name, line), (_, place))| {
                let modules = config.modules_of(name).count();
                line_row(name, line.serial, modules, place.pty.as_deref(), place.tcp)
            })
            .collect();
        served_json(&lines, control.as_deref())
    } else {
        let mut table = Table::new(lang.get(SimText::LinesHead).split('|'));
        for ((name, line), (_, place)) in lines {
            let pty = place.pty.as_ref().map(|path| path.display().to_string());
            let tcp = place.tcp.map(|address| address.to_string());
            table.add([
                name.clone(),
                line.serial.to_string(),
                config.modules_of(name).count().to_string(),
                pty.unwrap_or_else(|| "-".to_owned()),
                tcp.unwrap_or_else(|| "-".to_owned()),
            ]);
        }
        let counts: [(&str, &dyn std::fmt::Display); 3] = [
            ("file", &wanted.file.display()),
            ("lines", &config.lines.len()),
            ("modules", &config.modules.len()),
        ];
        let head = lang.fill(SimText::PlantServed, &counts);
        let tail = control.map(|path| lang.fill(SimText::ControlledBy, &[("path", &path)]) + "\n");
        format!("{head}\n{}{}", table.render(), tail.unwrap_or_default())
    };
    let mut stdout = std::io::stdout();
    let _ = stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush());
    if wanted.verbose {
        frames::heading(lang, width_of_names(directory), wanted.json);
    }
}
