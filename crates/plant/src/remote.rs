//! A simulated line inside the daemon: views of it, and commands that come over HTTP, in the
//! grammar of the prompt.

use super::orders::{Directory, LineOrder, Order};
use super::serve::{Job, Jobs};
use super::stage::FaultTarget;
use railbus_api::sim::SimLineInfo;
use railbus_app::failure::Failure;
use railbus_site::config::FaultsOf;
use railbus_words::Lang;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot};

/// Queued commands.
const JOBS_MAX: usize = 16;

/// A simulated line, ready for commands.
#[derive(Clone, Debug)]
pub struct Remote {
    name: Arc<str>,
    directory: Arc<Directory>,
    jobs: mpsc::Sender<Job>,
}

/// A valid action on it.
#[derive(Clone, Debug)]
pub struct LineRequest(LineOrder);

impl Remote {
    /// The only line of a directory, and the receiver of its commands.
    pub(super) fn new(lang: Lang, name: &str, directory: Directory) -> (Remote, Jobs) {
        let (jobs, receiver) = mpsc::channel(JOBS_MAX);
        let directory = Arc::new(directory);
        let remote = Remote {
            name: name.into(),
            directory: Arc::clone(&directory),
            jobs,
        };
        let jobs = Jobs {
            lang,
            directory,
            receiver,
        };
        (remote, jobs)
    }

    /// The line's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether there is a module of that name.
    pub fn has(&self, module: &str) -> bool {
        self.directory.setup(module).is_some()
    }

    /// Parses a command as at the prompt: `power pump off`, `pump.di0 = 1`.
    ///
    /// # Errors
    /// Why it is not valid.
    pub fn read(&self, lang: Lang, text: &str) -> Result<Option<LineRequest>, Failure> {
        match self.directory.read(lang, text)? {
            Order::Line(_, order) => Ok(Some(LineRequest(order))),
            Order::All(_) | Order::Help | Order::Quit => Ok(None),
        }
    }

    /// Parses faults to add to the line.
    ///
    /// # Errors
    /// Why they are not valid.
    pub fn read_faults(&self, lang: Lang, text: &str) -> Result<LineRequest, Failure> {
        let faults = self.directory.faults(lang, FaultsOf::Line, text)?;
        Ok(LineRequest(LineOrder::Faults(FaultTarget::Line, faults)))
    }

    /// Ends faults of the line: all, or those with this specification or name.
    pub fn clear_faults(which: Option<&str>) -> LineRequest {
        LineRequest(match which {
            Some(words) => LineOrder::ClearSome(FaultTarget::Line, words.to_owned()),
            None => LineOrder::Clear(FaultTarget::Line),
        })
    }

    /// Unplugs the adapter, or plugs it in.
    pub const fn plug(plugged: bool) -> LineRequest {
        LineRequest(LineOrder::Plug(plugged))
    }

    /// Carries out these actions in order, and returns the state of the line afterwards; `None` if
    /// it has ended.
    pub async fn order(&self, errands: Vec<LineRequest>) -> Option<SimLineInfo> {
        let (sender, answer) = oneshot::channel();
        let orders = errands
            .into_iter()
            .map(|LineRequest(order)| order)
            .collect();
        self.jobs.send(Job::Show(orders, sender)).await.ok()?;
        answer.await.ok()
    }

    /// The state of the line.
    pub async fn look(&self) -> Option<SimLineInfo> {
        self.order(Vec::new()).await
    }
}
