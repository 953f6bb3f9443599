//! The centre of a fleet: what `railbus fleet serve` runs. It admits the sites, hears what they
//! say, and answers its owner over a Unix socket and, if it listens, clients over TCP.
//!
//! # Where things are
//! - What is decided, without I/O: `railbus_fleet::centre` and `railbus_fleet::ledger`. What drives
//!   it: `driver`. Its connection, and the streams of its servers: `link`, `streams`. What it
//!   tells: `routes`, `view`, `sites`; its pages: `pages`. What sites tell through it: `site_api`.
//!   What they are told to do: `command`; many of them at once: `bulk`. Which configuration they
//!   are to have: `config`. Keys that it issues: `keys`. Keys that are let in no longer: `revoke`.

mod bulk;
mod command;
mod config;
mod driver;
mod keys;
mod link;
mod pages;
mod revoke;
mod routes;
mod site_api;
mod sites;
mod streams;
mod view;

use crate::access::{AccountsApi, AccountsPlace, Gate};
use crate::listen::{self, ConnectionLimit};
use crate::tcp::{self, Network, Reached};
use crate::texts::GatewayText;
use crate::tls::CertificateSource;
use crate::{Asked, Signals, cut_off, deadline, listen_on_socket, no_socket, say};
use driver::Driver;
use link::HubFiles;
use railbus_app::failure::Failure;
use railbus_app::socket;
use railbus_words::{Code, Lang};
pub use revoke::{Revocation, revoke_issued, revoke_keys};
pub(crate) use routes::HubApi;
use routes::HubAudience;
#[cfg(test)]
pub(crate) use routes::{DOCUMENT, documented};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::net::TcpListener;
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
    /// Where it listens for browsers, and programs with a token, if anywhere.
    pub listen: Option<SocketAddr>,
    /// Certificate and key, if it uses TLS.
    pub tls: Option<CertificateSource>,
    /// Names by which it is reached.
    pub names: Vec<String>,
}

/// What clients over TCP reach.
struct HubNetwork {
    tcp: TcpListener,
    reached: Reached,
    accounts: AccountsApi,
}

impl HubNetwork {
    /// Listens for clients who have accounts in the folder of the centre.
    async fn open(lang: Lang, wanted: &HubOptions) -> Result<Option<HubNetwork>, Failure> {
        let Some(listen) = wanted.listen else {
            return Ok(None);
        };
        let network = Network {
            listen,
            tls: wanted.tls.clone(),
            names: wanted.names.clone(),
        };
        let state = link::folder(&wanted.folder);
        let folder = wanted.folder.display();
        let serve = format!("railbus fleet serve {folder}");
        let add = format!("railbus user add NAME --role admin --fleet {folder}");
        network.may_listen(lang, Some(&state), (&serve, Some(&add)))?;
        let tcp = tcp::bind(lang, listen, &serve).await?;
        // Another process of this centre has them: this one can serve without listening.
        let access = Gate::open(&state).map_err(|problem| problem.with_hint(serve));
        let access = access.map_err(|problem| Failure::of_problem(lang, &problem))?;
        let reached = Reached::open(lang, &tcp, &network, &state)?;
        let accounts = AccountsApi {
            access: Arc::new(access),
            events: None,
            lang,
            demo: false,
            simulated: false,
            name: name(&wanted.folder).into(),
            place: AccountsPlace::Centre,
            origin: reached.origin.as_str().into(),
            is_tls: reached.tls.is_some(),
        };
        Ok(Some(HubNetwork {
            tcp,
            reached,
            accounts,
        }))
    }
}

/// The name of a fleet: that of its folder.
fn name(folder: &Path) -> String {
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Serves until it is stopped.
///
/// # Errors
/// Its files can't be used, or it may not listen on its socket or over TCP.
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
    let network = HubNetwork::open(lang, wanted).await?;
    announce(
        lang,
        &wanted.folder,
        &files,
        socket.path(),
        network.as_ref(),
    );
    let (calls, asked) = mpsc::channel(CALLS_MAX);
    let (stop, stopped) = watch::channel(false);
    let driver = Driver::new(lang, files, asked, stopped.clone());
    let driving = tokio::spawn(driver.run());
    let [limit, socket_limit] = [ConnectionLimit::new(), ConnectionLimit::new()];
    let accounts = network.as_ref().map(|network| &network.accounts);
    let owner = HubAudience::Owner(accounts, &wanted.folder);
    let router = routes::router(lang, calls.clone(), owner);
    let over_socket = listen::unix(socket, router, socket_limit.clone(), stopped.clone());
    let mut listening = vec![tokio::spawn(over_socket)];
    let mut tls = None;
    if let Some(HubNetwork {
        tcp,
        reached,
        accounts,
    }) = network
    {
        let router = routes::router(lang, calls, HubAudience::Network(&accounts, reached.front));
        let over_tcp = listen::tcp(tcp, reached.tls.clone(), router, limit.clone(), stopped);
        listening.push(tokio::spawn(over_tcp));
        tls = reached.tls;
    }
    // There is no configuration to read again.
    while signals.next().await != Asked::Stop {
        tcp::reload_tls(lang, tls.as_deref());
    }
    deadline::after(deadline::END_MAX, move || cut_off(lang));
    // Fails if there is no receiver left.
    let _ = stop.send(true);
    // Fails if one panicked, which was reported.
    for task in listening {
        let _ = task.await;
    }
    let _ = driving.await;
    tokio::join!(limit.emptied(), socket_limit.emptied());
    Ok(())
}

/// The system refuses something that it usually grants.
fn cant_serve(lang: Lang, error: std::io::Error) -> Failure {
    Failure::new(Code::System, lang.get(HubText::CantServeFleet).to_owned()).because(error)
}

fn announce(
    lang: Lang,
    folder: &Path,
    files: &HubFiles,
    socket: &Path,
    network: Option<&HubNetwork>,
) {
    let version = env!("CARGO_PKG_VERSION");
    let reached = network.map(|network| {
        let Reached { origin, tls, .. } = &network.reached;
        let tls = tls.as_deref();
        let tls = tls.map(|tls| format!("\n  tls     SHA-256 {}", tls.fingerprint()));
        // If there is a user already, there is no link.
        let setup = network.accounts.access.setup_link(origin).map(|link| {
            let once = lang.get(GatewayText::ServeSetup);
            format!("\n  setup   {link}   {once}")
        });
        let (setup, tls) = (setup.unwrap_or_default(), tls.unwrap_or_default());
        format!("\n  web     {origin}/{setup}{tls}\n  api     {origin}/fleet/v1")
    });
    say(&format!(
        "railbus {version}  {}\n  servers {}{}\n  socket  {}\n  {}",
        lang.fill(HubText::Serves, &[("name", &name(folder))]),
        files.servers.join(" "),
        reached.unwrap_or_default(),
        socket.display(),
        lang.get(HubText::Stop)
    ));
}
