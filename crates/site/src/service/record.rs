//! What is recorded: who wrote what, when a line or module came or went, and the values of every
//! point.

use super::{Follower, Inner, LineStatus, PointStatus, Service};
use crate::core::{Context, News, OpenAuditEntry, State};
use crate::rights::Who;
use crate::{CommandError, PointQuality, PointValue};
use railbus_device::Point;
use railbus_host::{LineState, Presence};
use railbus_store::audit::{AuditLog, End, Note, Origin};
use railbus_store::history::{Event, EventKind, History, Sample, SampleQuality, Severity, millis};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock, Weak};
use std::time::{Duration, SystemTime};
use tokio::sync::{broadcast, mpsc};
use tokio::time::Instant;

/// How many events wait for a listener before the oldest are dropped.
const EVENTS_MAX: usize = 256;
/// After the queue of the history was full, so long until what it did not take is tried again.
const AGAIN: Duration = Duration::from_secs(1);

/// Where events go.
#[derive(Debug)]
pub(super) struct Journal {
    ulids: railbus_store::Ulids,
    told: broadcast::Sender<Event>,
    history: OnceLock<History>,
}

impl Default for Journal {
    fn default() -> Journal {
        Journal {
            ulids: railbus_store::Ulids::default(),
            told: broadcast::Sender::new(EVENTS_MAX),
            history: OnceLock::new(),
        }
    }
}

/// A listener's end: what happens from now on.
#[derive(Debug)]
pub struct Events(broadcast::Receiver<Event>);

impl Events {
    /// The next event, or how many were missed before the next one; none once the site has gone.
    /// Can be dropped and called again without losing anything.
    pub async fn next(&mut self) -> Option<Result<Event, u64>> {
        match self.0.recv().await {
            Ok(event) => Some(Ok(event)),
            Err(broadcast::error::RecvError::Lagged(count)) => Some(Err(count)),
            Err(broadcast::error::RecvError::Closed) => None,
        }
    }
}

impl Service {
    /// From now on all samples and events are kept in this history. To be called inside the
    /// runtime; a site has one history, the first.
    pub fn keep_history(&self, history: History) {
        let journal = &self.inner.journal;
        if journal.history.set(history.clone()).is_err() {
            return;
        }
        let recorder = Recorder::new(Arc::downgrade(&self.inner), history.clone());
        tokio::spawn(recorder.run(self.follow(), history.notices()));
    }

    /// From now on nothing is written to a module that is not durable in this log before.
    pub fn keep_audit(&self, log: AuditLog) {
        self.inner.audit.keep(log);
    }

    /// The log that should be there can't be had: nothing is written to a module any more.
    pub fn miss_audit(&self) {
        self.inner.audit.miss();
    }

    /// The history, where one is kept.
    #[must_use]
    pub fn history(&self) -> Option<&History> {
        self.inner.journal.history.get()
    }

    /// The log of all that was done, where one is kept.
    #[must_use]
    pub fn audit_log(&self) -> Option<&AuditLog> {
        self.inner.audit.log()
    }

    /// Reports an event: to the history, and to all followers.
    pub fn tell_event(&self, event: Event) {
        self.inner.tell_event(event);
    }

    /// Tells which ends of pulses and leases an earlier run has promised that are not done any
    /// more: the names of their modules stand for other boards now, or for none. To be called
    /// once somebody listens; a reload tells its own.
    pub fn tell_dropped_ends(&self) {
        self.inner.change(State::tell_dropped_ends);
    }

    /// What happens from now on.
    #[must_use]
    pub fn follow_events(&self) -> Events {
        Events(self.inner.journal.told.subscribe())
    }

    /// Writes down that something is about to be done with a module that is no command to its
    /// outputs. It is durable when this returns.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::Limited`], [`CommandError::NotAudited`]: then
    /// it may not be done.
    pub async fn begin_work(&self, module: &str, what: String) -> Result<Work, CommandError> {
        self.who.rights.may_change_site()?;
        self.note_work(module, what).await
    }

