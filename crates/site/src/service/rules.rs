//! Rules, as callers see them: what they do is decided in the core.

use super::Service;
use crate::CommandError;
use crate::config::Rule;
use crate::core::RuleNow;
use crate::rules::{Deadline, Moment, Phase, Tried, try_against};
use jiff::tz::TimeZone;
use railbus_store::history::HistoryError;
use std::time::Duration;

impl Service {
    /// From now on the armed rules of the configuration act. Once is enough.
    pub fn run_rules(&self) {
        let zone = TimeZone::system();
        self.inner.change(|state| {
            let config = state.site.config();
            state.rules.start(config, zone, state.now.site);
        });
    }

    /// Rules that begin from now on have their times of day in the zone of the machine as it is.
    pub(super) fn tell_zone(&self) {
        let zone = TimeZone::system();
        self.inner.read(|state| state.rules.zone_is(zone));
    }

    /// All rules, by name.
    #[must_use]
    pub fn rules(&self) -> Vec<RuleStatus> {
        self.inner.read(|state| state.rules_now())
    }

    /// Says when a rule would have acted, from one moment to another, both in milliseconds since
    /// 1970. From then on it counts as tried.
    ///
    /// # Errors
    /// [`HistoryError`]; [`HistoryError::Closed`] where none is kept.
    pub async fn try_rule(&self, rule: &Rule, span: (i64, i64)) -> Result<Tried, HistoryError> {
        let history = self.history().ok_or(HistoryError::Closed)?;
        let tried = try_against(history, &self.config(), rule, span).await?;
        self.inner.read(|state| state.rules.tried(rule));
        Ok(tried)
    }

    /// Whether a rule that acts just so was tried since the program began.
    #[must_use]
    pub fn is_tried(&self, rule: &Rule) -> bool {
        self.inner.read(|state| state.rules.is_tried(rule))
    }

    /// A rule that was stopped begins anew.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::Limited`].
    pub fn begin_rule_anew(&self, id: &str) -> Result<(), CommandError> {
        self.who.rights.may_change_site()?;
        self.tell_zone();
        self.inner
            .change(|state| state.rules.begin_anew(id, state.now.site));
        Ok(())
    }
}

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
    pub(crate) fn of(
        id: String,
        rule: Rule,
        is_tried: bool,
        standing: Option<&RuleNow>,
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
