//! A part of the configuration that comes from elsewhere, by an outlet: a centre says it, and the
//! rest stays the site's own. It has the permissions of an engineer.
//!
//! Outlets run on threads of their own, without access to the daemon. They pass what they want to
//! it, and it does one thing after the other.

use super::super::access::{Caller, Known, Role};
use super::super::listen::ended;
use super::super::northbound;
use super::super::remote_api::shown_user;
use super::super::site::Site;
use super::{Asks, bring};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures::bad_config;
use railbus_site::Config;
use railbus_site::config::keeper::etag;
use railbus_site::config::part::{PartError, part_of, taken_back, with_part};
use railbus_words::Lang;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot, watch};

/// How many calls wait: each outlet waits for its own.
const CALLS_MAX: usize = 16;
/// What the text of a centre is called in what is wrong with it.
const NAME: &str = "config";

/// Why a text is not in force.
#[cfg_attr(
    not(feature = "fleet"),
    expect(dead_code, reason = "the other kinds have no centre")
)]
#[derive(Debug)]
pub(crate) enum NotApplied {
    /// It has this text, and not the one that was to be replaced.
    Other(String),
    /// The new text is not accepted, and nothing was changed.
    Refused(Problem),
    /// It may work later. The text may have been written.
    Failed(Problem),
}

/// What an outlet wants.
enum ConfigCall {
    Read(oneshot::Sender<Result<String, Problem>>),
    Check(PartCheck, oneshot::Sender<Result<String, NotApplied>>),
    Apply(PartChange, oneshot::Sender<Result<String, NotApplied>>),
}

/// A part that is to be checked.
struct PartCheck {
    who: Caller,
    /// The text of the file.
    before: String,
    part: String,
}

/// A text that is to be the file's.
struct PartChange {
    who: Caller,
    before: String,
    text: String,
    /// It was there before, and comes back whatever it says.
    is_back: bool,
}

/// The end of an outlet.
#[derive(Clone, Debug)]
pub(crate) struct RemoteConfig {
    calls: mpsc::Sender<ConfigCall>,
    changes: watch::Receiver<u64>,
}

/// The end of the daemon.
pub(crate) struct RemoteConfigCalls {
    calls: mpsc::Receiver<ConfigCall>,
    changes: watch::Sender<u64>,
}

/// Both ends.
pub(crate) fn remote_config() -> (RemoteConfig, RemoteConfigCalls) {
    let (calls, called) = mpsc::channel(CALLS_MAX);
    let (changed, changes) = watch::channel(0);
    let outlet = RemoteConfig { calls, changes };
    let daemon = RemoteConfigCalls {
        calls: called,
        changes: changed,
    };
    (outlet, daemon)
}

#[cfg_attr(
    not(feature = "fleet"),
    expect(dead_code, reason = "the other kinds have no centre")
)]
impl RemoteConfig {
    /// The text of the file.
    ///
    /// # Errors
    /// It can't be read, or the daemon is stopping.
    pub(crate) async fn read(&self) -> Result<String, Problem> {
        self.call(ConfigCall::Read).await?
    }

    /// Waits until the configuration is another one. Ends with the daemon.
    ///
    /// # Errors
    /// The daemon is stopping.
    pub(crate) async fn changed(&mut self) -> Result<(), Problem> {
        self.changes.changed().await.map_err(|_| stopping())
    }

    /// How this file would be with this part, wanted by this user of a centre behind the outlet of
    /// this name, and whether it would be accepted.
    ///
    /// # Errors
    /// It would not be.
    pub(crate) async fn check(
        &self,
        (outlet, user): (&str, &str),
        before: String,
        part: String,
    ) -> Result<String, NotApplied> {
        let who = caller(outlet, user);
        let check = PartCheck { who, before, part };
        let done = self.call(|to| ConfigCall::Check(check, to)).await;
        done.map_err(NotApplied::Failed)?
    }

    /// Replaces the text before by this one, and applies it. The file as it is then.
    ///
    /// # Errors
    /// [`NotApplied`].
    pub(crate) async fn apply(
        &self,
        (outlet, user): (&str, &str),
        (before, text): (String, String),
    ) -> Result<String, NotApplied> {
        self.change(caller(outlet, user), (before, text), false)
            .await
    }

    /// Replaces the part of the file by that of the text before, whatever that says, if it is that
    /// of the first text. The file as it is then.
    ///
    /// # Errors
    /// [`NotApplied`].
    pub(crate) async fn take_back(
        &self,
        outlet: &str,
        (from, to): (String, String),
    ) -> Result<String, NotApplied> {
        self.change(caller(outlet, ""), (from, to), true).await
    }

    async fn change(
        &self,
        who: Caller,
        (before, text): (String, String),
        is_back: bool,
    ) -> Result<String, NotApplied> {
        let change = PartChange {
            who,
            before,
            text,
            is_back,
        };
        let done = self.call(|to| ConfigCall::Apply(change, to)).await;
        done.map_err(NotApplied::Failed)?
    }

    async fn call<T>(
        &self,
        what: impl FnOnce(oneshot::Sender<T>) -> ConfigCall,
    ) -> Result<T, Problem> {
        let (to, done) = oneshot::channel();
        self.calls.send(what(to)).await.map_err(|_| stopping())?;
        done.await.map_err(|_| stopping())
    }
}

fn stopping() -> Problem {
    Problem::new(codes::DAEMON).with("reason", "stopping")
}

