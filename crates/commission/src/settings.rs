//! The stored settings of modules: their values, and the words that change them. Which ones there
//! are, and which of them a command can change, is in the datasheet of the family.

pub use railbus_device::{Access, Key};

use crate::{Kept, PulseSetup};
use railbus_device::Setup;
use railbus_wire::{Address, Baud, Character, Micros, Protocol, PulseWidth};
use std::collections::BTreeMap;
use std::fmt;

/// All settings of a module, in the order in which they are shown.
#[must_use]
pub fn settings(setup: &Setup) -> Vec<(Key, Access)> {
    let all = setup.family.datasheet().settings.iter();
    all.map(|setting| (setting.key, setting.access.of(setup.protocol)))
        .collect()
}

/// The setting with that name.
#[must_use]
pub fn key(setup: &Setup, name: &str) -> Option<(Key, Access)> {
    settings(setup)
        .into_iter()
        .find(|(key, _)| key.to_string() == name)
}

/// The possible values of a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Choice {
    /// A whole number in this range, except this one.
    Number(u8, u8, Option<u8>),
    /// One of these words.
    Word(Vec<String>),
    /// A decimal number in this range, in this unit.
    Measure(&'static str, &'static str, &'static str),
}

impl fmt::Display for Choice {
    /// For people: `1-32`, `4800 9600 …`. The same in every language.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Choice::Number(low, high, Some(but)) => {
                write!(f, "{low}-{} {}-{high}", but - 1, but + 1)
            }
            Choice::Number(low, high, None) => write!(f, "{low}-{high}"),
            Choice::Word(words) => {
                let are_numbers = words.iter().all(|word| word.parse::<u32>().is_ok());
                f.write_str(&words.join(if are_numbers { " " } else { " | " }))
            }
            Choice::Measure(low, high, unit) => write!(f, "{low}-{high} {unit}"),
        }
    }
}

/// The possible values of the setting.
#[must_use]
pub fn choice(setup: &Setup, key: Key) -> Choice {
    let profile = setup.family.profile();
    let words = |words: &[&str]| Choice::Word(words.iter().map(|&word| word.to_owned()).collect());
    match key {
        Key::Address => {
            let (low, high) = addresses(setup);
            let all = setup.family.datasheet().broadcast;
            Choice::Number(low, high, all.map(|all| all.0))
        }
        Key::Baud => {
            let rates = profile.bauds.iter();
            Choice::Word(rates.map(|(_, baud)| baud.to_string()).collect())
        }
        Key::Parity => words(&["none", "odd", "even"]),
        Key::Checksum => words(&["on", "off"]),
        Key::Protocol => {
            let all = profile.protocols.iter();
            Choice::Word(all.map(|protocol| protocol.name().to_owned()).collect())
        }
        Key::Mode(_) => words(&["level", "pulse"]),
        Key::PulseWidth => Choice::Measure("0.1", "20.0", "s"),
        Key::CalibrationVoltage => Choice::Measure("0.01", "20.00", "V"),
    }
}

/// The possible values, for people: `1-32`, `4800 9600 …`. The same in every language.
#[must_use]
pub fn range(setup: &Setup, key: Key) -> String {
    choice(setup, key).to_string()
}

/// The lowest and the highest address that the module can have in its protocol: Modbus excludes 0,
/// the broadcast address [EDA §4.8].
#[must_use]
pub fn addresses(setup: &Setup) -> (u8, u8) {
    let (low, high) = setup.family.profile().addresses;
    if setup.protocol == Protocol::Rtu {
        (low.max(1), high)
    } else {
        (low, high)
    }
}

/// The value of a setting in words that are the same in every language; `None` if it is not known.
#[must_use]
pub fn shown(setup: &Setup, kept: &Kept, key: Key) -> Option<String> {
    Some(match key {
        Key::Address => kept.address?.0.to_string(),
        Key::Baud => kept.baud?.to_string(),
        Key::Parity => parity(kept.character?).to_owned(),
        Key::Checksum => if kept.checksum? { "on" } else { "off" }.to_owned(),
        Key::Protocol => setup.protocol.name().to_owned(),
        Key::Mode(channel) => {
            let pulse = kept.pulse?.mask >> channel & 1 == 1;
            if pulse { "pulse" } else { "level" }.to_owned()
        }
        Key::PulseWidth => {
            let tenths = kept.pulse?.width.tenths();
            format!("{}.{} s", tenths / 10, tenths % 10)
        }
        Key::CalibrationVoltage => {
            let hundredths = kept.voltage?;
            format!("{}.{:02} V", hundredths / 100, hundredths % 100)
        }
    })
}

