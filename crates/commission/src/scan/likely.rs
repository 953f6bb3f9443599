//! The retry after an empty scan: requests to the modules that are likely to be there.

use super::Scope;
use super::ask::{PATIENCE, Question};
use railbus_wire::Micros;
use std::collections::VecDeque;

/// The requests that are sent with a long timeout if no module is found.
#[derive(Clone, Debug, Default)]
pub(super) struct Likely {
    left: VecDeque<Question>,
}

impl Likely {
    /// The likely ones in the scope that do not get a long timeout anyway, as configured modules
    /// (`early`) may, and as the first request at each speed of the `plan` does, which is repeated
    /// at the end of that speed.
    pub(super) fn of(
        scope: &Scope,
        early: &VecDeque<(Question, Micros)>,
        plan: impl Iterator<Item = Question>,
    ) -> Likely {
        let mut before = None;
        let is_first = |asked: &Question| before.replace(asked.settings) != Some(asked.settings);
        let first: Vec<Question> = plan.filter(is_first).collect();
        let mut likely = scope.likely();
        let is_early = |asked: &Question| {
            let mut early = early.iter();
            early.any(|(question, patience)| question == asked && *patience >= PATIENCE)
        };
        likely.retain(|asked| !first.contains(asked) && !is_early(asked));
        Likely {
            left: likely.into(),
        }
    }

    /// Takes the next one.
    pub(super) fn take(&mut self) -> Option<Question> {
        self.left.pop_front()
    }

    /// All remaining ones.
    pub(super) fn questions(&self) -> impl Iterator<Item = Question> {
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
