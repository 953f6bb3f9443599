//! What happens to outputs when something is lost or comes back.

use super::context::Context;
use super::promises::{Key, Promise, Why};
use super::reload::same_board;
use super::state::State;
use super::timers::Timer;
use crate::config::{Config, Place, Policy, Safety};
use crate::rights::Who;
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// How long closing the site may take to switch its outputs.
const EXIT_MAX: Micros = Micros::from_millis(1_200);

/// Outputs by their modules, and the state that each of them goes into.
type Wanted = BTreeMap<String, Vec<(Place, bool)>>;

impl Context {
    /// Outputs with a policy for the end of the site are switched.
    pub(crate) async fn exit_policy(&self) {
        let who = Who::program("on_exit");
        let wanted = self.with(|state| state.wanted(None, |safety| safety.on_exit));
        let switching = wanted.into_iter().map(|(module, outputs)| {
            let (context, who) = (self.clone(), Who::clone(&who));
            self.begin(async move { context.switch_at_exit(&who, &module, &outputs).await })
        });
        let switching: Vec<_> = switching.collect();
        let until = self.now() + EXIT_MAX;
        // What is not done by then shows in its audit entry.
        let _ = self.until(until, self.all(switching)).await;
    }

    async fn switch_at_exit(&self, who: &Who, module: &str, outputs: &[(Place, bool)]) {
        let points = |wanted: bool| {
            let these = outputs.iter().filter(move |(_, on)| *on == wanted);
            these.map(|(place, on)| (place.point, *on))
        };
        let off: Vec<_> = points(false).collect();
        if !off.is_empty() {
            // How it ended, its audit entry says.
            let _ = self.write_at_exit(who, module, &off).await;
        }
        for on in points(true) {
            // One by one: what excludes one of them does not keep the others.
            let _ = self.write_at_exit(who, module, &[on]).await;
        }
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
            let turn = context.turn_to_end([key.0.clone()]).await;
            if !same_board(&since, &context.config(), &key.0.module) {
                // Another board has the name now, which has not returned.
                return;
            }
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
