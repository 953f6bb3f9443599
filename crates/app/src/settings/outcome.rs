//! Results of procedures, as failures in words.

use super::target::Target;
use super::texts::SettingsText;
use crate::api::config_words;
use crate::failure::Failure;
use crate::render::wire_words;
use railbus_commission::settings::{Key, Wrong, range};
use railbus_commission::{Blocker, BusAddress, Ended, NotWritable, ProcedureError, WriteFailure};
use railbus_device::{Refusal, SetupError};
use railbus_words::Code;
use railbus_words::Lang;
use std::io::ErrorKind;
use std::path::Path;

/// Why a procedure failed.
pub fn trouble(lang: Lang, target: &Target, trouble: &ProcedureError) -> Failure {
    let about = |code: Code| {
        Failure::of(lang, code)
            .because(place(
                lang,
                target,
                trouble.place().unwrap_or(BusAddress::of(&target.setup)),
            ))
            .with_fact("module", target.name.as_str())
            .with_fact("line", target.line.as_str())
    };
    let failure = match trouble {
        ProcedureError::NoReply(_) => about(Code::NoReply),
        ProcedureError::Garbled(at) => {
            let search = format!("railbus config recover --addr {}", at.address.0);
            about(Code::TwoModules).with_try(search)
        }
        ProcedureError::WrongModel(_, told) => {
            let failure = about(Code::WrongModel);
            match told {
                Some(name) => {
                    failure.because(lang.fill(SettingsText::CallsItself, &[("name", name)]))
                }
                None => failure.because(lang.get(SettingsText::NotAsModel)),
            }
        }
        ProcedureError::Refused(NotWritable::Setup(SetupError::Address(low, high))) => {
            about(Code::SettingRange).because(format!("address: {low}-{high}"))
        }
        ProcedureError::Refused(NotWritable::Setup(why)) => {
            about(Code::SettingRange).because(config_words::setup(lang, *why))
        }
        ProcedureError::Refused(NotWritable::NoCommand) => about(Code::SettingFixed),
        ProcedureError::Refused(NotWritable::NotReadable) => about(Code::NotReadable),
        ProcedureError::Taken(taken) => {
            let at = lang.fill(
                SettingsText::TakenBy,
                &[
                    ("place", &placed(lang, taken.place)),
                    ("protocol", &taken.protocol),
                    ("module", &taken.module.as_deref().unwrap_or("?")),
                ],
            );
            let failure = Failure::of(lang, Code::AddressTaken).because(at);
            let failure = match taken.garbled {
                true => failure.because(lang.get(SettingsText::TakenGarbled)),
                false => failure,
            };
            failure
                .with_fact("module", target.name.as_str())
                .with_fact("address", taken.place.address.0)
        }
        ProcedureError::Unsafe(protocol) => about(Code::UnsafeFrame).because(protocol),
        ProcedureError::Journal(_) => about(Code::Journal),
        ProcedureError::Port(_) => about(Code::Unknown),
        ProcedureError::Stopped => {
            Failure::of(lang, Code::Interrupted).because(lang.get(SettingsText::NothingWritten))
        }
    };
    failure.perhaps_acted(trouble.may_have_acted())
}

/// `9 (09h), 19200 8N1`.
pub fn placed(lang: Lang, place: BusAddress) -> String {
    let comma = lang.get(crate::texts::AppText::Comma);
    let checksum = lang.get(SettingsText::WithChecksum);
    let checksum = if place.checksum {
        format!("{comma}{checksum}")
    } else {
        String::new()
    };
    format!("{}{comma}{}{checksum}", place.address, place.serial)
}

/// `pump (EDA9060A, line main, 1 (01h), 9600 8N1)`.
fn place(lang: Lang, target: &Target, at: BusAddress) -> String {
    let comma = lang.get(crate::texts::AppText::Comma);
    let protocol = target.setup.protocol;
    format!(
        "{} ({}{comma}{}{comma}{protocol}{comma}{})",
        target.name,
        target.setup.family,
        target.line,
        placed(lang, at)
    )
}

