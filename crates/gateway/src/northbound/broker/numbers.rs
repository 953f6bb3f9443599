//! Which message went out in which packet, and which of them the broker has.

use std::collections::{BTreeMap, VecDeque};

/// The numbers of messages by the packets in which they went out, in their order.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    waiting: VecDeque<u64>,
    flying: BTreeMap<u16, u64>,
    /// The last message that went out.
    gone: u64,
    /// The last one before each question whether they arrived, by the packet of the question.
    asked: BTreeMap<u16, u64>,
}

impl Numbers {
    /// A message was handed over.
    pub(super) fn handed(&mut self, number: u64) {
        self.waiting.push_back(number);
    }

    /// The next of them went out in this packet; one without a number needs no acknowledgement.
    pub(super) fn went(&mut self, packet: u16) -> Option<u64> {
        let number = self.waiting.pop_front()?;
        self.gone = number;
        match packet {
            0 => Some(number),
            packet => {
                self.flying.insert(packet, number);
                None
            }
        }
    }

    /// The broker has a packet.
    pub(super) fn acknowledged(&mut self, packet: u16) -> Option<u64> {
        self.flying.remove(&packet)
    }

    /// It was asked in this packet whether everything before it arrived.
    pub(super) fn asked(&mut self, packet: u16) {
        self.asked.insert(packet, self.gone);
    }

    /// It has answered: which one was the last before the question.
    pub(super) fn answered(&mut self, packet: u16) -> Option<u64> {
        self.asked.remove(&packet)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_known_by_the_packet_in_which_it_went() {
        let mut numbers = Numbers::default();
        for number in [7, 8, 9] {
            numbers.handed(number);
        }
        assert_eq!(numbers.went(1), None);
        assert_eq!(numbers.went(0), Some(8), "at most once");
        assert_eq!(numbers.went(2), None);
        assert_eq!(numbers.acknowledged(2), Some(9));
        assert_eq!(numbers.acknowledged(2), None);
        assert_eq!(numbers.acknowledged(1), Some(7));
        assert_eq!(numbers.went(3), None, "of somebody else");
    }

    #[test]
    fn what_went_before_a_question_has_arrived_with_its_answer() {
        let mut numbers = Numbers::default();
        numbers.asked(4);
        for number in [7, 8, 9] {
            numbers.handed(number);
        }
        numbers.went(0);
        numbers.went(0);
        numbers.asked(5);
        numbers.went(0);
        assert_eq!(numbers.answered(4), Some(0));
        assert_eq!(numbers.answered(5), Some(8), "9 went after it");
        assert_eq!(numbers.answered(5), None);
    }
}
