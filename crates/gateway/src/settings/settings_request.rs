//! Requests concerning the settings of a module, checked against those it has now.

use super::look::look;
use crate::site::Site;
use railbus_api::problem::{Problem, codes};
use railbus_api::settings::{
    LoggedChange, Setting, SettingChange, SettingFrame, Settings, SettingsLog, SettingsPlan,
};
use railbus_api::types::SCHEMA;
use railbus_app::api::failures;
use railbus_app::failure::Failure;
use railbus_app::frames::meaning;
use railbus_app::settings::log::taking_back;
use railbus_app::settings::target::{NoTarget, Target};
use railbus_app::settings::{outcome, plan};
use railbus_commission::settings::{
    Access, Choice, Key, Wanted, choice, differences, settings, shown,
};
use railbus_commission::{ChangeOrigin, Found, JournalRecord, Log, WriteStep};
use railbus_site::Service;
use railbus_site::config::keeper::etag;
use railbus_store::journal::JournalFile;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::{Map, Value};
use std::path::PathBuf;

/// The most changes that are listed at once.
const LOGGED_MAX: usize = 200;

/// A request concerning the settings of a module.
pub(super) struct SettingsRequest {
    pub(super) site: Site,
    pub(super) service: Service,
    pub(super) lang: Lang,
    pub(super) module: String,
    /// The versions of the values that may be changed; none if any may.
    seen: Option<Vec<String>>,
}

/// The requested change.
pub(super) enum Want {
    /// These settings, by name.
    Set(Map<String, Value>),
    /// Undo this change, or the last one.
    Undo(Option<u64>),
}

/// The steps of a change.
pub(super) struct Plan {
    /// The module, at the place where it was found.
    pub(super) target: Target,
    pub(super) found: Found,
    pub(super) wanted: Wanted,
    pub(super) stages: Vec<WriteStep>,
    pub(super) by: ChangeOrigin,
    pub(super) undoes: Option<u64>,
}

impl SettingsRequest {
    pub(super) fn new(
        site: &Site,
        service: &Service,
        lang: Lang,
        module: String,
        seen: Option<Vec<String>>,
    ) -> SettingsRequest {
        SettingsRequest {
            site: site.clone(),
            service: service.clone(),
            lang,
            module,
            seen,
        }
    }

    /// The folder of the journal.
    pub(super) fn state(&self) -> PathBuf {
        self.site.desk.state().to_owned()
    }

    pub(super) fn target(&self) -> Result<Target, Problem> {
        let target = Target::of(&self.service.config(), &self.module);
        target.map_err(|why| match why {
            NoTarget::Module => failures::no_such_module(&self.service, &self.module),
            NoTarget::Line(line) => failures::no_such_line(&self.service, &line),
        })
    }

    /// Reads the module's settings.
    pub(super) async fn settings(&self) -> Result<Settings, Problem> {
        let target = self.target()?;
        let found = look(&self.service, self.lang, &target).await?;
        let open = self.journal().await?;
        let mut open = open.open().into_iter();
        let open = open.find(|record| record.module == target.name);
        let all = settings(&target.setup).into_iter();
        Ok(Settings {
            schema: SCHEMA,
            module: target.name.clone(),
            etag: mark(&target, &found),
            settings: all.map(|of| setting(&target, &found, of)).collect(),
            open: open.map(|record| record.change),
        })
    }

    /// The plan for a change, of a module whose settings are as the caller has seen them.
    pub(super) async fn plan(&self, want: Want) -> Result<Plan, Problem> {
        let target = self.target()?;
        let (wanted, by, undoes) = match want {
            Want::Set(keys) => (self.wanted(&target, keys)?, ChangeOrigin::Set, None),
            Want::Undo(number) => {
                let (number, wanted) = self.undoing(&target, number).await?;
                (wanted, ChangeOrigin::Undo, Some(number))
            }
        };
        let found = look(&self.service, self.lang, &target).await?;
        let now = mark(&target, &found);
        if self.seen.as_ref().is_some_and(|seen| !seen.contains(&now)) {
            let problem = Problem::new(codes::SETTINGS_CHANGED).with("module", target.name);
            return Err(problem.with("etag", now));
        }
        let target = target.found(&found);
        let stages = target.writes(&found, &wanted);
        let refused = |trouble| outcome::trouble(self.lang, &target, &trouble).to_problem();
        Ok(Plan {
            stages: stages.map_err(refused)?,
            target,
            found,
            wanted,
            by,
            undoes,
        })
    }

    fn wanted(&self, target: &Target, keys: Map<String, Value>) -> Result<Wanted, Problem> {
        let wrong = |reason: &str| Problem::new(codes::BAD_REQUEST).with("reason", reason);
        if keys.is_empty() {
            return Err(wrong("no setting is named"));
        }
        let mut wanted = Wanted::default();
        for (name, value) in keys {
            let word = match value {
                Value::String(word) => word,
                Value::Number(number) => number.to_string(),
                Value::Bool(on) => if on { "on" } else { "off" }.to_owned(),
                _ => return Err(wrong(&format!("{name}: a word or a number"))),
            };
            wanted
                .set(&target.setup, &name, &word)
                .map_err(|why| outcome::wrong(self.lang, target, &why).to_problem())?;
        }
        Ok(wanted)
    }

