//! A module to work on, as configured.

use railbus_commission::settings::Wanted;
use railbus_commission::{
    BusAddress, Found, Neighbour, NotWritable, ProcedureError, WriteStep, stages,
};
use railbus_device::{Module, Op, Setup};
use railbus_host::LineName;
use railbus_site::Config;
use railbus_wire::Exchange;

/// A module to work on.
#[derive(Clone, Debug)]
pub struct Target {
    /// Its name.
    pub name: String,
    /// Its line.
    pub line: String,
    /// The port of that line.
    pub port: LineName,
    /// Its model and how to talk to it.
    pub setup: Setup,
    /// The other modules of the line.
    pub neighbours: Vec<Neighbour>,
}

/// Why there is no such target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoTarget {
    /// There is no module of that name.
    Module,
    /// Its line, whose name this is, has no port.
    Line(String),
}

impl Target {
    /// The module with that name.
    ///
    /// # Errors
    /// If there is no such module, or its line has no port.
    pub fn of(config: &Config, name: &str) -> Result<Target, NoTarget> {
        let module = config.modules.get(name).ok_or(NoTarget::Module)?;
        let line = config.lines.get(&module.line);
        let port = line.and_then(|line| line.port.parse().ok());
        let others = config
            .modules_of(&module.line)
            .filter(|(other, _)| *other != name);
        Ok(Target {
            name: name.to_owned(),
            line: module.line.clone(),
            port: port.ok_or_else(|| NoTarget::Line(module.line.clone()))?,
            setup: module.setup,
            neighbours: others
                .map(|(name, other)| Neighbour {
                    name: name.clone(),
                    protocol: other.setup.protocol,
                    place: BusAddress::of(&other.setup),
                })
                .collect(),
        })
    }

    /// The same module at the place where it was found.
    pub fn found(&self, found: &Found) -> Target {
        Target {
            setup: found.place.setup(&self.setup),
            ..self.clone()
        }
    }

    /// The values that a write sends.
    pub fn request(&self, stage: &WriteStep) -> Option<Exchange<'static>> {
        let module = Module::new(stage.from.setup(&self.setup)).ok()?;
        module.exchange(&Op::Configure(stage.change)).ok()
    }

    /// The writes from its present settings to the requested ones.
    ///
    /// # Errors
    /// If the requested settings are not possible, or the present ones can't be read.
    pub fn writes(&self, found: &Found, wanted: &Wanted) -> Result<Vec<WriteStep>, ProcedureError> {
        let known = found.kept();
        let kept = wanted.over(&known).ok_or(NotWritable::NotReadable)?;
        Ok(stages(&self.setup, found.place, &known, &kept)?)
    }
}