/// The word for a character format; none of the five families supports two stop bits.
#[must_use]
pub const fn parity(character: Character) -> &'static str {
    match character {
        Character::N1 | Character::N2 => "none",
        Character::O1 => "odd",
        Character::E1 => "even",
    }
}

/// The requested settings of a module.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// What can be decided without reading the module.
    pub kept: Kept,
    /// Which outputs are to give pulses, or no longer.
    pub modes: BTreeMap<u8, bool>,
    /// The width of all pulses.
    pub width: Option<PulseWidth>,
}

/// Why a word is not a valid setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// Not `name=value`.
    NoPair(String),
    /// The module has no such setting; these are the ones it has.
    NoSetting(String, Vec<String>),
    /// No command can change it.
    ReadOnly(Key, Access),
    /// An impossible value; these are the possible ones.
    Value(Key, String, String),
}

impl Wanted {
    /// Parses `address=9`, `do3.mode=pulse` for this module.
    ///
    /// # Errors
    /// The first invalid word, and why.
    pub fn parse<'w>(
        setup: &Setup,
        words: impl IntoIterator<Item = &'w str>,
    ) -> Result<Wanted, Wrong> {
        let mut wanted = Wanted::default();
        for word in words {
            let (name, value) = word
                .split_once('=')
                .ok_or_else(|| Wrong::NoPair(word.to_owned()))?;
            wanted.set(setup, name, value)?;
        }
        Ok(wanted)
    }

    /// Adds one setting.
    ///
    /// # Errors
    /// Why it is not possible.
    pub fn set(&mut self, setup: &Setup, name: &str, value: &str) -> Result<(), Wrong> {
        let Some((key, access)) = key(setup, name) else {
            let known = settings(setup)
                .iter()
                .map(|(key, _)| key.to_string())
                .collect();
            return Err(Wrong::NoSetting(name.to_owned(), known));
        };
        if !access.is_writable() {
            return Err(Wrong::ReadOnly(key, access));
        }
        self.put(setup, key, value)
            .ok_or_else(|| Wrong::Value(key, value.to_owned(), range(setup, key)))
    }

    /// `None` for an impossible value.
    fn put(&mut self, setup: &Setup, key: Key, value: &str) -> Option<()> {
        let value = value.trim();
        let profile = setup.family.profile();
        match key {
            Key::Address => {
                let address = address(value)?;
                let (low, high) = addresses(setup);
                let is_broadcast = setup.family.datasheet().broadcast == Some(Address(address));
                if !(low..=high).contains(&address) || is_broadcast {
                    return None;
                }
                self.kept.address = Some(Address(address));
            }
            Key::Baud => {
                let baud = Baud::from_rate(value.parse().ok()?)?;
                profile.baud_code(baud)?;
                self.kept.baud = Some(baud);
            }
            Key::Parity => {
                let character = match value {
                    "none" | "n" | "无" => Character::N1,
                    "odd" | "o" | "奇" => Character::O1,
                    "even" | "e" | "偶" => Character::E1,
                    _ => return None,
                };
                profile.character_code(character)?;
                self.kept.character = Some(character);
            }
            Key::Checksum => self.kept.checksum = Some(switch(value)?),
            Key::Mode(channel) => {
                let pulse = match value {
                    "pulse" | "脉冲" | "点动" => true,
                    "level" | "电平" => false,
                    _ => return None,
                };
                self.modes.insert(channel, pulse);
            }
            Key::PulseWidth => self.width = Some(width(value)?),
            Key::CalibrationVoltage => self.kept.voltage = Some(voltage(value)?),
            Key::Protocol => return None,
        }
        Some(())
    }

    /// Whether nothing is requested.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Wanted::default()
    }

    /// The requested settings, now that the module's present ones are known: modes and width are a
    /// single setting to it. `None` if that would have to be known and is not.
    #[must_use]
    pub fn over(&self, known: &Kept) -> Option<Kept> {
        let mut kept = self.kept;
        if !self.modes.is_empty() || self.width.is_some() {
            let before = known.pulse?;
            let with = |mask: u8, (channel, pulse): (&u8, &bool)| {
                let bit = 1 << channel;
                if *pulse { mask | bit } else { mask & !bit }
            };
            kept.pulse = Some(PulseSetup {
                mask: self.modes.iter().fold(before.mask, with),
                width: self.width.unwrap_or(before.width),
            });
        }
        Some(kept)
    }
}

fn switch(value: &str) -> Option<bool> {
    match value {
        "on" | "true" | "1" | "开" => Some(true),
        "off" | "false" | "0" | "关" => Some(false),
        _ => None,
    }
}

