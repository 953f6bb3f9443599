//! What every handler needs of the daemon.

use super::access::{AccountsApi, AccountsPlace, Caller, Gate};
use super::config::Desk;
use super::listen::ended;
use super::northbound::Northbound;
use super::ops::Ops;
use super::tls::Tls;
use super::ws::{Printer, SocketLimit};
use railbus_plant::remote::Remote;
use railbus_site::Service;
use railbus_words::Lang;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::watch;

/// What every handler needs.
#[derive(Clone, Debug)]
pub(super) struct Site {
    pub(super) service: Service,
    /// The default language.
    pub(super) lang: Lang,
    /// It is the demo: nothing is real.
    pub(super) demo: bool,
    /// The lines that are simulated here, and can be controlled.
    pub(super) simulated: Arc<[Remote]>,
    /// Ends streams when the daemon stops.
    pub(super) stop: watch::Receiver<bool>,
    /// The limit of WebSockets.
    pub(super) sockets: SocketLimit,
    /// What is made for all of them together.
    pub(super) printer: Arc<Printer>,
    pub(super) ops: Arc<Ops>,
    /// The configuration file, and its changes.
    pub(super) desk: Arc<Desk>,
    /// What publishes the site to other systems.
    pub(super) northbound: Arc<Northbound>,
    /// Accounts and permissions.
    pub(super) access: Arc<Gate>,
    /// The URL of its pages: `http://127.0.0.1:7485`.
    pub(super) origin: Arc<str>,
    /// Certificate and key, if browsers use TLS.
    pub(super) tls: Option<Arc<Tls>>,
}

impl Site {
    /// Resolves when a stream must end: the daemon stops, or the caller has lost its permission.
    pub(super) fn over(&self, caller: &Caller) -> impl Future<Output = ()> + Send + use<> {
        let (mut stop, access, caller) =
            (self.stop.clone(), Arc::clone(&self.access), caller.clone());
        async move {
            tokio::select! {
                () = ended(&mut stop) => {}
                () = access.gone(&caller) => {}
            }
        }
    }

    /// What handlers of sessions and accounts need of it.
    pub(super) fn accounts(&self) -> AccountsApi {
        AccountsApi {
            access: Arc::clone(&self.access),
            events: Some(self.service.clone()),
            lang: self.lang,
            demo: self.demo,
            simulated: !self.simulated.is_empty(),
            name: self.name().into(),
            place: AccountsPlace::Site,
            origin: Arc::clone(&self.origin),
            is_tls: self.tls.is_some(),
        }
    }

    /// Its name: that of the folder of its configuration.
    pub(super) fn name(&self) -> String {
        name_of(self.demo, self.desk.file())
    }
}

/// The name of a site with this configuration file.
pub(super) fn name_of(is_demo: bool, file: &Path) -> String {
    if is_demo {
        return "demo".to_owned();
    }
    // The same however the path is written. Where the file itself is a link, the folder of the link
    // is that of the site.
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let folder = file.parent().map(railbus_app::config_file::real);
    let name = folder.as_deref().and_then(Path::file_name);
    name.map_or_else(
        || "railbus".to_owned(),
        |name| name.to_string_lossy().into_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_site_is_called_the_same_however_its_path_is_written() {
        let unique = format!("railbus-site-name-{}", std::process::id());
        let root = std::env::temp_dir().join(unique);
        let (plant, other) = (root.join("plant"), root.join("other"));
        std::fs::create_dir_all(&plant).unwrap();
        std::fs::create_dir_all(&other).unwrap();
        let file = plant.join("railbus.toml");
        std::fs::write(&file, "").unwrap();
        std::os::unix::fs::symlink(&file, other.join("railbus.toml")).unwrap();
        let name = |path: &Path| name_of(false, path);
        assert_eq!(name(&file), "plant");
        assert_eq!(name(&plant.join("not-yet.toml")), "plant");
        assert_eq!(name(&other.join("../plant/./railbus.toml")), "plant");
        assert_eq!(name(&other.join("railbus.toml")), "other", "a link");
        // A test runs in the folder of its package.
        assert_eq!(name(Path::new("railbus.toml")), "gateway");
        assert_eq!(name(Path::new("src/../railbus.toml")), "gateway");
        assert_eq!(name(Path::new("/railbus.toml")), "railbus");
        assert_eq!(name_of(true, &file), "demo");
        let _ = std::fs::remove_dir_all(root);
    }
}
