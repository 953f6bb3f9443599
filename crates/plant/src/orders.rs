//! Commands typed at the simulator's prompt, or sent to its control socket.

use super::stage::{FaultTarget, ManualAction};
use super::texts::SimText;
use railbus_app::address;
use railbus_app::api::config_words;
use railbus_app::failure::Failure;
use railbus_device::{Datasheet, Point, PointKind, Setup};
use railbus_sim::Power;
use railbus_site::Config;
use railbus_site::config::{FaultOrder, FaultsOf, ModuleConfig, Range, Signal, parse_faults};
use railbus_words::Code;
use railbus_words::Lang;
use std::collections::BTreeMap;

/// A command.
#[derive(Clone, Debug)]
pub(super) enum Order {
    /// On one line, by its number.
    Line(usize, LineOrder),
    /// For all lines.
    All(LineOrder),
    Help,
    Quit,
}

/// A command for one line.
#[derive(Clone, Debug)]
pub(super) enum LineOrder {
    Do(usize, ManualAction),
    Faults(FaultTarget, Vec<FaultOrder>),
    Clear(FaultTarget),
    /// Only those with this specification or name.
    ClearSome(FaultTarget, String),
    ClearAll,
    /// Unplugs the adapter, or plugs it in.
    Plug(bool),
    Show(usize),
    ShowAll,
}

/// The names that commands use.
#[derive(Clone, Debug, Default)]
pub(super) struct Directory {
    /// In index order.
    pub(super) lines: Vec<String>,
    modules: BTreeMap<String, Known>,
}

/// A module by its indices.
#[derive(Clone, Debug)]
struct Known {
    line: usize,
    part: usize,
    setup: Setup,
    /// The signals at its analog inputs.
    ranges: BTreeMap<Point, Range>,
}

impl Directory {
    /// The names of a configuration: lines are sorted by name, and so are the modules of each.
    pub(super) fn of(config: &Config) -> Directory {
        let lines: Vec<String> = config.lines.keys().cloned().collect();
        let mut modules = BTreeMap::new();
        for (line, name) in lines.iter().enumerate() {
            for (part, (name, module)) in config.modules_of(name).enumerate() {
                let known = Known {
                    line,
                    part,
                    setup: module.setup,
                    ranges: ranges(module),
                };
                modules.insert(name.clone(), known);
            }
        }
        Directory { lines, modules }
    }

    /// The names of all modules.
    pub(super) fn modules(&self) -> impl Iterator<Item = &str> {
        self.modules.keys().map(String::as_str)
    }

    /// How a module is set up.
    pub(super) fn setup(&self, module: &str) -> Option<&Setup> {
        self.modules.get(module).map(|known| &known.setup)
    }

    /// The signal at an analog input; `None` for any other point.
    pub(super) fn range(&self, module: &str, point: Point) -> Option<&Range> {
        self.modules.get(module)?.ranges.get(&point)
    }

    /// Parses a list of faults.
    pub(super) fn faults(
        &self,
        lang: Lang,
        of: FaultsOf<'_>,
        text: &str,
    ) -> Result<Vec<FaultOrder>, Failure> {
        parse_faults(text, of).map_err(|why| {
            Failure::new(Code::SimOrder, config_words::fault(lang, &why))
                .with_try("railbus sim --help")
        })
    }

    /// Parses one command.
    pub(super) fn read(&self, lang: Lang, text: &str) -> Result<Order, Failure> {
        let reader = Reader {
            lang,
            directory: self,
        };
        reader.order(text.trim())
    }

    /// Parses `--fault 'pump: drop 5%'`.
    pub(super) fn read_fault(&self, lang: Lang, text: &str) -> Result<Order, Failure> {
        let reader = Reader {
            lang,
            directory: self,
        };
        let (target, faults) = text
            .split_once([':', '：'])
            .ok_or_else(|| reader.form("pump: drop 5%"))?;
        reader.fault(&format!("{} {faults}", target.trim()))
    }
}

struct Reader<'d> {
    lang: Lang,
    directory: &'d Directory,
}

/// The first word and the rest.
fn split(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim())
}

