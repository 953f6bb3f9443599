//! A trace in fixed columns, to be pasted into an issue.

use core::fmt;
use railbus_wire::Instant;
use std::collections::VecDeque;

/// The direction of an entry, seen from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TraceDirection {
    /// From the host to the line.
    Out,
    /// From the line to the host.
    In,
    /// From a module, or from noise, to the line.
    Talk,
    /// Not on the line: power, inputs, outputs.
    Panel,
    /// A fault was injected.
    Fault,
}

impl TraceDirection {
    const fn sign(self) -> &'static str {
        match self {
            TraceDirection::Out => "->",
            TraceDirection::In => "=>",
            TraceDirection::Talk => "<-",
            TraceDirection::Panel => "..",
            TraceDirection::Fault => "!!",
        }
    }
}

/// An entry of a trace.
#[derive(Clone, Debug)]
pub struct TraceEntry {
    at: Instant,
    since: u64,
    who: Box<str>,
    direction: TraceDirection,
    event: &'static str,
    number: Option<u64>,
    bytes: Vec<u8>,
}

impl TraceEntry {
    /// When it happened.
    #[must_use]
    pub const fn at(&self) -> Instant {
        self.at
    }

    /// The subject: `host`, `line`, or a module's name.
    #[must_use]
    pub fn who(&self) -> &str {
        &self.who
    }

    /// The direction.
    #[must_use]
    pub const fn direction(&self) -> TraceDirection {
        self.direction
    }

    /// What happened: `sends`, `hears`, `flip`, `power off` and the like.
    #[must_use]
    pub const fn event(&self) -> &'static str {
        self.event
    }

    /// The characters, if it is about characters.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl fmt::Display for TraceEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:>12} {:>9}  {:<10} {} {}",
            self.at.0,
            self.since,
            self.who,
            self.direction.sign(),
            self.event
        )?;
        let mut width = self.event.len();
        if let Some(number) = self.number {
            let digits = number.checked_ilog10().unwrap_or(0) as usize + 1;
            width += digits + 1;
            write!(f, " {number}")?;
        }
        if !self.bytes.is_empty() {
            write!(f, "{:1$}", "", 14usize.saturating_sub(width))?;
        }
        for byte in &self.bytes {
            write!(f, " {byte:02X}")?;
        }
        Ok(())
    }
}

/// The most recent events of a line.
#[derive(Clone, Debug)]
pub struct Trace {
    entries: VecDeque<TraceEntry>,
    limit: usize,
    last: Instant,
    /// How many entries were dropped for newer ones.
    dropped: u64,
}

impl Trace {
    /// A trace of this many entries.
    pub(crate) const fn new(limit: usize) -> Trace {
        Trace {
            entries: VecDeque::new(),
            limit,
            last: Instant(0),
            dropped: 0,
        }
    }

    /// The entries, oldest first.
    pub fn entries(&self) -> impl Iterator<Item = &TraceEntry> {
        self.entries.iter()
    }

    /// Removes and returns the oldest entry.
    pub fn take(&mut self) -> Option<TraceEntry> {
        self.entries.pop_front()
    }

    pub(crate) fn add(
        &mut self,
        at: Instant,
        who: &str,
        direction: TraceDirection,
        event: &'static str,
        number: Option<u64>,
        bytes: &[u8],
    ) {
        if self.entries.len() == self.limit {
            self.entries.pop_front();
            self.dropped += 1;
        }
        self.entries.push_back(TraceEntry {
            at,
            since: at.since(self.last).0,
            who: who.into(),
            direction,
            event,
            number,
            bytes: bytes.to_vec(),
        });
        self.last = self.last.max(at);
    }
}

/// A heading, and one line per entry.
impl fmt::Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:>12} {:>9}  {:<10}    {:<14} BYTES",
            "TIME us", "+us", "WHO", "EVENT"
        )?;
        if self.dropped > 0 {
            writeln!(f, "{:>12} earlier entries were dropped", self.dropped)?;
        }
        for entry in &self.entries {
            writeln!(f, "{entry}")?;
        }
        Ok(())
    }
}
