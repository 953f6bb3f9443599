//! The configuration of this site, where its centre may say a part of it: what comes is verified,
//! tried, and kept or taken back. What is decided is in [`railbus_fleet::trial`].
//!
//! It goes on while there is no connection: without a session a trial ends in taking back.

use super::asked::refusal;
use super::trial_files::TrialFiles;
use crate::clock::since_boot;
use crate::config::{NotApplied, RemoteConfig};
use crate::nats::next;
use crate::northbound::outlet::{Outlet, Report};
use crate::panics;
use async_nats::{Client, Subscriber};
use railbus_api::problem::{Problem, codes};
use railbus_fleet::desired::ConfigVerifier;
use railbus_fleet::message::{ConfigAnswer, ConfigDocument, ConfigPhaseKind, ConfigReport};
use railbus_fleet::trial::{
    ConfigText, ConfigTrial, TrialDone, TrialHealth, TrialInput, TrialOutput, TrialRefusal,
    part_hash,
};
use railbus_host::{LineState, PortError, Presence};
use railbus_site::Service;
use railbus_site::config::part::part_of;
use serde_json::Value;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Notify, mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::Instant;

/// How often it is looked how the site works, while that counts.
const LOOK: Duration = Duration::from_secs(1);
/// How often the newest document is read, whatever was heard: what is published is lost where a
/// connection is.
const READ_AGAIN: Duration = Duration::from_secs(300);
/// The same where it could not be read.
const READ_SOON: Duration = Duration::from_secs(30);
/// How long until something that could not be read is read again.
const RETRY: Duration = Duration::from_secs(5);
/// How many of the problems of a configuration are told.
const PROBLEMS_MAX: usize = 5;
/// How many documents wait.
const WAITING_MAX: usize = 16;

/// What is known of the configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
struct ManagedView {
    /// How far it is.
    report: ConfigReport,
    /// What the file says that the centre may say.
    part: Arc<str>,
}

/// A task that ends with this.
#[derive(Debug)]
pub(super) struct Following(JoinHandle<()>);

impl Drop for Following {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Takes configurations of the centre until it is dropped.
pub(super) struct Managed {
    verifier: Arc<ConfigVerifier>,
    wanted: mpsc::Sender<ConfigDocument>,
    session: watch::Sender<bool>,
    /// None until the file was read.
    view: watch::Receiver<Option<ManagedView>>,
    outlet: Report,
    task: JoinHandle<()>,
    /// Ends it once it has nothing under way.
    over: Arc<Notify>,
}

/// [`Managed::end`] is gentler.
impl Drop for Managed {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Managed {
    /// Of this outlet; none if it has no key of a centre.
    ///
    /// # Errors
    /// That is no key. Settings are checked before.
    pub(super) fn start(outlet: &Outlet) -> Result<Option<Managed>, Problem> {
        let key = outlet.text(super::settings::CONFIG_KEY);
        if key.is_empty() {
            return Ok(None);
        }
        let verifier = ConfigVerifier::new(&key).map_err(|error| untrusted(&error))?;
        let (wanted, asked) = mpsc::channel(WAITING_MAX);
        let (session, has_session) = watch::channel(false);
        let (told, view) = watch::channel(None);
        let over = Arc::new(Notify::new());
        let task = ManagedTask {
            name: outlet.name.clone(),
            config: outlet.config.clone(),
            files: TrialFiles::new(&outlet.folder, &outlet.name),
            service: outlet.service.clone(),
            report: outlet.report.clone(),
            wanted: asked,
            session: has_session,
            told,
            over: Arc::clone(&over),
            key,
        };
        let task = tokio::spawn(task.run());
        Ok(Some(Managed {
            verifier: Arc::new(verifier),
            wanted,
            session,
            view,
            outlet: outlet.report.clone(),
            task,
            over,
        }))
    }

    /// Waits a while until a trial that was left is taken back, and ends it.
    pub(super) async fn settle(mut self, within: Duration) {
        let is_over = |view: &Option<ManagedView>| {
            let phase = view.as_ref().map(|view| view.report.phase());
            phase.is_some_and(|phase| phase != ConfigPhaseKind::Trying)
        };
        let _ = tokio::time::timeout(within, self.view.wait_for(is_over)).await;
        self.end(within).await;
    }

