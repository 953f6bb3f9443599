//! The calls that wait for a result.

use crate::clock::Clock;
use crate::event::Publisher;
use crate::line::{Done, LATE_MAX, ProbeResult, RunId};
use crate::tap::{Tap, TapSender};
use railbus_bus::LateReply;
use railbus_bus::{COMMANDS_MAX, Confirmation, Fault, ModuleId, Probe, Probed, Ticket};
use railbus_device::{Observation, Op};
use railbus_wire::{Instant, Micros, SerialSettings};
use std::collections::VecDeque;
use tokio::sync::oneshot;

/// The most bytes kept of the answer to a probe.
const RX_LOG_MAX: usize = 300;
/// The most probes in the queue.
const PROBES_MAX: usize = 16;

/// Where the result of a probe is sent.
pub(crate) type ProbeReply = oneshot::Sender<Result<ProbeResult, Fault>>;

/// Where the end of a run is sent.
#[derive(Debug)]
pub(crate) enum RunReply {
    /// To a caller that waits.
    Caller(oneshot::Sender<Result<Done, Fault>>),
    /// To the observer.
    Observer(RunId),
}

impl RunReply {
    /// Sends it: to a caller only once the observer has all events before it.
    pub(crate) fn send(self, end: Result<Done, Fault>, publisher: &mut Publisher) {
        match self {
            RunReply::Caller(reply) => {
                publisher.flush();
                // Fails if the caller is gone.
                let _ = reply.send(end);
            }
            RunReply::Observer(run) => publisher.ended(run, end),
        }
    }
}

/// All pending calls.
#[derive(Debug)]
pub(crate) struct PendingCalls {
    runs: Vec<PendingRun>,
    probe: Option<PendingProbe>,
    /// Probes that wait for that one to end.
    probes: VecDeque<(Probe, ProbeReply)>,
    late: Vec<LateReply>,
    tap: Option<TapSender>,
    /// There is a probe or a tap: a single check for both, since it is made for every byte.
    records: bool,
}

/// A caller that waits for a command's end.
#[derive(Debug)]
pub(crate) struct PendingRun {
    pub(crate) ticket: Ticket,
    pub(crate) module: ModuleId,
    pub(crate) op: Op,
    pub(crate) submitted: Instant,
    /// The last observation that may be the answer, and when its request began.
    pub(crate) seen: Option<(Observation, Instant)>,
    pub(crate) reply: RunReply,
}

/// A caller that waits for a probe's end. What comes back is recorded here, because the state
/// machine does not keep replies it has understood.
#[derive(Debug)]
struct PendingProbe {
    sent: Vec<u8>,
    heard: Vec<u8>,
    changes: bool,
    reply: ProbeReply,
}

impl PendingCalls {
    pub(crate) fn new() -> PendingCalls {
        PendingCalls {
            runs: Vec::with_capacity(COMMANDS_MAX),
            probe: None,
            probes: VecDeque::new(),
            late: Vec::new(),
            tap: None,
            records: false,
        }
    }

    /// Adds a tap.
    pub(crate) fn tap(&mut self, clock: Clock) -> Tap {
        self.records = true;
        self.tap.get_or_insert_with(|| TapSender::new(clock)).tap()
    }

    /// Whether no call is pending.
    pub(crate) fn is_idle(&self) -> bool {
        self.runs.is_empty() && self.probe.is_none() && self.probes.is_empty()
    }

    pub(crate) fn add(&mut self, run: PendingRun) {
        self.runs.push(run);
    }

    /// Queues a probe, after dropping those whose caller is gone.
    pub(crate) fn queue_probe(&mut self, probe: Probe, reply: ProbeReply) {
        self.probes.retain(|(_, reply)| !reply.is_closed());
        if self.probes.len() >= PROBES_MAX {
            let _ = reply.send(Err(Fault::Overloaded));
            return;
        }
        self.probes.push_back((probe, reply));
    }

    /// Whether a probe is in flight or queued: checked at every step of the line.
    pub(crate) fn has_probes(&self) -> bool {
        self.probe.is_some() || !self.probes.is_empty()
    }