/// An address as written in manuals: `10`, `0x0A`, `0Ah`.
#[must_use]
pub fn address(text: &str) -> Option<u8> {
    let hexadecimal = text
        .strip_prefix("0x")
        .or_else(|| text.strip_suffix(['h', 'H']));
    match hexadecimal {
        Some(digits) => u8::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// `0.7s`, `700ms`: the module has only whole tenths of a second [EDA9060A §3.4].
fn width(text: &str) -> Option<PulseWidth> {
    let Micros(micros) = Micros::parse(&text.replace(' ', ""))?;
    let tenths = u8::try_from(micros / 100_000).ok()?;
    (micros % 100_000 == 0)
        .then(|| PulseWidth::from_tenths(tenths))
        .flatten()
}

/// `5.00V`, `5V`, `5.00`: 0.01 to 20.00 V [EMD-2A2Q §4.5].
fn voltage(text: &str) -> Option<u16> {
    let text = text.trim_end_matches(['V', 'v']).trim_end();
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    if fraction.len() > 2 || !fraction.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let fraction: u16 = format!("{fraction:0<2}").parse().ok()?;
    let hundredths = whole
        .parse::<u16>()
        .ok()?
        .checked_mul(100)?
        .checked_add(fraction)?;
    (1..=2000).contains(&hundredths).then_some(hundredths)
}

/// The settings in which two differ, with both values in words: setting, from, to.
#[must_use]
pub fn differences(setup: &Setup, before: &Kept, after: &Kept) -> Vec<(Key, String, String)> {
    let mut found = Vec::new();
    for (key, _) in settings(setup) {
        if let Some(new) = shown(setup, after, key) {
            let old = shown(setup, before, key).unwrap_or_else(|| "?".to_owned());
            if old != new {
                found.push((key, old, new));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;

    fn parse(family: Family, words: &str) -> Result<Wanted, Wrong> {
        Wanted::parse(&Setup::new(family, Address(1)), words.split(' '))
    }

    #[test]
    fn words_are_settings_where_the_family_has_them() {
        let wanted = parse(Family::Eda9060a, "address=0Ah baud=19200 checksum=on").unwrap();
        assert_eq!(wanted.kept.address, Some(Address(10)));
        assert_eq!(wanted.kept.baud, Some(Baud::B19200));
        assert_eq!(wanted.kept.checksum, Some(true));
        let wanted = parse(Family::Eda9060a, "do3.mode=pulse pulse_width=0.7s").unwrap();
        let known = PulseSetup {
            mask: 1,
            width: PulseWidth::DEFAULT,
        };
        let known = Kept {
            pulse: Some(known),
            ..Kept::default()
        };
        let pulse = wanted.over(&known).unwrap().pulse.unwrap();
        assert_eq!((pulse.mask, pulse.width.tenths()), (9, 7));
        assert_eq!(
            wanted.over(&Kept::default()),
            None,
            "what is not known is not overwritten"
        );
        assert_eq!(
            parse(Family::Emd2a2q, "calibration_voltage=5.00V")
                .unwrap()
                .kept
                .voltage,
            Some(500)
        );
    }

    #[test]
    fn what_a_family_does_not_have_is_refused() {
        let wrong = |family, words| parse(family, words).unwrap_err();
        assert!(matches!(
            wrong(Family::Erc8, "address=33"),
            Wrong::Value(Key::Address, ..)
        ));
        assert!(matches!(wrong(Family::Erc8, "address=0"), Wrong::Value(..)));
        assert!(matches!(
            wrong(Family::Erc8, "baud=1200"),
            Wrong::Value(Key::Baud, ..)
        ));
        assert!(matches!(
            wrong(Family::R55, "address=245"),
            Wrong::Value(..)
        ));
        assert!(matches!(
            wrong(Family::R55, "baud=9600"),
            Wrong::ReadOnly(_, Access::Fixed)
        ));
        assert!(matches!(
            wrong(Family::Eda9060a, "protocol=rtu"),
            Wrong::ReadOnly(Key::Protocol, Access::MakersSoftware)
        ));
        assert!(matches!(
            wrong(Family::Eda9050, "protocol=lc02"),
            Wrong::ReadOnly(Key::Protocol, Access::InitPin)
        ));
        assert!(matches!(
            wrong(Family::Eda9050, "pulse_width=1s"),
            Wrong::NoSetting(..)
        ));
        assert!(matches!(
            wrong(Family::Eda9060a, "pulse_width=0.75s"),
            Wrong::Value(..)
        ));
        assert!(matches!(
            wrong(Family::Eda9060a, "pulse_width=20.1s"),
            Wrong::Value(..)
        ));
        assert!(matches!(
            wrong(Family::Emd2a2q, "calibration_voltage=20.01"),
            Wrong::Value(..)
        ));
        assert!(matches!(wrong(Family::Erc8, "address"), Wrong::NoPair(_)));
    }
}