    /// The same of work whose rights were asked.
    pub(super) async fn note_work(&self, module: &str, what: String) -> Result<Work, CommandError> {
        let origin = Origin::clone(&self.who.origin);
        let (module, note) = (module.to_owned(), Note { origin, what });
        let begin =
            |core: Context| async move { core.journal(module, None, note, String::new()).await };
        // There is none only where the procedure has broken down.
        let begun = self
            .ask(begin)
            .await
            .unwrap_or(Err(CommandError::NotAudited));
        Ok(Work {
            service: self.clone(),
            begun: begun?,
        })
    }

    /// For whom this handle acts.
    #[must_use]
    pub fn origin(&self) -> &Origin {
        &self.who.origin
    }
}

/// Something other than a command that was written down and is under way.
#[derive(Debug)]
pub struct Work {
    service: Service,
    begun: OpenAuditEntry,
}

impl Work {
    /// Its number in the audit log.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.begun.id
    }

    /// Writes down how it ended.
    pub async fn end(self, end: End) {
        let begun = self.begun;
        self.service
            .ask(|core| async move { core.journal_end(begun, end, String::new()) })
            .await;
    }
}

impl Inner {
    pub(super) fn tell_event(&self, mut event: Event) {
        if event.id.is_empty() {
            event.id = self.journal.ulids.next(event.at);
        }
        if let Some(history) = self.journal.history.get() {
            history.event(event.clone());
        }
        // Fails if there are no subscribers, which does not matter.
        let _ = self.journal.told.send(event);
    }
}

/// A value, where there is one, and how good it is.
type Graded = (Option<f64>, SampleQuality);

/// How a point is, and what of that is recorded.
#[derive(Debug)]
struct Recorded {
    path: Arc<str>,
    now: Graded,
    /// What the history has. It takes as bad what it does not know.
    kept: Graded,
    /// The time of that sample, in milliseconds since 1970.
    kept_at: i64,
}

/// Records the values of all points, and what becomes of lines and modules.
struct Recorder {
    site: Weak<Inner>,
    history: History,
    /// By module.
    points: BTreeMap<String, BTreeMap<Point, Recorded>>,
    presence: BTreeMap<String, Presence>,
    lines: BTreeMap<String, (LineState, bool)>,
    /// When what the history did not take is tried again.
    again: Option<Instant>,
}

impl Recorder {
    fn new(site: Weak<Inner>, history: History) -> Recorder {
        Recorder {
            site,
            history,
            points: BTreeMap::new(),
            presence: BTreeMap::new(),
            lines: BTreeMap::new(),
            again: None,
        }
    }

    fn site(&self) -> Option<Service> {
        Some(Service {
            inner: self.site.upgrade()?,
            who: Who::program("history"),
        })
    }

    /// Works until the site has gone.
    async fn run(mut self, mut follower: Follower, notices: Option<mpsc::Receiver<Event>>) {
        let mut notices = notices;
        let mut opened = self.history.opened();
        loop {
            let again = self.again;
            tokio::select! {
                biased;
                news = follower.next() => match (news, self.site()) {
                    (Some(news), Some(site)) => self.take(&site, &news),
                    _ => return,
                },
                notice = next_notice(&mut notices) => match self.site() {
                    Some(site) => site.tell_event(notice),
                    None => return,
                },
                Ok(()) = opened.changed() => {
                    self.forget();
                    self.record_all();
                }
                () = sleep_until(again) => self.record_all(),
            }
        }
    }

    fn take(&mut self, site: &Service, news: &News) {
        match news {
            // It may be that of another configuration.
            News::Picture(picture) => {
                self.modules_changed(site);
                let past = &site.config().past;
                self.history.keep(past.history);
                if let Some(log) = site.audit_log() {
                    log.require(past.audit_required);
                    log.keep(past.audit_bytes);
                }
                for status in &picture.points {
                    self.record(status, picture.at);
                }
            }
            News::Batch(batch) => {
                for status in &batch.lines {
                    self.line(site, status);
                }
                for status in &batch.modules {
                    self.module(site, &status.name);
                }
                for reading in &batch.points {
                    self.record(&reading.status, reading.at);
                }
            }
        }
    }

