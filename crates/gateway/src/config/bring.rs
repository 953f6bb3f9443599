//! What a text of the configuration may contain, depending on the caller: a whole text can do
//! everything that other routes do one by one, and needs the same permissions. Editing the file
//! itself needs none.

use super::super::access::{Caller, Known, Role};
use super::super::ports;
use super::super::site::Site;
use super::rules;
use crate::northbound;
use railbus_api::problem::{Problem, codes};
use railbus_site::Config;
use railbus_site::config::Allowed;

/// Whether a whole text may replace the present one.
pub(super) fn may_bring(
    (who, site): (&Caller, &Site),
    before: &str,
    text: &str,
) -> Result<(), Problem> {
    // Errors in the text are reported when it is checked.
    let Ok(new) = Config::parse(text) else {
        return Ok(());
    };
    let old = known(site, before);
    administrators(who, &old, &new)?;
    rules::are_tried(&site.service, &old, &new)
}

/// If the file was broken by hand, the configuration in force counts.
fn known(site: &Site, before: &str) -> Config {
    Config::parse(before).unwrap_or_else(|_| Config::clone(&site.service.config()))
}

/// What only administrators may change: outlets, and whether everything is recorded.
fn administrators(who: &Caller, old: &Config, new: &Config) -> Result<(), Problem> {
    let Some(role) = who.role.filter(|role| *role < Role::Admin) else {
        return Ok(());
    };
    let theirs = |table: &String| northbound::is_outlet(table) || table == "audit";
    let mut tables = old.differences(new);
    tables.retain(theirs);
    if tables.is_empty() {
        return Ok(());
    }
    let problem = Problem::new(codes::ROLE).with("role", role.name());
    let problem = problem.with("need", Role::Admin.name());
    Err(problem.with("reason", tables.join(" ")))
}

/// Whether a change contains only destinations that the owner has allowed. Only the owner can allow
/// more, over the socket or in the file.
pub(super) fn may_lead(
    (who, site): (&Caller, &Site),
    before: &str,
    text: &str,
) -> Result<(), Problem> {
    if who.known == Known::Owner {
        return Ok(());
    }
    let Ok(new) = Config::parse(text) else {
        return Ok(());
    };
    let old = known(site, before);
    if old.allowed != new.allowed {
        return Err(Problem::new(codes::OWNER_ONLY).with("reason", Allowed::TABLES));
    }
    let at_start = site.desk.ports_at_start();
    let is_known = |port: &String| {
        at_start.contains(port) || old.lines.values().any(|line| line.port == *port)
    };
    for (name, line) in &new.lines {
        let port = &line.port;
        if !is_known(port) && !ports::may_be_opened(&new.allowed.ports, port) {
            let problem = Problem::new(codes::PORT_NOT_ALLOWED).with("line", name.as_str());
            let problem = problem.with("port", port.as_str());
            return Err(problem.with_hint(format!("[ports] allow = [\"{port}\"]")));
        }
    }
    northbound::may_lead(&old, &new)
}
