//! Running rules: changes are passed to their engines, whose actions are carried out.

mod acts;
mod status;

pub use status::RuleStatus;

use super::{Inner, Service, Update, Updates, lock};
use crate::config::{Place, Rule, When};
use crate::rights::Who;
use crate::rules::{Deadline, Engine, Fact, Moment, Output, Phase, Tried, try_against};
use crate::{Failure, Quality, Value};
use jiff::tz::TimeZone;
use railbus_host::{LineState, PortError, Presence};
use railbus_store::history::{HistoryError, Severity, millis};
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, SystemTime};
use tokio::sync::Notify;
use tokio::time::Instant;

/// A clock can be set while one waits for it.
const CLOCK_MAX: Duration = Duration::from_secs(30);
/// How many rules are remembered as tried: more than a site has.
const TRIED_MAX: usize = 128;

/// All rules of a site.
#[derive(Default)]
pub(super) struct Standings {
    all: Mutex<BTreeMap<String, Standing>>,
    /// Those that were tried against the past, the newest last.
    tried: Mutex<VecDeque<Rule>>,
    /// Somebody carries them out.
    at_work: AtomicBool,
    /// They are to be looked at anew.
    again: Arc<Notify>,
}

/// A rule as it stands.
struct Standing {
    rule: Rule,
    /// None where it is not armed.
    engine: Option<Engine>,
    is_known: bool,
    /// An action of it is still in progress.
    busy: Arc<AtomicBool>,
    last: Option<i64>,
    count: u64,
}

/// What comes of a look at the rules.
#[derive(Default)]
struct Due {
    acts: Vec<(String, Rule, Arc<AtomicBool>)>,
    stopped: Vec<String>,
}

impl Service {
    /// From now on the armed rules of the configuration act. To be called inside the runtime;
    /// once is enough.
    pub fn run_rules(&self) {
        if self.inner.rules.at_work.swap(true, Ordering::Relaxed) {
            return;
        }
        tokio::spawn(run(Arc::downgrade(&self.inner), self.subscribe()));
    }

    /// All rules, by name.
    #[must_use]
    pub fn rules(&self) -> Vec<RuleStatus> {
        self.sync();
        let now = self.inner.moment();
        let config = self.config();
        let all = lock(&self.inner.rules.all);
        let rules = config.rules.iter();
        rules
            .map(|(id, rule)| {
                let is_tried = self.is_tried(rule);
                let standing = all.get(id);
                RuleStatus::of(id.clone(), rule.clone(), is_tried, standing, now)
            })
            .collect()
    }

    /// Says when a rule would have acted, from one moment to another, both in milliseconds since
    /// 1970. From then on it counts as tried.
    ///
    /// # Errors
    /// [`HistoryError`]; [`HistoryError::Closed`] where none is kept.
    pub async fn try_rule(&self, rule: &Rule, span: (i64, i64)) -> Result<Tried, HistoryError> {
        let history = self.history().ok_or(HistoryError::Closed)?;
        let tried = try_against(history, &self.config(), rule, span).await?;
        let mut known = lock(&self.inner.rules.tried);
        known.retain(|other| !other.acts_as(rule));
        if known.len() >= TRIED_MAX {
            known.pop_front();
        }
        known.push_back(rule.clone());
        Ok(tried)
    }

    /// Whether a rule that acts just so was tried since the program began.
    #[must_use]
    pub fn is_tried(&self, rule: &Rule) -> bool {
        let known = lock(&self.inner.rules.tried);
        known.iter().any(|other| other.acts_as(rule))
    }

    /// A rule that was stopped begins anew.
    ///
    /// # Errors
    /// [`Failure::RoleTooLow`], [`Failure::Limited`].
    pub fn begin_rule_anew(&self, id: &str) -> Result<(), Failure> {
        self.who.rights.may_change_site()?;
        self.sync();
        if let Some(standing) = lock(&self.inner.rules.all).get_mut(id)
            && let Some(engine) = &mut standing.engine
            && engine.phase() == Phase::Stopped
        {
            *engine = Engine::new(&standing.rule, TimeZone::system());
            standing.is_known = false;
        }
        self.inner.rules.again.notify_one();
        Ok(())
    }

    /// The rules are those of the configuration. One that acts as before goes on where it is.
    fn sync(&self) {
        if !self.inner.rules.at_work.load(Ordering::Relaxed) {
            return;
        }
        let config = self.config();
        let mut all = lock(&self.inner.rules.all);
        let mut before = std::mem::take(&mut *all);
        for (id, rule) in &config.rules {
            let known = before.remove(id);
            let known = known.unwrap_or_else(|| Standing::new(rule.clone()));
            all.insert(id.clone(), known.with(rule.clone()));
        }
    }

    /// Tells the rules what changed, or that time has passed; says until when there is nothing
    /// more to do.
    fn turn(&self, update: Option<&Update>) -> Option<Instant> {
        if matches!(update, Some(Update::Reloaded | Update::Gap(_))) {
            self.sync();
        }
        let (mut due, mut wake) = (Due::default(), None);
        for (id, standing) in lock(&self.inner.rules.all).iter_mut() {
            let next = self.step(id, standing, update, &mut due);
            wake = [wake, next].into_iter().flatten().min();
        }
        for id in due.stopped {
            self.told(&id, Severity::Error, "rule_stopped", |event| event);
        }
        for (id, rule, busy) in due.acts {
            tokio::spawn(self.acting(&id).act(id, rule, busy));
        }
        wake
    }