/// Succeeds if the change did.
///
/// # Errors
/// Why it did not.
pub fn ended(lang: Lang, target: &Target, change: u64, ended: &Ended) -> Result<(), Failure> {
    let about = |code: Code, at: Option<BusAddress>| {
        let failure = Failure::of(lang, code)
            .because(place(
                lang,
                target,
                at.unwrap_or(BusAddress::of(&target.setup)),
            ))
            .with_fact("module", target.name.as_str())
            .with_fact("change", change);
        match at {
            Some(at) => failure.with_fact("address", at.address.0),
            None => failure,
        }
    };
    let perhaps = ended.may_have_acted();
    let failure = match ended {
        Ended::Same(_) | Ended::Done(_) => return Ok(()),
        Ended::Pending(found) => about(Code::AtPowerUp, Some(found.place)),
        Ended::Untold(found) => about(Code::Untold, Some(found.place)),
        Ended::Unchanged(found, why) => {
            let code = match why {
                WriteFailure::Refused(_) => Code::SettingRefused,
                WriteFailure::NoPowerCycle => Code::NoPowerCycle,
                WriteFailure::Stopped => Code::Interrupted,
                WriteFailure::Ignored | WriteFailure::NotVerified => Code::SettingIgnored,
            };
            because(lang, about(code, Some(found.place)), *why)
        }
        Ended::RolledBack(found, why) => {
            because(lang, about(Code::RolledBack, Some(found.place)), *why)
        }
        Ended::Halfway(found, why) => {
            let undo = format!("railbus config undo {change}");
            because(lang, about(Code::Halfway, Some(found.place)), *why).with_try(undo)
        }
        Ended::Lost(garbled) => {
            let failure = about(Code::Lost, None);
            match garbled {
                true => failure.because(lang.get(SettingsText::TakenGarbled)),
                false => failure,
            }
        }
    };
    Err(failure.perhaps_acted(perhaps))
}

fn because(lang: Lang, failure: Failure, why: WriteFailure) -> Failure {
    match why {
        WriteFailure::Refused(Refusal::Exception(exception)) => {
            failure.because(wire_words::exception(lang, exception))
        }
        WriteFailure::Refused(Refusal::Invalid) => failure.because("?AA"),
        WriteFailure::Refused(Refusal::WatchdogTripped) => failure.because("!"),
        WriteFailure::NotVerified => failure.because(lang.get(SettingsText::ReadsOtherwise)),
        WriteFailure::Ignored => failure.because(lang.get(SettingsText::NotAcknowledged)),
        WriteFailure::NoPowerCycle | WriteFailure::Stopped => failure,
    }
}

/// Why a word is not a valid setting of the module.
pub fn wrong(lang: Lang, target: &Target, wrong: &Wrong) -> Failure {
    let show = format!("railbus config show {}", target.name);
    match wrong {
        Wrong::NoPair(word) => Failure::of(lang, Code::Usage)
            .because(word)
            .with_try(format!("railbus config set {} address=9", target.name)),
        Wrong::NoSetting(name, known) => {
            let known = known.join(" ");
            Failure::of(lang, Code::NoSetting)
                .because(name)
                .because(lang.fill(crate::texts::AppText::Known, &[("names", &known)]))
                .with_try(show)
        }
        Wrong::ReadOnly(key, access) => Failure::of(lang, Code::SettingFixed)
            .because(format!("{key}: {}", super::plan::note(lang, *access)))
            .with_fact("setting", key.to_string())
            .with_fact("access", access.name()),
        Wrong::Value(key, value, possible) => {
            let possible = if possible.is_empty() {
                range(&target.setup, *key)
            } else {
                possible.clone()
            };
            Failure::of(lang, Code::SettingRange)
                .because(format!("{key}={value}"))
                .because(format!("{key}: {possible}"))
                .with_fact("setting", key.to_string())
        }
    }
}

/// Why a calibration stopped early.
pub fn hindered(lang: Lang, target: &Target, why: Blocker) -> Failure {
    let of = |code: Code| Failure::of(lang, code).with_fact("module", target.name.as_str());
    match why {
        Blocker::Stopped => of(Code::NotConfirmed),
        Blocker::Refused(Refusal::Exception(exception)) => {
            of(Code::SettingRefused).because(wire_words::exception(lang, exception))
        }
        Blocker::Refused(_) => of(Code::SettingRefused),
        Blocker::NotFinished => of(Code::NotCalibrated),
        Blocker::Voltage => of(Code::NotCalibrated).because(Key::CalibrationVoltage),
    }
}

/// Why the journal can't be locked.
pub fn store_failure(lang: Lang, folder: &Path, error: &std::io::Error) -> Failure {
    let code = match error.kind() {
        ErrorKind::WouldBlock => Code::JournalBusy,
        _ => Code::Journal,
    };
    let failure = Failure::of(lang, code).with_fact("folder", folder.display().to_string());
    match code {
        Code::JournalBusy => failure,
        _ => failure.because(format!("{}: {error}", folder.display())),
    }
}

/// The module has moved, and the configuration file could not be updated.
pub fn not_followed(
    lang: Lang,
    file: &Path,
    module: &str,
    place: BusAddress,
    why: &str,
) -> Failure {
    let place = placed(lang, place);
    let by_hand = lang.fill(
        SettingsText::WriteByHand,
        &[("module", &module), ("place", &place)],
    );
    Failure::of(lang, Code::ConfigNotWritten)
        .because(format!("{}: {why}", file.display()))
        .because(by_hand)
}
