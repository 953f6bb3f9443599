//! Lines as they are opened, closed and changed. One procedure at a time does that, in the order
//! in which they came: nothing is opened between two steps of one that closes.

use super::context::{Context, TaskId};
use super::exclusive::LoanId;
use super::policies::EXIT_MAX;
use super::state::State;
use super::{LineId, Output};
use crate::config::Config;
use crate::service::{Busy, Update};
use crate::{BadReason, CommandError};
use railbus_host::{Fault, LineState, PortError};
use railbus_wire::Micros;
use std::collections::VecDeque;
use std::pin::pin;
use std::sync::Arc;

/// How many may wait for lines before reloads and exclusive access are refused.
pub(super) const WAITING_MAX: usize = 64;

/// Once a line is being closed, a command that was sent has ended after this time: a second, and
/// what the audit log takes.
const SENT_MAX: Micros = Micros::from_millis(1_200);

/// How a line is.
#[derive(Clone, Debug)]
pub(crate) struct LineNow {
    /// Which line it is while it is open, until its port is closed.
    pub(crate) id: Option<LineId>,
    /// It is being closed, and takes no more commands.
    pub(super) is_closing: bool,
    pub(crate) state: LineState,
    pub(crate) babble: bool,
    /// How much of its time is taken.
    pub(crate) busy: Busy,
    /// Exclusive access to it.
    pub(super) lent: Option<LoanId>,
    /// Another program has had its port since it was last open: its modules may have moved.
    pub(super) was_lent: bool,
    /// Why nothing can be known over it, as its points were last published.
    pub(super) told: Option<BadReason>,
    /// When its clock began, in the time of the site: values grow old without it, too.
    pub(crate) began: Micros,
    /// The names of its modules, by their numbers on the line; empty for those that left.
    pub(crate) modules: Vec<String>,
}

impl LineNow {
    pub(crate) fn new(config: &Config, line: &str) -> LineNow {
        LineNow {
            id: None,
            is_closing: false,
            state: LineState::Opening,
            babble: false,
            busy: Busy::default(),
            lent: None,
            was_lent: false,
            told: None,
            began: Micros::ZERO,
            modules: modules_of(config, line),
        }
    }

    /// Which line it is, where that takes commands.
    pub(crate) fn open(&self) -> Option<LineId> {
        self.id.filter(|_| !self.is_closing)
    }

    /// Why nothing can be known over it now. One that is only just being opened may have nothing
    /// to tell yet, but is no fault.
    pub(super) fn fault(&self) -> Option<BadReason> {
        match &self.state {
            _ if self.lent.is_some() => Some(BadReason::Exclusive),
            LineState::Up | LineState::Opening => None,
            LineState::Absent(why) => Some(match **why {
                PortError::Busy { .. } => BadReason::LineBusy,
                PortError::Exclusive => BadReason::Exclusive,
                _ => BadReason::LineAbsent,
            }),
            LineState::Closed => Some(BadReason::LineClosed),
        }
    }
}

fn modules_of(config: &Config, line: &str) -> Vec<String> {
    let modules = config.modules_of(line);
    modules.map(|(name, _)| name.clone()).collect()
}

/// Procedures that open and close lines, in their order: the first one has its turn.
#[derive(Debug, Default)]
pub(super) struct LineTurns {
    newest: u64,
    queue: VecDeque<(u64, TaskId)>,
}

/// The turn of a procedure that opens and closes lines, or its place in the queue, until this is
/// dropped.
pub(super) struct LineTurn {
    context: Context,
    number: u64,
}

impl Drop for LineTurn {
    fn drop(&mut self) {
        self.context.with(|state| {
            let queue = &mut state.line_turns.queue;
            queue.retain(|(number, _)| *number != self.number);
            if let Some((_, task)) = queue.front() {
                state.runs.wake(*task);
            }
        });
    }
}

impl Context {
    /// Waits until no other procedure opens or closes lines.
    pub(super) async fn line_turn(&self) -> LineTurn {
        let number = self.with(|state| {
            let turns = &mut state.line_turns;
            turns.newest += 1;
            turns.queue.push_back((turns.newest, state.runs.current));
            turns.newest
        });
        let turn = LineTurn {
            context: self.clone(),
            number,
        };
        self.wait(|state| {
            let first = state.line_turns.queue.front();
            first
                .is_none_or(|(first, _)| *first == number)
                .then_some(())
        })
        .await;
        turn
    }

    /// The same where the queue is not full.
    ///
    /// # Errors
    /// [`Fault::Overloaded`].
    pub(super) async fn line_turn_if_free(&self) -> Result<LineTurn, CommandError> {
        if self.with(|state| state.line_turns.queue.len() >= WAITING_MAX) {
            return Err(Fault::Overloaded.into());
        }
        Ok(self.line_turn().await)
    }

