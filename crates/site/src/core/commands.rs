//! Recent commands, by their ids.

use railbus_store::audit::{End, Origin};
use std::collections::VecDeque;
use std::time::SystemTime;

/// How many commands are remembered.
pub const COMMANDS_KEPT: usize = 1_024;

/// A command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Command {
    /// Its number, which is that of its audit entry.
    pub id: String,
    /// When it was requested.
    pub at: SystemTime,
    /// Who requested it.
    pub origin: Origin,
    /// The module.
    pub module: String,
    /// What was requested.
    pub what: String,
    /// How it ended; none while it is in progress.
    pub end: Option<End>,
}

/// Recent commands.
#[derive(Debug, Default)]
pub(super) struct Commands(VecDeque<Command>);

impl Commands {
    pub(super) fn find(&self, id: &str) -> Option<&Command> {
        self.0.iter().rev().find(|command| command.id == id)
    }

    pub(super) fn add(&mut self, command: Command) {
        if self.0.len() >= COMMANDS_KEPT {
            self.0.pop_front();
        }
        self.0.push_back(command);
    }

    pub(super) fn end(&mut self, id: &str, end: End) {
        if let Some(command) = self.0.iter_mut().rev().find(|command| command.id == id) {
            command.end = Some(end);
        }
    }
}
