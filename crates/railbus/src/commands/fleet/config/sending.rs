//! A configuration that is given to a site, and what becomes of it.

use super::texts::SiteConfigText;
use super::{FleetConfig, FleetPresence, HASH_SHOWN, OUTPUT, shown};
use crate::commands::Context;
use crate::commands::context::hub_socket;
use crate::commands::fleet::{self, unusable};
use crate::commands::stop::{self, Stop};
use clap::ArgMatches;
use railbus_api::fleet::{FleetConfigPhase, SetSiteConfig};
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_app::render::{Format, out};
use railbus_client::HubClient;
use railbus_fleet::desired::CONFIG_TEXT_MAX;
use railbus_fleet::trial::TRIAL;
use railbus_words::{Code, reasons};
use std::fs::File;
use std::io::{Read, stdin};
use std::path::Path;
use std::time::{Duration, Instant};

/// How often it is asked how far it is.
const ASK: Duration = Duration::from_secs(1);

/// How long a centre that has just been connected may take to know whether a site is there.
const KNOWN_MAX: Duration = Duration::from_secs(40);
/// How many digits a hash has.
const HASH_LEN: usize = 64;

/// What became of a version.
#[derive(Clone, Debug, PartialEq)]
enum ConfigFate {
    /// The site has not said yet.
    Open,
    /// It waits there, for this reason if one is said.
    Waits(Option<String>),
    /// It is tried.
    Tried,
    /// It is kept.
    Kept,
    /// It is not, for this reason.
    Not(Problem),
    /// A later one was given since.
    Overtaken(u64),
}

/// Gives a site another configuration, and waits for what becomes of it.
pub(super) fn run(context: &Context, matches: &ArgMatches, site: &str) -> Result<(), Failure> {
    let lang = context.lang;
    let file = fleet::text(matches, "FILE");
    let text = read(context, file)?;
    let named = hub_socket(matches);
    let waits = !matches.get_flag("no-wait");
    let replaces = matches.get_one::<String>("replace");
    let is_hash = |hash: &&String| {
        let length = (HASH_SHOWN..=HASH_LEN).contains(&hash.len());
        length && hash.bytes().all(|byte| byte.is_ascii_hexdigit())
    };
    if replaces.is_some() && replaces.filter(is_hash).is_none() {
        let message = lang.get(SiteConfigText::BadHash).to_owned();
        return Err(Failure::new(Code::Usage, message));
    }
    let replaces = replaces.map(|hash| hash.to_ascii_lowercase());
    let told = context.block(async {
        let hub = HubClient::find(named.as_deref()).await;
        let hub = hub.map_err(|problem| context.failure(&problem))?;
        let mut sending = Sending {
            context,
            hub,
            site,
            stop: Stop::new(context)?,
        };
        let wanted = sending.wanted(text, replaces.as_deref()).await?;
        let told = sending.give(&wanted, file).await?;
        let Some(version) = told.wanted.as_ref().map(|wanted| wanted.version) else {
            return Ok((told, SiteConfigText::Sent, 0));
        };
        let told = if waits {
            sending.presence(told).await?
        } else {
            told
        };
        if told.presence != FleetPresence::Online {
            sending.note(SiteConfigText::Away, version, "");
            return Ok((told, SiteConfigText::Sent, version));
        }
        match waits {
            true => Ok((sending.wait(version).await?, SiteConfigText::Kept, version)),
            false => Ok((told, SiteConfigText::Sent, version)),
        }
    });
    let (told, end, version) = told?;
    let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &site), ("version", &version)];
    match context.format {
        Format::Table => out::result(lang, &(lang.fill(end, values) + "\n")),
        format => out::result(lang, &shown(context, &told).render(format)),
    }
}

/// The text of the file, or of the input.
fn read(context: &Context, file: &str) -> Result<String, Failure> {
    let mut text = String::new();
    // The centre refuses what is longer.
    let most = u64::try_from(CONFIG_TEXT_MAX).unwrap_or(u64::MAX) + 1;
    let read = match file == OUTPUT {
        true => stdin().take(most).read_to_string(&mut text),
        false => File::open(file).and_then(|file| file.take(most).read_to_string(&mut text)),
    };
    read.map_err(|error| unusable(context.lang, Path::new(file), &error))?;
    Ok(text)
}

/// A configuration that is being given.
struct Sending<'c> {
    context: &'c Context,
    hub: HubClient,
    site: &'c str,
    stop: Stop,
}

