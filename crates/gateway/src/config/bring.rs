//! What a text of the configuration may bring, and from whom: a whole text says in one go what is
//! asked for one by one elsewhere, and is held to the same. Who edits the file itself is not asked.

use super::super::access::{Caller, Known, Role};
use super::super::order::Order;
use super::super::ports;
use super::super::webhook::target;
use super::rules;
use railbus_api::problem::{Problem, codes};
use railbus_site::Config;

/// Whether a whole text may take the place of that one.
pub(super) fn may_bring(order: &Order, before: &str, text: &str) -> Result<(), Problem> {
    // What is wrong with a text is told when it is checked.
    let Ok(new) = Config::parse(text) else {
        return Ok(());
    };
    let old = known(order, before);
    administrators(&order.who, &old, &new)?;
    rules::are_tried(&order.site.service, &old, &new)
}

/// A file that somebody broke by hand says nothing; what is in force does.
fn known(order: &Order, before: &str) -> Config {
    Config::parse(before).unwrap_or_else(|_| order.site.service.config())
}

/// What only administrators say: who is told of events, and whether everything is written down.
fn administrators(who: &Caller, old: &Config, new: &Config) -> Result<(), Problem> {
    let Some(role) = who.role.filter(|role| *role < Role::Admin) else {
        return Ok(());
    };
    let theirs = |table: &String| table.starts_with("webhook.") || table == "audit";
    let mut tables = old.differences(new);
    tables.retain(theirs);
    if tables.is_empty() {
        return Ok(());
    }
    let problem = Problem::new(codes::ROLE).with("role", role.name());
    let problem = problem.with("need", Role::Admin.name());
    Err(problem.with("reason", tables.join(" ")))
}

/// Whether a change leads nowhere that the owner has not allowed. Only the owner says what is
/// allowed, by the socket or in the file.
pub(super) fn may_lead(order: &Order, before: &str, text: &str) -> Result<(), Problem> {
    if order.who.known == Known::Owner {
        return Ok(());
    }
    let Ok(new) = Config::parse(text) else {
        return Ok(());
    };
    let old = known(order, before);
    if old.allowed != new.allowed {
        return Err(Problem::new(codes::OWNER_ONLY).with("reason", "[ports] [webhooks]"));
    }
    let at_start = order.site.desk.ports_at_start();
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
    let places: Vec<_> = old
        .webhooks
        .values()
        .map(|hook| target::place(&hook.url))
        .collect();
    for hook in new.webhooks.values() {
        let place = target::place(&hook.url);
        if places.contains(&place) {
            continue;
        }
        // The address of a name is looked at when something is sent there.
        let inner = place.and_then(|(host, port)| {
            let address = target::literal(&host).filter(|address| target::is_inner(*address))?;
            Some((host, port, address))
        });
        if let Some((host, port, address)) = inner
            && !target::is_allowed(&new.allowed.webhooks, (&host, port), address)
        {
            return Err(target::refused(&host, port));
        }
    }
    Ok(())
}