impl Reader<'_> {
    fn order(&self, text: &str) -> Result<Order, Failure> {
        if let Some((point, value)) = text.split_once('=') {
            return self.input(point.trim(), value.trim());
        }
        let (verb, rest) = split(text);
        let (name, value) = split(rest);
        match verb {
            "fault" if rest == "clear" => Ok(Order::All(LineOrder::ClearAll)),
            "fault" => self.fault(rest),
            "power" => {
                let powers = [
                    ("on", Power::On),
                    ("off", Power::Off),
                    ("cycle", Power::Cycle),
                ];
                let power = powers.into_iter().find(|(word, _)| *word == value);
                let (_, power) = power.ok_or_else(|| self.form("power pump on|off|cycle"))?;
                self.deed(name, ManualAction::Power(power))
            }
            "dip" => {
                let dip = address(value).map_err(|_| self.form("dip yard 3"))?;
                self.has(name, |sheet| sheet.dip_switch, SimText::NoDip)?;
                self.deed(name, ManualAction::Dip(dip))
            }
            "init" => {
                let grounded = switch(value).ok_or_else(|| self.form("init gate on|off"))?;
                self.has(name, |sheet| sheet.init_pin, SimText::NoInit)?;
                self.deed(name, ManualAction::Init(grounded))
            }
            "protocol" => {
                let known = self.module(name)?;
                let protocols = known.setup.family.profile().protocols;
                let found = protocols.iter().find(|known| known.name() == value);
                let deed = found.copied().map(ManualAction::Protocol).ok_or_else(|| {
                    let names: Vec<&str> = protocols.iter().map(|known| known.name()).collect();
                    self.form(&format!("protocol {name} {}", names.join("|")))
                });
                self.deed(name, deed?)
            }
            "reset" if value.is_empty() => self.deed(name, ManualAction::Reset),
            "show" if rest.is_empty() => Ok(Order::All(LineOrder::ShowAll)),
            "show" => self.show(rest),
            "help" | "?" if rest.is_empty() => Ok(Order::Help),
            "quit" | "exit" if rest.is_empty() => Ok(Order::Quit),
            _ => Err(self.wrong(SimText::NoOrder, &[("text", &text)])),
        }
    }

    fn deed(&self, name: &str, deed: ManualAction) -> Result<Order, Failure> {
        let known = self.module(name)?;
        Ok(Order::Line(known.line, LineOrder::Do(known.part, deed)))
    }

    /// Checks for something that not every family has.
    fn has(&self, name: &str, has: fn(&Datasheet) -> bool, lacks: SimText) -> Result<(), Failure> {
        match has(self.module(name)?.setup.family.datasheet()) {
            true => Ok(()),
            false => Err(self.wrong(lacks, &[("name", &name)])),
        }
    }

    fn show(&self, rest: &str) -> Result<Order, Failure> {
        let (target, line, after) = self.target(rest)?;
        match target {
            _ if !after.is_empty() => Err(self.form("show pump")),
            FaultTarget::Line => Ok(Order::Line(line, LineOrder::ShowAll)),
            FaultTarget::Module(part) => Ok(Order::Line(line, LineOrder::Show(part))),
        }
    }

    fn fault(&self, text: &str) -> Result<Order, Failure> {
        let (target, line, faults) = self.target(text)?;
        if faults == "clear" {
            return Ok(Order::Line(line, LineOrder::Clear(target)));
        }
        if let Some(words) = faults.strip_prefix("clear ") {
            let words = words.trim().to_owned();
            return Ok(Order::Line(line, LineOrder::ClearSome(target, words)));
        }
        let of = match (target, self.directory.modules.get(split(text).0)) {
            (FaultTarget::Module(_), Some(known)) => FaultsOf::Module(&known.setup),
            _ => FaultsOf::Line,
        };
        let orders = self.directory.faults(self.lang, of, faults)?;
        Ok(Order::Line(line, LineOrder::Faults(target, orders)))
    }

    /// The target, the index of the line, and the rest. If there is only one line, `line` alone
    /// refers to it.
    fn target<'t>(&self, text: &'t str) -> Result<(FaultTarget, usize, &'t str), Failure> {
        let (word, rest) = split(text);
        if word != "line" || self.directory.modules.contains_key("line") {
            let known = self.module(word)?;
            return Ok((FaultTarget::Module(known.part), known.line, rest));
        }
        let (name, after) = split(rest);
        let lines = &self.directory.lines;
        if let Some(line) = lines.iter().position(|known| known == name) {
            return Ok((FaultTarget::Line, line, after));
        }
        if lines.len() == 1 {
            return Ok((FaultTarget::Line, 0, rest));
        }
        let names = lines.join(", ");
        Err(self.wrong(SimText::WhichLine, &[("names", &names)]))
    }

    /// `pump.di1 = 1`, `tank.ai1 = 8.71 V`.
    fn input(&self, path: &str, value: &str) -> Result<Order, Failure> {
        let (name, label) = path
            .split_once('.')
            .ok_or_else(|| self.form("pump.di1 = 1"))?;
        let known = self.module(name)?;
        let point = known.setup.point(label);
        let point = point.filter(|p| matches!(p.kind, PointKind::Input | PointKind::Analog));
        let point = point.ok_or_else(|| self.wrong(SimText::NoInput, &[("path", &path)]))?;
        let range = known.ranges.get(&point);
        let unit = range.map_or("", |range| range.unit.as_str());
        let signal = match point.kind {
            _ if value == "auto" => Some(None),
            PointKind::Analog => analog(value, unit).map(|value| Some(Signal::Value(value))),
            _ => switch(value).map(|level| Some(Signal::Level(level))),
        };
        let signal = signal.ok_or_else(|| match point.kind {
            PointKind::Analog => self.form(&format!("{path} = 8.71 {unit}")),
            _ => self.form(&format!("{path} = 1")),
        })?;
        self.deed(name, ManualAction::Input(point, signal))
    }

    fn module(&self, name: &str) -> Result<&Known, Failure> {
        let modules = &self.directory.modules;
        modules.get(name).ok_or_else(|| {
            let names: Vec<&str> = modules.keys().take(12).map(String::as_str).collect();
            let mut names = names.join(", ");
            if modules.len() > 12 {
                names += " …";
            }
            self.wrong(SimText::NoModule, &[("name", &name), ("names", &names)])
        })
    }

    fn form(&self, form: &str) -> Failure {
        self.wrong(SimText::WriteSo, &[("form", &form)])
    }

    fn wrong(&self, text: SimText, values: &[(&str, &dyn std::fmt::Display)]) -> Failure {
        Failure::new(Code::SimOrder, self.lang.fill(text, values)).with_try("railbus sim --help")
    }
}

