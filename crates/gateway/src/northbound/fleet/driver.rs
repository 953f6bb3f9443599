//! Drives the site's side of its way to the centre.

use super::asked::{self, RunTime, refused};
use super::connection::{Connection, LinkState, RECONNECT_MAX, credentials};
use super::files::{self, Configured};
use super::managed::{self, Managed};
use super::settings::FleetAccess;
use super::trial_files::TrialFiles;
use crate::access::secret::random;
use crate::clock::since_boot;
use crate::nats::{next, unusable};
use crate::northbound::broker::session::Tries;
use crate::northbound::outbox::{self, OutboxHandle, OutboxState, Reading, StateAt};
use crate::northbound::outlet::Outlet;
use crate::remote_api::RemoteKind;
use async_nats::connection::State;
use async_nats::{HeaderMap, Message, StatusCode, Subject, Subscriber};
use prost::Message as _;
use railbus_api::problem::{Problem, codes};
use railbus_fleet::message::{CommandRequest, Resend, ResendAnswer};
use railbus_fleet::uplink::{
    NoResend, OutboxHead, READ_MAX, SiteIdentity, UpMessage, Uplink, UplinkFault, UplinkInput,
    UplinkOutput,
};
use railbus_fleet::{API_ANSWER_MAX, KEY_ENDS_SOON_S, read_site_creds, renewed_creds};
use railbus_store::durable;
use railbus_store::history::millis;
use std::io::ErrorKind;
use std::path::Path;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;

/// How long the last messages may take, once it is to stop.
const LINGER: Duration = Duration::from_secs(1);
/// How long the outbox may take to be closed.
const CLOSE_MAX: Duration = Duration::from_secs(2);
/// How long a trial that was left may take to be taken back where nothing else works.
const SETTLE_MAX: Duration = Duration::from_secs(10);
/// How often it is looked whether a disk still hangs.
const LOOK: Duration = Duration::from_secs(1);
/// Of answers longer than this, in bytes, one is sent at a time.
const LONG: usize = 32 << 10;
/// Every installation has its own number.
const INSTALLATION_LEN: usize = 16;

/// How everything is, while it is being found out.
type Finding = Pin<Box<dyn Future<Output = Option<StateAt>>>>;

/// What is recorded of the site, and what is being read of it.
struct Recorded {
    outbox: OutboxHandle,
    reading: Option<Reading>,
    finding: Option<Finding>,
}

struct Driver {
    uplink: Uplink,
    recorded: Recorded,
    /// What the centre asks, in the session of this name.
    asked: Option<(String, Subscriber)>,
    /// It has worked with these claims, and that their key ends soon was said.
    has_worked: bool,
    is_key_end_said: bool,
    /// It has other claims than those with which it is connected.
    has_new_claims: bool,
    /// How many failures were reported since it worked.
    failures: u32,
    /// What is known of the connection.
    link: LinkState,
    /// Which run this is, and its time.
    run: RunTime,
    /// Takes the configuration from the centre, if that may say it.
    managed: Option<Managed>,
    /// Held while a long answer of the API is sent.
    long_answers: Arc<Semaphore>,
    outlet: Outlet,
}

/// Why a connection is no longer used.
enum Ended {
    Stopped,
    /// There is no outbox any more, or nothing that takes configurations.
    Gone(Problem),
    /// With the claims of this connection the servers would end it soon.
    Renewed,
    Broken(Problem),
}

/// Reports until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let (kept, outboxes) = outlet.left_behind();
    outboxes.iter().for_each(|file| outbox::remove(file));
    // What stays is removed by the next one.
    kept.iter().for_each(|file| _ = std::fs::remove_file(file));
    let internal =
        |error: &dyn ToString| Problem::new(codes::INTERNAL).with("reason", error.to_string());
    let days = outlet.number("replay_days");
    let installation = installation(&outlet)?;
    let configured = Configured::of(&outlet.service.config(), outlet.kind.name);
    files::remove_stale(&outlet.folder, &configured);
    let boot = random().map_err(|error| internal(&error))?;
    let managed = Managed::start(&outlet)?;
    let outbox = match outbox::start_for_again(&outlet, days) {
        Ok(outbox) => outbox,
        Err(problem) => {
            // A trial that was left does not wait for it.
            if let Some(managed) = managed {
                managed.settle(SETTLE_MAX).await;
            }
            return Err(problem);
        }
    };
    let own = SiteIdentity {
        installation,
        boot,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let mut driver = Driver {
        uplink: Uplink::new(own),
        recorded: Recorded {
            outbox,
            reading: None,
            finding: None,
        },
        asked: None,
        has_worked: false,
        is_key_end_said: false,
        has_new_claims: false,
        failures: 0,
        link: LinkState::default(),
        run: RunTime {
            boot,
            began: since_boot(),
        },
        managed,
        long_answers: Arc::new(Semaphore::new(1)),
        outlet,
    };
    let end = driver.work().await;
    driver.end().await;
    end
}

