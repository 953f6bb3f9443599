//! The configurations of a site whose boards stay where they are.

use super::super::world::{Dice, Seat};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Lines and their ports.
const LINES: [(&str, &str); 3] = [
    ("far", "/dev/ttyS9"),
    ("main", "/dev/ttyS8"),
    ("spare", "/dev/ttyS7"),
];

/// What it does is told by events: the last one, when it has ended.
const RULE: &str = "[rule.watch]\nwhen = { point = \"oven.k6\", is = true }\n\
    for = \"200ms\"\narmed = true\n\
    then = [{ set = \"gate.k2\", to = true }, { set = \"oven.k6\", to = false }, \
    { notify = \"it has ended\" }]\n";

/// Which names there are, and which boards they stand for.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    lines: BTreeMap<&'static str, u32>,
    /// Line and address.
    modules: BTreeMap<&'static str, (&'static str, u8)>,
    longest: u32,
    poll: u32,
}

pub(super) fn port(line: &str) -> String {
    let found = LINES.iter().find(|(name, _)| *name == line);
    found.unwrap().1.to_owned()
}

impl Layout {
    pub(super) fn new() -> Layout {
        let modules = [
            ("oven", ("main", 3)),
            ("kiln", ("main", 4)),
            ("gate", ("main", 7)),
            ("pump", ("far", 3)),
        ];
        Layout {
            lines: BTreeMap::from([("main", 9_600), ("far", 9_600)]),
            modules: modules.into(),
            longest: 20,
            poll: 250,
        }
    }

    fn is_free(&self, line: &str, address: u8) -> bool {
        !self.modules.values().any(|at| *at == (line, address))
    }

    /// Something is another way.
    pub(super) fn change(&mut self, dice: &mut Dice) {
        let erc8 = |name: &&&str| **name != "gate";
        let names: Vec<&str> = self.modules.keys().filter(erc8).copied().collect();
        let name = names[dice.below(names.len() as u64) as usize];
        let other = names[dice.below(names.len() as u64) as usize];
        let (line, address) = self.modules[name];
        match dice.below(10) {
            // Two names are exchanged.
            0 | 1 => {
                let at = self.modules.insert(other, (line, address)).unwrap();
                self.modules.insert(name, at);
            }
            2 | 3 => {
                let vacant = 3 + dice.below(4) as u8;
                if self.is_free(line, vacant) {
                    self.modules.insert(name, (line, vacant));
                }
            }
            4 => {
                let was = self.modules.remove("kiln").map(|at| ("yard", at));
                let was = was.or_else(|| self.modules.remove("yard").map(|at| ("kiln", at)));
                self.modules.extend(was);
            }
            5 => {
                if self.modules.remove("pump").is_none() && self.lines.contains_key("far") {
                    let vacant = (3..).find(|at| self.is_free("far", *at)).unwrap();
                    self.modules.insert("pump", ("far", vacant));
                }
            }
            6 => {
                let line = ["far", "spare"][dice.below(2) as usize];
                if self.lines.remove(line).is_some() {
                    self.modules
                        .retain(|name, at| at.0 != line || *name == "oven");
                    if self.modules["oven"].0 == line {
                        let vacant = (3..).find(|at| self.is_free("main", *at)).unwrap();
                        self.modules.insert("oven", ("main", vacant));
                    }
                } else {
                    self.lines.insert(line, 9_600);
                    if line == "spare" && !self.modules.contains_key("attic") {
                        self.modules.insert("attic", ("spare", 3));
                    }
                }
            }
            7 => {
                // Its line is closed and opened.
                let baud = self.lines.get_mut(line).unwrap();
                *baud = 28_800 - *baud;
            }
            8 => self.longest = 30 - self.longest,
            _ => self.poll = 500 - self.poll,
        }
    }

    /// Whether the names of a line stand for the same boards.
    pub(super) fn is_alike(&self, other: &Layout, line: &str) -> bool {
        let of_line = |layout: &Layout| {
            let modules = layout.modules.clone().into_iter();
            modules.filter(|(_, at)| at.0 == line).collect::<Vec<_>>()
        };
        of_line(self) == of_line(other)
            && self.lines.contains_key(line) == other.lines.contains_key(line)
    }

    /// A module of a line gets a vacant address; from where to where it moves.
    pub(super) fn move_one(&mut self, line: &str, dice: &mut Dice) -> Option<(Seat, Seat)> {
        let of_line = self
            .modules
            .iter()
            .filter(|(name, at)| at.0 == line && **name != "gate");
        let (name, (line, from)) = of_line.map(|(name, at)| (*name, *at)).next()?;
        let to = 3 + dice.below(4) as u8;
        if !self.is_free(line, to) {
            return None;
        }
        self.modules.insert(name, (line, to));
        Some(((port(line), from), (port(line), to)))
    }

    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        for (line, baud) in &self.lines {
            let port = port(line);
            writeln!(text, "[line.{line}]\nport = \"{port}\"\nbaud = {baud}").unwrap();
        }
        for (name, (line, address)) in &self.modules {
            let model = match *name {
                "gate" => "r55",
                _ => "erc8",
            };
            write!(
                text,
                "[module.{name}]\nline = \"{line}\"\nmodel = \"{model}\"\n"
            )
            .unwrap();
            writeln!(text, "address = {address}").unwrap();
            if *name == "gate" {
                writeln!(text, "baud = 9600").unwrap();
            }
            if *name == "kiln" {
                writeln!(text, "poll = \"{}ms\"", self.poll).unwrap();
            }
        }
        let longest = self.longest;
        let oven = "k1.interlock = [\"oven.k2\"]\nk2.interlock = [\"oven.k1\"]\n\
                    k4.min_off = \"5s\"\nk5.on_return = \"off\"\n";
        write!(
            text,
            "[module.oven.point]\n{oven}k3.max_on = \"{longest}s\"\n"
        )
        .unwrap();
        let some = ["oven.k6", "kiln.k1", "pump.k2"].into_iter();
        let there = |path: &&str| self.modules.contains_key(path.split('.').next().unwrap());
        let some: Vec<&str> = some.filter(there).collect();
        writeln!(text, "[group.all]\nmembers = {some:?}").unwrap();
        let set = |path: &&str| format!("{{ set = \"{path}\", to = true }}");
        let mut steps: Vec<String> = some.iter().map(set).collect();
        steps.insert(1, "{ wait = \"300ms\" }".to_owned());
        steps.push("{ set = \"oven.k4\", to = false }".to_owned());
        writeln!(text, "[scene.dusk]\nsteps = [{}]", steps.join(", ")).unwrap();
        text + RULE
    }
}
