//! A connection to a broker in one of both versions of the protocol, which differ in types only.
//! Each connection is a new one: nothing is carried over from the one before.

use super::WINDOW;
use super::dial::{Dial, Reached, tls_reason};
use super::message::{Message, Received, Verdict};
use super::numbers::Numbers;
use hyper::body::Bytes;
use railbus_api::problem::Problem;
use rumqttc_v5 as v5;
use rumqttc_v311 as v311;
use std::error::Error;
use std::fmt;
use std::time::Duration;

/// How often something is sent at least (MQTT 5, section 3.1.2.10), in seconds.
const KEEP_ALIVE_S: u16 = 3;
/// How long it may take until the broker has accepted the connection: a test that tries both
/// versions has 15 s.
pub(crate) const CONNECT_MAX: Duration = Duration::from_secs(6);
/// The longest packet that is received, in bytes. A broker of version 5 is told so and leaves out
/// what is longer.
const PACKET_MAX: u32 = 64 << 10;
/// The same for version 3.1.1, where a longer one ends the connection.
const PACKET_MAX_311: usize = 1 << 20;
/// What may wait in the client: everything that is with the broker, and some control packets.
const CAPACITY: usize = 2 * WINDOW;
/// What version 5 adds to the topic and the payload of a message, at most.
const OVERHEAD: usize = 64;

/// A version of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Version {
    Five,
    ThreeOne,
}

impl Version {
    /// As people write it.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Version::Five => "5",
            Version::ThreeOne => "3.1.1",
        }
    }
}

/// Who connects, and as what.
#[derive(Clone)]
pub(crate) struct Login {
    pub(crate) client_id: String,
    pub(crate) username: Option<String>,
    pub(crate) password: Option<Bytes>,
    /// What the broker publishes when the connection is lost.
    pub(crate) will: Option<Message>,
}

impl fmt::Debug for Login {
    /// Without the password.
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.debug_struct("Login")
            .field("client_id", &self.client_id)
            .field("username", &self.username)
            .field("will", &self.will)
            .finish_non_exhaustive()
    }
}

/// Topics that are to come.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Filter {
    pub(crate) topic: String,
    /// With what the broker keeps there. Else it is left out where the broker can be told so.
    pub(crate) with_kept: bool,
}

/// What comes from the broker.
#[derive(Debug)]
pub(crate) enum Heard {
    Message(Received),
    /// What it says of the message with this number.
    Taken(u64, Verdict),
    /// What was subscribed comes from now on.
    Subscribed,
    /// It lets nothing come from where commands are to come from.
    NotSubscribed,
    /// It has every message up to this number, also those that are delivered at most once.
    Arrived(u64),
}

/// Why there is no connection any more.
#[derive(Debug)]
pub(crate) struct Broken {
    pub(crate) problem: Problem,
    /// The broker may speak another version.
    pub(crate) is_of_version: bool,
}

/// The side that sends.
#[derive(Debug)]
pub(crate) struct Sender {
    client: Client,
    numbers: Numbers,
}

#[derive(Debug)]
enum Client {
    Five(v5::AsyncClient),
    ThreeOne(v311::AsyncClient),
}

/// The side that receives, and keeps the connection alive.
pub(crate) struct Receiver {
    events: Loop,
    dial: Dial,
}

enum Loop {
    Five(Box<v5::EventLoop>),
    ThreeOne(Box<v311::EventLoop>),
}

/// What happens on a connection.
#[derive(Debug)]
pub(crate) enum Step {
    Message(Received),
    /// The next message went out in this packet.
    Went(u16),
    /// The broker has a packet, or refuses it.
    Acknowledged(u16, Verdict),
    Subscribed,
    NotSubscribed,
    /// It was asked whether everything arrived, and has answered: [`Sender::ask`].
    Asked(u16),
    Answered(u16),
    /// Something else, such as what keeps the connection alive.
    Other,
}

impl Step {
    /// The same; a command that has waited for too long has expired.
    pub(crate) fn expired_if(self, is_late: bool) -> Step {
        match self {
            Step::Message(message) if is_late => Step::Message(Received {
                expiry: Some(0),
                ..message
            }),
            step => step,
        }
    }
}

