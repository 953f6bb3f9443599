//! The judge. It knows what the modules really did and when, and nothing of the line master or
//! of protocols: it imports neither.
//!
//! Whatever was reported of a module must have been so at some moment between request and reply; a
//! command reported as done must have been done; what must not be done twice must not have been.

use std::collections::{BTreeMap, VecDeque};

/// How long the past of a module is kept, in microseconds.
const MEMORY: u64 = 30_000_000;

/// The counts of what was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Verdicts {
    /// Readings judged.
    pub(crate) readings: u64,
    /// Readings of a value that was not so, though every character was received as sent: another
    /// module's, or another moment's.
    pub(crate) misattributed: u64,
    /// Readings of a value that was not so, where characters had been garbled: the protocol's
    /// checksum, if it has one, did not detect it.
    pub(crate) undetected: u64,
    /// Commands that ended.
    pub(crate) commands: u64,
    /// Commands that were confirmed.
    pub(crate) confirmed: u64,
    /// Confirmed, but not done, though every character was received as sent.
    pub(crate) falsely_confirmed: u64,
    /// As above where characters had been garbled.
    pub(crate) confirmed_undetected: u64,
    /// Said not to have acted, though the outputs went as commanded, by nobody else, and every
    /// character was received as sent.
    pub(crate) falsely_denied: u64,
    /// As above where characters had been garbled.
    pub(crate) denied_undetected: u64,
    /// Actions of outputs that are only toggled or pulsed, more than one for each command.
    pub(crate) doubled: u64,
    /// As above where characters had been garbled: the module took one command for another.
    pub(crate) acted_undetected: u64,
}

impl Verdicts {
    /// Adds another run's.
    pub(crate) fn add(&mut self, other: &Verdicts) {
        self.readings += other.readings;
        self.misattributed += other.misattributed;
        self.undetected += other.undetected;
        self.commands += other.commands;
        self.confirmed += other.confirmed;
        self.falsely_confirmed += other.falsely_confirmed;
        self.confirmed_undetected += other.confirmed_undetected;
        self.falsely_denied += other.falsely_denied;
        self.denied_undetected += other.denied_undetected;
        self.doubled += other.doubled;
        self.acted_undetected += other.acted_undetected;
    }
}

/// A quantity over time: when it took which value.
#[derive(Debug)]
struct Past(VecDeque<(u64, u32)>);

impl Past {
    fn new(value: u32) -> Past {
        Past(VecDeque::from([(0, value)]))
    }

    fn is_now(&self) -> u32 {
        self.0.back().map_or(0, |(_, value)| *value)
    }

    fn becomes(&mut self, at: u64, value: u32) {
        if self.is_now() != value {
            self.0.push_back((at, value));
        }
        while self.0.get(1).is_some_and(|(next, _)| next + MEMORY < at) {
            self.0.pop_front();
        }
    }

    /// Whether it had, at some moment from `from` to `to`, a matching value.
    fn was(&self, from: u64, to: u64, suits: impl Fn(u32) -> bool) -> bool {
        let ends = self.0.iter().skip(1).map(|(at, _)| *at).chain([u64::MAX]);
        self.0
            .iter()
            .zip(ends)
            .any(|((begin, value), end)| *begin <= to && end >= from && suits(*value))
    }
}

/// What is known of one module.
#[derive(Debug)]
struct Truth {
    outputs: Past,
    inputs: Past,
    analogs: [Past; 2],
    once_only: OnceOnly,
    /// How many actions followed garbled characters.
    doubtful: u64,
}

/// Outputs that do something each time they are commanded.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct OnceOnly {
    /// They act by going on.
    pub(crate) pulsed: u32,
    /// They act by changing.
    pub(crate) toggled: u32,
}

/// A command as the judge sees it.
#[derive(Clone, Copy, Debug)]
struct Wish {
    module: usize,
    mask: u32,
    on: u32,
    since: u64,
    spoilt: u64,
    /// How many actions it may still cause of outputs that act each time they are commanded.
    actions: u32,
    /// No other command was pending for its module meanwhile, and its outputs were not as wanted:
    /// if they are afterwards, it was this one.
    is_alone: bool,
}

/// How a command was said to have ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ToldEnd {
    Done,
    /// It may have acted.
    Unknown,
    NotDone,
}

/// What was reported of a module.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Told {
    /// These outputs are so.
    Outputs { mask: u32, on: u32 },
    /// These inputs are so.
    Inputs { mask: u32, on: u32 },
    /// This analog input is so.
    Analog { channel: usize, value: u16 },
}

/// The judge of one line.
#[derive(Debug, Default)]
pub(crate) struct Oracle {
    modules: Vec<Truth>,
    wishes: BTreeMap<u64, Wish>,
    /// What was found so far.
    pub(crate) verdicts: Verdicts,
    /// The first thing found to be wrong, in words.
    pub(crate) first_wrong: Option<String>,
}

impl Oracle {
    /// Another module, with these inputs; its outputs are off.
    pub(crate) fn add(&mut self, inputs: u32, once_only: OnceOnly) {
        self.modules.push(Truth {
            outputs: Past::new(0),
            inputs: Past::new(inputs),
            analogs: [Past::new(0), Past::new(0)],
            once_only,
            doubtful: 0,
        });
    }

