//! From TOML to a configuration, with the position of every problem.

use super::control::{Name, Pending};
use super::{
    Config, ConfigProblem, Invalid, LineConfig, ModuleConfig, Place, PointConfig, Range, SimModule,
    unpolled,
};
use railbus_bus::{EchoMode, Plan};
use railbus_device::{Family, Layout, PointKind, Setup, SetupError};
use railbus_host::LineName;
use railbus_wire::{Address, Baud, Character, Protocol, SerialSettings};
use std::collections::BTreeMap;
use std::ops::Range as Span;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

pub(super) const ROOT_KEYS: [&str; 12] = [
    "line", "module", "group", "scene", "rule", "webhook", "webhooks", "outlet", "ports", "sim",
    "history", "audit",
];
pub(super) const LINE_KEYS: [&str; 6] = ["port", "name", "baud", "format", "echo", "sim"];
pub(super) const MODULE_KEYS: [&str; 22] = [
    "line",
    "model",
    "name",
    "area",
    "address",
    "protocol",
    "baud",
    "format",
    "checksum",
    "outputs",
    "inputs",
    "variables",
    "layout",
    "invert_on_off",
    "gap",
    "poll",
    "max_age",
    "identify",
    "range",
    "point",
    "sim",
    "settings",
];
pub(super) const POINT_KEYS: [&str; 11] = [
    "name",
    "hidden",
    "range",
    "locked",
    "confirm",
    "interlock",
    "max_on",
    "min_off",
    "on_exit",
    "on_offline",
    "on_return",
];
pub(super) const NAME_KEYS: [&str; 2] = ["en", "zh"];

const ECHOES: [(&str, EchoMode); 3] = [
    ("auto", EchoMode::Auto),
    ("on", EchoMode::On),
    ("off", EchoMode::Off),
];
const LAYOUTS: [(&str, Layout); 3] = [
    ("outputs", Layout::Outputs),
    ("inputs", Layout::Inputs),
    ("mixed", Layout::Mixed),
];

pub(super) type Value<'t> = Spanned<DeValue<'t>>;

pub(super) fn read(text: &str) -> Result<Config, Vec<ConfigProblem>> {
    let mut reader = Reader {
        text,
        problems: Vec::new(),
        pending: Vec::new(),
    };
    let config = match DeTable::parse(text) {
        Ok(root) => reader.root(root.get_ref()),
        Err(error) => {
            let kind = Invalid::Syntax(error.message().to_owned());
            reader.problem(error.span().unwrap_or(0..0), "", kind);
            Config::default()
        }
    };
    reader
        .problems
        .sort_by_key(|problem| (problem.line, problem.column));
    if reader.problems.is_empty() {
        Ok(config)
    } else {
        Err(reader.problems)
    }
}

/// The line and column (from 1) of a table or key given by its path, such as `module.pump.address`,
/// or of the nearest table above it.
#[must_use]
pub fn place_of(text: &str, path: &str) -> Option<(usize, usize)> {
    let root = DeTable::parse(text).ok()?;
    let mut table = root.get_ref();
    let mut found = None;
    for word in path.split('.') {
        let Some((key, value)) = table.iter().find(|(key, _)| key.get_ref() == word) else {
            break;
        };
        found = Some(key.span());
        match value.get_ref().as_table() {
            Some(below) => table = below,
            None => break,
        }
    }
    Some(line_and_column(text, &found?))
}

pub(super) fn line_and_column(text: &str, span: &Span<usize>) -> (usize, usize) {
    let before = text.get(..span.start).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    let column = before.get(line_start..).unwrap_or_default().chars().count() + 1;
    (before.matches('\n').count() + 1, column)
}

pub(super) struct Reader<'t> {
    text: &'t str,
    problems: Vec<ConfigProblem>,
    pub(super) pending: Vec<Pending>,
}

/// One table.
pub(super) struct Section<'r, 't> {
    pub(super) path: String,
    pub(super) span: Span<usize>,
    pub(super) table: &'r DeTable<'t>,
}

impl<'r, 't> Section<'r, 't> {
    pub(super) fn of(path: String, value: &Value<'t>, table: &'r DeTable<'t>) -> Self {
        let span = value.span();
        Section { path, span, table }
    }

    /// The position of a key's value, or of the table if the key is missing.
    pub(super) fn place_of(&self, key: &str) -> Span<usize> {
        let value = self.table.get(key);
        value.map_or_else(|| self.span.clone(), Spanned::span)
    }
}

