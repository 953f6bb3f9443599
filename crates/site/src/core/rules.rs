//! Rules: their engines are asked at the end of each step that may have changed what they wait
//! for, and at their time. What a rule does is a procedure, as for any other caller.

use super::Now;
use super::context::Context;
use super::state::State;
use crate::config::{Action, Config, Place, Rule, When};
use crate::rights::Who;
use crate::rules::{Deadline, Fact, Moment, Output, Phase, RuleEngine};
use crate::service::{RuleStatus, Update};
use crate::{CommandError, PointQuality, PointValue, Pulse, WriteTerms};
use jiff::tz::TimeZone;
use railbus_host::{LineState, PortError, Presence};
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity, millis};
use railbus_wire::Micros;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// A clock can be set while one waits for it.
const CLOCK_MAX: Micros = Micros::from_secs(30);
/// How many rules are remembered as tried: more than a site has.
const TRIED_MAX: usize = 128;

/// All rules of a site.
#[derive(Debug, Default)]
pub(crate) struct RuleStates {
    /// Times of day are in this zone; none until the rules act.
    zone: Option<TimeZone>,
    all: BTreeMap<String, RuleNow>,
    /// When the first of them is asked again.
    next: Option<Micros>,
    /// How often rules have acted.
    fired: u64,
    /// Those that were tried against the past, the newest last.
    tried: VecDeque<Rule>,
}

/// A rule as it stands.
#[derive(Debug)]
pub(crate) struct RuleNow {
    rule: Rule,
    /// None where it is not armed.
    pub(crate) engine: Option<RuleEngine>,
    pub(crate) is_known: bool,
    /// When it is asked again, in the time of the site.
    wakes_at: Option<Micros>,
    /// The act that is in progress, by its number.
    acting: Option<u64>,
    pub(crate) last: Option<i64>,
    pub(crate) count: u64,
}

/// A rule acts.
pub(super) struct Firing {
    number: u64,
    id: String,
    rule: Rule,
    /// The configuration in which its condition came true.
    since: Arc<Config>,
}

/// A rule acts until this is dropped.
struct Acting {
    context: Context,
    number: u64,
    id: String,
}

impl Drop for Acting {
    fn drop(&mut self) {
        self.context.with(|state| {
            let now = state.rules.all.get_mut(&self.id);
            // Another one may have its name by now.
            if let Some(now) = now.filter(|now| now.acting == Some(self.number)) {
                now.acting = None;
            }
        });
    }
}

impl Now {
    pub(crate) fn moment(self) -> Moment {
        Moment {
            steady: self.site,
            wall: millis(self.wall),
        }
    }
}

impl RuleNow {
    fn new(rule: Rule) -> RuleNow {
        RuleNow {
            rule,
            engine: None,
            is_known: false,
            wakes_at: None,
            acting: None,
            last: None,
            count: 0,
        }
    }

    /// The same by what the configuration says now.
    fn with(mut self, rule: &Rule, zone: &TimeZone) -> RuleNow {
        let goes_on = self.engine.is_some() && self.rule.acts_as(rule);
        if !rule.armed {
            self.engine = None;
        } else if !goes_on {
            self.engine = Some(RuleEngine::new(rule, zone.clone()));
            self.is_known = rule.when.is_clock();
        }
        self.rule = rule.clone();
        self
    }

    /// Whether it may be about this.
    fn waits_for(&self, update: &Update) -> bool {
        match update {
            Update::Point(change) => {
                self.rule.when.place().is_some_and(|place| {
                    place.point == change.point && place.module == change.module
                })
            }
            Update::Quality(place) => self.rule.when.place() == Some(place),
            Update::Module(_) | Update::Line(_) | Update::Reloaded | Update::Gap(_) => true,
        }
    }
}

impl RuleStates {
    /// They act from now on, with times of day in this zone.
    pub(crate) fn start(&mut self, config: &Config, zone: TimeZone, now: Micros) {
        self.zone = Some(zone);
        self.follow(config, now);
    }

    /// Times of day of rules that begin later are in this zone.
    pub(crate) fn zone_is(&mut self, zone: TimeZone) {
        self.zone = self.zone.is_some().then_some(zone);
    }

    /// The rules are those of this configuration. One that acts as before goes on where it is.
    pub(super) fn follow(&mut self, config: &Config, now: Micros) {
        let Some(zone) = &self.zone else {
            return;
        };
        let mut before = std::mem::take(&mut self.all);
        for (id, rule) in &config.rules {
            let known = before.remove(id);
            let known = known.unwrap_or_else(|| RuleNow::new(rule.clone()));
            self.all.insert(id.clone(), known.with(rule, zone));
        }
        self.wake(now);
    }

    /// What the rules wait for may have become anything.
    pub(super) fn wake(&mut self, now: Micros) {
        self.wake_where(now, |_| true);
    }

    /// The same of those that this is about.
    pub(super) fn take(&mut self, update: &Update, now: Micros) {
        self.wake_where(now, |rule| rule.waits_for(update));
    }

