//! What an outlet gets: the site in its own name and with its own rights, its settings, and where
//! it reports. And how it runs: on a thread of its own, so that nothing it does holds up another.

use super::kind::{Field, OutletKind, Shape, Work};
use super::run::Northbound;
use super::secrets::Secrets;
use super::supervisor::{Input, OutletCounts, OutletId, RunId, Supervised};
use crate::access::Gate;
use crate::access::secret::Secret;
use crate::config::RemoteConfig;
use crate::remote_api::RemoteApi;
use jiff::Timestamp;
use railbus_api::outlets::OutletError;
use railbus_api::problem::{Problem, codes};
use railbus_site::config::change::Keys;
use railbus_site::{Events, Rights, Role, Service};
use railbus_store::audit::Origin;
use railbus_words::time::rfc3339;
use serde_json::Value;
use std::net::IpAddr;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::watch;

/// The key of the settings with the outputs that an outlet may switch. Without it, it only reads.
const WRITE: &str = "write";
/// How the names of an outlet's files end.
const KEPT: &str = ".json";
const OUTBOX: &str = ".outbox.db";

/// What a running outlet has. There is nothing else of the daemon that it can reach.
pub(crate) struct Outlet {
    /// Its name.
    pub(crate) name: String,
    /// What the site is called.
    pub(crate) site: Arc<str>,
    /// The site, in the outlet's name and with its rights.
    pub(crate) service: Service,
    /// Its settings, as its fields are. They change for kinds that take them over.
    pub(crate) settings: watch::Receiver<Keys>,
    /// Where it reports how it does.
    pub(crate) report: Report,
    pub(super) kind: &'static OutletKind,
    pub(super) secrets: Arc<Secrets>,
    /// For kinds whose clients sign in.
    #[cfg_attr(
        not(feature = "opcua"),
        expect(dead_code, reason = "clients of the other kinds do not sign in")
    )]
    pub(super) accounts: Arc<Gate>,
    /// The API of the daemon, for remote callers.
    #[cfg_attr(
        not(feature = "fleet"),
        expect(dead_code, reason = "the other kinds have no remote callers")
    )]
    pub(super) api: Arc<RemoteApi>,
    /// The configuration of the daemon, for those who may say a part of it.
    #[cfg_attr(
        not(feature = "fleet"),
        expect(dead_code, reason = "the other kinds have no centre")
    )]
    pub(super) config: RemoteConfig,
    /// The folder of what is kept.
    pub(super) folder: Arc<Path>,
    pub(super) stop: watch::Receiver<bool>,
}

/// Its settings by their keys, as its fields say.
impl Outlet {
    /// A text among its settings; empty where it is left out.
    pub(crate) fn text(&self, key: &str) -> String {
        let value = self.setting(key);
        value.as_str().unwrap_or_default().to_owned()
    }

    /// A number among its settings, or what its field says where it is left out.
    pub(crate) fn number(&self, key: &str) -> i64 {
        let is_it = |field: &&Field| field.key == key;
        let default = match self.kind.fields.iter().find(is_it).map(|field| field.shape) {
            Some(Shape::Number(_, _, default)) => default,
            _ => 0,
        };
        self.setting(key).as_i64().unwrap_or(default)
    }

    /// Whether a setting of shape [`Shape::Flag`] is set.
    #[cfg_attr(
        not(any(test, feature = "opcua")),
        expect(dead_code, reason = "no other kind has such a setting")
    )]
    pub(crate) fn flag(&self, key: &str) -> bool {
        self.setting(key) == Value::Bool(true)
    }

    fn setting(&self, key: &str) -> Value {
        self.settings.borrow().get(key).cloned().unwrap_or_default()
    }
}

impl Outlet {
    /// The site in the outlet's name for a client of it at this address: logs have both.
    pub(crate) fn service_for(&self, client: IpAddr) -> Service {
        let rights = rights(&self.settings.borrow());
        self.service_of(&client.to_string(), rights)
    }

    /// The same for a client that has shown who it is, as this text says besides its address, and
    /// may switch these outputs; none for reading only.
    pub(crate) fn service_as(&self, client: IpAddr, who: &str, points: &[String]) -> Service {
        self.service_of(&format!("{client} {who}"), rights_to(points.to_vec()))
    }