/// A user of a centre, or the outlet itself.
fn caller(outlet: &str, user: &str) -> Caller {
    let outlet = format!("outlet:{outlet}");
    Caller {
        name: match user {
            "" => outlet.clone(),
            user => format!("{outlet}:{}", shown_user(user)),
        },
        id: outlet.clone(),
        role: Some(Role::Engineer),
        via: outlet,
        points: Arc::default(),
        known: Known::Outlet,
    }
}

impl RemoteConfigCalls {
    /// Does what outlets want until the daemon stops.
    pub(crate) async fn serve(mut self, site: Site) {
        let mut stop = site.stop.clone();
        let mut changes = site.desk.changes();
        loop {
            let call = tokio::select! {
                biased;
                () = ended(&mut stop) => return,
                changed = changes.changed() => match changed {
                    Ok(()) => {
                        self.changes.send_modify(|count| *count = count.wrapping_add(1));
                        continue;
                    }
                    Err(_) => return,
                },
                call = self.calls.recv() => call,
            };
            // Sending fails if the outlet has ended.
            match call {
                Some(ConfigCall::Read(to)) => _ = to.send(site.desk.text().await),
                Some(ConfigCall::Check(wanted, to)) => _ = to.send(check(&site, wanted).await),
                Some(ConfigCall::Apply(wanted, to)) => _ = to.send(apply(&site, wanted).await),
                None => return,
            }
        }
    }
}

/// How the file would be.
async fn check(site: &Site, wanted: PartCheck) -> Result<String, NotApplied> {
    let PartCheck { who, before, part } = wanted;
    let now = site.desk.text().await.map_err(NotApplied::Failed)?;
    if now != before {
        return Err(NotApplied::Other(now));
    }
    as_in_force(site, &before)?;
    checked(site, &who, &before, &part).map_err(NotApplied::Refused)
}

/// Whether the file is what is in force. One that is gone or empty, or was changed and not read
/// yet, is not begun anew by a centre; and what was before must be able to come back.
fn as_in_force(site: &Site, text: &str) -> Result<(), NotApplied> {
    let file = site.desk.file().display().to_string();
    let config = Config::parse(text)
        .map_err(|problems| NotApplied::Failed(bad_config(Lang::En, &file, &problems)))?;
    let tables = site.service.config().differences(&config);
    match tables.is_empty() {
        true => Ok(()),
        false => Err(NotApplied::Failed(
            Problem::new(codes::CONFIG_CHANGED)
                .with("file", file)
                .with("reason", tables.join(" ")),
        )),
    }
}

/// The file with this part, if it is accepted.
fn checked(site: &Site, who: &Caller, before: &str, part: &str) -> Result<String, Problem> {
    let whole = with_part(before, part);
    if let Err(PartError::Own(tables)) = whole {
        return Err(Problem::new(codes::SITE_OWN).with("reason", tables.join(" ")));
    }
    // With the lines of the part, which the centre has.
    Config::parse(part).map_err(|problems| bad_config(Lang::En, NAME, &problems))?;
    let unreadable = |error: PartError| {
        Problem::new(codes::CONFIG_FILE)
            .with("file", site.desk.file().display().to_string())
            .with("reason", error.to_string())
    };
    let text = whole.map_err(unreadable)?;
    let new = Config::parse(&text);
    let new = new.map_err(|problems| bad_config(Lang::En, NAME, &problems))?;
    northbound::check(Lang::En, NAME, &text, &new)?;
    bring::may_bring((who, site), before, &text)?;
    bring::may_lead((who, site), before, &text)?;
    Ok(text)
}

async fn apply(site: &Site, wanted: PartChange) -> Result<String, NotApplied> {
    let PartChange {
        who,
        before,
        text,
        is_back,
    } = wanted;
    let service = site.service.on_behalf_of(who.origin(), who.rights());
    let now = site.desk.text().await.map_err(NotApplied::Failed)?;
    // What only the site says may have been changed since: it stays.
    let is_same = match is_back {
        true => part_of(&now).ok() == part_of(&before).ok(),
        false => now == before,
    };
    if !is_same {
        return Err(NotApplied::Other(now));
    }
    let text = match is_back {
        true => taken_back(&now, &before, &text),
        false => {
            as_in_force(site, &now)?;
            let may = bring::may_bring((&who, site), &now, &text)
                .and_then(|()| bring::may_lead((&who, site), &now, &text));
            may.map_err(NotApplied::Refused)?;
            text
        }
    };
    let asks = Asks {
        service: &service,
        lang: Lang::En,
        who: &who.name,
        seen: Some(vec![etag(&now)]),
        // What was there comes back, also if an integration could not use it.
        is_fact: is_back,
    };
    let end = site.desk.change(&asks, |_| Ok(text.clone())).await;
    let problem = match end {
        Ok(_) => return Ok(text),
        Err(problem) => problem,
    };
    if problem.code == codes::CONFIG_CHANGED.code {
        let now = site.desk.text().await.map_err(NotApplied::Failed)?;
        return Err(NotApplied::Other(now));
    }
    // Nothing is written that can't be read. What else stands in the way, such as exclusive access
    // to a line, ends.
    match problem.code == codes::BAD_CONFIG.code {
        true => Err(NotApplied::Refused(problem)),
        false => Err(NotApplied::Failed(problem)),
    }
}

#[cfg(test)]
mod tests;