    fn wake_where(&mut self, now: Micros, of: impl Fn(&RuleNow) -> bool) {
        let armed = self.all.values_mut().filter(|rule| rule.engine.is_some());
        for rule in armed.filter(|rule| of(rule)) {
            (rule.wakes_at, self.next) = (Some(now), Some(now));
        }
    }

    /// A rule that was stopped begins anew.
    pub(crate) fn begin_anew(&mut self, id: &str, now: Micros) {
        if let Some(rule) = self.all.get_mut(id)
            && let (Some(engine), Some(zone)) = (&mut rule.engine, &self.zone)
            && engine.phase() == Phase::Stopped
        {
            *engine = RuleEngine::new(&rule.rule, zone.clone());
            rule.is_known = false;
            (rule.wakes_at, self.next) = (Some(now), Some(now));
        }
    }

    /// A rule was tried against the past.
    pub(crate) fn tried(&mut self, rule: &Rule) {
        self.tried.retain(|other| !other.acts_as(rule));
        if self.tried.len() >= TRIED_MAX {
            self.tried.pop_front();
        }
        self.tried.push_back(rule.clone());
    }

    /// Whether a rule that acts just so was.
    pub(crate) fn is_tried(&self, rule: &Rule) -> bool {
        self.tried.iter().any(|other| other.acts_as(rule))
    }
}

impl State {
    /// When [`State::rules_due`] is to be called at the latest.
    pub(super) fn rules_deadline(&self) -> Option<Micros> {
        self.rules.next.filter(|_| !self.is_stopping())
    }

    /// All rules, by name.
    pub(crate) fn rules_now(&self) -> Vec<RuleStatus> {
        let now = self.now.moment();
        let rules = self.site.config().rules.iter();
        let status = rules.map(|(id, rule)| {
            let is_tried = self.rules.is_tried(rule);
            let standing = self.rules.all.get(id);
            RuleStatus::of(id.clone(), rule.clone(), is_tried, standing, now)
        });
        status.collect()
    }

    /// Asks the rules whose time has come, or whose condition may have changed by the step that
    /// ends; gives back those that act. Each of them acts once at most: a second must pass before
    /// it does again.
    pub(super) fn rules_due(&mut self) -> Vec<Firing> {
        let now = self.now;
        if self.rules_deadline().is_none_or(|next| next > now.site) {
            return Vec::new();
        }
        let mut rules = std::mem::take(&mut self.rules);
        let mut firings = Vec::new();
        for (id, rule) in &mut rules.all {
            if rule.wakes_at.is_some_and(|at| at <= now.site) && self.asks(id, rule) {
                rules.fired += 1;
                firings.extend(self.fires(id, rule, rules.fired));
            }
        }
        rules.next = rules.all.values().filter_map(|rule| rule.wakes_at).min();
        self.rules = rules;
        firings
    }

    /// Asks a rule; says whether it acts.
    fn asks(&mut self, id: &str, rule: &mut RuleNow) -> bool {
        rule.wakes_at = None;
        let Some(engine) = &mut rule.engine else {
            return false;
        };
        let now = self.now.moment();
        if !rule.rule.when.is_clock() {
            let fact = self.look(&rule.rule.when);
            rule.is_known = fact != Fact::Unknown;
            engine.handle(now, fact);
        }
        let mut acts = false;
        loop {
            match engine.poll(now) {
                Output::Act => acts = true,
                Output::Stop => {
                    self.tell_event(of_rule(id, Severity::Error, "rule_stopped"));
                }
                Output::Wait(deadline) => {
                    rule.wakes_at = deadline.map(|deadline| wakes_at(now, deadline));
                    return acts;
                }
            }
        }
    }

    /// Begins an act, unless the one before is still in progress.
    fn fires(&mut self, id: &str, rule: &mut RuleNow, number: u64) -> Option<Firing> {
        let is_busy = rule.acting.is_some();
        let (severity, code) = match is_busy {
            true => (Severity::Error, "rule_failed"),
            false => (Severity::Info, "rule_fired"),
        };
        let what = rule.rule.then.iter().map(|action| self.words(action));
        let what = what.collect::<Vec<_>>().join(", ");
        let event = self.about(&rule.rule, of_rule(id, severity, code).what(&what));
        if is_busy {
            self.tell_event(event.text("busy"));
            return None;
        }
        self.tell_event(event);
        rule.acting = Some(number);
        (rule.last, rule.count) = (Some(self.now.moment().wall), rule.count + 1);
        Some(Firing {
            number,
            id: id.to_owned(),
            rule: rule.rule.clone(),
            since: Arc::clone(self.site.config()),
        })
    }

