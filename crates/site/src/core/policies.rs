//! What happens to outputs when something is lost or comes back.

use super::context::Context;
use super::order::places;
use super::promises::{Key, Promise, Why};
use super::state::State;
use super::timers::Timer;
use super::within::TTL;
use super::write::WriteTerms;
use crate::config::{Config, Place, Policy, Safety};
use crate::rights::Who;
use railbus_device::Point;
use railbus_store::history::{Event, EventKind, Severity};
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// How long closing the site may take to switch its outputs.
pub(super) const EXIT_MAX: Micros = Micros::from_millis(1_200);

/// Outputs by their modules, and the state that each of them goes into.
type Wanted = BTreeMap<String, Vec<(Place, bool)>>;

impl Context {
    /// Outputs with a policy for the end of the site are switched, at the boards that have their
    /// names as this begins. [`State::tell_not_exited`] reports what is not done.
    pub(super) async fn exit_policy(&self) {
        let since = self.config();
        let wanted = self.with(|state| {
            let wanted = state.wanted(None, |safety| safety.on_exit);
            let places = wanted.values().flatten().map(|(place, _)| place.clone());
            state.exiting = places.collect();
            wanted
        });
        let switching = wanted.into_iter().map(|(module, outputs)| {
            let (context, since) = (self.clone(), Arc::clone(&since));
            self.begin(async move { context.switch_at_exit(&since, &module, &outputs).await })
        });
        self.all(switching.collect::<Vec<_>>()).await;
    }

    async fn switch_at_exit(&self, since: &Config, module: &str, outputs: &[(Place, bool)]) {
        // A reload may have opened its line just now.
        let is_opened = |state: &mut State| state.is_opened(module);
        self.wait_in(|state| &mut state.opening, is_opened).await;
        let points = |wanted: bool| {
            let these = outputs.iter().filter(move |(_, on)| *on == wanted);
            these.map(|(place, on)| (place.point, *on))
        };
        let off: Vec<_> = points(false).collect();
        if !off.is_empty() {
            self.write_at_exit(since, module, &off).await;
        }
        for on in points(true) {
            // One by one: what excludes one of them does not keep the others.
            self.write_at_exit(since, module, &[on]).await;
        }
    }

    /// Nobody is asked whether it is meant, and how many wait does not matter.
    async fn write_at_exit(&self, since: &Config, module: &str, set: &[(Point, bool)]) {
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        let turn = self.turn_to_end_since(since, module, &points);
        let Some(turn) = turn.await else {
            return;
        };
        let (who, terms) = (Who::program("on_exit"), WriteTerms::default());
        let expires = self.now() + TTL;
        let done = self.write_in_turn(&who, &turn, module, set, terms, expires);
        let Ok(done) = done.await else {
            return;
        };
        self.with(|state| {
            for place in places(module, &points) {
                state.exiting.remove(&place);
            }
        });
        // What the disk refuses is done once more, with the next start.
        let _ = self.take_over(module, &points, done).await;
    }

    /// A module answers again: its outputs are switched according to their policies, off before on.
    /// Failures are retried until it is done, or somebody else commands the output.
    pub(super) async fn returned(self, module: String) {
        let since = self.config();
        let wanted = self.with(|state| state.wanted(Some(&module), |safety| safety.on_return));
        let outputs: Vec<_> = wanted.into_values().flatten().collect();
        for wanted in [false, true] {
            let these = outputs.iter().filter(|(_, on)| *on == wanted);
            let begun = these.map(|(place, on)| self.begin_policy(&since, place, *on));
            self.all(begun.collect::<Vec<_>>()).await;
        }
    }

    fn begin_policy(
        &self,
        since: &Arc<Config>,
        place: &Place,
        on: bool,
    ) -> impl Future<Output = ()> + Send + use<> {
        let (tried, waits) = self.tried();
        let (context, key) = (self.clone(), (place.clone(), Why::OnReturn));
        let since = Arc::clone(since);
        self.spawn(async move {
            // Those who asked before come before it, and take nothing from it.
            let (module, points) = (&key.0.module, [key.0.point]);
            let turn = context.turn_to_end_since(&since, module, &points);
            let Some(turn) = turn.await else {
                // Another board has the name now, which has not returned.
                return;
            };
            let wall = context.with(|state| state.now.wall);
            let promise = Promise::after(wall, Duration::ZERO, Some(on));
            let timer = Timer::new(&context, key, promise).at_once(turn, tried);
            timer.promised().await;
        });
        waits
    }
}

/// What a policy wants of an output.
fn state_of(config: &Config, place: &Place, policy: impl Fn(&Safety) -> Policy) -> Option<bool> {
    let point = config.modules.get(&place.module)?.points.get(&place.point);
    let point = point.filter(|point| !point.locked)?;
    policy(&point.safety).state()
}

impl State {
    /// What a policy wants of outputs, of one module or of all.
    fn wanted(&self, of: Option<&str>, policy: impl Fn(&Safety) -> Policy) -> Wanted {
        let config = self.site.config();
        let mut wanted = Wanted::new();
        for (module, described) in &config.modules {
            if of.is_some_and(|of| of != module) {
                continue;
            }
            for point in described.points.keys() {
                let place = Place::new(module, *point);
                if let Some(on) = state_of(config, &place, &policy) {
                    wanted.entry(module.clone()).or_default().push((place, on));
                }
            }
        }
        wanted
    }

    /// Reports the outputs whose policy for the end of the site is not known to be done.
    pub(super) fn tell_not_exited(&mut self) {
        for place in std::mem::take(&mut self.exiting) {
            let label = self.label(&place.module, place.point);
            let event = Event::new(EventKind::System, Severity::Error, "on_exit_not_done");
            self.tell_event(event.module(&place.module).point(&label));
        }
    }

    /// What the policy for the return of its module wants of an output now.
    pub(super) fn policy(&self, place: &Place) -> Option<bool> {
        state_of(self.site.config(), place, |safety| safety.on_return)
    }

    /// Whether what keeps an output from going on is about to go off by the same policy. Where
    /// somebody wants it on, nothing waits for it to be switched off.
    pub(super) fn comes_free(&self, (place, why): &Key) -> bool {
        let safety = self.site.config().safety(place);
        let excluded = safety.into_iter().flat_map(|safety| &safety.interlock);
        let goes_off = |other: &Place| {
            let found = self.schedule.find(&(other.clone(), *why));
            found.is_some_and(|(_, promise)| promise.end == Some(false))
        };
        excluded.into_iter().any(goes_off)
    }
}