impl Recorded {
    /// What happens next; none once there is no outbox. Can be dropped.
    async fn next(&mut self) -> Option<UplinkInput<'static>> {
        let finding = &mut self.finding;
        let found = async {
            let Some(under_way) = finding else {
                return std::future::pending().await;
            };
            let found = under_way.await;
            *finding = None;
            found
        };
        Some(tokio::select! {
            state = self.outbox.news() => UplinkInput::Stored(head(state?)),
            read = outbox::read(&mut self.reading) => UplinkInput::Read(read),
            found = found => UplinkInput::State(found),
        })
    }
}

impl Driver {
    async fn work(&mut self) -> Result<(), Problem> {
        let stopped = self.outlet.stopped();
        let mut stopped = pin!(stopped);
        let mut tries = Tries::default();
        loop {
            let begun = Instant::now();
            let opened = tokio::select! {
                () = &mut stopped => return Ok(()),
                problem = managed::ended(self.managed.as_mut()) => return Err(problem),
                opened = Connection::open(&self.outlet) => opened,
            };
            let problem = match opened {
                Err(problem) => problem,
                Ok((connection, claims, token)) => {
                    self.uplink.set_claims(&claims, token);
                    (self.has_worked, self.is_key_end_said) = (false, false);
                    self.has_new_claims = false;
                    let managed = self.managed.as_ref();
                    let _following =
                        managed.map(|own| own.follow(&connection.client, &claims.site));
                    let end = self.serve(connection, stopped.as_mut()).await;
                    self.asked = None;
                    self.handle(UplinkInput::Lost);
                    tries.connected_since(begun);
                    match end {
                        Ended::Stopped => return Ok(()),
                        Ended::Gone(problem) => return Err(problem),
                        Ended::Renewed => continue,
                        Ended::Broken(problem) => problem,
                    }
                }
            };
            let (tries, wait) = tries.failed();
            self.outlet.report.failed(problem, tries, Some(wait));
            let again = Instant::now() + wait;
            loop {
                tokio::select! {
                    () = &mut stopped => return Ok(()),
                    problem = managed::ended(self.managed.as_mut()) => return Err(problem),
                    () = tokio::time::sleep_until(again) => break,
                    input = self.recorded.next() => match input {
                        Some(input) => {
                            self.handle(input);
                            self.count();
                        }
                        None => return Err(gone()),
                    },
                }
            }
        }
    }

    async fn serve(
        &mut self,
        mut connection: Connection,
        mut stopped: Pin<&mut impl Future<Output = ()>>,
    ) -> Ended {
        self.link = connection.state.borrow_and_update().clone();
        self.connected(&connection);
        loop {
            let driven = tokio::select! {
                // A line that takes nothing must not hold up the end.
                () = &mut stopped => return Ended::Stopped,
                driven = self.drive(&connection) => driven,
            };
            if let Err(problem) = driven {
                return Ended::Broken(problem);
            }
            if std::mem::take(&mut self.has_new_claims) {
                // What is not acknowledged is sent again.
                let _ = tokio::time::timeout(LINGER, connection.client.flush()).await;
                return Ended::Renewed;
            }
            // What was suspended on the way is due sooner.
            let now = self.run.now();
            let deadline = self.uplink.deadline();
            let deadline = deadline.map(|at| Instant::now() + at.saturating_sub(now));
            // A disk that hangs does not say when it no longer does.
            let look = self
                .recorded
                .outbox
                .is_stuck()
                .then(|| Instant::now() + LOOK);
            let deadline = [deadline, look].into_iter().flatten().min();
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
                changed = connection.state.changed() => match changed {
                    Ok(()) => {
                        let state = connection.state.borrow_and_update().clone();
                        self.happened(&connection, state);
                    }
                    Err(_) => return Ended::Broken(ended(&"closed")),
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
                input = self.recorded.next() => match input {
                    Some(input) => self.handle(input),
                    None => return Ended::Gone(gone()),
                },
                changed = managed::changed(self.managed.as_mut()) => {
                    if let Err(problem) = changed {
                        return Ended::Gone(problem);
                    }
                }
                () = due => {}
            }
        }
    }

