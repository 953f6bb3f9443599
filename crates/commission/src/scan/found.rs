//! A module that was found, and what its replies mean.

use super::ask::{PATIENCE, ProbeKind, ScanProbe};
use super::identify::{
    Answer, Identity, describe, description, identify, rules_out, state, version,
};
use railbus_device::{Family, ScanEvidence};
use railbus_wire::{Micros, Protocol};

/// The verdict on a module's replies. A module that never replied is silent, and not reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// It answers as a module of a known family.
    Ok,
    /// It answers like a module of one of these families, and nothing proves which.
    CouldBe,
    /// It refuses, which is a sign of life, too.
    Refused,
    /// It answers, but not like a module of a known family.
    Odd,
    /// There is something, but its replies are corrupted, or there are two modules.
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

/// What is known about a module apart from its model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Nothing.
    None,
    /// Outputs and digital inputs, according to the datasheet.
    Channels(u8, u8),
    /// Eight coils from 60, and no register that identifies the model.
    CoilsAt60,
    /// The version in its first register.
    Version(u16),
    /// A 0x55 board on which this is the highest channel that is on, or high.
    AtLeast(u8),
    /// None of the replies was valid.
    Spoilt {
        /// Number of attempts.
        tries: usize,
        /// Whether they differed.
        differ: bool,
    },
    /// One request was answered twice.
    Twice,
}

/// A module that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundModule {
    /// The request by which it was found.
    pub asked: ScanProbe,
    /// What it is.
    pub identity: Identity,
    /// From the end of the request to the beginning of its reply.
    pub rtt: Micros,
    /// All requests and their responses.
    pub answers: Vec<Answer>,
    /// Bytes that were not a valid reply.
    pub garbled: Vec<Vec<u8>>,
    /// One request was answered twice.
    pub twice: bool,
    /// Its name in the configuration.
    pub known: Option<String>,
    /// Whether the configuration has another model there.
    pub differs: bool,
}

impl FoundModule {
    /// The verdict from these responses.
    #[must_use]
    pub fn of(
        asked: ScanProbe,
        answers: Vec<Answer>,
        garbled: Vec<Vec<u8>>,
        rtt: Micros,
    ) -> FoundModule {
        FoundModule {
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

    /// Its protocol.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        self.asked.ask.protocol()
    }

    /// Whether its ASCII frames carry a checksum; `None` in other protocols.
    #[must_use]
    pub const fn checksum(&self) -> Option<bool> {
        match self.asked.ask {
            ProbeKind::AsciiName(checksum) => Some(checksum),
            _ => None,
        }
    }

    /// The verdict on its replies.
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

    /// Its identification beyond the datasheet: manufacturer, product and version, or its firmware.
    #[must_use]
    pub fn description(&self) -> Option<String> {
        description(self.asked, &self.answers)
    }

    /// Whether its responses rule this family out.
    pub(super) fn rules_out(&self, family: Family) -> bool {
        rules_out(self.asked, &self.answers, family)
    }

    /// The next request for its identification, and the timeout.
    pub(super) fn to_describe(&self) -> Option<(ScanProbe, Micros)> {
        let ask = describe(self.asked, &self.answers).filter(|_| !self.is_conflict())?;
        let patience = self.rtt * 2 + Micros::from_millis(30);
        Some((self.asked.with(ask), patience.min(PATIENCE)))
    }

    /// Its response to that; empty if it was silent. Returns whether more is known about it now.
    pub(super) fn described(&mut self, ask: ProbeKind, bytes: Vec<u8>) -> bool {
        self.answers.push((ask, bytes));
        self.description().is_some()
    }

    /// Whether two modules may have its address.
    #[must_use]
    pub fn is_conflict(&self) -> bool {
        self.verdict() == Verdict::Garbled
    }

    /// What is known about it apart from its model.
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
        let Some(family) = self.identity.family else {
            return Detail::None;
        };
        match family.datasheet().evidence {
            ScanEvidence::Coils => Detail::CoilsAt60,
            ScanEvidence::Version => {
                version(self.asked, &self.answers).map_or(Detail::None, Detail::Version)
            }
            ScanEvidence::HighestOn => {
                let state = state(self.asked, &self.answers).unwrap_or_default();
                let highest = u32::BITS - state.leading_zeros();
                u8::try_from(highest).map_or(Detail::None, Detail::AtLeast)
            }
            ScanEvidence::Channels => {
                let profile = family.profile();
                Detail::Channels(profile.outputs, profile.inputs)
            }
        }
    }

    /// Whether it is the module that answers this request, too. Not every port supports parity, and
    /// a module has only one.
    pub(super) fn answers_to(&self, question: &ScanProbe) -> bool {
        self.asked.settings.baud == question.settings.baud
            && self.asked.address == question.address
            && self.protocol() == question.ask.protocol()
    }
}
