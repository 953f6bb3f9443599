//! How procedures ended, as failures in words.

use super::target::Target;
use super::texts::ConfigText;
use railbus_app::api::config_words;
use railbus_app::failure::Failure;
use railbus_app::render::wire_words;
use railbus_commission::settings::{Wrong, range};
use railbus_commission::{Ended, Place, Refused, Trouble, Why};
use railbus_device::{Refusal, SetupError};
use railbus_words::Code;
use railbus_words::Lang;

/// Why a procedure could not do what it was to.
pub(crate) fn trouble(lang: Lang, target: &Target, trouble: &Trouble) -> Failure {
    let about = |code: Code| {
        Failure::of(lang, code)
            .because(place(
                lang,
                target,
                trouble.place().unwrap_or(Place::of(&target.setup)),
            ))
            .with_fact("module", target.name.as_str())
            .with_fact("line", target.line.as_str())
    };
    let failure = match trouble {
        Trouble::NoReply(_) => about(Code::NoReply),
        Trouble::Garbled(at) => {
            let search = format!("railbus config recover --addr {}", at.address.0);
            about(Code::TwoModules).with_try(search)
        }
        Trouble::WrongModel(_, told) => {
            let failure = about(Code::WrongModel);
            match told {
                Some(name) => {
                    failure.because(lang.fill(ConfigText::CallsItself, &[("name", name)]))
                }
                None => failure.because(lang.get(ConfigText::NotAsModel)),
            }
        }
        Trouble::Refused(Refused::Setup(SetupError::Address(low, high))) => {
            about(Code::SettingRange).because(format!("address: {low}-{high}"))
        }
        Trouble::Refused(Refused::Setup(why)) => {
            about(Code::SettingRange).because(config_words::setup(lang, *why))
        }
        Trouble::Refused(Refused::NoCommand) => about(Code::SettingFixed),
        Trouble::Refused(Refused::NotReadable) => about(Code::NotReadable),
        Trouble::Taken(taken) => {
            let at = lang.fill(
                ConfigText::TakenBy,
                &[
                    ("place", &placed(lang, taken.place)),
                    ("protocol", &taken.protocol),
                    ("module", &taken.module.as_deref().unwrap_or("?")),
                ],
            );
            let failure = Failure::of(lang, Code::AddressTaken).because(at);
            let failure = match taken.garbled {
                true => failure.because(lang.get(ConfigText::TakenGarbled)),
                false => failure,
            };
            failure
                .with_fact("module", target.name.as_str())
                .with_fact("address", taken.place.address.0)
        }
        Trouble::Unsafe(protocol) => about(Code::UnsafeFrame).because(protocol),
        Trouble::Journal(_) => about(Code::Journal),
        Trouble::Port(_) => about(Code::Unknown),
        Trouble::Stopped => {
            Failure::of(lang, Code::Interrupted).because(lang.get(ConfigText::NothingWritten))
        }
    };
    failure.perhaps_acted(trouble.may_have_acted())
}

/// `9 (09h), 19200 8N1`.
pub(crate) fn placed(lang: Lang, place: Place) -> String {
    let comma = lang.get(railbus_app::texts::AppText::Comma);
    let checksum = lang.get(ConfigText::WithChecksum);
    let checksum = if place.checksum {
        format!("{comma}{checksum}")
    } else {
        String::new()
    };
    format!("{}{comma}{}{checksum}", place.address, place.serial)
}

/// `pump (EDA9060A, line main, 1 (01h), 9600 8N1)`.
fn place(lang: Lang, target: &Target, at: Place) -> String {
    let comma = lang.get(railbus_app::texts::AppText::Comma);
    let protocol = target.setup.protocol;
    format!(
        "{} ({}{comma}{}{comma}{protocol}{comma}{})",
        target.name,
        target.setup.family,
        target.line,
        placed(lang, at)
    )
}

/// Why a change did not end as it should; nothing where it did.
pub(crate) fn ended(
    lang: Lang,
    target: &Target,
    change: u64,
    ended: &Ended,
) -> Result<(), Failure> {
    let about = |code: Code, at: Option<Place>| {
        let failure = Failure::of(lang, code)
            .because(place(lang, target, at.unwrap_or(Place::of(&target.setup))))
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
                Why::Refused(_) => Code::SettingRefused,
                Why::NoPowerCycle => Code::NoPowerCycle,
                Why::Stopped => Code::Interrupted,
                Why::Ignored | Why::NotVerified => Code::SettingIgnored,
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
                true => failure.because(lang.get(ConfigText::TakenGarbled)),
                false => failure,
            }
        }
    };
    Err(failure.perhaps_acted(perhaps))
}

fn because(lang: Lang, failure: Failure, why: Why) -> Failure {
    match why {
        Why::Refused(Refusal::Exception(exception)) => {
            failure.because(wire_words::exception(lang, exception))
        }
        Why::Refused(Refusal::Invalid) => failure.because("?AA"),
        Why::Refused(Refusal::WatchdogTripped) => failure.because("!"),
        Why::NotVerified => failure.because(lang.get(ConfigText::ReadsOtherwise)),
        Why::Ignored => failure.because(lang.get(ConfigText::NotAcknowledged)),
        Why::NoPowerCycle | Why::Stopped => failure,
    }
}

/// Why a word is no setting of the module.
pub(crate) fn wrong(lang: Lang, target: &Target, wrong: &Wrong) -> Failure {
    let show = format!("railbus config show {}", target.name);
    match wrong {
        Wrong::NoPair(word) => Failure::of(lang, Code::Usage)
            .because(word)
            .with_try(format!("railbus config set {} address=9", target.name)),
        Wrong::NoSetting(name, known) => {
            let known = known.join(" ");
            Failure::of(lang, Code::NoSetting)
                .because(name)
                .because(lang.fill(railbus_app::texts::AppText::Known, &[("names", &known)]))
                .with_try(show)
        }
        Wrong::ReadOnly(key, access) => Failure::of(lang, Code::SettingFixed)
            .because(format!("{key}: {}", super::show::note(lang, *access)))
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