/// Connects. What comes back is connected: the broker has accepted it. The largest packet that it
/// takes comes with it, where it says one.
///
/// # Errors
/// Why not.
pub(crate) async fn connect(
    version: Version,
    dial: Dial,
    login: Login,
) -> Result<(Sender, Receiver, Option<usize>), Broken> {
    let (client, events) = match version {
        Version::Five => five(&dial, login),
        Version::ThreeOne => three_one(&dial, login),
    };
    let mut receiver = Receiver { events, dial };
    let connected = tokio::time::timeout(CONNECT_MAX, receiver.accepted()).await;
    let limit = connected.unwrap_or_else(|_| Err(receiver.broken(&"no answer", true)))?;
    let numbers = Numbers::default();
    Ok((Sender { client, numbers }, receiver, limit))
}

fn five(dial: &Dial, login: Login) -> (Client, Loop) {
    // The address is that of the dial; this one is never looked up.
    let mut options = v5::MqttOptions::new(login.client_id, "broker");
    options
        .set_keep_alive(KEEP_ALIVE_S)
        .set_clean_start(true)
        .set_connect_timeout(CONNECT_MAX)
        .set_max_packet_size(Some(PACKET_MAX))
        .set_outgoing_inflight_upper_limit(WINDOW as u16);
    if let Some(will) = login.will {
        let quality = match will.is_sure {
            true => v5::QoS::AtLeastOnce,
            false => v5::QoS::AtMostOnce,
        };
        let will = v5::LastWill::new(will.topic, will.payload, quality, will.is_retained, None);
        options.set_last_will(will);
    }
    match (login.username, login.password) {
        (Some(name), Some(password)) => _ = options.set_credentials(name, password),
        (Some(name), None) => _ = options.set_username(name),
        (None, Some(password)) => _ = options.set_password(password),
        (None, None) => {}
    }
    let dial = dial.clone();
    options.set_socket_connector(move |_, _| dial.clone().connect());
    let builder = v5::AsyncClient::builder(options);
    let (client, events) = builder.capacity(CAPACITY).build();
    (Client::Five(client), Loop::Five(Box::new(events)))
}

fn three_one(dial: &Dial, login: Login) -> (Client, Loop) {
    let mut options = v311::MqttOptions::new(login.client_id, "broker");
    let mut network = v311::NetworkOptions::new();
    network.set_connection_timeout(CONNECT_MAX.as_secs());
    options
        .set_keep_alive(KEEP_ALIVE_S)
        .set_clean_session(true)
        .set_max_packet_size(PACKET_MAX_311, usize::MAX)
        .set_inflight(WINDOW as u16);
    if let Some(will) = login.will {
        let quality = match will.is_sure {
            true => v311::QoS::AtLeastOnce,
            false => v311::QoS::AtMostOnce,
        };
        let will = v311::LastWill::new(will.topic, will.payload, quality, will.is_retained);
        options.set_last_will(will);
    }
    // A password needs a name in this version (MQTT 3.1.1, section 3.1.2.9).
    if let Some(name) = login.username {
        match login.password {
            Some(password) => _ = options.set_credentials(name, password),
            None => _ = options.set_username(name),
        }
    }
    let dial = dial.clone();
    options.set_socket_connector(move |_, _| dial.clone().connect());
    let builder = v311::AsyncClient::builder(options);
    let (client, mut events) = builder.capacity(CAPACITY).build();
    events.set_network_options(network);
    (Client::ThreeOne(client), Loop::ThreeOne(Box::new(events)))
}

impl Sender {
    /// Has these topics come.
    ///
    /// # Errors
    /// The connection has ended.
    pub(crate) fn subscribe(&self, filters: &[Filter]) -> Result<(), String> {
        match &self.client {
            Client::Five(client) => {
                use v5::QoS;
                use v5::RetainForwardRule;
                let filters = filters.iter().map(|filter| {
                    let rule = match filter.with_kept {
                        true => RetainForwardRule::OnEverySubscribe,
                        false => RetainForwardRule::Never,
                    };
                    v5::SubscribeFilterInput::new(filter.topic.as_str(), QoS::AtLeastOnce)
                        .preserve_retain(true)
                        .retain_forward_rule(rule)
                });
                let filters: Vec<_> = filters.collect();
                let end = client.try_subscribe_many(filters);
                end.map_err(|error| error.to_string())
            }
            Client::ThreeOne(client) => {
                use v311::QoS;
                let filters = filters.iter().map(|filter| {
                    v311::SubscribeFilterInput::new(filter.topic.as_str(), QoS::AtLeastOnce)
                });
                let filters: Vec<_> = filters.collect();
                let end = client.try_subscribe_many(filters);
                end.map_err(|error| error.to_string())
            }
        }
    }

