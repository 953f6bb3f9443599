//! Exclusive access to a line, for callers that change settings of modules.

use super::context::Context;
use super::schedule::STOP_MAX;
use super::state::State;
use crate::CommandError;
use crate::config::{Config, Place};
use crate::service::Update;
use railbus_host::{Fault, LineState, PortError};
use railbus_wire::Micros;
use std::sync::Arc;
use std::time::Duration;

/// The longest exclusive access; for longer ones it is requested again.
pub const LOAN_MAX: Duration = Duration::from_secs(900);
/// The shortest one that is of use: a change of one setting, and the way back.
const LOAN_MIN: Duration = Duration::from_secs(60);
/// So long before an output must be switched off it is over: a write that was begun then is still
/// verified, and the line is opened.
const SAFE: Duration = Duration::from_secs(30);

/// One exclusive access to a line; its number is never given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LoanId(pub(super) u64);

/// Exclusive access to a line that was granted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exclusive {
    pub(crate) loan: LoanId,
    /// When it is over, in the time of the site.
    pub(crate) until: Micros,
}

/// Exclusive access that is not granted yet: if that fails or the caller is gone, the line is
/// opened again.
struct Lending {
    context: Context,
    line: String,
    loan: LoanId,
    is_granted: bool,
}

impl Drop for Lending {
    fn drop(&mut self) {
        if !self.is_granted {
            let (context, line, loan) = (self.context.clone(), self.line.clone(), self.loan);
            self.context.with(|state| state.hasten_ends_of(&line));
            self.context
                .spawn(async move { context.give_back(&line, loan, None).await });
        }
    }
}

impl Context {
    /// Closes the port of a line and leaves it to the caller until [`Context::give_back`]. Pulses
    /// and leases of its outputs end before that; commands under way get a second to end.
    pub(crate) async fn lend_line(&self, line: &str) -> Result<Exclusive, CommandError> {
        let _turn = self.line_turn_if_free().await?;
        let loan = self.with(|state| {
            state.time_to_lend(line)?;
            let now = state.lines.get_mut(line).ok_or(CommandError::NoSuchLine)?;
            if now.lent.is_some() {
                return Err(CommandError::Lent);
            }
            state.newest_loan += 1;
            let loan = LoanId(state.newest_loan);
            now.lent = Some(loan);
            Ok(loan)
        })?;
        let mut lending = Lending {
            context: self.clone(),
            line: line.to_owned(),
            loan,
            is_granted: false,
        };
        let of_line = self.with(|state| state.outputs_of_line(line));
        let ends = self.end_now(|place| of_line.contains(place), STOP_MAX);
        let ended = self.unless_stopping(ends).await;
        let (turns, _) = ended.ok_or(Fault::Closed)?;
        let until = self.with(|state| {
            state.hasten_ends_of(line);
            // An output that is due may have been switched on in the meantime.
            let time = state.time_to_lend(line)?;
            state.close_lines(&[line.to_owned()]);
            if let Some(now) = state.lines.get_mut(line) {
                now.state = LineState::Absent(Arc::new(PortError::Exclusive));
            }
            let time = Micros(u64::try_from(time.as_micros()).unwrap_or(u64::MAX));
            Ok::<_, CommandError>(state.now.site + time)
        })?;
        self.closed(&[line.to_owned()]).await;
        drop(turns);
        if self.with(|state| state.is_stopping()) {
            return Err(Fault::Closed.into());
        }
        self.with(|state| {
            if let Some(now) = state.lines.get_mut(line) {
                now.was_lent = true;
            }
            state.publish(Update::Line(line.to_owned()));
        });
        lending.is_granted = true;
        Ok(Exclusive { loan, until })
    }

    /// Ends exclusive access to a line and opens it again, with another configuration if there is
    /// one: a module may have moved meanwhile. If the access has ended before, that of another
    /// caller goes on.
    pub(crate) async fn give_back(&self, line: &str, loan: LoanId, config: Option<Config>) {
        let _turn = self.line_turn().await;
        // Whoever wanted it may have gone while it was being closed.
        self.closed(&[line.to_owned()]).await;
        self.with(|state| {
            let is_ended = state.end_loan(line, loan);
            if is_ended && state.lines.get(line).is_some_and(|now| now.id.is_none()) {
                state.had_by_another(line);
            }
        });
        if let Some(config) = config
            && self.reload_in_turn(config, None).await.is_err()
        {
            // The site ends, and the modules may not be where its configuration has them.
            return;
        }
        self.with(|state| {
            let now = state.lines.get(line);
            let is_free = now.is_some_and(|now| now.id.is_none() && now.lent.is_none());
            if is_free && !state.is_closed {
                state.open_line(line);
                state.publish(Update::Line(line.to_owned()));
            }
        });
    }
}

impl State {
    /// Says whether it was that one.
    fn end_loan(&mut self, line: &str, loan: LoanId) -> bool {
        let now = self.lines.get_mut(line);
        let now = now.filter(|now| now.lent == Some(loan));
        now.map(|now| now.lent = None).is_some()
    }

    /// What was to be ended before a line is lent, and could not be, is once the line is back.
    fn hasten_ends_of(&mut self, line: &str) {
        let outputs = self.outputs_of_line(line);
        let held = self.schedule.held(|place| outputs.contains(place));
        let held: Vec<u64> = held.into_iter().map(|(number, ..)| number).collect();
        self.hasten(&held);
    }

    /// The holder of a line may have done anything to its outputs.
    fn had_by_another(&mut self, line: &str) {
        let config = Arc::clone(self.site.config());
        self.come_back(|module| {
            let module = config.modules.get(module);
            module.is_some_and(|module| module.line == line)
        });
    }

    fn outputs_of_line(&self, line: &str) -> Vec<Place> {
        let of_line = |place: &Place| {
            let module = self.site.config().modules.get(&place.module);
            module.is_some_and(|module| module.line == line)
        };
        self.outputs().into_iter().filter(of_line).collect()
    }

    /// How long a line can be lent: what its outputs have until they must be switched off.
    fn time_to_lend(&self, line: &str) -> Result<Duration, CommandError> {
        if self.is_stopping() {
            return Err(Fault::Closed.into());
        }
        let outputs = self.outputs_of_line(line);
        let limits = self.limits(|place| outputs.contains(place));
        let Some((left, place)) = limits.into_iter().min() else {
            return Ok(LOAN_MAX);
        };
        match left.checked_sub(SAFE) {
            Some(time) if time >= LOAN_MIN => Ok(time.min(LOAN_MAX)),
            _ => Err(CommandError::Due {
                path: self.site.config().path(&place),
                left: Micros(u64::try_from(left.as_micros()).unwrap_or(u64::MAX)),
            }),
        }
    }
}