    /// The next probe whose caller still waits, unless one is in flight.
    pub(crate) fn next_probe(&mut self) -> Option<(Probe, ProbeReply)> {
        if self.probe.is_some() {
            return None;
        }
        let mut waiting = std::iter::from_fn(|| self.probes.pop_front());
        waiting.find(|(_, reply)| !reply.is_closed())
    }

    /// Whether the caller of the probe in flight is gone.
    pub(crate) fn is_abandoned(&self) -> bool {
        let probe = self.probe.as_ref();
        probe.is_some_and(|probe| probe.reply.is_closed())
    }

    /// The line has taken a probe. Its result includes what comes back.
    pub(crate) fn add_probe(&mut self, changes: bool, reply: ProbeReply) {
        self.records = true;
        self.probe = Some(PendingProbe {
            sent: Vec::new(),
            heard: Vec::new(),
            changes,
            reply,
        });
    }

    /// The line has dropped the probe without sending it.
    pub(crate) fn forget_probe(&mut self) {
        self.probe = None;
    }

    /// A frame was sent.
    pub(crate) fn sent(&mut self, bytes: &[u8], settings: SerialSettings) {
        if self.records {
            self.record_sent(bytes, settings);
        }
    }

    /// Bytes were received.
    pub(crate) fn heard(&mut self, bytes: &[u8], echoes: impl FnOnce() -> bool) {
        if self.records {
            self.record_heard(bytes, echoes());
        }
    }

    #[cold]
    fn record_sent(&mut self, bytes: &[u8], settings: SerialSettings) {
        if let Some(probe) = &mut self.probe {
            probe.sent.clear();
            probe.sent.extend_from_slice(bytes);
            probe.heard.clear();
        }
        self.tell(|tap| tap.sent(bytes, settings));
    }

    #[cold]
    fn record_heard(&mut self, bytes: &[u8], echoes: bool) {
        if let Some(probe) = &mut self.probe {
            let room = RX_LOG_MAX - probe.heard.len().min(RX_LOG_MAX);
            probe.heard.extend(bytes.iter().take(room));
        }
        self.tell(|tap| tap.heard(bytes, echoes));
    }

    /// Passes something to the taps; the last of them may have gone.
    fn tell(&mut self, what: impl FnOnce(&mut TapSender) -> bool) {
        if let Some(tap) = &mut self.tap
            && !what(tap)
        {
            self.tap = None;
        }
        self.records = self.probe.is_some() || self.tap.is_some();
    }

    /// A module reported something.
    #[inline]
    pub(crate) fn seen(&mut self, module: ModuleId, op: &Op, seen: &Observation, asked: Instant) {
        if !self.runs.is_empty() {
            self.seen_by_runs(module, op, *seen, asked);
        }
    }

    #[inline(never)]
    fn seen_by_runs(&mut self, module: ModuleId, op: &Op, seen: Observation, asked: Instant) {
        for run in self.runs.iter_mut().filter(|run| run.module == module) {
            let answers = if run.op.is_read() {
                run.op == *op
            } else {
                matches!(seen, Observation::Channels { outputs, .. } if outputs.mask != 0)
            };
            if answers {
                run.seen = Some((seen, asked));
            }
        }
    }

    /// A command ended.
    pub(crate) fn end(
        &mut self,
        ticket: Ticket,
        (end, took): (Result<Confirmation, Fault>, Micros),
        publisher: &mut Publisher,
    ) {
        let Some(index) = self.runs.iter().position(|run| run.ticket == ticket) else {
            return;
        };
        let run = self.runs.swap_remove(index);
        let done = end.map(|confirmed| Done {
            confirmed,
            took,
            seen: run.seen.and_then(|(seen, asked)| {
                // Outputs requested before the write was answered say nothing about it.
                let is_after = match confirmed {
                    Confirmation::Readback => true,
                    Confirmation::Reply => asked >= run.submitted + took,
                    Confirmation::Sent => false,
                };
                (run.op.is_read() || is_after).then_some(seen)
            }),
        });
        run.reply.send(done, publisher);
    }

    /// A late reply to a probe: kept for the result of the next probe.
    pub(crate) fn late(&mut self, reply: LateReply) {
        if self.late.len() < LATE_MAX {
            self.late.push(reply);
        }
    }

