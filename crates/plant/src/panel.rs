//! The front panels of the modules of a line: their true state, whatever was read over the line.

use super::orders::Directory;
use super::stage::{FaultTarget, Part, Stage};
use railbus_api::sim::{SimFaultInfo, SimLineInfo, SimModuleInfo, SimPointInfo, SimValue};
use railbus_device::{Point, PointKind};
use railbus_wire::Instant;

/// A line and everything on it.
pub(super) fn line(
    stage: &Stage,
    directory: &Directory,
    now: Instant,
    plugged: bool,
) -> SimLineInfo {
    let modules = 0..stage.parts().len();
    SimLineInfo {
        line: stage.name().to_owned(),
        baud: stage.serial().baud.rate(),
        format: stage.serial().character.to_string(),
        plugged,
        collisions: stage.line().collisions(),
        faults: faults(stage, FaultTarget::Line, now),
        modules: modules
            .map(|index| module(stage, directory, index, now))
            .collect(),
    }
}

fn module(stage: &Stage, directory: &Directory, index: usize, now: Instant) -> SimModuleInfo {
    let (line, part) = (stage.line(), &stage.parts()[index]);
    let (id, family) = (part.id(), part.setup.family);
    let sheet = family.datasheet();
    let (engine, counts) = (line.engine(id), line.counts(id));
    let active = engine.active();
    let points = part.setup.points();
    let points = points.filter_map(|at| point(stage, part, directory, at));
    SimModuleInfo {
        module: part.name.clone(),
        model: family.name().to_owned(),
        title: family.to_string(),
        address: engine.address().0,
        protocol: engine.protocol().name().to_owned(),
        baud: active.serial.baud.rate(),
        format: active.serial.character.to_string(),
        checksum: active.checksum,
        dip: sheet.dip_switch.then(|| line.dip(id)),
        init: sheet.init_pin.then(|| line.init_grounded(id)),
        powered: line.is_powered(id),
        lit: line.is_lit(id),
        replies: counts.replies,
        restarts: counts.restarts,
        points: points.collect(),
        faults: faults(stage, FaultTarget::Module(index), now),
    }
}

fn point(stage: &Stage, part: &Part, directory: &Directory, at: Point) -> Option<SimPointInfo> {
    let bit = |mask: u32| mask >> at.index & 1 == 1;
    let (kind, value) = match at.kind {
        PointKind::Output => {
            let outputs = stage.line().engine(part.id()).outputs();
            ("output", SimValue::Switch(bit(outputs)))
        }
        PointKind::Input => ("input", SimValue::Switch(bit(part.levels()))),
        PointKind::Analog => {
            let hundredths = *part.analogs().get(usize::from(at.index))?;
            ("analog", SimValue::Number(f64::from(hundredths) / 100.0))
        }
        // It is internal, not at a terminal.
        PointKind::Variable => return None,
    };
    let (letters, number) = part.setup.label(at);
    let range = directory.range(&part.name, at);
    Some(SimPointInfo {
        label: format!("{letters}{number}"),
        kind: kind.to_owned(),
        value,
        unit: range.map(|range| range.unit.clone()),
        range: range.map(|range| [range.low, range.high]),
        by_hand: part.is_by_hand(at),
        stuck: at.kind == PointKind::Output && bit(part.faults.stuck()),
    })
}

fn faults(stage: &Stage, target: FaultTarget, now: Instant) -> Vec<SimFaultInfo> {
    let told = stage.faults_of(target).told(now, stage.replies(target));
    told.map(|told| SimFaultInfo {
        fault: told.words.to_owned(),
        left_ms: told.left.map(|left| left.0.div_ceil(1_000)),
        left_replies: told.times_left,
    })
    .collect()
}
