//! The listener: bytes with their times in, frames out.
//!
//! Adapters deliver bytes in pieces, so a pause between them need not be a pause on the wire, and
//! two frames may come as one piece. So frames are recognised by their content, at every position
//! in turn; pauses only decide when to stop waiting for the rest of one.

use crate::frame::{Asked, FrameRole, FrameVerdict, Missing, Reading, SniffEvent, SniffedFrame};
use crate::judge::judge;
use crate::look::{Find, Look, Trust, look};
use railbus_wire::{Exchange, Instant, Micros, Protocol, REPLY_TIMEOUT, SerialSettings, r55};
use std::collections::VecDeque;

/// The default reply timeout.
pub const PATIENCE: Micros = REPLY_TIMEOUT;
/// A reply later than this after its request is no longer paired with it.
const LATE_MAX: Micros = Micros::from_secs(2);
/// How long adapters may pause inside a frame: FTDI's timer is 16 ms.
const SILENCE_MIN: Micros = Micros::from_millis(20);
/// The same if a frame is complete, and only another reading of it would be longer.
const SETTLED_MIN: Micros = Micros::from_millis(5);
/// Bytes are processed in pieces of this size, so that the buffer is bounded.
const PIECE: usize = 256;
/// Bytes that are not a frame are reported when there are this many.
const NOISE_MAX: usize = 256;

/// An input of the listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a> {
    /// Bytes just received; the last one ends now.
    Bytes(&'a [u8]),
    /// A complete frame that the master was seen to send; its last byte ends now.
    Sent(&'a [u8]),
    /// The frame, or what there is of it, is known to have ended.
    Silence,
    /// Time has passed.
    Timeout,
}

/// An output of the listener.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// Something was heard.
    Heard(SniffEvent),
    /// Nothing now; [`Input::Timeout`] is due at this moment, or never.
    Wait(Option<Instant>),
}

/// Finds frames among bytes. After each input, drain [`Listener::poll`] until it waits: the outputs
/// are queued, and their number is bounded by the input.
#[derive(Debug)]
pub struct Listener {
    settings: SerialSettings,
    patience: Micros,
    silence: Micros,
    bytes: Vec<u8>,
    marks: VecDeque<Mark>,
    /// No frame begins before this position.
    tried: usize,
    /// When the last byte ended.
    last: Option<Instant>,
    /// When the last frame ended.
    told: Option<Instant>,
    pending: Option<Pending>,
    /// A complete frame only waits for a longer reading to fail.
    settling: bool,
    out: VecDeque<SniffEvent>,
}

/// Where in the buffer a piece begins, and when.
#[derive(Clone, Copy, Debug)]
struct Mark {
    at: usize,
    begins: Instant,
    /// There was silence before it.
    gap: bool,
}

/// What is known about the end of the last frame.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ended {
    /// Nothing.
    No,
    /// A complete frame needs no more bytes.
    Settled,
    /// No more bytes belong to it.
    Yes,
}

/// A pending request.
#[derive(Debug)]
struct Pending {
    asked: Asked,
    end: Instant,
    /// It has timed out.
    over: bool,
    /// Something came that may have been its reply, so it is not reported as unanswered.
    spoiled: bool,
}

impl Listener {
    /// A listener for a line with these settings.
    #[must_use]
    pub fn new(settings: SerialSettings) -> Listener {
        Listener {
            settings,
            patience: PATIENCE,
            silence: SILENCE_MIN,
            bytes: Vec::with_capacity(2 * PIECE),
            marks: VecDeque::new(),
            tried: 0,
            last: None,
            told: None,
            pending: None,
            settling: false,
            out: VecDeque::new(),
        }
    }

    /// Sets the reply timeout.
    #[must_use]
    pub const fn with_patience(mut self, patience: Micros) -> Listener {
        self.patience = patience;
        self
    }

    /// Sets the longest pause inside a frame, for a line behind a network that may hold bytes back.
    #[must_use]
    pub const fn with_silence(mut self, silence: Micros) -> Listener {
        self.silence = silence;
        self
    }

    /// Takes an input.
    pub fn handle(&mut self, now: Instant, input: Input<'_>) {
        match input {
            Input::Bytes(bytes) => {
                self.expire(before(now, self.settings.frame_time(bytes.len())));
                for (index, piece) in bytes.chunks(PIECE).enumerate() {
                    let rest = bytes.len().saturating_sub((index + 1) * PIECE);
                    self.push(before(now, self.settings.frame_time(rest)), piece);
                    self.find(Ended::No);
                }
            }
            Input::Sent(frame) => {
                self.find(Ended::Yes);
                self.give_up(before(now, self.settings.frame_time(frame.len())));
                self.pending = None;
                self.push(now, frame.get(..SniffedFrame::LEN_MAX).unwrap_or(frame));
                self.find(Ended::Yes);
            }
            Input::Silence => self.find(Ended::Yes),
            Input::Timeout => {
                let silent = self.due().is_some_and(|due| due <= now);
                match self.settling {
                    _ if !silent || self.bytes.is_empty() => {}
                    true => self.find(Ended::Settled),
                    false => self.find(Ended::Yes),
                }
                self.expire(now);
            }
        }
    }

