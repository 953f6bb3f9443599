//! A module that was found, and what its answers amount to.

use super::ask::{Ask, PATIENCE, Question};
use super::identify::{
    Answer, Identity, describe, description, identify, rules_out, state, version,
};
use railbus_device::Family;
use railbus_wire::{Micros, Protocol};

/// What a module's answers amount to. Who was asked in vain is silent, and not told of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// It answers as a module of a known family.
    Ok,
    /// It answers as one of these families would, and nothing proves that it is one.
    CouldBe,
    /// It answers no, which is a sign of life, too.
    Refused,
    /// It answers, but as no module of a known family.
    Odd,
    /// Something is there, but its replies are spoilt, or there are two of them.
    Garbled,
}

impl Verdict {
    /// The name for programs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Verdict::Ok => "ok",
            Verdict::CouldBe => "could_be",
            Verdict::Refused => "refused",
            Verdict::Odd => "odd",
            Verdict::Garbled => "garbled",
        }
    }
}

/// What is known of a module beyond its model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Nothing.
    None,
    /// Outputs and digital inputs, as the datasheet has them.
    Channels(u8, u8),
    /// Eight coils from 60, and no register that tells a model.
    CoilsAt60,
    /// The version in its first register.
    Version(u16),
    /// A 0x55 board whose highest channel that is on, or high, has this number.
    AtLeast(u8),
    /// No reply of so many was good, and whether they differed.
    Spoilt {
        /// Asked so often.
        tries: usize,
        /// They were not all the same.
        differ: bool,
    },
    /// A second reply came to one question.
    Twice,
}

/// A module that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// The question by which it was heard.
    pub asked: Question,
    /// What it is.
    pub identity: Identity,
    /// From the end of the request to the beginning of its reply.
    pub rtt: Micros,
    /// Everything that it was asked and that it answered.
    pub answers: Vec<Answer>,
    /// What came back that was no good reply.
    pub garbled: Vec<Vec<u8>>,
    /// A second reply came to one question.
    pub twice: bool,
    /// Its name in the configuration.
    pub known: Option<String>,
    /// The configuration says that it is another model.
    pub differs: bool,
}

impl Found {
    /// What these answers show.
    #[must_use]
    pub fn of(asked: Question, answers: Vec<Answer>, garbled: Vec<Vec<u8>>, rtt: Micros) -> Found {
        Found {
            identity: identify(asked, &answers),
            asked,
            rtt,
            answers,
            garbled,
            twice: false,
            known: None,
            differs: false,
        }
    }

    /// The protocol it speaks.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        self.asked.ask.protocol()
    }

    /// Whether its ASCII frames carry a checksum; nothing in other protocols.
    #[must_use]
    pub const fn checksum(&self) -> Option<bool> {
        match self.asked.ask {
            Ask::AsciiName(checksum) => Some(checksum),
            _ => None,
        }
    }

    /// What its answers amount to.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        match &self.identity {
            _ if self.answers.is_empty() || self.twice => Verdict::Garbled,
            Identity {
                family: Some(_), ..
            } => Verdict::Ok,
            is if !is.could_be.is_empty() => Verdict::CouldBe,
            Identity { refused: true, .. } => Verdict::Refused,
            Identity { .. } => Verdict::Odd,
        }
    }

    /// What it says of itself beyond its datasheet: maker, product and version, or its firmware.
    #[must_use]
    pub fn description(&self) -> Option<String> {
        description(self.asked, &self.answers)
    }

    /// Whether its answers show that it is not of this family.
    pub(super) fn rules_out(&self, family: Family) -> bool {
        rules_out(self.asked, &self.answers, family)
    }

    /// What it is to be asked yet, so that it says of itself what it is, and how long it is waited
    /// for.
    pub(super) fn to_describe(&self) -> Option<(Question, Micros)> {
        let ask = describe(self.asked, &self.answers).filter(|_| !self.is_conflict())?;
        let patience = self.rtt * 2 + Micros::from_millis(30);
        Some((self.asked.with(ask), patience.min(PATIENCE)))
    }

    /// What it said to that; nothing where it was silent. Whether it now is known better.
    pub(super) fn described(&mut self, ask: Ask, bytes: Vec<u8>) -> bool {
        self.answers.push((ask, bytes));
        self.description().is_some()
    }

    /// Whether two modules may have its address.
    #[must_use]
    pub fn is_conflict(&self) -> bool {
        self.verdict() == Verdict::Garbled
    }

    /// What is known of it beyond its model.
    #[must_use]
    pub fn detail(&self) -> Detail {
        if self.answers.is_empty() {
            let differ = self
                .garbled
                .windows(2)
                .any(|pair| pair.first() != pair.last());
            let tries = self.garbled.len();
            return Detail::Spoilt { tries, differ };
        }
        if self.twice {
            return Detail::Twice;
        }
        match self.identity.family {
            None => Detail::None,
            Some(Family::Erc8) => Detail::CoilsAt60,
            Some(Family::Emd2a2q) => {
                version(self.asked, &self.answers).map_or(Detail::None, Detail::Version)
            }
            Some(Family::R55) => {
                let state = state(self.asked, &self.answers).unwrap_or_default();
                let highest = u32::BITS - state.leading_zeros();
                u8::try_from(highest).map_or(Detail::None, Detail::AtLeast)
            }
            Some(family @ (Family::Eda9060a | Family::Eda9050)) => {
                let profile = family.profile();
                Detail::Channels(profile.outputs, profile.inputs)
            }
        }
    }

    /// Whether it is the one that answers this question, too. Not every port has a parity, and a
    /// module has only one.
    pub(super) fn answers_to(&self, question: &Question) -> bool {
        self.asked.settings.baud == question.settings.baud
            && self.asked.address == question.address
            && self.protocol() == question.ask.protocol()
    }
}
