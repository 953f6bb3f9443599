//! Drives the site's side of its way to the centre.

use super::connection::{Connection, credentials};
use super::settings::FleetAccess;
use crate::access::secret::random;
use crate::northbound::broker::session::wait;
use crate::northbound::outbox::{self, OutboxHandle, OutboxState, Reading, StateAt};
use crate::northbound::outlet::Outlet;
use async_nats::{Event, HeaderMap, Message, ServerError, StatusCode, Subscriber};
use futures_core::Stream;
use prost::Message as _;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::message::FleetRefusal;
use railbus_fleet::uplink::{
    OutboxHead, READ_MAX, SiteIdentity, UpMessage, Uplink, UplinkFault, UplinkInput, UplinkOutput,
};
use railbus_store::durable;
use railbus_store::history::millis;
use std::pin::{Pin, pin};
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime};
use tokio::time::Instant;

/// How long the last messages may take, once it is to stop.
const LINGER: Duration = Duration::from_secs(1);
/// How long the outbox may take to be closed.
const CLOSE_MAX: Duration = Duration::from_secs(2);
/// A connection that lasted so long was one.
const STEADY: Duration = Duration::from_secs(60);
/// Every installation has its own number.
const INSTALLATION_LEN: usize = 16;

/// How everything is, while it is being found out.
type Finding = Pin<Box<dyn Future<Output = Option<StateAt>>>>;

struct Driver {
    uplink: Uplink,
    outbox: OutboxHandle,
    reading: Option<Reading>,
    finding: Option<Finding>,
    /// What the centre asks, in the session of this name.
    asked: Option<(String, Subscriber)>,
    /// How many failures were reported since it worked.
    failures: u32,
    began: Instant,
    outlet: Outlet,
}

/// Why a connection is no longer used.
enum Ended {
    Stopped,
    Broken(Problem),
}

/// Reports until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let (_, outboxes) = outlet.left_behind();
    outboxes.iter().for_each(|file| outbox::remove(file));
    let internal =
        |error: &dyn ToString| Problem::new(codes::INTERNAL).with("reason", error.to_string());
    let days = outlet.number("replay_days");
    let outbox = outbox::start(&outlet, days, |_| true)?;
    let outbox = outbox.ok_or_else(|| internal(&"no outbox"))?;
    let installation = installation(&outlet).map_err(|error| internal(&error))?;
    let boot = random().map_err(|error| internal(&error))?;
    let own = SiteIdentity {
        // Known with its credentials.
        site: String::new(),
        installation,
        boot,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let mut driver = Driver {
        uplink: Uplink::new(own),
        outbox,
        reading: None,
        finding: None,
        asked: None,
        failures: 0,
        began: Instant::now(),
        outlet,
    };
    driver.work().await;
    driver.end().await;
    Ok(())
}

impl Driver {
    async fn work(&mut self) {
        let stopped = self.outlet.stopped();
        let mut stopped = pin!(stopped);
        let mut tries = 0;
        loop {
            let begun = Instant::now();
            let opened = tokio::select! {
                () = &mut stopped => return,
                opened = Connection::open(&self.outlet) => opened,
            };
            let problem = match opened {
                Err(problem) => problem,
                Ok((connection, claims)) => {
                    self.uplink.is_site(claims.site);
                    let end = self.serve(connection, stopped.as_mut()).await;
                    self.asked = None;
                    self.handle(UplinkInput::Lost);
                    match end {
                        Ended::Stopped => return,
                        Ended::Broken(problem) => problem,
                    }
                }
            };
            if begun.elapsed() >= STEADY {
                tries = 0;
            }
            tries += 1;
            let wait = wait(tries);
            self.outlet.report.failed(problem, tries, Some(wait));
            let again = Instant::now() + wait;
            loop {
                tokio::select! {
                    () = &mut stopped => return,
                    () = tokio::time::sleep_until(again) => break,
                    () = next(&mut self.outbox, &mut self.reading, &mut self.finding,
                              &mut self.uplink, self.began) => self.count(),
                }
            }
        }
    }