    /// The next output, or when to call again.
    pub fn poll(&mut self) -> Output {
        match self.out.pop_front() {
            Some(heard) => Output::Heard(heard),
            None => Output::Wait(self.due()),
        }
    }

    fn due(&self) -> Option<Instant> {
        if !self.bytes.is_empty() {
            let least = match self.settling {
                true => SETTLED_MIN,
                false => self.silence,
            };
            return self.last.map(|last| last + self.settings.t3_5().max(least));
        }
        let pending = self.pending.as_ref().filter(|pending| !pending.over);
        pending.map(|pending| pending.end + self.patience)
    }

    fn push(&mut self, now: Instant, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        let begins = before(now, self.settings.frame_time(bytes.len()));
        let begins = self.last.map_or(begins, |last| begins.max(last));
        let gap = self
            .last
            .is_some_and(|last| begins.since(last) >= self.settings.t3_5());
        self.marks.push_back(Mark {
            at: self.bytes.len(),
            begins,
            gap,
        });
        self.bytes.extend_from_slice(bytes);
        self.last = Some(now.max(begins));
    }

    /// Reports every complete frame; everything if it is known to have ended.
    fn find(&mut self, ended: Ended) {
        self.settling = false;
        while self.tried < self.bytes.len() {
            let late = self.pending.as_ref().is_some_and(|pending| pending.over);
            let pending = self.pending.as_ref().and_then(|p| p.asked.exchange());
            let rest = self.bytes.get(self.tried..).unwrap_or_default();
            let look = look(rest, pending.as_ref());
            let best = look.best(late).filter(|best| self.may_be(best));
            match best {
                Some(best) if ended != Ended::No || !self.is_rivalled(&look, &best) => {
                    self.noise(self.tried);
                    self.frame(&look, best);
                }
                Some(_) => {
                    self.settling = true;
                    return;
                }
                None if look.partial && ended != Ended::Yes && !self.is_refuted() => return,
                None => self.tried += 1,
            }
            if self.tried >= NOISE_MAX {
                self.noise(self.tried);
            }
        }
        if ended == Ended::Yes || self.bytes.len() >= NOISE_MAX {
            self.noise(self.bytes.len());
        }
    }

    /// What only looks like an envelope is accepted at the beginning, never among other bytes.
    fn may_be(&self, best: &Find) -> bool {
        best.trust > Trust::Envelope || self.tried == 0 || self.gap_at(self.tried)
    }

    /// Whether bytes that are a complete frame may also be the beginning of a longer one: a sum of
    /// eight bits matches by chance once in 256 times. Silence after it speaks against that.
    fn is_rivalled(&self, look: &Look, best: &Find) -> bool {
        let end = self.tried + best.len;
        look.partial_rtu && best.trust <= Trust::Sum && !self.gap_at(end)
    }

    /// Whether a complete frame begins after a silence, so that what only began before it can't be
    /// completed.
    fn is_refuted(&self) -> bool {
        let after = |mark: &&Mark| mark.gap && mark.at > self.tried;
        self.marks.iter().filter(after).any(|mark| {
            let rest = self.bytes.get(mark.at..).unwrap_or_default();
            let best = look(rest, None).best(false);
            best.is_some_and(|best| best.trust > Trust::Envelope)
        })
    }

    fn gap_at(&self, at: usize) -> bool {
        self.marks.iter().any(|mark| mark.at == at && mark.gap)
    }

    /// When the byte at a place began. Where bytes came faster than the line can carry them, as
    /// from a terminal without a wire, none is later than the piece after it.
    fn time(&self, at: usize) -> Instant {
        let after = self.marks.partition_point(|mark| mark.at <= at);
        let mark = after.checked_sub(1).and_then(|index| self.marks.get(index));
        let (from, begins) = mark.map_or((0, Instant(0)), |mark| (mark.at, mark.begins));
        let paced = begins + self.settings.frame_time(at.saturating_sub(from));
        let next = self.marks.get(after).map(|mark| mark.begins);
        paced.min(next.or(self.last).unwrap_or(paced))
    }

    /// When the bytes before a position ended.
    fn end(&self, len: usize) -> Instant {
        let last = len.saturating_sub(1);
        let paced = self.time(last) + self.settings.frame_time(1);
        let next = self.marks.iter().find(|mark| mark.at > last);
        let limit = next.map(|mark| mark.begins).or(self.last);
        paced.min(limit.unwrap_or(paced))
    }

