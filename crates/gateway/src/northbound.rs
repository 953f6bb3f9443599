//! Integrations that publish the site to other systems: outlets. A kind of outlet is a folder
//! here, and a line of [`NORTHBOUND`].
//!
//! An outlet is configured by name, runs on a thread of its own, and gets the site in its own name
//! and with its own rights ([`outlet`]). What runs and when is decided by [`supervisor`] and done
//! by [`run`]. Routes, secrets, metrics and the form on the page are the same for every kind, and
//! made from what its line says ([`kind`]).

pub(super) mod broker;
mod clients;
mod command_end;
#[cfg(feature = "fleet")]
mod fleet;
mod kind;
mod modbus;
mod modbus_line;
mod modbus_rtu;
mod modbus_tcp;
mod mqtt;
mod network;
pub mod offered;
#[cfg(feature = "opcua")]
mod opcua;
mod outbox;
mod outlet;
pub(super) mod routes;
mod run;
mod secrets;
mod settings;
mod sparkplug;
#[cfg(test)]
mod stage;
mod supervisor;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod textline;
mod webhook;

pub(super) use run::{Northbound, OutletFigures};

pub(super) use kind::DemoOutlet;
use kind::{OutletKind, TABLE};
use railbus_api::problem::{Problem, ProblemType};
use railbus_app::api::failures::bad_config;
use railbus_site::Config;
use railbus_site::config::OUTLET_TYPE;
use railbus_words::Lang;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use supervisor::OutletId;

/// Every kind of outlet.
static NORTHBOUND: &[&OutletKind] = &[
    &webhook::KIND,
    &modbus_tcp::KIND,
    &modbus_rtu::KIND,
    &modbus_line::KIND,
    &mqtt::KIND,
    &sparkplug::KIND,
    #[cfg(feature = "opcua")]
    &opcua::KIND,
    #[cfg(feature = "fleet")]
    &fleet::KIND,
    #[cfg(test)]
    &textline::KIND,
];

/// The names of all kinds.
pub(super) fn kinds() -> impl Iterator<Item = &'static str> {
    NORTHBOUND.iter().map(|kind| kind.name)
}

/// Whether a table of the configuration, such as `outlet.plant`, is one of an outlet.
pub(super) fn is_outlet(table: &str) -> bool {
    let table = table.split_once('.').map(|(table, _)| table);
    table == Some(TABLE) || NORTHBOUND.iter().any(|kind| table == Some(kind.table))
}

/// The problem where a table of the configuration has no outlet of a name; none if no outlets
/// stand in this table.
pub(super) fn missing_in(table: &str) -> Option<ProblemType> {
    let its = NORTHBOUND.iter().find(|kind| kind.table == table);
    its.map(|kind| kind.missing)
}

/// The problem where there is no such outlet.
fn missing(id: &OutletId) -> Problem {
    let kind = of_name(id.kind).map(|kind| kind.missing);
    Problem::new(kind.unwrap_or(railbus_api::problem::codes::NO_SUCH_OUTLET))
        .with("name", id.name.as_str())
}

/// The kind of this name.
fn of_name(name: &str) -> Option<&'static OutletKind> {
    NORTHBOUND.iter().copied().find(|kind| kind.name == name)
}

/// Whether the outlets of a configuration have settings that their kinds know.
///
/// # Errors
/// Everything that is wrong, with line and column in this text.
pub(super) fn check(lang: Lang, file: &str, text: &str, config: &Config) -> Result<(), Problem> {
    match settings::check(text, config).as_slice() {
        [] => Ok(()),
        problems => Err(bad_config(lang, file, problems)),
    }
}

/// The outlets that the demo has, also as text of its configuration: those whose port is free.
pub(super) fn of_demo() -> (String, Vec<DemoOutlet>) {
    demo_where(|listen| TcpListener::bind(listen).is_ok())
}

/// The same, by where one can listen.
fn demo_where(is_free: impl Fn(SocketAddr) -> bool) -> (String, Vec<DemoOutlet>) {
    let (mut text, mut outlets) = (String::new(), Vec::new());
    for kind in NORTHBOUND {
        if let Some(demo) = kind.demo.filter(|demo| is_free(demo.listen)) {
            text += &format!(
                "\n[{TABLE}.{}]\n{OUTLET_TYPE} = \"{}\"\n",
                demo.name, kind.name
            );
            outlets.push(demo);
        }
    }
    (text, outlets)
}

/// Undoes what an outlet has left half done in this configuration file, before that is read.
///
/// # Errors
/// The disk refuses.
pub(super) fn recover(config: &Path, state: &Path) -> Result<(), Problem> {
    NORTHBOUND
        .iter()
        .try_for_each(|kind| (kind.recover)(config, state))
}

/// Whether outlets of a new configuration only lead where the owner of the daemon allows it, or
/// where they led before.
pub(super) fn may_lead(old: &Config, new: &Config) -> Result<(), Problem> {
    NORTHBOUND
        .iter()
        .try_for_each(|kind| (kind.may_lead)(old, new))
}
