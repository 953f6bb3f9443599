//! Splits a change into writes, in an order in which the module can't be lost: first what leaves it
//! at its place, then its address, then its speed, then its parity.

use super::{BusAddress, Kept};
use railbus_device::{Module, Op, SettingWrite, Setup, SetupError};
use railbus_wire::Protocol;

/// One write, and where the module answers before and after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteStep {
    /// The write itself.
    pub change: SettingWrite,
    /// The module's settings before it, and where they apply.
    pub before: Kept,
    /// Where it is before.
    pub from: BusAddress,
    /// Its settings after it.
    pub after: Kept,
    /// Where it is after.
    pub to: BusAddress,
}

/// Why settings can't be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotWritable {
    /// The model has no command for it in this protocol.
    NoCommand,
    /// No module of the model can be so.
    Setup(SetupError),
    /// The settings to be kept along with it are not known, and can't be read.
    NotReadable,
}

/// The writes that lead from a module's settings to the requested ones; none if they are equal.
///
/// # Errors
/// If one of them is not possible.
pub fn stages(
    setup: &Setup,
    place: BusAddress,
    known: &Kept,
    wanted: &Kept,
) -> Result<Vec<WriteStep>, NotWritable> {
    let ascii = setup.protocol == Protocol::Ascii;
    // Only ASCII frames carry a checksum, and only they can turn it on or off.
    let wanted = &Kept {
        checksum: wanted.checksum.filter(|_| ascii),
        ..*wanted
    };
    let target = wanted.place(place);
    let there = target.setup(setup);
    there.check().map_err(NotWritable::Setup)?;
    let mut changes = Vec::new();
    if let (Some(pulse), true) = (wanted.pulse, wanted.pulse != known.pulse) {
        changes.push(SettingWrite::Pulse {
            mask: pulse.mask,
            width: pulse.width,
        });
    }
    if let (Some(voltage), true) = (wanted.voltage, wanted.voltage != known.voltage) {
        changes.push(SettingWrite::CalibrationVoltage(voltage));
    }
    changes.extend(serial(setup, place, target));
    let mut stages: Vec<WriteStep> = Vec::new();
    for change in changes {
        let (before, from) = stages
            .last()
            .map_or((known.or(Kept::at(place)), place), |last| {
                (last.after, last.to)
            });
        let mut after = applied(setup, change, before);
        let mut to = after.place(from);
        if !ascii {
            after.checksum = before.checksum;
            to.checksum = from.checksum;
        }
        let module = Module::new(from.setup(setup)).map_err(NotWritable::Setup)?;
        module
            .exchange(&Op::Configure(change))
            .map_err(|_| NotWritable::NoCommand)?;
        stages.push(WriteStep {
            change,
            before,
            from,
            after,
            to,
        });
    }
    Ok(stages)
}

/// The writes that move a module from one place to another.
fn serial(setup: &Setup, place: BusAddress, target: BusAddress) -> Vec<SettingWrite> {
    if place == target {
        return Vec::new();
    }
    if setup.family.datasheet().serial_as_one {
        return vec![SettingWrite::Serial {
            address: target.address,
            baud: target.serial.baud,
            checksum: target.checksum,
        }];
    }
    let address = SettingWrite::Address(target.address);
    let baud = SettingWrite::Baud(target.serial.baud);
    let character = SettingWrite::Character(target.serial.character);
    let wanted = [
        (target.address != place.address).then_some(address),
        (target.serial.baud != place.serial.baud).then_some(baud),
        (target.serial.character != place.serial.character).then_some(character),
    ];
    wanted.into_iter().flatten().collect()
}

/// The settings of a module after a change.
pub(crate) fn applied(setup: &Setup, change: SettingWrite, before: Kept) -> Kept {
    let mut after = before;
    match change {
        SettingWrite::Serial {
            address,
            baud,
            checksum,
        } => {
            after.address = Some(address);
            after.baud = Some(baud);
            after.checksum = Some(checksum);
        }
        SettingWrite::Address(address) => after.address = Some(address),
        SettingWrite::Baud(baud) => after.baud = Some(baud),
        SettingWrite::Character(character) => after.character = Some(character),
        SettingWrite::Pulse { mask, width } => {
            after.pulse = Some(super::PulseSetup { mask, width })
        }
        SettingWrite::CalibrationVoltage(voltage) => after.voltage = Some(voltage),
        SettingWrite::CalibrateZero | SettingWrite::CalibrateSpan => {}
        SettingWrite::Restore => {
            after = Kept {
                voltage: setup.family.datasheet().factory.voltage,
                ..Kept::at(BusAddress::of(&Setup::factory(setup.family)))
            };
        }
    }
    after
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;
    use railbus_wire::{Address, Baud, Character};

    fn wanted() -> Kept {
        Kept {
            address: Some(Address(9)),
            baud: Some(Baud::B19200),
            ..Kept::default()
        }
    }

    #[test]
    fn eda_modules_take_address_and_speed_in_one_frame() {
        for protocol in [Protocol::Ascii, Protocol::Lc02, Protocol::Rtu] {
            let setup = Setup {
                protocol,
                ..Setup::new(Family::Eda9050, Address(1))
            };
            let place = BusAddress::of(&setup);
            let stages = stages(&setup, place, &Kept::at(place), &wanted()).unwrap();
            assert_eq!(stages.len(), 1);
            assert_eq!(stages[0].to.address, Address(9));
            assert_eq!(stages[0].to.serial.baud, Baud::B19200);
        }
    }

    #[test]
    fn the_others_take_the_address_first() {
        let setup = Setup::new(Family::Erc8, Address(1));
        let place = BusAddress::of(&setup);
        let wanted = Kept {
            character: Some(Character::E1),
            ..wanted()
        };
        let stages = stages(&setup, place, &Kept::at(place), &wanted).unwrap();
        let changes: Vec<SettingWrite> = stages.iter().map(|stage| stage.change).collect();
        let all = [
            SettingWrite::Address(Address(9)),
            SettingWrite::Baud(Baud::B19200),
            SettingWrite::Character(Character::E1),
        ];
        assert_eq!(changes, all);
        assert_eq!(stages[1].from.address, Address(9));
    }

    #[test]
    fn nothing_is_written_for_what_is_so_already() {
        let setup = Setup::new(Family::Emd2a2q, Address(1));
        let place = BusAddress::of(&setup);
        let same = Kept {
            address: Some(Address(1)),
            ..Kept::default()
        };
        assert_eq!(
            stages(&setup, place, &Kept::at(place), &same),
            Ok(Vec::new())
        );
    }

    #[test]
    fn what_no_frame_carries_is_refused() {
        let setup = Setup {
            protocol: Protocol::Lc02,
            ..Setup::new(Family::Eda9060a, Address(1))
        };
        let place = BusAddress::of(&setup);
        let wanted = Kept {
            character: Some(Character::E1),
            ..Kept::default()
        };
        let refused = stages(&setup, place, &Kept::at(place), &wanted);
        assert_eq!(refused, Err(NotWritable::Setup(SetupError::Character)));
    }
}