    /// Reports the first bytes as noise, split where there was silence.
    fn noise(&mut self, len: usize) {
        let mut left = len.min(self.bytes.len());
        while left > 0 {
            let cut = self.marks.iter().find(|mark| mark.gap && mark.at > 0);
            let len = cut.map_or(left, |mark| mark.at.min(left));
            let pending = self.pending.as_ref().and_then(|p| p.asked.exchange());
            let noise = self.bytes.get(..len).unwrap_or_default();
            let (readings, verdict) = judge(noise, pending.as_ref());
            let answers = readings.first().is_some_and(|reading| {
                reading.role == Some(FrameRole::Reply)
                    && pending.is_some_and(|asked| asked.protocol() == reading.protocol)
            });
            let asks =
                readings.first().and_then(|reading| reading.role) == Some(FrameRole::Request);
            if asks && verdict == FrameVerdict::Unknown {
                // The master sends another request: it no longer waits.
                self.give_up(self.time(0));
                self.pending = None;
            }
            self.tell(len, readings, verdict, answers);
            match &mut self.pending {
                // A refusal without CRC is still an answer.
                Some(_) if answers && verdict == FrameVerdict::Refused => self.pending = None,
                Some(pending) => pending.spoiled = true,
                None => {}
            }
            left -= len;
        }
    }

    fn frame(&mut self, look: &Look, best: Find) {
        let readings = look.readings(best);
        let paired = best.trust == Trust::Paired;
        let reading = best.reading;
        let bytes = self.bytes.get(..best.len).unwrap_or_default();
        let asked = match reading.role {
            Some(FrameRole::Request) => Asked::new(reading, bytes),
            _ => None,
        };
        if reading.role == Some(FrameRole::Request) {
            self.give_up(self.time(0));
            self.pending = None;
        }
        let end = self.tell(best.len, readings, best.verdict, paired);
        if paired {
            self.pending = None;
        }
        self.pending = match asked {
            Some(asked) => Some(Pending {
                over: !waits(&asked),
                spoiled: false,
                asked,
                end,
            }),
            None => self.pending.take(),
        };
    }

    /// Removes bytes from the buffer and reports them; returns when they ended.
    fn tell(
        &mut self,
        len: usize,
        readings: Vec<Reading>,
        verdict: FrameVerdict,
        answers: bool,
    ) -> Instant {
        let at = self.time(0);
        let end = self.end(len);
        let bytes: Vec<u8> = self.bytes.drain(..len.min(self.bytes.len())).collect();
        self.tried = self.tried.saturating_sub(len);
        self.forget_marks(len, end);
        let pending = self.pending.as_ref().filter(|_| answers);
        let frame = SniffedFrame {
            at,
            end,
            gap: self.told.map(|told| at.since(told)),
            bytes,
            readings,
            after: pending.map(|pending| at.since(pending.end)),
            late: pending.is_some_and(|pending| pending.over),
            asked: pending.map(|pending| pending.asked.clone()),
            verdict,
        };
        self.told = Some(end);
        self.out.push_back(SniffEvent::Frame(frame));
        end
    }

    fn forget_marks(&mut self, len: usize, end: Instant) {
        let mut begins = end;
        while let Some(mark) = self.marks.front().filter(|mark| mark.at <= len) {
            if mark.at == len {
                begins = mark.begins;
            }
            self.marks.pop_front();
        }
        for mark in &mut self.marks {
            mark.at -= len;
        }
        if !self.bytes.is_empty() {
            self.marks.push_front(Mark {
                at: 0,
                begins,
                gap: false,
            });
        }
    }

    fn expire(&mut self, now: Instant) {
        let Some(pending) = &self.pending else { return };
        if pending.end + self.patience <= now && self.bytes.is_empty() {
            self.give_up(now);
        }
        if self
            .pending
            .as_ref()
            .is_some_and(|pending| pending.end + LATE_MAX <= now)
        {
            self.pending = None;
        }
    }

    /// The pending request will not be answered.
    fn give_up(&mut self, at: Instant) {
        let Some(pending) = self.pending.as_mut().filter(|pending| !pending.over) else {
            return;
        };
        pending.over = true;
        if !pending.spoiled {
            self.out.push_back(SniffEvent::Missing(Missing {
                asked: pending.asked.clone(),
                at,
                after: at.since(pending.end),
            }));
        }
    }
}

/// Whether the request expects a reply.
fn waits(asked: &Asked) -> bool {
    asked.exchange().is_some_and(|asked| match asked {
        Exchange::R55(e) => {
            let read = matches!(e.request(), r55::Request::ReadAddress);
            e.expects_reply() && (e.address() != r55::BROADCAST || read)
        }
        asked => asked.expects_reply() || asked.protocol() == Protocol::Lc02,
    })
}

const fn before(now: Instant, span: Micros) -> Instant {
    Instant(now.0.saturating_sub(span.0))
}
