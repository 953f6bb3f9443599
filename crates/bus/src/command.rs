//! Commands: what a caller asked for, from submission to its end.

use crate::event::Events;
use crate::module_state::ModuleState;
use crate::{Confirmation, Event, Evidence, Fault, ModuleId, Ticket};
use alloc::collections::VecDeque;
use railbus_device::{Bank, Op, Refusal};
use railbus_wire::{Instant, Malformed, Micros};

/// How often a command's exchange is tried, where it is safe to repeat.
pub(crate) const TRIES_MAX: u8 = 3;
/// How often its outputs are read back before the read-back counts as failed.
pub(crate) const READS_MAX: u8 = 2;
/// How long after its expiry a command that was sent still waits for its read-back.
const READ_BACK_PATIENCE: Micros = Micros::from_secs(5);

/// A pending command.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Command {
    pub(crate) ticket: Ticket,
    pub(crate) module: ModuleId,
    pub(crate) op: Op,
    pub(crate) verify: bool,
    pub(crate) submitted: Instant,
    pub(crate) expires: Instant,
    pub(crate) stage: Stage,
    /// For a write: the outputs that no frame has carried yet.
    pub(crate) left: u32,
    /// Every frame so far was acknowledged.
    pub(crate) acknowledged: bool,
    /// One of its acknowledgements equals the request, as an echo would.
    pub(crate) echoed: bool,
    /// One of its replies contradicts it: it shows another state, or it is a refusal.
    pub(crate) denied: bool,
    /// It was refused, by a reply without a CRC: of `>`, which says that it is done, one bit makes
    /// `?`. What is read back decides.
    pub(crate) refusal: Option<Refusal>,
    /// Another model may have acknowledged it: the module had not identified itself.
    pub(crate) unidentified: bool,
    /// The outputs that did not match when they were last read after its frame, except for those
    /// known to give pulses, whose pulse may have ended.
    pub(crate) wrong: u32,
    /// Ask which outputs give pulses before reading its outputs again.
    pub(crate) asks_pulses: bool,
    /// When the last of its own replies was complete.
    pub(crate) replied: Option<Instant>,
    pub(crate) evidence: Evidence,
}

/// The stage a command has reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Waiting for its turn.
    Queued,
    /// Its frame is on the line.
    Sent,
    /// Its frame was sent; its outputs are still to be read back. The number counts the attempts.
    ReadBack(u8),
}

/// The outputs a plain write asks for; none for any other op.
pub(crate) const fn bank_of(op: &Op) -> Option<Bank> {
    match op {
        Op::Write(bank) => Some(*bank),
        _ => None,
    }
}

/// The outputs that an op affects: other commands for them wait until it has ended.
pub(crate) const fn touched(op: &Op) -> u32 {
    match op {
        Op::Write(bank) | Op::WriteSilent(bank) => bank.mask,
        Op::Toggle(mask) => *mask,
        Op::Jog { channel, .. } => channel.mask(),
        Op::Configure(_) => u32::MAX,
        _ => 0,
    }
}

impl Command {
    pub(crate) const fn new(
        ticket: Ticket,
        module: ModuleId,
        op: Op,
        verify: bool,
        (submitted, expires): (Instant, Instant),
    ) -> Command {
        let left = match bank_of(&op) {
            Some(bank) => bank.mask,
            None => 0,
        };
        Command {
            ticket,
            module,
            op,
            verify,
            submitted,
            expires,
            stage: Stage::Queued,
            left,
            acknowledged: true,
            echoed: false,
            denied: false,
            refusal: None,
            unidentified: false,
            wrong: 0,
            asks_pulses: false,
            replied: None,
            evidence: Evidence {
                attempts: 0,
                garbled: 0,
                bytes: 0,
                why: None,
            },
        }
    }

    /// Whether none of its frames has been sent.
    pub(crate) const fn is_unsent(&self) -> bool {
        matches!(self.stage, Stage::Queued) && self.evidence.attempts == 0
    }

