//! How far a scan is, and what it has done.

use super::ask::Ask;
use railbus_wire::{Micros, Settings};

/// How far a scan is: a run of its scope, and an address of that run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The run.
    pub run: usize,
    /// How many of its addresses were asked.
    pub asked: usize,
    /// The first that was found was heard later than silence is believed.
    pub slow: bool,
}

/// What a scan has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that went out.
    pub probes: usize,
    /// First questions that nobody answered.
    pub silent: usize,
    /// Questions left out, because another module on the line could take them for a command.
    pub skipped: usize,
}

/// How far a scan is, for people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// First questions asked.
    pub done: usize,
    /// First questions in all.
    pub total: usize,
    /// What the rest takes, about.
    pub left: Micros,
}

/// A part of a run that was not asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// Speed and character format.
    pub settings: Settings,
    /// What was to be asked.
    pub ask: Ask,
    /// Who was not asked.
    pub addresses: Vec<u8>,
}
