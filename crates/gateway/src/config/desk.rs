//! Where the configuration is changed, one change at a time, and always the same way: text, edit,
//! check, write, reload.

use crate::access::Caller;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures::bad_config;
use railbus_app::config_file;
use railbus_site::config::edit::WriteError;
use railbus_site::config::keeper::{Generation, Keeper, etag};
use railbus_site::{Config, Loan, Reloaded, Service};
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::Lang;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::{Mutex, OwnedMutexGuard, watch};
use tokio::task::JoinError;

/// How many tables an event names that have changed.
const TABLES_TOLD: usize = 8;

/// The desk of a daemon's configuration.
#[derive(Debug)]
pub(crate) struct Desk {
    keeper: Keeper,
    /// What is remembered of the site lies here.
    state: PathBuf,
    /// The ports of the text that the daemon began with, which is its owner's.
    ports_at_start: BTreeSet<String>,
    /// Whose turn it is to change the file, or to bring it into force.
    turn: Arc<Mutex<()>>,
    /// Counts how often another one was brought into force.
    changes: watch::Sender<u64>,
}

/// An event about the configuration, with the tables that are others now.
fn told(code: &str, tables: &[String]) -> Event {
    let event = Event::new(EventKind::Config, Severity::Info, code);
    let named = tables.iter().take(TABLES_TOLD).map(String::as_str);
    let more = (tables.len() > TABLES_TOLD).then_some("…");
    match named.chain(more).collect::<Vec<_>>().join(" ") {
        // Comments, or nothing at all.
        none if none.is_empty() => event,
        tables => event.what(&tables),
    }
}

/// Who changes it, and what they have seen of it.
#[derive(Debug)]
pub(crate) struct Asks<'a> {
    pub(crate) service: &'a Service,
    pub(crate) lang: Lang,
    /// The name that is written down with the change.
    pub(crate) who: &'a str,
    /// The marks of the texts that may be changed; none where any may.
    pub(crate) seen: Option<Vec<String>>,
}

/// What came of a change.
#[derive(Debug)]
pub(crate) struct Changed {
    /// The mark of the text in force now.
    pub(crate) etag: String,
    pub(crate) reloaded: Reloaded,
}

impl Desk {
    /// The desk of this file, which says this at the start, and of the site's folder.
    pub(crate) fn new(file: &Path, state: &Path, config: &Config) -> Desk {
        let ports = config.lines.values().map(|line| line.port.clone());
        Desk {
            keeper: Keeper::new(file.to_owned(), state),
            state: state.to_owned(),
            ports_at_start: ports.collect(),
            turn: Arc::default(),
            changes: watch::Sender::new(0),
        }
    }

    /// Tells whenever another configuration is in force.
    pub(crate) fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// The ports that the file had when the daemon began.
    pub(super) fn ports_at_start(&self) -> &BTreeSet<String> {
        &self.ports_at_start
    }

    pub(crate) fn file(&self) -> &Path {
        self.keeper.file()
    }

    pub(crate) fn state(&self) -> &Path {
        &self.state
    }

    /// Nobody else changes the file or what is in force meanwhile.
    async fn turn(&self) -> OwnedMutexGuard<()> {
        Arc::clone(&self.turn).lock_owned().await
    }

    /// What the file says.
    pub(crate) async fn text(&self) -> Result<String, Problem> {
        let read = self.at_disk(|keeper| keeper.read()).await;
        read.and_then(|text| text)
            .map_err(|error| self.unreadable(&error))
    }

    /// Every generation, oldest first.
    pub(crate) async fn generations(&self) -> Result<Vec<Generation>, Problem> {
        let kept = self.at_disk(|keeper| keeper.generations()).await;
        kept.map_err(|error| self.unreadable(&error))
    }

    /// One of them; without a number the text before the one that the file has.
    pub(crate) async fn generation(&self, id: Option<u64>) -> Result<Generation, Problem> {
        let found = match id {
            Some(id) => self.at_disk(move |keeper| keeper.generation(id)).await,
            None => {
                let now = self.text().await?;
                self.at_disk(move |keeper| keeper.before(&now)).await
            }
        };
        let found = found.map_err(|error| self.unreadable(&error))?;
        found.ok_or_else(|| Problem::new(codes::NO_GENERATION))
    }

