//! The centre of a fleet: what `railbus fleet serve` runs. It admits the sites, hears what they
//! say, and tells its owner over a Unix socket.
//!
//! # Where things are
//! - What is decided, without I/O: `railbus_fleet::centre` and `railbus_fleet::ledger`. What drives
//!   it: `driver`. Its connection, and the streams of its servers: `link`. What it tells:
//!   `routes`, `view`. What sites tell through it: `site_api`. What they are told to do: `command`.
//!   Keys that it issues: `keys`. Keys that are let in no longer: `revoke`.

mod command;
mod driver;
mod keys;
mod link;
mod revoke;
mod routes;
mod site_api;
mod view;

use crate::listen::{self, ConnectionLimit};
use crate::{Asked, Signals, cut_off, deadline, listen_on_socket, no_socket, say};
use driver::Driver;
use link::HubFiles;
use railbus_app::failure::Failure;
use railbus_app::socket;
use railbus_words::{Code, Lang};
pub use revoke::{Revocation, revoke_issued, revoke_keys};
use std::path::{Path, PathBuf};
use tokio::sync::{mpsc, watch};

/// How many requests wait for the driver.
const CALLS_MAX: usize = 64;

railbus_words::texts! {
    pub(crate) HubText;

    Serves { en: "the centre of {name}", zh: "站群 {name} 的中心" }
    Stop {
        en: "press Ctrl-C to stop; sites go on without it",
        zh: "按 Ctrl-C 停止；各站点继续运行",
    }
    Connected { en: "connected to {server}", zh: "已连接 {server}" }
    CantServeFleet { en: "can't run the centre", zh: "无法运行站群中心" }
}

/// The options of the centre.
#[derive(Clone, Debug)]
pub struct HubOptions {
    /// The folder of the fleet, as `railbus fleet init` made it.
    pub folder: PathBuf,
    /// The socket, if one is named.
    pub socket: Option<PathBuf>,
}

/// Serves until it is stopped.
///
/// # Errors
/// Its files can't be used, or it may not listen on its socket.
pub fn run(lang: Lang, wanted: &HubOptions) -> Result<(), Failure> {
    let files = HubFiles::read(&wanted.folder);
    let files = files.map_err(|problem| Failure::of_problem(lang, &problem))?;
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| cant_serve(lang, error))?
        .block_on(serve(lang, wanted, files))
}

async fn serve(lang: Lang, wanted: &HubOptions, files: HubFiles) -> Result<(), Failure> {
    let mut signals = Signals::new().map_err(|error| cant_serve(lang, error))?;
    // Without its socket nobody could ask it.
    let socket = listen_on_socket(lang, wanted.socket.as_deref(), socket::HUB)?
        .map_err(|(path, error)| no_socket(lang, &path, &error))?;
    announce(lang, &wanted.folder, &files, socket.path());
    let (calls, asked) = mpsc::channel(CALLS_MAX);
    let (stop, stopped) = watch::channel(false);
    let driver = Driver::new(lang, files, asked, stopped.clone());
    let driving = tokio::spawn(driver.run());
    let limit = ConnectionLimit::new();
    let router = routes::router(calls);
    let listening = tokio::spawn(listen::unix(socket, router, limit.clone(), stopped));
    // There is no configuration to read again.
    while signals.next().await != Asked::Stop {}
    deadline::after(deadline::END_MAX, move || cut_off(lang));
    // Fails if there is no receiver left.
    let _ = stop.send(true);
    // Fails if one panicked, which was reported.
    let _ = tokio::join!(listening, driving);
    limit.emptied().await;
    Ok(())
}

/// The system refuses something that it usually grants.
fn cant_serve(lang: Lang, error: std::io::Error) -> Failure {
    Failure::new(Code::System, lang.get(HubText::CantServeFleet).to_owned()).because(error)
}

fn announce(lang: Lang, folder: &Path, files: &HubFiles, socket: &Path) {
    let version = env!("CARGO_PKG_VERSION");
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    let name = name.to_string_lossy();
    say(&format!(
        "railbus {version}  {}\n  servers {}\n  socket  {}\n  {}",
        lang.fill(HubText::Serves, &[("name", &name)]),
        files.servers.join(" "),
        socket.display(),
        lang.get(HubText::Stop)
    ));
}
