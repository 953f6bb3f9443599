//! Delivers the characters on the wire to their receivers.

use super::{Chunks, Outgoing, VirtualLine};
use crate::talk::{Mark, State, Talk, Talker, understands};
use crate::{SlotId, TraceDirection};
use railbus_device::{Effect, Input, Output};
use railbus_wire::{Instant, SerialSettings};

/// A character as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arrives {
    AsSent,
    Garbled(u8),
    Bad,
    Not,
}

/// Consecutive characters and their sender.
#[derive(Clone, Copy)]
struct Heard<'a> {
    who: Talker,
    settings: SerialSettings,
    unheard_by: &'a [SlotId],
    /// When the last of them ended.
    at: Instant,
}

impl VirtualLine {
    /// Delivers the chunks that end now.
    pub(super) fn hand_out_chunks(&mut self, at: Instant) {
        for index in 0..self.talks.len() {
            let talk = &self.talks[index];
            if talk.state == State::Running && talk.due <= at {
                let chunk = talk.chunk;
                self.hand_out(index, chunk);
                self.go_on(index);
            }
        }
    }

    /// Delivers everything that has ended by now, before an event that may depend on it.
    pub(super) fn hand_out_ended(&mut self, at: Instant) {
        for index in 0..self.talks.len() {
            let talk = &self.talks[index];
            if talk.state != State::Running {
                continue;
            }
            let ended = talk.ended_by(at);
            if ended > talk.next {
                self.hand_out(index, ended);
                if self.talks[index].next >= self.talks[index].chunk {
                    self.go_on(index);
                }
            }
        }
    }

    /// Plans the next chunk, or ends the talk.
    fn go_on(&mut self, index: usize) {
        let talk = &mut self.talks[index];
        if talk.next < talk.bytes.len() {
            self.plan_chunk(index);
            return;
        }
        let (who, settings, end) = (talk.who, talk.settings, talk.end());
        talk.finish();
        if let Some(until) = talk.babble_until.take() {
            self.burst(who, settings, end, until);
        }
    }

    pub(super) fn plan_chunk(&mut self, index: usize) {
        let running = |talk: &&Talk| talk.state == State::Running;
        let alone = self.talks.iter().filter(running).count() == 1;
        let rest = self.talks[index].bytes.len() - self.talks[index].next;
        let most = match self.config.chunks {
            _ if !alone => 1,
            Chunks::Whole => rest,
            Chunks::Single => 1,
            Chunks::Random => 1 + self.random.below(rest as u64) as usize,
        };
        self.talks[index].plan(most);
    }

    /// Delivers the characters of a talk up to `end`.
    fn hand_out(&mut self, index: usize, end: usize) {
        let talk = &mut self.talks[index];
        let from = core::mem::replace(&mut talk.next, end);
        let (bytes, unheard_by) = (
            core::mem::take(&mut talk.bytes),
            core::mem::take(&mut talk.unheard_by),
        );
        let heard = Heard {
            who: talk.who,
            settings: talk.settings,
            unheard_by: &unheard_by,
            at: talk.end_of(end),
        };
        if talk.marks.is_empty() && !talk.clashes {
            self.all_hear(heard, &bytes[from..end]);
        } else {
            self.hand_out_spoilt(index, heard, from, &bytes[..end]);
        }
        let talk = &mut self.talks[index];
        (talk.bytes, talk.unheard_by) = (bytes, unheard_by);
    }

    /// Delivers characters of which some may be corrupted: good ones in runs, the others one by
    /// one.
    fn hand_out_spoilt(&mut self, index: usize, mut heard: Heard<'_>, from: usize, bytes: &[u8]) {
        let mut run = from;
        for at in from..bytes.len() {
            let arrives = self.arrives(index, at);
            if arrives == Arrives::AsSent {
                continue;
            }
            heard.at = self.talks[index].end_of(at);
            self.all_hear(heard, &bytes[run..at]);
            run = at + 1;
            heard.at = self.talks[index].end_of(run);
            match arrives {
                Arrives::AsSent | Arrives::Not => {}
                Arrives::Garbled(byte) => self.all_hear(heard, &[byte]),
                Arrives::Bad => self.all_hear_bad(heard),
            }
        }
        heard.at = self.talks[index].end_of(bytes.len());
        self.all_hear(heard, &bytes[run..]);
    }

    fn arrives(&mut self, index: usize, character: usize) -> Arrives {
        let talk = &self.talks[index];
        let (begin, end) = (talk.end_of(character), talk.end_of(character + 1));
        let others = self.talks.iter().enumerate().filter(|(at, _)| *at != index);
        // The bytes of the current talk are taken out of it at this point, but not those of the
        // others.
        let clash = others
            .filter(|(_, other)| other.state != State::Waiting)
            .any(|(_, other)| other.start < end && other.end() > begin);
        let mark = talk.mark(character);
        self.collisions += u64::from(clash);
        match mark {
            _ if clash => match self.random.below(4) {
                0 => Arrives::Bad,
                1 => Arrives::Not,
                _ => Arrives::Garbled(self.random.byte()),
            },
            Some(Mark::Bad) => Arrives::Bad,
            Some(Mark::Lost) => Arrives::Not,
            None => Arrives::AsSent,
        }
    }