impl Sending<'_> {
    /// What is to be given; in the place of what the site has now, if that has this hash.
    async fn wanted(
        &mut self,
        text: String,
        replaces: Option<&str>,
    ) -> Result<SetSiteConfig, Failure> {
        let mut wanted = SetSiteConfig {
            text,
            ..SetSiteConfig::default()
        };
        let Some(hash) = replaces else {
            return Ok(wanted);
        };
        let (hub, site) = (self.hub.clone(), self.site);
        let now = self.stop.or(hub.config(site)).await;
        let now = now.ok_or_else(|| stop::interrupted(self.context))?;
        let now = now.map_err(|problem| self.context.failure(&problem))?;
        wanted.seen = Some(now.wanted.map_or(0, |wanted| wanted.version));
        wanted.replaces = match now.state.map(|state| state.hash) {
            Some(now) if now.starts_with(hash) => Some(now),
            // What it has is not known here: the site compares it.
            None if hash.len() == HASH_LEN => Some(hash.to_owned()),
            _ => {
                let problem = Problem::new(codes::SITE_CONFIG_CHANGED).with("name", site);
                return Err(self.context.failure(&problem));
            }
        };
        Ok(wanted)
    }

    /// How the site is, once the centre knows whether it is there.
    async fn presence(&mut self, mut told: FleetConfig) -> Result<FleetConfig, Failure> {
        let since = Instant::now();
        while told.presence == FleetPresence::Unknown && since.elapsed() < KNOWN_MAX {
            let slept = self.stop.or(tokio::time::sleep(ASK)).await;
            slept.ok_or_else(|| self.left(stop::interrupted(self.context)))?;
            let (hub, site) = (self.hub.clone(), self.site);
            let now = self.stop.or(hub.config(site)).await;
            let now = now.ok_or_else(|| self.left(stop::interrupted(self.context)))?;
            told = now.map_err(|problem| self.left(self.context.failure(&problem)))?;
        }
        Ok(told)
    }

    async fn give(&mut self, wanted: &SetSiteConfig, file: &str) -> Result<FleetConfig, Failure> {
        let (hub, site) = (self.hub.clone(), self.site);
        let told = self.stop.or(hub.set_config(site, wanted)).await;
        let told = told.ok_or_else(|| self.left(stop::interrupted(self.context)))?;
        told.map_err(|problem| {
            // Lines and columns are of the file that was read.
            let problem = match problem.code == codes::BAD_CONFIG.code && file != OUTPUT {
                true => problem.with("file", file),
                false => problem,
            };
            match problem.may_have_acted {
                true => self.left(self.context.failure(&problem)),
                false => self.context.failure(&problem),
            }
        })
    }

    /// Waits until the site says what became of a version; how it is then, if it is kept.
    async fn wait(&mut self, version: u64) -> Result<FleetConfig, Failure> {
        let (mut last, mut was_online) = (ConfigFate::Open, true);
        loop {
            let (hub, site) = (self.hub.clone(), self.site);
            let told = self.stop.or(hub.config(site)).await;
            let told = told.ok_or_else(|| self.left(stop::interrupted(self.context)))?;
            let told = told.map_err(|problem| self.left(self.context.failure(&problem)))?;
            let is_online = told.presence == FleetPresence::Online;
            if was_online && !is_online {
                self.note(SiteConfigText::Gone, version, "");
            }
            was_online = is_online;
            let fate = fate(&told, version);
            let is_new = fate != last;
            match &fate {
                ConfigFate::Kept => return Ok(told),
                ConfigFate::Not(problem) => return Err(self.context.failure(problem)),
                ConfigFate::Overtaken(newer) => return Err(self.overtaken(version, *newer)),
                ConfigFate::Tried if is_new => self.note(SiteConfigText::TriedNow, version, ""),
                ConfigFate::Waits(Some(why)) if is_new => {
                    let why = reasons::told(self.context.lang, why);
                    self.note(SiteConfigText::Waits, version, &why);
                }
                ConfigFate::Waits(None) if is_new => {
                    self.note(SiteConfigText::NotBegun, version, "")
                }
                ConfigFate::Open | ConfigFate::Tried | ConfigFate::Waits(_) => {}
            }
            last = fate;
            let slept = self.stop.or(tokio::time::sleep(ASK)).await;
            slept.ok_or_else(|| self.left(stop::interrupted(self.context)))?;
        }
    }

    fn note(&self, text: SiteConfigText, version: u64, why: &str) {
        let seconds = TRIAL.as_secs();
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("site", &self.site),
            ("version", &version),
            ("seconds", &seconds),
            ("why", &why),
        ];
        self.context.note(&self.context.lang.fill(text, values));
    }

    fn overtaken(&self, version: u64, newer: u64) -> Failure {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("version", &version), ("newer", &newer)];
        let message = self.context.lang.fill(SiteConfigText::Overtaken, values);
        let failure = Failure::new(Code::ConfigChanged, message);
        failure.with_try(format!("railbus fleet config {}", self.site))
    }

    /// Nobody waits for it any more.
    fn left(&self, failure: Failure) -> Failure {
        let values: &[(&str, &dyn std::fmt::Display)] = &[("site", &self.site)];
        let failure = failure.perhaps_acted(true);
        failure.because(self.context.lang.fill(SiteConfigText::GoesOn, values))
    }
}