    fn handle(&mut self, input: UplinkInput<'_>) {
        self.uplink.handle(self.run.now(), input);
        self.tell_managed();
    }

    fn tell_managed(&self) {
        if let Some(managed) = &self.managed {
            managed.set_session(self.uplink.has_session());
        }
    }

    /// The centre issued these claims: they are put in the place of those in the file.
    fn renewed(&mut self, token: &str) {
        let path = FleetAccess::of(&self.outlet.settings.borrow()).credentials;
        let end = credentials(&path).and_then(|(own, text)| {
            // Of another site or key: not asked for by this one.
            let new =
                renewed_creds(&text, token).and_then(|text| Ok((read_site_creds(&text)?, text)));
            let Ok((new, text)) = new else {
                return Ok(false);
            };
            if new.expires <= own.expires {
                let behind = "the clock of the centre is behind";
                return Err(Problem::new(codes::NO_KEY).with("reason", behind));
            }
            // It may be a link to where it is kept.
            let file = std::fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
            let written = durable::replace(&file, text.as_bytes(), Some(0o600));
            written.map_err(|error| unusable(&path, &error))?;
            Ok(true)
        });
        match end {
            Ok(is_new) => self.has_new_claims = is_new,
            Err(problem) => self.outlet.report.noted(problem, 1),
        }
    }

    /// Says once that its key ends soon, by the clock of the centre.
    fn tell_key_end(&mut self) {
        let clock_ms = millis(SystemTime::now());
        let ends = self
            .uplink
            .key_ends(self.run.now(), clock_ms, KEY_ENDS_SOON_S);
        if let Some(at) = ends.filter(|_| self.has_worked && !self.is_key_end_said) {
            self.is_key_end_said = true;
            let problem = Problem::new(codes::FLEET_KEY_ENDS).with("reason", day(at));
            self.outlet.report.noted(problem, 1);
        }
    }

    fn connected(&mut self, connection: &Connection) {
        let most = connection.client.max_payload();
        self.handle(UplinkInput::Connected(most));
    }

