//! Sending, and random faults in what is sent.

use super::{BACKLOG_MAX, VirtualLine};
use crate::talk::{Mark, NEVER, State, Talk, Talker};
use crate::{Faults, SlotId, TraceDirection};
use railbus_wire::{Character, Instant, Micros, SerialSettings};

/// Babble consists of bursts of this many characters.
const BURST: usize = 64;

impl VirtualLine {
    /// The host sends, after everything queued before.
    pub(super) fn send(&mut self, bytes: &[u8], settings: SerialSettings) {
        self.host_settings = settings;
        let start = self.now.max(self.host_free_at);
        if bytes.is_empty() {
            return;
        }
        if start.since(self.now) > BACKLOG_MAX {
            self.note(
                self.now,
                Talker::Host,
                TraceDirection::Fault,
                "overrun",
                bytes,
            );
            return;
        }
        let mut talk = self.new_talk(Talker::Host, settings, start, bytes);
        for (index, slot) in self.slots.iter().enumerate() {
            let chance = slot.faults.lose_request;
            if slot.powered && slot.is_addressed(bytes) && self.random.happens(chance) {
                self.injected.lost_requests += 1;
                talk.unheard_by.push(SlotId(index));
            }
        }
        for index in 0..talk.unheard_by.len() {
            let who = Talker::Module(talk.unheard_by[index]);
            self.note(start, who, TraceDirection::Fault, "lost request", &[]);
        }
        self.host_free_at = talk.end();
        self.spoil(&mut talk, self.config.faults);
        self.talks.push(talk);
    }

    /// A module starts to send its reply, which is in the scratch buffer.
    pub(super) fn reply(&mut self, module: SlotId, at: Instant) {
        let slot = &self.slots[module.0];
        let (faults, settings) = (slot.faults, slot.engine.active().serial);
        let mut reply = core::mem::take(&mut self.scratch);
        let who = Talker::Module(module);
        if self.random.happens(faults.spoil)
            && let Some(last) = reply.last_mut()
        {
            *last ^= 0x10;
            self.injected.spoilt += 1;
            self.note(at, who, TraceDirection::Fault, "spoilt", &[]);
        }
        self.slots[module.0].sent_at = if self.random.happens(faults.lose_reply) {
            self.injected.lost_replies += 1;
            self.note(at, who, TraceDirection::Fault, "lost reply", &reply);
            at + settings.frame_time(reply.len())
        } else if self.random.happens(faults.babble) {
            let time = self.random.within(faults.babble_for);
            self.talk_garbage(who, settings, at, time);
            at + time
        } else {
            self.talk_with_faults(who, settings, at, &reply, faults)
        };
        self.scratch = reply;
    }

    /// Sends a reply late, with glitches, in pieces, or twice, as drawn at random; returns when its
    /// first copy will have been sent.
    fn talk_with_faults(
        &mut self,
        who: Talker,
        settings: SerialSettings,
        at: Instant,
        reply: &[u8],
        faults: Faults,
    ) -> Instant {
        let mut start = at;
        if self.random.happens(faults.late) {
            let later = self.random.within(faults.late_by);
            start = start + later;
            self.injected.late += 1;
            self.note_number(at, who, TraceDirection::Fault, "late", Some(later.0), &[]);
        }
        let end = if self.random.happens(faults.pieces) {
            self.injected.pieces += 1;
            self.note(at, who, TraceDirection::Fault, "pieces", &[]);
            self.talk_in_pieces(who, settings, start, reply, faults)
        } else {
            self.talk(who, settings, start, reply, faults)
        };
        if self.random.happens(faults.again) {
            self.injected.again += 1;
            let start = end + self.random.within(faults.again_after);
            self.note(at, who, TraceDirection::Fault, "again", &[]);
            self.talk(who, settings, start, reply, faults);
        }
        end
    }

    fn talk_in_pieces(
        &mut self,
        who: Talker,
        settings: SerialSettings,
        start: Instant,
        mut rest: &[u8],
        faults: Faults,
    ) -> Instant {
        let mut end = start;
        for pieces in (1..=2 + self.random.below(3)).rev() {
            let most = (rest.len() as u64).saturating_sub(pieces - 1);
            let len = match pieces {
                1 => rest.len(),
                _ => 1 + self.random.below(most) as usize,
            };
            let Some((piece, after)) = rest.split_at_checked(len).filter(|_| len > 0) else {
                break;
            };
            rest = after;
            let pause = if end == start {
                Micros::ZERO
            } else {
                self.random.within(faults.pause)
            };
            end = self.talk(who, settings, end + pause, piece, faults);
        }
        end
    }

    /// Sends characters without a pause; returns when they will have been sent.
    fn talk(
        &mut self,
        who: Talker,
        settings: SerialSettings,
        start: Instant,
        bytes: &[u8],
        faults: Faults,
    ) -> Instant {
        let mut talk = self.new_talk(who, settings, start, bytes);
        self.spoil(&mut talk, faults);
        if self.random.happens(faults.glitch_before) {
            self.injected.glitches += 1;
            talk.bytes.insert(0, 0x00);
            for (index, _) in &mut talk.marks {
                *index += 1;
            }
        }
        if self.random.happens(faults.glitch_after) {
            self.injected.glitches += 1;
            talk.bytes.push(0xFF);
        }
        let end = talk.end();
        self.talks.push(talk);
        end
    }

