//! The persistent state of the modules over restarts of the simulator (`--state`).

use super::stage::Stage;
use super::texts::SimText;
use railbus_app::failure::Failure;
use railbus_device::{AnalogCalibration, Eeprom, Extensions, Family, Setup};
use railbus_wire::{Address, Baud, Character, Protocol, PulseWidth, SerialSettings};
use railbus_words::Code;
use railbus_words::Lang;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// The version of the file format.
const SCHEMA: u32 = 1;
/// Maximum size of the file.
const LEN_MAX: u64 = 1 << 20;

/// The file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Form {
    schema: u32,
    modules: BTreeMap<String, Kept>,
}

/// The state of one module.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    model: String,
    address: u8,
    baud: u32,
    format: String,
    protocol: String,
    checksum: bool,
    pulse_mask: u8,
    pulse_tenths: u8,
    voltage: u16,
    zero: [i16; 2],
    span: [(u16, u16); 2],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    beyond: Option<KeptExtensions>,
}

/// The additional state of a module with functions beyond its datasheet.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptExtensions {
    watchdog_tenths: u8,
    power_on: u32,
    safe: u32,
    tripped: bool,
}

impl KeptExtensions {
    /// `None` for a module without them.
    fn of(extensions: Extensions) -> Option<KeptExtensions> {
        (extensions != Extensions::NEUTRAL).then_some(KeptExtensions {
            watchdog_tenths: extensions.watchdog,
            power_on: extensions.power_on,
            safe: extensions.safe,
            tripped: extensions.tripped,
        })
    }

    const fn extensions(&self) -> Extensions {
        Extensions {
            watchdog: self.watchdog_tenths,
            power_on: self.power_on,
            safe: self.safe,
            tripped: self.tripped,
        }
    }
}

impl Kept {
    fn of(family: Family, eeprom: &Eeprom) -> Kept {
        Kept {
            model: family.name().to_owned(),
            address: eeprom.address.0,
            baud: eeprom.serial.baud.rate(),
            format: eeprom.serial.character.to_string(),
            protocol: eeprom.protocol.name().to_owned(),
            checksum: eeprom.checksum,
            pulse_mask: eeprom.pulse_mask,
            pulse_tenths: eeprom.pulse_width.tenths(),
            voltage: eeprom.calibration.voltage,
            zero: eeprom.calibration.zero,
            span: eeprom.calibration.span,
            beyond: KeptExtensions::of(eeprom.extensions),
        }
    }

    /// `None` if no module can have this state.
    fn eeprom(&self) -> Option<Eeprom> {
        let mut protocols = Protocol::ALL.into_iter();
        Some(Eeprom {
            address: Address(self.address),
            serial: SerialSettings {
                baud: Baud::from_rate(self.baud)?,
                character: Character::from_name(&self.format)?,
            },
            protocol: protocols.find(|known| known.name() == self.protocol)?,
            checksum: self.checksum,
            pulse_mask: self.pulse_mask,
            pulse_width: PulseWidth::from_tenths(self.pulse_tenths)?,
            calibration: AnalogCalibration {
                voltage: self.voltage,
                zero: self.zero,
                span: self.span,
            },
            extensions: self
                .beyond
                .as_ref()
                .map_or(Extensions::NEUTRAL, KeptExtensions::extensions),
        })
    }
}

/// The file, shared by the lines.
#[derive(Clone, Debug)]
pub(super) struct Store {
    path: PathBuf,
    form: Arc<Mutex<Form>>,
}

impl Store {
    /// Reads the file, if there is one.
    pub(super) fn open(lang: Lang, path: &Path) -> Result<Store, Failure> {
        let form = read(path).map_err(|why| bad(lang, path).because(why))?;
        Ok(Store {
            path: path.to_owned(),
            form: Arc::new(Mutex::new(form)),
        })
    }

    /// The stored state of a module, if there is one.
    pub(super) fn kept(
        &self,
        lang: Lang,
        name: &str,
        family: Family,
    ) -> Result<Option<Eeprom>, Failure> {
        let form = self.form.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(kept) = form.modules.get(name) else {
            return Ok(None);
        };
        if kept.model != family.name() {
            let why = lang.fill(SimText::OtherFamily, &[("name", &name)]);
            return Err(bad(lang, &self.path).because(why));
        }
        let eeprom = kept.eeprom().filter(|eeprom| is_possible(family, eeprom));
        match eeprom {
            Some(eeprom) => Ok(Some(eeprom)),
            None => Err(bad(lang, &self.path).because(name)),
        }
    }
}

