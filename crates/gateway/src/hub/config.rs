//! Configurations of far sites: what is wanted of a site, how far it is, and what it has now.

use super::driver::HubCall;
use super::routes::{HubApi, call, changed, note_change, parsed};
use super::site_api;
use super::view::SCHEMA;
use crate::access::secret::hex;
use crate::access::{Caller, to_its_end};
use crate::events::unreadable;
use crate::language::spoken;
use crate::{answer, localize, northbound};
use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::header::ACCEPT_LANGUAGE;
use axum::http::{HeaderMap, Response};
use prost::Message as _;
use railbus_api::fleet::{
    AT_SITE, FleetConfig, FleetConfigPhase, FleetConfigState, FleetConfigText, FleetConfigWanted,
    FleetSiteConfig, SetSiteConfig,
};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures::bad_config;
use railbus_app::api::past::moment;
use railbus_fleet::centre::{SitePresence, SiteView};
use railbus_fleet::desired::CONFIG_TEXT_MAX;
use railbus_fleet::is_site_name;
use railbus_fleet::message::{
    ConfigAnswer, ConfigDocument, ConfigPhaseKind, ConfigReport, FleetRefusal,
};
use railbus_fleet::trial::part_hash;
use railbus_site::Config;
use railbus_site::config::part::{PartError, with_part};
use railbus_words::{Lang, reasons};
use std::time::Duration;

/// The longest body with a configuration, in bytes: JSON may write each byte of the text in six,
/// and a text that is too long is to be told from a request that is.
pub(super) const CONFIG_BODY_MAX: usize = 8 * CONFIG_TEXT_MAX;
/// The length of a hash, in bytes.
const HASH_LEN: usize = 32;

/// A configuration that somebody wants a site to have. What can be said without knowing the site
/// was checked.
pub(super) struct GivenConfig {
    pub(super) site: String,
    pub(super) text: String,
    /// The version that its author has seen, if that is said.
    pub(super) seen: Option<u64>,
    /// The hash of what it may replace at the site; empty if nothing but what the centre made.
    pub(super) replaces: Vec<u8>,
    /// The name of who wants it.
    pub(super) user: String,
}

impl GivenConfig {
    /// One that can be a configuration, as far as its text tells.
    ///
    /// # Errors
    /// What is wrong with it, with line and column in the text.
    pub(super) fn new(
        lang: Lang,
        site: String,
        wanted: SetSiteConfig,
        user: &str,
    ) -> Result<GivenConfig, Problem> {
        let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
        if !is_site_name(&site) {
            return Err(wrong("a site's name has 1 to 64 of a-z, 0-9, - and _"));
        }
        let SetSiteConfig {
            text,
            seen,
            replaces,
        } = wanted;
        if text.len() > CONFIG_TEXT_MAX {
            return Err(wrong("the configuration has more than 512 KiB"));
        }
        let replaces = replaces.unwrap_or_default();
        let replaces = match replaces.is_empty() {
            true => Vec::new(),
            false => unhex(&replaces).ok_or_else(|| unreadable("replaces"))?,
        };
        check(lang, &format!("{site}.toml"), &text)?;
        Ok(GivenConfig {
            site,
            text,
            seen,
            replaces,
            user: user.to_owned(),
        })
    }

    /// The newest version of which the site knows, if it may be given this one.
    ///
    /// # Errors
    /// It is there, and takes no configuration from the centre; or it has one that the centre did
    /// not make and that nobody said may be replaced.
    pub(super) fn may_go(&self, site: Option<&SiteView<'_>>) -> Result<u64, Problem> {
        let why = |kind| Problem::new(kind).with("name", &*self.site);
        let is_online = site.is_some_and(|site| site.presence == SitePresence::Online);
        let Some(report) = site.and_then(|site| site.config) else {
            // One that is away may take part when it comes.
            return match is_online {
                true => Err(why(codes::NOT_MANAGED)),
                false => Ok(0),
            };
        };
        let is_new = report.kept == 0 && report.hash == part_hash("");
        let may_be_replaced = report.hash == self.replaces || is_new;
        match report.is_local && !may_be_replaced {
            true => Err(why(codes::SITE_CONFIG_CHANGED)),
            false => Ok(report.version.max(report.kept)),
        }
    }