    /// A change of this module, and the change that undoes it.
    async fn undoing(
        &self,
        target: &Target,
        number: Option<u64>,
    ) -> Result<(u64, Wanted), Problem> {
        let log = self.journal().await?;
        let of_module = |record: &&JournalRecord| {
            record.module == target.name && number.is_none_or(|number| record.change == number)
        };
        let last = log.records.iter().rev().find(of_module);
        let last = last.ok_or_else(|| {
            let failure = Failure::of(self.lang, Code::NoChange);
            failure.because(number.unwrap_or_default()).to_problem()
        })?;
        let wanted = taking_back(self.lang, &log, last, target);
        let wanted = wanted.map_err(|failure| failure.to_problem())?;
        Ok((last.change, wanted))
    }

    async fn journal(&self) -> Result<Log, Problem> {
        let state = self.state();
        let read = tokio::task::spawn_blocking(move || JournalFile::peek(&state)).await;
        let read = read.map_err(std::io::Error::other).and_then(|log| log);
        read.map_err(|error| {
            let failure = Failure::of(self.lang, Code::Journal);
            failure.because(error).to_problem()
        })
    }

    /// The journal of the module.
    pub(super) async fn log(&self) -> Result<SettingsLog, Problem> {
        self.target()?;
        let log = self.journal().await?;
        let last_words = log.last_words();
        let of_module = last_words.values().rev();
        let of_module = of_module.filter(|record| record.module == self.module);
        Ok(SettingsLog {
            schema: SCHEMA,
            changes: of_module
                .take(LOGGED_MAX)
                .map(|last| logged(&log, last))
                .collect(),
        })
    }
}

impl Plan {
    /// The differences.
    pub(super) fn changes(&self) -> Vec<SettingChange> {
        let before = self.found.kept();
        let after = self.stages.last().map_or(before, |stage| stage.after);
        let all = differences(&self.target.setup, &before, &after).into_iter();
        all.map(|(key, before, after)| SettingChange {
            setting: key.to_string(),
            before,
            after,
        })
        .collect()
    }

    pub(super) fn told(&self, lang: Lang) -> SettingsPlan {
        let frame = |stage: &WriteStep| {
            let asked = self.target.request(stage);
            SettingFrame {
                frame: plan::frame(&self.target, stage),
                meaning: asked.map_or_else(String::new, |asked| meaning::request(lang, &asked)),
            }
        };
        SettingsPlan {
            schema: SCHEMA,
            module: self.target.name.clone(),
            etag: mark(&self.target, &self.found),
            changes: self.changes(),
            frames: self.stages.iter().map(frame).collect(),
            warnings: plan::warnings(lang, &self.target, &self.stages),
            power_cycle: self.target.setup.family.datasheet().needs_power_cycle()
                && !self.stages.is_empty(),
        }
    }
}

/// The version of a module's settings.
fn mark(target: &Target, found: &Found) -> String {
    let known = plan::known(target, found);
    let all = settings(&target.setup).into_iter();
    let all = all.map(|(key, _)| format!("{key}={:?}", shown(&target.setup, &known, key)));
    etag(&format!(
        "{} {:?}",
        all.collect::<Vec<_>>().join(" "),
        found.place
    ))
}

fn setting(target: &Target, found: &Found, (key, access): (Key, Access)) -> Setting {
    let setup = &target.setup;
    let mut told = Setting {
        setting: key.to_string(),
        value: shown(setup, &plan::known(target, found), key),
        range: choice(setup, key).to_string(),
        words: Vec::new(),
        min: None,
        max: None,
        unit: None,
        writable: access.is_writable(),
        access: access.name().to_owned(),
        source: plan::source(target, found, key).to_owned(),
    };
    match choice(setup, key) {
        Choice::Number(low, high, _) => {
            (told.min, told.max) = (Some(low.into()), Some(high.into()));
        }
        Choice::Word(words) => told.words = words,
        Choice::Measure(low, high, unit) => {
            (told.min, told.max) = (low.parse().ok(), high.parse().ok());
            told.unit = Some(unit.to_owned());
        }
    }
    told
}

fn logged(log: &Log, last: &JournalRecord) -> LoggedChange {
    let name = |value: Value| value.as_str().unwrap_or_default().to_owned();
    let set = log.net(last.change);
    let known = set.values().all(|[old, _]| old != "?");
    LoggedChange {
        change: last.change,
        at: last.at.clone(),
        state: name(serde_json::to_value(last.state).unwrap_or_default()),
        by: name(serde_json::to_value(last.by).unwrap_or_default()),
        undoes: last.undoes,
        rolled_back: log.is_rolled_back(last.change),
        undoable: last.state.is_done() && known && set.values().any(|[old, new]| old != new),
        set,
    }
}
