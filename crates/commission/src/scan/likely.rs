//! Who is waited for where nobody was found: those that are likely to be there.

use super::Scope;
use super::ask::{PATIENCE, Question};
use railbus_wire::Micros;
use std::collections::VecDeque;

/// The questions that are asked with patience if nobody is found.
#[derive(Clone, Debug, Default)]
pub(super) struct Likely {
    left: VecDeque<Question>,
}

impl Likely {
    /// Who is likely in the scope and is not waited for anyhow: as one of the `early` may be, and
    /// as the first question at each speed of the `plan` is, which is asked once more at the end of
    /// that speed.
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

    /// The next one, which is left no more.
    pub(super) fn take(&mut self) -> Option<Question> {
        self.left.pop_front()
    }

    /// All that are left.
    pub(super) fn questions(&self) -> impl Iterator<Item = Question> {
        self.left.iter().copied()
    }

    /// How many are left.
    pub(super) fn len(&self) -> usize {
        self.left.len()
    }

    /// What those cost that are left.
    pub(super) fn cost(&self) -> Micros {
        let costs = self.left.iter().map(|question| question.cost(PATIENCE));
        costs.fold(Micros::ZERO, |sum, cost| sum + cost)
    }
}