    /// Asks the broker whether everything before this arrived: [`Heard::Arrived`]. It takes the
    /// packets of a connection in their order, and answers this one in every case (MQTT 5,
    /// section 3.10.4). A ping would not do: there is none while something else is sent.
    ///
    /// # Errors
    /// The connection has ended.
    pub(crate) fn ask(&self) -> Result<(), String> {
        /// Nothing was ever subscribed there.
        const NOTHING: &str = "railbus/arrived";
        match &self.client {
            Client::Five(client) => {
                let end = client.try_unsubscribe(NOTHING);
                end.map_err(|error| error.to_string())
            }
            Client::ThreeOne(client) => {
                let end = client.try_unsubscribe(NOTHING);
                end.map_err(|error| error.to_string())
            }
        }
    }

    /// Has one topic come, with what the broker kept.
    ///
    /// # Errors
    /// The connection has ended.
    pub(crate) fn look(&self, topic: &str) -> Result<(), String> {
        match &self.client {
            Client::Five(client) => {
                let once = v5::QoS::AtMostOnce;
                let end = client.try_subscribe(topic, once);
                end.map_err(|error| error.to_string())
            }
            Client::ThreeOne(client) => {
                let once = v311::QoS::AtMostOnce;
                let end = client.try_subscribe(topic, once);
                end.map_err(|error| error.to_string())
            }
        }
    }

    /// Publishes a message, which has this number.
    ///
    /// # Errors
    /// The connection is no more, or the message is none.
    pub(crate) fn publish(&mut self, number: u64, message: Message) -> Result<(), String> {
        self.numbers.handed(number);
        match &self.client {
            Client::Five(client) => {
                use v5::PublishProperties;
                use v5::QoS;
                let quality = match message.is_sure {
                    true => QoS::AtLeastOnce,
                    false => QoS::AtMostOnce,
                };
                let options = v5::PublishOptions::new(quality).retain(message.is_retained);
                let options = match message.correlation {
                    None => options,
                    Some(data) => options.properties(PublishProperties {
                        correlation_data: Some(Bytes::from(data)),
                        ..PublishProperties::default()
                    }),
                };
                let end = client.try_publish(message.topic, message.payload, options);
                end.map_err(|error| error.to_string())
            }
            Client::ThreeOne(client) => {
                use v311::QoS;
                let quality = match message.is_sure {
                    true => QoS::AtLeastOnce,
                    false => QoS::AtMostOnce,
                };
                let options = v311::PublishOptions::new(quality).retain(message.is_retained);
                let end = client.try_publish(message.topic, message.payload, options);
                end.map_err(|error| error.to_string())
            }
        }
    }

    /// What something that happened means.
    pub(crate) fn heard(&mut self, step: Step) -> Option<Heard> {
        match step {
            Step::Message(message) => Some(Heard::Message(message)),
            Step::Subscribed => Some(Heard::Subscribed),
            Step::NotSubscribed => Some(Heard::NotSubscribed),
            Step::Other => None,
            Step::Asked(packet) => {
                self.numbers.asked(packet);
                None
            }
            Step::Answered(packet) => {
                let number = self.numbers.answered(packet)?;
                Some(Heard::Arrived(number))
            }
            Step::Went(packet) => {
                let number = self.numbers.went(packet)?;
                Some(Heard::Taken(number, Verdict::Taken))
            }
            Step::Acknowledged(packet, verdict) => {
                let number = self.numbers.acknowledged(packet)?;
                Some(Heard::Taken(number, verdict))
            }
        }
    }

    /// Ends the connection once everything is sent, so that the will is not published.
    pub(crate) fn disconnect(&self) {
        // Fails where it has ended.
        match &self.client {
            Client::Five(client) => _ = client.try_disconnect(),
            Client::ThreeOne(client) => _ = client.try_disconnect(),
        }
    }

    /// The same where the will may be published: version 5 can say so.
    pub(crate) fn disconnect_with_will(&self) {
        match &self.client {
            Client::Five(client) => {
                let reason = v5::DisconnectReasonCode::DisconnectWithWillMessage;
                let properties = v5::DisconnectProperties {
                    session_expiry_interval: None,
                    reason_string: None,
                    user_properties: Vec::new(),
                    server_reference: None,
                };
                _ = client.try_disconnect_with_properties(reason, properties);
            }
            Client::ThreeOne(_) => self.disconnect(),
        }
    }
}

