//! The only place where the configuration is changed, one change at a time, and always in the same
//! way: text, edit, check, write, reload.

use crate::access::Caller;
use crate::northbound;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures::{self, bad_config};
use railbus_app::config_file;
use railbus_site::config::edit::WriteError;
use railbus_site::config::keeper::{ConfigFile, Generation, etag};
use railbus_site::{Config, ExclusiveHold, ReloadError, Reloaded, Service};
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use railbus_words::Lang;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::{Mutex, OwnedMutexGuard, watch};
use tokio::task::JoinError;

/// How many changed tables an event names.
const TABLES_TOLD: usize = 8;

/// Changes the configuration of a daemon.
#[derive(Debug)]
pub(crate) struct Desk {
    keeper: ConfigFile,
    /// The state folder of the site.
    state: PathBuf,
    /// The ports of the text with which the daemon started, which is its owner's.
    ports_at_start: BTreeSet<String>,
    /// Serialises changes of the file and reloads.
    turn: Arc<Mutex<()>>,
    /// Counts reloads.
    changes: watch::Sender<u64>,
}

/// An event about the configuration, with the tables that have changed.
fn told(code: &str, tables: &[String]) -> Event {
    let event = Event::new(EventKind::Config, Severity::Info, code);
    let named = tables.iter().take(TABLES_TOLD).map(String::as_str);
    let more = (tables.len() > TABLES_TOLD).then_some("…");
    match named.chain(more).collect::<Vec<_>>().join(" ") {
        // Only comments have changed, or nothing.
        none if none.is_empty() => event,
        tables => event.what(&tables),
    }
}

/// Who makes a change, and which versions they have seen.
#[derive(Debug)]
pub(crate) struct Asks<'a> {
    pub(crate) service: &'a Service,
    pub(crate) lang: Lang,
    /// The name for the record of the change.
    pub(crate) who: &'a str,
    /// The versions of the text that may be changed; none if any may.
    pub(crate) seen: Option<Vec<String>>,
    /// It is so already, as where a module has moved: what integrations make of it is no reason to
    /// leave the file as it was. They show what does not fit.
    pub(crate) is_fact: bool,
}

/// The result of a change.
#[derive(Debug)]
pub(crate) struct Changed {
    /// The version of the text now in force.
    pub(crate) etag: String,
    pub(crate) reloaded: Reloaded,
}

impl Desk {
    /// The desk of this file, which says this at the start, and of the site's folder.
    pub(crate) fn new(file: &Path, state: &Path, config: &Config) -> Desk {
        let ports = config.lines.values().map(|line| line.port.clone());
        Desk {
            keeper: ConfigFile::new(file.to_owned(), state),
            state: state.to_owned(),
            ports_at_start: ports.collect(),
            turn: Arc::default(),
            changes: watch::Sender::new(0),
        }
    }

    /// Notifies of every reload.
    pub(crate) fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// The ports that the file had when the daemon started.
    pub(super) fn ports_at_start(&self) -> &BTreeSet<String> {
        &self.ports_at_start
    }

    pub(crate) fn file(&self) -> &Path {
        self.keeper.file()
    }

    pub(crate) fn state(&self) -> &Path {
        &self.state
    }

    /// Excludes other changes and reloads.
    async fn turn(&self) -> OwnedMutexGuard<()> {
        Arc::clone(&self.turn).lock_owned().await
    }

    /// The text of the file.
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

    /// One generation; without a number, the one before the text in the file.
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

    /// Changes the text and applies it. If anything is wrong, nothing changes.
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
        if !asks.is_fact {
            northbound::check(asks.lang, &name, &text, &new)?;
        }
        let old = asks.service.config();
        let is_other = text != before;
        let (desk, service) = (Arc::clone(self), asks.service.clone());
        let (lang, who) = (asks.lang, asks.who.to_owned());
        // From here on it runs to its end, whether or not the caller waits.
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

    /// Applies the text of the file.
    pub(crate) async fn reload(&self, service: &Service, lang: Lang) -> Result<Changed, Problem> {
        let _turn = self.turn().await;
        let text = config_file::text_of(self.file())?;
        if let Ok(new) = Config::parse(&text) {
            northbound::check(lang, &self.file().display().to_string(), &text, &new)?;
        }
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

    /// Ends exclusive access to a line, and applies the present configuration: a module may have
    /// moved.
    pub(crate) async fn take_back(&self, loan: ExclusiveHold, service: &Service) {
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

    /// Notifies followers of a reload.
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
        let reloaded = done.map_err(|error| match error {
            ReloadError::Problems(problems) => bad_config(lang, &name, &problems),
            ReloadError::Refused(failure) => failures::of_several(&failure),
        })??;
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

    /// A file that was deleted is not started anew over running lines.
    fn must_be_new(&self, service: &Service) -> Result<(), Problem> {
        let is_gone = !self.file().exists() && *service.config() != Config::default();
        match is_gone {
            true => Err(self.unreadable(&io::ErrorKind::NotFound.into())),
            false => Ok(()),
        }
    }

    /// Disks may be slow, and lines must not wait for them.
    async fn at_disk<T: Send + 'static>(
        &self,
        work: impl FnOnce(&ConfigFile) -> T + Send + 'static,
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
