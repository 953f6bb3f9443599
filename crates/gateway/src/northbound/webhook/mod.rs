//! Webhooks: who is told of events over HTTP, in the order in which they happened. All of them
//! work on a thread of their own, so that no handshake of TLS holds up a line, and each has a
//! queue of its own, so that none holds up another.

mod hook;
mod request;
mod routes;
mod schema;
mod secrets;
mod target;

pub(super) use schema::KIND;

use hook::Hook;
use hyper::body::Bytes;
use railbus_api::types::SCHEMA;
use railbus_app::api::past;
use railbus_site::{Config, Events, Service};
use railbus_store::history::{Event, EventKind, Severity};
use request::{Carrier, Failed, Parcel};
use secrets::Secrets;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::runtime::{Builder, Handle};
use tokio::sync::watch;
use tokio::task::AbortHandle;

/// At the end, what waits has this time to be delivered.
const LINGER: Duration = Duration::from_millis(500);
/// How often it is looked whether anything waits then.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// The end of the webhooks: wished for, and reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Open,
    Closing,
    Closed,
}

/// A webhook, what became of the events for it, and how many wait.
#[derive(Debug)]
pub(crate) struct HookFigures {
    pub(crate) name: String,
    pub(crate) results: [(&'static str, u64); 4],
    pub(crate) queue: usize,
}

/// The webhooks of a site.
pub(crate) struct Hooks {
    /// What the site is called.
    site: String,
    carrier: Carrier,
    secrets: Secrets,
    hooks: Mutex<BTreeMap<String, (Arc<Hook>, AbortHandle)>>,
    phase: watch::Sender<Phase>,
    /// Where they work.
    thread: Handle,
}

impl std::fmt::Debug for Hooks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hooks")
            .field("site", &self.site)
            .finish_non_exhaustive()
    }
}

impl Hooks {
    /// Begins to tell of these events. `changes` says when the configuration is another one.
    ///
    /// # Errors
    /// What the system says where it has no thread left.
    pub(crate) fn start(
        site: String,
        state: &Path,
        service: Service,
        events: Events,
        changes: watch::Receiver<u64>,
    ) -> std::io::Result<Arc<Hooks>> {
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let (secrets, why) = Secrets::open(state);
        if let Some(why) = why {
            let event = Event::new(EventKind::System, Severity::Error, "webhook_secrets_lost");
            service.tell_event(event.text(why.code));
        }
        let hooks = Arc::new(Hooks {
            site,
            carrier: Carrier::new(request::LIMIT),
            secrets,
            hooks: Mutex::default(),
            phase: watch::Sender::new(Phase::Open),
            thread: runtime.handle().clone(),
        });
        let follower = Arc::clone(&hooks);
        let thread = std::thread::Builder::new().name("webhooks".to_owned());
        thread.spawn(move || runtime.block_on(follower.follow(service, events, changes)))?;
        Ok(hooks)
    }

    fn all(&self) -> MutexGuard<'_, BTreeMap<String, (Arc<Hook>, AbortHandle)>> {
        self.hooks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A webhook that has been at work.
    fn find(&self, name: &str) -> Option<Arc<Hook>> {
        self.all().get(name).map(|(hook, _)| Arc::clone(hook))
    }

    /// Gives every event to whom it is for, until the end.
    async fn follow(
        self: Arc<Self>,
        service: Service,
        mut events: Events,
        mut changes: watch::Receiver<u64>,
    ) {
        let mut phase = self.phase.subscribe();
        let mut config = self.configure(&service);
        loop {
            tokio::select! {
                biased;
                // Fails where nobody can change it any more.
                Ok(()) = changes.changed() => config = self.configure(&service),
                event = events.next() => match event {
                    Some(event) => self.take(&config, event),
                    None => break,
                },
                _ = phase.wait_for(|phase| *phase != Phase::Open) => break,
            }
        }
        let _ = tokio::time::timeout(LINGER, self.emptied()).await;
        self.phase.send_replace(Phase::Closed);
    }