    /// Ends it between two steps, and takes back what is tried: what is under way on the disk is
    /// not to meet what the next run does there.
    pub(super) async fn end(mut self, within: Duration) {
        self.over.notify_one();
        let _ = tokio::time::timeout(within, &mut self.task).await;
    }

    /// How far the configuration is; in no known phase until what is recorded could be read.
    pub(super) fn report(&self) -> ConfigReport {
        let view = self.view.borrow();
        view.as_ref().map_or_else(
            || ConfigReport {
                reason: "what is recorded of it is not read yet".to_owned(),
                ..ConfigReport::default()
            },
            |view| view.report.clone(),
        )
    }

    /// Whether there is a session with the centre.
    pub(super) fn set_session(&self, is_there: bool) {
        self.session
            .send_if_modified(|was| std::mem::replace(was, is_there) != is_there);
    }

    /// Takes what the centre wants of this site, as long as this connection lasts.
    pub(super) fn follow(&self, client: &Client, site: &str) -> Following {
        let follower = DesiredFollower {
            client: client.clone(),
            site: site.to_owned(),
            verifier: Arc::clone(&self.verifier),
            wanted: self.wanted.clone(),
            report: self.outlet.clone(),
            untrusted: Vec::new(),
        };
        Following(tokio::spawn(follower.run()))
    }
}

/// Waits until there is something else to report; for ever, where nothing is taken from the centre.
/// Cancel-safe.
///
/// # Errors
/// Its task has ended: nothing is judged or taken back any more.
pub(super) async fn changed(managed: Option<&mut Managed>) -> Result<(), Problem> {
    match managed {
        Some(managed) => managed.view.changed().await.map_err(|_| {
            Problem::new(codes::INTERNAL).with("reason", "what takes configurations has ended")
        }),
        None => std::future::pending().await,
    }
}

/// Waits until its task has ended: why that is a failure. Cancel-safe.
pub(super) async fn ended(mut managed: Option<&mut Managed>) -> Problem {
    loop {
        if let Err(problem) = changed(managed.as_deref_mut()).await {
            return problem;
        }
    }
}

/// The answer where the centre asks for the configuration.
pub(super) fn told(managed: Option<&Managed>) -> ConfigAnswer {
    let view = managed.map(|managed| managed.view.borrow().clone());
    let why = match view {
        Some(Some(ManagedView { report, part })) => {
            return ConfigAnswer {
                refusal: None,
                text: part.to_string(),
                hash: report.hash,
            };
        }
        Some(None) => Problem::new(codes::CONFIG_FILE).with("reason", "it is not read yet"),
        None => Problem::new(codes::NOT_MANAGED),
    };
    ConfigAnswer {
        refusal: Some(refusal(&why)),
        ..ConfigAnswer::default()
    }
}

fn untrusted(reason: &dyn ToString) -> Problem {
    Problem::new(codes::CONFIG_UNTRUSTED).with("reason", reason.to_string())
}

/// Reads the documents of a site.
struct DesiredFollower {
    client: Client,
    site: String,
    verifier: Arc<ConfigVerifier>,
    wanted: mpsc::Sender<ConfigDocument>,
    report: Report,
    /// The last one that was not trusted.
    untrusted: Vec<u8>,
}

impl DesiredFollower {
    async fn run(mut self) {
        let subject = format!("rb.desired.{}.config", self.site);
        // Before the newest is read, so that none comes between.
        let Ok(mut published) = self.client.subscribe(subject.clone()).await else {
            return;
        };
        let get = format!("$JS.API.DIRECT.GET.DESIRED.{subject}");
        loop {
            let newest = self.client.request(get.clone(), Vec::new().into()).await;
            let again = match newest {
                // There is none.
                Ok(message) if message.status.is_some() => READ_AGAIN,
                Ok(message) => {
                    self.offer(&message.payload);
                    READ_AGAIN
                }
                Err(_) => READ_SOON,
            };
            let again = Instant::now() + again;
            while let Some(payload) = published_until(&mut published, again).await {
                let Some(payload) = payload else {
                    // The connection has ended.
                    return;
                };
                self.offer(&payload);
            }
        }
    }