    /// What its remote callers may switch.
    #[cfg_attr(
        not(feature = "fleet"),
        expect(dead_code, reason = "the other kinds have no remote callers")
    )]
    pub(super) fn rights(&self) -> Rights {
        rights(&self.settings.borrow())
    }

    fn service_of(&self, client: &str, rights: Rights) -> Service {
        let origin = Origin {
            who: self.service.origin().who.clone(),
            via: format!("{} {client}", self.kind.name),
        };
        self.service.on_behalf_of(origin, rights)
    }

    /// Looks at how the run of this outlet does, for a test beside it; none if there is none.
    pub(crate) fn look<T>(&self, look: impl FnOnce(&Supervised) -> T) -> Option<T> {
        let id = OutletId {
            kind: self.kind.name,
            name: self.name.clone(),
        };
        self.report.to.upgrade()?.look(&id, look)
    }

    /// Its secret, as it is now.
    pub(crate) fn secret(&self) -> Option<Arc<Secret>> {
        self.secrets.of(self.kind, &self.name)
    }

    /// A file of its own in the state folder.
    pub(crate) fn kept(&self) -> PathBuf {
        let name = format!("{}-{}{KEPT}", self.kind.name, self.name);
        self.folder.join(name)
    }

    /// The file of its outbox.
    pub(crate) fn outbox_file(&self) -> PathBuf {
        let name = format!("{}-{}{OUTBOX}", self.kind.name, self.name);
        self.folder.join(name)
    }

    /// Files like [`Outlet::kept`] and [`Outlet::outbox_file`] of outlets of this kind that the
    /// configuration does not have: of earlier names, or removed while the daemon did not run.
    pub(crate) fn left_behind(&self) -> (Vec<PathBuf>, Vec<PathBuf>) {
        // As it is once the file was seen: an outlet is configured before it has one.
        let is_there = |name: &str| {
            let config = self.service.config();
            let outlet = config.outlets.get(name);
            outlet.is_some_and(|outlet| outlet.kind == self.kind.name)
        };
        left_in(&self.folder, self.kind.name, is_there)
    }

    /// Whether the configuration has it no longer.
    pub(crate) fn is_gone(&self) -> bool {
        let config = self.service.config();
        let now = config.outlets.get(&self.name);
        now.is_none_or(|now| now.kind != self.kind.name)
    }

    /// Resolves when it must end. It then has [`super::supervisor::STOP_MAX`].
    pub(crate) fn stopped(&self) -> impl Future<Output = ()> + use<> {
        let mut stop = self.stop.clone();
        async move {
            // Fails if the supervisor is gone, which stops it as well.
            let _ = stop.wait_for(|stop| *stop).await;
        }
    }
}

/// The files of outlets of a kind that are not there: those with JSON, and outboxes.
fn left_in(
    folder: &Path,
    kind: &str,
    is_there: impl Fn(&str) -> bool,
) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let (mut kept, mut outboxes) = (Vec::new(), Vec::new());
    // A folder that can't be read has nothing that could be used.
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let file = entry.file_name();
        let rest = file.to_str().and_then(|file| file.strip_prefix(kind));
        let Some(rest) = rest.and_then(|rest| rest.strip_prefix('-')) else {
            continue;
        };
        for (end, found) in [(KEPT, &mut kept), (OUTBOX, &mut outboxes)] {
            // Names have no dots.
            let name = rest.strip_suffix(end).filter(|name| !name.contains('.'));
            if name.is_some_and(|name| !is_there(name)) {
                found.push(entry.path());
            }
        }
    }
    (kept, outboxes)
}

/// For whom an outlet acts.
pub(super) fn origin(id: &OutletId) -> Origin {
    Origin::program(&format!("{}:{}", id.kind, id.name))
}

/// What an outlet may do: read, and switch the outputs that its settings name.
pub(super) fn rights(settings: &Keys) -> Rights {
    let named = settings.get(WRITE).and_then(|value| value.as_array());
    let points: Vec<String> = named
        .into_iter()
        .flatten()
        .filter_map(|point| point.as_str().map(str::to_owned))
        .collect();
    rights_to(points)
}