    /// Records how a point is, which was told at this time. A value that was read has the time of
    /// its reading, as everywhere else.
    fn record(&mut self, status: &PointStatus, told_at: SystemTime) {
        let Some(points) = self.points.get_mut(&status.module) else {
            return;
        };
        let known = points.entry(status.point).or_insert_with(|| Recorded {
            path: Arc::from(format!("{}.{}", status.module, status.label)),
            now: UNKNOWN,
            kept: UNKNOWN,
            kept_at: 0,
        });
        known.now = graded(status);
        let read_at = status.time.filter(|_| status.quality == PointQuality::Good);
        if !known.record(&self.history, read_at.unwrap_or(told_at), told_at) {
            self.again = Some(Instant::now() + AGAIN);
        }
    }

    /// The history knows nothing of any point.
    fn forget(&mut self) {
        let all = self.points.values_mut().flat_map(BTreeMap::values_mut);
        all.for_each(|point| point.kept = UNKNOWN);
    }

    /// Records what the history does not have, as of now.
    fn record_all(&mut self) {
        self.again = None;
        let now = SystemTime::now();
        for known in self.points.values_mut().flat_map(BTreeMap::values_mut) {
            if !known.record(&self.history, now, now) {
                self.again = Some(Instant::now() + AGAIN);
                return;
            }
        }
    }

    /// There are other modules; of those that are no more, nothing is known from now on.
    fn modules_changed(&mut self, site: &Service) {
        let mut before = std::mem::take(&mut self.points);
        for module in site.config().modules.keys() {
            let mut known = before.remove(module).unwrap_or_default();
            // Another model has other labels.
            let same =
                |point: &Point, known: &mut Recorded| *known.path == *path(site, module, *point);
            let others: BTreeMap<_, _> =
                known.extract_if(.., |at, known| !same(at, known)).collect();
            before.insert(module.clone(), others);
            self.points.insert(module.clone(), known);
        }
        let t = millis(SystemTime::now());
        for gone in before.into_values().flat_map(BTreeMap::into_values) {
            let (value, grade) = (None, SampleQuality::Bad);
            // Where there is no room for it, the last value seems to last.
            let _ = self.history.sample(gone.path, Sample { t, value, grade });
        }
        self.presence
            .retain(|name, _| self.points.contains_key(name));
        let config = site.config();
        self.lines.retain(|name, _| config.lines.contains_key(name));
    }

    /// A module is heard, or no longer.
    fn module(&mut self, site: &Service, name: &str) {
        let presence = site.inner.read(|state| state.site.presence(name));
        let before = self.presence.insert(name.to_owned(), presence);
        let (severity, code) = match (before.unwrap_or(Presence::Unheard), presence) {
            (Presence::Silent | Presence::OtherModel, Presence::Online) => {
                (Severity::Info, "module_online")
            }
            (Presence::Silent, Presence::Silent) | (Presence::OtherModel, Presence::OtherModel) => {
                return;
            }
            (_, Presence::Silent) => (Severity::Warning, "module_offline"),
            (_, Presence::OtherModel) => (Severity::Warning, "module_other_model"),
            // That it is there when the program begins is as it should be.
            _ => return,
        };
        let mut event = Event::new(EventKind::Module, severity, code).module(name);
        if let Some(status) = site.module(name) {
            event = event.line(&status.line);
            event.text = status.stranger;
        }
        site.tell_event(event);
    }

    /// A line's port was opened or lost, or a babble began or ended.
    fn line(&mut self, site: &Service, status: &LineStatus) {
        let name = &status.name;
        let now = (status.state.clone(), status.babble);
        let before = self.lines.insert(name.clone(), now.clone());
        let (state_before, babble_before) = before.unwrap_or((LineState::Opening, false));
        let tell = |severity, code: &str, text: Option<String>| {
            let mut event = Event::new(EventKind::Line, severity, code).line(name);
            event.text = text;
            site.tell_event(event);
        };
        let (state, babble) = now;
        if state != state_before {
            match state {
                LineState::Up => tell(Severity::Info, "line_up", None),
                LineState::Absent(why) => {
                    tell(Severity::Warning, "line_down", Some(why.name().to_owned()));
                }
                LineState::Opening | LineState::Closed => {}
            }
        }
        match (babble_before, babble) {
            (false, true) => tell(Severity::Warning, "line_babble", None),
            (true, false) => tell(Severity::Info, "line_quiet", None),
            _ => {}
        }
    }
}

