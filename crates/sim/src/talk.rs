//! Characters on the wire: what one sender sends without a pause.

use crate::SlotId;
use railbus_wire::{Character, Instant, SerialSettings};

/// Never.
pub(crate) const NEVER: Instant = Instant(u64::MAX);

/// The sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Talker {
    Host,
    Module(SlotId),
    /// Noise: every receiver takes it for characters at its own speed.
    Noise,
}

/// How a character is not received as sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// Received with a wrong stop bit or parity.
    Bad,
    /// Not received.
    Lost,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum State {
    Waiting,
    Running,
    Over,
}

/// What one sender sends without a pause. It is complete from the start: a collision may corrupt
/// later characters, and a loss of power truncate them.
#[derive(Clone, Debug)]
pub(crate) struct Talk {
    pub(crate) who: Talker,
    pub(crate) settings: SerialSettings,
    /// When the first character begins.
    pub(crate) start: Instant,
    pub(crate) bytes: Vec<u8>,
    pub(crate) marks: Vec<(usize, Mark)>,
    /// The modules that do not receive it.
    pub(crate) unheard_by: Vec<SlotId>,
    pub(crate) state: State,
    /// Others sent at the same time.
    pub(crate) clashes: bool,
    /// The first character not delivered yet.
    pub(crate) next: usize,
    /// The end of the characters to be delivered together.
    pub(crate) chunk: usize,
    /// When to look at this again: its start, or the end of the chunk.
    pub(crate) due: Instant,
    /// More garbage follows until then.
    pub(crate) babble_until: Option<Instant>,
}

impl Talk {
    pub(crate) const fn new() -> Talk {
        Talk {
            who: Talker::Noise,
            settings: SerialSettings::FACTORY,
            start: NEVER,
            bytes: Vec::new(),
            marks: Vec::new(),
            unheard_by: Vec::new(),
            state: State::Waiting,
            clashes: false,
            next: 0,
            chunk: 0,
            due: NEVER,
            babble_until: None,
        }
    }

    /// Reuses it for a new talk, keeping the memory.
    pub(crate) fn reset(&mut self, who: Talker, settings: SerialSettings, start: Instant) {
        self.bytes.clear();
        self.marks.clear();
        self.unheard_by.clear();
        *self = Talk {
            who,
            settings,
            start,
            due: start,
            bytes: core::mem::take(&mut self.bytes),
            marks: core::mem::take(&mut self.marks),
            unheard_by: core::mem::take(&mut self.unheard_by),
            ..Talk::new()
        };
    }

    /// When this many characters have ended.
    pub(crate) fn end_of(&self, characters: usize) -> Instant {
        self.start + self.settings.frame_time(characters)
    }

    /// When the last character has ended.
    pub(crate) fn end(&self) -> Instant {
        self.end_of(self.bytes.len())
    }

    /// How many characters have ended by then.
    pub(crate) fn ended_by(&self, now: Instant) -> usize {
        let bit_micros = u64::from(self.settings.character.bits()) * 1_000_000;
        let rate = u64::from(self.settings.baud.rate());
        let ended = now.since(self.start).0.saturating_mul(rate) / bit_micros;
        self.bytes.len().min(usize::try_from(ended).unwrap_or(0))
    }

    pub(crate) fn mark(&self, index: usize) -> Option<Mark> {
        let marked = self.marks.iter().find(|(at, _)| *at == index);
        marked.map(|(_, mark)| *mark)
    }

    /// Plans to deliver the next characters together, at most up to the next one that may end a
    /// request: a module may reply from there on.
    pub(crate) fn plan(&mut self, most: usize) {
        let rest = self.bytes.len() - self.next;
        let most = most.clamp(1, rest.max(1)).min(rest);
        let ends = (self.next..self.next + most).find(|index| self.may_end_request(*index));
        self.chunk = ends.map_or(self.next + most, |index| index + 1);
        self.due = self.end_of(self.chunk);
    }

    /// ASCII and LC-02 requests end with 0D, 0x55 requests have eight bytes; Modbus requests end
    /// with silence, which is not part of a talk.
    fn may_end_request(&self, index: usize) -> bool {
        let start = index.checked_sub(7).and_then(|at| self.bytes.get(at));
        self.bytes.get(index) == Some(&0x0D) || start == Some(&0x55)
    }

    /// Truncates it now; a character that is being sent becomes bad.
    pub(crate) fn cut(&mut self, now: Instant) {
        self.babble_until = None;
        let ended = self.ended_by(now);
        if self.state == State::Waiting || self.start >= now {
            self.bytes.clear();
            self.finish();
        } else if ended < self.bytes.len() {
            let in_the_middle = self.end_of(ended) < now;
            self.bytes.truncate(ended + usize::from(in_the_middle));
            if in_the_middle {
                self.marks.push((ended, Mark::Bad));
            }
        }
    }

    /// Truncates it now, and delivers the rest of it.
    pub(crate) fn end_early(&mut self, now: Instant) {
        self.cut(now);
        if self.state == State::Running {
            self.plan(1);
        }
    }

    pub(crate) const fn finish(&mut self) {
        self.state = State::Over;
        self.due = NEVER;
    }
}

/// Whether a receiver with some settings understands a sender with others.
pub(crate) fn understands(receiver: SerialSettings, talker: SerialSettings) -> bool {
    // A second stop bit is a longer idle time; receivers check the first one only.
    const fn parity(character: Character) -> Character {
        match character {
            Character::N2 => Character::N1,
            other => other,
        }
    }
    receiver.baud == talker.baud && parity(receiver.character) == parity(talker.character)
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_wire::{Baud, Micros};

    fn talk(bytes: &[u8]) -> Talk {
        let mut talk = Talk::new();
        talk.reset(Talker::Host, SerialSettings::FACTORY, Instant(1_000));
        talk.bytes.extend(bytes);
        talk
    }

    #[test]
    fn characters_end_exactly_when_they_have_ended() {
        for baud in Baud::ALL {
            let mut talk = talk(&[0; 256]);
            talk.settings.baud = baud;
            for count in 1..=256 {
                let end = talk.end_of(count);
                assert_eq!(talk.ended_by(end), count);
                assert_eq!(talk.ended_by(Instant(end.0 - 1)), count - 1);
            }
        }
    }

    #[test]
    fn a_chunk_ends_where_a_request_may_end() {
        let mut talk = talk(b"\x55\x01\x10\x00\x00\x00\x00\x66\x55\x01$016\r#");
        let mut chunks = Vec::new();
        while talk.next < talk.bytes.len() {
            talk.plan(usize::MAX);
            chunks.push(talk.chunk - talk.next);
            talk.next = talk.chunk;
        }
        assert_eq!(chunks, [8, 7, 1]);
        assert_eq!(talk.due, Instant(1_000) + Micros(16_667));
    }
}
