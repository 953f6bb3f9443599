//! The result of an exchange: readings, and the ends of commands.

use crate::command::{self, Command, Stage, bank_of, end_commands};
use crate::in_flight::{InFlight, Job};
use crate::module_state::{LATE_MIN, ModuleState, Reading};
use crate::rx_buffer::is_own_reply;
use crate::{Bus, Confirmation, Event, Evidence, Fault, ModuleId, Presence, Probed};
use railbus_device::{Bank, Observation, Op};
use railbus_wire::Malformed;

impl Bus {
    /// A good reply: updates what is known and ends commands.
    pub(crate) fn learn(&mut self, flight: &InFlight, seen: Observation) {
        let Some(module) = flight.job.module() else {
            return;
        };
        if flight.is_fence() {
            // Some models report themselves in it.
            if let Observation::Model(_) = seen {
                self.identified(module, &seen);
            }
            return;
        }
        let op = flight.job.op();
        let refused = matches!(seen, Observation::Refused(_));
        let is_command = matches!(flight.job, Job::Command { .. });
        let is_claim = is_command && self.is_claim(module, flight, &seen);
        if let Some(state) = self.modules.get_mut(module.0) {
            if (state.published_presence() != Presence::Online || !state.is_settled())
                && state.withholds(Reading {
                    op,
                    seen,
                    asked: flight.asked,
                    heard: self.now,
                })
            {
                return self.end_sent_commands(module, |command| {
                    command.stage = Stage::Queued;
                    None
                });
            }
            if !is_claim {
                state.module.learn(&seen);
            }
            state.polled(&op, flight.asked);
            if state.pulse_question() == Some(op) {
                state.answered_pulses();
            }
        }
        if is_claim {
            self.tell_inputs(module, flight, &seen);
        } else if !matches!(seen, Observation::Done | Observation::Refused(_)) {
            let (asked, heard) = (flight.asked, self.now);
            self.events.push(Event::Seen {
                module,
                op,
                seen,
                asked,
                heard,
            });
        }
        if let Op::Identify = op {
            self.identified(module, &seen);
        } else if let Job::OnOnline { .. } = flight.job {
            self.publish_pulses(module);
        }
        if let Job::Command { .. } = flight.job {
            self.acknowledge(module, flight, seen);
        } else if let Observation::Refused(refusal) = seen {
            self.events.push(Event::Missed {
                module,
                op,
                fault: Fault::Refused(refusal),
            });
        }
        if let Observation::Channels { outputs, .. } = seen
            && op.is_read()
            && !refused
        {
            self.judge(module, outputs);
        } else if let Job::ReadBack { .. } = flight.job {
            self.miss_read_back(module);
        }
    }

    /// Whether the reply to a command names states that are read back next. A board names those
    /// that it was told, also where a relay did not move: what is read counts.
    #[cold]
    fn is_claim(&self, module: ModuleId, flight: &InFlight, seen: &Observation) -> bool {
        let op = flight.job.op();
        let state = self.modules.get(module.0);
        let read_back = state.and_then(|state| state.module.read_back(&op));
        let mut sent = self.commands.iter().filter(|command| {
            command.module == module && command.stage == Stage::Sent && command.verify
        });
        matches!(seen, Observation::Channels { .. })
            && read_back == Some(Op::ReadOutputs)
            && sent.next().is_some()
    }

    /// The inputs beside such a claim were read.
    #[cold]
    fn tell_inputs(&mut self, module: ModuleId, flight: &InFlight, seen: &Observation) {
        let Observation::Channels { inputs, .. } = *seen else {
            return;
        };
        if inputs.mask != 0 {
            let outputs = Bank::new(0, 0);
            self.events.push(Event::Seen {
                module,
                op: flight.job.op(),
                seen: Observation::Channels { outputs, inputs },
                asked: flight.asked,
                heard: self.now,
            });
        }
    }

    /// The module answered a command.
    fn acknowledge(&mut self, module: ModuleId, flight: &InFlight, seen: Observation) {
        let (now, op) = (self.now, &flight.job.op());
        let parrots = !self.rx.took_echo() && is_own_reply(&flight.exchange, self.outgoing.bytes());
        let reads_back = self
            .modules
            .get(module.0)
            .is_some_and(|state| state.module.read_back(op) == Some(Op::ReadOutputs));
        let carried = bank_of(op).map(|bank| bank.mask);
        let state = self.modules.get(module.0);
        let asks_again = *op == Op::Identify && state.is_some_and(|state| !state.is_settled());
        // A change of settings does so itself, and its module may not be found afterwards.
        let acts = !op.is_read() && !matches!(op, Op::Configure(_));
        let is_unknown = acts && state.is_some_and(ModuleState::is_to_be_identified);
        self.end_sent_commands(module, |command| {
            if asks_again {
                // It may have been corrupted: it is asked again.
                command.stage = Stage::Queued;
                return None;
            }
            command.replied = Some(now);
            command.echoed |= parrots;
            command.unidentified |= is_unknown;
            if let Observation::Refused(refusal) = seen {
                return command.refused(Fault::Refused(refusal), reads_back);
            }
            // What may be an echo is not a reply.
            let to_be_read = reads_back && (command.verify || parrots);
            command.denied = is_denied(&command.op, op, &seen);
            if !to_be_read && command.denied {
                return Some(Err(Fault::NotVerified));
            }
            if let Some(mask) = carried {
                command.left &= !mask;
                if command.left != 0 {
                    command.stage = Stage::Queued;
                    return None;
                }
            }
            // A reply that may be another model's does not count, not even to an earlier one of
            // several frames: the module has to report its model first.
            if to_be_read || command.unidentified {
                command.stage = Stage::ReadBack(0);
                return None;
            }
            Some(Ok(Confirmation::Reply))
        });
    }

