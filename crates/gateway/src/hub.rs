//! The centre of a fleet: what `railbus fleet serve` runs. It admits the sites, hears what they
//! say, and tells its owner over a Unix socket.
//!
//! # Where things are
//! - What is decided, without I/O: `railbus_fleet::centre`. What drives it: `driver`. Its
//!   connection, and the streams of its servers: `link`. What it tells: `routes`, `view`.

mod driver;
mod link;
mod routes;
mod view;

use crate::listen::{self, ConnectionLimit};
use crate::{Signals, deadline, say, system};
use driver::Driver;
use link::HubFiles;
use railbus_app::failure::Failure;
use railbus_app::socket::{self, Socket};
use railbus_words::{Code, Lang};
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
    CantServe { en: "can't serve the fleet", zh: "无法运行站群中心" }
    NoHubSocket {
        en: "can't listen on the socket {path}",
        zh: "无法监听套接字 {path}",
    }
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
        .map_err(|error| system(lang, error))?
        .block_on(serve(lang, wanted, files))
}

async fn serve(lang: Lang, wanted: &HubOptions, files: HubFiles) -> Result<(), Failure> {
    let mut signals = Signals::new().map_err(|error| system(lang, error))?;
    let socket = listen_on(lang, wanted.socket.as_deref())?;
    announce(lang, &wanted.folder, &files, socket.path());
    let (calls, asked) = mpsc::channel(CALLS_MAX);
    let (stop, stopped) = watch::channel(false);
    let driver = Driver::new(lang, files, asked, stopped.clone());
    let driving = tokio::spawn(driver.run());
    let limit = ConnectionLimit::new();
    let router = routes::router(calls);
    let listening = tokio::spawn(listen::unix(socket, router, limit.clone(), stopped));
    // There is no configuration to read again.
    while signals.next().await != crate::Asked::Stop {}
    deadline::after(deadline::END_MAX, move || {
        std::process::exit(Code::CutOff.exit().into());
    });
    // Fails if there is no receiver left.
    let _ = stop.send(true);
    // Fails if one panicked, which was reported.
    let _ = tokio::join!(listening, driving);
    limit.emptied().await;
    Ok(())
}

/// A socket that was named must be available; of the default ones, the first that is.
fn listen_on(lang: Lang, named: Option<&Path>) -> Result<Socket, Failure> {
    let places = match named {
        Some(path) => vec![path.to_owned()],
        None => socket::places(socket::HUB),
    };
    let mut refused = Failure::new(Code::Listen, lang.get(HubText::CantServe).to_owned());
    for path in places {
        match Socket::listen(lang, &path) {
            Ok(socket) => return Ok(socket),
            Err(error) => {
                let path = path.display();
                let message = lang.fill(HubText::NoHubSocket, &[("path", &path)]);
                refused = Failure::new(Code::Listen, message).because(error);
            }
        }
    }
    Err(refused)
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