impl<'t> Reader<'t> {
    pub(super) fn problem(&mut self, span: Span<usize>, path: &str, kind: Invalid) {
        let (line, column) = line_and_column(self.text, &span);
        self.problems.push(ConfigProblem {
            line,
            column,
            path: path.to_owned(),
            kind,
        });
    }

    fn root(&mut self, root: &DeTable<'t>) -> Config {
        let mut config = Config::default();
        // A line with problems is still known by name, for the modules that refer to it.
        let mut lines = BTreeMap::new();
        for (key, value) in root {
            match key.get_ref().as_ref() {
                "line" => {
                    let mut taken = BTreeMap::new();
                    self.named(value, "line", |reader, name, section| {
                        let (path, port_at) = (section.path.clone(), section.place_of("port"));
                        if let Some(sim) = reader.sim_line(&section) {
                            config.plant.lines.insert(name.clone(), sim);
                        }
                        let line = reader.line(section);
                        let serial = line
                            .as_ref()
                            .map_or(SerialSettings::FACTORY, |line| line.serial);
                        lines.insert(name.clone(), serial);
                        if let Some(line) = line {
                            if let Some(other) = taken.insert(line.port.clone(), name.clone()) {
                                let path = format!("{path}.port");
                                reader.problem(port_at, &path, Invalid::PortTaken(other));
                            }
                            config.lines.insert(name, line);
                        }
                    });
                }
                // Read below, once lines and modules are known.
                "module" | "group" | "scene" | "rule" | "webhook" | "webhooks" | "outlet"
                | "ports" => {}
                "sim" => {
                    let _ = self.sim(value, &mut config.plant);
                }
                "history" => {
                    let _ = self.history(value, &mut config.past);
                }
                "audit" => {
                    let _ = self.audit(value, &mut config.past);
                }
                other => {
                    let meant = closest(other, &ROOT_KEYS);
                    self.problem(key.span(), other, Invalid::UnknownKey(meant));
                }
            }
        }
        if let Some(modules) = root.get("module") {
            let mut taken = BTreeMap::new();
            self.named(modules, "module", |reader, name, section| {
                let address_at = section.place_of("address");
                let path = section.path.clone();
                if let Some((module, sim)) = reader.module(section, &lines) {
                    let Setup {
                        protocol, address, ..
                    } = module.setup;
                    let place = (module.line.clone(), protocol, address);
                    if let Some(other) = taken.insert(place, name.clone()) {
                        let path = format!("{path}.address");
                        reader.problem(address_at, &path, Invalid::AddressTaken(other));
                    }
                    config.plant.modules.insert(name.clone(), sim);
                    config.modules.insert(name, module);
                }
            });
        }
        self.control(root, &mut config);
        self.webhooks(root, &mut config);
        self.outlets(root, &mut config);
        self.allowed(root, &mut config);
        config
    }

    /// The tables `[kind.name]`.
    pub(super) fn named(
        &mut self,
        value: &Value<'t>,
        kind: &str,
        mut each: impl FnMut(&mut Self, String, Section<'_, 't>),
    ) {
        let Some(tables) = self.table(value, kind) else {
            return;
        };
        for (name, value) in tables {
            let path = format!("{kind}.{}", name.get_ref());
            if !is_slug(name.get_ref()) {
                self.problem(name.span(), &path, Invalid::BadName);
                continue;
            }
            if let Some(table) = self.table(value, &path) {
                let section = Section {
                    path,
                    span: value.span(),
                    table,
                };
                each(self, name.get_ref().to_string(), section);
            }
        }
    }