    /// Compares the outputs read after its frame; gives the end, or none yet. A reply without its
    /// outputs, such as an input read, does not count as a read-back.
    pub(crate) fn judge(
        &mut self,
        state: &ModuleState,
        outputs: Bank,
    ) -> Option<Result<Confirmation, Fault>> {
        let Stage::ReadBack(reads) = self.stage else {
            return None;
        };
        if outputs.mask == 0 {
            return None;
        }
        // The module has identified itself.
        self.unidentified = false;
        let Some(want) = bank_of(&self.op) else {
            return Some(self.end_by_reply());
        };
        let seen = outputs.mask & want.mask;
        let wrong = (outputs.on ^ want.on) & seen;
        if seen == want.mask && wrong == 0 {
            return Some(Ok(Confirmation::Readback));
        }
        let pulses = state.pulses();
        self.wrong = wrong & !(pulses.unwrap_or(0) & want.on);
        // A pulse may have ended before the read-back: then only the reply confirms it.
        let may_be_over = pulses.unwrap_or(u32::MAX) & want.on;
        if wrong & !may_be_over == 0 && seen == want.mask {
            if pulses.is_some() || !self.acknowledged {
                return Some(self.end_by_reply());
            }
            // Whether the output gives pulses is asked once. A module that does not answer has
            // none.
            if state.pulse_question().is_some() && (reads == 0 || self.asks_pulses) {
                self.asks_pulses = true;
                self.stage = Stage::ReadBack(1);
                return None;
            }
        }
        if !self.acknowledged && state.repeatable(&self.op) && self.evidence.attempts < TRIES_MAX {
            self.left = want.mask;
            self.acknowledged = true;
            (self.echoed, self.denied, self.unidentified, self.wrong) = (false, false, false, 0);
            self.stage = Stage::Queued;
            return None;
        }
        if reads + 1 < READS_MAX {
            self.stage = Stage::ReadBack(reads + 1);
            return None;
        }
        Some(Err(match self.refusal {
            Some(refusal) => Fault::Refused(refusal),
            None if self.acknowledged => Fault::NotVerified,
            None => self.lost(),
        }))
    }

    /// The line may echo: what looked like an acknowledgement may have been the echo.
    pub(crate) const fn suspect_echo(&mut self) {
        self.acknowledged &= !self.echoed;
    }

    /// The module was asked which outputs give pulses, and answered unless it was silent: a
    /// mismatch may be a pulse that has ended, and then only the reply confirms the command.
    pub(crate) fn pulses_known(&mut self, pulses: u32) -> Option<Result<Confirmation, Fault>> {
        let want = bank_of(&self.op).filter(|_| core::mem::take(&mut self.asks_pulses))?;
        self.wrong &= !(pulses & want.on);
        (self.wrong == 0).then(|| self.end_by_reply())
    }

    /// The end when another model answers at the address.
    pub(crate) const fn end_by_other_model(&self) -> Result<Confirmation, Fault> {
        let sent = !self.is_unsent() && !self.op.is_read();
        Err(Fault::OtherModel { sent })
    }

    /// When it times out; a frame on the line is waited for.
    pub(crate) fn time_is_up_at(&self) -> Option<Instant> {
        match self.stage {
            Stage::Queued => Some(self.expires),
            Stage::Sent => None,
            Stage::ReadBack(_) => Some(self.expires + READ_BACK_PATIENCE),
        }
    }

    /// The end when it times out: a command never sent did nothing, one waiting to be resent may
    /// have acted.
    pub(crate) fn end_by_time(&self) -> Result<Confirmation, Fault> {
        match self.stage {
            Stage::Queued if self.is_unsent() => Err(Fault::Expired),
            Stage::Queued => Err(self.lost()),
            Stage::Sent | Stage::ReadBack(_) => self.end_by_reply(),
        }
    }

    /// The end when nothing more can be read back. A mismatch read before means not verified.
    pub(crate) fn end_by_reply(&self) -> Result<Confirmation, Fault> {
        match (
            self.acknowledged,
            self.denied || self.unidentified || self.wrong != 0,
        ) {
            (true, false) => Ok(Confirmation::Reply),
            // What was not read was not read otherwise.
            (true, true) if self.refusal.is_some() && self.wrong == 0 => Err(self.lost()),
            (true, true) => Err(Fault::NotVerified),
            (false, _) => Err(self.lost()),
        }
    }

    /// Its last frame was refused. An earlier one (one of several, or the same with its reply lost)
    /// may have acted: then the outputs are read back. So they are after a refusal without a CRC.
    pub(crate) fn refused(
        &mut self,
        refused: Fault,
        reads_back: bool,
    ) -> Option<Result<Confirmation, Fault>> {
        if self.evidence.attempts <= 1 {
            match refused {
                Fault::Refused(refusal @ Refusal::Invalid) if reads_back => {
                    self.refusal = Some(refusal);
                    self.evidence
                        .add(Evidence::of_try(2, Some(Malformed::Syntax)));
                }
                _ => return Some(Err(refused)),
            }
        }
        if !reads_back {
            return Some(Err(self.lost()));
        }
        (self.acknowledged, self.denied) = (true, true);
        self.stage = Stage::ReadBack(0);
        None
    }

    /// The fault of an exchange without a good reply.
    pub(crate) const fn lost(&self) -> Fault {
        self.evidence.fault()
    }
}

/// Ends every command for which `end` returns a result, in order.
pub(crate) fn end_commands(
    commands: &mut VecDeque<Command>,
    events: &mut Events,
    now: Instant,
    mut end: impl FnMut(&mut Command) -> Option<Result<Confirmation, Fault>>,
) {
    let mut index = 0;
    while let Some(command) = commands.get_mut(index) {
        let Some(end) = end(command) else {
            index += 1;
            continue;
        };
        let took = command.replied.unwrap_or(now).since(command.submitted);
        events.push(Event::Done {
            ticket: command.ticket,
            end,
            took,
        });
        commands.remove(index);
    }
}