    /// An exchange failed: no reply, or no good one. `taken` bytes of what was received have
    /// already been removed from the buffer.
    pub(crate) fn fail(&mut self, flight: &InFlight, taken: usize, why: Option<Malformed>) {
        let left = self.rx.heard().len();
        let bytes = u16::try_from(taken + left).unwrap_or(u16::MAX);
        let evidence = Evidence::of_try(bytes, why);
        let fault = evidence.fault();
        match flight.job {
            Job::Command { module, op } => self.lose(module, &op, evidence),
            Job::ReadBack { module } => {
                self.miss_read_back(module);
                self.events.push(Event::Missed {
                    module,
                    op: Op::ReadOutputs,
                    fault,
                });
            }
            // A module that does not report its model is not counted as silent for that.
            Job::OnOnline {
                module,
                op: Op::Identify,
            } => self.not_identified(module, flight, evidence),
            Job::Poll { module, op } | Job::OnOnline { module, op } => {
                if let Job::OnOnline { .. } = flight.job {
                    self.publish_pulses(module);
                    // Some models never answer it.
                    if let Some(state) = self.modules.get_mut(module.0) {
                        state.on_online_at = flight.sent + LATE_MIN;
                    }
                }
                self.events.push(Event::Missed { module, op, fault });
            }
            Job::Fence { module, op } => {
                // A request that is only a test says nothing about the module by getting no reply.
                if self
                    .modules
                    .get(module.0)
                    .is_some_and(ModuleState::has_fence)
                {
                    self.events.push(Event::Missed { module, op, fault });
                }
            }
            Job::Probe { .. } => {
                let outcome = if left == 0 {
                    Probed::Silent
                } else {
                    Probed::Garbled
                };
                let after = self.now.since(flight.sent);
                self.events.push(Event::Probed { outcome, after });
            }
        }
    }

    /// The reply to a command was lost. Read back what can be read back; repeat what can be
    /// repeated; send nothing else a second time.
    fn lose(&mut self, module: ModuleId, op: &Op, evidence: Evidence) {
        let Some(state) = self.modules.get(module.0) else {
            return;
        };
        let reads_back = state.module.read_back(op) == Some(Op::ReadOutputs);
        let repeatable = state.repeatable(op);
        let silent = state.is_silent();
        self.end_sent_commands(module, |command| {
            command.acknowledged = false;
            command.evidence.add(evidence);
            let attempts = command.evidence.attempts;
            if silent {
                // More attempts would only keep other modules waiting.
                return Some(Err(command.lost()));
            }
            if reads_back {
                command.stage = Stage::ReadBack(0);
            } else if repeatable && attempts < command::TRIES_MAX {
                command.acknowledged = true;
                command.stage = Stage::Queued;
            } else {
                return Some(Err(command.lost()));
            }
            None
        });
    }

    /// Passes the outputs just read to every command that waits for them.
    fn judge(&mut self, id: ModuleId, outputs: Bank) {
        if self.commands.is_empty() {
            return;
        }
        // Outputs that may be another model's confirm nothing.
        let Some(state) = self.modules.get(id.0).filter(|state| state.is_settled()) else {
            return;
        };
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            if command.module == id {
                command.judge(state, outputs)
            } else {
                None
            }
        });
    }

    /// Passes the pulse settings of a module to its waiting commands, as far as they are known.
    pub(crate) fn publish_pulses(&mut self, module: ModuleId) {
        let pulses = self.modules.get(module.0).and_then(ModuleState::pulses);
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let asks = command.module == module && command.asks_pulses;
            asks.then(|| command.pulses_known(pulses.unwrap_or(0)))?
        });
    }

    /// A read-back failed: after a few attempts, the command ends with its own reply. Without
    /// `verify` it does not wait for a second one: this reply was not an echo either.
    pub(crate) fn miss_read_back(&mut self, module: ModuleId) {
        end_commands(
            &mut self.commands,
            &mut self.events,
            self.now,
            |command| match command.stage {
                Stage::ReadBack(reads) if command.module == module => {
                    command.stage = Stage::ReadBack(reads + 1);
                    let is_last = reads + 1 >= command::READS_MAX || !command.verify;
                    is_last.then(|| command.end_by_reply())
                }
                _ => None,
            },
        );
    }

    /// Updates or ends the commands in flight.
    pub(crate) fn end_sent_commands(
        &mut self,
        module: ModuleId,
        mut change: impl FnMut(&mut Command) -> Option<Result<Confirmation, Fault>>,
    ) {
        end_commands(&mut self.commands, &mut self.events, self.now, |command| {
            let sent = command.module == module && command.stage == Stage::Sent;
            if sent { change(command) } else { None }
        });
    }
}

/// Whether the reply to a frame itself shows another state than its command asked for.
fn is_denied(command: &Op, frame: &Op, seen: &Observation) -> bool {
    match (command, frame, seen) {
        (Op::Write(want), Op::Write(sent), Observation::Channels { outputs, .. }) => {
            (outputs.on ^ want.on) & want.mask & sent.mask & outputs.mask != 0
        }
        // A board replies with its state after it has begun; only a jog of zero duration has ended
        // by then.
        (
            Op::Jog {
                channel,
                close,
                millis,
            },
            _,
            Observation::Channels { outputs, .. },
        ) => millis.get() > 0 && outputs.get(*channel) == Some(!*close),
        (Op::WriteVariable(_, want), _, Observation::Variable(_, is)) => want != is,
        _ => false,
    }
}
