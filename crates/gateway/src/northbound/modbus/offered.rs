//! Where each point stands, for other programs.

use super::map::{Content, Space, UnitMap};
use super::units;
use crate::northbound::offered::{ModbusOfferPoint, ModbusPlace, can_be_wired, shown};
use crate::northbound::outlet;
use railbus_device::{Point, PointKind};
use railbus_site::Config;
use railbus_site::config::change::Keys;

/// The points of all units that a register or bit of their own is for.
pub(crate) fn points(settings: &Keys, config: &Config) -> Vec<ModbusOfferPoint> {
    let is_uniform = units::is_uniform(settings);
    let rights = outlet::rights(settings);
    let mut all = Vec::new();
    for (unit, name) in units::units(settings, config).by_unit {
        let Some(module) = config.modules.get(&name) else {
            continue;
        };
        let map = UnitMap::of(&module.setup, is_uniform);
        for (label, point) in shown(module) {
            let Some((place, address)) = place(&map, point) else {
                continue;
            };
            let may = rights.may_switch(&name, &label).is_ok();
            all.push(ModbusOfferPoint {
                may_switch: may && place == ModbusPlace::Coil && can_be_wired(module, point),
                module: name.clone(),
                label,
                point,
                unit,
                place,
                address,
            });
        }
    }
    all
}

/// Where a point is read. Outputs are where they are switched, too; of two forms of a number it is
/// the one that needs no factor.
fn place(map: &UnitMap, point: Point) -> Option<(ModbusPlace, u16)> {
    let index = u16::from(point.index);
    let mut places = map.runs().iter().filter_map(|run| {
        let (place, at) = match (run.content, run.space) {
            (Content::Bits(kind), Space::Coils) if kind == point.kind => (ModbusPlace::Coil, index),
            (Content::Bits(kind), Space::DiscreteInputs) if kind == point.kind => {
                (ModbusPlace::DiscreteInput, index)
            }
            (Content::Raw, Space::HoldingRegisters) if point.kind == PointKind::Analog => {
                (ModbusPlace::HoldingHundredths, index)
            }
            (Content::Raw, Space::InputRegisters) if point.kind == PointKind::Analog => {
                (ModbusPlace::InputHundredths, index)
            }
            (Content::Floats, _) if point.kind == PointKind::Analog => {
                (ModbusPlace::InputFloat, 2 * index)
            }
            (Content::Numbers, _) if point.kind == PointKind::Variable => {
                (ModbusPlace::InputNumber, 2 * index)
            }
            _ => return None,
        };
        (at < run.count).then_some((place, run.start + at))
    });
    places.next()
}
