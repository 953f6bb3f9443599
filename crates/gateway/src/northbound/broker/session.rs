//! How a connection to a broker is made, tried, and made again.

use super::dial::Dial;
use super::link::{self, Broken, Login, Receiver, Sender, Step, Version};
use super::message::Message;
use super::settings::{Broker, Spoken};
use crate::access::secret::random;
use crate::northbound::outlet::Outlet;
use hyper::body::Bytes;
use railbus_api::problem::{Problem, codes};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::Instant;

/// The shortest and the longest wait before the next try to connect.
const WAIT_MIN: Duration = Duration::from_secs(1);
const WAIT_MAX: Duration = Duration::from_secs(60);
/// A connection that lasted so long was one.
const STEADY: Duration = Duration::from_secs(30);
/// How long a test waits until the broker says what it is.
const LOOK_MAX: Duration = Duration::from_secs(1);
/// Where many brokers say what they are.
const BROKER_VERSION: &str = "$SYS/broker/version";

/// Who connects for an outlet, and what the broker publishes once that is lost.
pub(crate) fn login(outlet: &Outlet, broker: &Broker, will: Option<Message>) -> Login {
    let secret = outlet.secret();
    Login {
        client_id: broker.client_id.clone(),
        username: broker.username.clone(),
        password: secret.map(|secret| Bytes::copy_from_slice(secret.expose().as_bytes())),
        will,
    }
}

/// A connection in a version that the broker speaks. Where that has to be found out, it is each
/// time: a broker that hung up on version 5 once may only have been busy. Each try has a login of
/// its own; of two tries the first one has reached the broker.
pub(crate) async fn connected(
    broker: Broker,
    mut login: impl FnMut() -> Login,
) -> Result<(Version, Sender, Receiver, Option<usize>), Problem> {
    let versions: &[Version] = match broker.spoken {
        Spoken::Five => &[Version::Five],
        Spoken::ThreeOne => &[Version::ThreeOne],
        Spoken::Auto => &[Version::Five, Version::ThreeOne],
    };
    let mut first = None;
    for version in versions {
        let dial = Dial::new(&broker)?;
        match link::connect(*version, dial, login()).await {
            Ok((sender, receiver, limit)) => return Ok((*version, sender, receiver, limit)),
            // The broker's other answer says more than that it does not know the first version.
            Err(broken) if first.is_some() || !broken.is_of_version => {
                return Err(broken.problem);
            }
            Err(broken) => first = Some(broken.problem),
        }
    }
    // There is at least one version.
    Err(first.unwrap_or_else(|| Problem::new(codes::INTERNAL)))
}

/// Hands on what happens, until the connection ends.
pub(crate) async fn pump(receiver: &mut Receiver, steps: mpsc::Sender<Step>) -> Broken {
    loop {
        match receiver.next().await {
            // Fails once the receiver is dropped; the connection then ends as well.
            Ok(step) => _ = steps.send(step).await,
            Err(broken) => return broken,
        }
    }
}

/// How often in a row a connection failed.
#[derive(Debug, Default)]
pub(crate) struct Tries(u32);

impl Tries {
    /// It failed again: how often in a row, and how long to wait before the next try.
    pub(crate) fn failed(&mut self) -> (u32, Duration) {
        self.0 = self.0.saturating_add(1);
        (self.0, wait(self.0))
    }

    /// A connection ended that was begun at this time: the row ends with one that lasted.
    pub(crate) fn connected_since(&mut self, begun: Instant) {
        if begun.elapsed() >= STEADY {
            self.0 = 0;
        }
    }
}

/// How long after so many failures it is tried again: longer each time, and never at the same time
/// as all others that lost the same broker.
fn wait(tries: u32) -> Duration {
    let longest = WAIT_MIN * (1 << tries.saturating_sub(1).min(6));
    let share = random::<1>().map_or(128, |[byte]| byte);
    let jitter = longest.mul_f64(f64::from(share) / 512.0);
    (longest.mul_f64(0.75) + jitter).clamp(WAIT_MIN, WAIT_MAX)
}

/// Connects once beside the run, and says what the broker is.
pub(crate) async fn test(outlet: Outlet, broker: Broker) -> Result<String, Problem> {
    let mut login = login(&outlet, &broker, None);
    // The broker would end the connection of the run otherwise.
    login.client_id.push_str("-test");
    let is_tls = broker.is_tls;
    let (version, sender, mut receiver, _) = connected(broker, || login.clone()).await?;
    let mut words = vec![format!("MQTT {}", version.name())];
    if is_tls {
        words.push("TLS".to_owned());
    }
    if sender.look(BROKER_VERSION).is_ok() {
        let said = tokio::time::timeout(LOOK_MAX, said(&mut receiver)).await;
        words.extend(said.ok().flatten());
    }
    sender.disconnect();
    let _ = tokio::time::timeout(LOOK_MAX, async { while receiver.next().await.is_ok() {} }).await;
    Ok(words.join(", "))
}

/// What the broker says that it is.
async fn said(receiver: &mut Receiver) -> Option<String> {
    /// Longer ones are no name.
    const LEN_MAX: usize = 64;
    loop {
        if let Step::Message(message) = receiver.next().await.ok()? {
            let text = String::from_utf8(message.payload).ok()?;
            let text = text.chars().filter(|char| !char.is_control());
            return Some(text.take(LEN_MAX).collect());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_waits_longer_each_time_and_never_too_long() {
        for (tries, low, high) in [(1, 1.0, 1.3), (2, 1.5, 2.5), (4, 6.0, 10.0)] {
            let wait = wait(tries).as_secs_f64();
            assert!((low..=high).contains(&wait), "{tries}: {wait}");
        }
        for tries in [7, 8, 1_000, u32::MAX] {
            let wait = wait(tries);
            assert!(wait <= WAIT_MAX && wait >= WAIT_MAX / 2, "{wait:?}");
        }
    }
}
