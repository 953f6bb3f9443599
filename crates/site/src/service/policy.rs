//! What becomes of outputs when something is lost or comes back.

use super::{Inner, Service, lock};
use crate::Origin;
use crate::config::{Place, Policy, Safety};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// When the site ends, its outputs have this time to be switched.
const EXIT_MAX: Duration = Duration::from_millis(1_200);

impl Service {
    /// Who commands this site over a network was lost: outputs with a policy for that are
    /// switched. Returns when each of them was, or could not be.
    pub async fn northbound_lost(&self) {
        let policy = |safety: &Safety| safety.on_offline.unwrap_or_default();
        self.apply(policy, "on_offline", None).await;
    }

    /// Outputs with a policy for the end of the site are switched.
    pub(super) async fn exit_policy(&self) {
        let switching = self.apply(|safety| safety.on_exit, "on_exit", None);
        // What is not done by then, is told by its audit entry.
        let _ = tokio::time::timeout(EXIT_MAX, switching).await;
    }

    /// Switches outputs, of one module or of all, as their policies say: module by module, what
    /// goes off first.
    async fn apply(&self, policy: impl Fn(&Safety) -> Policy, part: &str, of: Option<&str>) {
        let service = self.on_behalf_of(Origin::program(part));
        let wanted = self.inner.wanted(policy, of);
        let each = wanted.into_iter().map(|(module, outputs)| {
            let service = service.clone();
            tokio::spawn(async move { service.switch_all(&module, &outputs).await })
        });
        let each: Vec<_> = each.collect();
        for module in each {
            // Fails only where the runtime itself ends.
            let _ = module.await;
        }
    }

    async fn switch_all(&self, module: &str, outputs: &[(Place, bool)]) {
        let points = |wanted: bool| {
            let these = outputs.iter().filter(move |(_, on)| *on == wanted);
            these.map(|(place, on)| (place.point, *on))
        };
        let off: Vec<_> = points(false).collect();
        if !off.is_empty() {
            // How it ended, its audit entry says.
            let _ = self.write_by_policy(module, &off).await;
        }
        for on in points(true) {
            // One by one: what excludes one of them does not keep the others.
            let _ = self.write_by_policy(module, &[on]).await;
        }
    }
}

impl Inner {
    fn wanted(
        &self,
        policy: impl Fn(&Safety) -> Policy,
        of: Option<&str>,
    ) -> BTreeMap<String, Vec<(Place, bool)>> {
        let state = lock(&self.state);
        let mut wanted: BTreeMap<_, Vec<_>> = BTreeMap::new();
        for (module, config) in &state.site.config().modules {
            if of.is_some_and(|of| of != module) {
                continue;
            }
            for (point, config) in &config.points {
                if let (false, Some(on)) = (config.locked, policy(&config.safety).state()) {
                    let outputs = wanted.entry(module.clone()).or_default();
                    outputs.push((Place::new(module, *point), on));
                }
            }
        }
        wanted
    }

    /// A module is heard again.
    pub(super) fn returned(self: &Arc<Inner>, module: String) {
        if self
            .wanted(|safety| safety.on_return, Some(&module))
            .is_empty()
        {
            return;
        }
        let service = Service {
            inner: Arc::clone(self),
            origin: Arc::new(Origin::program("on_return")),
        };
        tokio::spawn(async move {
            let policy = |safety: &Safety| safety.on_return;
            service.apply(policy, "on_return", Some(&module)).await;
        });
    }
}