    fn all_hear(&mut self, heard: Heard<'_>, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        for index in 0..self.slots.len() {
            let module = SlotId(index);
            if let Some(understood) = self.reaches(module, heard) {
                let input = if understood {
                    Input::Bytes(bytes)
                } else {
                    Input::BadByte
                };
                self.tell(module, heard.at, input);
            }
        }
        self.host_hears(heard, bytes);
    }

    fn all_hear_bad(&mut self, heard: Heard<'_>) {
        for index in 0..self.slots.len() {
            if self.reaches(SlotId(index), heard).is_some() {
                self.tell(SlotId(index), heard.at, Input::BadByte);
            }
        }
        let garbage = self.random.byte();
        self.host_hears(heard, &[garbage]);
    }

    /// Whether a module receives these characters at all, and whether it understands them.
    fn reaches(&self, module: SlotId, heard: Heard<'_>) -> Option<bool> {
        let slot = &self.slots[module.0];
        let is_itself = heard.who == Talker::Module(module);
        if !slot.powered || is_itself || heard.unheard_by.contains(&module) {
            return None;
        }
        let own = slot.engine.active().serial;
        Some(heard.who == Talker::Noise || understands(own, heard.settings))
    }

    fn host_hears(&mut self, heard: Heard<'_>, bytes: &[u8]) {
        let deaf = match heard.who {
            Talker::Host => !self.config.echo,
            Talker::Module(_) | Talker::Noise => !self.config.echo && self.host_talks_at(heard.at),
        };
        if deaf {
            return;
        }
        let from = self.heard.len();
        let is_noise = heard.who == Talker::Noise;
        if is_noise || understands(self.host_settings, heard.settings) {
            self.heard.extend_from_slice(bytes);
        } else {
            for _ in bytes {
                self.heard.push(self.random.byte());
            }
        }
        if self.trace.is_some() {
            let heard_bytes = self.heard.split_off(from);
            self.note(
                heard.at,
                Talker::Host,
                TraceDirection::In,
                "hears",
                &heard_bytes,
            );
            self.heard.extend_from_slice(&heard_bytes);
        }
        self.outbox.push_back(Outgoing::Heard {
            at: heard.at,
            from,
            to: self.heard.len(),
        });
    }

    fn host_talks_at(&self, at: Instant) -> bool {
        let mut host = self.talks.iter().filter(|talk| talk.who == Talker::Host);
        host.any(|talk| talk.state != State::Waiting && talk.start < at && talk.end() >= at)
    }

    /// Passes an input to a module, and does what it asks for.
    pub(super) fn tell(&mut self, module: SlotId, at: Instant, input: Input<'_>) {
        self.slots[module.0].handle(at, input);
        self.drain(module, at);
    }

    pub(super) fn drain(&mut self, module: SlotId, at: Instant) {
        loop {
            match self.slots[module.0].engine.poll() {
                Output::Effect(effect) => self.effect(module, at, effect),
                Output::Transmit(bytes) => {
                    self.scratch.clear();
                    self.scratch.extend_from_slice(bytes);
                    self.slots[module.0].counts.replies += 1;
                    self.reply(module, at);
                }
                Output::Wait(deadline) => {
                    let slot = &self.slots[module.0];
                    let own = slot.sent_at.min(slot.power_at);
                    self.wakes[module.0] = deadline.map_or(own, |at| at.min(own));
                    return;
                }
            }
        }
    }

    pub(super) fn effect(&mut self, module: SlotId, at: Instant, effect: Effect) {
        if self.trace.is_some() {
            self.note_effect(module, at, effect);
        }
        let slot = &mut self.slots[module.0];
        match effect {
            Effect::Led(lit) => slot.lit = lit,
            Effect::Save(_) => slot.counts.saves += 1,
            Effect::Output { .. } | Effect::Serial(_) => {}
        }
        self.outbox
            .push_back(Outgoing::Effect { at, module, effect });
    }

    fn note_effect(&mut self, module: SlotId, at: Instant, effect: Effect) {
        let (event, number) = match effect {
            Effect::Output { channel, on: true } => ("output on", Some(channel.into())),
            Effect::Output { channel, on: false } => ("output off", Some(channel.into())),
            Effect::Serial(settings) => ("speed", Some(settings.baud.rate().into())),
            Effect::Save(_) => ("saves", None),
            // It blinks twice a second, which would flood the trace.
            Effect::Led(_) => return,
        };
        let who = Talker::Module(module);
        self.note_number(at, who, TraceDirection::Panel, event, number, &[]);
    }
}
