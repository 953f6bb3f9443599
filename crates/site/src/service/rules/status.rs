//! The status of a rule.

use super::Standing;
use crate::config::Rule;
use crate::rules::{Deadline, Moment, Phase};
use std::time::Duration;

/// A rule, as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct RuleStatus {
    /// Its name in the configuration.
    pub id: String,
    /// What the configuration says of it.
    pub rule: Rule,
    /// Where it is; none where it is not armed.
    pub phase: Option<Phase>,
    /// What it waits for is known.
    pub is_known: bool,
    /// How long its condition has still to hold, where it does.
    pub left: Option<Duration>,
    /// When it acts next by the clock, in milliseconds since 1970.
    pub next: Option<i64>,
    /// When it last acted since this program began, in milliseconds since 1970.
    pub last: Option<i64>,
    /// How often it did.
    pub count: u64,
    /// It was tried against the past as it is now.
    pub is_tried: bool,
}

impl RuleStatus {
    pub(super) fn of(
        id: String,
        rule: Rule,
        is_tried: bool,
        standing: Option<&Standing>,
        now: Moment,
    ) -> RuleStatus {
        let mut status = RuleStatus {
            id,
            rule,
            phase: None,
            is_known: false,
            left: None,
            next: None,
            last: None,
            count: 0,
            is_tried,
        };
        let Some(standing) = standing else {
            return status;
        };
        (status.last, status.count) = (standing.last, standing.count);
        status.is_known = standing.is_known;
        if let Some(engine) = &standing.engine {
            status.phase = Some(engine.phase());
            match engine.deadline() {
                Some(Deadline::Steady(due)) => {
                    status.left = Some(Duration::from_micros((due - now.steady).0));
                }
                Some(Deadline::Wall(due)) => status.next = Some(due),
                None => {}
            }
        }
        status
    }
}