impl Recorded {
    /// False where the history does not take it.
    fn record(&mut self, history: &History, since: SystemTime, told_at: SystemTime) -> bool {
        if self.now == self.kept {
            return true;
        }
        let (value, grade) = self.now;
        let mut t = millis(since);
        // A value can become stale after the request began that reads it anew, and everything be
        // recorded before a change of that moment is told: the sample that comes later must not lie
        // before the one that is there. After a clock was set back it may.
        if t < self.kept_at && self.kept_at <= millis(told_at) + TOLD_LATE_MAX {
            t = self.kept_at;
        }
        let is_taken = history.sample(Arc::clone(&self.path), Sample { t, value, grade });
        if is_taken {
            (self.kept, self.kept_at) = (self.now, t);
        }
        is_taken
    }
}

/// How much later than it was a change is told at most, in milliseconds.
const TOLD_LATE_MAX: i64 = 5_000;

/// What the history takes a point for of which it knows nothing.
const UNKNOWN: Graded = (None, SampleQuality::Bad);

fn graded(status: &PointStatus) -> Graded {
    let value = status.value.map(number);
    match status.quality {
        PointQuality::Good => (value, SampleQuality::Good),
        PointQuality::Stale => (value, SampleQuality::Stale),
        PointQuality::Bad(_) => UNKNOWN,
    }
}

async fn sleep_until(at: Option<Instant>) {
    match at {
        Some(at) => tokio::time::sleep_until(at).await,
        None => std::future::pending().await,
    }
}

/// What a point is called in the history.
fn path(site: &Service, module: &str, point: Point) -> String {
    format!(
        "{module}.{}",
        site.inner.read(|state| state.label(module, point))
    )
}

/// What the history itself has to tell; never, where somebody else was told already.
async fn next_notice(notices: &mut Option<mpsc::Receiver<Event>>) -> Event {
    if let Some(listening) = notices {
        if let Some(event) = listening.recv().await {
            return event;
        }
        *notices = None;
    }
    std::future::pending().await
}