    /// Changes the text, and brings it into force. Where anything is wrong, nothing changes.
    pub(crate) async fn change(
        self: &Arc<Desk>,
        asks: &Asks<'_>,
        change: impl FnOnce(&str) -> Result<String, Problem>,
    ) -> Result<Changed, Problem> {
        let turn = self.turn().await;
        let before = self.text().await?;
        if let Some(seen) = &asks.seen
            && !seen.contains(&etag(&before))
        {
            return Err(self.changed_meanwhile(&before));
        }
        if asks.seen.is_none() && before.is_empty() {
            self.must_be_new(asks.service)?;
        }
        let text = change(&before)?;
        let name = self.file().display().to_string();
        let new = Config::parse(&text);
        let new = new.map_err(|problems| bad_config(asks.lang, &name, &problems))?;
        let old = asks.service.config();
        let is_other = text != before;
        let (desk, service) = (Arc::clone(self), asks.service.clone());
        let (lang, who) = (asks.lang, asks.who.to_owned());
        // From here on it goes to its end, whether or not somebody waits.
        let end = tokio::spawn(async move {
            let _turn = turn;
            let (writer, to_write) = (Arc::clone(&desk), text.clone());
            let written = async move {
                match is_other {
                    true => writer.write(before, to_write, who).await,
                    false => Ok(()),
                }
            };
            let changed = desk.bring_into_force(&service, lang, &text, written);
            let changed = changed.await?;
            if is_other {
                let event = told("config_changed", &old.differences(&new));
                service.tell_event(event.by(service.origin()));
            }
            Ok(changed)
        });
        let broken =
            |error: JoinError| Err(Problem::new(codes::INTERNAL).with("reason", error.to_string()));
        end.await.unwrap_or_else(broken)
    }

    /// Brings into force what the file says.
    pub(crate) async fn reload(&self, service: &Service, lang: Lang) -> Result<Changed, Problem> {
        let _turn = self.turn().await;
        let text = config_file::text_of(self.file())?;
        let old = service.config();
        let written = async { Ok(()) };
        let changed = self.bring_into_force(service, lang, &text, written);
        let changed = changed.await?;
        let event = told("config_reloaded", &old.differences(&service.config()));
        let signal = Origin {
            via: "signal".to_owned(),
            ..Caller::owner().origin()
        };
        service.tell_event(event.by(&signal));
        Ok(changed)
    }

    /// Takes a line back, and the configuration as it is by now: a module may have moved.
    pub(crate) async fn take_back(&self, loan: Loan, service: &Service) {
        let _turn = self.turn().await;
        let text = config_file::text_of(self.file()).ok();
        let old = service.config();
        loan.end(text.as_deref()).await;
        let tables = old.differences(&service.config());
        if !tables.is_empty() {
            self.is_another();
            service.tell_event(told("config_changed", &tables).by(service.origin()));
        }
    }

    /// Tells those who follow that another configuration is in force.
    fn is_another(&self) {
        self.changes
            .send_modify(|count| *count = count.wrapping_add(1));
    }

    async fn bring_into_force(
        &self,
        service: &Service,
        lang: Lang,
        text: &str,
        written: impl Future<Output = Result<(), Problem>> + Send + 'static,
    ) -> Result<Changed, Problem> {
        let name = self.file().display().to_string();
        let done = service.reload_written(text, written).await;
        let reloaded = done.map_err(|problems| bad_config(lang, &name, &problems))??;
        self.is_another();
        let etag = etag(text);
        Ok(Changed { etag, reloaded })
    }

    async fn write(&self, seen: String, text: String, who: String) -> Result<(), Problem> {
        let written = self
            .at_disk(move |keeper| match keeper.write(&seen, &text, &who) {
                Err(WriteError::Changed) => Err(Err(keeper.read().unwrap_or_default())),
                Err(WriteError::Io(error)) => Err(Ok(error)),
                Ok(()) => Ok(()),
            })
            .await;
        match written {
            Ok(Ok(())) => Ok(()),
            Ok(Err(Err(now))) => Err(self.changed_meanwhile(&now)),
            Ok(Err(Ok(error))) | Err(error) => Err(Problem::new(codes::CONFIG_NOT_WRITTEN)
                .with("file", self.file().display().to_string())
                .with("reason", error.to_string())),
        }
    }

    /// A file that is gone is not begun anew over the lines at work.
    fn must_be_new(&self, service: &Service) -> Result<(), Problem> {
        let is_gone = !self.file().exists() && service.config() != Config::default();
        match is_gone {
            true => Err(self.unreadable(&io::ErrorKind::NotFound.into())),
            false => Ok(()),
        }
    }

    /// Disks may be slow, and the lines are not to wait for them.
    async fn at_disk<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Keeper) -> T + Send + 'static,
    ) -> io::Result<T> {
        let keeper = self.keeper.clone();
        let done = tokio::task::spawn_blocking(move || work(&keeper)).await;
        done.map_err(io::Error::other)
    }

    fn unreadable(&self, error: &io::Error) -> Problem {
        Problem::new(codes::CONFIG_FILE)
            .with("file", self.file().display().to_string())
            .with("reason", error.to_string())
    }

    fn changed_meanwhile(&self, now: &str) -> Problem {
        Problem::new(codes::CONFIG_CHANGED)
            .with("file", self.file().display().to_string())
            .with("etag", etag(now))
    }
}
