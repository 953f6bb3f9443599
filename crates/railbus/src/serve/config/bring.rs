//! What a text of the configuration may bring, and from whom: a whole text says in one go what is
//! asked for one by one elsewhere, and is held to the same. Who edits the file itself is not asked.

use super::super::access::{Caller, Role};
use super::super::order::Order;
use super::rules;
use crate::api::problem::{Problem, codes};
use railbus_site::Config;

/// Whether this text may take the place of that one.
pub(super) fn may_bring(order: &Order, before: &str, text: &str) -> Result<(), Problem> {
    // What is wrong with a text is told when it is checked.
    let Ok(new) = Config::parse(text) else {
        return Ok(());
    };
    let service = &order.site.service;
    // A file that somebody broke by hand says nothing; what is in force does.
    let old = Config::parse(before).unwrap_or_else(|_| service.config());
    administrators(&order.who, &old, &new)?;
    rules::are_tried(service, &old, &new)
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
