//! The commands that come from the broker, and their results.

use super::super::ends;
use super::super::orders::{self, Target};
use super::super::topics::{TOPIC_MAX, Topics};
use super::{Job, Message, Node, Output, Received, Reply, said, unkept};
use railbus_api::problem::{Problem, codes};
use railbus_site::Within;
use railbus_wire::Micros;
use serde_json::{Map, Value};
use sha2::{Digest as _, Sha256};
use std::time::Duration;

/// How many commands are under way before more are refused.
pub(super) const COMMANDS_MAX: usize = 64;
/// How many packets are remembered to know one that comes again.
const PACKETS_MAX: usize = 256;
/// The time of a command that says none, in milliseconds.
const WITHIN_MS: u64 = 5_000;

impl Node {
    pub(super) fn received(&mut self, now: Duration, message: Received) {
        if self.topics.is_status(&message.topic) {
            self.told_status(now, &message.payload);
            return;
        }
        let Some(target) = self.topics.target(&message.topic) else {
            return;
        };
        // Another outlet of these topics may have it, and then says how it ended.
        if matches!(&target, Target::Output(module, _) if !self.topics.has(module)) {
            return;
        }
        // So a topic is cleared that should not have been kept.
        let clears = message.is_retained && message.payload.is_empty();
        if self.is_ending || clears || self.was_here(&message) {
            return;
        }
        self.commands += 1;
        let topic = Topics::result(&message.topic);
        if topic.len() > TOPIC_MAX {
            // There is nowhere to say so.
            self.commands_refused += 1;
            return;
        }
        let mut reply = Reply {
            topic,
            response: message
                .response
                .filter(|topic| self.topics.may_respond(topic)),
            correlation: message.correlation,
            id: None,
        };
        let order = match message.is_retained {
            true => Err(ends::wrong("a retained command is never carried out")),
            false => orders::parse(target, &message.payload).map_err(ends::wrong),
        };
        let job = order.and_then(|order| {
            reply.id.clone_from(&order.id);
            if self.under_way >= COMMANDS_MAX {
                return Err(Problem::new(codes::OVERLOADED));
            }
            let within = within(order.within_ms, message.expiry)?;
            // Correlation data is no key: MQTT names no sender, and two of them may use the same.
            let key = order.id.clone();
            Ok((order, key, within))
        });
        match job {
            Ok((order, key, within)) => {
                self.under_way += 1;
                let job = Job {
                    order,
                    key,
                    within,
                    reply,
                };
                self.outputs.push_back(Output::Carry(Box::new(job)));
            }
            Err(problem) => {
                self.commands_refused += 1;
                self.answer(reply, ends::refused(problem));
            }
        }
    }

    /// Whether this message was delivered before on the same connection. It is under way or done,
    /// and has its result.
    fn was_here(&mut self, message: &Received) -> bool {
        let (Some(link), Some(packet)) = (&mut self.link, message.packet) else {
            return false;
        };
        let content = digest(&[message.topic.as_bytes(), &message.payload]);
        if message.is_again && link.packets.contains(&(packet, content)) {
            return true;
        }
        // The number belongs to another message now.
        link.packets.retain(|(known, _)| *known != packet);
        link.packets.push_back((packet, content));
        if link.packets.len() > PACKETS_MAX {
            link.packets.pop_front();
        }
        false
    }

    /// Tells a result to all, and to who asked for it.
    pub(super) fn answer(&mut self, reply: Reply, result: Value) {
        let mut told = Map::new();
        told.insert("id".to_owned(), reply.id.into());
        if let Value::Object(result) = result {
            told.extend(result);
        }
        let told = Value::Object(told);
        self.results
            .push_back(said(unkept(reply.topic, &told, true)));
        if let Some(topic) = reply.response {
            self.results.push_back(said(Message {
                correlation: reply.correlation,
                ..unkept(topic, &told, true)
            }));
        }
        self.shorten();
    }
}

/// The time within which a command must be sent: what it says, and no more than is left of its
/// message.
fn within(asked_ms: Option<u64>, expiry: Option<u32>) -> Result<Within, Problem> {
    let asked = asked_ms.unwrap_or(WITHIN_MS);
    let checked = Within::new(Micros(asked.saturating_mul(1_000)));
    let checked = checked.ok_or_else(|| ends::wrong("\"within_ms\" is 200 to 60000"))?;
    let Some(seconds) = expiry else {
        return Ok(checked);
    };
    let least = asked.min(u64::from(seconds) * 1_000);
    Within::new(Micros(least * 1_000)).ok_or_else(|| Problem::new(codes::EXPIRED))
}

/// A hash of these parts.
fn digest(parts: &[&[u8]]) -> [u8; 32] {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.finalize().into()
}