    /// An output really went on or off; `spoilt` says whether characters were garbled since the
    /// last request.
    pub(crate) fn output(&mut self, at: u64, module: usize, bank: (u8, bool), spoilt: bool) {
        let (channel, on) = bank;
        let truth = &mut self.modules[module];
        let bit = 1 << channel;
        let outputs = truth.outputs.is_now() & !bit | if on { bit } else { 0 };
        truth.outputs.becomes(at, outputs);
        let OnceOnly { pulsed, toggled } = truth.once_only;
        if pulsed & bit != 0 && on || toggled & bit != 0 {
            self.acted(at, module, spoilt);
        }
    }

    /// The module lost its power, and with it this output went off.
    pub(crate) fn lost_power(&mut self, at: u64, module: usize, channel: u8) {
        let outputs = &mut self.modules[module].outputs;
        outputs.becomes(at, outputs.is_now() & !(1 << channel));
    }

    /// An output acted that does so each time it is commanded; by which command? The oldest one for
    /// it comes first; but a garbled frame may have been another one, and then the command that
    /// seems to have acted is still to come.
    fn acted(&mut self, at: u64, module: usize, spoilt: bool) {
        let doubtful = &mut self.modules[module].doubtful;
        *doubtful += u64::from(spoilt);
        let mut pending = self.wishes.values_mut();
        match pending.find(|wish| wish.module == module && wish.actions > 0) {
            Some(wish) => wish.actions -= 1,
            None if *doubtful > 0 => {
                *doubtful -= 1;
                self.verdicts.acted_undetected += 1;
            }
            None => {
                self.verdicts.doubled += 1;
                self.wrong(format!("at {at} us: module {module} acted once too often"));
            }
        }
    }

    /// The inputs of a module were really changed.
    pub(crate) fn inputs(&mut self, at: u64, module: usize, levels: u32) {
        self.modules[module].inputs.becomes(at, levels);
    }

    /// An analog input was really changed.
    pub(crate) fn analog(&mut self, at: u64, module: usize, channel: usize, value: u16) {
        self.modules[module].analogs[channel].becomes(at, value.into());
    }

    /// Something was reported of a module, requested at `from` and received at `to`.
    pub(crate) fn told(&mut self, module: usize, told: Told, from: u64, to: u64, spoilt: bool) {
        let truth = &self.modules[module];
        let right = match told {
            Told::Outputs { mask, on } => truth.outputs.was(from, to, |v| v & mask == on & mask),
            Told::Inputs { mask, on } => truth.inputs.was(from, to, |v| v & mask == on & mask),
            Told::Analog { channel, value } => {
                truth.analogs[channel].was(from, to, |v| v == u32::from(value))
            }
        };
        self.verdicts.readings += 1;
        if right {
            return;
        }
        if spoilt {
            self.verdicts.undetected += 1;
        } else {
            self.verdicts.misattributed += 1;
            self.wrong(format!(
                "at {to} us, asked at {from}: module {module} told {told:?}"
            ));
        }
    }

    /// A command was given, for outputs of the mask to go to these states (an empty mask if they
    /// are unknown); `spoilt` counts the garbled characters so far.
    pub(crate) fn commanded(
        &mut self,
        ticket: u64,
        module: usize,
        (mask, on): (u32, u32),
        since: u64,
        spoilt: u64,
    ) {
        let OnceOnly { pulsed, toggled } = self.modules[module].once_only;
        let actions = if mask == 0 {
            toggled
        } else {
            mask & on & pulsed
        }
        .count_ones();
        let mut is_alone = mask != 0;
        for other in self.wishes.values_mut() {
            if other.module == module {
                (other.is_alone, is_alone) = (false, false);
            }
        }
        is_alone &= self.modules[module].outputs.is_now() & mask != on & mask;
        self.wishes.insert(
            ticket,
            Wish {
                module,
                mask,
                on,
                since,
                spoilt,
                actions,
                is_alone,
            },
        );
    }

    /// A command ended.
    pub(crate) fn ended(&mut self, ticket: u64, end: ToldEnd, at: u64, spoilt: u64) {
        let Some(wish) = self.wishes.remove(&ticket) else {
            return self.wrong(format!("at {at} us: command {ticket} ended twice"));
        };
        self.verdicts.commands += 1;
        if end == ToldEnd::Done {
            self.verdicts.confirmed += 1;
        }
        let done = self.modules[wish.module]
            .outputs
            .was(wish.since, at, |v| v & wish.mask == wish.on & wish.mask);
        let is_spoilt = spoilt > wish.spoilt;
        match end {
            ToldEnd::Done if !done && is_spoilt => self.verdicts.confirmed_undetected += 1,
            ToldEnd::Done if !done => {
                self.verdicts.falsely_confirmed += 1;
                self.wrong(format!("at {at} us: {wish:?} confirmed, but not done"));
            }
            ToldEnd::NotDone if done && wish.is_alone && is_spoilt => {
                self.verdicts.denied_undetected += 1;
            }
            ToldEnd::NotDone if done && wish.is_alone => {
                self.verdicts.falsely_denied += 1;
                self.wrong(format!("at {at} us: {wish:?} denied, but done"));
            }
            ToldEnd::Done | ToldEnd::Unknown | ToldEnd::NotDone => {}
        }
    }

    /// The run is over: every command must have ended.
    pub(crate) fn close(&mut self) {
        if !self.wishes.is_empty() {
            self.verdicts.falsely_confirmed += self.wishes.len() as u64;
            self.wrong(format!("{} commands never ended", self.wishes.len()));
        }
    }

    fn wrong(&mut self, what: String) {
        self.first_wrong.get_or_insert(what);
    }
}