/// To read, and to switch these outputs.
fn rights_to(points: Vec<String>) -> Rights {
    Rights {
        // Without points an operator could switch them all.
        role: match points.is_empty() {
            true => Role::Viewer,
            false => Role::Operator,
        },
        points: points.into(),
    }
}

/// Where an outlet reports how it does.
#[derive(Clone, Debug)]
pub(crate) struct Report {
    pub(super) run: RunId,
    pub(super) counts: Arc<OutletCounts>,
    pub(super) to: Weak<Northbound>,
}

impl Report {
    /// What it counts.
    pub(crate) fn counts(&self) -> &OutletCounts {
        &self.counts
    }

    /// It has begun its work.
    pub(crate) fn ready(&self) {
        self.input(Input::Ready(self.run));
    }

    /// It delivered something, or reached the other side again.
    pub(crate) fn worked(&self) {
        self.input(Input::Worked(self.run));
    }

    /// What it does failed for this many times, and is tried again after this time, if at all.
    pub(crate) fn failed(&self, problem: Problem, tries: u32, retry: Option<Duration>) {
        let error = OutletError {
            at: rfc3339(Timestamp::now()),
            tries,
            problem,
        };
        self.input(Input::Failed(self.run, error, retry));
    }

    /// A client was not served as it wanted: the last error, without an event, for the outlet goes
    /// on. This many times by now.
    pub(crate) fn noted(&self, problem: Problem, tries: u32) {
        let error = OutletError {
            at: rfc3339(Timestamp::now()),
            tries,
            problem,
        };
        self.input(Input::Noted(self.run, error));
    }

    fn input(&self, input: Input) {
        if let Some(to) = self.to.upgrade() {
            to.input(input);
        }
    }
}

/// Runs an outlet on a thread of its own, until it ends or panics; `ended` is then called with the
/// reason.
pub(super) fn spawn(
    outlet: Outlet,
    events: Events,
    ended: impl FnOnce(Problem) + Send + 'static,
) -> std::io::Result<()> {
    let name = outlet.name.clone();
    let thread = std::thread::Builder::new().name(format!("outlet {}", outlet.kind.name));
    let run = move || {
        let work = outlet.kind.run;
        let end = on_this_thread(|| work(outlet, events));
        let reason = match end {
            Ok(Ok(())) => Problem::new(codes::OUTLET_ENDED),
            Ok(Err(problem)) => problem,
            Err(reason) => Problem::new(codes::OUTLET_ENDED).with("reason", reason),
        };
        ended(match reason.code == codes::OUTLET_ENDED.code {
            true => reason.with("name", name),
            false => reason,
        });
    };
    thread.spawn(run).map(drop)
}

/// Runs this to its end in a runtime of its own. An error says why there is no result.
pub(super) fn on_this_thread<T>(what: impl FnOnce() -> Work<T>) -> Result<T, String> {
    let runtime = Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| error.to_string())?;
    let end = catch_unwind(AssertUnwindSafe(|| runtime.block_on(what())));
    // A pending name look-up must not delay the end.
    runtime.shutdown_background();
    end.map_err(|panic| {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
        format!("panic: {}", text.unwrap_or_default())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_outlets_of_earlier_names_have_left_is_found() {
        let folder = std::env::temp_dir().join(format!("railbus-left-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for file in [
            "toy-now.json",
            "toy-now.outbox.db",
            "toy-old.json",
            "toy-old.outbox.db",
            "toy-old.outbox.db-wal",
            "toy-old.outbox.broken-7.db",
            "toys-old.json",
            "audit-1.json",
            "toy-gone.outbox.db",
        ] {
            std::fs::write(folder.join(file), "").unwrap();
        }
        let (kept, mut outboxes) = left_in(&folder, "toy", |name| name == "now");
        outboxes.sort();
        assert_eq!(kept, [folder.join("toy-old.json")]);
        let both = ["toy-gone.outbox.db", "toy-old.outbox.db"];
        assert_eq!(outboxes, both.map(|file| folder.join(file)));
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(left_in(&folder, "toy", |_| false), (vec![], vec![]));
    }
}
