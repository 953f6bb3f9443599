//! The journal's entries about a change, and the search for lost modules.

use super::outcome;
use super::target::Target;
use super::texts::SettingsText;
use crate::failure::Failure;
use railbus_commission::settings::Wanted;
use railbus_commission::{JournalRecord, Log, RecordState};
use railbus_device::{Separation, Setup};
use railbus_words::Code;
use railbus_words::Lang;

/// The state of a change, in words.
pub fn state(log: &Log, last: &JournalRecord) -> SettingsText {
    match last.state {
        RecordState::Done | RecordState::Filed if log.is_rolled_back(last.change) => {
            SettingsText::StateRolledBack
        }
        RecordState::Done | RecordState::Filed => SettingsText::StateDone,
        RecordState::Intent => SettingsText::StateIntent,
        RecordState::Pending => SettingsText::StatePending,
        RecordState::Unchanged => SettingsText::StateUnchanged,
        RecordState::Elsewhere => SettingsText::StateElsewhere,
        RecordState::Lost => SettingsText::StateLost,
        RecordState::Untold => SettingsText::StateUntold,
    }
}

/// The change that undoes the one with this last record.
///
/// # Errors
/// If its result is not known, or an old value is not.
pub fn taking_back(
    lang: Lang,
    log: &Log,
    last: &JournalRecord,
    target: &Target,
) -> Result<Wanted, Failure> {
    let can_not = |why: String| Failure::of(lang, Code::CantUndo).because(why);
    if !last.state.is_done() {
        let told = lang.get(state(log, last)).to_owned();
        return Err(can_not(told).with_try("railbus config recover"));
    }
    let mut wanted = Wanted::default();
    for (key, [old, new]) in &log.net(last.change) {
        if old == "?" {
            return Err(can_not(format!("{key}: ? → {new}")));
        }
        if old != new {
            wanted
                .set(&target.setup, key, old)
                .map_err(|wrong| outcome::wrong(lang, target, &wrong))?;
        }
    }
    Ok(wanted)
}

/// Not found at all, or two modules at once: then how to separate them, which depends on the
/// family.
pub fn not_found(lang: Lang, target: &Target, garbled: bool) -> Failure {
    let setup = &target.setup;
    let code = if garbled {
        Code::TwoModules
    } else {
        Code::NotFound
    };
    let failure = Failure::of(lang, code)
        .because(&target.name)
        .with_fact("module", target.name.as_str());
    if !garbled {
        return failure.with_try(format!("railbus scan -l {}", target.line));
    }
    let (_, steps) = parting(setup);
    let address = setup.address.0;
    let values: &[(&str, &dyn std::fmt::Display)] =
        &[("module", &target.name), ("address", &address)];
    let failure = failure.because(lang.fill(steps, values));
    failure.with_try(format!("railbus scan -l {}", target.line))
}

/// How to separate two modules at one address: its name, and the steps.
pub fn parting(setup: &Setup) -> (&'static str, SettingsText) {
    match setup.family.datasheet().separation.of(setup.protocol) {
        Separation::PowerUp => ("boards", SettingsText::PartBoards),
        Separation::InitPin => ("pin", SettingsText::PartByPin),
        Separation::Plug => ("plug", SettingsText::PartByPlug),
    }
}