/// How many bytes a message takes at most.
pub(crate) fn size(message: &Message) -> usize {
    let correlation = message.correlation.as_ref().map_or(0, Vec::len);
    message.topic.len() + message.payload.len() + correlation + OVERHEAD
}

impl Receiver {
    /// The way that it goes.
    pub(crate) fn dial(&self) -> Dial {
        self.dial.clone()
    }

    /// Waits until the broker accepts the connection.
    async fn accepted(&mut self) -> Result<Option<usize>, Broken> {
        loop {
            match &mut self.events {
                Loop::Five(events) => match events.poll().await {
                    Ok(v5::Event::Incoming(v5::Packet::ConnAck(accepted))) => {
                        let said = accepted.properties;
                        let retains = said.as_ref().and_then(|said| said.retain_available);
                        if retains == Some(0) {
                            return Err(self.broken(&"it keeps no retained messages", false));
                        }
                        let most = said.and_then(|said| said.max_packet_size);
                        return Ok(most.map(|most| most as usize));
                    }
                    Ok(_) => {}
                    Err(error) => return Err(self.broken_five(&error)),
                },
                Loop::ThreeOne(events) => match events.poll().await {
                    Ok(v311::Event::Incoming(v311::Packet::ConnAck(_))) => return Ok(None),
                    Ok(_) => {}
                    Err(error) => return Err(self.broken_three_one(&error)),
                },
            }
        }
    }

    /// What happens next. It must not be dropped before it has ended: a packet that is half sent
    /// would be lost.
    ///
    /// # Errors
    /// The connection has ended.
    pub(crate) async fn next(&mut self) -> Result<Step, Broken> {
        let step = match &mut self.events {
            Loop::Five(events) => match events.poll().await {
                Ok(event) => step_five(event),
                Err(error) => return Err(self.broken_five(&error)),
            },
            Loop::ThreeOne(events) => match events.poll().await {
                Ok(event) => step_three_one(event),
                Err(error) => return Err(self.broken_three_one(&error)),
            },
        };
        Ok(step.unwrap_or(Step::Other))
    }

    /// Why there is no connection. Another version may be spoken only where the broker was
    /// reached, and said nothing else.
    fn broken(&self, reason: &dyn ToString, is_of_version: bool) -> Broken {
        let dial = &self.dial;
        let problem = match dial.reached() {
            Reached::Failed(problem) => problem,
            Reached::No => dial.unreached(reason),
            Reached::Yes => {
                let problem = dial.refused(reason);
                return Broken {
                    problem,
                    is_of_version,
                };
            }
        };
        Broken {
            problem,
            is_of_version: false,
        }
    }

    fn unknown(&self, reason: &dyn ToString) -> Broken {
        Broken {
            problem: self.dial.unknown(reason),
            is_of_version: false,
        }
    }

