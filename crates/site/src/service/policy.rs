//! What becomes of outputs when something is lost or comes back.

use super::promises::{Key, Promise, Why};
use super::timer::Timer;
use super::{Inner, Service, lock};
use crate::config::{Config, Place, Policy, Safety};
use railbus_store::audit::Origin;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;

/// When the site ends, its outputs have this time to be switched.
const EXIT_MAX: Duration = Duration::from_millis(1_200);

/// Outputs by their modules, and the state that each of them goes into.
type Wanted = BTreeMap<String, Vec<(Place, bool)>>;

impl Service {
    /// Outputs with a policy for the end of the site are switched.
    pub(super) async fn exit_policy(&self) {
        let service = self.on_behalf_of(Origin::program("on_exit"));
        let wanted = self.inner.wanted(None, |safety| safety.on_exit);
        let each = wanted.into_iter().map(|(module, outputs)| {
            let service = service.clone();
            tokio::spawn(async move { service.switch_at_exit(&module, &outputs).await })
        });
        let each: Vec<_> = each.collect();
        let switching = async {
            for module in each {
                // Fails only where the runtime itself ends.
                let _ = module.await;
            }
        };
        // What is not done by then, is told by its audit entry.
        let _ = tokio::time::timeout(EXIT_MAX, switching).await;
    }

    async fn switch_at_exit(&self, module: &str, outputs: &[(Place, bool)]) {
        let points = |wanted: bool| {
            let these = outputs.iter().filter(move |(_, on)| *on == wanted);
            these.map(|(place, on)| (place.point, *on))
        };
        let off: Vec<_> = points(false).collect();
        if !off.is_empty() {
            // How it ended, its audit entry says.
            let _ = self.write_at_exit(module, &off).await;
        }
        for on in points(true) {
            // One by one: what excludes one of them does not keep the others.
            let _ = self.write_at_exit(module, &[on]).await;
        }
    }
}

/// What a policy wants of an output.
fn state(config: &Config, place: &Place, policy: impl Fn(&Safety) -> Policy) -> Option<bool> {
    let point = config.modules.get(&place.module)?.points.get(&place.point);
    let point = point.filter(|point| !point.locked)?;
    policy(&point.safety).state()
}

impl Inner {
    /// What a policy wants of outputs, of one module or of all.
    fn wanted(&self, of: Option<&str>, policy: impl Fn(&Safety) -> Policy) -> Wanted {
        let state_of = |config: &Config, place: &Place| state(config, place, &policy);
        let known = lock(&self.state);
        let config = known.site.config();
        let mut wanted = Wanted::new();
        for (module, described) in &config.modules {
            if of.is_some_and(|of| of != module) {
                continue;
            }
            for point in described.points.keys() {
                let place = Place::new(module, *point);
                if let Some(on) = state_of(config, &place) {
                    wanted.entry(module.clone()).or_default().push((place, on));
                }
            }
        }
        wanted
    }

    /// What the policy for the return of its module wants of an output now.
    pub(super) fn policy(&self, place: &Place) -> Option<bool> {
        let known = lock(&self.state);
        state(known.site.config(), place, |safety| safety.on_return)
    }

    /// Whether what keeps an output from going on is about to go off by the same policy. Where
    /// somebody wants it on, nothing waits for it to be switched off.
    pub(super) fn comes_free(&self, (place, why): &Key) -> bool {
        let excluded = {
            let known = lock(&self.state);
            let safety = known.site.config().safety(place);
            safety.map_or_else(Vec::new, |safety| {
                safety.interlock.iter().cloned().collect()
            })
        };
        let goes_off = |other: Place| {
            let found = self.schedule.find(&(other, *why));
            found.is_some_and(|(_, promise)| promise.end == Some(false))
        };
        excluded.into_iter().any(goes_off)
    }

    /// A module is heard again: its outputs go where their policies say, what goes off first.
    /// What fails is tried again until it is done, or somebody else commands the output.
    pub(super) fn returned(self: &Arc<Inner>, module: String) {
        let inner = Arc::clone(self);
        tokio::spawn(async move {
            let wanted = inner.wanted(Some(&module), |safety| safety.on_return);
            let outputs: Vec<_> = wanted.into_values().flatten().collect();
            for wanted in [false, true] {
                let these = outputs.iter().filter(|(_, on)| *on == wanted);
                let begun = these.map(|(place, on)| inner.begin_policy(place, *on));
                for tried in begun.collect::<Vec<_>>() {
                    // It is closed, then.
                    let _ = tried.await;
                }
            }
        });
    }

    fn begin_policy(self: &Arc<Inner>, place: &Place, on: bool) -> oneshot::Receiver<()> {
        let (tell, tried) = oneshot::channel();
        let (inner, key) = (Arc::clone(self), (place.clone(), Why::OnReturn));
        tokio::spawn(async move {
            // Those who asked before come before it, and take nothing from it.
            let turn = inner.turn_to_end([key.0.clone()]).await;
            let promise = Promise::after(Duration::ZERO, Some(on));
            let timer = Timer::new(&inner, key, promise).at_once(turn, tell);
            timer.promised().await;
        });
        tried
    }
}