    pub(super) fn table<'r>(
        &mut self,
        value: &'r Value<'t>,
        path: &str,
    ) -> Option<&'r DeTable<'t>> {
        let table = value.get_ref().as_table();
        if table.is_none() {
            self.problem(value.span(), path, Invalid::WrongType("table"));
        }
        table
    }

    pub(super) fn check_keys(&mut self, section: &Section<'_, 't>, known: &[&'static str]) {
        for key in section.table.keys() {
            let name = key.get_ref().as_ref();
            if !known.contains(&name) {
                let path = format!("{}.{name}", section.path);
                self.problem(key.span(), &path, Invalid::UnknownKey(closest(name, known)));
            }
        }
    }

    fn line(&mut self, section: Section<'_, 't>) -> Option<LineConfig> {
        self.check_keys(&section, &LINE_KEYS);
        let serial = self.serial(&section, SerialSettings::FACTORY);
        let echo = self.one_of(&section, "echo", &ECHOES)?.unwrap_or_default();
        let name = self.name(&section)?;
        let port = self.required(&section, "port", |reader, value, path| {
            let port = reader.string(value, path)?;
            if let Err(why) = port.parse::<LineName>() {
                reader.problem(value.span(), path, Invalid::BadPort(why));
                return None;
            }
            Some(port)
        })?;
        Some(LineConfig {
            port,
            serial: serial?,
            echo,
            name,
        })
    }

    /// Speed and character format; by default those of the line.
    fn serial(
        &mut self,
        section: &Section<'_, 't>,
        of_line: SerialSettings,
    ) -> Option<SerialSettings> {
        let baud = match section.table.get("baud") {
            None => Some(of_line.baud),
            Some(value) => {
                let path = format!("{}.baud", section.path);
                let rate = self.integer(value, &path)?;
                let baud = u32::try_from(rate).ok().and_then(Baud::from_rate);
                if baud.is_none() {
                    self.problem(value.span(), &path, Invalid::NotOneOf(Baud::NAMES.to_vec()));
                }
                baud
            }
        };
        let character = self
            .one_of(
                section,
                "format",
                &Character::ALL.map(|format| (format.name(), format)),
            )?
            .unwrap_or(of_line.character);
        Some(SerialSettings {
            baud: baud?,
            character,
        })
    }

    fn module(
        &mut self,
        section: Section<'_, 't>,
        lines: &BTreeMap<String, SerialSettings>,
    ) -> Option<(ModuleConfig, SimModule)> {
        self.check_keys(&section, &MODULE_KEYS);
        let families = Family::ALL.map(|family| (family.name(), family));
        let line = self.required(&section, "line", Self::string);
        let of_line = line.as_ref().and_then(|name| lines.get(name));
        if let (Some(_), None, Some(value)) = (&line, of_line, section.table.get("line")) {
            self.problem(
                value.span(),
                &format!("{}.line", section.path),
                Invalid::NoSuchLine,
            );
        }
        let address = self.required(&section, "address", |reader, value, path| {
            reader.integer_in(value, path, 0, 255)
        });
        let family = match self.one_of(&section, "model", &families)? {
            Some(family) => family,
            None => {
                self.problem(
                    section.span.clone(),
                    &section.path,
                    Invalid::MissingKey("model"),
                );
                return None;
            }
        };
        let setup = Setup::new(family, Address(address? as u8));
        let of_line = *of_line?;
        let setup = self.setup(&section, setup, of_line)?;
        if let Err(error) = setup.check() {
            let key = key_of(error);
            let span = section.place_of(key);
            self.problem(
                span,
                &format!("{}.{key}", section.path),
                Invalid::Setup(error),
            );
            return None;
        }
        let points = self.points(&section, &setup);
        let sim = self.sim_module(&section, &setup);
        let plan = self.plan(&section)?;
        let range = self.range(&section)?.unwrap_or_else(Range::volts);
        let module = ModuleConfig {
            line: line?,
            setup,
            plan,
            range,
            points,
            settings: super::desired::read(self, &section, &setup),
            name: self.name(&section)?,
            area: self.optional(&section, "area", Self::string)?,
        };
        Some((module, sim?))
    }

    /// Settings that differ from the factory's.
    fn setup(
        &mut self,
        section: &Section<'_, 't>,
        factory: Setup,
        of_line: SerialSettings,
    ) -> Option<Setup> {
        let protocols = Protocol::ALL.map(|protocol| (protocol.name(), protocol));
        let protocol = self
            .one_of(section, "protocol", &protocols)?
            .unwrap_or(factory.protocol);
        let layout = self
            .one_of(section, "layout", &LAYOUTS)?
            .unwrap_or_default();
        let (outputs, inputs) = match layout {
            Layout::Inputs => (0, 32),
            Layout::Mixed => (16, 16),
            Layout::Outputs => (factory.outputs, factory.inputs),
        };
        let gap = self.duration(section, "gap")?;
        Some(Setup {
            protocol,
            serial: self.serial(section, of_line)?,
            checksum: self.boolean(section, "checksum")?,
            outputs: self.count(section, "outputs", outputs)?,
            inputs: self.count(section, "inputs", inputs)?,
            variables: self.count(section, "variables", 0)?,
            layout,
            invert_on_off: self.boolean(section, "invert_on_off")?,
            gap,
            ..factory
        })
    }

    fn plan(&mut self, section: &Section<'_, 't>) -> Option<Plan> {
        let identify = self.optional(section, "identify", Self::truth)?;
        let identify = identify.unwrap_or(true);
        let never = section
            .table
            .get("poll")
            .and_then(|value| value.get_ref().as_str());
        if never == Some("never") {
            return Some(unpolled(identify));
        }
        let standard = Plan::default();
        let interval = self.duration(section, "poll")?.unwrap_or(standard.interval);
        let max_age = self
            .duration(section, "max_age")?
            .unwrap_or(standard.max_age);
        Some(Plan {
            interval,
            max_age,
            identify,
            ..standard
        })
    }

    fn points(
        &mut self,
        section: &Section<'_, 't>,
        setup: &Setup,
    ) -> BTreeMap<railbus_device::Point, PointConfig> {
        let mut points = BTreeMap::new();
        let path = format!("{}.point", section.path);
        let Some(value) = section.table.get("point") else {
            return points;
        };
        let Some(tables) = self.table(value, &path) else {
            return points;
        };
        for (label, value) in tables {
            let path = format!("{path}.{}", label.get_ref());
            let Some(point) = setup.point(label.get_ref()) else {
                self.problem(label.span(), &path, Invalid::NoSuchPoint);
                continue;
            };
            if let Some(table) = self.table(value, &path) {
                let section = Section {
                    path,
                    span: value.span(),
                    table,
                };
                let module = section.path.split('.').nth(1).unwrap_or_default();
                let place = Place::new(module, point);
                if let Some(config) = self.point(&section, place) {
                    points.insert(point, config);
                }
            }
        }
        points
    }

    fn point(&mut self, section: &Section<'_, 't>, place: Place) -> Option<PointConfig> {
        self.check_keys(section, &POINT_KEYS);
        let locked = self.boolean(section, "locked")?;
        let hidden = self.boolean(section, "hidden")?;
        let range = self.range(section)?;
        if range.is_some() && place.point.kind != PointKind::Analog {
            let path = format!("{}.range", section.path);
            self.problem(section.place_of("range"), &path, Invalid::UnknownKey(None));
            return None;
        }
        let Name { en, zh } = self.name(section)?;
        Some(PointConfig {
            name_en: en,
            name_zh: zh,
            hidden,
            range,
            locked,
            safety: self.safety(section, place)?,
        })
    }

    /// A display name: one text for both languages, or one for each.
    pub(super) fn name(&mut self, section: &Section<'_, 't>) -> Option<Name> {
        match section.table.get("name").map(|v| (v, v.get_ref())) {
            None => Some(Name::default()),
            Some((_, DeValue::String(name))) => Some(Name {
                en: Some(name.to_string()),
                zh: Some(name.to_string()),
            }),
            Some((value, _)) => {
                let path = format!("{}.name", section.path);
                let table = self.table(value, &path)?;
                let names = Section::of(path, value, table);
                self.check_keys(&names, &NAME_KEYS);
                Some(Name {
                    en: self.optional(&names, "en", Self::string)?,
                    zh: self.optional(&names, "zh", Self::string)?,
                })
            }
        }
    }
}