/// What became of a version, by what is told of its site.
fn fate(told: &FleetConfig, version: u64) -> ConfigFate {
    let named = |kind| Problem::new(kind).with("name", told.site.as_str());
    let newest = told.wanted.as_ref().map_or(0, |wanted| wanted.version);
    let Some(state) = &told.state else {
        return match told.presence {
            FleetPresence::Online => ConfigFate::Not(named(codes::NOT_MANAGED)),
            FleetPresence::Offline | FleetPresence::Unknown => ConfigFate::Open,
        };
    };
    let said = state.version.unwrap_or_default();
    if said > version {
        return ConfigFate::Overtaken(said);
    }
    let not = |kind| {
        let problem = state.problem.clone();
        ConfigFate::Not(problem.unwrap_or_else(|| named(kind)))
    };
    match state.phase {
        // What it says is of another version, which it may be trying.
        _ if said < version && newest > version => ConfigFate::Overtaken(newest),
        _ if said < version => ConfigFate::Open,
        FleetConfigPhase::Current => ConfigFate::Kept,
        FleetConfigPhase::Trying => ConfigFate::Tried,
        FleetConfigPhase::Pending => ConfigFate::Waits(state.reason.clone()),
        FleetConfigPhase::RolledBack => not(codes::CONFIG_TAKEN_BACK),
        FleetConfigPhase::Refused
        | FleetConfigPhase::LocalChange
        | FleetConfigPhase::Interrupted => not(codes::SITE_CONFIG_CHANGED),
        FleetConfigPhase::Unmanaged | FleetConfigPhase::Other => ConfigFate::Open,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_api::fleet::{FleetConfigState, FleetConfigWanted};

    /// What is told where version 3 was given last, and the site says this of a version.
    fn told(phase: FleetConfigPhase, version: Option<u64>) -> FleetConfig {
        FleetConfig {
            schema: 1,
            site: "plant7".to_owned(),
            presence: FleetPresence::Online,
            wanted: Some(FleetConfigWanted {
                version: 3,
                user: "li".to_owned(),
                at: String::new(),
                text: String::new(),
            }),
            state: Some(FleetConfigState {
                phase,
                version,
                kept: None,
                hash: String::new(),
                changed_at_site: false,
                reason: Some("no storage space".to_owned()),
                problem: None,
                heard_ms: 0,
            }),
        }
    }

    fn code(fate: ConfigFate) -> String {
        match fate {
            ConfigFate::Not(problem) => problem.code,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn only_what_is_kept_is() {
        use FleetConfigPhase::{
            Current, Interrupted, LocalChange, Other, Pending, Refused, RolledBack, Trying,
            Unmanaged,
        };
        let of = |phase, version| fate(&told(phase, version), 3);
        assert_eq!(of(Current, Some(3)), ConfigFate::Kept);
        assert_eq!(of(Trying, Some(3)), ConfigFate::Tried);
        let why = Some("no storage space".to_owned());
        assert_eq!(of(Pending, Some(3)), ConfigFate::Waits(why));
        assert_eq!(code(of(RolledBack, Some(3))), "E0944");
        assert_eq!(code(of(Refused, Some(3))), "E0943");
        assert_eq!(code(of(LocalChange, Some(3))), "E0943");
        assert_eq!(code(of(Interrupted, Some(3))), "E0943");
        for open in [Unmanaged, Other] {
            assert_eq!(of(open, None), ConfigFate::Open);
            assert_eq!(of(open, Some(3)), ConfigFate::Open);
        }
        // What is said of an earlier version says nothing of this one.
        for phase in [Current, Trying, Pending, Refused, RolledBack, LocalChange] {
            assert_eq!(of(phase, Some(2)), ConfigFate::Open);
            assert_eq!(of(phase, Some(4)), ConfigFate::Overtaken(4));
            let earlier = fate(&told(phase, Some(1)), 2);
            assert_eq!(earlier, ConfigFate::Overtaken(3));
        }
        // It was over when another one was given.
        assert_eq!(code(fate(&told(RolledBack, Some(2)), 2)), "E0944");
    }

    #[test]
    fn a_site_that_takes_none_any_more_says_so_and_one_that_is_away_does_not() {
        let mut none = told(FleetConfigPhase::Current, Some(3));
        none.state = None;
        assert_eq!(code(fate(&none, 3)), "E0942");
        for presence in [FleetPresence::Offline, FleetPresence::Unknown] {
            none.presence = presence;
            assert_eq!(fate(&none, 3), ConfigFate::Open);
        }
    }

    #[test]
    fn the_problem_is_that_of_the_site() {
        let mut refused = told(FleetConfigPhase::Refused, Some(3));
        let state = refused.state.as_mut().unwrap();
        state.problem = Some(Problem::new(codes::BAD_CONFIG));
        assert_eq!(code(fate(&refused, 3)), "E0810");
    }
}