    /// What is known now of what a rule waits for.
    fn look(&self, when: &When) -> Fact {
        match when {
            When::Switch(place, _) | When::Analog(place, _) => self.look_at(place),
            When::ModuleOffline(module) => {
                let described = self.site.config().modules.get(module);
                let down = described.map_or(Fact::Unknown, |module| self.is_down(&module.line));
                match (down, self.site.presence(module)) {
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
        let Some(module) = self.site.config().modules.get(&place.module) else {
            return Fact::Unknown;
        };
        let now = self.line_time(&place.module);
        // A command that was not read back interrupts no rule: what it switched is read soon.
        let (known, quality) = self.site.point_by_age(&place.module, place.point, now);
        match (known, quality, self.line_fault(&module.line)) {
            (Some(known), PointQuality::Good, None) => match known.value {
                PointValue::Bool(is) => Fact::Is(is),
                PointValue::Analog(value, _) => Fact::Value(value),
                PointValue::Number(number) => Fact::Value(f64::from(number)),
            },
            _ => Fact::Unknown,
        }
    }

    /// Whether a line has no port; not known while it is lent, or being opened.
    fn is_down(&self, line: &str) -> Fact {
        let line = self.lines.get(line).filter(|line| line.lent.is_none());
        match line.map(|line| &line.state) {
            Some(LineState::Up) => Fact::Is(false),
            Some(LineState::Absent(why)) if !matches!(**why, PortError::Exclusive) => {
                Fact::Is(true)
            }
            _ => Fact::Unknown,
        }
    }

    /// An event of the point that a rule waits for.
    fn about(&self, rule: &Rule, event: Event) -> Event {
        match rule.when.place() {
            Some(place) => {
                let label = self.label(&place.module, place.point);
                event.module(&place.module).point(&label)
            }
            None => event,
        }
    }

    /// `pump.do0=off`, `pulse gate.do0 500ms`, `notify`.
    fn words(&self, action: &Action) -> String {
        let path = |place: &Place| {
            let label = self.label(&place.module, place.point);
            format!("{}.{label}", place.module)
        };
        match action {
            Action::Set(place, true) => format!("{}=on", path(place)),
            Action::Set(place, false) => format!("{}=off", path(place)),
            Action::Pulse(place, None) => format!("pulse {}", path(place)),
            Action::Pulse(place, Some(width)) => {
                format!("pulse {} {}ms", path(place), width.0 / 1_000)
            }
            Action::Notify(_) => "notify".to_owned(),
        }
    }

    fn failed(&mut self, id: &str, action: &Action, failure: &CommandError) {
        let mut event = of_rule(id, Severity::Error, "rule_failed");
        if let Action::Set(place, _) | Action::Pulse(place, _) = action {
            let label = self.label(&place.module, place.point);
            event = event.module(&place.module).point(&label);
        }
        event.end = Some(failure.name().to_owned());
        let what = self.words(action);
        self.tell_event(event.what(&what).text(failure.name()));
    }
}

impl Context {
    /// Carries out the actions of a rule. After an output that could not be switched no other is:
    /// later ones may rely on it. Notifications are sent all the same.
    pub(super) async fn act(self, firing: Firing) {
        let Firing {
            number,
            id,
            rule,
            since,
        } = firing;
        let _acting = Acting {
            context: self.clone(),
            number,
            id: id.clone(),
        };
        let who = Who::program(&who(&id));
        let mut has_failed = false;
        for action in &rule.then {
            let end = match action {
                Action::Notify(text) => {
                    self.with(|state| {
                        let event = of_rule(&id, Severity::Warning, "notify").text(text.clone());
                        let event = state.about(&rule, event);
                        state.tell_event(event);
                    });
                    Ok(())
                }
                _ if has_failed => Err(CommandError::NotTried),
                Action::Set(Place { module, point }, on) => {
                    let (set, terms) = ([(*point, *on)], WriteTerms::default());
                    let terms = (terms, self.expires(terms.within));
                    let done = self.write_since(&since, &who, module, &set, terms);
                    done.await.map(drop)
                }
                Action::Pulse(Place { module, point }, width) => {
                    let pulse = Pulse {
                        width: *width,
                        ..Pulse::default()
                    };
                    let done = self.pulse_since(&since, &who, module, *point, pulse);
                    done.await.map(drop)
                }
            };
            if let Err(failure) = end {
                has_failed = true;
                self.with(|state| state.failed(&id, action, &failure));
            }
        }
    }
}

/// The name that a rule acts under.
fn who(id: &str) -> String {
    format!("rule:{id}")
}

fn of_rule(id: &str, severity: Severity, code: &str) -> Event {
    Event::new(EventKind::Rule, severity, code).by(&Origin::program(&who(id)))
}

/// When a rule is to be asked again, in the time of the site.
fn wakes_at(now: Moment, deadline: Deadline) -> Micros {
    match deadline {
        Deadline::Steady(due) => due,
        Deadline::Wall(due) => {
            let left = u64::try_from(due - now.wall).unwrap_or_default();
            now.steady + Micros(left.saturating_mul(1_000)).min(CLOCK_MAX)
        }
    }
}
