//! The actions of rules, and their reports.

use super::super::Service;
use crate::config::{Action, Place, Rule};
use crate::{Failure, Pulse, Rights, WriteTerms};
use railbus_store::audit::Origin;
use railbus_store::history::{Event, EventKind, Severity};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

impl Service {
    /// A handle that acts for a rule.
    pub(super) fn acting(&self, id: &str) -> Service {
        self.on_behalf_of(Origin::program(&format!("rule:{id}")), Rights::all())
    }

    fn label(&self, place: &Place) -> String {
        self.inner
            .read(|state| state.label(&place.module, place.point))
    }

    /// Tells of a rule.
    pub(super) fn told(
        &self,
        id: &str,
        severity: Severity,
        code: &str,
        more: impl FnOnce(Event) -> Event,
    ) {
        let event = Event::new(EventKind::Rule, severity, code);
        let event = event.by(self.acting(id).origin());
        self.tell_event(more(event));
    }

    /// Carries out the actions of a rule. After an output that could not be switched no other is:
    /// later ones may rely on it. Notifications are sent all the same.
    pub(super) async fn act(self, id: String, rule: Rule, busy: Arc<AtomicBool>) {
        let about = |event: Event| match rule.when.place() {
            Some(place) => event.module(&place.module).point(&self.label(place)),
            None => event,
        };
        let what = rule.then.iter().map(|action| self.words(action));
        let what = what.collect::<Vec<_>>().join(", ");
        if busy.swap(true, Ordering::Relaxed) {
            self.told(&id, Severity::Error, "rule_failed", |event| {
                about(event).what(&what).text("busy")
            });
            return;
        }
        self.told(&id, Severity::Info, "rule_fired", |event| {
            about(event).what(&what)
        });
        let mut failed = None;
        for action in &rule.then {
            let end = match (action, &failed) {
                (Action::Notify(text), _) => {
                    self.told(&id, Severity::Warning, "notify", |event| {
                        about(event).text(text.clone())
                    });
                    Ok(())
                }
                (_, Some(_)) => Err(Failure::NotTried),
                (action, None) => self.switch(action).await,
            };
            if let Err(failure) = end {
                self.failed(&id, action, &failure);
                failed = Some(failure);
            }
        }
        busy.store(false, Ordering::Relaxed);
    }

    async fn switch(&self, action: &Action) -> Result<(), Failure> {
        match action {
            Action::Set(place, on) => {
                let set = [(place.point, *on)];
                let done = self.write(&place.module, &set, WriteTerms::default());
                done.await.map(|_| ())
            }
            Action::Pulse(place, width) => {
                let pulse = Pulse {
                    width: *width,
                    ..Pulse::default()
                };
                let done = self.pulse(&place.module, place.point, pulse);
                done.await.map(|_| ())
            }
            Action::Notify(_) => Ok(()),
        }
    }

    fn failed(&self, id: &str, action: &Action, failure: &Failure) {
        self.told(id, Severity::Error, "rule_failed", |mut event| {
            if let Action::Set(place, _) | Action::Pulse(place, _) = action {
                let label = self.label(place);
                event = event.module(&place.module).point(&label);
            }
            event.end = Some(failure.name().to_owned());
            event.what(&self.words(action)).text(failure.name())
        });
    }

    /// `pump.do0=off`, `pulse gate.do0 500ms`, `notify`.
    fn words(&self, action: &Action) -> String {
        let path = |place: &Place| format!("{}.{}", place.module, self.label(place));
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
}