fn is_possible(family: Family, eeprom: &Eeprom) -> bool {
    let setup = Setup {
        serial: eeprom.serial,
        protocol: eeprom.protocol,
        checksum: eeprom.checksum && eeprom.protocol == Protocol::Ascii,
        ..Setup::new(family, eeprom.address)
    };
    setup.check().is_ok()
}

fn bad(lang: Lang, path: &Path) -> Failure {
    let message = lang.fill(SimText::BadState, &[("path", &path.display())]);
    Failure::new(Code::SimState, message).with_try("railbus sim plant.toml --state ./other.json")
}

fn read(path: &Path) -> Result<Form, String> {
    let file = match std::fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Ok(Form {
                schema: SCHEMA,
                ..Form::default()
            });
        }
        Err(error) => return Err(error.to_string()),
    };
    let mut text = String::new();
    file.take(LEN_MAX)
        .read_to_string(&mut text)
        .map_err(|error| error.to_string())?;
    let form: Form = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    if form.schema != SCHEMA {
        return Err(format!("schema {}", form.schema));
    }
    Ok(form)
}

/// Stores the state of the modules of one line.
#[derive(Debug)]
pub(super) struct Keeper {
    store: Store,
    /// The last written state, in the order of the modules.
    written: Vec<Eeprom>,
}

impl Keeper {
    pub(super) const fn new(store: Store) -> Keeper {
        Keeper {
            store,
            written: Vec::new(),
        }
    }

    /// Rewrites the file if something has changed: completely or not at all.
    pub(super) fn keep(&mut self, stage: &Stage) -> io::Result<()> {
        let line = stage.line();
        let kept = || stage.parts().iter().map(|part| part.kept(line));
        if kept().eq(self.written.iter().copied()) {
            return Ok(());
        }
        self.written = kept().collect();
        let Store { path, form } = &self.store;
        let mut form = form.lock().unwrap_or_else(PoisonError::into_inner);
        for (part, eeprom) in stage.parts().iter().zip(&self.written) {
            let kept = Kept::of(part.setup.family, eeprom);
            form.modules.insert(part.name.clone(), kept);
        }
        let text = serde_json::to_string_pretty(&*form).map_err(io::Error::other)?;
        let draft = path.with_extension(format!("{}.new", std::process::id()));
        std::fs::write(&draft, text + "\n")?;
        std::fs::rename(&draft, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_survives() {
        for family in Family::ALL {
            let setup = Setup::new(family, Address(7));
            let eeprom = Eeprom {
                pulse_mask: 5,
                calibration: AnalogCalibration {
                    voltage: 432,
                    zero: [-3, 4],
                    span: [(490, 500), (510, 500)],
                },
                extensions: Extensions {
                    watchdog: 15,
                    power_on: 1,
                    safe: 2,
                    tripped: true,
                },
                ..Eeprom::of(&setup)
            };
            let kept = Kept::of(family, &eeprom);
            let text = serde_json::to_string(&kept).unwrap();
            let read: Kept = serde_json::from_str(&text).unwrap();
            assert_eq!(read.eeprom(), Some(eeprom));
            assert!(is_possible(family, &eeprom));
        }
    }

    #[test]
    fn what_no_module_can_keep_is_refused() {
        let setup = Setup::new(Family::Erc8, Address(7));
        let good = Kept::of(Family::Erc8, &Eeprom::of(&setup));
        let bad = [
            Kept {
                baud: 9_601,
                ..good.clone()
            },
            Kept {
                format: "7E1".to_owned(),
                ..good.clone()
            },
            Kept {
                pulse_tenths: 0,
                ..good.clone()
            },
        ];
        for kept in bad {
            assert_eq!(kept.eeprom(), None, "{kept:?}");
        }
        let far = Eeprom {
            address: Address(200),
            ..Eeprom::of(&setup)
        };
        assert!(!is_possible(Family::Erc8, &far));
    }
}
