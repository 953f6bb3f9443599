//! How far a scan has got, and its statistics.

use super::ask::ProbeKind;
use railbus_wire::{Micros, SerialSettings};

/// The position of a scan: a run of its scope, and an address of that run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct ScanPosition {
    /// The run.
    pub run: usize,
    /// How many of its addresses were tried.
    pub asked: usize,
    /// The first module found replied later than the scan's timeout.
    pub slow: bool,
}

/// The statistics of a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanCounts {
    /// Frames sent.
    pub probes: usize,
    /// First requests without a reply.
    pub silent: usize,
    /// Requests left out, because another module on the line could take them for a command.
    pub skipped: usize,
}

/// The progress of a scan, for people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanProgress {
    /// First requests sent.
    pub done: usize,
    /// First questions in all.
    pub total: usize,
    /// Estimated time of the rest.
    pub left: Micros,
}

/// A part of a run that was not tried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// Speed and character format.
    pub settings: SerialSettings,
    /// The kind of request.
    pub ask: ProbeKind,
    /// The addresses.
    pub addresses: Vec<u8>,
}
