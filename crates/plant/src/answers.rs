//! Executes commands on a line, and produces their answers: one line of text for each module.

use super::active_faults::Told;
use super::orders::{LineOrder, path};
use super::stage::{FaultTarget, ManualAction, Part, Stage};
use super::texts::SimText;
use railbus_device::PointKind;
use railbus_sim::Power;
use railbus_site::config::Signal;
use railbus_wire::Instant;
use railbus_words::Lang;
use railbus_words::time;

/// Executes a command, and answers.
pub(super) fn perform(
    lang: Lang,
    stage: &mut Stage,
    now: Instant,
    order: LineOrder,
) -> Vec<String> {
    match order {
        LineOrder::Do(index, deed) => {
            stage.act(now, index, deed);
            vec![done(lang, &stage.parts()[index], deed)]
        }
        LineOrder::Faults(target, orders) => {
            for order in &orders {
                stage.add_fault(now, target, order);
            }
            vec![faults_line(lang, stage, target, now)]
        }
        LineOrder::Clear(target) => {
            stage.clear_faults(now, target);
            vec![faults_line(lang, stage, target, now)]
        }
        LineOrder::ClearSome(target, words) => {
            stage.clear_some(now, target, &words);
            vec![faults_line(lang, stage, target, now)]
        }
        LineOrder::ClearAll => {
            stage.clear_all(now);
            Vec::new()
        }
        // The modules on the line are not affected.
        LineOrder::Plug(_) => Vec::new(),
        LineOrder::Show(index) => vec![show(lang, stage, index, now)],
        LineOrder::ShowAll => {
            let parts = 0..stage.parts().len();
            let modules = parts.map(|index| show(lang, stage, index, now));
            std::iter::once(show_line(lang, stage, now))
                .chain(modules)
                .collect()
        }
    }
}

fn done(lang: Lang, part: &Part, deed: ManualAction) -> String {
    let name = &part.name;
    let with = |text: SimText, value: &dyn std::fmt::Display| {
        lang.fill(text, &[("name", name), ("value", value)])
    };
    let state = |on| lang.get(if on { SimText::On } else { SimText::Off });
    match deed {
        ManualAction::Input(point, signal) => {
            let path = path(name, &part.setup, point);
            match signal {
                Some(Signal::Value(hundredths)) => format!("{path} = {}", decimal(hundredths)),
                Some(Signal::Level(high)) => {
                    let level = if high { SimText::High } else { SimText::Low };
                    format!("{path} = {}", lang.get(level))
                }
                _ => format!("{path} = auto"),
            }
        }
        ManualAction::Power(Power::On) => with(SimText::PowerIs, &state(true)),
        ManualAction::Power(Power::Off) => with(SimText::PowerIs, &state(false)),
        ManualAction::Power(Power::Cycle) => lang.fill(SimText::Cycled, &[("name", name)]),
        ManualAction::Dip(dip) => with(SimText::DipIs, &dip),
        ManualAction::Init(grounded) => {
            let pin = if grounded {
                SimText::Grounded
            } else {
                SimText::Open
            };
            with(SimText::InitIs, &lang.get(pin))
        }
        ManualAction::Protocol(protocol) => with(SimText::ProtocolIs, &protocol),
        ManualAction::Reset => lang.fill(SimText::WasReset, &[("name", name)]),
    }
}

fn faults_line(lang: Lang, stage: &Stage, target: FaultTarget, now: Instant) -> String {
    let name = match target {
        FaultTarget::Line => lang.fill(SimText::LineNamed, &[("name", &stage.name())]),
        FaultTarget::Module(index) => stage.parts()[index].name.clone(),
    };
    let faults = faults(lang, stage, target, now);
    lang.fill(SimText::FaultsOf, &[("name", &name), ("faults", &faults)])
}

fn faults(lang: Lang, stage: &Stage, target: FaultTarget, now: Instant) -> String {
    let words: Vec<String> = stage
        .faults_of(target)
        .told(now, stage.replies(target))
        .map(
            |Told {
                 words,
                 left,
                 times_left,
             }| {
                let left = left.map(|left| time::duration(lang, left.0.div_ceil(1_000)));
                match left.or(times_left.map(|times| format!("{times}x"))) {
                    None => words.to_owned(),
                    Some(left) => lang.fill(SimText::Left, &[("words", &words), ("left", &left)]),
                }
            },
        )
        .collect();
    if words.is_empty() {
        return lang.get(SimText::None).to_owned();
    }
    words.join(", ")
}

/// The state of a line: settings, counters, faults.
fn show_line(lang: Lang, stage: &Stage, now: Instant) -> String {
    let line = stage.line();
    let faults = faults(lang, stage, FaultTarget::Line, now);
    let name = lang.fill(SimText::LineNamed, &[("name", &stage.name())]);
    lang.fill(
        SimText::ShowLine,
        &[
            ("name", &name),
            ("serial", &stage.serial()),
            ("collisions", &line.collisions()),
            ("injected", &line.injected().total()),
            ("faults", &faults),
        ],
    )
}

/// The state of a module: settings, power, points, LED, counters, faults.
fn show(lang: Lang, stage: &Stage, index: usize, now: Instant) -> String {
    let part = &stage.parts()[index];
    let line = stage.line();
    let (engine, counts) = (line.engine(part.id()), line.counts(part.id()));
    let setup = &part.setup;
    let (active, kept) = (engine.active(), engine.eeprom());
    let state = |on| lang.get(if on { SimText::On } else { SimText::Off });
    let mut parts = vec![format!(
        "{}: {} {} {} {}",
        part.name,
        setup.family,
        engine.address(),
        engine.protocol(),
        active.serial
    )];
    if active.checksum {
        parts.push(lang.get(SimText::Checksummed).to_owned());
    }
    if (kept.address, kept.serial) != (active.address, active.serial) {
        let value = format!("{} {}", kept.address, kept.serial);
        parts.push(lang.fill(SimText::Kept, &[("value", &value)]));
    }
    let power = state(line.is_powered(part.id()));
    let mut say = |text: SimText, value: &dyn std::fmt::Display| {
        parts.push(lang.fill(text, &[("value", value)]));
    };
    say(SimText::ShowPower, &power);
    if setup.outputs > 0 {
        say(SimText::ShowOutputs, &bits(engine.outputs(), setup.outputs));
    }
    if setup.inputs > 0 {
        say(SimText::ShowInputs, &bits(part.levels(), setup.inputs));
    }
    let analogs = usize::from(setup.count(PointKind::Analog));
    if analogs > 0 {
        let shown = part.analogs();
        let values: Vec<String> = shown.iter().take(analogs).map(|v| decimal(*v)).collect();
        say(SimText::ShowAnalogs, &values.join(" "));
    }
    say(SimText::ShowLed, &state(line.is_lit(part.id())));
    say(SimText::ShowReplies, &counts.replies);
    say(SimText::ShowSaves, &counts.saves);
    say(SimText::ShowRestarts, &counts.restarts);
    say(
        SimText::ShowFaults,
        &faults(lang, stage, FaultTarget::Module(index), now),
    );
    parts.join("; ")
}

/// In the order of the terminals.
fn bits(value: u32, count: u8) -> String {
    let bit = |index| if value >> index & 1 == 1 { '1' } else { '0' };
    (0..count).map(bit).collect()
}

fn decimal(hundredths: i16) -> String {
    format!("{:.2}", f64::from(hundredths) / 100.0)
}