    /// A probe ended.
    pub(crate) fn end_probe(&mut self, outcome: Probed, after: Micros, echoes: bool) {
        if let Some(probe) = self.probe.take() {
            let mut bytes = probe.heard;
            if echoes && bytes.starts_with(&probe.sent) {
                bytes.drain(..probe.sent.len());
            }
            let _ = probe.reply.send(Ok(ProbeResult {
                outcome,
                bytes,
                after,
                late: std::mem::take(&mut self.late),
            }));
        }
    }

    /// The line is closed: all pending calls end. How a probe ended that was sent and may change
    /// something is unknown.
    pub(crate) fn clear(&mut self, probe_was_sent: bool, publisher: &mut Publisher) {
        for run in self.runs.drain(..) {
            run.reply.send(Err(Fault::Unknown), publisher);
        }
        if let Some(probe) = self.probe.take() {
            let unknown = probe_was_sent && probe.changes;
            let fault = if unknown {
                Fault::Unknown
            } else {
                Fault::Closed
            };
            let _ = probe.reply.send(Err(fault));
        }
        for (_, reply) in self.probes.drain(..) {
            let _ = reply.send(Err(Fault::Closed));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Bank;

    fn pending_with(op: Op) -> (PendingCalls, oneshot::Receiver<Result<Done, Fault>>) {
        let (reply, end) = oneshot::channel();
        let mut pending = PendingCalls::new();
        pending.add(PendingRun {
            ticket: Ticket(7),
            module: ModuleId(1),
            op,
            submitted: Instant(100),
            seen: None,
            reply: RunReply::Caller(reply),
        });
        (pending, end)
    }

    fn outputs(on: u32) -> Observation {
        Observation::Channels {
            outputs: Bank::new(0xFF, on),
            inputs: Bank::default(),
        }
    }

    #[test]
    fn a_read_gets_what_was_seen_last_of_its_own_module_and_op() {
        let (mut pending, mut end) = pending_with(Op::ReadOutputs);
        let at = Instant(50);
        pending.seen(ModuleId(1), &Op::ReadOutputs, &outputs(1), at);
        pending.seen(ModuleId(1), &Op::ReadOutputs, &outputs(2), at);
        pending.seen(ModuleId(0), &Op::ReadOutputs, &outputs(3), at);
        pending.seen(
            ModuleId(1),
            &Op::ReadAnalogs,
            &Observation::Analogs([1, 2]),
            at,
        );
        let end_of = (Ok(Confirmation::Reply), Micros(5));
        pending.end(Ticket(7), end_of, &mut Publisher::new(None));
        let done = end.try_recv().unwrap().unwrap();
        assert_eq!(done.seen, Some(outputs(2)));
        assert!(pending.is_idle());
    }

    #[test]
    fn a_write_has_seen_what_was_asked_for_after_its_reply() {
        for (confirmed, asked, seen) in [
            (Confirmation::Reply, 104, None),
            (Confirmation::Reply, 105, Some(outputs(4))),
            (Confirmation::Readback, 104, Some(outputs(4))),
            (Confirmation::Sent, 105, None),
        ] {
            let (mut pending, mut end) = pending_with(Op::Toggle(4));
            pending.seen(ModuleId(1), &Op::ReadOutputs, &outputs(4), Instant(asked));
            let end_of = (Ok(confirmed), Micros(5));
            pending.end(Ticket(7), end_of, &mut Publisher::new(None));
            assert_eq!(end.try_recv().unwrap().unwrap().seen, seen);
        }
    }

    #[test]
    fn a_probe_gets_what_came_back_without_the_echo() {
        for (echoes, bytes) in [(true, &[3, 4][..]), (false, &[1, 2, 3, 4][..])] {
            let (reply, mut end) = oneshot::channel();
            let mut pending = PendingCalls::new();
            pending.add_probe(false, reply);
            pending.heard(&[9], || false);
            pending.sent(&[1, 2], SerialSettings::FACTORY);
            pending.heard(&[1, 2, 3], || false);
            pending.heard(&[4], || false);
            pending.end_probe(Probed::Answered, Micros(5), echoes);
            assert_eq!(end.try_recv().unwrap().unwrap().bytes, bytes);
        }
    }
}
