//! The retry after an empty scan: requests to the modules that are likely to be there.

use super::Scope;
use super::ask::{PATIENCE, ScanProbe};
use railbus_wire::Micros;
use std::collections::VecDeque;

/// The requests that are sent with a long timeout if no module is found.
#[derive(Clone, Debug, Default)]
pub(super) struct Likely {
    left: VecDeque<ScanProbe>,
}

impl Likely {
    /// The likely ones in the scope that do not get a long timeout anyway, as configured modules
    /// (`early`) may, and as the first request at each speed of the `plan` does, which is repeated
    /// at the end of that speed.
    pub(super) fn of(
        scope: &Scope,
        early: &VecDeque<(ScanProbe, Micros)>,
        plan: impl Iterator<Item = ScanProbe>,
    ) -> Likely {
        let mut before = None;
        let is_first = |asked: &ScanProbe| before.replace(asked.settings) != Some(asked.settings);
        let first: Vec<ScanProbe> = plan.filter(is_first).collect();
        let mut likely = scope.likely();
        let is_early = |asked: &ScanProbe| {
            let mut early = early.iter();
            early.any(|(question, patience)| question == asked && *patience >= PATIENCE)
        };
        likely.retain(|asked| !first.contains(asked) && !is_early(asked));
        Likely {
            left: likely.into(),
        }
    }

    /// Takes the next one.
    pub(super) fn take(&mut self) -> Option<ScanProbe> {
        self.left.pop_front()
    }

    /// All remaining ones.
    pub(super) fn questions(&self) -> impl Iterator<Item = ScanProbe> {
        self.left.iter().copied()
    }

    /// Number of remaining ones.
    pub(super) fn len(&self) -> usize {
        self.left.len()
    }

    /// Time that the remaining ones take.
    pub(super) fn cost(&self) -> Micros {
        let costs = self.left.iter().map(|question| question.cost(PATIENCE));
        costs.fold(Micros::ZERO, |sum, cost| sum + cost)
    }
}