    fn happened(&mut self, connection: &Connection, state: LinkState) {
        let before = std::mem::replace(&mut self.link, state);
        // It may be there again already.
        if self.link.losses != before.losses {
            self.handle(UplinkInput::Lost);
            self.failed(ended(&"disconnected"), Some(RECONNECT_MAX));
        }
        if self.link.is_up {
            self.connected(connection);
        }
        if self.link.complaints != before.complaints {
            let problem = ended(&self.link.complaint);
            self.outlet.report.noted(problem, 1);
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

    /// The centre asks something. Whatever it is, it is answered.
    async fn was_asked(&mut self, connection: &Connection, asked: Message) {
        let Some((session, _)) = &self.asked else {
            return;
        };
        let said = match asked.subject.rsplit('.').next() {
            Some("end") => {
                let session = session.clone();
                self.handle(UplinkInput::Ended(&session));
                Vec::new()
            }
            Some("api") => match self.outlet.api.permit(RemoteKind::Read) {
                Ok(permit) => {
                    self.ask_api(connection, asked, permit);
                    return;
                }
                Err(problem) => refused(&problem).encode_to_vec(),
            },
            Some("cmd") => match asked::command_request(&asked.payload, &self.outlet.api) {
                Ok((request, permit)) => {
                    self.carry_out(connection, asked.reply, request, permit);
                    return;
                }
                Err(problem) => asked::not_begun(&problem).encode_to_vec(),
            },
            Some("config") => managed::told(self.managed.as_ref()).encode_to_vec(),
            Some("resend") => self.resend(&asked.payload).encode_to_vec(),
            Some("state") => {
                self.uplink.send_state();
                ResendAnswer::default().encode_to_vec()
            }
            // The form of every answer that is a refusal.
            _ => refused(&Problem::new(codes::NO_SUCH_PAGE)).encode_to_vec(),
        };
        if let Some(reply) = asked.reply {
            // Fails where the connection has ended.
            let _ = connection.client.publish(reply, said.into()).await;
        }
    }

    /// Asks the API of this site and sends its answer, beside everything else. The permit is held
    /// until the answer is sent, so their number is limited.
    fn ask_api(&self, connection: &Connection, asked: Message, permit: OwnedSemaphorePermit) {
        let Some(reply) = asked.reply else {
            return;
        };
        let (api, client) = (Arc::clone(&self.outlet.api), connection.client.clone());
        let (name, long) = (self.outlet.name.clone(), Arc::clone(&self.long_answers));
        tokio::spawn(async move {
            let begun = Instant::now();
            let (answer, permit) = asked::api(&api, &name, &asked.payload, permit).await;
            let payload = answer.encode_to_vec();
            // One long answer at a time: heartbeats wait for what is being sent.
            let turn = match payload.len() > LONG {
                true => long.acquire_owned().await.ok(),
                false => None,
            };
            let is_awaited = begun.elapsed() < API_ANSWER_MAX;
            if is_awaited && client.connection_state() == State::Connected {
                // Both fail if the connection has ended.
                let _ = client.publish(reply, payload.into()).await;
                let _ = client.flush().await;
            }
            drop((turn, permit));
        });
    }

    /// Gives a command to this site, or tells what came of it, beside everything else.
    fn carry_out(
        &self,
        connection: &Connection,
        reply: Option<Subject>,
        request: CommandRequest,
        permit: OwnedSemaphorePermit,
    ) {
        let Some(reply) = reply else {
            return;
        };
        let (api, client) = (Arc::clone(&self.outlet.api), connection.client.clone());
        let (name, rights) = (self.outlet.name.clone(), self.outlet.rights());
        let run = self.run;
        tokio::spawn(async move {
            let (answer, permit) =
                asked::command(&api, &name, (run, rights), request, permit).await;
            let sent = async {
                if client.connection_state() == State::Connected {
                    // Both fail if the connection has ended: the centre asks again.
                    let _ = client.publish(reply, answer.encode_to_vec().into()).await;
                    let _ = client.flush().await;
                }
            };
            // A connection that stands still must not keep the permit.
            let _ = tokio::time::timeout(API_ANSWER_MAX, sent).await;
            drop(permit);
        });
    }

    fn resend(&mut self, asked: &[u8]) -> ResendAnswer {
        let end = match Resend::decode(asked) {
            Ok(asked) => self
                .uplink
                .resend(&asked.epoch, (asked.first, asked.last))
                .map_err(|why| match why {
                    NoResend::Epoch => Problem::new(codes::FLEET_EPOCH),
                    NoResend::Busy => Problem::new(codes::OVERLOADED),
                }),
            Err(why) => Err(Problem::new(codes::BAD_REQUEST).with("reason", why.to_string())),
        };
        match end {
            Ok(()) => ResendAnswer::default(),
            Err(problem) => refused(&problem),
        }
    }

    async fn drive(&mut self, connection: &Connection) -> Result<(), Problem> {
        self.handle(UplinkInput::Stuck(self.recorded.outbox.is_stuck()));
        let report = self.managed.as_ref().map(Managed::report);
        self.uplink.set_config(report);
        loop {
            let clock = millis(SystemTime::now());
            let Some(output) = self.uplink.poll(self.run.now(), clock) else {
                break;
            };
            match output {
                UplinkOutput::Publish(message) => publish(connection, message).await?,
                UplinkOutput::Listen(subject, session) => {
                    self.asked = None;
                    let asked = connection.client.subscribe(subject).await;
                    let asked = asked.map_err(|error| ended(&error))?;
                    self.asked = Some((session, asked));
                }
                UplinkOutput::Unlisten => self.asked = None,
                UplinkOutput::Read(after) => {
                    self.recorded.reading =
                        Some(Box::pin(self.recorded.outbox.read(after, READ_MAX)));
                }
                UplinkOutput::ReadAgain(span) => {
                    self.recorded.reading =
                        Some(Box::pin(self.recorded.outbox.read_again(span, READ_MAX)));
                }
                UplinkOutput::FindState => {
                    self.recorded.finding = Some(Box::pin(self.recorded.outbox.state()));
                }
                UplinkOutput::Delivered(epoch, to, count) => {
                    self.recorded.outbox.delivered(&epoch, to);
                    let counts = self.outlet.report.counts();
                    counts.sent.fetch_add(count, Relaxed);
                }
                UplinkOutput::Renewed(token) => self.renewed(&token),
                UplinkOutput::NotRenewed(reason) => {
                    let problem = Problem::new(codes::NO_KEY).with("reason", reason);
                    self.outlet.report.noted(problem, 1);
                }
                UplinkOutput::Works => {
                    self.failures = 0;
                    self.outlet.report.worked();
                    self.has_worked = true;
                }
                UplinkOutput::Fails(fault, wait) => {
                    let file = self.outlet.outbox_file();
                    self.failed(problem(fault, &file), Some(wait));
                }
            }
        }
        self.tell_managed();
        self.tell_key_end();
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
    async fn end(mut self) {
        if let Some(managed) = self.managed.take() {
            managed.end(CLOSE_MAX).await;
        }
        self.recorded.outbox.end(CLOSE_MAX).await;
        if self.outlet.is_gone() {
            outbox::remove(&self.outlet.outbox_file());
            // What stays is removed by the next outlet of this kind.
            let _ = std::fs::remove_file(self.outlet.kept());
            TrialFiles::new(&self.outlet.folder, &self.outlet.name).remove_managed();
            let credentials = FleetAccess::of(&self.outlet.settings.borrow()).credentials;
            let config = self.outlet.service.config();
            let configured = Configured::of(&config, self.outlet.kind.name);
            let (folder, name) = (&self.outlet.folder, &self.outlet.name);
            files::remove_of(folder, name, &credentials, &configured);
        }
    }
}

fn head(state: OutboxState) -> OutboxHead {
    OutboxHead {
        epoch: state.epoch,
        newest: state.newest,
        delivered: state.delivered,
        is_failing: state.is_failing,
    }
}

/// The next message; never, where nothing is listened to. Cancel-safe.
async fn message(from: Option<&mut Subscriber>) -> Option<Message> {
    match from {
        Some(from) => next(from).await,
        None => std::future::pending().await,
    }
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

/// The thread of the outbox has ended.
fn gone() -> Problem {
    Problem::new(codes::OUTBOX_FAILS).with("reason", "its thread has ended")
}

fn ended(reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_ENDED).with("reason", reason.to_string())
}

fn problem(fault: UplinkFault, outbox: &Path) -> Problem {
    match fault {
        UplinkFault::Away => Problem::new(codes::FLEET_AWAY),
        UplinkFault::NoSession(code, reason) => {
            let reason = format!("{code} {reason}");
            Problem::new(codes::FLEET_TAKEN).with("reason", reason.trim().to_owned())
        }
        UplinkFault::NotStored(reason) => {
            Problem::new(codes::FLEET_NOT_STORED).with("reason", reason)
        }
        UplinkFault::NotRecorded => {
            Problem::new(codes::OUTBOX_FAILS).with("path", outbox.display().to_string())
        }
        UplinkFault::StateTooLong(length) => Problem::new(codes::FLEET_NOT_STORED).with(
            "reason",
            format!("the picture of this site has {length} bytes"),
        ),
    }
}

/// The number of this installation, made the first time. A file that has none is not replaced: with
/// another number it would be another machine to the centre.
fn installation(outlet: &Outlet) -> Result<[u8; INSTALLATION_LEN], Problem> {
    let path = outlet.kept();
    let unusable = |reason: &dyn ToString| unusable(&path, reason);
    match std::fs::read(&path) {
        Ok(text) => return serde_json::from_slice(&text).map_err(|error| unusable(&error)),
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(unusable(&error)),
    }
    let made = random().map_err(|error| unusable(&error))?;
    let text = serde_json::to_vec(&made).map_err(|error| unusable(&error))?;
    durable::replace(&path, &text, Some(0o600)).map_err(|error| unusable(&error))?;
    Ok(made)
}

/// The day of a time in seconds since 1970.
fn day(at: i64) -> String {
    let at = jiff::Timestamp::from_second(at).unwrap_or(jiff::Timestamp::MAX);
    at.strftime("%Y-%m-%d").to_string()
}

/// Connects once beside the run, and says which server it is.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let stopped = outlet.stopped();
    let (connection, claims, _) = tokio::select! {
        () = stopped => return Err(ended(&"stopped")),
        opened = Connection::open(&outlet) => opened?,
    };
    let server = connection.client.server_info();
    let until = claims.expires.and_then(|at| i64::try_from(at).ok());
    let until = until.map(|at| format!(", {}", day(at)));
    Ok(format!(
        "{}, nats-server {}{}",
        claims.site,
        server.version,
        until.unwrap_or_default()
    ))
}