    async fn serve(
        &mut self,
        mut connection: Connection,
        mut stopped: Pin<&mut impl Future<Output = ()>>,
    ) -> Ended {
        self.handle(UplinkInput::Connected);
        loop {
            if let Err(problem) = self.drive(&connection).await {
                return Ended::Broken(problem);
            }
            let deadline = self.uplink.deadline().map(|at| self.began + at);
            let due = async {
                match deadline {
                    Some(at) => tokio::time::sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = &mut stopped => {
                    // What is not acknowledged stays in the outbox.
                    let _ = tokio::time::timeout(LINGER, connection.client.flush()).await;
                    return Ended::Stopped;
                }
                event = connection.events.recv() => match event {
                    Some(event) => self.happened(event),
                    None => return Ended::Broken(ended(&"closed")),
                },
                answer = message(Some(&mut connection.answers)) => match answer {
                    Some(answer) => self.answered(&answer),
                    None => return Ended::Broken(ended(&"closed")),
                },
                asked = message(self.asked.as_mut().map(|(_, asked)| asked)) => {
                    match asked {
                        Some(asked) => self.was_asked(&connection, asked).await,
                        None => self.asked = None,
                    }
                }
                () = next(&mut self.outbox, &mut self.reading, &mut self.finding,
                          &mut self.uplink, self.began) => {}
                () = due => {}
            }
        }
    }

    fn handle(&mut self, input: UplinkInput<'_>) {
        self.uplink.handle(self.began.elapsed(), input);
    }

    fn happened(&mut self, event: Event) {
        match event {
            Event::Connected => self.handle(UplinkInput::Connected),
            Event::Disconnected => {
                self.handle(UplinkInput::Lost);
                self.failed(ended(&"disconnected"), None);
            }
            Event::ServerError(ServerError::Other(error)) => {
                self.failed(ended(&error), None);
            }
            _ => {}
        }
    }

    fn answered(&mut self, answer: &Message) {
        let number = answer.subject.rsplit('.').next();
        let Some(number) = number.and_then(|number| number.parse().ok()) else {
            return;
        };
        let is_nobody = answer.status == Some(StatusCode::NO_RESPONDERS);
        let said = (!is_nobody).then_some(&*answer.payload);
        self.handle(UplinkInput::Answer(number, said));
    }

    /// The centre asks something. Whatever it is: what is not known here is refused in words.
    async fn was_asked(&mut self, connection: &Connection, asked: Message) {
        let Some((session, _)) = &self.asked else {
            return;
        };
        if asked.subject.ends_with(".end") {
            let session = session.clone();
            self.handle(UplinkInput::Ended(&session));
        }
        if let Some(reply) = asked.reply {
            let refusal = FleetRefusal {
                code: codes::NO_SUCH_PAGE.code.to_owned(),
                reason: "this version does not know it".to_owned(),
            };
            let said = match asked.subject.ends_with(".end") {
                true => Vec::new(),
                false => refusal.encode_to_vec(),
            };
            // Fails where the connection has ended.
            let _ = connection.client.publish(reply, said.into()).await;
        }
    }

    async fn drive(&mut self, connection: &Connection) -> Result<(), Problem> {
        loop {
            let clock = millis(SystemTime::now());
            let Some(output) = self.uplink.poll(self.began.elapsed(), clock) else {
                break;
            };
            match output {
                UplinkOutput::Publish(message) => publish(connection, message).await?,
                UplinkOutput::Listen(subject, session) => {
                    let asked = connection.client.subscribe(subject).await;
                    let asked = asked.map_err(|error| ended(&error))?;
                    self.asked = Some((session, asked));
                }
                UplinkOutput::Read(after) => {
                    self.reading = Some(Box::pin(self.outbox.read(after, READ_MAX)));
                }
                UplinkOutput::FindState => {
                    self.finding = Some(Box::pin(self.outbox.state()));
                }
                UplinkOutput::Delivered(epoch, to, count) => {
                    self.outbox.delivered(&epoch, to);
                    let counts = self.outlet.report.counts();
                    counts.sent.fetch_add(count, Relaxed);
                }
                UplinkOutput::Works => {
                    self.failures = 0;
                    self.outlet.report.worked();
                }
                UplinkOutput::Fails(fault, wait) => self.failed(problem(fault), Some(wait)),
            }
        }
        self.count();
        Ok(())
    }

    fn failed(&mut self, problem: Problem, wait: Option<Duration>) {
        self.failures = self.failures.saturating_add(1);
        self.outlet.report.failed(problem, self.failures, wait);
    }

    fn count(&self) {
        let behind = usize::try_from(self.uplink.behind()).unwrap_or(usize::MAX);
        self.outlet.report.counts().queue.store(behind, Relaxed);
    }

    /// The outbox is closed, and removed with its outlet.
    async fn end(self) {
        self.outbox.end(CLOSE_MAX).await;
        let config = self.outlet.service.config();
        let now = config.outlets.get(&self.outlet.name);
        if now.is_none_or(|now| now.kind != super::KIND.name) {
            outbox::remove(&self.outlet.outbox_file());
        }
    }
}

/// Waits for what happens to the outbox, and takes it. Can be dropped.
async fn next(
    outbox: &mut OutboxHandle,
    reading: &mut Option<Reading>,
    finding: &mut Option<Finding>,
    uplink: &mut Uplink,
    began: Instant,
) {
    let found = async {
        let Some(under_way) = finding else {
            return std::future::pending().await;
        };
        let found = under_way.await;
        *finding = None;
        found
    };
    let input = tokio::select! {
        state = outbox.changed() => UplinkInput::Stored(head(state)),
        read = outbox::read(reading) => UplinkInput::Read(read),
        found = found => UplinkInput::State(found),
    };
    uplink.handle(began.elapsed(), input);
}

fn head(state: OutboxState) -> OutboxHead {
    OutboxHead {
        epoch: state.epoch,
        newest: state.newest,
        delivered: state.delivered,
    }
}

/// The next message; never, where nothing is listened to. Can be dropped.
async fn message(from: Option<&mut Subscriber>) -> Option<Message> {
    let Some(from) = from else {
        return std::future::pending().await;
    };
    std::future::poll_fn(|context| Pin::new(&mut *from).poll_next(context)).await
}

async fn publish(connection: &Connection, message: UpMessage) -> Result<(), Problem> {
    let mut headers = HeaderMap::new();
    if let Some(id) = message.id {
        headers.insert("Nats-Msg-Id", id);
    }
    let (client, payload) = (&connection.client, message.payload.into());
    let end = match message.answer {
        Some(number) => {
            let reply = format!("{}.{number}", connection.inbox);
            client
                .publish_with_reply_and_headers(message.subject, reply, headers, payload)
                .await
        }
        None => client.publish(message.subject, payload).await,
    };
    end.map_err(|error| ended(&error))
}

fn ended(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_ENDED).with("reason", reason.to_string())
}