/// The signal at each analog input.
fn ranges(module: &ModuleConfig) -> BTreeMap<Point, Range> {
    let points = module.setup.points();
    let analogs = points.filter(|point| point.kind == PointKind::Analog);
    let range = |point| (point, module.range_of(point).at_terminal());
    analogs.map(range).collect()
}

/// `1`, `on`, `high` and their opposites.
fn switch(word: &str) -> Option<bool> {
    match word {
        "1" | "on" | "high" | "true" => Some(true),
        "0" | "off" | "low" | "false" => Some(false),
        _ => None,
    }
}

/// A value in hundredths: `8.71`, with or without the module's unit.
fn analog(text: &str, unit: &str) -> Option<i16> {
    let number = text.strip_suffix(unit).unwrap_or(text).trim();
    let hundredths = (number.parse::<f64>().ok()? * 100.0).round();
    (-32_768.0..=32_767.0)
        .contains(&hundredths)
        .then_some(hundredths as i16)
}

/// A point's name.
pub(super) fn path(name: &str, setup: &Setup, point: Point) -> String {
    let (letters, number) = setup.label(point);
    format!("{name}.{letters}{number}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_site::config::InjectedFault;

    fn directory(lines: &[&str]) -> Directory {
        let line = |name| format!("[line.{name}]\nport = \"pty:/tmp/{name}\"\n");
        let text: String = lines.iter().map(line).collect();
        let module = |name, model, address| {
            let line = lines[0];
            format!(
                "[module.{name}]\nline = \"{line}\"\nmodel = \"{model}\"\naddress = {address}\n"
            )
        };
        let text = text + &module("pump", "eda9060a", 1) + &module("tank", "emd2a2q", 5);
        Directory::of(&Config::parse(&text).unwrap())
    }

    fn refused(directory: &Directory, text: &str) -> String {
        match directory.read(Lang::En, text) {
            Err(failure) => {
                assert_eq!(failure.code(), Code::SimOrder);
                failure.message().to_owned()
            }
            Ok(order) => panic!("{text}: {order:?}"),
        }
    }

    #[test]
    fn what_is_no_order_is_told_with_its_remedy() {
        let one = directory(&["main"]);
        for (text, told) in [
            ("", "unknown command \"\"; try help"),
            ("frob pump", "unknown command \"frob pump\"; try help"),
            ("power pump", "write it as: power pump on|off|cycle"),
            (
                "power pmp on",
                "there is no module \"pmp\"; there are: pump, tank",
            ),
            ("dip pump x", "write it as: dip yard 3"),
            ("init pump", "write it as: init gate on|off"),
            ("dip pump 3", "pump has no DIP switch"),
            ("init tank on", "tank has no INIT* pin"),
            (
                "reset pump now",
                "unknown command \"reset pump now\"; try help",
            ),
            (
                "pump.do0 = 1",
                "pump.do0 is not an input; only inputs can be changed from outside",
            ),
            (
                "pump.di9 = 1",
                "pump.di9 is not an input; only inputs can be changed from outside",
            ),
            ("pump = 1", "write it as: pump.di1 = 1"),
            ("pump.di1 = 2", "write it as: pump.di1 = 1"),
            ("tank.ai1 = 5 mA", "write it as: tank.ai1 = 8.71 V"),
            ("tank.ai1 = nan", "write it as: tank.ai1 = 8.71 V"),
            ("fault pump drop", "write drop 5%"),
            ("protocol tank ascii", "write it as: protocol tank rtu"),
            (
                "fault pump echo",
                "\"echo\" is a fault of lines, not of modules",
            ),
            ("show pump tank", "write it as: show pump"),
        ] {
            assert_eq!(refused(&one, text), told, "{text}");
        }
        let two = directory(&["main", "yard"]);
        assert_eq!(
            refused(&two, "fault line echo"),
            "which line? there are: main, yard"
        );
    }

    #[test]
    fn a_line_may_go_unnamed_where_it_is_the_only_one() {
        let faults = |directory: &Directory, text: &str| match directory.read(Lang::En, text) {
            Ok(Order::Line(line, LineOrder::Faults(target, orders))) => {
                (line, target, orders[0].fault)
            }
            other => panic!("{text}: {other:?}"),
        };
        let one = directory(&["main"]);
        for text in ["fault line echo", "fault line main echo"] {
            assert_eq!(
                faults(&one, text),
                (0, FaultTarget::Line, InjectedFault::Echo),
                "{text}"
            );
        }
        let two = directory(&["main", "yard"]);
        let second = faults(&two, "fault line yard echo");
        assert_eq!(second, (1, FaultTarget::Line, InjectedFault::Echo));
        let module = faults(&two, "fault tank mute 10s");
        assert_eq!(module, (0, FaultTarget::Module(1), InjectedFault::Mute));
    }

    #[test]
    fn flags_say_the_same_as_the_prompt() {
        let one = directory(&["main"]);
        for text in [
            "pump: drop 5%, mute",
            "line: noise 1e-4，echo",
            "line main：echo",
        ] {
            let order = one.read_fault(Lang::En, text);
            let faults = matches!(order, Ok(Order::Line(0, LineOrder::Faults(..))));
            assert!(faults, "{text}: {order:?}");
        }
        for wrong in ["pump drop 5%", "pmp: mute", "pump: ", "pump: echo"] {
            assert!(one.read_fault(Lang::En, wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn values_of_inputs_are_read() {
        let one = directory(&["main"]);
        let signal = |text: &str| match one.read(Lang::En, text) {
            Ok(Order::Line(_, LineOrder::Do(_, ManualAction::Input(_, Some(signal))))) => signal,
            other => panic!("{text}: {other:?}"),
        };
        for text in ["pump.di1 = 1", "pump.di1=high", " pump.di1 = on "] {
            assert_eq!(signal(text), Signal::Level(true), "{text}");
        }
        for text in ["tank.ai1 = 8.71 V", "tank.ai1=8.71V", "tank.ai1 = 8.71"] {
            assert_eq!(signal(text), Signal::Value(871), "{text}");
        }
        assert_eq!(signal("tank.ai2 = -0.5"), Signal::Value(-50));
    }

    #[test]
    fn no_order_makes_it_panic() {
        let one = directory(&["main"]);
        let words = [
            "fault", "line", "main", "pump", "tank", "clear", "show", "power", "on", "dip", "256",
            "=", "pump.di1", "tank.ai1", ".", "drop", "5%", "±", "delay", "1ms±9", "，", ",",
            "for", "10s", "1e400", "-1", "é", "babble", "split", "noise", "init", "reset", "\u{0}",
        ];
        let mut state = 7usize;
        let mut next = |below: usize| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % below
        };
        for _ in 0..20_000 {
            let count = 1 + next(6);
            let text: Vec<&str> = (0..count).map(|_| words[next(words.len())]).collect();
            let _ = one.read(Lang::En, &text.join(" "));
            let _ = one.read_fault(Lang::Zh, &text.join(":"));
        }
    }
}
