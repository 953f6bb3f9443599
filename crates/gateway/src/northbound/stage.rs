//! The outlets of a site in a temporary folder, for the tests of every kind.

use super::Northbound;
use super::supervisor::{OutletId, Supervised};
use crate::access::Gate;
use railbus_api::outlets::OutletState;
use railbus_site::{Config, Service};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;

/// Long enough for the busiest machine; nothing is proven by it.
pub(super) const PATIENCE: Duration = Duration::from_secs(60);

/// A site with its outlets and accounts. The folder is removed with it.
pub(super) struct OutletStage {
    pub(super) folder: PathBuf,
    pub(super) service: Service,
    pub(super) accounts: Arc<Gate>,
    pub(super) northbound: Arc<Northbound>,
    pub(super) changes: watch::Sender<u64>,
}

/// A new folder for the test of this name.
pub(super) fn folder(name: &str) -> PathBuf {
    let unique = format!("railbus-outlets-{}-{name}", std::process::id());
    let folder = std::env::temp_dir().join(unique);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// An address nothing listens at.
pub(super) async fn free_address() -> SocketAddr {
    let free = TcpListener::bind("127.0.0.1:0").await.unwrap();
    free.local_addr().unwrap()
}

impl OutletStage {
    /// A site of this configuration. Its outlets wait for [`OutletStage::run`].
    pub(super) fn new(folder: PathBuf, text: &str) -> OutletStage {
        let service = Service::start_in(Config::parse(text).unwrap(), &folder).unwrap();
        let accounts = Arc::new(Gate::open(&folder).unwrap());
        let northbound = Northbound::new("here", &folder, &service, &accounts);
        OutletStage {
            folder,
            service,
            accounts,
            northbound,
            changes: watch::Sender::new(0),
        }
    }

    /// The same, with its outlets at work.
    pub(super) fn running(folder: PathBuf, text: &str) -> OutletStage {
        let stage = OutletStage::new(folder, text);
        stage.run();
        stage
    }

    /// Starts its outlets.
    pub(super) fn run(&self) {
        self.northbound.run(self.changes.subscribe());
    }

    /// Brings a configuration into force without the checks of the outlets, as where a module has
    /// moved.
    pub(super) async fn reload(&self, text: &str) {
        let written = async { Ok::<(), ()>(()) };
        let done = self.service.reload_written(text, written).await;
        done.unwrap().unwrap();
    }

    /// Waits until this is true of an outlet.
    pub(super) async fn until(&self, id: &OutletId, is_so: impl Fn(&Supervised) -> bool) {
        let looks = async {
            loop {
                let news = self.northbound.news.notified();
                if self.northbound.look(id, &is_so) == Some(true) {
                    return;
                }
                news.await;
            }
        };
        tokio::time::timeout(PATIENCE, looks).await.unwrap();
    }

    /// Waits until an outlet runs.
    pub(super) async fn until_running(&self, id: &OutletId) {
        let runs = |outlet: &Supervised| outlet.state() == OutletState::Running;
        self.until(id, runs).await;
    }
}

impl Drop for OutletStage {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
