//! The datasheets of the models, in the types of the API.

use railbus_api::models::{
    FactoryInfo, ModelInfo, ModelRegister, ModelSetting, Models, TerminalInfo,
};
use railbus_api::types::SCHEMA;
use railbus_commission::settings::{range, settings};
use railbus_device::{Family, Setup};
use railbus_words::Lang;

/// Every model that railbus knows.
#[must_use]
pub fn all(lang: Lang) -> Models {
    Models {
        schema: SCHEMA,
        models: Family::ALL.map(|family| info(lang, family)).to_vec(),
    }
}

fn info(lang: Lang, family: Family) -> ModelInfo {
    let (profile, sheet) = (family.profile(), family.datasheet());
    let new = Setup::factory(family);
    let (address_min, address_max) = profile.addresses;
    let names = |protocol: &railbus_wire::Protocol| protocol.name().to_owned();
    let stored = settings(&new)
        .into_iter()
        .map(|(key, access)| ModelSetting {
            setting: key.to_string(),
            range: range(&new, key),
            access: access.name().to_owned(),
        });
    let registers = (0..).zip(sheet.registers);
    let registers = registers.map(|(at, register)| ModelRegister {
        at,
        name: lang.of(register.name).to_owned(),
        fact: register.fact.to_owned(),
    });
    let terminals = sheet.terminals.iter().map(|terminal| TerminalInfo {
        numbers: terminal.numbers.to_owned(),
        what: lang.of(terminal.what).to_owned(),
    });
    ModelInfo {
        model: profile.name.to_owned(),
        title: lang.of(sheet.title).to_owned(),
        outputs: profile.outputs,
        inputs: profile.inputs,
        analogs: profile.analogs,
        channels_vary: sheet.channels_vary,
        address_min,
        address_max,
        protocols: profile.protocols.iter().map(names).collect(),
        bauds: profile.bauds.iter().map(|(_, baud)| baud.rate()).collect(),
        formats: profile
            .characters
            .iter()
            .map(|(_, format)| format.to_string())
            .collect(),
        gap_ms: profile.gap.map(|gap| gap.0 / 1_000),
        factory: FactoryInfo {
            address: new.address.0,
            baud: new.serial.baud.rate(),
            format: new.serial.character.to_string(),
        },
        pulses: sheet.pulses.name().to_owned(),
        calibrated: sheet.is_calibrated(),
        settings: stored.collect(),
        registers: registers.collect(),
        terminals: terminals.collect(),
        notes: sheet
            .notes
            .iter()
            .map(|note| lang.of(*note).to_owned())
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_text_is_there_in_both_languages() {
        let is_chinese = |text: &str| text.chars().any(|c| ('\u{4E00}'..'\u{A000}').contains(&c));
        for (en, zh) in all(Lang::En).models.iter().zip(&all(Lang::Zh).models) {
            let texts = |of: &ModelInfo| -> Vec<String> {
                let registers = of.registers.iter().map(|register| register.name.clone());
                of.notes.iter().cloned().chain(registers).collect()
            };
            assert!(!en.notes.is_empty());
            for (en, zh) in texts(en).iter().zip(texts(zh)) {
                assert!(!is_chinese(en) && is_chinese(&zh), "{en} / {zh}");
            }
            assert_eq!(en.settings, zh.settings);
            // Numbers of terminals name each terminal once.
            let numbers: Vec<&str> = en
                .terminals
                .iter()
                .map(|one| one.numbers.as_str())
                .collect();
            assert!(
                numbers
                    .iter()
                    .enumerate()
                    .all(|(at, one)| !numbers[..at].contains(one))
            );
        }
    }
}