/// The key that the family's error is about.
const fn key_of(error: SetupError) -> &'static str {
    match error {
        SetupError::Address(..) => "address",
        SetupError::Protocol => "protocol",
        SetupError::Baud => "baud",
        SetupError::Character => "format",
        SetupError::Channels => "outputs",
        SetupError::Checksum => "checksum",
        SetupError::Family => "family",
    }
}

/// Whether a line, a module or an integration may have this name: 1 to 32 of `a-z`, `0-9` and `_`.
///
/// Names are used in paths on the command line, in topics, in URLs and in names of files.
#[must_use]
pub fn is_slug(name: &str) -> bool {
    let slug = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    (1..=32).contains(&name.len()) && name.chars().all(slug)
}

/// The known word nearest to an unknown one, if it is near enough.
fn closest(word: &str, known: &[&'static str]) -> Option<&'static str> {
    let distance = |other: &str| edit_distance(word, other);
    let nearest = known.iter().copied().min_by_key(|other| distance(other))?;
    (distance(nearest) <= 2.max(word.len() / 3)).then_some(nearest)
}

/// Whether a word is probably a mistyped one of another. Short words can't be judged: `k9` is not
/// taken for `k1`.
#[must_use]
pub fn resembles(word: &str, meant: &str) -> bool {
    let distance = edit_distance(word, meant);
    let longest = word.len().max(meant.len());
    longest >= 4 && distance <= 2 && distance * 2 <= word.len()
}

/// How many letters must be changed, added or removed.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, y) in b.bytes().enumerate() {
            let changed = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