    /// TLS broke the connection, as where the broker wants another certificate.
    fn untrusted(&self, error: &(dyn Error + 'static)) -> Option<Broken> {
        let problem = self.dial.untrusted(&tls_reason(error)?);
        Some(Broken {
            problem,
            is_of_version: false,
        })
    }

    fn broken_five(&self, error: &v5::ConnectionError) -> Broken {
        use v5::ConnectReturnCode as Code;
        if let v5::ConnectionError::ConnectionRefused(code) = error {
            return match code {
                Code::BadUserNamePassword
                | Code::NotAuthorized
                | Code::BadAuthenticationMethod
                | Code::Banned => self.unknown(&format!("{code:?}")),
                // Brokers that do not know the version say it in different ways.
                Code::RefusedProtocolVersion
                | Code::UnsupportedProtocolVersion
                | Code::MalformedPacket
                | Code::ProtocolError
                | Code::UnspecifiedError => self.broken(&format!("{code:?}"), true),
                _ => self.broken(&format!("{code:?}"), false),
            };
        }
        if let v5::ConnectionError::MqttState(v5::StateError::ServerDisconnect {
            reason_code,
            ..
        }) = error
        {
            return self.broken(&format!("{reason_code:?}"), false);
        }
        let untrusted = self.untrusted(error);
        untrusted.unwrap_or_else(|| self.broken(error, true))
    }

    fn broken_three_one(&self, error: &v311::ConnectionError) -> Broken {
        use v311::ConnectReturnCode as Code;
        if let v311::ConnectionError::ConnectionRefused(code) = error {
            return match code {
                Code::BadUserNamePassword | Code::NotAuthorized => {
                    self.unknown(&format!("{code:?}"))
                }
                _ => self.broken(&format!("{code:?}"), false),
            };
        }
        let untrusted = self.untrusted(error);
        untrusted.unwrap_or_else(|| self.broken(error, false))
    }
}

fn step_five(event: v5::Event) -> Option<Step> {
    match event {
        v5::Event::Incoming(v5::Packet::Publish(publish)) => {
            let said = publish.properties.unwrap_or_default();
            Some(Step::Message(Received {
                topic: String::from_utf8(publish.topic.to_vec()).ok()?,
                payload: publish.payload.to_vec(),
                is_retained: publish.retain,
                packet: (publish.pkid != 0).then_some(publish.pkid),
                is_again: publish.dup,
                expiry: said.message_expiry_interval,
                response: said.response_topic,
                correlation: said.correlation_data.map(|data| data.to_vec()),
            }))
        }
        v5::Event::Incoming(v5::Packet::PubAck(ack)) => {
            let verdict = match ack.reason {
                v5::PubAckReason::Success => Verdict::Taken,
                v5::PubAckReason::NoMatchingSubscribers => Verdict::NoReceiver,
                _ => Verdict::Refused,
            };
            Some(Step::Acknowledged(ack.pkid, verdict))
        }
        v5::Event::Incoming(v5::Packet::SubAck(ack)) => {
            let is_good = |code: &v5::SubscribeReasonCode| {
                matches!(code, v5::SubscribeReasonCode::Success(_))
            };
            match ack.return_codes.iter().all(is_good) {
                true => Some(Step::Subscribed),
                false => Some(Step::NotSubscribed),
            }
        }
        v5::Event::Outgoing(v5::Outgoing::Publish(packet)) => Some(Step::Went(packet)),
        v5::Event::Outgoing(v5::Outgoing::Unsubscribe(packet)) => Some(Step::Asked(packet)),
        v5::Event::Incoming(v5::Packet::UnsubAck(ack)) => Some(Step::Answered(ack.pkid)),
        _ => None,
    }
}

fn step_three_one(event: v311::Event) -> Option<Step> {
    match event {
        v311::Event::Incoming(v311::Packet::Publish(publish)) => Some(Step::Message(Received {
            topic: String::from_utf8(publish.topic.to_vec()).ok()?,
            payload: publish.payload.to_vec(),
            is_retained: publish.retain,
            packet: (publish.pkid != 0).then_some(publish.pkid),
            is_again: publish.dup,
            ..Received::default()
        })),
        v311::Event::Incoming(v311::Packet::PubAck(ack)) => {
            Some(Step::Acknowledged(ack.pkid, Verdict::Taken))
        }
        v311::Event::Incoming(v311::Packet::SubAck(ack)) => {
            let is_good = |code: &v311::SubscribeReasonCode| {
                matches!(code, v311::SubscribeReasonCode::Success(_))
            };
            match ack.return_codes.iter().all(is_good) {
                true => Some(Step::Subscribed),
                false => Some(Step::NotSubscribed),
            }
        }
        v311::Event::Outgoing(v311::Outgoing::Publish(packet)) => Some(Step::Went(packet)),
        v311::Event::Outgoing(v311::Outgoing::Unsubscribe(packet)) => Some(Step::Asked(packet)),
        v311::Event::Incoming(v311::Packet::UnsubAck(ack)) => Some(Step::Answered(ack.pkid)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A command is then answered with E0106.
    #[test]
    fn what_came_too_late_has_expired() {
        let expiry = |is_late| {
            let message = Received {
                expiry: Some(60),
                ..Received::default()
            };
            match Step::Message(message).expired_if(is_late) {
                Step::Message(message) => message.expiry,
                step => panic!("{step:?}"),
            }
        };
        assert_eq!((expiry(false), expiry(true)), (Some(60), Some(0)));
    }

    #[test]
    fn a_password_is_never_told() {
        let login = Login {
            client_id: "c7".to_owned(),
            username: Some("anna".to_owned()),
            password: Some(Bytes::from_static(b"swordfish")),
            will: None,
        };
        let told = format!("{login:?}");
        assert!(told.contains("anna") && !told.contains("sword"), "{told}");
    }
}