    fn offer(&mut self, payload: &[u8]) {
        match self.verifier.open(&self.site, payload) {
            // If too many wait, the newest is read again later.
            Ok(document) => _ = self.wanted.try_send(document),
            Err(error) if self.untrusted != payload => {
                self.untrusted = payload.to_vec();
                self.report.noted(untrusted(&error), 1);
            }
            Err(_) => {}
        }
    }
}

/// What is published before this time: none then, and `Some(None)` at the end of the connection.
async fn published_until(published: &mut Subscriber, until: Instant) -> Option<Option<Vec<u8>>> {
    tokio::select! {
        message = next(published) => Some(message.map(|message| message.payload.to_vec())),
        () = tokio::time::sleep_until(until) => None,
    }
}

/// Drives the trial.
struct ManagedTask {
    name: String,
    config: RemoteConfig,
    files: TrialFiles,
    service: Service,
    report: Report,
    wanted: mpsc::Receiver<ConfigDocument>,
    session: watch::Receiver<bool>,
    told: watch::Sender<Option<ManagedView>>,
    over: Arc<Notify>,
    /// The key of the centre.
    key: String,
}

impl ManagedTask {
    async fn run(mut self) {
        let Some(mut trial) = self.begin().await else {
            return;
        };
        // The file has changed, and could not be read since.
        let mut is_unread = false;
        loop {
            if is_unread {
                is_unread = !self.read(&mut trial).await;
            }
            self.drive(&mut trial).await;
            let look = trial.needs_health().then_some(LOOK);
            let retry = is_unread.then_some(RETRY);
            let due = trial.deadline().map(|at| at.saturating_sub(since_boot()));
            let due = [look, retry, due].into_iter().flatten().min();
            let due = async {
                match due {
                    Some(wait) => tokio::time::sleep(wait).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                document = self.wanted.recv() => match document {
                    Some(document) => {
                        let wanted = TrialInput::Wanted(document.into());
                        trial.handle(since_boot(), wanted);
                    }
                    None => return,
                },
                changed = self.config.changed() => match changed {
                    Ok(()) => is_unread = true,
                    // The daemon is stopping.
                    Err(_) => return,
                },
                // A trial may wait for it.
                changed = self.session.changed() => {
                    if changed.is_err() {
                        return;
                    }
                }
                () = self.over.notified() => {
                    // The next start takes back what can't be now.
                    trial.handle(since_boot(), TrialInput::Leave);
                    self.drive(&mut trial).await;
                    return;
                }
                () = due => {}
            }
        }
    }

    /// Begins with what is on the disk, as soon as that can be read; none if it is to end before.
    async fn begin(&mut self) -> Option<ConfigTrial> {
        loop {
            let files = self.files.clone();
            let recorded = at_disk(move || Ok((files.managed()?, files.trial()?)));
            let found = async { Ok((recorded.await?, self.config.read().await?)) };
            match found.await {
                Ok(((managed, trial), text)) => {
                    let managed = managed.of(&self.key);
                    return Some(ConfigTrial::new(managed, config_text(text), trial));
                }
                Err(problem) => self.report.noted(problem, 1),
            }
            tokio::select! {
                () = self.over.notified() => return None,
                () = tokio::time::sleep(RETRY) => {}
            }
        }
    }

    /// Reads the file; whether it could be read.
    async fn read(&self, trial: &mut ConfigTrial) -> bool {
        match self.config.read().await {
            Ok(text) => {
                trial.handle(since_boot(), TrialInput::File(config_text(text)));
                true
            }
            Err(problem) => {
                self.report.noted(problem, 1);
                false
            }
        }
    }

    async fn drive(&mut self, trial: &mut ConfigTrial) {
        loop {
            trial.handle(since_boot(), TrialInput::Health(self.health()));
            let output = trial.poll(since_boot());
            self.tell(trial);
            let Some(output) = output else {
                return;
            };
            let done = self.carry_out(output, trial.user()).await;
            trial.handle(since_boot(), TrialInput::Done(done));
        }
    }

    /// How the site works now.
    fn health(&self) -> TrialHealth {
        let (lines, modules) = (self.service.lines(), self.service.modules());
        let up = lines.iter().filter(|line| line.state == LineState::Up);
        let lent = LineState::Absent(Arc::new(PortError::Exclusive));
        let lent = lines.iter().filter(|line| line.state == lent);
        let online = modules
            .iter()
            .filter(|module| module.presence == Presence::Online);
        TrialHealth {
            lines_up: up.map(|line| line.name.clone()).collect(),
            lines_lent: lent.map(|line| line.name.clone()).collect(),
            modules_online: online.map(|module| module.name.clone()).collect(),
            lines: lines.iter().map(|line| line.name.clone()).collect(),
            modules: modules.iter().map(|module| module.name.clone()).collect(),
            has_session: *self.session.borrow(),
            panics: panics::count(),
        }
    }

    async fn carry_out(&self, output: TrialOutput, user: &str) -> TrialDone {
        let files = self.files.clone();
        let stored = match output {
            TrialOutput::Check(before, part) => {
                let who = (&*self.name, user);
                return match self.config.check(who, before, part).await {
                    Ok(text) => TrialDone::Checked(config_text(text)),
                    Err(why) => not_applied(why),
                };
            }
            TrialOutput::Apply(from, to) => {
                let applied = self.config.apply((&self.name, user), (from, to)).await;
                return applied.map_or_else(not_applied, |_| TrialDone::Ok);
            }
            TrialOutput::TakeBack(from, to) => {
                let back = self.config.take_back(&self.name, (from, to)).await;
                return back.map_or_else(not_applied, |text| TrialDone::Back(config_text(text)));
            }
            TrialOutput::StoreTrial(record) => at_disk(move || files.store_trial(&record)).await,
            TrialOutput::StoreManaged(record) => {
                at_disk(move || files.store_managed(&record)).await
            }
            TrialOutput::RemoveTrial => at_disk(move || files.remove_trial()).await,
        };
        stored.map_or_else(
            |problem| TrialDone::Failed(reason(&problem)),
            |()| TrialDone::Ok,
        )
    }

    /// Tells the centre how far it is, and the site what was not kept.
    fn tell(&self, trial: &ConfigTrial) {
        let report = trial.report().shortened();
        let before = self.told.borrow().clone();
        if before
            .as_ref()
            .is_some_and(|before| before.report == report)
        {
            return;
        }
        // At a start, too: the centre is told the same.
        let was = before
            .as_ref()
            .map(|before| (before.report.phase, before.report.version));
        if was != Some((report.phase, report.version))
            && let Some(problem) = not_kept(&report)
        {
            self.report.noted(problem, 1);
        }
        let part = part_of(&trial.file().text).unwrap_or_default().into();
        self.told.send_replace(Some(ManagedView { report, part }));
    }
}

/// Why a version was not kept; none if none was.
fn not_kept(report: &ConfigReport) -> Option<Problem> {
    let kind = match report.phase() {
        ConfigPhaseKind::RolledBack => codes::CONFIG_TAKEN_BACK,
        ConfigPhaseKind::Refused | ConfigPhaseKind::Interrupted => codes::SITE_CONFIG_CHANGED,
        ConfigPhaseKind::Unspecified
        | ConfigPhaseKind::Unmanaged
        | ConfigPhaseKind::Current
        | ConfigPhaseKind::Pending
        | ConfigPhaseKind::Trying
        | ConfigPhaseKind::LocalChange => return None,
    };
    let said = serde_json::from_slice(&report.problem).ok();
    let other = || Problem::new(kind).with("reason", report.reason.clone());
    Some(said.unwrap_or_else(other))
}

/// A text that was read, or is to be written. One that is no TOML was written by hand: then the
/// whole of it is what the centre does not know.
fn config_text(text: String) -> ConfigText {
    let part = part_of(&text);
    let hash = part_hash(part.as_deref().unwrap_or(&text));
    ConfigText { text, hash }
}

fn not_applied(why: NotApplied) -> TrialDone {
    match why {
        NotApplied::Other(text) => TrialDone::Changed(config_text(text)),
        NotApplied::Failed(problem) => TrialDone::Failed(reason(&problem)),
        NotApplied::Refused(mut problem) => {
            // The first ones are enough, and a heartbeat is short.
            if let Some(Value::Array(all)) = problem.with.get_mut("problems") {
                all.truncate(PROBLEMS_MAX);
            }
            TrialDone::Refused(TrialRefusal {
                reason: reason(&problem),
                problem: serde_json::to_vec(&problem).unwrap_or_default(),
            })
        }
    }
}

/// A problem in one line.
fn reason(problem: &Problem) -> String {
    match problem.text("reason") {
        none if none.is_empty() => format!("{} {}", problem.code, problem.title),
        reason => format!("{} {}: {reason}", problem.code, problem.title),
    }
}

async fn at_disk<T: Send + 'static>(
    what: impl FnOnce() -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let done = tokio::task::spawn_blocking(what).await;
    done.map_err(|error| Problem::new(codes::INTERNAL).with("reason", error.to_string()))?
}