    /// Why it does not follow this version, if it does not.
    pub(super) fn conflict(&self, newest: u64) -> Option<Problem> {
        let is_other = self.seen.is_some_and(|seen| seen != newest);
        is_other.then(|| {
            Problem::new(codes::CONFIG_CHANGED)
                .with("file", format!("{}.toml", self.site))
                .with("etag", newest.to_string())
        })
    }
}

/// Whether a text can be the configuration of a site, as far as the centre may say it.
fn check(lang: Lang, file: &str, text: &str) -> Result<(), Problem> {
    let own = own_tables(text);
    if !own.is_empty() {
        return Err(Problem::new(codes::SITE_OWN).with("reason", own.join(" ")));
    }
    let config = Config::parse(text).map_err(|problems| bad_config(lang, file, &problems))?;
    northbound::check(lang, file, text, &config)
}

/// The tables of a text that only a site itself says; none if it is no TOML.
fn own_tables(text: &str) -> Vec<String> {
    match with_part("", text) {
        Err(PartError::Own(tables)) => tables,
        Ok(_) | Err(PartError::Syntax(..)) => Vec::new(),
    }
}

/// The bytes of a hash.
fn unhex(text: &str) -> Option<Vec<u8>> {
    let is_one = text.len() == 2 * HASH_LEN && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let pairs = is_one.then(|| (0..text.len()).step_by(2))?;
    pairs
        .map(|at| u8::from_str_radix(text.get(at..at + 2)?, 16).ok())
        .collect()
}

/// How far the configuration of a site is, in a list of sites.
pub(super) fn brief(report: &ConfigReport) -> FleetSiteConfig {
    FleetSiteConfig {
        phase: phase(report),
        version: version(report.version),
    }
}

/// How far the configuration of a site is, by its heartbeat of so long ago.
pub(super) fn state(site: &str, report: &ConfigReport, heard: Duration) -> FleetConfigState {
    let has_problem = !matches!(
        report.phase(),
        ConfigPhaseKind::Pending | ConfigPhaseKind::Unspecified
    );
    let reason = Some(&report.reason).filter(|reason| !has_problem && !reason.is_empty());
    FleetConfigState {
        phase: phase(report),
        version: version(report.version),
        kept: version(report.kept),
        hash: hex(&report.hash),
        changed_at_site: report.is_local,
        reason: reason.cloned(),
        problem: problem(site, report),
        heard_ms: u64::try_from(heard.as_millis()).unwrap_or(u64::MAX),
    }
}

/// A version; 0 is none.
fn version(number: u64) -> Option<u64> {
    Some(number).filter(|number| *number > 0)
}

fn phase(report: &ConfigReport) -> FleetConfigPhase {
    match report.phase() {
        ConfigPhaseKind::Unmanaged => FleetConfigPhase::Unmanaged,
        ConfigPhaseKind::Current => FleetConfigPhase::Current,
        ConfigPhaseKind::Pending => FleetConfigPhase::Pending,
        ConfigPhaseKind::Trying => FleetConfigPhase::Trying,
        ConfigPhaseKind::Refused => FleetConfigPhase::Refused,
        ConfigPhaseKind::RolledBack => FleetConfigPhase::RolledBack,
        ConfigPhaseKind::LocalChange => FleetConfigPhase::LocalChange,
        ConfigPhaseKind::Interrupted => FleetConfigPhase::Interrupted,
        ConfigPhaseKind::Unspecified => FleetConfigPhase::Other,
    }
}

/// Why a configuration was not kept. A report is not longer than what the centre takes.
fn problem(site: &str, report: &ConfigReport) -> Option<Problem> {
    let said = serde_json::from_slice::<Problem>(&report.problem).ok();
    let said = said.map(|said| {
        // Commands that help there do not help here.
        let said = Problem {
            hint: Vec::new(),
            ..said
        };
        said.with(AT_SITE, site)
    });
    said.or_else(|| {
        let problem = match report.phase() {
            ConfigPhaseKind::RolledBack => Problem::new(codes::CONFIG_TAKEN_BACK),
            ConfigPhaseKind::Refused | ConfigPhaseKind::Interrupted => {
                Problem::new(codes::SITE_CONFIG_CHANGED).with("name", site)
            }
            _ => return None,
        };
        Some(match report.reason.is_empty() {
            true => problem,
            false => problem.with("reason", &*report.reason),
        })
    })
}