fn problem(fault: UplinkFault) -> Problem {
    match fault {
        UplinkFault::Away => Problem::new(codes::FLEET_AWAY),
        UplinkFault::NoSession(code, reason) => {
            let reason = format!("{code} {reason}");
            Problem::new(codes::FLEET_TAKEN).with("reason", reason.trim().to_owned())
        }
        UplinkFault::NotStored(reason) => {
            Problem::new(codes::FLEET_NOT_STORED).with("reason", reason)
        }
        UplinkFault::StateTooLong(length) => Problem::new(codes::FLEET_NOT_STORED).with(
            "reason",
            format!("the picture of this site has {length} bytes"),
        ),
    }
}

/// The number of this installation, made the first time.
fn installation(outlet: &Outlet) -> std::io::Result<[u8; INSTALLATION_LEN]> {
    let path = outlet.kept();
    let kept = std::fs::read_to_string(&path).ok();
    let kept = kept.and_then(|text| serde_json::from_str::<[u8; INSTALLATION_LEN]>(&text).ok());
    if let Some(kept) = kept {
        return Ok(kept);
    }
    let made = random().map_err(std::io::Error::other)?;
    let text = serde_json::to_vec(&made)?;
    durable::replace(&path, &text, Some(0o600))?;
    Ok(made)
}

/// Connects once beside the run, and says which server it is.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let access = FleetAccess::of(&outlet.settings.borrow());
    let (claims, _) = credentials(&access.credentials)?;
    let stopped = outlet.stopped();
    let (connection, _) = tokio::select! {
        () = stopped => return Err(ended(&"stopped")),
        opened = Connection::open(&outlet) => opened?,
    };
    let server = connection.client.server_info();
    let until = claims.expires.and_then(|at| i64::try_from(at).ok());
    let until = until.and_then(|at| jiff::Timestamp::from_second(at).ok());
    let until = until.map(|at| format!(", {}", at.strftime("%Y-%m-%d")));
    Ok(format!(
        "{}, nats-server {}{}",
        claims.site,
        server.version,
        until.unwrap_or_default()
    ))
}
