//! What passes on a line, frame by frame and in words. Nothing is sent for it, and while nobody
//! looks on nothing is done.

use super::{Gone, Out};
use crate::api::{ask, convert};
use crate::commands::sniff::{Facts, Named, as_json};
use crate::i18n::Lang;
use railbus_host::{Passed, Tap};
use railbus_site::{Service, Update};
use railbus_sniff::{Heard, Input, Listener, Output};
use railbus_wire::{Instant, Settings};
use serde_json::Value;
use std::time::Duration;
use tokio::time::sleep_until;

/// How many frames are told at once; more wait at the line, which drops the oldest.
const BATCH_MAX: usize = 64;

/// Follows a line through all its ports.
pub(super) async fn follow(
    service: Service,
    line: String,
    lang: Lang,
    mut out: Out,
) -> Result<(), Gone> {
    let mut updates = service.subscribe();
    out.snapshot(&[0; 0]).await?;
    loop {
        if let Ok((now, tap)) = service.tap(&line).await {
            let settings = service.line(&line).map(|status| status.serial);
            let mut ear = Ear::new(
                convert::start_of(now),
                settings.unwrap_or(Settings::FACTORY),
            );
            listen(&service, (&line, lang), tap, &mut ear, &mut out).await?;
        }
        // Its port is closed: it may be lent, or come back with another configuration.
        loop {
            match updates.next().await {
                None => return Ok(()),
                Some(Update::Line(name)) if name == line => break,
                Some(Update::Reloaded | Update::Gap(_)) => break,
                Some(_) => {}
            }
        }
    }
}

/// Until the line is closed.
async fn listen(
    service: &Service,
    (line, lang): (&str, Lang),
    mut tap: Tap,
    ear: &mut Ear,
    out: &mut Out,
) -> Result<(), Gone> {
    let mut heard = Vec::new();
    loop {
        let due = ear.hear(&mut heard);
        tokio::select! {
            biased;
            passed = tap.next(), if heard.len() < BATCH_MAX => match passed {
                None => return Ok(()),
                Some(Ok(passed)) => ear.take(&passed, &mut heard),
                Some(Err(count)) => {
                    out.dropped(count).await?;
                    out.snapshot(&[0; 0]).await?;
                }
            },
            () = out.paced(), if !heard.is_empty() => {
                let modules = modules(service, line);
                let records: Vec<Value> = heard
                    .drain(..)
                    .map(|heard| as_json(lang, line, &heard, &Facts::of(&heard, &modules)))
                    .collect();
                out.delta("frames", &records).await?;
            }
            () = until(ear, due) => ear.listener.handle(ear.now(), Input::Timeout),
        }
    }
}

/// The modules that frames may be of.
fn modules(service: &Service, line: &str) -> Vec<Named> {
    let modules = ask::modules(service).into_iter();
    let here = modules.filter(|module| module.line == line);
    here.filter_map(Named::of).collect()
}

async fn until(ear: &Ear, due: Option<Instant>) {
    match due {
        Some(due) => {
            let left = Duration::from_micros(due.since(ear.now()).0);
            sleep_until(tokio::time::Instant::now() + left).await;
        }
        None => std::future::pending().await,
    }
}

/// Finds the frames in what passes.
struct Ear {
    listener: Listener,
    settings: Settings,
    /// When the line's time began, in microseconds since 1970.
    start: u64,
    /// Its own time began then.
    began: tokio::time::Instant,
    at: u64,
}

impl Ear {
    fn new(start: u64, settings: Settings) -> Ear {
        let epoch = u64::try_from(jiff::Timestamp::now().as_microsecond());
        Ear {
            listener: Listener::new(settings),
            settings,
            start,
            began: tokio::time::Instant::now(),
            at: epoch.unwrap_or_default(),
        }
    }

    fn now(&self) -> Instant {
        let passed = u64::try_from(self.began.elapsed().as_micros()).unwrap_or_default();
        Instant(self.at.saturating_add(passed))
    }

    /// Takes out what was heard; says when it is due again.
    fn hear(&mut self, heard: &mut Vec<Heard>) -> Option<Instant> {
        loop {
            match self.listener.poll() {
                Output::Wait(due) => return due,
                Output::Heard(one) => heard.push(one),
            }
        }
    }

    /// What passed, after every timeout that fell due before it.
    fn take(&mut self, passed: &Passed, heard: &mut Vec<Heard>) {
        let at = Instant(self.start.saturating_add(passed.at.0));
        let time = self.settings.frame_time(passed.bytes.len());
        // What is sent is told when it is handed to the port, what is heard when it has ended.
        let (begins, ends) = match passed.sent {
            Some(settings) => (at, at + settings.frame_time(passed.bytes.len())),
            None => (Instant(at.0.saturating_sub(time.0)), at),
        };
        while let Some(due) = self.hear(heard)
            && due <= begins
        {
            self.listener.handle(due, Input::Timeout);
        }
        let input = match passed.sent {
            Some(_) => Input::Sent(&passed.bytes),
            None => Input::Bytes(&passed.bytes),
        };
        self.listener.handle(ends, input);
    }
}