    fn take(&self, config: &Config, event: Result<Event, u64>) {
        let event = match event {
            Ok(event) if hook::is_own(&event) => return,
            Ok(event) => Arc::new(event),
            Err(count) => {
                return self.all().values().for_each(|(hook, _)| hook.missed(count));
            }
        };
        for (name, wish) in &config.webhooks {
            if config.tells(wish, &event)
                && let Some(hook) = self.find(name)
            {
                hook.push(Arc::clone(&event));
            }
        }
    }

    /// Has the webhooks of the configuration, and no others, at work.
    fn configure(self: &Arc<Self>, service: &Service) -> Arc<Config> {
        let config = service.config();
        self.carrier.trust_anew();
        let mut all = self.all();
        all.retain(|name, (_, task)| {
            let stays = config.webhooks.contains_key(name);
            if !stays {
                task.abort();
            }
            stays
        });
        for (name, wish) in &config.webhooks {
            match all.get(name) {
                Some((hook, _)) => hook.set(wish.clone()),
                None => {
                    let hook = Arc::new(Hook::new(name, wish.clone()));
                    let task = self.work(name.clone(), Arc::clone(&hook), service.clone());
                    all.insert(name.clone(), (hook, task));
                }
            }
        }
        config
    }

    /// Puts a webhook to work.
    fn work(self: &Arc<Self>, name: String, hook: Arc<Hook>, service: Service) -> AbortHandle {
        let hooks = Arc::clone(self);
        let tell = {
            let service = service.clone();
            move |event| service.tell_event(event)
        };
        let send = move |url, event: Arc<Event>| {
            let (hooks, name) = (Arc::clone(&hooks), name.clone());
            let allowed = service.config().allowed.webhooks.clone();
            async move { hooks.send((url, allowed), &name, &event).await }
        };
        self.thread.spawn(hook.work(send, tell)).abort_handle()
    }

    /// Sends an event once, to an address and beyond it only where the owner allows.
    async fn send(
        &self,
        (url, allowed): (String, Vec<String>),
        webhook: &str,
        event: &Event,
    ) -> Result<u16, Failed> {
        let told = past::of_event(event.clone());
        let body = json!({ "schema": SCHEMA, "site": self.site, "event": told });
        let parcel = Parcel {
            url,
            allowed,
            id: event.id.clone(),
            body: Bytes::from(body.to_string()),
            secret: self.secrets.of(webhook),
        };
        self.carrier.carry(&parcel).await
    }

    /// Waits until everything is delivered that does not fail.
    async fn emptied(&self) {
        let waits = |(hook, _): &(Arc<Hook>, AbortHandle)| {
            let (figures, waiting) = hook.figures();
            waiting > 0 && figures.in_a_row == 0
        };
        while self.all().values().any(waits) {
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }

    /// Ends them: what happened so far is told where that can be done at once.
    pub(crate) async fn close(&self) {
        let mut phase = self.phase.subscribe();
        self.phase.send_if_modified(|phase| {
            let is_open = *phase == Phase::Open;
            if is_open {
                *phase = Phase::Closing;
            }
            is_open
        });
        let closed = phase.wait_for(|phase| *phase == Phase::Closed);
        let _ = tokio::time::timeout(LINGER * 2, closed).await;
    }

    /// For `/metrics`.
    pub(crate) fn figures(&self) -> Vec<HookFigures> {
        let all = self.all();
        let each = all.iter().map(|(name, (hook, _))| {
            let (figures, queue) = hook.figures();
            HookFigures {
                name: name.clone(),
                results: [
                    ("ok", figures.delivered),
                    ("refused", figures.refused),
                    ("given_up", figures.given_up),
                    ("dropped", figures.dropped),
                ],
                queue,
            }
        });
        each.collect()
    }
}
