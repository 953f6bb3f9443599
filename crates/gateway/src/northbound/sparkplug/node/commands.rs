//! What comes from the broker: commands, and whether the primary host is there.

use super::{HostChange, HostState, Job, JobEnd, LastCommand, Node, Now, Output, Phase, Topic};
use super::{MetricValue, Payload, Received};
use crate::northbound::sparkplug::payload::{DataType, Metric};
use railbus_api::problem::{ProblemType, codes};
use railbus_device::PointKind;
use railbus_site::Within;
use railbus_wire::Micros;
use sha2::{Digest as _, Sha256};

/// The metric of the node with which a host asks for all births.
pub(super) const REBIRTH: &str = "Node Control/Rebirth";
/// How many commands are under way before more are refused.
pub(super) const COMMANDS_MAX: usize = 64;
const RETAINED: &str = "a retained command is never carried out";
/// The longest payload that is looked at.
const PAYLOAD_MAX: usize = 64 << 10;
/// The longest name of a metric that is looked at, in characters.
const NAME_MAX: usize = 256;
/// How far the time of a command may be from the one here, in milliseconds. What is older was
/// meant for a moment that is over, and the age of what comes from the future is not known.
const AGE_MAX: u64 = 5_000;
/// How many packets are remembered to know one that comes again.
const PACKETS_MAX: usize = 64;

/// What is to be done with a metric of a command.
enum Wish {
    Set(bool),
    Refused(ProblemType),
}

impl Node {
    pub(super) fn received(&mut self, now: Now, message: Received) {
        let Some(topic) = self.setup.topics.about(&message.topic) else {
            return;
        };
        let end = match &topic {
            Topic::Host => self.host(now, &message),
            Topic::Node | Topic::Device(_) if self.is_ending || self.was_here(&message) => Ok(()),
            Topic::Node => self.node_command(now, &message),
            Topic::Device(device) => self.device_command(now, device, &message),
        };
        if let Err(why) = end {
            self.counted.refused += 1;
            let told = format!("{}: {why}", message.topic);
            self.outputs.push_back(Output::Wrong(told));
        }
    }

    fn host(&mut self, now: Now, message: &Received) -> Result<(), String> {
        // So a topic is cleared.
        if message.payload.is_empty() {
            return Ok(());
        }
        let state = HostState::parse(&message.payload)?;
        match self.host.heard(state) {
            HostChange::Came => {
                self.bear_if_due(now);
                Ok(())
            }
            HostChange::Went => {
                self.die();
                Ok(())
            }
            HostChange::Same => Ok(()),
            HostChange::Old => Err("it is older than what the host said before".to_owned()),
        }
    }