    fn step(
        &self,
        id: &str,
        standing: &mut Standing,
        update: Option<&Update>,
        due: &mut Due,
    ) -> Option<Instant> {
        let now = self.inner.moment();
        let phase = standing.engine.as_ref()?.phase();
        let is_holding = matches!(phase, Phase::Holding(_));
        let looks = match update {
            Some(Update::Point(change)) => {
                let place = standing.rule.when.place();
                let is_it = place.is_some_and(|place| {
                    place.point == change.point && place.module == change.module
                });
                if is_it {
                    // What it became counts, however it is by now.
                    standing.learn(now, fact_of(change.value));
                    standing.drain(id, now, due);
                }
                is_it
            }
            // What was missed may have been anything.
            Some(Update::Gap(_)) => {
                standing.learn(now, Fact::Unknown);
                true
            }
            Some(Update::Quality(place)) => standing.rule.when.place() == Some(place),
            Some(_) => true,
            // The time of a rule may come in the moment in which its value becomes stale.
            None => is_holding || !standing.is_known,
        };
        if looks && !standing.rule.when.is_clock() {
            standing.learn(now, self.look(&standing.rule.when));
        }
        let deadline = standing.drain(id, now, due);
        deadline.map(|deadline| wake(now, deadline))
    }

    /// What is known now of what a rule waits for.
    fn look(&self, when: &When) -> Fact {
        match when {
            When::Switch(place, _) | When::Analog(place, _) => self.look_at(place),
            When::ModuleOffline(module) => {
                let config = self.config();
                let line = config.modules.get(module).map(|module| &module.line);
                let down = line.map_or(Fact::Unknown, |line| self.is_down(line));
                let presence = self.inner.read(|state| state.site.presence(module));
                match (down, presence) {
                    (Fact::Is(false), Presence::Online) => Fact::Is(false),
                    (Fact::Is(false), Presence::Silent | Presence::OtherModel) => Fact::Is(true),
                    (Fact::Is(false), Presence::Unheard) => Fact::Unknown,
                    (down, _) => down,
                }
            }
            When::LineOffline(line) => self.is_down(line),
            When::Clock(_) => Fact::Unknown,
        }
    }

    fn look_at(&self, place: &Place) -> Fact {
        let status = self.point(&place.module, place.point);
        match status.map(|status| (status.quality, status.value)) {
            Some((Quality::Good, Some(value))) => fact_of(value),
            _ => Fact::Unknown,
        }
    }

    /// Whether a line has no port; not known while it is lent, or being opened.
    fn is_down(&self, line: &str) -> Fact {
        match self.line(line).map(|status| status.state) {
            Some(LineState::Up) => Fact::Is(false),
            Some(LineState::Absent(why)) if !matches!(*why, PortError::Exclusive) => Fact::Is(true),
            _ => Fact::Unknown,
        }
    }
}

/// Carries the rules out until the site has gone.
async fn run(site: Weak<Inner>, mut updates: Updates) {
    let who = Who::program("rules");
    let mut update = Some(Update::Reloaded);
    loop {
        let Some(inner) = site.upgrade() else {
            return;
        };
        if inner.read(|state| state.is_stopping()) {
            return;
        }
        let service = Service {
            inner,
            who: who.clone(),
        };
        let wake = service.turn(update.take().as_ref());
        let again = Arc::clone(&service.inner.rules.again);
        // Who waits here does not keep the site from ending.
        drop(service);
        update = tokio::select! {
            biased;
            next = updates.next() => match next {
                Some(update) => Some(update),
                None => return,
            },
            () = again.notified() => None,
            () = sleep_until(wake) => None,
        };
    }
}

async fn sleep_until(wake: Option<Instant>) {
    match wake {
        Some(wake) => tokio::time::sleep_until(wake).await,
        None => std::future::pending().await,
    }
}

impl Inner {
    fn moment(&self) -> Moment {
        Moment {
            steady: self.now().site,
            wall: millis(SystemTime::now()),
        }
    }
}

impl Standing {
    fn new(rule: Rule) -> Standing {
        Standing {
            rule,
            engine: None,
            is_known: false,
            busy: Arc::default(),
            last: None,
            count: 0,
        }
    }

    /// The same by what the configuration says now.
    fn with(mut self, rule: Rule) -> Standing {
        let goes_on = self.engine.is_some() && self.rule.acts_as(&rule);
        if !rule.armed {
            self.engine = None;
        } else if !goes_on {
            self.engine = Some(Engine::new(&rule, TimeZone::system()));
            self.is_known = rule.when.is_clock();
        }
        self.rule = rule;
        self
    }

    fn learn(&mut self, now: Moment, fact: Fact) {
        self.is_known = fact != Fact::Unknown;
        if let Some(engine) = &mut self.engine {
            engine.handle(now, fact);
        }
    }

    /// Takes what there is to do from the engine, until it waits.
    fn drain(&mut self, id: &str, now: Moment, due: &mut Due) -> Option<Deadline> {
        loop {
            match self.engine.as_mut()?.poll(now) {
                Output::Act => {
                    (self.last, self.count) = (Some(now.wall), self.count + 1);
                    let rule = self.rule.clone();
                    due.acts.push((id.to_owned(), rule, Arc::clone(&self.busy)));
                }
                Output::Stop => due.stopped.push(id.to_owned()),
                Output::Wait(deadline) => return deadline,
            }
        }
    }
}

/// When a rule is to be asked again.
fn wake(now: Moment, deadline: Deadline) -> Instant {
    let left = match deadline {
        Deadline::Steady(due) => Duration::from_micros((due - now.steady).0),
        Deadline::Wall(due) => {
            let left = u64::try_from(due - now.wall).unwrap_or_default();
            Duration::from_millis(left).min(CLOCK_MAX)
        }
    };
    Instant::now() + left
}

fn fact_of(value: Value) -> Fact {
    match value {
        Value::Bool(is) => Fact::Is(is),
        Value::Analog(value, _) => Fact::Value(value),
        Value::Number(number) => Fact::Value(f64::from(number)),
    }
}