    /// Garbage for a time, in consecutive bursts.
    pub(super) fn talk_garbage(
        &mut self,
        who: Talker,
        settings: SerialSettings,
        at: Instant,
        time: Micros,
    ) {
        self.injected.babble += 1;
        self.note_number(at, who, TraceDirection::Fault, "babble", Some(time.0), &[]);
        self.burst(who, settings, at, at + time);
    }

    pub(super) fn burst(
        &mut self,
        who: Talker,
        settings: SerialSettings,
        at: Instant,
        until: Instant,
    ) {
        if at >= until {
            return;
        }
        let mut talk = self.new_talk(who, settings, at, &[]);
        while talk.end() < until && talk.bytes.len() < BURST {
            talk.bytes.push(self.random.byte());
        }
        talk.babble_until = Some(until);
        self.talks.push(talk);
    }

    /// One to three characters of noise, if the line is idle.
    pub(super) fn make_noise(&mut self, at: Instant) {
        let Some(mean) = self.config.faults.noise_every else {
            self.noise_at = NEVER;
            return;
        };
        self.noise_at = at + self.random.around(mean);
        if self.talks.iter().any(|talk| talk.state == State::Running) {
            return;
        }
        self.injected.noise += 1;
        let mut talk = self.new_talk(Talker::Noise, self.host_settings, at, &[]);
        for _ in 0..=self.random.below(3) {
            talk.bytes.push(self.random.byte());
        }
        self.talks.push(talk);
    }

    /// Starts the talks that are due. Everything sent before has been delivered.
    pub(super) fn start_talks(&mut self, at: Instant) {
        for index in 0..self.talks.len() {
            let talk = &self.talks[index];
            if talk.state != State::Waiting || talk.due > at {
                continue;
            }
            self.hand_out_ended(at);
            self.talks[index].state = State::Running;
            let running = |talk: &&mut Talk| talk.state == State::Running;
            let alone = self.talks.iter_mut().filter(running).count() == 1;
            if alone {
                self.plan_chunk(index);
            } else {
                for talk in self.talks.iter_mut().filter(running) {
                    talk.clashes = true;
                    talk.plan(1);
                }
            }
            self.note_start(index);
        }
    }

    fn note_start(&mut self, index: usize) {
        if self.trace.is_none() {
            return;
        }
        let (who, start) = (self.talks[index].who, self.talks[index].start);
        let direction = match who {
            Talker::Host => TraceDirection::Out,
            Talker::Module(_) => TraceDirection::Talk,
            Talker::Noise => TraceDirection::Fault,
        };
        let event = if who == Talker::Noise {
            "noise"
        } else {
            "sends"
        };
        let bytes = core::mem::take(&mut self.talks[index].bytes);
        self.note(start, who, direction, event, &bytes);
        self.talks[index].bytes = bytes;
    }

    fn new_talk(
        &mut self,
        who: Talker,
        settings: SerialSettings,
        start: Instant,
        bytes: &[u8],
    ) -> Talk {
        let mut talk = self.spare.pop().unwrap_or(const { Talk::new() });
        talk.reset(who, settings, start);
        talk.bytes.extend_from_slice(bytes);
        talk
    }

    /// Corrupts single characters at random.
    fn spoil(&mut self, talk: &mut Talk, faults: Faults) {
        for index in 0..talk.bytes.len() {
            if self.random.happens(faults.flip) {
                self.flip(talk, index);
            } else if self.random.happens(faults.lose_character) {
                self.injected.lost_characters += 1;
                talk.marks.push((index, Mark::Lost));
                let at = talk.start;
                self.note(
                    at,
                    talk.who,
                    TraceDirection::Fault,
                    "lost",
                    &[talk.bytes[index]],
                );
            }
        }
    }

    /// Flips one bit of a character, or two: data bits, parity or the stop bit.
    fn flip(&mut self, talk: &mut Talk, index: usize) {
        self.injected.flips += 1;
        let at = talk.start;
        let before = talk.bytes[index];
        let bits = u64::from(talk.settings.character.bits()) - 1;
        let mut turned = 1 << self.random.below(bits);
        if self.random.below(4) == 0 {
            turned |= 1 << self.random.below(bits);
        }
        let data = turned as u8;
        if is_noticed(talk.settings.character, turned) {
            talk.marks.push((index, Mark::Bad));
        } else {
            talk.bytes[index] = before ^ data;
        }
        self.note(
            at,
            talk.who,
            TraceDirection::Fault,
            "flip",
            &[before, before ^ data],
        );
    }
}

/// Whether a receiver detects these flipped bits of a character: bits 0 to 7 are the data, followed
/// by parity, if there is one, and the stop bit.
const fn is_noticed(character: Character, turned: u32) -> bool {
    let (under_parity, stop) = match character {
        Character::N1 | Character::N2 => (0, !0xFF),
        Character::E1 | Character::O1 => (0x1FF, !0x1FF),
    };
    turned & stop != 0 || (turned & under_parity).count_ones() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parity_notices_one_bit_but_not_two() {
        use Character::{E1, N1, O1};
        for bit in 0..9 {
            assert!(is_noticed(E1, 1 << bit) && is_noticed(O1, 1 << bit));
        }
        assert!(!is_noticed(E1, 0b11), "two data bits");
        assert!(!is_noticed(E1, 0x101), "a data bit and the parity");
        assert!(is_noticed(E1, 0x201), "a data bit and the stop bit");
        assert!(!is_noticed(N1, 0x01) && is_noticed(N1, 0x100));
    }
}