    /// Whether this message was delivered before on the same connection.
    fn was_here(&mut self, message: &Received) -> bool {
        let (Some(link), Some(packet)) = (&mut self.link, message.packet) else {
            return false;
        };
        let mut hash = Sha256::new();
        hash.update(&message.topic);
        hash.update([0]);
        hash.update(&message.payload);
        let content: [u8; 32] = hash.finalize().into();
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

    /// The payload of a command that is one.
    fn command(&self, message: &Received) -> Result<Payload, String> {
        if message.payload.len() > PAYLOAD_MAX {
            return Err(format!(
                "the payload has {} bytes; at most {PAYLOAD_MAX} are taken",
                message.payload.len()
            ));
        }
        if !self.is_born() {
            return Err("the node is not born".to_owned());
        }
        let payload = Payload::parse(&message.payload);
        let payload = payload.map_err(|why| format!("it is no payload: {why}"))?;
        match payload.metrics.len() {
            // Each of them gets an answer.
            0..=COMMANDS_MAX => Ok(payload),
            many => Err(format!("{many} metrics; at most {COMMANDS_MAX} are taken")),
        }
    }

    fn node_command(&mut self, now: Now, message: &Received) -> Result<(), String> {
        let payload = self.command(message)?;
        if message.is_retained {
            return Err(RETAINED.to_owned());
        }
        let mut end = Ok(());
        let mut is_asked = false;
        for metric in &payload.metrics {
            let name = short(metric);
            match (&*name, &metric.value) {
                (REBIRTH, Some(MetricValue::Boolean(true))) => is_asked = true,
                // What it is without being asked.
                (REBIRTH, Some(MetricValue::Boolean(false))) => {}
                _ => end = Err(format!("the node has no command {name:?} with this value")),
            }
        }
        // Several that come before the births have begun are one.
        let births = self.setup.topics.node("NBIRTH");
        let link = self.link.as_ref();
        let next = link.and_then(|link| link.queue.front());
        if is_asked && next.is_none_or(|next| next.topic != births) {
            self.bear(now);
        }
        end
    }

    fn device_command(&mut self, now: Now, name: &str, message: &Received) -> Result<(), String> {
        let payload = self.command(message)?;
        let device = self.devices.get(name);
        let device = device.filter(|device| device.born.is_some());
        if device.is_none() {
            return Err("there is no such device, or it does not answer".to_owned());
        }
        let age = payload.timestamp.map(|at| now.wall.abs_diff(at));
        let age = age.filter(|age| *age <= AGE_MAX);
        let within = age.and_then(|age| {
            // What is left of the time after which it would be too old.
            let left = match payload.timestamp.is_some_and(|at| at <= now.wall) {
                true => AGE_MAX - age,
                false => AGE_MAX,
            };
            Within::new(Micros(left * 1_000))
        });
        let mut end = Ok(());
        for metric in &payload.metrics {
            let label = short(metric);
            let wish = match within {
                _ if message.is_retained => Wish::Refused(codes::BAD_REQUEST),
                None => Wish::Refused(codes::EXPIRED),
                Some(_) => self.wish(name, &label, metric),
            };
            match (wish, within) {
                (Wish::Set(on), Some(within)) => {
                    self.under_way += 1;
                    self.outputs.push_back(Output::Carry(Job {
                        device: name.to_owned(),
                        label,
                        on,
                        within,
                    }));
                }
                (Wish::Set(_), None) => {}
                (Wish::Refused(problem), _) => {
                    end = Err(
                        match (problem.code == codes::EXPIRED.code, payload.timestamp) {
                            (true, None) => "it has no time".to_owned(),
                            (true, Some(at)) => format!(
                                "its time is {at}, and here it is {}: at most {AGE_MAX} ms between \
                             them are taken",
                                now.wall
                            ),
                            _ if message.is_retained => RETAINED.to_owned(),
                            _ => format!("{label:?} can't be this: {}", problem.code),
                        },
                    );
                    let code = problem.code.to_owned();
                    self.ended(
                        now,
                        JobEnd {
                            device: name.to_owned(),
                            label,
                            end: "failed",
                            code,
                        },
                    );
                }
            }
        }
        end
    }

    /// What a metric of a command asks for.
    fn wish(&self, device: &str, label: &str, metric: &Metric) -> Wish {
        let status = self
            .devices
            .get(device)
            .and_then(|device| device.find(label));
        let Some(status) = status else {
            return Wish::Refused(codes::NO_SUCH_POINT);
        };
        if status.point.kind != PointKind::Output {
            return Wish::Refused(codes::NOT_AN_OUTPUT);
        }
        let is_boolean = metric
            .datatype
            .is_none_or(|of| of == DataType::Boolean as u32);
        match &metric.value {
            Some(MetricValue::Boolean(on)) if is_boolean => match self.under_way < COMMANDS_MAX {
                true => Wish::Set(*on),
                false => Wish::Refused(codes::OVERLOADED),
            },
            _ => Wish::Refused(codes::BAD_REQUEST),
        }
    }

    /// Tells how a command ended, with its metric as it is now.
    pub(super) fn ended(&mut self, now: Now, end: JobEnd) {
        let Some(device) = self.devices.get_mut(&end.device) else {
            return;
        };
        let last = LastCommand {
            metric: end.label,
            end: end.end,
            code: end.code,
            time: now.wall,
        };
        let link = self.link.as_mut().filter(|link| link.phase == Phase::Born);
        match link.filter(|_| device.born.is_some()) {
            Some(link) => {
                let metrics = device.answer(last, now.wall);
                let topic = self.setup.topics.device("DDATA", &end.device);
                link.push(topic, metrics, false);
                self.shorten(now);
            }
            // Its next birth has it.
            None => device.last = Some(last),
        }
    }
}

/// The name of a metric, as far as it is looked at.
fn short(metric: &Metric) -> String {
    let name = metric.name.as_deref().unwrap_or_default();
    name.chars().take(NAME_MAX).collect()
}