    /// Waits until the ports of lines that are being closed are free.
    pub(super) async fn closed(&self, lines: &[String]) {
        let is_closing = |state: &State, line: &String| {
            let line = state.lines.get(line);
            line.is_some_and(|line| line.is_closing)
        };
        self.wait_in(
            |state| &mut state.opening,
            |state| !lines.iter().any(|line| is_closing(state, line)),
        )
        .await;
    }

    /// Waits until the port of a line is open, or could not be opened once.
    pub(crate) async fn opened(&self, line: &str) {
        let is_opened = |state: &mut State| state.is_line_opened(line);
        self.wait_in(|state| &mut state.opening, is_opened).await;
    }

    /// Ends the site: pulses and leases, then the outputs with a policy for that, then its lines.
    /// Lines are not opened any more.
    ///
    /// A reload or loan that has not closed a line yet gives up at the first step of this. One that
    /// has is waited for side by side with the ends of pulses and leases: a line closes within a
    /// second, and then names stand for the boards at which the policies are to be done. If that
    /// takes longer, because a port hangs, the process has to end in time all the same, and
    /// [`State::tell_not_exited`] reports what could not be done.
    pub(crate) async fn close_site(&self) {
        if self.with(|state| state.is_stopping()) {
            // Already closing or closed: everything is done once.
            let has_ended = |state: &mut State| state.has_ended;
            self.wait_in(|state| &mut state.opening, has_ended).await;
            return self.answer_behind_all();
        }
        let until = self.stop();
        let _turn = self.until(until, self.line_turn()).await;
        self.until(until, self.all_ended()).await;
        let mut exits = pin!(self.exit_policy());
        let until = self.now() + EXIT_MAX;
        let is_done = self.until(until, exits.as_mut()).await.is_some();
        let lines: Vec<String> = self.with(|state| {
            state.is_closed = true;
            let lines: Vec<String> = state.lines.keys().cloned().collect();
            state.close_lines(&lines);
            lines
        });
        if !is_done {
            let until = self.now() + SENT_MAX;
            let _ = self.until(until, exits).await;
        }
        self.with(State::tell_not_exited);
        self.closed(&lines).await;
        self.with(|state| {
            state.has_ended = true;
            state.wake_opening();
        });
        self.answer_behind_all();
    }
}

impl State {
    /// A line of the configuration is opened, with its modules numbered anew; its number from now
    /// on. None where there is no such line, or the site has been closed.
    pub(crate) fn line_opens(&mut self, line: &str) -> Option<LineId> {
        let modules = modules_of(self.site.config(), line);
        let known = self.lines.get_mut(line).filter(|_| !self.is_closed)?;
        let id = LineId(self.lines_opened);
        self.lines_opened += 1;
        (known.id, known.began, known.modules) = (Some(id), self.now.site, modules);
        (known.was_lent, known.babble) = (false, false);
        Some(id)
    }

    /// The same, done by the driver.
    pub(super) fn open_line(&mut self, line: &str) {
        if let Some(id) = self.line_opens(line) {
            self.runs.outputs.push_back(Output::Open {
                line: line.to_owned(),
                id,
                config: Arc::clone(self.site.config()),
            });
        }
    }

    /// A line was opened, and its clock began at this time of the site; or the system refused.
    pub(super) fn line_opened(
        &mut self,
        line: &str,
        id: LineId,
        opened: Result<Micros, PortError>,
    ) {
        let known = self.lines.get_mut(line);
        let Some(known) = known.filter(|known| known.id == Some(id)) else {
            return;
        };
        match opened {
            Ok(began) => known.began = began,
            Err(why) => {
                (known.id, known.is_closing) = (None, false);
                known.state = LineState::Absent(Arc::new(why));
                self.publish(Update::Line(line.to_owned()));
                self.wake_opening();
            }
        }
    }

    /// These lines take no more commands and are closed; [`Context::closed`] waits for that.
    pub(super) fn close_lines(&mut self, lines: &[String]) {
        for line in lines {
            if let Some(now) = self.lines.get_mut(line)
                && let Some(id) = now.open()
            {
                now.is_closing = true;
                self.runs.outputs.push_back(Output::Close(id));
            }
        }
    }

    /// The port of a line is free.
    pub(super) fn line_closed(&mut self, id: LineId) {
        let mut lines = self.lines.values_mut();
        if let Some(line) = lines.find(|line| line.id == Some(id)) {
            (line.id, line.is_closing) = (None, false);
        }
        self.wake_opening();
    }
}
