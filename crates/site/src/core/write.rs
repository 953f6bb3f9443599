//! Outputs written or switched over: what is checked before a command goes to the line.

use super::context::Context;
use super::order::{Entry, Order, bank_state, channel, places};
use super::turns::Turn;
use super::within::Within;
use crate::CommandError;
use crate::config::Config;
use crate::config::Place;
use crate::rights::Who;
use railbus_device::{Bank, Op, Point};
use railbus_host::{Confirmation, Fault};
use railbus_store::audit::{Note, Origin};
use railbus_wire::Micros;

/// On what terms outputs are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteTerms {
    /// Read the outputs back and compare, where the module can.
    pub verify: bool,
    /// In the form that no module answers.
    pub silent: bool,
    /// Only where every one of the outputs is in this state now, for which they are read first.
    pub only_if: Option<bool>,
    /// Who asks means it, also for outputs that want that to be said.
    pub confirm: bool,
    /// It must be sent within this time.
    pub within: Within,
}

impl Default for WriteTerms {
    fn default() -> WriteTerms {
        WriteTerms {
            verify: true,
            silent: false,
            only_if: None,
            confirm: false,
            within: Within::DEFAULT,
        }
    }
}

/// On what terms an output is switched over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ToggleTerms {
    /// By the board's own command, which is never repeated; else it is read first and then set.
    pub raw: bool,
    /// Who asks means it, also for outputs that want that to be said.
    pub confirm: bool,
    /// It must be sent within this time.
    pub within: Within,
}

/// How outputs were written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WriteDone {
    /// Each output with what it is now, and what it was before, where that is known.
    pub outputs: Vec<(Point, Option<bool>, Option<bool>)>,
    /// How far that is certain.
    pub confirmed: Confirmation,
    /// From handing the command in to the last byte of its own reply.
    pub took: Micros,
    /// The number of its audit entry.
    pub audit: String,
    /// It was made of a read and a write.
    pub read_then_set: bool,
}

pub(super) fn note(who: &Who, what: String) -> Note {
    Note {
        origin: Origin::clone(&who.origin),
        what,
    }
}

impl Context {
    /// Brings outputs of one module into these states with one command of the line, and leaves
    /// the others alone.
    pub(crate) async fn write(
        &self,
        who: &Who,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
    ) -> Result<WriteDone, CommandError> {
        let since = self.config();
        let expires = self.expires(terms.within);
        self.write_since(&since, who, module, set, (terms, expires))
            .await
    }

    /// The same at the board that had the name in an earlier configuration, as one of several
    /// steps that has until then: see [`Context::turn_since`].
    pub(crate) async fn write_since(
        &self,
        since: &Config,
        who: &Who,
        module: &str,
        set: &[(Point, bool)],
        (terms, expires): (WriteTerms, Micros),
    ) -> Result<WriteDone, CommandError> {
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        let until = (terms.confirm, expires);
        let turn = self.turn_to_command(since, who, module, &points, until);
        let turn = turn.await?;
        if let Some(wanted) = terms.only_if {
            self.read_all(module, expires).await?;
            let other = self.with(|state| {
                let known = |point| state.output(module, point);
                let other = points.iter().find(|point| known(**point) != Some(wanted));
                other.copied()
            });
            if let Some(point) = other {
                return Err(CommandError::NotAsAsked(point, !wanted));
            }
        }
        let on = set.iter().filter(|(_, on)| *on).map(|(point, _)| *point);
        self.with(|state| state.watched(module, on))?;
        let done = self.write_in_turn(who, &turn, module, set, terms, expires);
        let done = done.await?;
        self.take_over(module, &points, done).await
    }

    /// The turn with outputs of one module, for a command that may be given by then: see
    /// [`Context::turn_since`].
    pub(super) async fn turn_to_command(
        &self,
        since: &Config,
        who: &Who,
        module: &str,
        points: &[Point],
        (confirm, expires): (bool, Micros),
    ) -> Result<Turn, CommandError> {
        self.with(|state| state.may_command(who, module, points, confirm))?;
        let turn = self.turn_since(since, places(module, points), expires);
        let turn = turn.await?;
        // Meanwhile the configuration may have changed, or the site begun to end.
        self.with(|state| state.may_command(who, module, points, confirm))?;
        Ok(turn)
    }

    /// Writes outputs whose turn it is. What was to be done to them later still is.
    pub(super) async fn write_in_turn(
        &self,
        who: &Who,
        turn: &Turn,
        module: &str,
        set: &[(Point, bool)],
        terms: WriteTerms,
        expires: Micros,
    ) -> Result<WriteDone, CommandError> {
        let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
        let mut bank = Bank::default();
        for (point, on) in set {
            let one = Bank::one(channel(*point)?, *on);
            bank = Bank::new(bank.mask | one.mask, bank.on & !one.mask | one.on);
        }
        let op = if terms.silent {
            Op::WriteSilent(bank)
        } else {
            Op::Write(bank)
        };
        let what = self.with(|state| {
            state.writable(module, &points)?;
            Ok::<_, CommandError>(state.describe(module, set))
        })?;
        let order = Order {
            module,
            points: &points,
            op,
            verify: terms.verify,
            expires,
        };
        let mut entry = Entry::new(note(who, what));
        let wanted = |point| bank_state(bank, point);
        self.command(turn, order, &mut entry, wanted).await
    }

    /// Switches an output over. Where it is read first and then set, someone else may come
    /// between.
    pub(crate) async fn toggle(
        &self,
        who: &Who,
        module: &str,
        point: Point,
        terms: ToggleTerms,
    ) -> Result<WriteDone, CommandError> {
        let ToggleTerms {
            raw,
            confirm,
            within,
        } = terms;
        let expires = self.expires(within);
        self.with(|state| state.may_command(who, module, &[point], confirm))?;
        let turn = self.turn(places(module, &[point]), expires).await?;
        self.with(|state| state.may_command(who, module, &[point], confirm))?;
        let done = if raw {
            let what = self.with(|state| {
                state.watched(module, [point])?;
                Ok::<_, CommandError>(format!("toggle {}", state.label(module, point)))
            })?;
            let order = Order {
                module,
                points: &[point],
                op: Op::Toggle(channel(point)?.mask()),
                verify: true,
                expires,
            };
            let mut entry = Entry::new(note(who, what));
            self.command(&turn, order, &mut entry, |_| None).await?
        } else {
            let read = self.read_all(module, expires).await;
            read.map_err(|failure| match failure {
                CommandError::Line(fault) => CommandError::NotRead(fault),
                other => other,
            })?;
            let now = self.with(|state| {
                let now = state.output(module, point);
                let now = now.ok_or(CommandError::NotRead(Fault::Unknown))?;
                state.watched(module, (!now).then_some(point))?;
                Ok::<_, CommandError>(now)
            })?;
            let (set, terms) = ([(point, !now)], WriteTerms::default());
            let done = self.write_in_turn(who, &turn, module, &set, terms, expires);
            WriteDone {
                read_then_set: true,
                ..done.await?
            }
        };
        self.take_over(module, &[point], done).await
    }

    /// A command was carried out: its outputs are in no pulse and no lease any more. A frame that
    /// nobody answers may not have been heard, and takes nothing over.
    pub(super) async fn take_over(
        &self,
        module: &str,
        points: &[Point],
        done: WriteDone,
    ) -> Result<WriteDone, CommandError> {
        if done.confirmed != Confirmation::Sent {
            let places: Vec<Place> = places(module, points).collect();
            let taken = self.hand_outputs_over(&places, None).await;
            taken.map_err(CommandError::NotTakenOver)?;
        }
        Ok(done)
    }
}