fn number(value: PointValue) -> f64 {
    match value {
        PointValue::Bool(on) => f64::from(u8::from(on)),
        PointValue::Analog(value, _) => value,
        PointValue::Number(number) => f64::from(number),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use railbus_device::PointKind;
    use railbus_store::history::{Chart, HistoryError, Keep};

    fn oven(model: &str) -> String {
        format!(
            "[line.main]\nport = \"/dev/railbus-test-nothing-here\"\n\
             [module.oven]\nline = \"main\"\nmodel = \"{model}\"\naddress = 3\n"
        )
    }

    #[tokio::test]
    async fn a_sample_has_the_time_of_its_reading_and_none_lies_before_an_earlier_one() {
        let unique = format!("railbus-record-times-{}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let history = History::open(&folder, Keep::default()).unwrap();
        let service = Service::start(Config::parse(&oven("erc8")).unwrap()).unwrap();
        let mut recorder = Recorder::new(Arc::downgrade(&service.inner), history.clone());
        recorder.take(&service, &service.follow().next().await.unwrap());
        let first = Point {
            kind: PointKind::Output,
            index: 0,
        };
        const BEGIN: u64 = 1_700_000_000_000;
        let at = |ms: u64| SystemTime::UNIX_EPOCH + Duration::from_millis(BEGIN + ms);
        let mut tell = |value: Option<bool>, quality, read_ms: u64, told_ms: u64| {
            let mut status = service.point("oven", first).unwrap();
            status.value = value.map(PointValue::Bool);
            (status.quality, status.time) = (quality, Some(at(read_ms)));
            recorder.record(&status, at(told_ms));
        };
        let (good, stale) = (PointQuality::Good, PointQuality::Stale);
        tell(Some(true), good, 10_100, 10_140);
        // Another end of a pulse: the same value, which was read again.
        tell(Some(true), good, 10_200, 10_230);
        tell(Some(true), stale, 10_200, 11_200);
        // Its request began before that.
        tell(Some(false), good, 11_190, 11_230);
        tell(Some(true), good, 11_300, 11_340);
        let offline = PointQuality::Bad(crate::BadReason::Offline);
        tell(Some(true), offline, 11_300, 12_000);
        // The clock was set back.
        tell(Some(true), good, 50, 90);
        let begin = i64::try_from(BEGIN).unwrap();
        let chart = history.chart("oven.k1", begin, begin + 15_000, 60).await;
        let Ok(Chart::Samples(samples)) = chart else {
            panic!("{chart:?}");
        };
        let told: Vec<_> = samples
            .iter()
            .map(|sample| (sample.t - begin, sample.value, sample.grade))
            .collect();
        assert_eq!(
            told,
            [
                (50, Some(1.0), SampleQuality::Good),
                (10_100, Some(1.0), SampleQuality::Good),
                (11_200, Some(0.0), SampleQuality::Good),
                (11_300, Some(1.0), SampleQuality::Good),
                (12_000, None, SampleQuality::Bad),
            ]
        );
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }

    /// Changes are told a moment after they were.
    #[tokio::test]
    async fn a_history_that_is_opened_again_has_a_change_of_that_moment_last() {
        let unique = format!("railbus-record-again-{}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let history = History::open(&folder, Keep::default()).unwrap();
        let service = Service::start(Config::parse(&oven("erc8")).unwrap()).unwrap();
        let mut recorder = Recorder::new(Arc::downgrade(&service.inner), history.clone());
        recorder.take(&service, &service.follow().next().await.unwrap());
        let first = Point {
            kind: PointKind::Output,
            index: 0,
        };
        let now = SystemTime::now();
        let tell = |recorder: &mut Recorder, on, at| {
            let mut status = service.point("oven", first).unwrap();
            (status.value, status.quality) = (Some(PointValue::Bool(on)), PointQuality::Good);
            status.time = Some(at);
            recorder.record(&status, at);
        };
        tell(&mut recorder, true, now - Duration::from_secs(5));
        recorder.forget();
        recorder.record_all();
        tell(&mut recorder, false, now - Duration::from_millis(30));
        let end = millis(now);
        let chart = history
            .chart("oven.k1", end - 10_000, end + 10_000, 60)
            .await;
        let Ok(Chart::Samples(samples)) = chart else {
            panic!("{chart:?}");
        };
        let values: Vec<_> = samples.iter().map(|sample| sample.value).collect();
        assert_eq!(values, [Some(1.0), Some(0.0)]);
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }

    #[tokio::test]
    async fn a_value_is_kept_under_the_label_that_its_point_has_now() {
        let unique = format!("railbus-record-{}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        let history = History::open(&folder, Keep::default()).unwrap();
        let service = Service::start(Config::parse(&oven("erc8")).unwrap()).unwrap();
        let mut recorder = Recorder::new(Arc::downgrade(&service.inner), history.clone());
        let mut follower = service.follow();
        recorder.take(&service, &follower.next().await.unwrap());
        let first = Point {
            kind: PointKind::Output,
            index: 0,
        };
        let read = |recorder: &mut Recorder, on| {
            let mut status = service.point("oven", first).unwrap();
            (status.value, status.quality) = (Some(PointValue::Bool(on)), PointQuality::Good);
            recorder.record(&status, SystemTime::now());
        };
        read(&mut recorder, true);
        // Two samples of one millisecond are one.
        tokio::time::sleep(Duration::from_millis(20)).await;
        service.reload(&oven("eda9060a")).await.unwrap();
        while !matches!(follower.next().await, Some(news @ News::Picture(_)) if {
            recorder.take(&service, &news);
            true
        }) {}
        read(&mut recorder, false);
        let now = millis(SystemTime::now());
        let values = async |path: &str| match history.chart(path, 0, now + 1_000, 60).await {
            Ok(Chart::Samples(samples)) => samples.iter().map(|sample| sample.value).collect(),
            Err(HistoryError::NoSuchPoint) => Vec::new(),
            other => panic!("{other:?}"),
        };
        assert_eq!(values("oven.k1").await, [Some(1.0), None]);
        assert_eq!(values("oven.do0").await, [Some(0.0)]);
        service.close().await;
        let _ = std::fs::remove_dir_all(folder);
    }
}
