//! What a change would write, and where settings come from.

use super::target::Target;
use super::texts::SettingsText;
use railbus_commission::settings::{Access, Key, shown};
use railbus_commission::{Found, Kept, WriteStep};
use railbus_wire::{Frame, Protocol};
use railbus_words::Lang;
use railbus_words::hex;

/// The frame of a write, as in the manual.
pub fn frame(target: &Target, stage: &WriteStep) -> String {
    let mut frame = Frame::new();
    if let Some(request) = target.request(stage) {
        request.encode(&mut frame);
    }
    match target.setup.protocol {
        Protocol::Ascii => String::from_utf8_lossy(frame.bytes()).replace('\r', "<CR>"),
        _ => hex::spaced(frame.bytes()),
    }
}

/// What the change means for the line.
pub fn warnings(lang: Lang, target: &Target, stages: &[WriteStep]) -> Vec<String> {
    let (Some(first), Some(last)) = (stages.first(), stages.last()) else {
        return Vec::new();
    };
    let mut warnings = Vec::new();
    let others = |apart: &dyn Fn(&railbus_commission::Neighbour) -> bool| {
        target
            .neighbours
            .iter()
            .filter(|other| apart(other))
            .count()
    };
    let staying = others(&|other| other.place.serial != last.to.serial);
    if first.from.serial != last.to.serial && staying > 0 {
        let values: &[(&str, &dyn std::fmt::Display)] = &[
            ("count", &staying),
            ("module", &target.name),
            ("line", &target.line),
        ];
        warnings.push(lang.fill(SettingsText::TwoSpeeds, values));
    }
    let other_checksums = others(&|other| {
        other.protocol == Protocol::Ascii && other.place.checksum != last.to.checksum
    });
    if first.from.checksum != last.to.checksum && other_checksums > 0 {
        warnings.push(lang.fill(SettingsText::TwoChecksums, &[("count", &other_checksums)]));
    }
    if target.setup.protocol == Protocol::Rtu && last.to.address.0 > 247 {
        warnings.push(lang.get(SettingsText::Reserved).to_owned());
    }
    let boards = others(&|other| other.protocol == Protocol::R55);
    if last.to.address.0 == 85 && boards > 0 {
        warnings.push(lang.get(SettingsText::Address85).to_owned());
    }
    if target.setup.family.datasheet().needs_power_cycle() {
        warnings.push(lang.get(SettingsText::BoardNeedsPower).to_owned());
    }
    warnings
}

/// Whether the module reported it, or it follows from where it answers.
pub fn source(target: &Target, found: &Found, key: Key) -> &'static str {
    if key == Key::Protocol {
        "place"
    } else if shown(&target.setup, &found.told, key).is_some() {
        "module"
    } else if shown(&target.setup, &found.kept(), key).is_some() {
        "place"
    } else {
        "unknown"
    }
}

/// A setting that no frame of the module's protocol shows is not known, whatever its place is.
pub fn known(target: &Target, found: &Found) -> Kept {
    let mut kept = found.kept();
    if target.setup.protocol != Protocol::Ascii && found.told.checksum.is_none() {
        kept.checksum = None;
    }
    kept
}

/// When a setting takes effect, or why no command can change it.
pub fn note(lang: Lang, access: Access) -> &'static str {
    lang.get(match access {
        Access::Written => SettingsText::NoteWritten,
        Access::AtPowerUp => SettingsText::NoteAtPowerUp,
        Access::MakersSoftware => SettingsText::NoteMaker,
        Access::InitPin => SettingsText::NoteInit,
        Access::InAscii => SettingsText::NoteInAscii,
        Access::Fixed => SettingsText::NoteFixed,
    })
}