/// A configuration that was wanted.
pub(super) fn wanted(document: ConfigDocument) -> FleetConfigWanted {
    FleetConfigWanted {
        version: document.version,
        user: document.user,
        at: moment(document.at_ms),
        text: document.text,
    }
}

/// What is wanted of a site, and how far it is.
pub(super) async fn told(
    State(api): State<HubApi>,
    Path(site): Path<String>,
    headers: HeaderMap,
) -> Response<Body> {
    let found = call(&api.calls, |to| HubCall::Config(site, to)).await;
    let found = found.and_then(|found| found);
    answer::json(found.map(|found| in_words(&api, &headers, found)))
}

/// Wants a configuration, to the end, even if the caller goes away: that it was stored, or may have
/// been, is always told.
pub(super) async fn set(
    State(api): State<HubApi>,
    Extension(caller): Extension<Caller>,
    Path(site): Path<String>,
    headers: HeaderMap,
    body: Bytes,
) -> Response<Body> {
    to_its_end(async move {
        let lang = spoken(&headers, api.lang);
        let (name, user) = (site.clone(), caller.name.clone());
        // Reading a long text takes its time, and sites are to be heard meanwhile.
        let given = tokio::task::spawn_blocking(move || {
            GivenConfig::new(lang, name, parsed(&body)?, &user)
        });
        let given = given.await.unwrap_or_else(|error| {
            Err(Problem::new(codes::INTERNAL).with("reason", error.to_string()))
        });
        let given = match given {
            Ok(given) => given,
            Err(problem) => return answer::problem(&problem),
        };
        let set = call(&api.calls, |to| HubCall::SetConfig(given, to)).await;
        let set = changed(set);
        let version = set.as_ref().ok().and_then(|told| told.wanted.as_ref());
        let version = version.map_or_else(String::new, |wanted| wanted.version.to_string());
        let what = format!("config_set {site} {version}");
        note_change(&caller, what.trim_end(), set.as_ref().err());
        answer::json(set.map(|told| in_words(&api, &headers, told)))
    })
    .await
}

/// What a site has now.
pub(super) async fn text(State(api): State<HubApi>, Path(site): Path<String>) -> Response<Body> {
    answer::json(text_of(&api, &site).await)
}

async fn text_of(api: &HubApi, site: &str) -> Result<FleetConfigText, Problem> {
    let (message, _) = site_api::send(&api.calls, (site, "config"), Bytes::new()).await?;
    let answer = ConfigAnswer::decode(message.payload);
    let answer = answer.map_err(|error| site_api::away(site, &error.to_string()))?;
    match answer.refusal {
        Some(refusal) => Err(refused(site, &refusal)),
        None => Ok(FleetConfigText {
            schema: SCHEMA,
            site: site.to_owned(),
            text: answer.text,
            hash: hex(&answer.hash),
        }),
    }
}

/// Why a site does not tell its configuration.
fn refused(site: &str, refusal: &FleetRefusal) -> Problem {
    // An older one does not know what it is asked.
    if [codes::NO_SUCH_PAGE.code, codes::NOT_MANAGED.code].contains(&&*refusal.code) {
        return Problem::new(codes::NOT_MANAGED).with("name", site);
    }
    let mut known = codes::ALL.iter();
    let known = known.find(|kind| kind.code == refusal.code);
    let problem = Problem::new(known.copied().unwrap_or(codes::SITE_AWAY));
    problem
        .with("name", site)
        .with("reason", site_api::shown(refusal))
}

/// With what the problem means, if a language is asked for.
fn in_words(api: &HubApi, headers: &HeaderMap, mut told: FleetConfig) -> FleetConfig {
    if headers.contains_key(ACCEPT_LANGUAGE) {
        let lang = spoken(headers, api.lang);
        if let Some(state) = &mut told.state {
            let problem = state.problem.take();
            state.problem = problem.map(|problem| localize::told(lang, problem));
            let reason = state.reason.take();
            state.reason = reason.map(|reason| reasons::told(lang, &reason));
        }
    }
    told
}

#[cfg(test)]
mod tests;
